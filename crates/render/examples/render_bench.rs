//! The renderer's benchmark: the scene of the comparison with Embree, whole pictures with shadows.
//!
//! `cargo run --release -p selenograph-render --example render_bench -- terrain.npy [--runs N] [--azimuth DEG] [--oblique] [--attached] [--set avx512|avx2|scalar|exact] [--compare] [--picture out.png]`
//!
//! The terrain is a square `.npy` of f32 heights at 5 m, put round the south pole; the camera hangs 10 km above its middle
//! with 45° across 512×512 pixels; 64 rays per pixel through a Gaussian of 0.6 px; the Sun's disc at elevation 8°,
//! azimuth 30° (or `--azimuth`); cast shadows. Prints `selenograph wall_s=<median>` and the parts.

#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::print_stdout, reason = "a benchmark prints its figures")]

use selenograph_geometry::{Body, Camera, Point3, Projection, Vector3, lookat, proj_string::Crs};
use selenograph_raster::georef::Affine;
use selenograph_render::*;
use selenograph_terrain::{Grid, Layer, Terrain};
use std::time::Instant;

const CELL_M: f64 = 5.0;

fn terrain(path: &str) -> Result<Terrain, Box<dyn std::error::Error>> {
    let bytes = std::fs::read(path)?;
    let array = npyz::NpyFile::new(&bytes[..])?;
    let n = array.shape()[0] as usize;
    let heights: Vec<f32> = array.into_vec()?;
    let body = Body::moon();
    let corner = (n - 1) as f64 / 2.0 * CELL_M;
    let crs = Crs { projection: Projection::south_polar(body.radius_m), body: body.clone() };
    let grid = Grid::new(crs, n, n, Affine::new([-corner, CELL_M, 0.0, corner, 0.0, -CELL_M]))?;
    let started = Instant::now();
    let layer = Layer::from_heights(grid, heights)?;
    println!("pyramid_s={:.3}", started.elapsed().as_secs_f64());
    let shape = &layer.pyramid.shape;
    println!("memory_ratio={:.3}", 1.0 + (shape.max_len + shape.min_len) as f64 / (n * n) as f64);
    Ok(Terrain::new(body, vec![layer])?)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str| args.iter().position(|a| a == name).and_then(|k| args.get(k + 1));
    let path = args.first().ok_or(
        "usage: render_bench terrain.npy [--runs N] [--azimuth DEG] [--oblique] [--picture out.png]",
    )?;
    let runs: usize = value("--runs").map_or(Ok(5), |v| v.parse())?;
    let terrain = terrain(path)?;
    let tracer = Tracer::new(&terrain, Interpolation::Bilinear);
    let origin = Point3::new(0.0, 0.0, -(terrain.body.radius_m + 10_000.0));
    // The oblique view is tilted by 30° about the image's x axis.
    let has = |name: &str| args.iter().any(|a| a == name);
    let tilt = if has("--oblique") { 30f64.to_radians() } else { 0.0 };
    let forward = Vector3::new(tilt.sin(), 0.0, tilt.cos());
    let camera = Camera::from_fov(512, 512, 45f64.to_radians())?;
    let view = Viewpoint {
        camera,
        world_from_cam: lookat::from_forward_and_right(origin, &forward, &Vector3::y())?,
    };
    let azimuth_deg: f64 = value("--azimuth").map_or(Ok(30.0), |v| v.parse())?;
    let site = terrain.body.place(&Point3::new(0.0, 0.0, -terrain.body.radius_m));
    let sun = Sun::at_site(&terrain.body, &site, azimuth_deg.to_radians(), 8f64.to_radians())?;
    let started = Instant::now();
    let truth = Truth::cast(&tracer, &view)?;
    println!(
        "truth_s={:.3} sky={} absent={}",
        started.elapsed().as_secs_f64(),
        truth.num_sky,
        truth.num_absent
    );
    let started = Instant::now();
    let light = LightMaps::cast(&tracer, &view, &truth, &sun, Shadows::Cast);
    let lit = light.lit.iter().map(|v| usize::from(*v)).sum::<usize>();
    println!("light_s={:.3} lit={:.4}", started.elapsed().as_secs_f64(), lit as f64 / light.lit.len() as f64);
    let mut settings = RadianceSettings::default();
    if has("--attached") {
        settings.shadows = Shadows::Attached;
    }
    settings.instruction_set = match value("--set").map(String::as_str) {
        None => settings.instruction_set,
        Some("avx512") => InstructionSet::Avx512,
        Some("avx2") => InstructionSet::Avx2,
        Some("scalar") => InstructionSet::Scalar,
        Some("exact") => InstructionSet::Exact,
        Some(other) => return Err(format!("unknown instruction set {other}").into()),
    };
    let (mut seconds, mut pictures) = (Vec::new(), Vec::new());
    for _ in 0..runs.max(1) {
        let started = Instant::now();
        pictures = radiance(&tracer, &view, &truth, &[sun], &settings)?;
        seconds.push(started.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    println!("mean_radiance={:.5}", pictures[0].data.iter().sum::<f32>() / pictures[0].data.len() as f32);
    if let Some(out) = value("--picture") {
        let exposure = Tone::default().exposures(&[&pictures[0]])[0];
        std::fs::write(out, selenograph_raster::codec::png::encode_grey8(&exposure.to_u8(&pictures[0]))?)?;
    }
    if has("--compare") {
        let exact = RadianceSettings { instruction_set: InstructionSet::Exact, ..settings.clone() };
        let reference = radiance(&tracer, &view, &truth, &[sun], &exact)?;
        let mean = reference[0].data.iter().sum::<f32>() / reference[0].data.len() as f32;
        let mut off: Vec<f32> =
            pictures[0].data.iter().zip(&reference[0].data).map(|(a, b)| (a - b).abs() / mean).collect();
        off.sort_by(f32::total_cmp);
        let at = |q: f64| off[((off.len() - 1) as f64 * q) as usize];
        let mean_off = off.iter().sum::<f32>() / off.len() as f32;
        println!(
            "difference from exact, shares of the mean: mean {mean_off:.2e}, p99 {:.2e}, p99.9 {:.2e}, worst {:.2e}",
            at(0.99),
            at(0.999),
            at(1.0)
        );
    }
    println!("instruction_set={:?} runs={seconds:?}", settings.instruction_set);
    println!("selenograph wall_s={:.3}", seconds[seconds.len() / 2]);
    Ok(())
}
