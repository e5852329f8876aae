//! Another body, another surface, another albedo: a Mars-sized sphere on an equirectangular map against closed forms, the
//! C¹ surface against the bilinear one, a map of albedo.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use common::{layer, nested};
use selenograph_geometry::{Body, Camera, Geodetic, Point3, Projection, Vector3, lookat, proj_string::Crs};
use selenograph_raster::Raster;
use selenograph_raster::georef::Affine;
use selenograph_render::brdf::Brdf;
use selenograph_render::{
    Albedo, AlbedoMap, Hit, InstructionSet, Interpolation, RadianceSettings, Shadows, Sun, Tracer, Truth,
    Viewpoint, radiance,
};
use selenograph_terrain::{Grid, Layer, Terrain};
use std::sync::Arc;

const PLACE_DEG: [f64; 2] = [12.0, 137.0];
const BOTH: [InstructionSet; 2] = [InstructionSet::Exact, InstructionSet::Scalar];

fn equirectangular(body: &Body) -> Projection {
    Projection::Equirectangular {
        lat_ts_rad: PLACE_DEG[0].to_radians(),
        lat0_rad: PLACE_DEG[0].to_radians(),
        lon0_rad: PLACE_DEG[1].to_radians(),
        false_easting_m: 0.0,
        false_northing_m: 0.0,
        radius_m: body.radius_m,
    }
}

/// A Mars without relief, `height_m` above its sphere, 18° round the place.
fn smooth(height_m: f32) -> Terrain {
    let mars = Body::mars();
    let (cell, half) = (mars.radius_m * 0.1f64.to_radians(), 180);
    let corner = half as f64 * cell;
    let n = 2 * half + 1;
    let crs = Crs { body: mars.clone(), projection: equirectangular(&mars) };
    let grid = Grid::new(crs, n, n, Affine::new([-corner, cell, 0.0, corner, 0.0, -cell])).unwrap();
    Terrain::new(mars, vec![Layer::from_heights(grid, vec![height_m; n * n]).unwrap()]).unwrap()
}

/// 2.4 km of relief at the place.
fn rough() -> Terrain {
    let mars = Body::mars();
    Terrain::new(mars.clone(), vec![layer(equirectangular(&mars), &mars, [0.0, 0.0], 10.0, 120, 1.0)])
        .unwrap()
}

/// A camera over the place, tilted northwards from the vertical.
fn view(body: &Body, altitude_m: f64, tilt_deg: f64, fov_rad: f64) -> Viewpoint {
    let place = Geodetic::from_deg(PLACE_DEG[0], PLACE_DEG[1], altitude_m);
    let forward = body.direction(&place, 0.0, (tilt_deg - 90.0).to_radians());
    let right = body.direction(&place, std::f64::consts::FRAC_PI_2, 0.0);
    Viewpoint {
        camera: Camera::from_fov(48, 48, fov_rad).unwrap(),
        world_from_cam: lookat::from_forward_and_right(body.point(&place), &forward, &right).unwrap(),
    }
}

fn sun(body: &Body, elevation_deg: f64) -> Sun {
    let site = Geodetic::from_deg(PLACE_DEG[0], PLACE_DEG[1], 0.0);
    Sun::at_site(body, &site, 0.7, elevation_deg.to_radians()).unwrap()
}

/// Where a ray enters a sphere about the origin: the smaller root of |o + t d|² = r².
fn sphere_hit(origin: &Point3<f64>, direction: &Vector3<f64>, radius_m: f64) -> Option<f64> {
    let (a, b) = (direction.norm_squared(), origin.coords.dot(direction));
    // (|o| − r)(|o| + r) keeps the digits that |o|² − r² would lose.
    let distance = origin.coords.norm();
    let c = (distance - radius_m) * (distance + radius_m);
    let root = b * b - a * c;
    (root >= 0.0 && b < 0.0).then(|| c / (-b + root.sqrt()))
}

