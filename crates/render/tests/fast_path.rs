//! The fast path against the exact one, and against itself with other instructions and thread counts.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use common::{layer, nested};
use selenograph_geometry::{Body, Camera, Distortion, Point3, Projection, Vector3, lookat};
use selenograph_raster::Raster;
use selenograph_render::{
    InstructionSet, Interpolation, LightMaps, RadianceSettings, Shadows, Sun, Tracer, Truth, Viewpoint,
    radiance,
};
use selenograph_terrain::Terrain;

const OFF: [f64; 2] = [41_000.0, -23_000.0];

fn single() -> Terrain {
    let moon = Body::moon();
    let map = Projection::south_polar(moon.radius_m);
    Terrain::new(moon.clone(), vec![layer(map, &moon, OFF, 10.0, 240, 1.0)]).unwrap()
}

/// A camera `altitude_m` over the middle of the finest layer, tilted from the vertical.
fn view(terrain: &Terrain, altitude_m: f64, tilt_deg: f64, size: usize, distortion: Distortion) -> Viewpoint {
    let grid = &terrain.layers[0].grid;
    let middle = grid.point_from_grid((grid.cols / 2) as f64, (grid.rows / 2) as f64, 0.0).unwrap();
    let enu = terrain.body.body_from_enu(&terrain.body.place(&middle));
    let (sin, cos) = tilt_deg.to_radians().sin_cos();
    let forward = enu.vector(&Vector3::new(0.6 * sin, 0.8 * sin, -cos));
    let origin: Point3<f64> = middle - forward * (altitude_m / cos);
    let camera = Camera::from_fov(size, size, 0.35).unwrap().with_distortion(distortion);
    Viewpoint {
        camera,
        world_from_cam: lookat::from_forward_and_right(origin, &forward, &enu.vector(&Vector3::x())).unwrap(),
    }
}

fn sun(terrain: &Terrain, view: &Viewpoint, azimuth_deg: f64, elevation_deg: f64) -> Sun {
    let site = terrain.body.place(&view.origin());
    Sun::at_site(&terrain.body, &site, f64::to_radians(azimuth_deg), f64::to_radians(elevation_deg)).unwrap()
}

fn picture(
    terrain: &Terrain,
    view: &Viewpoint,
    suns: &[Sun],
    settings: &RadianceSettings,
) -> Vec<Raster<f32>> {
    let tracer = Tracer::new(terrain, Interpolation::Bilinear);
    let truth = Truth::cast(&tracer, view).unwrap();
    radiance(&tracer, view, &truth, suns, settings).unwrap()
}

fn settings(set: InstructionSet) -> RadianceSettings {
    RadianceSettings { rays_per_pixel: 20, instruction_set: set, ..RadianceSettings::default() }
}

/// Largest mean difference from the exact picture, as a share of its mean: f32 picks another cell for a ray in ten
/// thousand, and a shadow edge moves by its millimetre.
const MEAN_DIFFERENCE: f64 = 2e-3;
/// Share of pixels that may differ by more than a hundredth of the mean.
const PIXELS_OFF: f64 = 0.01;

#[test]
fn the_fast_picture_is_the_exact_picture() {
    let moon = Body::moon();
    let terrains = [single(), nested(&moon, Projection::south_polar(moon.radius_m), OFF)];
    let lens = Distortion { k1: -0.08, p1: 1e-3, ..Distortion::default() };
    for (name, terrain, altitude, tilt, azimuth, elevation, lens) in [
        ("nadir", &terrains[0], 3500.0, 0.0, 30.0, 8.0, Distortion::default()),
        ("oblique", &terrains[0], 2500.0, 40.0, 110.0, 5.0, Distortion::default()),
        ("steep view, low Sun", &terrains[0], 1500.0, 55.0, 200.0, 2.0, Distortion::default()),
        ("high Sun", &terrains[0], 3000.0, 10.0, 290.0, 65.0, Distortion::default()),
        ("lens", &terrains[0], 3000.0, 20.0, 60.0, 12.0, lens),
        ("across a seam", &terrains[1], 5000.0, 15.0, 330.0, 6.0, Distortion::default()),
        ("octant 8", &terrains[1], 3000.0, 5.0, 170.0, 4.0, Distortion::default()),
    ] {
        let view = view(terrain, altitude, tilt, 48, lens);
        let sun = sun(terrain, &view, azimuth, elevation);
        let exact = &picture(terrain, &view, &[sun], &settings(InstructionSet::Exact))[0];
        let fast = &picture(terrain, &view, &[sun], &settings(InstructionSet::best()))[0];
        let mean = exact.data.iter().map(|v| f64::from(*v)).sum::<f64>() / exact.data.len() as f64;
        let off: Vec<f64> =
            exact.data.iter().zip(&fast.data).map(|(a, b)| f64::from((a - b).abs()) / mean).collect();
        let mean_off = off.iter().sum::<f64>() / off.len() as f64;
        let share = off.iter().filter(|d| **d > 0.01).count() as f64 / off.len() as f64;
        println!(
            "{name}: mean {mean:.5}, mean difference {mean_off:.1e}, {:.2} % of pixels off",
            100.0 * share
        );
        assert!(mean > 1e-4, "{name}: a dark picture tests nothing");
        assert!(mean_off < MEAN_DIFFERENCE && share < PIXELS_OFF, "{name}: {mean_off:.2e} {share:.4}");
    }
}

