use super::equations::{
    CellEquations, Equations, PerUnknown, Regular, Solver, add_scaled, along, neighbours,
};
use super::globals::{Free, Global, Globals, PHASE_POWERS, Shot};
use super::linearise::{Axes, LawTable, Surface, linearise, see};
use super::*;
use crate::field::conjugate::dot;
use selenograph_geometry::{Camera, DMatrix, Point2};

/// A smooth rough ground in cells, with slopes up to about 20°.
fn relief(x: f64, y: f64) -> f64 {
    1.2 * (0.31 * x).sin() * (0.27 * y).cos()
        + 0.8 * (0.17 * x + 0.23 * y).sin()
        + 0.3 * (0.6 * x - 0.5 * y).cos()
        + 1.5 * (0.05 * x).cos() * (0.07 * y).sin()
}

/// Two cameras over the plane `z = height`, looking down (the scene's z points down), the second one moved and turned.
fn cameras(side: usize, height: f64) -> [(Camera, Rigid3<Cam, PredA>); 2] {
    let camera = Camera::from_fov(side, side, 0.7).unwrap();
    let turn = Rotation3::from_euler_angles(0.02, 0.14, 0.05);
    let center = Point3::new(0.15 * height, 0.02 * height, -0.03 * height);
    let second = Rigid3::new(turn, Point3::from(-(turn * center.coords)));
    [(camera.clone(), Rigid3::identity()), (camera, second)]
}

/// A picture of the relief over the plane `z = height`, one cell a unit.
fn rendered(camera: &Camera, pose: &Rigid3<Cam, PredA>, height: f64, sun: &Vector3<f64>) -> View {
    let back = pose.inverse();
    let origin = back.origin().coords;
    let law = Brdf::default();
    let grey = |x: f64, y: f64| {
        let ray = back.vector(&camera.ray_z1(&Point2::new(x, y)).unwrap());
        let mut t = (height - origin.z) / ray.z;
        for _ in 0..40 {
            let p = origin + ray * t;
            t += (height - relief(p.x, p.y) - p.z) / ray.z;
        }
        let p = origin + ray * t;
        let step = 1e-4;
        let by_x = (relief(p.x + step, p.y) - relief(p.x - step, p.y)) / (2.0 * step);
        let by_y = (relief(p.x, p.y + step) - relief(p.x, p.y - step)) / (2.0 * step);
        let normal = Vector3::new(-by_x, -by_y, -1.0).normalize();
        let eye = (origin - p).normalize();
        0.9 * law.radiance_factor(normal.dot(sun), normal.dot(&eye), eye.dot(sun), 1.0)
    };
    // Over an area a little larger than the pixel, as optics blur.
    let offsets = [-0.7, -0.35, 0.0, 0.35, 0.7];
    let image = Raster::from_fn(camera.width, camera.height, |x, y| {
        let at = |i: f64, j: f64| grey(x as f64 + 0.5 + i, y as f64 + 0.5 + j);
        let sum: f64 =
            offsets.iter().flat_map(|i| offsets.iter().map(move |j| (*i, *j))).map(|(i, j)| at(i, j)).sum();
        (sum / 25.0) as f32
    });
    View { image, camera: camera.clone() }
}

fn sun(azimuth_deg: f64, elevation_deg: f64) -> Vector3<f64> {
    let (a, e) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    Vector3::new(e.cos() * a.cos(), e.cos() * a.sin(), -e.sin())
}

struct Scene {
    views: Vec<View>,
    poses: Vec<Rigid3<Cam, PredA>>,
    suns: Vec<Vector3<f64>>,
    height: f64,
}

const SIDE: usize = 96;

fn scene(suns: [Vector3<f64>; 2]) -> Scene {
    // One pixel is a cell of the ground.
    let height = SIDE as f64 / (2.0 * (0.35f64).tan());
    let cameras = cameras(SIDE, height);
    let views = cameras.iter().zip(&suns).map(|((c, p), s)| rendered(c, p, height, s)).collect();
    Scene { views, poses: cameras.iter().map(|(_, p)| *p).collect(), suns: suns.to_vec(), height }
}

