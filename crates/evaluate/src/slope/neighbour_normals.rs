//! Normals of a cloud from each point's nearest neighbours.

use crate::cloud::tree::Tree;
use rayon::prelude::*;
use selenograph_geometry::{Matrix3, Point3, SymmetricEigen, Vector3};
use selenograph_raster::Raster;

/// Neighbours that make a normal, the point itself among them, as the authors have it.
pub const NUM_NEIGHBOURS: usize = 30;

/// The normal of every `stride`-th pixel's point (along each axis) from its nearest neighbours among all points: the
/// direction of their least spread, sign free. NaN elsewhere, at absent points, and where there are not enough neighbours.
pub fn neighbour_normals(points: &Raster<Point3<f64>>, stride: usize) -> Raster<Vector3<f64>> {
    let (width, stride) = (points.width, stride.max(1));
    let is_finite = |p: &Point3<f64>| p.coords.iter().all(|c| c.is_finite());
    let cloud: Vec<Point3<f64>> = points.data.iter().filter(|p| is_finite(p)).copied().collect();
    let mut normals = Raster::filled(width, points.height, Vector3::repeat(f64::NAN));
    if cloud.len() < NUM_NEIGHBOURS {
        return normals;
    }
    let tree = Tree::new(&cloud);
    normals.data.par_chunks_mut(width.max(1)).enumerate().step_by(stride).for_each_init(
        || Vec::with_capacity(NUM_NEIGHBOURS),
        |found, (y, row)| {
            for (x, normal) in row.iter_mut().enumerate().step_by(stride) {
                let point = points[(x, y)];
                if is_finite(&point) {
                    tree.nearest(&point, NUM_NEIGHBOURS, found);
                    *normal = least_spread(found.iter().map(|n| cloud[n.idx] - point));
                }
            }
        },
    );
    normals
}

/// Angle of a normal of free sign against an axis, radians in `[0, π/2]`.
pub fn slope_against(normal: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
    normal.cross(axis).norm().atan2(normal.dot(axis).abs()) + 0.0 * normal.x
}

/// Direction of the least spread of points given by their offsets from one of them.
fn least_spread(offsets: impl Iterator<Item = Vector3<f64>>) -> Vector3<f64> {
    let (mut sum, mut squares, mut count) = (Vector3::zeros(), Matrix3::zeros(), 0.0);
    for offset in offsets {
        sum += offset;
        squares += offset * offset.transpose();
        count += 1.0;
    }
    let eigen = SymmetricEigen::new(squares - sum * sum.transpose() / count);
    eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilted_plane_with_a_hole_has_its_normal() {
        let normal = Vector3::new(0.3, -0.2, 1.0).normalize();
        let mut points = Raster::from_fn(24, 18, |x, y| {
            let (x, y) = (3.0 * x as f64, 5.0 * y as f64);
            Point3::new(x, y, 1000.0 - (normal.x * x + normal.y * y) / normal.z)
        });
        points[(4, 4)] = Point3::new(f64::NAN, 0.0, 0.0);
        let normals = neighbour_normals(&points, 2);
        for y in 0..18 {
            for x in 0..24 {
                let wanted = x % 2 == 0 && y % 2 == 0 && (x, y) != (4, 4);
                let found = normals[(x, y)];
                assert_eq!(found.x.is_finite(), wanted);
                if wanted {
                    assert!((found.dot(&normal).abs() - 1.0).abs() < 1e-12);
                    assert!((slope_against(&found, &Vector3::z()) - normal.z.acos()).abs() < 1e-9);
                }
            }
        }
        assert!(slope_against(&normals[(4, 4)], &Vector3::z()).is_nan());
        let few = Raster { width: 2, height: 2, data: points.data[..4].to_vec() };
        assert!(neighbour_normals(&few, 1).data.iter().all(|n| n.x.is_nan()));
    }
}
