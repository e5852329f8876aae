//! Outputs made from the truth: descriptors are a code of the surface point, points are the true ones in a unit of 3.7.

use super::*;
use crate::{Border, Density, Rule, SquareCrop};
use selenograph_geometry::{CamA, CamB, Point2, Point3, Rigid3, Rotation3};
use selenograph_network::Preset;
use selenograph_network::config::ConfidenceMode;
use selenograph_pose::relative::CannotSay;
use selenograph_reconstruct::Fill;
use selenograph_reconstruct::NoPose;
use selenograph_reconstruct::learned::{LearnedOptions, PointsFrom, solve};

const UNIT: f64 = 3.7;
const FOV_RAD: f64 = 0.8;
const MODE: ConfidenceMode = ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY };
/// Numbers of a descriptor: twelve waves through space, sine and cosine each.
const DIM: usize = 24;

fn true_pose() -> Rigid3<CamB, CamA> {
    Rigid3::new(Rotation3::from_euler_angles(0.05, 0.22, 0.3), Point3::new(-2.4, 0.3, 0.4))
}

/// The point of rough ground near the plane `z = 10` that is seen along a ray, by bisection.
fn ground(origin: &Point3<f64>, ray: &selenograph_geometry::Vector3<f64>) -> Point3<f64> {
    let height =
        |x: f64, y: f64| 0.9 * (1.3 * x).sin() * (1.1 * y + 0.4).cos() + 0.4 * (2.9 * x + 1.7 * y).sin();
    let (mut near, mut far) = (4.0, 30.0);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        let x = origin + ray * middle;
        if x.z < 10.0 - height(x.x, x.y) {
            near = middle;
        } else {
            far = middle;
        }
    }
    origin + ray * (0.5 * (near + far))
}

/// The code of a surface point.
fn code(x: &Point3<f64>) -> [f32; DIM] {
    let mut code = [0.0; DIM];
    for (wave, pair) in code.as_chunks_mut::<2>().0.iter_mut().enumerate() {
        let k = wave as f64;
        let length = 0.6 + 0.7 * k;
        let along = length * (2.4 * k).cos() * x.x + length * (2.4 * k).sin() * x.y + 0.3 * k * x.z;
        *pair = [along.sin() as f32, along.cos() as f32].map(|v| v / (DIM as f32 / 2.0).sqrt());
    }
    code
}

/// What perfect heads say of a view: `frame_from_a` carries points into the frame that is asked for.
fn output(view: Seen<'_>, cam_from_a: &Rigid3<CamB, CamA>, frame_from_a: &Rigid3<CamB, CamA>) -> HeadOutput {
    let [width_px, height_px] = view.transform.kept;
    let a_from_cam = cam_from_a.inverse();
    let mut head = HeadOutput {
        height_px,
        width_px,
        points: Vec::new(),
        confidence: vec![10.0; width_px * height_px],
        descriptor_dim: DIM,
        descriptors: Vec::new(),
        descriptor_confidence: vec![1.0; width_px * height_px],
    };
    for (y, x) in (0..height_px).flat_map(|y| (0..width_px).map(move |x| (y, x))) {
        let at = view.transform.source_from_input(pixel::center_of(x), pixel::center_of(y));
        let ray = a_from_cam.vector(&view.camera.ray_z1(&Point2::new(at[0], at[1])).unwrap());
        let point = ground(&a_from_cam.origin(), &ray);
        head.points.extend(frame_from_a.point(&point).coords.iter().map(|v| (v * UNIT) as f32));
        head.descriptors.extend(code(&point));
    }
    head
}

/// Both ways of a pair that is looked at by a rule.
struct Scene {
    cameras: [Camera; 2],
    transforms: [InputTransform; 2],
    forward: [HeadOutput; 2],
    backward: [HeadOutput; 2],
}

impl Scene {
    fn new(sizes: [[usize; 2]; 2], rule: Rule) -> Self {
        let cameras = sizes.map(|[width, height]| Camera::from_fov(width, height, FOV_RAD).unwrap());
        let transforms = sizes.map(|[width, height]| InputTransform::new(width, height, rule, 16).unwrap());
        let views = [0, 1].map(|k| Seen { camera: &cameras[k], transform: &transforms[k] });
        let poses = [Rigid3::identity(), true_pose()];
        let way = |frame: usize| [frame, 1 - frame].map(|k| output(views[k], &poses[k], &poses[frame]));
        let (forward, backward) = (way(0), way(1));
        Self { cameras, transforms, forward, backward }
    }