#[test]
fn a_smooth_mars_has_the_limb_and_the_curvature_of_its_sphere() {
    const HEIGHT_M: f32 = 1_500.0;
    /// Rounding of positions at the radius of Mars (5e-10 m), stretched where a ray grazes the limb.
    const MAX_ERROR_M: f64 = 1e-3;
    let terrain = smooth(HEIGHT_M);
    let mars = &terrain.body;
    let radius_m = mars.radius_m + f64::from(HEIGHT_M);
    // From 100 km the limb is 76.4° off the nadir, 13.6° of arc away.
    let view = view(mars, 100_000.0, 70.0, 0.5);
    let tracer = Tracer::new(&terrain, Interpolation::Bilinear);
    let truth = Truth::cast(&tracer, &view).unwrap();
    let (mut num_ground, mut worst) = (0, 0f64);
    for n in 0..truth.depth_z.len() {
        let direction = view.direction(n % truth.width, n / truth.width).unwrap();
        match sphere_hit(&view.origin(), &direction, radius_m) {
            None => assert!(truth.depth_z[n].is_nan(), "ground above the limb at pixel {n}"),
            Some(t) => {
                num_ground += 1;
                worst = worst.max((truth.depth_z[n] - t).abs());
                let normal = (view.origin() + direction * t).coords.normalize();
                let found = Vector3::from(truth.normal[n].map(f64::from));
                assert!((found - normal).norm() < 1e-6, "normal at pixel {n}");
                assert!(truth.slope_rad[n] < 1e-6);
            }
        }
    }
    println!("{num_ground} of {} pixels on the ground, worst depth error {worst:.1e} m", truth.depth_z.len());
    assert_eq!(truth.num_sky, truth.depth_z.len() - num_ground);
    assert!(num_ground > 1000 && truth.num_sky > 300, "the picture should hold the limb");
    assert!(worst < MAX_ERROR_M, "{worst}");

    // A Lambert sphere under a distant point: I/F is the cosine of incidence.
    let sun = sun(mars, 25.0).as_point();
    for instruction_set in BOTH {
        let settings = RadianceSettings {
            rays_per_pixel: 1,
            psf_sigma_px: 0.0,
            shadows: Shadows::Attached,
            brdf: Brdf::Lambert,
            instruction_set,
            ..RadianceSettings::default()
        };
        let picture = &radiance(&tracer, &view, &truth, &[sun], &settings).unwrap()[0];
        for (n, value) in picture.data.iter().enumerate() {
            let direction = view.direction(n % truth.width, n / truth.width).unwrap();
            let expected = sphere_hit(&view.origin(), &direction, radius_m).map_or(0.0, |t| {
                (view.origin() + direction * t).coords.normalize().dot(&sun.direction).max(0.0)
            });
            assert!(
                (f64::from(*value) - expected).abs() < 2e-4,
                "{instruction_set:?} {n}: {value} {expected}"
            );
        }
    }
}

#[test]
fn the_fast_picture_of_a_rough_mars_is_the_exact_one() {
    let mars = Body::mars();
    let terrain = nested(&mars, equirectangular(&mars), [0.0, 0.0]);
    let view = view(&terrain.body, 2_500.0, 20.0, 0.3);
    let tracer = Tracer::new(&terrain, Interpolation::Bilinear);
    let truth = Truth::cast(&tracer, &view).unwrap();
    assert_eq!(truth.num_absent + truth.num_sky, 0);
    let sun = sun(&terrain.body, 9.0);
    let [exact, fast] = [InstructionSet::Exact, InstructionSet::best()].map(|instruction_set| {
        let settings =
            RadianceSettings { rays_per_pixel: 16, instruction_set, ..RadianceSettings::default() };
        radiance(&tracer, &view, &truth, &[sun], &settings).unwrap().remove(0)
    });
    let mean = exact.data.iter().map(|v| f64::from(*v)).sum::<f64>() / exact.data.len() as f64;
    let off = exact.data.iter().zip(&fast.data).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
    let mean_off = off / exact.data.len() as f64 / mean;
    println!("mean {mean:.5}, mean difference {mean_off:.1e}");
    assert!(mean > 1e-3 && mean_off < 2e-3, "{mean} {mean_off}");
}

/// Angles in degrees by which the normal turns across lines of constant column, at many rows.
fn normal_jumps_deg(
    terrain: &Terrain,
    interpolation: Interpolation,
    column: impl Fn(usize) -> f64,
) -> Vec<f64> {
    let tracer = Tracer::new(terrain, interpolation);
    let grid = &terrain.layers[0].grid;
    let normal = |c: f64, r: f64| {
        let above = grid.point_from_grid(c, r, 3_000.0).unwrap();
        let Hit::Surface(hit) = tracer.first_hit(above, -above.coords.normalize(), 0.0, f64::INFINITY) else {
            panic!("no ground at {c} {r}")
        };
        tracer.local_surface(&hit).unwrap().normal
    };
    (0..400)
        .map(|k| {
            let (c, r) = (column(20 + k % 200), 20.37 + (k * 7 % 200) as f64);
            normal(c - 1e-6, r).angle(&normal(c + 1e-6, r)).to_degrees()
        })
        .collect()
}