#[test]
fn instruction_sets_and_thread_counts_give_the_same_bits() {
    let terrain = single();
    for (tilt, elevation) in [(0.0, 8.0), (50.0, 3.0)] {
        let view = view(&terrain, 2500.0, tilt, 40, Distortion::default());
        let suns = [sun(&terrain, &view, 30.0, elevation), sun(&terrain, &view, 250.0, 20.0)];
        let reference = picture(&terrain, &view, &suns, &settings(InstructionSet::Scalar));
        for set in [InstructionSet::Avx2, InstructionSet::Avx512] {
            if !set.is_available() {
                println!("{set:?} is not on this machine");
                continue;
            }
            assert_eq!(picture(&terrain, &view, &suns, &settings(set)), reference, "{set:?}");
        }
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let again = pool.install(|| picture(&terrain, &view, &suns, &settings(InstructionSet::best())));
            assert_eq!(again, reference, "{threads} threads");
        }
    }
}

#[test]
fn attached_shadows_are_brighter_than_cast_ones_and_never_darker() {
    let terrain = single();
    let view = view(&terrain, 3000.0, 10.0, 48, Distortion::default());
    let sun = sun(&terrain, &view, 30.0, 4.0);
    let cast = &picture(&terrain, &view, &[sun], &settings(InstructionSet::best()))[0];
    let attached = RadianceSettings { shadows: Shadows::Attached, ..settings(InstructionSet::best()) };
    let attached = &picture(&terrain, &view, &[sun], &attached)[0];
    assert!(cast.data.iter().zip(&attached.data).all(|(c, a)| c <= a));
    let sum = |p: &Raster<f32>| p.data.iter().sum::<f32>();
    assert!(sum(cast) < 0.9 * sum(attached));
}

#[test]
fn the_lit_mask_is_that_of_exact_rays() {
    let moon = Body::moon();
    for terrain in [single(), nested(&moon, Projection::south_polar(moon.radius_m), OFF)] {
        let view = view(&terrain, 4000.0, 20.0, 96, Distortion::default());
        let tracer = Tracer::new(&terrain, Interpolation::Bilinear);
        let truth = Truth::cast(&tracer, &view).unwrap();
        for elevation in [2.0, 6.0, 30.0] {
            let sun = sun(&terrain, &view, 70.0, elevation);
            let light = LightMaps::cast(&tracer, &view, &truth, &sun, Shadows::Cast);
            let mut dark = 0;
            for n in 0..truth.depth_z.len() {
                let Some(point) = truth.point(&view, n % 96, n / 96) else { continue };
                let faces = f64::from(light.incidence_rad[n]) < std::f64::consts::FRAC_PI_2;
                let lit = faces && !tracer.occluded(point, sun.direction.into_inner());
                assert_eq!(light.lit[n] == 1, lit, "pixel {n} at {elevation}°");
                dark += usize::from(!lit);
            }
            assert!(elevation > 10.0 || dark > 500, "{dark} dark pixels test nothing");
        }
    }
}

#[test]
fn a_sun_below_the_horizon_makes_a_dark_picture() {
    let terrain = single();
    let view = view(&terrain, 3000.0, 0.0, 24, Distortion::default());
    let sun = sun(&terrain, &view, 30.0, -20.0);
    let dark = &picture(&terrain, &view, &[sun], &settings(InstructionSet::best()))[0];
    assert!(dark.data.iter().all(|v| *v == 0.0));
}

#[test]
fn unusable_settings_are_refused() {
    for broken in [
        RadianceSettings { rays_per_pixel: 0, ..RadianceSettings::default() },
        RadianceSettings { psf_sigma_px: -1.0, ..RadianceSettings::default() },
        RadianceSettings { psf_sigma_px: f64::NAN, ..RadianceSettings::default() },
    ] {
        assert!(broken.validate().is_err());
    }
}