    fn gather(&self, focal: FocalKnowledge, options: &PredictOptions) -> LearnedInput {
        let views = [0, 1].map(|k| Seen { camera: &self.cameras[k], transform: &self.transforms[k] });
        let outputs = Outputs { forward: &self.forward, backward: Some(&self.backward) };
        let config = NetworkConfig { confidence: MODE, ..Preset::Tiny.config() };
        gather(outputs, views, focal, &config, options).unwrap()
    }
}

/// Errors of a pose: rotation and direction in degrees, length as a share.
fn errors(found: &Rigid3<CamB, CamA>) -> [f64; 3] {
    let (found_t, true_t) = (found.origin().coords, true_pose().origin().coords);
    [
        (&found.inverse() * &true_pose()).rotation_angle_rad().to_degrees(),
        found_t.angle(&true_t).to_degrees(),
        (found_t.norm() / (UNIT * true_t.norm()) - 1.0).abs(),
    ]
}

const WHOLE: Rule = Rule::Whole { max_side: Some(192), border: Border::Pad };
const PUBLISHED: Rule = Rule::Published { size: 192, square: SquareCrop::FourThirds };

/// Matches are whole pixels of an input of some 200 pixels: 0.3 px at 230 px of focal length is a tenth of a degree for each of a few
/// hundred matches; the direction is known worse by the ratio of range to baseline; the length is as far off as 0.3 px of a parallax of
/// some 50 px and the pose's own error.
const BOUNDS: [f64; 3] = [0.2, 1.0, 0.02];

#[test]
fn pose_length_and_points_of_perfect_heads() {
    // As it is; landscape and portrait; resized to a half; cropped as published; odd sizes.
    for (sizes, rule) in [
        ([[192, 192]; 2], WHOLE),
        ([[192, 144], [144, 192]], WHOLE),
        ([[384, 384]; 2], WHOLE),
        ([[384, 384]; 2], PUBLISHED),
        ([[191, 173], [185, 190]], WHOLE),
    ] {
        let scene = Scene::new(sizes, rule);
        let said = scene.gather(FocalKnowledge::Known, &PredictOptions::default());
        let solved = solve(said.cameras.each_ref(), &said.learned, None, &LearnedOptions::default()).unwrap();
        let pose = solved.prediction.cam_b_from_cam_a.unwrap();
        let errors = errors(&pose);
        assert!(
            errors.iter().zip(BOUNDS).all(|(error, bound)| *error < bound),
            "{sizes:?} {rule:?} {errors:?}"
        );
        assert!(solved.warnings.is_empty(), "{:?}", solved.warnings);
        let views = solved.prediction.views.unwrap();
        let poses = [Rigid3::identity(), true_pose()];
        for k in 0..2 {
            let camera = &scene.cameras[k];
            assert_eq!((views[k].points.width, views[k].points.height), (camera.width, camera.height));
            let absent = views[k].fill.data.iter().filter(|f| **f == Fill::Absent).count();
            let lost = scene.transforms[k].lost_share() * views[k].fill.data.len() as f64;
            assert_eq!(absent, lost.round() as usize);
            // A point of the picture projects to the pixel it stands at.
            let (x, y) = (camera.width / 2 + 7, camera.height / 2 - 5);
            let point = Point3::from(views[k].points[(x, y)].map(|v| f64::from(v) / UNIT));
            let at = camera.project(&poses[k].point(&point)).unwrap();
            let off = (at - Point2::new(pixel::center_of(x), pixel::center_of(y))).norm();
            // Between pixels of an input of half the size the ground is curved.
            assert!(off < 0.02, "{sizes:?} {off}");
        }
    }
}

