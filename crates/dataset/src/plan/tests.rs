use super::*;
use crate::pair::tilt_rad;
use crate::test_terrain::{nested, wide};
use selenograph_geometry::{Body, Matrix3, Vector3};
use selenograph_render::Interpolation;
use std::path::Path;

fn tracer(terrain: &'static Terrain) -> Tracer<'static> {
    Tracer::new(terrain, Interpolation::Bilinear)
}

/// A preset with so many pairs in each section that it has, its cells allowed to be coarse.
fn preset(name: &str, pairs: u64) -> Campaign {
    let mut campaign = Campaign::preset(name).unwrap();
    for count in [
        &mut campaign.nadir.pairs,
        &mut campaign.oblique.pairs,
        &mut campaign.dynamic.pairs,
        &mut campaign.descent.pairs,
        &mut campaign.low_light.pairs,
        &mut campaign.no_overlap.pairs,
        &mut campaign.identical.pairs,
    ] {
        *count = if *count > 0 { pairs } else { 0 };
    }
    campaign.limits.max_coarse_share = 1.0;
    campaign.limits.probe_rays = 8;
    campaign
}

fn made(campaign: &Campaign, terrain: &'static Terrain) -> Vec<(Row, PlacedPair)> {
    let tracer = tracer(terrain);
    let planner = Planner::new(campaign, &tracer).unwrap();
    let plan = planner.plan(&|_| ());
    assert_eq!(plan.rows.len() as u64, campaign.num_pairs());
    plan.rows.into_iter().filter_map(|row| row.placed.clone().map(|placed| (row, placed))).collect()
}

fn of(pairs: &[(Row, PlacedPair)], trajectory: Trajectory) -> Vec<(&Row, &PlacedPair)> {
    pairs.iter().filter(|(row, _)| row.trajectory == trajectory).map(|(row, placed)| (row, placed)).collect()
}

#[test]
fn a_row_depends_on_nothing_but_its_number() {
    let campaign = preset("paper-iccv2025", 6);
    let tracer = tracer(wide());
    let planner = Planner::new(&campaign, &tracer).unwrap();
    let plan = planner.plan(&|_| ());
    for id in [17, 3, 0, 9] {
        assert_eq!(planner.row(id), plan.rows[id as usize]);
    }
    // The order of the table is that of the numbers, and it reads back to the last bit.
    let text = plan.to_csv().unwrap();
    assert_eq!(Plan::from_csv(&text, Path::new("plan.csv")).unwrap(), plan);
    assert_eq!(planner.plan(&|_| ()).to_csv().unwrap(), text);
    let other = Campaign { seed: campaign.seed + 1, ..campaign.clone() };
    assert_ne!(Planner::new(&other, &tracer).unwrap().row(3), plan.rows[3]);
}

#[test]
fn every_frame_is_orthonormal_and_every_camera_is_over_ground() {
    for name in ["paper-iccv2025", "paper-iccv2025-scripts", "descent", "hard-cases"] {
        let pairs = made(&preset(name, 8), wide());
        assert!(!pairs.is_empty(), "{name}");
        for (row, placed) in &pairs {
            for pose in [placed.a.pose(), placed.b.pose()] {
                let r = pose.rotation();
                // Rounding of a quaternion's four numbers.
                assert!((r * r.transpose() - Matrix3::identity()).amax() < 4e-15, "{name} {}", row.pair_id);
                assert!((r.determinant() - 1.0).abs() < 1e-14);
                assert!(ground::clearance_m(wide(), &pose.origin()).unwrap() > 500.0);
            }
        }
    }
}

#[test]
fn the_papers_pairs_keep_the_papers_ranges() {
    let campaign = preset("paper-iccv2025", 60);
    let pairs = made(&campaign, wide());
    let body = Body::moon();
    assert!(pairs.len() > 170, "{}", pairs.len());
    for (row, placed) in &pairs {
        let relative = RelativeGeometry::new(&body, &placed.site, &placed.a.pose(), &placed.b.pose());
        let altitudes =
            [placed.a, placed.b].map(|p| body.height_m(&p.pose().origin()) - placed.site.height_m);
        let tilts = [placed.a, placed.b].map(|p| tilt_rad(&p.pose()).to_degrees());
        let most = if row.trajectory == Trajectory::Dynamic { 0.3 } else { 0.02 };
        assert!(altitudes.iter().all(|h| (h / row.level_m - 1.0).abs() < most + 1e-9), "{row:?}");
        match row.trajectory {
            Trajectory::Nadir => {
                assert!(tilts.iter().all(|t| *t < 1e-5), "{tilts:?}");
                assert!((0.04..=0.10).contains(&relative.baseline_over_height), "{relative:?}");
                // The baseline is the image's right.
                let right = placed.a.pose().vector(&Vector3::x());
                assert!(relative.baseline_vector_m.normalize().dot(&right) > 0.999);
            }
            Trajectory::Oblique => {
                assert!(tilts.iter().all(|t| (20.0..=35.0).contains(t)), "{tilts:?}");
                assert!(relative.baseline_over_height >= 0.04, "{relative:?}");
                for pose in [placed.a.pose(), placed.b.pose()] {
                    assert!(pose.vector(&Vector3::x()).dot(&pose.origin().coords.normalize()).abs() < 1e-9);
                }
            }
            _ => {
                let b_over_h = placed.parameters["b_over_h"];
                assert!((0.05..=0.18).contains(&b_over_h));
                // What the plan drew is what the record tells.
                assert!((relative.baseline_over_height - b_over_h).abs() < 1e-9, "{row:?}");
                for name in ["roll_a_deg", "roll_b_deg"] {
                    assert!(placed.parameters[name].abs() <= 10.0);
                }
            }
        }
        let suns: Vec<_> = placed.suns.iter().map(|s| (s.azimuth_deg, s.elevation_deg)).collect();
        assert_eq!(suns, [(330.0, 20.0), (250.0, 20.0), (180.0, 15.0)]);
    }
}

#[test]
fn the_papers_sites_are_uniform_in_area_and_free_of_altitude() {
    let campaign = preset("paper-iccv2025", 300);
    let all = made(&campaign, wide());
    let sites: Vec<_> = all.iter().map(|(row, p)| (row.level_m, p.site)).collect();
    let n = sites.len() as f64;
    // Uniform area on a small cap: the squared distance from the pole is uniform, so its mean is half the largest.
    let squared = |site: &Geodetic| ((90.0 + site.lat_rad.to_degrees()) / 3.0).powi(2);
    let mean = sites.iter().map(|(_, s)| squared(s)).sum::<f64>() / n;
    // Standard error 0.29/sqrt(900) = 0.01.
    assert!((mean - 0.5).abs() < 0.04, "{mean}");
    let (east, north) =
        sites.iter().fold((0.0, 0.0), |(x, y), (_, s)| (x + s.lon_rad.cos() / n, y + s.lon_rad.sin() / n));
    assert!(f64::hypot(east, north) < 0.1);
    let mean_level = sites.iter().map(|(l, _)| l).sum::<f64>() / n;
    let covariance =
        sites.iter().map(|(l, s)| (l - mean_level) / 9000.0 * (squared(s) - mean) / 0.289).sum::<f64>() / n;
    assert!(covariance.abs() < 0.1, "{covariance}");
}

#[test]
fn the_scripts_pairs_are_those_of_the_scripts() {
    let campaign = preset("paper-iccv2025-scripts", 50);
    let pairs = made(&campaign, wide());
    let body = Body::moon();
    for (row, placed) in of(&pairs, Trajectory::Nadir) {
        let relative = RelativeGeometry::new(&body, &placed.site, &placed.a.pose(), &placed.b.pose());
        assert!((0.019..=0.101).contains(&relative.baseline_over_height));
        // The second camera looks back at the site: its tilt is the convergence, atan(B/H).
        let tilt = tilt_rad(&placed.b.pose());
        assert!((tilt.tan() - relative.baseline_over_height).abs() < 0.003, "{tilt}");
        assert!(tilt_rad(&placed.a.pose()) < 1e-7);
        assert!(relative.baseline_vector_m.normalize().y.abs() > 0.99);
        let altitude = body.height_m(&placed.a.pose().origin()) - placed.site.height_m;
        assert!((altitude - row.level_m).abs() < 1e-6);
    }
    let oblique = of(&pairs, Trajectory::Oblique);
    let mut tilts: Vec<f64> = Vec::new();
    for (row, placed) in &oblique {
        for pose in [placed.a.pose(), placed.b.pose()] {
            assert!((body.height_m(&pose.origin()) - row.level_m).abs() <= 1000.0 + 1e-6, "{row:?}");
            tilts.push(tilt_rad(&pose).to_degrees());
        }
    }
    let (low, high) = (tilts.iter().copied().fold(90.0, f64::min), tilts.iter().copied().fold(0.0, f64::max));
    // atan(0.5) .. atan(1.1), moved by the height of the ground.
    assert!(low > 18.0 && low < 32.0 && high < 56.0 && high > 43.0, "{low} {high}");
    let dynamic = of(&pairs, Trajectory::Dynamic);
    let turned = dynamic
        .iter()
        .filter(|(_, p)| {
            let relative = RelativeGeometry::new(&body, &p.site, &p.a.pose(), &p.b.pose());
            relative.relative_rotation_rad.to_degrees() > 40.0
        })
        .count();
    assert!(2 * turned > dynamic.len(), "the in-plane rotation is free: {turned} of {}", dynamic.len());
    // Low altitudes come first and stand near the pole: the scripts' own correlation.
    let nadir = of(&pairs, Trajectory::Nadir);
    assert!(nadir.windows(2).all(|w| w[0].0.level_m <= w[1].0.level_m));
    assert!(nadir[0].1.site.lat_rad < nadir[nadir.len() - 1].1.site.lat_rad);
}

#[test]
fn descents_have_their_epipole_inside_and_hard_cases_are_hard() {
    for (row, placed) in made(&preset("descent", 20), wide()) {
        let [a, b] = placed.views();
        let epipole = a.project(&b.origin()).unwrap();
        assert!((0.0..=512.0).contains(&epipole.x) && (0.0..=512.0).contains(&epipole.y));
        let relative = RelativeGeometry::new(&Body::moon(), &placed.site, &placed.a.pose(), &placed.b.pose());
        assert!((0.48..=0.92).contains(&relative.altitude_ratio), "{row:?} {relative:?}");
    }
    let pairs = made(&preset("hard-cases", 12), wide());
    for (_, placed) in of(&pairs, Trajectory::Identical) {
        assert_eq!(placed.a, placed.b);
    }
    let tracer = tracer(wide());
    let limits = campaign::LimitSection { max_coarse_share: 1.0, ..campaign::LimitSection::default() };
    for (_, placed) in of(&pairs, Trajectory::NoOverlap) {
        let [a, b] = placed.views();
        let ground = coverage::probe(&tracer, &a.camera, &a.world_from_cam, &limits, 0.0).unwrap();
        assert_eq!(coverage::share_in_frame(&b.camera, &b.world_from_cam, &ground), 0.0);
    }
    let low = of(&pairs, Trajectory::LowLight);
    assert!(low.iter().all(|(_, p)| p.suns.iter().all(|s| (0.5..=3.0).contains(&s.elevation_deg))));
}

#[test]
fn layers_carry_what_they_can_and_coarse_ground_is_refused() {
    let mut campaign = preset("polar-real", 6);
    campaign.limits.max_coarse_share = 0.02;
    campaign.limits.max_attempts = 60;
    campaign.limits.min_lit_share = 0.0;
    campaign.nadir.altitude_levels_m = vec![3_500.0, 9_500.0];
    campaign.oblique.pairs = 0;
    campaign.dynamic.pairs = 0;
    let pairs = made(&campaign, nested());
    assert_eq!(pairs.len(), 6);
    for (_, placed) in &pairs {
        // Cells of 200 m are too coarse for pixels of 6 or 15 m: all are on the fine site.
        let point = Body::moon().point(&placed.site);
        assert_eq!(nested().sample(&point).unwrap().layer_idx, 0);
    }
    // From 1.2 km up, even the fine cells are too coarse; the reason is told.
    campaign.nadir.altitude_levels_m = vec![1_200.0];
    let tracer = tracer(nested());
    let row = Planner::new(&campaign, &tracer).unwrap().row(0);
    assert_eq!(row.placed, None);
    assert_eq!(row.refusals, BTreeMap::from([(Refusal::NoFineLayer, 60)]));
    campaign.sites.placement = Placement::Area;
    let row = Planner::new(&campaign, &tracer).unwrap().row(0);
    assert_eq!(row.refusals.get(&Refusal::Coarse), Some(&60), "{row:?}");
    let plan = Plan { rows: vec![row] };
    assert_eq!(Plan::from_csv(&plan.to_csv().unwrap(), Path::new("p")).unwrap(), plan);
    assert_eq!(plan.skipped().count(), 1);
}

#[test]
fn the_edge_of_the_terrain_is_refused_at_the_rendering_field_of_view() {
    let mut campaign = preset("paper-iccv2025", 20);
    campaign.oblique.pairs = 0;
    campaign.dynamic.pairs = 0;
    // The cap ends 150 km from the pole, at 85.06° S.
    campaign.sites.lat_deg = Interval::new(-85.6, -84.9);
    campaign.nadir.altitude_levels_m = vec![30_500.0];
    campaign.limits.max_attempts = 3;
    let tracer = tracer(wide());
    let plan = Planner::new(&campaign, &tracer).unwrap().plan(&|_| ());
    let refused: u32 = plan.rows.iter().map(|r| r.refusals.values().sum::<u32>()).sum();
    let absent: u32 = plan.rows.iter().filter_map(|r| r.refusals.get(&Refusal::TerrainAbsent)).sum();
    assert!(absent > 10 && absent == refused, "{absent} of {refused}");
    for row in plan.rows.iter().filter(|r| r.placed.is_some()) {
        let views = row.placed.as_ref().unwrap().views();
        for view in views {
            for (x, y) in [(0, 0), (511, 0), (0, 511), (511, 511), (256, 0)] {
                let ray = view.direction(x, y).unwrap();
                let hit = tracer.first_hit(view.origin(), ray, 0.0, f64::INFINITY);
                assert!(matches!(hit, selenograph_render::Hit::Surface(_)));
            }
        }
    }
}

#[test]
fn broken_tables_are_refused_with_the_line_and_the_column() {
    let campaign = preset("paper-iccv2025", 1);
    let tracer = tracer(wide());
    let text = Planner::new(&campaign, &tracer).unwrap().plan(&|_| ()).to_csv().unwrap();
    let broken = |from: &str, to: &str| {
        Plan::from_csv(&text.replacen(from, to, 1), Path::new("plan.csv")).unwrap_err().to_string()
    };
    assert!(broken("pair_id,", "id,").contains("columns of a plan"));
    assert!(broken("nadir", "nadirr").contains("line 2, column `trajectory`"));
    assert!(broken("\n1,", "\n0,").contains("pair numbers that rise"));
    assert!(broken("512,512", "512,x").contains("column `height_px`"), "{}", broken("512,512", "512,x"));
    // Cut anywhere, it is refused or a shorter table, never a panic.
    for cut in (0..text.len()).step_by(37) {
        let _ = Plan::from_csv(&text[..cut], Path::new("plan.csv"));
    }
}
