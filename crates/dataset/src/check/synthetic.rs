//! Views of a wavy sphere whose depth is known exactly, for the tests of the checks.

use super::record::share_in_frame;
use super::reprojection::DepthView;
use crate::generate::scene::OVERLAP_STRIDE;
use crate::pair::{
    self, CameraRecord, OverlapRecord, PairRecord, SunRecord, Trajectory, ViewMeasures, ViewName,
};
use crate::plan::SunAngles;
use selenograph_files::record::{RUN_NAME, RunRecord};
use selenograph_geometry::{
    Body, BodyFixed, Cam, Camera, Geodetic, Matrix4, Point2, Point3, Rigid3, Vector3, lookat, pixel,
};
use selenograph_raster::Raster;
use selenograph_raster::codec::exr::{Channel, ExrImage};
use selenograph_raster::codec::{exr, png};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A sphere with waves on it.
pub struct Shape {
    amplitude_m: f64,
    wavelength_m: f64,
}

impl Default for Shape {
    fn default() -> Self {
        Self { amplitude_m: 400.0, wavelength_m: 9_000.0 }
    }
}

/// A view with exact truth.
pub struct TestView {
    pub camera: Camera,
    pub world_from_cam: Rigid3<BodyFixed, Cam>,
    pub depth_z: Raster<f32>,
}

impl TestView {
    /// What its depth and its shape tell.
    fn measures(&self) -> ViewMeasures {
        ViewMeasures {
            altitude_over_terrain_m: Some(Shape::default().altitude_m(&self.world_from_cam)),
            ..ViewMeasures::of_depth(self.depth_z.data.iter().map(|z| f64::from(*z)), &self.camera)
        }
    }

    pub fn view(&self) -> DepthView<'_> {
        DepthView { camera: &self.camera, world_from_cam: &self.world_from_cam, depth_z: &self.depth_z }
    }

    pub fn range(&self) -> Raster<f32> {
        Raster::from_fn(self.camera.width, self.camera.height, |x, y| {
            let center = Point2::new(pixel::center_of(x), pixel::center_of(y));
            self.camera.range_from_depth_z(&center, f64::from(self.depth_z[(x, y)])).unwrap() as f32
        })
    }

    pub fn pose_matrix(&self) -> Matrix4<f64> {
        let rows = self.world_from_cam.rows_3x4();
        Matrix4::from_fn(|i, j| rows.get(i).map_or(f64::from(u8::from(j == 3)), |row| row[j]))
    }
}

impl Shape {
    /// Height above the ground's own surface, metres along the vertical.
    fn clearance_m(&self, p: &Point3<f64>) -> f64 {
        let k = std::f64::consts::TAU / self.wavelength_m;
        let waves = (k * p.x).sin() * (k * 0.8 * p.y).cos() + 0.4 * (k * 1.7 * (p.x + p.y)).sin();
        p.coords.norm() - Body::moon().radius_m - self.amplitude_m * waves
    }

