//! How well shading does on a dataset of ours, on exact pictures and on disturbed ones, with poses that are given.
//!
//! `cargo run --release -p selenograph-evaluate --example shading -- DATASET [--lights same|cross] [--pairs N] [--items N]
//! [--lit] [--albedo 0.1] [--noise 0.005] [--jpeg 90] [--pose-deg 0.02] [--direction-deg 0.06] [--pose-free] [--sun-deg 0.5] [--options TOML]`
//!
//! Each item goes through the pipeline that `reconstruct` and `evaluate` use, with the true relative pose turned by `--pose-deg`
//! (its baseline by `--direction-deg`), and 30 true matches with 1 px of noise in place of features. The albedo is a smooth field on
//! the ground, the same in all pictures, of `--albedo` as its peak. With `--lit` points of dark pixels are left out, and pe is
//! the mean error of the others in A's picture, as a share of their range. A line per item, then medians and worst.

#![expect(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "a program that prints what it measures, seconds too"
)]

use selenograph_evaluate::dataset_source::{Choice, LightChoice, LoadedPair, Source};
use selenograph_evaluate::pair_metrics::{PreparedTruth, Promise, Settings};
use selenograph_geometry::{Point2, Point3, Rigid3, Rotation3, Vector3};
use selenograph_raster::codec::{Picture, jpeg};
use selenograph_reconstruct::Fill;
use selenograph_reconstruct::View;
use selenograph_reconstruct::matches_file::GivenMatches;
use selenograph_reconstruct::matching::Match;
use selenograph_reconstruct::pipeline::{Incomplete, Input, Method, Options, Wanted, reconstruct};
use selenograph_reconstruct::priors::{KnownPose, KnownSun, Priors, SunAxes};
use selenograph_reconstruct::shading::{PoseSigma, Shaded, ShadingOptions};
use selenograph_reconstruct::stereo::{Completion, StereoOptions};
use std::path::Path;
use std::time::Instant;

/// Numbers of an item.
const NUMBERS: usize = 14;

type Failure = Box<dyn std::error::Error>;

/// What is done to the pictures and to what is known.
#[derive(Debug, Default)]
struct Disturbed {
    albedo: f64,
    waves: f64,
    noise: f64,
    jpeg: Option<u8>,
    pose_deg: f64,
    direction_deg: Option<f64>,
    pose_free: bool,
    lit: bool,
    sun_deg: f64,
}

/// Numbers of a seed, uniform in [0, 1): splitmix64.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }

    fn axis(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()).normalize()
    }
}

impl Disturbed {
    /// The pictures with albedo, noise and compression.
    fn pictures(&self, pair: &LoadedPair, mut views: [View; 2], seed: u64) -> Result<[View; 2], Failure> {
        let mut random = Random(seed);
        let truth = &pair.truth;
        let extent = {
            let camera = &truth.views[0].camera;
            truth.views[0].median_depth_z_m().unwrap_or(1.0) * camera.width as f64 / camera.fx
        };
        let waves: Vec<(Vector3<f64>, f64)> = (0..12)
            .map(|_| {
                let k = Vector3::new(random.normal(), random.normal(), random.normal());
                (
                    k * std::f64::consts::TAU * self.waves / extent / 1.4,
                    std::f64::consts::TAU * random.uniform(),
                )
            })
            .collect();
        let field = |p: &Vector3<f64>| {
            let sum: f64 = waves.iter().map(|(k, phase)| (p.dot(k) + phase).sin()).sum();
            (sum / 6f64.sqrt() / 2.0 * self.albedo).exp()
        };
        for (view, truth) in views.iter_mut().zip(&truth.views) {
            if self.albedo > 0.0 {
                let points = truth.points_in_cam();
                for (grey, point) in view.image.data.iter_mut().zip(&points.data) {
                    let point = truth.world_from_cam.point(&point.coords.into());
                    *grey *= field(&point.coords) as f32;
                }
            }
            for grey in &mut view.image.data {
                *grey = (*grey + (self.noise * random.normal()) as f32).clamp(0.0, 1.0);
            }
            if let Some(quality) = self.jpeg {
                let mut sorted: Vec<f32> = view.image.data.clone();
                sorted.sort_by(f32::total_cmp);
                let stretch = 0.98 / sorted[sorted.len() * 999 / 1000];
                let grey8 = view.image.map(|v| (v * stretch * 255.0 + 0.5).clamp(0.0, 255.0) as u8);
                let bytes = jpeg::encode_grey_as_rgb(&grey8, quality)?;
                view.image = match jpeg::decode(&bytes, Path::new("disturbed.jpg"))? {
                    Picture::Grey8(grey) => grey.map(|v| f32::from(*v) / (255.0 * stretch)),
                    Picture::Rgb8(rgb) => rgb.map(|v| f32::from(v[0]) / (255.0 * stretch)),
                    Picture::Grey16(grey) => grey.map(|v| f32::from(*v) / (65535.0 * stretch)),
                };
            }
        }
        Ok(views)
    }
}

