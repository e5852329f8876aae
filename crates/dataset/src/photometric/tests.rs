use super::cast_shadow::Ground;
use super::report::median;
use super::*;
use selenograph_render::brdf::Brdf;

/// Every nadir and oblique pair of the shared samples; empty, with a message, where there are none.
fn samples(test: &str) -> Vec<Scene> {
    let workspace = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let shared = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(|| "../shared".into(), PathBuf::from);
    let root = workspace.join(shared).join("data/stereolunar");
    let settings = Settings::default();
    let mut scenes = Vec::new();
    for stored in stored::find(&root, ReadOptions::default()).unwrap_or_default() {
        let trajectory = trajectory_of(&stored.place.name());
        let Some(rule) = trajectory.and_then(SiteRule::of_trajectory) else { continue };
        let pair = stored.triplets().unwrap();
        scenes.push(Scene::read(&stored, pair, rule, &settings, &mut Vec::new()).unwrap());
    }
    match scenes.is_empty() {
        true => eprintln!("SKIP shared-data: {test}: no nadir or oblique pairs in {}", root.display()),
        false => eprintln!("RAN shared-data: {test}"),
    }
    scenes
}

fn report(scenes: &[Scene], settings: &Settings) -> Report {
    let mut skipped = Vec::new();
    let images = scenes
        .iter()
        .flat_map(|scene| scene.fit(settings, &mut skipped, &mut |_, _, _| Ok(())).unwrap())
        .collect();
    Report::new(images, skipped, settings)
}

/// Correlations with another Sun or law, of the pictures of one light or (`None`) of all.
fn control(
    scenes: &[Scene],
    light_idx: Option<usize>,
    turn: impl Fn(SunAngles) -> SunAngles,
    shade: impl Fn(f64, f64, f64) -> f64 + Sync,
) -> Vec<f64> {
    let settings = Settings::default();
    let mut found = Vec::new();
    for scene in scenes {
        for picture in &scene.pictures {
            if light_idx.is_some_and(|idx| idx != picture.light_idx) {
                continue;
            }
            let sun = turn(settings.suns[picture.light_idx]);
            let rendered = scene.render(picture, sun, &settings, &shade);
            found.extend(fit::compare(&rendered, &picture.levels).map(|agreement| agreement.pearson));
        }
    }
    found
}

/// One test, so that the surfaces are worked out once.
#[test]
fn shared_samples_are_reproduced_and_controls_are_not() {
    let scenes = samples("shared_samples_are_reproduced_and_controls_are_not");
    if scenes.is_empty() {
        return;
    }
    let settings = Settings::default();
    let truth = report(&scenes, &settings);
    for fit in &truth.images {
        eprintln!(
            "pair {} light {} view {}: r {:.4}, {:.2} levels, gain {:.0}",
            fit.pair_id, fit.light_idx, fit.view_idx, fit.pearson, fit.rmse_levels, fit.gain
        );
    }
    eprintln!(
        "worst {:?}, median {:?}, {:?} levels",
        truth.worst_pearson, truth.median_pearson, truth.median_rmse_levels
    );
    assert!(truth.agrees, "{truth:#?}");

    let law = Brdf::default();
    let hapke = |mu0: f64, mu: f64, cos_phase: f64| law.radiance_factor(mu0, mu, cos_phase, 1.0);
    let same = |sun: SunAngles| sun;
    let middle = |values: Vec<f64>| median(values.into_iter()).unwrap();
    let controls = [
        ("Lommel-Seeliger", 0.96, middle(control(&scenes, None, same, |mu0, mu, _| mu0 / (mu0 + mu)))),
        ("Lambert", 0.96, middle(control(&scenes, None, same, |mu0, _, _| mu0))),
        (
            "a cosine too many",
            0.96,
            middle(control(&scenes, None, same, |mu0, mu, g| mu0 * hapke(mu0, mu, g))),
        ),
        (
            "azimuth as the script writes it (150), unflipped",
            0.0,
            middle(control(&scenes, Some(0), |sun| SunAngles { azimuth_deg: 150.0, ..sun }, hapke)),
        ),
        (
            "east and west exchanged",
            0.8,
            middle(control(&scenes, None, |sun| SunAngles { azimuth_deg: -sun.azimuth_deg, ..sun }, hapke)),
        ),
        (
            "elevation 70 for 20",
            0.6,
            middle(control(&scenes, Some(1), |sun| SunAngles { elevation_deg: 70.0, ..sun }, hapke)),
        ),
    ];
    for (what, limit, found) in controls {
        eprintln!("control, {what}: median r {found:.3}");
        assert!(found < limit, "{what} should fail, but its median correlation is {found:.4}");
    }
    assert_cast_shadows_do_not_fit(&scenes, &truth);
}