    /// z-depth along a ray with z = 1: marched in small steps, then bisected to the last bit.
    fn depth_z(&self, world_from_cam: &Rigid3<BodyFixed, Cam>, ray: &Vector3<f64>) -> f64 {
        let at = |t: f64| self.clearance_m(&world_from_cam.point(&Point3::from(ray * t)));
        let (step, far) = (200.0, 200_000.0);
        let mut t = step;
        while at(t) > 0.0 {
            if t > far {
                return f64::NAN;
            }
            t += step.max(0.3 * at(t));
        }
        let (mut low, mut high) = (0.0, t);
        while at(low) > 0.0 && high - low > 1e-7 {
            let middle = 0.5 * (low + high);
            if at(middle) > 0.0 { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Height of a camera that looks downwards over the ground straight below it, metres.
    pub fn altitude_m(&self, world_from_cam: &Rigid3<BodyFixed, Cam>) -> f64 {
        let down = world_from_cam.inverse().vector(&-world_from_cam.origin().coords.normalize());
        self.depth_z(world_from_cam, &(down / down.z)) / down.z
    }

    /// From a place, looking `tilt_deg` off the vertical towards an azimuth, level or straight down.
    pub fn view(
        &self,
        side: usize,
        lat: f64,
        lon: f64,
        altitude_m: f64,
        tilt_deg: f64,
        azimuth_deg: f64,
    ) -> TestView {
        let moon = Body::moon();
        let camera = Camera::from_fov(side, side, 45f64.to_radians()).unwrap();
        let place = Geodetic::from_deg(lat, lon, altitude_m);
        let down = tilt_deg.to_radians() - std::f64::consts::FRAC_PI_2;
        let forward = moon.direction(&place, azimuth_deg.to_radians(), down);
        let right = moon.direction(&place, (azimuth_deg + 90.0).to_radians(), 0.0);
        let world_from_cam = lookat::from_forward_and_right(moon.point(&place), &forward, &right).unwrap();
        let depth_z = Raster::from_fn(side, side, |x, y| {
            let center = Point2::new(pixel::center_of(x), pixel::center_of(y));
            self.depth_z(&world_from_cam, &camera.ray_z1(&center).unwrap()) as f32
        });
        TestView { camera, world_from_cam, depth_z }
    }
}

/// Two oblique views of the same ground, some 40° apart in direction.
pub fn oblique_pair(side: usize) -> [TestView; 2] {
    let shape = Shape::default();
    // 15 km of altitude at 30° look 8.7 km ahead; a degree of latitude is 30.3 km.
    [
        shape.view(side, -88.0, 100.0, 15_000.0, 30.0, 0.0),
        shape.view(side, -87.9, 106.0, 18_000.0, 36.0, 320.0),
    ]
}

/// Two views straight down, 7 % of the altitude apart along the image's x axis.
pub fn nadir_pair(side: usize) -> [TestView; 2] {
    let shape = Shape::default();
    [shape.view(side, -88.0, 100.0, 15_000.0, 0.0, 0.0), shape.view(side, -88.0, 101.0, 15_000.0, 0.0, 0.0)]
}

/// Writes a pair in our own layout with two lights, and returns its folder.
pub fn write_own_pair(root: &Path, pair_id: u64, views: &[TestView; 2]) -> PathBuf {
    let folder = pair::pair_folder(root, pair_id);
    std::fs::create_dir_all(&folder).unwrap();
    let body = Body::moon();
    let mut files = BTreeMap::new();
    let mut write = |name: String, bytes: Vec<u8>| {
        files.insert(name.clone(), blake3::hash(&bytes).to_hex().to_string());
        std::fs::write(folder.join(name), bytes).unwrap();
    };
    for (view, name) in views.iter().zip(ViewName::BOTH) {
        let camera =
            CameraRecord::new(name, &body, &view.camera, &view.world_from_cam, 0.01, view.measures());
        write(pair::camera_name(name), pair::json_text(&camera, &folder).unwrap().into_bytes());
        let (width, height) = (view.camera.width, view.camera.height);
        let truth = ExrImage {
            width,
            height,
            channels: vec![
                Channel::float("depth_z", view.depth_z.data.clone()),
                Channel::float("slope", vec![0.1; width * height]),
            ],
            attributes: BTreeMap::new(),
        };
        write(pair::truth_name(name), exr::encode(&truth).unwrap());
        for light_idx in 0..2 {
            let deep = Raster::from_fn(width, height, |x, y| (500 * (x + y)) as u16);
            write(pair::image_name(name, light_idx), png::encode_grey16(&deep).unwrap());
            let lit = Raster::from_fn(width, height, |x, _| if x % 9 > light_idx { 255 } else { 0 });
            write(pair::lit_name(name, light_idx), png::encode_grey8(&lit).unwrap());
        }
    }
    let [a, b] = views;
    let site = Geodetic::from_deg(-87.7, 100.0, 0.0);
    let angles = SunAngles { azimuth_deg: 10.0, elevation_deg: 15.0 };
    let sun = SunRecord::new(&angles, &body, &site, 0.27);
    let share = |from: &TestView, to: &TestView| share_in_frame(&from.view(), &to.view(), OVERLAP_STRIDE).0;
    let (a_in_b, b_in_a) = (share(a, b), share(b, a));
    let record = PairRecord {
        trajectory: Some(Trajectory::Oblique),
        suns: vec![Some(sun); 2],
        overlap: OverlapRecord { a_in_b, b_in_a, a_seen_by_b: a_in_b, b_seen_by_a: b_in_a },
        files,
        ..PairRecord::new(pair_id, &body, &site, [&a.world_from_cam, &b.world_from_cam])
    };
    std::fs::write(folder.join(pair::PAIR_NAME), pair::json_text(&record, &folder).unwrap()).unwrap();
    RunRecord::<_, ()>::new("test", &BTreeMap::<String, String>::new()).write(&root.join(RUN_NAME)).unwrap();
    folder
}