impl Scene {
    fn pictures(&self) -> Vec<Picture<'_>> {
        (0..self.views.len())
            .map(|k| Picture {
                view: &self.views[k],
                cam_from_scene: self.poses[k],
                pose_sigma: None,
                sun: self.suns[k],
                sun_sigma_rad: 0.0,
            })
            .collect()
    }

    fn start(&self) -> Start<'_> {
        let plane = Plane {
            center: Vector3::new(0.0, 0.0, self.height),
            normal: -Vector3::z(),
            residual_rms: 0.0,
            spread: 1.0,
        };
        Start { plane, views: None, ground: None, least_cell: 0.0 }
    }

    /// Root mean square error of the heights where both pictures see the ground, in cells of the relief, a plane taken off: that both
    /// lean together is what two pictures tell least.
    fn error(&self, shaded: &Shaded) -> f64 {
        let mut differences = Vec::new();
        for y in 0..shaded.patch.height {
            for x in 0..shaded.patch.width {
                let at = [x as f64 + 0.5, y as f64 + 0.5, f64::from(shaded.heights[(x, y)])];
                let point = shaded.patch.point_of(at.map(|c| c as f32));
                let inside = self.poses.iter().zip(&self.views).all(|(pose, view)| {
                    let pixel = view.camera.project(&pose.point(&point.into()));
                    pixel.is_some_and(|p| {
                        p.x > 4.0 && p.y > 4.0 && p.x < SIDE as f64 - 4.0 && p.y < SIDE as f64 - 4.0
                    })
                });
                if inside {
                    differences.push([point.x, point.y, self.height - point.z - relief(point.x, point.y)]);
                }
            }
        }
        assert!(differences.len() > SIDE * SIDE / 2, "{}", differences.len());
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for [x, y, d] in &differences {
            let basis = Vector3::new(1.0, *x, *y);
            normal += basis * basis.transpose();
            right += basis * *d;
        }
        let plane = normal.try_inverse().unwrap() * right;
        let off = differences.iter().map(|[x, y, d]| (d - plane.dot(&Vector3::new(1.0, *x, *y))).powi(2));
        (off.sum::<f64>() / differences.len() as f64).sqrt()
    }
}

fn shaded(scene: &Scene, pictures: &[Picture<'_>]) -> Shaded {
    shade(pictures, &scene.start(), &even()).unwrap()
}

/// Ground of one albedo: what is left is the shape.
fn even() -> ShadingOptions {
    ShadingOptions { albedo_step: 1e-4, estimate_weights: false, ..ShadingOptions::default() }
}

#[test]
fn two_suns_give_the_relief_from_a_plane() {
    let scene = scene([sun(20.0, 35.0), sun(130.0, 30.0)]);
    let shaded = shaded(&scene, &scene.pictures());
    // The relief's own root mean square is 0.85 cells.
    let error = scene.error(&shaded);
    assert!(error < 0.05, "{error}");
    for picture in &shaded.pictures {
        assert!(picture.correlation > 0.995, "{}", picture.correlation);
        assert!((picture.gain / 0.9 - 1.0).abs() < 0.02, "{}", picture.gain);
    }
}

#[test]
fn the_order_of_the_pictures_and_the_unit_do_not_matter() {
    let scene = scene([sun(20.0, 35.0), sun(130.0, 30.0)]);
    let first = scene.error(&shaded(&scene, &scene.pictures()));
    let mut pictures = scene.pictures();
    pictures.reverse();
    let swapped = scene.error(&shaded(&scene, &pictures));
    // Another grid over the same ground: not the same bits, the same surface.
    assert!((first - swapped).abs() < 0.02, "{first} {swapped}");
    let larger = Scene {
        poses: scene.poses.iter().map(|p| scaled(p, 1000.0)).collect(),
        height: 1000.0 * scene.height,
        views: scene.views.clone(),
        suns: scene.suns.clone(),
    };
    let large = shade(&larger.pictures(), &larger.start(), &even()).unwrap();
    let small = shaded(&scene, &scene.pictures());
    let worst =
        large.heights.data.iter().zip(&small.heights.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-2, "{worst}");
}

fn scaled(pose: &Rigid3<Cam, PredA>, factor: f64) -> Rigid3<Cam, PredA> {
    Rigid3::new(Rotation3::from_matrix(&pose.rotation()), Point3::from(pose.origin().coords * factor))
}

#[test]
fn threads_do_not_change_a_bit() {
    let scene = scene([sun(20.0, 35.0), sun(130.0, 30.0)]);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| shaded(&scene, &scene.pictures()).heights)
    };
    assert_eq!(with(1).data, with(3).data);
}

