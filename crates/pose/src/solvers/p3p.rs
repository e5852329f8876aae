//! Camera poses through three points and their directions.
//!
//! The distances `d` along the unit directions `y` satisfy `dᵢ² + dⱼ² − 2 dᵢ dⱼ yᵢ·yⱼ = ‖xᵢ − xⱼ‖²`. Two quotients of these are cones
//! in `d`; one of the pencil they span is a pair of planes, found from a cubic. Each plane meets a cone in at most two rays.
//!
//! Precondition: the points are not on a line and the directions differ.
//!
//! # Source
//! Persson, Nordberg 2018, "Lambda Twist: An Accurate Fast Robust P3P Solver", ECCV; the split of the degenerate conic: Richter-Gebert
//! 2011, "Perspectives on Projective Geometry", §11.3.

use crate::polynomial::{MAX_DEGREE, real_roots};
use selenograph_geometry::{Matrix3, Rotation3, Vector3};

/// A pose of a camera: `x_in_cam = rotation · x_in_world + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPose {
    /// Rotation from the world's axes to the camera's.
    pub rotation: Matrix3<f64>,
    /// Where the world's origin lies in the camera.
    pub translation: Vector3<f64>,
}

/// All poses (at most four) with the points in front, appended to `out`.
///
/// # Shapes and units
/// `world`: three points. `directions`: unit vectors in the camera.
pub fn p3p(world: &[Vector3<f64>; 3], directions: &[Vector3<f64>; 3], out: &mut Vec<CameraPose>) {
    let sides = [
        (world[0] - world[1]).norm_squared(),
        (world[0] - world[2]).norm_squared(),
        (world[1] - world[2]).norm_squared(),
    ];
    let cosines = [
        directions[0].dot(&directions[1]),
        directions[0].dot(&directions[2]),
        directions[1].dot(&directions[2]),
    ];
    let forms = [
        Matrix3::new(1.0, -cosines[0], 0.0, -cosines[0], 1.0, 0.0, 0.0, 0.0, 0.0),
        Matrix3::new(1.0, 0.0, -cosines[1], 0.0, 0.0, 0.0, -cosines[1], 0.0, 1.0),
        Matrix3::new(0.0, 0.0, 0.0, 0.0, 1.0, -cosines[2], 0.0, -cosines[2], 1.0),
    ];
    let longest = sides[0].max(sides[1]).max(sides[2]);
    if longest <= 0.0 || !longest.is_finite() {
        return;
    }
    let first = (forms[0] * sides[2] - forms[2] * sides[0]) / longest;
    let second = (forms[1] * sides[2] - forms[2] * sides[1]) / longest;
    let Some(planes) = plane_pair(&first, &second) else { return };
    for plane in planes {
        for ray in rays(&plane, &first, &second).into_iter().flatten() {
            let Some(distances) = scaled(&ray, &forms, &sides) else { continue };
            let known = out.iter().any(|pose| {
                (pose.rotation * world[0] + pose.translation - distances[0] * directions[0]).norm()
                    < 1e-9 * distances.norm()
                    && (pose.rotation * world[1] + pose.translation - distances[1] * directions[1]).norm()
                        < 1e-9 * distances.norm()
            });
            if !known {
                out.extend(aligned(world, directions, &distances));
            }
        }
    }
}

/// The two planes `gᵀ d = 0` whose product is in the pencil of the cones.
fn plane_pair(first: &Matrix3<f64>, second: &Matrix3<f64>) -> Option<[Vector3<f64>; 2]> {
    // det(first + γ second), by its values: mixed determinants are sums of column exchanges.
    let mixed = |p: &Matrix3<f64>, q: &Matrix3<f64>| {
        (0..3)
            .map(|k| {
                let mut m = *p;
                m.set_column(k, &q.column(k));
                m.determinant()
            })
            .sum::<f64>()
    };
    let cubic = [first.determinant(), mixed(first, second), mixed(second, first), second.determinant()];
    let mut roots = [0.0; MAX_DEGREE];
    let count = real_roots(&cubic, &mut roots);
    let mut best: Option<(f64, [Vector3<f64>; 2])> = None;
    for &gamma in &roots[..count] {
        let conic = (first + gamma * second) / (1.0 + gamma.abs());
        let adjugate = -adjugate(&conic);
        let k = adjugate.diagonal().imax();
        let square = adjugate[(k, k)];
        // Negative: the two planes are complex and share one real line only.
        if square < 0.0 || best.as_ref().is_some_and(|(s, _)| square <= *s) {
            continue;
        }
        let root = square.sqrt();
        let p = if root > 0.0 { adjugate.column(k) / root } else { Vector3::zeros() };
        let product = conic + p.cross_matrix();
        let (mut row, mut column, mut largest) = (0, 0, 0.0);
        for i in 0..3 {
            for j in 0..3 {
                if product[(i, j)].abs() > largest {
                    (row, column, largest) = (i, j, product[(i, j)].abs());
                }
            }
        }
        if largest > 0.0 {
            best = Some((square, [product.row(row).transpose(), product.column(column).into_owned()]));
        }
    }
    best.map(|(_, planes)| planes)
}