#[test]
fn the_c1_surface_has_no_creases_and_makes_pictures() {
    let terrain = rough();
    let median = |mut jumps: Vec<f64>| {
        jumps.sort_by(f64::total_cmp);
        jumps[jumps.len() / 2]
    };
    let bilinear = normal_jumps_deg(&terrain, Interpolation::Bilinear, |i| i as f64);
    let middle = median(bilinear);
    assert!(middle > 1.0, "the bilinear surface should have creases here: {middle}");
    // The spline's pieces meet half-way between nodes; at the nodes it is one polynomial.
    for shift in [0.0, 0.5] {
        let smooth = normal_jumps_deg(&terrain, Interpolation::QuadraticBSpline, |i| i as f64 + shift);
        let worst = smooth.iter().copied().fold(0.0, f64::max);
        println!("crease across a cell's edge: bilinear median {middle:.2}°, C1 worst {worst:.1e}°");
        assert!(worst < 1e-3, "shift {shift}: {worst}");
    }
    let view = view(&terrain.body, 2_500.0, 10.0, 0.3);
    let sun = sun(&terrain.body, 20.0);
    let [bilinear, spline] =
        [Interpolation::Bilinear, Interpolation::QuadraticBSpline].map(|interpolation| {
            let tracer = Tracer::new(&terrain, interpolation);
            let truth = Truth::cast(&tracer, &view).unwrap();
            assert_eq!(truth.num_absent + truth.num_sky, 0);
            let settings = RadianceSettings { rays_per_pixel: 8, ..RadianceSettings::default() };
            radiance(&tracer, &view, &truth, &[sun], &settings).unwrap().remove(0)
        });
    let mean = |picture: &Raster<f32>| picture.data.iter().sum::<f32>() / picture.data.len() as f32;
    assert!(bilinear != spline);
    // The same ground, with its roughness rounded off.
    assert!((mean(&bilinear) / mean(&spline) - 1.0).abs() < 0.1);
}

#[test]
fn an_albedo_map_scales_each_pixel_by_what_its_centre_sees() {
    let terrain = rough();
    let grid = terrain.layers[0].grid.clone();
    let mut values = Raster::from_fn(grid.cols, grid.rows, |i, j| 0.2 + (i + 2 * j) as f32 / 900.0);
    values[(120, 120)] = f32::NAN;
    let map = Albedo::Map(Arc::new(AlbedoMap { grid, values, elsewhere: 0.05 }));
    let view = view(&terrain.body, 2_500.0, 10.0, 0.2);
    let sun = sun(&terrain.body, 30.0);
    let tracer = Tracer::new(&terrain, Interpolation::Bilinear);
    let truth = Truth::cast(&tracer, &view).unwrap();
    for instruction_set in BOTH {
        let plain = RadianceSettings { rays_per_pixel: 4, instruction_set, ..RadianceSettings::default() };
        let mapped = RadianceSettings { albedo: map.clone(), ..plain.clone() };
        let [plain, mapped] =
            [plain, mapped].map(|s| radiance(&tracer, &view, &truth, &[sun], &s).unwrap().remove(0));
        for (n, (plain, mapped)) in plain.data.iter().zip(&mapped.data).enumerate() {
            let point = truth.point(&view, n % truth.width, n / truth.width).unwrap();
            let expected = map.at(&point) * f64::from(*plain);
            assert!((f64::from(*mapped) - expected).abs() <= 1e-6 * expected, "{instruction_set:?} {n}");
        }
    }
    let above = |c: f64, r: f64| terrain.layers[0].grid.point_from_grid(c, r, 0.0).unwrap();
    assert!((map.at(&above(10.0, 20.0)) - (0.2 + 50.0 / 900.0)).abs() < 1e-6);
    assert_eq!((map.at(&above(120.5, 120.5)), map.at(&above(-3.0, 10.0))), (0.05, 0.05));
}