#[test]
fn a_wrong_pose_that_is_free_lets_the_pictures_agree() {
    let mut scene = scene([sun(20.0, 35.0), sun(130.0, 30.0)]);
    let right = scene.poses[1];
    let turn = Rotation3::new(Vector3::new(0.3, -0.2, 0.4).normalize() * 0.3f64.to_radians());
    let rotation = turn * Rotation3::from_matrix(&right.rotation());
    scene.poses[1] = Rigid3::new(rotation, Point3::from(turn * right.origin().coords));
    let mut pictures = scene.pictures();
    pictures[1].pose_sigma = Some(PoseSigma { turn_rad: 0.006, direction_rad: 0.06 });
    let (free, fixed) = (shaded(&scene, &pictures), shaded(&scene, &scene.pictures()));
    // On so few pixels a turn and a lean of the ground are nearly one: what is sure is that the pictures agree nearly as well as
    // under the true pose.
    scene.poses[1] = right;
    let exact = shaded(&scene, &scene.pictures());
    let [free, fixed, exact] = [free, fixed, exact].map(|shaded| *shaded.energies.last().unwrap());
    assert!(free - exact < 0.25 * (fixed - exact), "{free} {fixed} {exact}");
}

/// A tiny problem on a few cells, with every global free.
fn tiny() -> (Surface, Globals, Vec<PicturePyramid>, LawTable) {
    let scene = scene([sun(20.0, 35.0), sun(130.0, 30.0)]);
    let pictures = scene.pictures();
    let (patch, _) = Patch::cover(&scene.start().plane, &pictures, 0.0, 1 << 20, 8).unwrap();
    let scale = 4.0;
    let (width, height) = (patch.width / 4, patch.height / 4);
    let heights = (0..width * height)
        .map(|i| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            (0.3 * (0.9 * x).sin() + 0.2 * (0.7 * y + 0.4 * x).cos()) as f32
        })
        .collect();
    let albedo = (0..width * height).map(|i| 0.05 * ((i as f32) * 0.37).sin()).collect();
    let surface = Surface { width, height, scale, sight: patch.sight, heights, albedo };
    let shots =
        pictures.iter().map(|p| Shot { gain: 30.0, offset: 0.03, placed: Placed::new(p, &patch) }).collect();
    let mut globals = Globals { shots, phase: [0.02; PHASE_POWERS], free: Vec::new() };
    let all = [
        Global::Gain(0),
        Global::Gain(1),
        Global::Offset(1),
        Global::Phase(0),
        Global::Phase(1),
        Global::Sun(0, 0),
        Global::Sun(1, 1),
        Global::Turn(1, 0),
        Global::Turn(1, 1),
        Global::Turn(1, 2),
        Global::Move(1, 0),
        Global::Move(1, 1),
    ];
    globals.free = all.iter().map(|&global| Free { global, sigma: 0.1, deviation: 0.0 }).collect();
    let pyramids = pictures.iter().map(|p| PicturePyramid::new(p, 3)).collect();
    (surface, globals, pyramids, LawTable::new(&Brdf::default()))
}

fn shown(pyramids: &[PicturePyramid]) -> Vec<linearise::Shown<'_>> {
    pyramids.iter().map(|p| linearise::Shown { level: &p.levels[2], mean: p.mean, share: 1.0 }).collect()
}