/// The middle one and the worst.
fn told(name: &str, values: &[f64], worst: fn(f64, f64) -> f64) -> String {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN);
    format!("{name} {median:.5} ({:.5})", values.iter().copied().reduce(worst).unwrap_or(f64::NAN))
}

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let mut choice = Choice::default();
    let mut disturbed = Disturbed { waves: 4.0, ..Disturbed::default() };
    let (mut items, mut root, mut shading) = (usize::MAX, None, ShadingOptions::default());
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--lights" => {
                choice.lights = match value()?.as_str() {
                    "same" => LightChoice::Same,
                    _ => LightChoice::Cross,
                }
            }
            "--pairs" => choice.limit = Some(value()?.parse()?),
            "--items" => items = value()?.parse()?,
            "--albedo" => disturbed.albedo = value()?.parse()?,
            "--waves" => disturbed.waves = value()?.parse()?,
            "--noise" => disturbed.noise = value()?.parse()?,
            "--jpeg" => disturbed.jpeg = Some(value()?.parse()?),
            "--pose-deg" => disturbed.pose_deg = value()?.parse()?,
            "--direction-deg" => disturbed.direction_deg = Some(value()?.parse()?),
            "--lit" => disturbed.lit = true,
            "--pose-free" => disturbed.pose_free = true,
            "--sun-deg" => disturbed.sun_deg = value()?.parse()?,
            "--options" => shading = toml::from_str(&value()?.replace(';', "\n"))?,
            _ => root = Some(argument),
        }
    }
    let root = root.ok_or("which dataset?")?;
    let source = Source::open(Path::new(&root), &choice)?;
    let methods: &[Method] =
        if choice.lights == LightChoice::Same { &[Method::Stereo, Method::Fused] } else { &[Method::Fused] };
    let mut rows: Vec<Vec<[f64; NUMBERS]>> = vec![Vec::new(); methods.len()];
    for (number, entry) in source.entries.iter().enumerate() {
        let pair = LoadedPair::read(entry, &source.pixels)?;
        let truth = PreparedTruth::new(&pair.truth, &Settings::default())?;
        for (of_pair, item) in pair.items(&entry.lights).into_iter().enumerate() {
            if of_pair >= items {
                break;
            }
            let lights = [item.light_a, item.light_b];
            let seed = (number * 100 + of_pair) as u64 + 1;
            let Some(views) = pair.views(lights) else { continue };
            let views = disturbed.pictures(&pair, views, seed)?;
            for (rows, method) in rows.iter_mut().zip(methods) {
                let row = measure(&pair, &truth, &views, lights, *method, &disturbed, &shading, seed)?;
                println!(
                    "{} {}.{} {:<6} ratio {:.4} full {:.4} pe {:.5} full {:.5} sc {:.4} mae {:.2} z {:.2}/{:.2} rta {:.2} {:.1} s within {:.0}/{:.0} {:.0}/{:.0}",
                    item.pair,
                    lights[0],
                    lights[1],
                    method.as_str(),
                    row[0],
                    row[1],
                    row[2],
                    row[3],
                    row[4],
                    row[5],
                    row[6],
                    row[7],
                    row[8],
                    row[9],
                    row[10],
                    row[11],
                    row[12],
                    row[13]
                );
                rows.push(row);
            }
        }
    }
    for (rows, method) in rows.iter().zip(methods) {
        let of = |k: usize| -> Vec<f64> { rows.iter().map(|row| row[k]).collect() };
        println!(
            "== {} {} items | {} | {} | {} | {} | {} | {} | {} | z {} {} | {} | within 1 and 2 sigma: {} {} slope {} {} | {}",
            method.as_str(),
            rows.len(),
            told("ratio", &of(0), f64::max),
            told("full", &of(1), f64::max),
            told("pe", &of(2), f64::max),
            told("full pe", &of(3), f64::max),
            told("sc", &of(4), f64::min),
            told("mae", &of(5), f64::max),
            told("rta", &of(8), f64::max),
            told("mean abs", &of(6), f64::max),
            told("rms", &of(7), f64::max),
            told("s", &of(9), f64::max),
            told("%", &of(10), f64::min),
            told("%", &of(11), f64::min),
            told("%", &of(12), f64::min),
            told("%", &of(13), f64::min),
            format_args!(
                "ratio ≤ .03: {}, ≤ .1: {}, ≤ .25: {}",
                within(rows, 0.03),
                within(rows, 0.1),
                within(rows, 0.25)
            ),
        );
    }
    Ok(())
}