#[test]
fn unknown_focal_lengths_come_from_the_points() {
    for sizes in [[[192, 192]; 2], [[192, 144], [144, 192]]] {
        let mut scene = Scene::new(sizes, WHOLE);
        let true_px = scene.cameras.each_ref().map(|camera| camera.fx);
        for camera in &mut scene.cameras {
            (camera.fx, camera.fy) = (0.6 * camera.fx, 0.6 * camera.fy);
        }
        let said = scene.gather(FocalKnowledge::Guessed, &PredictOptions::default());
        let FocalSource::Pointmaps { focal_px } = said.focal else { panic!("{:?}", said.focal) };
        for k in 0..2 {
            // Rounding of f32 points.
            assert!((focal_px[k] / true_px[k] - 1.0).abs() < 1e-4, "{focal_px:?} {true_px:?}");
            assert_eq!(said.cameras[k].fx, focal_px[k]);
        }
        // Points that fit no camera leave the guess.
        for head in scene.forward.iter_mut().chain(&mut scene.backward) {
            head.points.iter_mut().for_each(|v| *v = 1.0);
        }
        let said = scene.gather(FocalKnowledge::Guessed, &PredictOptions::default());
        assert!(matches!(said.focal, FocalSource::Assumed { .. }), "{:?}", said.focal);
    }
}

#[test]
fn both_ways_and_dense_matches() {
    let scene = Scene::new([[192, 192]; 2], WHOLE);
    let forward = scene.gather(FocalKnowledge::Known, &PredictOptions::default()).learned;
    let options =
        PredictOptions { passes: Passes::Symmetric, density: Density::Dense, ..PredictOptions::default() };
    let both = scene.gather(FocalKnowledge::Known, &options);
    assert!(both.learned.matches.len() > forward.matches.len());
    let dense = both.learned.dense_matches.as_ref().unwrap();
    assert!(dense.len() > 10_000, "{}", dense.len());
    let geometry = LearnedOptions { points: PointsFrom::Triangulated, ..LearnedOptions::default() };
    let solved = solve(both.cameras.each_ref(), &both.learned, None, &geometry).unwrap();
    // The unit of triangulated points is the baseline.
    let length = solved.prediction.cam_b_from_cam_a.unwrap().origin().coords.norm();
    assert!((length - 1.0).abs() < 1e-9);
    let views = solved.prediction.views.unwrap();
    let scale = true_pose().origin().coords.norm();
    let mut errors: Vec<f64> = (0..192 * 192)
        .filter(|idx| views[0].fill.data[*idx] == Fill::Measured)
        .map(|idx| {
            let range = |p: &[f32]| p.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
            let truth = range(&scene.forward[0].points[3 * idx..3 * idx + 3]) / UNIT;
            (range(&views[0].points.data[idx]) * scale / truth - 1.0).abs()
        })
        .collect();
    assert!(errors.len() > 8000, "{}", errors.len());
    errors.sort_by(f64::total_cmp);
    // 0.3 px of a parallax of some 50 px, and the error of the pose.
    assert!(errors[errors.len() / 2] < 0.02, "{}", errors[errors.len() / 2]);
}

#[test]
fn blank_pictures_and_networks_without_descriptors() {
    let mut scene = Scene::new([[96, 96]; 2], WHOLE);
    let views = [0, 1].map(|k| Seen { camera: &scene.cameras[k], transform: &scene.transforms[k] });
    let said = nothing(views, FocalKnowledge::Known, 16);
    let solved = solve(said.cameras.each_ref(), &said.learned, None, &LearnedOptions::default()).unwrap();
    assert!(matches!(
        solved.prediction.cam_b_from_cam_a,
        Err(NoPose::CannotSay(CannotSay::TooFewMatches { found: 0, .. }))
    ));
    assert!(solved.prediction.views.is_none());
    for head in scene.forward.iter_mut().chain(&mut scene.backward) {
        (head.descriptor_dim, head.descriptors, head.descriptor_confidence) = (0, Vec::new(), Vec::new());
    }
    let said = scene.gather(FocalKnowledge::Known, &PredictOptions::default());
    let solved = solve(said.cameras.each_ref(), &said.learned, None, &LearnedOptions::default()).unwrap();
    let errors = errors(&solved.prediction.cam_b_from_cam_a.unwrap());
    // From points alone, which are exact.
    assert!(errors.iter().all(|error| *error < 1e-3), "{errors:?}");
}
