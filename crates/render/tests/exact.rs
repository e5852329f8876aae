//! Truth depth against an independent brute force: tiny steps along the exact ray, no pyramid, no parabolas.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use common::{layer, nested};
use selenograph_geometry::{Body, Geodetic, Point3, Pole, Projection, Vector3, proj_string::Crs};
use selenograph_raster::georef::Affine;
use selenograph_render::{Hit, Interpolation, Tracer};
use selenograph_terrain::{Grid, Layer, Terrain};

/// The bar of the issue: 0.1 mm.
const MAX_ERROR_M: f64 = 1e-4;

/// Steps down to a centimetre where the ray is close to the surface; then bisection. Uses only
/// [`Terrain::sample`], which the tracer does not. `None`: no hit, or the ray came in below the surface.
/// Steps of the brute force next to the surface.
const FINEST_STEP_M: f64 = 0.01;

fn brute_force(terrain: &Terrain, origin: Point3<f64>, direction: Vector3<f64>, t_max: f64) -> Option<f64> {
    let clearance = |t: f64| {
        let p = origin + direction * t;
        terrain.sample(&p).map(|s| terrain.body.height_m(&p) - s.height_m)
    };
    let step = terrain.layers[0].cell_m / 20.0;
    let (mut t, mut last) = (0.0, None);
    while t < t_max {
        // No slope here exceeds 70°, so a clearance g cannot close within g/3 of path.
        let next_t = t + last.map_or(step, |g: f64| (g / 3.0).max(FINEST_STEP_M));
        let next = clearance(next_t);
        if next.is_some_and(|g| g < 0.0) {
            last?;
            let (mut a, mut b) = (t, next_t);
            for _ in 0..60 {
                let m = f64::midpoint(a, b);
                if clearance(m)? < 0.0 { b = m } else { a = m }
            }
            return Some(f64::midpoint(a, b));
        }
        (t, last) = (next_t, next);
    }
    None
}