#[test]
fn derivatives_are_those_of_the_residuals() {
    let (surface, globals, pyramids, law) = tiny();
    let shown = shown(&pyramids);
    let residual = |surface: &Surface, globals: &Globals, k: usize, (x, y): (usize, usize)| {
        let albedo = surface.albedo[y * surface.width + x];
        let seen = see(&law, globals, &globals.shots[k], &shown[k], surface.ground(x, y), albedo)?;
        Some((seen, f64::from(seen.residual)))
    };
    let middle = (surface.width / 2, surface.height / 2);
    let mut compared = 0;
    let mut compare = |what: &str, found: f32, numeric: f64| {
        // f32 residuals of order 1 and steps of 1e-3 leave 2e-4, the curvature of the spline and of the law some parts in a thousand.
        let error = (f64::from(found) - numeric).abs();
        assert!(error < 0.02 * numeric.abs() + 1e-3, "{what}: {found} {numeric}");
        compared += 1;
    };
    for (k, cell) in (0..2)
        .flat_map(|k| [(0, 0), (2, 1), (1, 3), (4, 2)].map(|(i, j)| (k, (middle.0 + i, middle.1 + j - 2))))
    {
        let at = |surface: &Surface, globals: &Globals| residual(surface, globals, k, cell).unwrap().1;
        let (seen, _) = residual(&surface, &globals, k, cell).unwrap();
        let j = seen.jacobian(&globals.shots[k], &shown[k], &surface.sight, surface.scale);
        let (step, here) = (1e-3f32, cell.1 * surface.width + cell.0);
        let moved = |change: &dyn Fn(&mut Surface, f32)| {
            let with = |step: f32| {
                let mut surface = surface.clone();
                change(&mut surface, step);
                at(&surface, &globals)
            };
            -(with(step) - with(-step)) / (2.0 * f64::from(step))
        };
        compare(
            "slope across",
            j[0],
            moved(&|s, d| {
                (s.heights[here + 1], s.heights[here - 1]) =
                    (s.heights[here + 1] + d, s.heights[here - 1] - d);
            }),
        );
        let width = surface.width;
        compare(
            "slope down",
            j[1],
            moved(&|s, d| {
                (s.heights[here + width], s.heights[here - width]) =
                    (s.heights[here + width] + d, s.heights[here - width] - d);
            }),
        );
        compare("log albedo", j[3], moved(&|s, d| s.albedo[here] += d));
        for (g, free) in globals.free.iter().enumerate().filter(|(_, free)| free.global.is_of(k)) {
            let found = seen.column(&Axes::of(&globals, k), free.global, &shown[k]);
            let with = |step: f64| {
                let mut steps = vec![0.0; globals.free.len()];
                steps[g] = step;
                at(&surface, &globals.stepped(&steps))
            };
            let numeric = -(with(1e-3) - with(-1e-3)) / 2e-3;
            compare(&format!("{:?}", free.global), found, numeric);
        }
        compare("height", j[2], moved(&|s, d| s.heights[here] += d));
    }
    assert_eq!(compared, 8 * 4 + 4 * 4 + 4 * 10);
}

/// Stereo's height under another pose: the ground stays where it was matched, along the way that height moves it.
#[test]
fn heights_of_stereo_follow_the_pose() {
    const STEP: f64 = 1e-3;
    let (surface, globals, ..) = tiny();
    let (x, y) = (surface.width / 2 + 2, surface.height / 2 - 1);
    let pixel = |surface: &Surface, globals: &Globals| {
        let [x, y, z] = globals.shots[1].placed.in_cam(surface.ground(x, y).position).map(f64::from);
        [x / z, y / z]
    };
    let raised = |by: f32| {
        let mut surface = surface.clone();
        surface.heights[y * surface.width + x] += by;
        surface
    };
    let before = pixel(&surface, &globals);
    let by_height = {
        let [up, down] = [raised(1.0), raised(-1.0)].map(|s| pixel(&s, &globals));
        [0.5 * (up[0] - down[0]), 0.5 * (up[1] - down[1])]
    };
    let along = |p: [f64; 2]| (p[0] - before[0]) * by_height[0] + (p[1] - before[1]) * by_height[1];
    let pose: Vec<(usize, Global)> =
        globals.free.iter().map(|f| f.global).enumerate().filter(|(_, g)| g.is_of_pose(1)).collect();
    let axes = Axes::of(&globals, 1);
    let told = surface.heights_follow((x, y), &globals.shots[1], &axes, pose.iter().map(|p| p.1));
    let mut felt = 0;
    for (&(g, global), follows) in pose.iter().zip(told) {
        let mut steps = vec![0.0; globals.free.len()];
        steps[g] = STEP;
        let moved = globals.stepped(&steps);
        let stays = along(pixel(&surface, &moved));
        let left = along(pixel(&raised(STEP as f32 * follows), &moved));
        let unit = by_height[0].powi(2) + by_height[1].powi(2);
        // A hundredth of a cell is felt; what is left is of second order.
        assert!(left.abs() < 0.03 * stays.abs() + 3e-4 * unit, "{global:?}: {left} of {stays}");
        felt += usize::from(stays.abs() > 0.01 * unit);
    }
    assert!(felt >= 2, "{felt}");
}