/// Shares of the cells whose error lies within one and two sigmas, of the height and of the slope's tangent at the steepest, on
/// ground that both pictures show; the heights are compared as they are, without any alignment.
fn within_sigma(shaded: &Shaded, pair: &LoadedPair) -> [f64; 4] {
    let (patch, scene) = (&shaded.patch, pair.truth.cam_b_from_cam_a().origin().coords.norm());
    let view = &pair.truth.views[0];
    let points = view.points_in_cam();
    let truth_at = |x: usize, y: usize| -> Option<f64> {
        let mut height = shaded.heights[(x, y)];
        for _ in 0..4 {
            let at = patch.point_of([x as f32 + 0.5, y as f32 + 0.5, height]);
            let pixel = view.camera.project(&at.into())?;
            let (i, j) = (pixel.x - 0.5, pixel.y - 0.5);
            let inside =
                i >= 0.0 && j >= 0.0 && i < points.width as f64 - 1.0 && j < points.height as f64 - 1.0;
            if !inside {
                return None;
            }
            let (left, top) = (i as usize, j as usize);
            let (fx, fy) = (i - left as f64, j - top as f64);
            let p = |dx: usize, dy: usize| points[(left + dx, top + dy)].coords / scene;
            let upper = p(0, 0) * (1.0 - fx) + p(1, 0) * fx;
            let lower = p(0, 1) * (1.0 - fx) + p(1, 1) * fx;
            height = patch.position(&(upper * (1.0 - fy) + lower * fy))[2] as f32;
        }
        height.is_finite().then_some(f64::from(height))
    };
    let (width, height) = (patch.width, patch.height);
    let truth: Vec<Option<f64>> = (0..width * height).map(|at| truth_at(at % width, at / width)).collect();
    let error = |x: usize, y: usize| Some(f64::from(shaded.heights[(x, y)]) - truth[y * width + x]?);
    let slope = |x: usize, y: usize| {
        let (h, at) = (&shaded.heights, |x: usize, y: usize| error(x, y));
        let (u, v) = (h[(x + 1, y)] - h[(x - 1, y)], h[(x, y + 1)] - h[(x, y - 1)]);
        let off = [at(x + 1, y)? - at(x - 1, y)?, at(x, y + 1)? - at(x, y - 1)?].map(|d| 0.5 * d);
        let length = f64::from(u.hypot(v)).max(1e-9);
        Some((off[0] * f64::from(u) + off[1] * f64::from(v)) / length)
    };
    let (mut heights, mut slopes) = (Vec::new(), Vec::new());
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            if shaded.num_seen[(x, y)] < 2 {
                continue;
            }
            if let (Some(off), Some(slope)) = (error(x, y), slope(x, y)) {
                heights.push(off / f64::from(shaded.height_sigma[(x, y)]));
                slopes.push(slope / f64::from(shaded.slope_sigma[(x, y)]));
            }
        }
    }
    let share = |z: &[f64], limit: f64| {
        100.0 * z.iter().filter(|z| z.abs() <= limit).count() as f64 / z.len().max(1) as f64
    };
    [share(&heights, 1.0), share(&heights, 2.0), share(&slopes, 1.0), share(&slopes, 2.0)]
}

fn within(rows: &[[f64; NUMBERS]], limit: f64) -> usize {
    rows.iter().filter(|row| row[0] <= limit).count()
}