struct Lcg(u64);
impl Lcg {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Casts `num_rays` rays at elevations between `el_deg` towards random points near `centre`, compares, returns
/// (compared, worst error, disagreements on hitting at all).
fn compare(
    terrain: &Terrain,
    centre: Geodetic,
    spread_m: f64,
    el_deg: [f64; 2],
    num_rays: usize,
) -> (usize, f64, usize) {
    let tracer = Tracer::new(terrain, Interpolation::Bilinear);
    let mut rng = Lcg(num_rays as u64);
    let enu = terrain.body.body_from_enu(&centre);
    let top = terrain.height_range().1;
    let (mut compared, mut worst, mut disagree) = (0, 0.0f64, 0);
    for _ in 0..num_rays {
        let target =
            enu.point(&Point3::new((rng.next() - 0.5) * spread_m, (rng.next() - 0.5) * spread_m, 0.0));
        let (az, el) = (
            rng.next() * std::f64::consts::TAU,
            (el_deg[0] + (el_deg[1] - el_deg[0]) * rng.next()).to_radians(),
        );
        let back = enu.vector(&Vector3::new(el.cos() * az.sin(), el.cos() * az.cos(), el.sin()));
        let origin = target + back * ((top + 20.0) / el.sin());
        let t_max = 2.0 * (top + 200.0) / el.sin();
        let found = tracer.first_hit(origin, -back, 0.0, t_max);
        let expected = brute_force(terrain, origin, -back, t_max);
        match (found, expected) {
            (Hit::Surface(hit), Some(t)) => {
                compared += 1;
                if (hit.t - t).abs() > MAX_ERROR_M {
                    disagree += 1;
                }
                worst = worst.max((hit.t - t).abs());
            }
            (Hit::Sky | Hit::Absent, None) => {}
            _ => disagree += 1,
        }
    }
    (compared, worst, disagree)
}

#[test]
fn truth_depth_equals_brute_force_everywhere() {
    let moon = Body::moon();
    let south = Projection::south_polar(moon.radius_m);
    let off = [41_000.0, -23_000.0];
    let single =
        |origin| Terrain::new(moon.clone(), vec![layer(south, &moon, origin, 20.0, 120, 3.0)]).unwrap();
    let pole = single([0.0, 0.0]);
    let away = single(off);
    let seam = nested(&moon, south, off);
    let mars = Body::mars();
    let eqc = Projection::Equirectangular {
        lat_ts_rad: 0.3,
        lat0_rad: 0.0,
        lon0_rad: 0.0,
        false_easting_m: 0.0,
        false_northing_m: 0.0,
        radius_m: mars.radius_m,
    };
    let plains =
        Terrain::new(mars.clone(), vec![layer(eqc, &mars, [500_000.0, 900_000.0], 20.0, 120, 2.0)]).unwrap();
    let north = Projection::polar(Pole::North, moon.radius_m);
    let north = Terrain::new(moon.clone(), vec![layer(north, &moon, [-9e4, 3e4], 20.0, 120, 2.0)]).unwrap();

    let centre = |terrain: &Terrain| {
        let grid = &terrain.layers[0].grid;
        let point = grid.point_from_grid((grid.cols / 2) as f64, (grid.rows / 2) as f64, 0.0).unwrap();
        terrain.body.place(&point)
    };
    let mut total = 0;
    for (name, terrain, el_deg, spread, rays) in [
        ("nadir", &away, [80.0, 90.0], 3000.0, 40_000),
        ("oblique", &away, [30.0, 65.0], 3000.0, 25_000),
        ("grazing", &away, [3.0, 10.0], 1500.0, 8_000),
        ("pole, nadir", &pole, [75.0, 90.0], 200.0, 15_000),
        ("pole, grazing", &pole, [3.0, 20.0], 400.0, 4_000),
        ("seam", &seam, [15.0, 85.0], 2200.0, 15_000),
        ("Mars, equirectangular", &plains, [10.0, 85.0], 2000.0, 8_000),
        ("north pole map", &north, [10.0, 85.0], 2000.0, 8_000),
    ] {
        let (compared, worst, disagree) = compare(terrain, centre(terrain), spread, el_deg, rays);
        println!(
            "{name}: {compared} of {rays} rays hit, worst difference {worst:.2e} m, {disagree} disagree"
        );
        assert!(compared * 10 > rays * 6, "{name}: too few rays hit");
        assert_eq!(disagree, 0, "{name}");
        assert!(worst < MAX_ERROR_M, "{name}");
        total += compared;
    }
    assert!(total >= 100_000, "{total} rays");
}

#[test]
fn depth_of_a_bare_sphere_is_the_closed_form() {
    let moon = Body::moon();
    let south = Projection::south_polar(moon.radius_m);
    let grid = Grid::new(
        Crs { body: moon.clone(), projection: south },
        401,
        401,
        Affine::new([-20_000.0, 100.0, 0.0, 20_000.0, 0.0, -100.0]),
    )
    .unwrap();
    let terrain =
        Terrain::new(moon.clone(), vec![Layer::from_heights(grid, vec![0.0; 401 * 401]).unwrap()]).unwrap();
    let tracer = Tracer::new(&terrain, Interpolation::Bilinear);
    let origin = Point3::new(300.0, -500.0, -(moon.radius_m + 10_000.0));
    for direction in [Vector3::new(0.0, 0.0, 1.0), Vector3::new(0.3, 0.2, 1.0), Vector3::new(-0.4, 0.1, 1.0)]
    {
        let Hit::Surface(hit) = tracer.first_hit(origin, direction, 0.0, f64::INFINITY) else {
            panic!("no hit")
        };
        let (a, b) = (direction.norm_squared(), origin.coords.dot(&direction));
        let c = (origin.coords.norm() - moon.radius_m) * (origin.coords.norm() + moon.radius_m);
        let t = c / (-b + (b * b - a * c).sqrt());
        assert!((hit.t - t).abs() < 1e-6, "{} {t}", hit.t);
        let local = tracer.local_surface(&hit).unwrap();
        assert!(local.slope_rad < 1e-9);
        assert!((local.normal.into_inner() - hit.point.coords.normalize()).norm() < 1e-9);
    }
}