#[test]
fn joint_elimination_is_the_solution_of_the_whole_system() {
    let (surface, globals, pyramids, law) = tiny();
    let linear = linearise(&surface, &globals, &shown(&pyramids), &law, 0.15);
    let (count, num_free) = (surface.heights.len(), globals.free.len());
    // Some hold on every height: what f32 makes of nearly free directions is not what is tested.
    let mut linear = linear;
    for cell in &mut linear.cells {
        cell.matrix[7] += 0.02;
    }
    let linear = linear;
    let mut own = linear.gram.clone();
    for g in 0..num_free {
        own[(g, g)] += 0.01;
    }
    let regular =
        Regular { stiffness: Raster::filled(surface.width, surface.height, 0.05), tension: 0.3, hold: 0.05 };
    let equations = |columns: Vec<Vec<f32>>, inverse: DMatrix<f64>| Equations {
        width: surface.width,
        height: surface.height,
        cells: linear.cells.clone(),
        regular: regular.clone(),
        columns,
        inverse,
    };
    // The whole matrix, column by column of the operator without globals.
    let bare = equations(Vec::new(), DMatrix::zeros(0, 0));
    let size = 2 * count + num_free;
    let mut whole = DMatrix::<f64>::zeros(size, size);
    let (mut tu, mut tv, mut image) = (vec![0.0; count], vec![0.0; count], vec![0.0; 2 * count]);
    for k in 0..2 * count {
        let mut unit = vec![0.0; 2 * count];
        unit[k] = 1.0;
        bare.apply(&unit, &mut tu, &mut tv, &mut image);
        for (l, v) in image.iter().enumerate() {
            whole[(l, k)] = f64::from(*v);
        }
    }
    for g in 0..num_free {
        for l in 0..2 * count {
            whole[(l, 2 * count + g)] = f64::from(linear.columns[g][l]);
            whole[(2 * count + g, l)] = f64::from(linear.columns[g][l]);
        }
        for h in 0..num_free {
            whole[(2 * count + g, 2 * count + h)] = own[(g, h)];
        }
    }
    let asymmetry = (&whole - whole.transpose()).abs().max();
    assert!(asymmetry < 1e-4, "{asymmetry}");
    let joint = equations(linear.columns.clone(), own.clone().try_inverse().unwrap());
    let mut right = joint.right(&surface.heights, &surface.albedo);
    let dense_right = DMatrix::from_fn(size, 1, |k, _| match k.checked_sub(2 * count) {
        None => f64::from(right[k]),
        Some(g) => linear.right[g],
    });
    let dense = whole.lu().solve(&dense_right).unwrap();
    let weights = &joint.inverse * DMatrix::from_fn(num_free, 1, |g, _| linear.right[g]);
    for (g, column) in joint.columns.iter().enumerate() {
        add_scaled(&mut right, column, -weights[(g, 0)] as f32);
    }
    let x = joint.solve(&right, &mut Solver::new(surface.width, surface.height), 2000, 1e-7);
    let largest = (0..count).map(|k| dense[(k, 0)].abs()).fold(0.0, f64::max);
    let worst = (0..2 * count).map(|k| (f64::from(x[k]) - dense[(k, 0)]).abs()).fold(0.0, f64::max);
    assert!(worst < 2e-3 * largest, "{worst} of {largest}");
    for g in 0..num_free {
        let explained: f64 = (0..num_free)
            .map(|h| joint.inverse[(g, h)] * (linear.right[h] - dot(&joint.columns[h], &x)))
            .sum();
        let expected = dense[(2 * count + g, 0)];
        assert!((explained - expected).abs() < 2e-3 * expected.abs().max(0.1), "{g}: {explained} {expected}");
    }
}

#[test]
fn gathering_is_the_adjoint_of_the_differences() {
    let (width, height) = (9, 7);
    let field = |seed: usize| -> Vec<f32> {
        (0..width * height).map(|i| ((i * 7919 + seed * 104_729) % 101) as f32 / 50.0 - 1.0).collect()
    };
    let (h, tu, tv) = (field(1), field(2), field(3));
    let t: Vec<PerUnknown> = tu.iter().zip(&tv).map(|(u, v)| [*u, *v, 0.0, 0.0]).collect();
    let back = Equations::gathered(width, height, &t);
    let mut forth = 0.0f64;
    for y in 0..height {
        let (above, below, factor) = neighbours(y, height);
        for x in 0..width {
            let across = along(&h[y * width..(y + 1) * width], x);
            let down = factor * (h[below * width + x] - h[above * width + x]);
            forth += f64::from(across * tu[y * width + x] + down * tv[y * width + x]);
        }
    }
    assert!((forth - dot(&back[..width * height], &h)).abs() < 1e-4);
    let mut cell = CellEquations::default();
    cell.add(2.0, [1.0, 2.0, 3.0, 4.0], 0.5);
    assert_eq!(cell.right, [1.0, 2.0, 3.0, 4.0]);
}
