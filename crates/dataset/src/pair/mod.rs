//! The records beside the pixels: `camera.json` of a view, `pair.json` of a pair, and what their files are called.

mod camera;
mod json;
mod name;
mod record;

pub use camera::{
    CAMERA_FORMAT, CameraRecord, PlaceRecord, QuaternionRecord, SensorRecord, ViewMeasures, tilt_rad,
};
pub(crate) use json::parse_json;
pub use json::{RECORD_VERSION, json_text, read_json};
pub use name::{
    PAIR_NAME, Trajectory, ViewName, angles_name, camera_name, correspondence_name, image_name, lit_name,
    pair_folder, truth_name,
};
pub use record::{
    ExposureRecord, ImportedSuns, OverlapRecord, PairRecord, RelativeGeometry, SourceRecord, SunRecord,
};

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::{Body, BodyFixed, Cam, Camera, Geodetic, Rigid3};
    use selenograph_geometry::{Point3, Vector3, lookat};
    use std::path::Path;

    fn pose(lat: f64, lon: f64, altitude: f64) -> Rigid3<BodyFixed, Cam> {
        let moon = Body::moon();
        let place = Geodetic::from_deg(lat, lon, altitude);
        let up = moon.up(&place);
        lookat::from_forward_and_right(moon.point(&place), &-up, &Vector3::new(0.1, 0.9, 0.2)).unwrap()
    }

    #[test]
    fn camera_record_keeps_every_bit_of_the_pose() {
        let moon = Body::moon();
        let camera = Camera::from_fov(512, 512, 45f64.to_radians()).unwrap();
        let world_from_cam = pose(-88.3, 123.4, 9_500.0);
        let record =
            CameraRecord::new(ViewName::A, &moon, &camera, &world_from_cam, 0.01, ViewMeasures::default());
        let folder = std::env::temp_dir().join(format!("selenograph-camera-{}.json", std::process::id()));
        std::fs::write(&folder, json_text(&record, &folder).unwrap()).unwrap();
        let back: CameraRecord = read_json(&folder).unwrap();
        std::fs::remove_file(&folder).unwrap();
        assert_eq!(back, record);
        assert_eq!(back.camera().unwrap(), camera);
        let again = back.world_from_cam();
        assert_eq!(again.origin(), world_from_cam.origin());
        assert!((again.rotation() - world_from_cam.rotation()).amax() < 1e-15);
        assert!((record.altitude_above_sphere_m - 9_500.0).abs() < 1e-6);
        assert!(record.tilt_deg < 1e-6);
        assert_eq!(record.world, "moon_me");
        assert!((record.sensor.width_mm - 5.12).abs() < 1e-12);
    }

    #[test]
    fn relative_geometry_of_two_nadir_views() {
        let moon = Body::moon();
        let a = pose(-88.0, 10.0, 10_000.0);
        let b = pose(-88.0, 11.0, 10_000.0);
        let site = Geodetic::from_deg(-88.0, 10.0, 0.0);
        let relative = RelativeGeometry::new(&moon, &site, &a, &b);
        let length = (b.origin() - a.origin()).norm();
        assert!((relative.baseline_over_height - length / 10_000.0).abs() < 1e-9);
        assert!((relative.altitude_ratio - 1.0).abs() < 1e-9);
        // Seen from the ground, the baseline spans atan(B/H) less the curvature.
        assert!((relative.convergence_rad.tan() - length / 10_000.0).abs() < 1e-3);
        let x_in_a = Point3::new(3.0, 4.0, 100.0);
        let x_in_b = b.inverse().point(&a.point(&x_in_a));
        assert!((relative.cam_b_from_cam_a.point(&x_in_a) - x_in_b).norm() < 1e-8);
    }

    #[test]
    fn names_and_folders() {
        assert_eq!(pair_folder(Path::new("d"), 12_034), Path::new("d/pairs/012/012034"));
        assert_eq!(image_name(ViewName::B, 2), "b.l2.png");
        for trajectory in Trajectory::ALL {
            assert_eq!(Trajectory::from_name(trajectory.as_str()), Some(trajectory));
            let json = serde_json::to_string(&trajectory).unwrap();
            assert_eq!(json, format!("\"{}\"", trajectory.as_str()));
        }
    }
}
