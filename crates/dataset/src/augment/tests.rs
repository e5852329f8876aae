use super::*;
use crate::check::reprojection::{self, symmetric};
use crate::check::synthetic::oblique_pair;
use crate::correspondence::MatchPool;
use crate::sample::ViewTruth;
use selenograph_raster::Raster;

fn views(side: usize) -> [UndevelopedView; 2] {
    oblique_pair(side).map(|view| UndevelopedView {
        levels: Raster::from_fn(side, side, |x, y| ((x * 7 + y * 3) % 200) as f32),
        camera: view.camera,
        truth: ViewTruth { depth_z: view.depth_z, world_from_cam: view.world_from_cam },
    })
}

/// Median and 99th percentile of the distance, pixels, between a pixel and where the other view's depth carries it back to.
fn reprojection_px(views: &[UndevelopedView; 2]) -> [f64; 2] {
    let [a, b] = views.each_ref().map(|view| {
        let truth = &view.truth;
        reprojection::DepthView {
            camera: &view.camera,
            world_from_cam: &truth.world_from_cam,
            depth_z: &truth.depth_z,
        }
    });
    let statistics = symmetric(&a, &b, 1).unwrap();
    [statistics.median_px, statistics.p99_px]
}

#[test]
fn windows_and_rolls_keep_views_on_one_ground() {
    // What the views have without any change: the bilinear depth of the check itself.
    let [clean, _] = reprojection_px(&views(128));
    assert!(clean < 0.01, "{clean}");
    let shapes = [
        Augmentation { windows: Windows::Matched, ..Augmentation::default() },
        Augmentation { roll_share: 1.0, ..Augmentation::default() },
        Augmentation { windows: Windows::Matched, roll_share: 1.0, ..Augmentation::default() },
        Augmentation::default(),
    ];
    for (idx, shape) in shapes.iter().enumerate() {
        for target in [[96, 96], [128, 96], [48, 64]] {
            let shaped = shape.reshape(views(128), false, target, 5, idx as u64).unwrap().0;
            for view in &shaped {
                assert_eq!([view.levels.width, view.levels.height], target);
                assert!(view.truth.depth_z.data.iter().all(|z| z.is_finite()));
            }
            let [median, p99] = reprojection_px(&shaped);
            assert!(median < 0.02 && p99 < 0.2, "{idx} {target:?}: {median} {p99}");
        }
    }
}

#[test]
fn the_published_geometry_is_off_by_what_it_is_known_for() {
    let published = Augmentation { fidelity: Fidelity::Published, ..Augmentation::physical() };
    let shaped = published.reshape(views(128), false, [96, 96], 5, 0).unwrap().0;
    let [median, _] = reprojection_px(&shaped);
    // Nearest depths: some quarter of a pixel on slanted ground.
    assert!((0.02..0.6).contains(&median), "{median}");
}

#[test]
fn pictures_move_with_their_depths() {
    // Levels that are a smooth function of the ground itself tell where each pixel of the picture has come from.
    let level = |p: selenograph_geometry::Point3<f64>| 120.0 + 60.0 * (p.x / 4e3).sin() * (p.y / 5e3).cos();
    let painted = views(128).map(|mut view| {
        view.levels = painted(&view, &level);
        view
    });
    for roll_share in [0.0, 1.0] {
        let shape = Augmentation { windows: Windows::Matched, roll_share, ..Augmentation::default() };
        for view in shape.reshape(painted.clone(), false, [64, 64], 9, 1).unwrap().0 {
            let expected = self::painted(&view, &level);
            let worst =
                view.levels.data.iter().zip(&expected.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // Half a pixel would be 10 levels; smoothing and curvature leave less than two.
            assert!(worst < 2.0, "{worst}");
        }
    }
}

/// The picture of a view whose ground has levels of its own.
fn painted(view: &UndevelopedView, level: &impl Fn(selenograph_geometry::Point3<f64>) -> f64) -> Raster<f32> {
    let truth = &view.truth;
    Raster::from_fn(view.camera.width, view.camera.height, |x, y| {
        let center = selenograph_geometry::Point2::new(
            selenograph_geometry::pixel::center_of(x),
            selenograph_geometry::pixel::center_of(y),
        );
        let point = view.camera.unproject(&center, f64::from(truth.depth_z[(x, y)])).unwrap();
        level(truth.world_from_cam.point(&point)) as f32
    })
}

#[test]
fn chosen_windows_share_more_than_drawn_ones() {
    let target = [64, 64];
    let count = |views: &[UndevelopedView; 2]| {
        let [a, b] = views.each_ref().map(UndevelopedView::sighted);
        MatchPool::reciprocal(a, b).positives.len()
    };
    let views = views(128);
    let (mut chosen, mut first) = (0, 0);
    for position in 0..6 {
        let mut stream = rng(1, "test", position, "windows");
        let windows = crop::choose([&views[0], &views[1]], target, &mut stream.clone());
        let blind = views.clone().map(|mut view| {
            view.truth.depth_z.data.fill(f32::NAN);
            view
        });
        let drawn = crop::choose([&blind[0], &blind[1]], target, &mut stream);
        let cut = |windows: [[f64; 4]; 2]| {
            [0, 1].map(|n| {
                Turn::onto(&views[n].camera, windows[n], target, Fidelity::Exact).unwrap().apply(&views[n])
            })
        };
        chosen += count(&cut(windows));
        first += count(&cut(drawn));
    }
    assert!(chosen > first, "{chosen} {first}");
}

#[test]
fn samples_are_functions_of_seed_and_position() {
    let augmentation = Augmentation { photometric: Some(Photometric::default()), ..Augmentation::physical() };
    augmentation.check("augment").unwrap();
    let make = |seed, position| {
        let ([a, b], _) = augmentation.reshape(views(64), false, [48, 48], seed, position).unwrap();
        [augmentation.develop(a, seed, position, "a"), augmentation.develop(b, seed, position, "b")]
    };
    assert_eq!(make(1, 2), make(1, 2));
    assert_ne!(make(1, 2)[0].rgb, make(1, 3)[0].rgb);
    assert_ne!(make(1, 2)[0].rgb, make(2, 2)[0].rgb);
    let refused = Augmentation { roll_share: 1.5, ..Augmentation::default() }.check("augment");
    assert!(matches!(refused, Err(Error::Value { key, .. }) if key == "augment.roll_share"));
}

#[test]
fn lights_copies_and_far_depths_follow_the_settings() {
    let independent = Augmentation::physical();
    let draws: Vec<[usize; 2]> = (0..300).map(|n| independent.lights(3, 1, n)).collect();
    assert!(draws.iter().filter(|[a, b]| a == b).count().abs_diff(100) < 30);
    let shared = Augmentation::default();
    assert!((0..50).all(|n| shared.lights(3, 1, n)[0] == shared.lights(3, 1, n)[1]));
    let published = Augmentation::published();
    let copies = Augmentation { monocular_share: 1.0, ..published };
    let ([a, b], is_copy) = copies.reshape(views(64), false, [64, 64], 1, 0).unwrap();
    // Not by `==`: what lies outside the turned picture has no depth.
    assert!(is_copy && a.levels == b.levels && a.camera == b.camera);
    // Two percent are gone, and more at the rim of the window, which lies outside the turned picture.
    let mut view = views(64)[0].clone();
    view.drop_far(0.98);
    let absent = view.truth.depth_z.data.iter().filter(|z| z.is_nan()).count();
    assert_eq!(absent, 82, "2 % of 4096");
}
