//! The camera of the goldens' points, of which a third is wrong.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it read"
)]

use safetensors::SafeTensors;
use selenograph_geometry::{Enu, Matrix3, Point2, Point3, Vector3};
use selenograph_pose::absolute::{AbsoluteOptions, Sighting, estimate};

/// What the goldens' README asks for, radians and units of the world: half a pixel of noise on 215 points.
const TOLERANCE: f64 = 1e-2;
/// The reference's largest reprojection error of an inlier.
const INLIER_PX: f64 = 5.0;

fn floats(file: &SafeTensors<'_>, name: &str) -> Vec<f64> {
    let tensor = file.tensor(name).unwrap();
    tensor.data().as_chunks::<4>().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect()
}

#[test]
fn shared_golden_pnp() {
    let shared = std::env::var_os("SELENOGRAPH_SHARED")
        .unwrap_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared").into());
    let Ok(bytes) = std::fs::read(std::path::Path::new(&shared).join("golden/geom.safetensors")) else {
        println!("SKIP shared-data: no goldens");
        return;
    };
    println!("RAN shared-data: golden PnP");
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let k = Matrix3::from_row_slice(&floats(&file, "pnp.K"));
    let (world, image) = (floats(&file, "pnp.pts3d"), floats(&file, "pnp.pts2d"));
    let sightings: Vec<Sighting> = world
        .chunks_exact(3)
        .zip(image.chunks_exact(2))
        .map(|(world, pixel)| Sighting {
            world: Point3::new(world[0], world[1], world[2]),
            image: Point2::new((pixel[0] - k[(0, 2)]) / k[(0, 0)], (pixel[1] - k[(1, 2)]) / k[(1, 1)]),
        })
        .collect();
    let options = AbsoluteOptions { threshold: INLIER_PX / k[(0, 0)], ..AbsoluteOptions::default() };
    let found = estimate::<Enu>(&sightings, &options).unwrap();
    let truth = floats(&file, "pnp.true_cam2world");
    let rotation = Matrix3::from_fn(|row, col| truth[4 * row + col]);
    let place = Vector3::new(truth[3], truth[7], truth[11]);
    let world_from_cam = found.cam_from_world.inverse();
    let turned = world_from_cam.rotation().transpose() * rotation;
    let angle_rad = ((turned.trace() - 1.0) / 2.0).clamp(-1.0, 1.0).acos();
    let off = (world_from_cam.origin().coords - place).norm();
    let outliers = file.tensor("pnp.outlier").unwrap();
    let taken_in =
        found.inliers.iter().zip(outliers.data()).filter(|(inlier, outlier)| **inlier && **outlier == 1);
    let taken_in = taken_in.count();
    println!("rotation {angle_rad:.1e} rad, place {off:.1e}, {taken_in} outliers taken in");
    assert!(angle_rad < TOLERANCE && off < TOLERANCE, "{angle_rad} {off}");
    assert!(taken_in == 0, "{taken_in} outliers agree by chance");
}