#[allow(clippy::too_many_arguments)]
fn measure(
    pair: &LoadedPair,
    truth: &PreparedTruth,
    views: &[View; 2],
    lights: [u64; 2],
    method: Method,
    disturbed: &Disturbed,
    shading: &ShadingOptions,
    seed: u64,
) -> Result<[f64; NUMBERS], Failure> {
    let mut random = Random(seed ^ 0xABCD);
    let right = pair.truth.cam_b_from_cam_a();
    let scene = right.origin().coords.norm();
    let turn = Rotation3::new(random.axis() * disturbed.pose_deg.to_radians());
    let rotation = turn * Rotation3::from_matrix(&right.rotation());
    let t = turn * right.origin().coords / scene;
    let direction_deg = disturbed.direction_deg.unwrap_or(3.0 * disturbed.pose_deg);
    let bent = Rotation3::new(t.cross(&random.axis()).normalize() * direction_deg.to_radians()) * t;
    let pose = Rigid3::new(rotation, bent.into());
    let suns = pair.suns_in_cams(lights).map(|sun| {
        let tilted = sun.map(|sun| {
            Rotation3::new(sun.cross(&random.axis()).normalize() * disturbed.sun_deg.to_radians()) * sun
        });
        tilted.map(|direction| KnownSun {
            direction,
            axes: SunAxes::Own,
            sigma_rad: disturbed.sun_deg.to_radians(),
        })
    });
    let priors = Priors {
        cam_b_from_cam_a: Some(KnownPose { cam_b_from_cam_a: pose, metric: false }),
        pose_sigma: disturbed.pose_free.then(|| PoseSigma {
            turn_rad: disturbed.pose_deg.max(0.02).to_radians(),
            direction_rad: direction_deg.max(0.06).to_radians(),
        }),
        suns,
        ..Priors::default()
    };
    let [a, b] = &pair.truth.views;
    let points = a.points_in_cam();
    let seen = |x: usize, y: usize| {
        let in_b = right.point(&points[(x, y)].coords.into());
        let at = b.camera.project(&in_b.coords.into())?;
        let inside = at.x > 1.0
            && at.y > 1.0
            && at.x < b.camera.width as f64 - 1.0
            && at.y < b.camera.height as f64 - 1.0;
        inside.then_some(at)
    };
    let mut matches = Vec::new();
    for _ in 0..20_000 {
        let x = (random.uniform() * a.camera.width as f64) as usize;
        let y = (random.uniform() * a.camera.height as f64) as usize;
        let Some(at) = seen(x, y) else { continue };
        if matches.len() < 30 {
            let noisy = Point2::new(at.x + random.normal(), at.y + random.normal());
            matches.push(Match { a: Point2::new(x as f64 + 0.5, y as f64 + 0.5), b: noisy, score: 1.0 });
        }
    }
    let matches = GivenMatches::new(matches);
    let options = Options {
        method,
        wanted: Wanted::Points,
        incomplete: Incomplete::Keep,
        stereo: StereoOptions { completion: Completion::Everywhere, ..StereoOptions::default() },
        shading: shading.clone(),
        ..Options::default()
    };
    let input = Input { views: views.each_ref(), learned: None, matches: Some(&matches) };
    let start = Instant::now();
    let mut answer = reconstruct(&input, &priors, &options, |_| {})?;
    let seconds = start.elapsed().as_secs_f64();
    for warning in &answer.warnings {
        let text = warning.to_string();
        if text.contains("shading") {
            println!("  {text}");
        }
    }
    let shares = answer.shading.used().map_or([f64::NAN; 4], |used| within_sigma(&used.shaded, pair));
    if let (true, Some(predicted)) = (disturbed.lit, &mut answer.prediction.views) {
        for (predicted, view) in predicted.iter_mut().zip(views) {
            let mean = view.image.data.iter().sum::<f32>() / view.image.data.len() as f32;
            for (at, _) in view.image.data.iter().enumerate().filter(|(_, grey)| **grey < 0.1 * mean) {
                predicted.points.data[at] = [f32::NAN; 3];
                predicted.fill.data[at] = Fill::Absent;
            }
        }
    }
    let of_lit = answer.prediction.views.as_ref().filter(|_| disturbed.lit).map(|[view, _]| {
        let errors = view.points.data.iter().zip(&points.data).filter(|(p, _)| p[2].is_finite());
        let share = |(p, t): (&[f32; 3], &Point3<f64>)| {
            (Vector3::from(p.map(f64::from)) * scene - t.coords).norm() / t.coords.norm()
        };
        let errors: Vec<f64> = errors.map(share).filter(|e| e.is_finite()).collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    });
    let measured = truth.measure(&answer.prediction, Promise::Points)?;
    let (near, whole) = (&measured.overlap.numbers, &measured.full.numbers);
    let of = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let pe = |numbers: &selenograph_evaluate::pair_metrics::RegionNumbers| {
        // An answer that fails counts with the plane's error.
        let plane = of(numbers.point_error_plane_rel);
        (numbers.point_error_rel.unwrap_or(plane), plane)
    };
    let ((near_error, near_plane), (whole_error, whole_plane)) = (pe(near), pe(whole));
    Ok([
        near_error / near_plane,
        whole_error / whole_plane,
        of_lit.unwrap_or(near_error),
        whole_error,
        near.slope_corr_true.unwrap_or(0.0),
        of(near.slope_mae_deg),
        of(near.sigma_z_mean_abs),
        of(near.sigma_z_rms),
        of(measured.numbers.rta_deg),
        seconds,
        shares[0],
        shares[1],
        shares[2],
        shares[3],
    ])
}