fn adjugate(m: &Matrix3<f64>) -> Matrix3<f64> {
    let (r0, r1, r2) = (m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose());
    Matrix3::from_columns(&[r1.cross(&r2), r2.cross(&r0), r0.cross(&r1)])
}

/// Rays of a plane on the cones: a basis of the plane, and a quadratic in the cone that restricts more.
fn rays(plane: &Vector3<f64>, first: &Matrix3<f64>, second: &Matrix3<f64>) -> [Option<Vector3<f64>>; 2] {
    let normal = plane.normalize();
    let u = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    let v = normal.cross(&u);
    let restrict = |c: &Matrix3<f64>| [u.dot(&(c * u)), u.dot(&(c * v)), v.dot(&(c * v))];
    let size = |q: &[f64; 3]| q.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let (p, q) = (restrict(first), restrict(second));
    let [a, b, c] = if size(&p) >= size(&q) { p } else { q };
    // A ray that only just touches is lost to rounding otherwise.
    let discriminant = b * b - a * c;
    if discriminant < -1e-14 * size(&[a, b, c]).powi(2) {
        return [None, None];
    }
    let root = discriminant.max(0.0).sqrt();
    let sum = -(b + if b < 0.0 { -root } else { root });
    // a s² + 2 b s t + c t² = 0 for the ray s u + t v: (s : t) = (sum : a) and (c : sum).
    let one = if sum == 0.0 && a == 0.0 { None } else { Some(u * sum + v * a) };
    let other = if sum == 0.0 && c == 0.0 { None } else { Some(u * c + v * sum) };
    [one, other]
}

/// Distances of the right size and sign, polished by Newton's method; none where one is not positive.
fn scaled(ray: &Vector3<f64>, forms: &[Matrix3<f64>; 3], sides: &[f64; 3]) -> Option<Vector3<f64>> {
    let ray = if ray.sum() < 0.0 { -ray.normalize() } else { ray.normalize() };
    let (mut form, mut side) = (0.0, 0.0);
    for (f, s) in forms.iter().zip(sides) {
        form += ray.dot(&(f * ray));
        side += s;
    }
    let mut d = ray * (side / form).sqrt();
    if !d.iter().all(|v| v.is_finite() && *v > 0.0) {
        return None;
    }
    for _ in 0..3 {
        let residual = Vector3::from_fn(|k, _| d.dot(&(forms[k] * d)) - sides[k]);
        let rows = forms.map(|f| (2.0 * f * d).transpose());
        let Some(inverse) = Matrix3::from_rows(&rows).try_inverse() else { break };
        let step = inverse * residual;
        // Near a double solution the step is not to be trusted.
        if step.norm().is_nan() || step.norm() >= 0.1 * d.norm() {
            break;
        }
        d -= step;
    }
    d.iter().all(|v| *v > 0.0).then_some(d)
}

/// The pose that carries the triangle of the world onto the one at the given distances.
fn aligned(
    world: &[Vector3<f64>; 3],
    directions: &[Vector3<f64>; 3],
    distances: &Vector3<f64>,
) -> Option<CameraPose> {
    let cam: [Vector3<f64>; 3] = std::array::from_fn(|k| directions[k] * distances[k]);
    let frame = |p: &[Vector3<f64>; 3]| {
        let (u, v) = (p[1] - p[0], p[2] - p[0]);
        Matrix3::from_columns(&[u, v, u.cross(&v)])
    };
    let rotation = frame(&cam) * frame(world).try_inverse()?;
    let rotation =
        Rotation3::from_matrix_unchecked(crate::decompose::nearest_rotation(&rotation)).into_inner();
    let translation = cam[0] - rotation * world[0];
    rotation.iter().all(|v| v.is_finite()).then_some(CameraPose { rotation, translation })
}