/// Share of sunlit pixels in cast shadow from which on a picture can tell.
const SHADOWED: f64 = 0.03;

/// Worsens every picture with cast shadows worth the name by more than other errors move it.
fn assert_cast_shadows_do_not_fit(scenes: &[Scene], truth: &Report) {
    let settings = Settings::default();
    let mut shadowed = Vec::new();
    for scene in scenes {
        let ground = Ground::new(scene, &settings);
        for picture in &scene.pictures {
            let (pearson, hidden) = ground.fit(scene, picture, &settings);
            let without = truth.images.iter().find(|fit| fit.image == picture.path).unwrap().pearson;
            eprintln!(
                "control, cast shadows: pair {} light {} view {}: {:.1} % hidden, r {without:.4} -> {pearson:.4}",
                scene.pair_id,
                picture.light_idx,
                picture.view_idx,
                100.0 * hidden
            );
            if hidden > SHADOWED {
                shadowed.push(pearson);
            }
        }
    }
    if shadowed.is_empty() {
        eprintln!("control, cast shadows: no picture has any to speak of");
        return;
    }
    let middle = median(shadowed.into_iter()).unwrap();
    assert!(middle < 0.97, "cast shadows should not fit, but the median correlation is {middle:.4}");
}

#[test]
fn sites_follow_their_rules() {
    let body = Body::moon();
    let pose = |place: Geodetic, target: Point3<f64>| {
        let origin = body.point(&place);
        selenograph_geometry::lookat::level::<BodyFixed>(origin, &(target - origin), &body.up(&place))
            .unwrap()
    };
    let ground = Geodetic::from_deg(-88.0, 100.0, 0.0);
    let target = body.point(&ground);
    let poses = [
        pose(Geodetic::from_deg(-88.4, 100.0, 20e3), target),
        pose(Geodetic::from_deg(-88.0, 110.0, 25e3), target),
    ];
    let crossing = site(SiteRule::AxesCrossing, &poses, &body).unwrap();
    assert!((body.point(&crossing) - target).norm() < 1e-3);
    let below = site(SiteRule::BelowFirstCamera, &poses, &body).unwrap();
    assert!((below.lat_rad.to_degrees() + 88.4).abs() < 1e-9);
    let parallel = [poses[0], poses[0]];
    assert!(site(SiteRule::AxesCrossing, &parallel, &body).is_err());
}

#[test]
fn trajectories_are_told_by_the_folder() {
    let rule = |scene: &str| trajectory_of(scene).and_then(SiteRule::of_trajectory);
    assert_eq!(rule("nadir_1"), Some(SiteRule::BelowFirstCamera));
    assert_eq!(rule("pitch_clean_0_90"), Some(SiteRule::AxesCrossing));
    assert_eq!(rule("dynamic_1"), None);
}

#[test]
fn medians() {
    assert_eq!(median([3.0, 1.0, 2.0].into_iter()), Some(2.0));
    assert_eq!(median([4.0, 1.0, 2.0, 3.0].into_iter()), Some(2.5));
    assert_eq!(median(std::iter::empty()), None);
}
