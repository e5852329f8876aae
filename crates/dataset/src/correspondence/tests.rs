use super::*;
use crate::check::synthetic::{Shape, TestView, oblique_pair};
use crate::rng::rng;

fn truth(view: TestView) -> (Camera, ViewTruth) {
    (view.camera, ViewTruth { depth_z: view.depth_z, world_from_cam: view.world_from_cam })
}

fn sighted((camera, truth): &(Camera, ViewTruth)) -> Sighted<'_> {
    Sighted { camera, truth }
}

#[test]
fn a_view_matches_itself_pixel_by_pixel() {
    let [view, _] = oblique_pair(24).map(truth);
    let pool = MatchPool::reciprocal(sighted(&view), sighted(&view));
    assert!(pool.positives.iter().enumerate().all(|(n, pair)| *pair == [n as u32; 2]));
    assert_eq!((pool.positives.len(), pool.negatives[0].len()), (576, 0));
    // All that there is, though half was to be negative.
    let matches = pool.clone().sample(576, 0.5, &mut rng(1, "test", 0, "matches")).unwrap();
    assert!(matches.valid.iter().all(|valid| *valid) && matches.a == matches.b);
    assert!(matches!(pool.sample(577, 0.5, &mut rng(1, "test", 0, "m")), Err(Error::Value { .. })));
}

#[test]
fn matches_see_the_same_ground_and_samples_keep_the_rule() {
    let views = oblique_pair(64).map(truth);
    let [a, b] = [sighted(&views[0]), sighted(&views[1])];
    let pool = MatchPool::reciprocal(a, b);
    assert!(pool.positives.len() > 600, "{}", pool.positives.len());
    for [in_a, in_b] in &pool.positives {
        let place = |view: Sighted<'_>, idx: u32| {
            let (x, y) = (idx as usize % 64, idx as usize / 64);
            let center = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let point = view.camera.unproject(&center, f64::from(view.truth.depth_z.data[idx as usize]));
            view.truth.world_from_cam.point(&point.unwrap())
        };
        let apart = (place(a, *in_a) - place(b, *in_b)).norm();
        // Rounding moves by at most half a pixel along each axis: 0.71 of some 250 m, stretched on slopes.
        assert!(apart < 500.0, "{apart}");
    }
    let sample = |seed| pool.clone().sample(512, 0.5, &mut rng(seed, "test", 0, "matches")).unwrap();
    let matches = sample(1);
    assert_eq!(matches, sample(1));
    assert_ne!(matches, sample(2));
    assert_eq!((matches.a.len(), matches.b.len(), matches.valid.len()), (512, 512, 512));
    assert!(matches.valid.iter().enumerate().all(|(n, valid)| *valid == (n < 256)));
    let flat = |[x, y]: [u32; 2]| x + 64 * y;
    for n in 0..256 {
        assert!(pool.positives.contains(&[flat(matches.a[n]), flat(matches.b[n])]));
        assert!(pool.negatives[0].contains(&flat(matches.a[256 + n])));
        assert!(pool.negatives[1].contains(&flat(matches.b[256 + n])));
    }
    let mut distinct = matches.a.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(distinct.len(), 512, "drawn without replacement");
}

#[test]
fn views_that_share_no_ground_give_negatives_only() {
    let away = Shape::default().view(32, -80.0, 10.0, 20_000.0, 0.0, 0.0);
    let [a, _] = oblique_pair(32).map(truth);
    let b = truth(away);
    let (to_b, to_a) = (sights(sighted(&a), sighted(&b)), sights(sighted(&b), sighted(&a)));
    assert!(to_b.iter().chain(&to_a).all(|sight| *sight == Sight::Outside));
    let pool = MatchPool::seen(sighted(&a), sighted(&b), &to_b, &to_a);
    assert!(pool.positives.is_empty());
    let matches = pool.sample(1024, 0.5, &mut rng(1, "test", 0, "matches")).unwrap();
    assert!(matches.valid.iter().all(|valid| !valid));
}

#[test]
fn pixels_without_depth_are_absent_and_in_no_seen_match() {
    let [mut a, b] = oblique_pair(32).map(truth);
    a.1.depth_z.data[..320].fill(f32::NAN);
    let (to_b, to_a) = (sights(sighted(&a), sighted(&b)), sights(sighted(&b), sighted(&a)));
    assert!(to_b[..320].iter().all(|sight| *sight == Sight::Absent));
    let pool = MatchPool::seen(sighted(&a), sighted(&b), &to_b, &to_a);
    assert!(!pool.positives.is_empty() && pool.positives.iter().all(|[in_a, _]| *in_a >= 320));
}
