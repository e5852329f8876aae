//! Dense stereo on pairs with truth: point error, coverage and slope of every pair and light, for choosing settings.
//!
//! `cargo run --release -p selenograph-evaluate --example stereo_eval -- samples|own FOLDER [key=value …]`. Keys: `pairs=0,6` and
//! `lights=0,2` select, `out=DIR` writes pictures, `every=N`; the others are settings of dense stereo. Seeds are drawn from the truth with 0.3 px of noise.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::expect_used,
    reason = "an experiment, run by hand"
)]

use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use selenograph_dataset::import::{StereoPair, selenograph, stereolunar};
use selenograph_geometry::{CamA, CamB, PixelConvention, Point2, Point3, Rigid3, pixel};
use selenograph_raster::{Raster, codec::png, resample};
use selenograph_reconstruct::stereo::{self, Dense, Seed, StereoOptions};
use selenograph_reconstruct::{Fill, View, relative_pose};
use std::path::{Path, PathBuf};
use std::time::Instant;

struct Args {
    pairs: Vec<u64>,
    lights: Vec<usize>,
    out: Option<PathBuf>,
    serial: bool,
    estimated: bool,
    options: StereoOptions,
}

fn main() {
    let mut words = std::env::args().skip(1);
    let (kind, folder) = (words.next().unwrap(), PathBuf::from(words.next().unwrap()));
    let mut args = Args {
        pairs: vec![],
        lights: vec![0, 1, 2],
        out: None,
        serial: false,
        estimated: false,
        options: StereoOptions::default(),
    };
    let mut settings = toml::Table::try_from(&args.options).unwrap();
    for word in words {
        let (key, value) = word.split_once('=').unwrap();
        match key {
            "pairs" => args.pairs = value.split(',').map(|v| v.parse().unwrap()).collect(),
            "lights" => args.lights = value.split(',').map(|v| v.parse().unwrap()).collect(),
            "out" => args.out = Some(value.into()),
            "pose" => args.estimated = value == "sift",
            "serial" => args.serial = value == "1",
            _ => {
                let old = settings.get(key).unwrap_or_else(|| panic!("no setting {key}"));
                let new = match old {
                    toml::Value::Float(_) => toml::Value::Float(value.parse().unwrap()),
                    toml::Value::Integer(_) => toml::Value::Integer(value.parse().unwrap()),
                    toml::Value::Boolean(_) => toml::Value::Boolean(value.parse().unwrap()),
                    _ => toml::Value::String(value.into()),
                };
                settings.insert(key.into(), new);
            }
        }
    }
    args.options = settings.try_into().unwrap();
    let mut tasks: Vec<(String, StereoPair, usize)> = vec![];
    for (name, pair) in read(&kind, &folder, &args.pairs) {
        for &light in &args.lights {
            tasks.push((name.clone(), pair.clone(), light));
        }
    }
    let rows: Vec<Row> = if args.serial {
        tasks.iter().map(|(name, pair, light)| one(name, pair, *light, &args)).collect()
    } else {
        tasks.par_iter().map(|(name, pair, light)| one(name, pair, *light, &args)).collect()
    };
    print(&rows);
}

fn read(kind: &str, folder: &Path, pairs: &[u64]) -> Vec<(String, StereoPair)> {
    let mut out = vec![];
    if kind == "samples" {
        for name in ["nadir_1", "oblique_1", "dynamic_1"] {
            for pair in stereolunar::scan(&folder.join(name)).unwrap() {
                let (pair, _) = stereolunar::read_pair(&pair, PixelConvention::Corner).unwrap();
                out.push((name.split('_').next().unwrap().to_owned(), pair));
            }
        }
        return out;
    }
    for shard in std::fs::read_dir(folder.join("pairs")).unwrap() {
        for entry in std::fs::read_dir(shard.unwrap().path()).unwrap() {
            let path = entry.unwrap().path();
            let id: u64 = path.file_name().unwrap().to_str().unwrap().parse().unwrap();
            if pairs.is_empty() || pairs.contains(&id) {
                let (pair, record) = selenograph::read_pair(&path).unwrap();
                out.push((record.trajectory.map_or("other", |t| t.as_str()).to_owned(), pair));
            }
        }
    }
    out.sort_by_key(|(_, pair)| pair.pair_id);
    out
}

struct Row {
    name: String,
    pair_id: u64,
    light: usize,
    error: f64,
    answered_error: f64,
    coverage: f64,
    slope: f64,
    seconds: f64,
    reliability: [f64; 3],
    no_shadow_error: f64,
}

struct Truth {
    points: Vec<Option<Point3<f64>>>,
    co_visible: Vec<bool>,
    median_z: f64,
}

fn truth(pair: &StereoPair) -> Truth {
    let [a, b] = &pair.views;
    let to_b = b.world_from_cam.inverse();
    let width = a.depth_z.width;
    let mut points = vec![];
    let mut co_visible = vec![];
    let mut zs = vec![];
    for (at, &z) in a.depth_z.data.iter().enumerate() {
        let p = Point2::new(pixel::center_of(at % width), pixel::center_of(at / width));
        let point = if z.is_finite() { a.camera.unproject(&p, f64::from(z)) } else { None };
        let world = point.map(|x| a.world_from_cam.point(&x));
        let seen = world.is_some_and(|w| {
            let x = to_b.point(&w);
            b.camera
                .project(&x)
                .and_then(|q| resample::bilinear(&b.depth_z, q.x, q.y))
                .is_some_and(|found| (found / x.z - 1.0).abs() <= 0.005)
        });
        if z.is_finite() {
            zs.push(f64::from(z));
        }
        points.push(world);
        co_visible.push(seen);
    }
    zs.sort_by(f64::total_cmp);
    Truth { points, co_visible, median_z: zs[zs.len() / 2] }
}

fn seeds(pair: &StereoPair, truth: &Truth, light: usize) -> Vec<Seed> {
    let [a, b] = &pair.views;
    let to_b = b.world_from_cam.inverse();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(pair.pair_id * 3 + light as u64);
    let mut out = vec![];
    for (at, &seen) in truth.co_visible.iter().enumerate() {
        let lit = a.images[light].data[at] > 15;
        if !seen || !lit || rng.random::<f64>() > 500.0 / 262_144.0 {
            continue;
        }
        let width = a.depth_z.width;
        let mut noise = || (0..4).map(|_| rng.random::<f64>() - 0.5).sum::<f64>() * 0.5;
        let p = Point2::new(pixel::center_of(at % width), pixel::center_of(at / width));
        let q = b.camera.project(&to_b.point(&truth.points[at].unwrap())).unwrap();
        out.push(Seed { a: p, b: Point2::new(q.x + noise(), q.y + noise()) });
    }
    out
}

fn view(pair: &StereoPair, idx: usize, light: usize) -> View {
    let v = &pair.views[idx];
    View { image: v.images[light].map(|&g| f32::from(g) / 255.0), camera: v.camera.clone() }
}

fn one(name: &str, pair: &StereoPair, light: usize, args: &Args) -> Row {
    let truth = truth(pair);
    let [a, b] = &pair.views;
    let b_from_a: Rigid3<CamB, CamA> = (&b.world_from_cam.inverse() * &a.world_from_cam).relabel();
    let length = b_from_a.origin().coords.norm();
    let unit = Rigid3::from_matrix(&b_from_a.rotation(), b_from_a.origin() / length).unwrap();
    let seeds = seeds(pair, &truth, light);
    let views = [view(pair, 0, light), view(pair, 1, light)];
    let (unit, seeds) = if args.estimated {
        let found = relative_pose::sift(&views[0], &views[1], &Default::default()).unwrap();
        let inliers = found.matches.iter().filter(|m| m.inlier);
        (found.pose.cam_b_from_cam_a, inliers.map(|m| Seed { a: m.a, b: m.b }).collect())
    } else {
        (unit, seeds)
    };
    let start = Instant::now();
    let dense = stereo::dense(&views[0], &views[1], &unit, &seeds, &args.options).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    score(name, pair, light, &truth, &dense, seconds, args)
}

/// Similarity by Umeyama: `to ≈ s R from + t`.
fn umeyama(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> (f64, Matrix3<f64>, Vector3<f64>) {
    let n = pairs.len() as f64;
    let (mf, mt) =
        pairs.iter().fold((Vector3::zeros(), Vector3::zeros()), |(f, t), (a, b)| (f + a / n, t + b / n));
    let mut cov = Matrix3::zeros();
    let mut var = 0.0;
    for (a, b) in pairs {
        cov += (b - mt) * (a - mf).transpose() / n;
        var += (a - mf).norm_squared() / n;
    }
    let svd = cov.svd(true, true);
    let (u, vt) = (svd.u.unwrap(), svd.v_t.unwrap());
    let sign = (u * vt).determinant().signum();
    let d = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
    let r = u * d * vt;
    let s = (svd.singular_values[0] + svd.singular_values[1] + sign * svd.singular_values[2]) / var;
    (s, r, mt - s * r * mf)
}

fn align(mut pairs: Vec<(Vector3<f64>, Vector3<f64>)>) -> (f64, Matrix3<f64>, Vector3<f64>) {
    let all = pairs.clone();
    for _ in 0..5 {
        let (s, r, t) = umeyama(&pairs);
        let errors: Vec<f64> = all.iter().map(|(a, b)| (s * r * a + t - b).norm()).collect();
        let mut sorted = errors.clone();
        sorted.sort_by(f64::total_cmp);
        let limit = 3.0 * sorted[sorted.len() / 2];
        pairs = all.iter().zip(&errors).filter(|(_, e)| **e <= limit).map(|(p, _)| *p).collect();
    }
    umeyama(&pairs)
}

fn score(
    name: &str,
    pair: &StereoPair,
    light: usize,
    truth: &Truth,
    dense: &Dense,
    seconds: f64,
    args: &Args,
) -> Row {
    let a = &pair.views[0];
    let (width, height) = (a.depth_z.width, a.depth_z.height);
    let answer = &dense.views[0];
    let predicted: Vec<Option<Vector3<f64>>> = (0..width * height)
        .map(|at| {
            let z = f64::from(answer.depth_z.data[at]);
            let p = Point2::new(pixel::center_of(at % width), pixel::center_of(at / width));
            if z.is_finite() { Some(a.camera.unproject(&p, z)?.coords) } else { None }
        })
        .collect();
    let pairs = (0..width * height)
        .filter(|&at| truth.co_visible[at])
        .filter_map(|at| Some((predicted[at]?, truth.points[at]?.coords)))
        .collect();
    let (s, r, t) = align(pairs);
    // The plane fitted to the truth: inverse depth affine in pixels.
    let plane_error = plane_errors(pair, truth);
    let (mut sum, mut count, mut answered, mut answered_sum) = (0.0, 0.0, 0.0, 0.0);
    let (mut lit_sum, mut lit_count) = (0.0, 0.0);
    let mut errors = Raster::filled(width, height, f32::NAN);
    let mut within = [0.0; 3];
    let (mut pred_z, mut true_z) =
        (Raster::filled(width, height, f32::NAN), Raster::filled(width, height, f32::NAN));
    let base = truth.points.iter().flatten().next().unwrap().z;
    for at in 0..width * height {
        if let Some(p) = truth.points[at] {
            true_z.data[at] = (p.z - base) as f32;
        }
        let aligned = predicted[at].map(|p| s * r * p + t);
        if let Some(p) = aligned {
            pred_z.data[at] = (p.z - base) as f32;
        }
        if !truth.co_visible[at] {
            continue;
        }
        count += 1.0;
        let true_point = truth.points[at].unwrap().coords;
        let error = aligned.map_or(plane_error[at], |p| (p - true_point).norm());
        sum += error;
        if a.images[light].data[at] > 15 {
            lit_sum += error;
            lit_count += 1.0;
        }
        if let Some(p) = aligned {
            let along = (r.transpose() * (p - true_point)).z;
            errors.data[at] = along as f32;
            let normalised = along.abs() / (s * f64::from(answer.sigma_z.data[at]));
            for (n, w) in within.iter_mut().enumerate() {
                *w += f64::from(u8::from(normalised < (n + 1) as f64));
            }
        }
        if aligned.is_some() && answer.fill.data[at] == Fill::Measured {
            answered += 1.0;
            answered_sum += error;
        }
    }
    let footprint = truth.median_z / a.camera.fx;
    let slope = slope_correlation(&pred_z, &true_z, &truth.co_visible, footprint);
    if let Some(out) = &args.out {
        pictures(
            out,
            &format!("{name}{}_{light}", pair.pair_id),
            &pred_z,
            &true_z,
            &errors,
            truth,
            footprint,
            &views_grey(pair, light),
            answer,
        );
    }
    Row {
        name: name.to_owned(),
        pair_id: pair.pair_id,
        light,
        error: sum / count / truth.median_z,
        answered_error: answered_sum / answered / truth.median_z,
        coverage: answered / count,
        slope,
        seconds,
        reliability: within.map(|w| w / answered.max(1.0)),
        no_shadow_error: lit_sum / lit_count / truth.median_z,
    }
}

fn views_grey(pair: &StereoPair, light: usize) -> Raster<u8> {
    pair.views[0].images[light].clone()
}

fn plane_errors(pair: &StereoPair, truth: &Truth) -> Vec<f64> {
    let points: Vec<Vector3<f64>> = (0..truth.points.len())
        .filter(|&at| truth.co_visible[at])
        .map(|at| truth.points[at].unwrap().coords)
        .collect();
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let cov: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let eigen = cov.symmetric_eigen();
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let eye = pair.views[0].world_from_cam.origin().coords;
    truth
        .points
        .iter()
        .map(|p| {
            p.map_or(0.0, |p| {
                let ray = p.coords - eye;
                let k = (mean - eye).dot(&normal) / ray.dot(&normal);
                (eye + k * ray - p.coords).norm()
            })
        })
        .collect()
}

/// tan of the slope, as `|Sobel| / 8`, borders mirrored as SciPy does.
fn sobel(z: &Raster<f32>, footprint: f64) -> Raster<f32> {
    let (w, h) = (z.width as i64, z.height as i64);
    let get = |x: i64, y: i64| f64::from(z[(x.clamp(0, w - 1) as usize, y.clamp(0, h - 1) as usize)]);
    Raster::from_fn(z.width, z.height, |x, y| {
        let (x, y) = (x as i64, y as i64);
        let mut g = [0.0; 2];
        for (k, s) in [(-1, 1.0), (0, 2.0), (1, 1.0)] {
            g[0] += s * (get(x + 1, y + k) - get(x - 1, y + k));
            g[1] += s * (get(x + k, y + 1) - get(x + k, y - 1));
        }
        (g[0].hypot(g[1]) / (8.0 * footprint)).atan() as f32
    })
}

fn slope_correlation(pred: &Raster<f32>, truth: &Raster<f32>, mask: &[bool], footprint: f64) -> f64 {
    let (w, h) = (pred.width, pred.height);
    let (sp, st) = (sobel(pred, footprint), sobel(truth, footprint));
    let keep = |x: usize, y: usize| mask[y * w + x] && pred[(x, y)].is_finite() && truth[(x, y)].is_finite();
    let (mut n, mut sx, mut sy, mut sxx, mut syy, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let ok = Raster::from_fn(w, h, keep);
    for y in 4..h - 4 {
        for x in 4..w - 4 {
            // Erosion by a cross, four times: a diamond.
            let inside = (-4i64..=4).all(|dy| {
                let r = 4 - dy.abs();
                (-r..=r).all(|dx| ok[((x as i64 + dx) as usize, (y as i64 + dy) as usize)])
            });
            if inside {
                let (a, b) = (f64::from(sp[(x, y)]), f64::from(st[(x, y)]));
                n += 1.0;
                sx += a;
                sy += b;
                sxx += a * a;
                syy += b * b;
                sxy += a * b;
            }
        }
    }
    (n * sxy - sx * sy) / ((n * sxx - sx * sx) * (n * syy - sy * sy)).sqrt()
}

fn pictures(
    out: &Path,
    name: &str,
    pred: &Raster<f32>,
    truth: &Raster<f32>,
    errors: &Raster<f32>,
    t: &Truth,
    footprint: f64,
    grey: &Raster<u8>,
    answer: &stereo::DenseView,
) {
    std::fs::create_dir_all(out).unwrap();
    let (w, h) = (pred.width, pred.height);
    let shade = |z: &Raster<f32>| {
        Raster::from_fn(w, h, |x, y| {
            let get = |x: usize, y: usize| f64::from(z[(x.min(w - 1), y.min(h - 1))]);
            let (dx, dy) = (
                (get(x + 1, y) - get(x.saturating_sub(1), y)) / (2.0 * footprint),
                (get(x, y + 1) - get(x, y.saturating_sub(1))) / (2.0 * footprint),
            );
            let v = (0.5 + (dx + dy) * 0.6) * 255.0;
            if v.is_finite() { v.clamp(0.0, 255.0) as u8 } else { 0 }
        })
    };
    let (p, q) = (shade(pred), shade(truth));
    let span = 0.004 * t.median_z;
    let sheet = Raster::from_fn(2 * w, 2 * h, |x, y| {
        let (cx, cy) = (x % w, y % h);
        match (x / w, y / h) {
            (0, 0) => [q[(cx, cy)]; 3],
            (1, 0) => [p[(cx, cy)]; 3],
            (0, _) => [grey[(cx, cy)]; 3],
            _ => {
                let e = f64::from(errors[(cx, cy)]) / span;
                if !t.co_visible[cy * w + cx] {
                    [40, 40, 60]
                } else if e.is_nan() {
                    [255, 0, 255]
                } else {
                    let v = (e.abs().min(1.0) * 255.0) as u8;
                    let base = if answer.fill[(cx, cy)] == Fill::Measured { 0 } else { 90 };
                    if e > 0.0 { [v, base, 0] } else { [0, base, v] }
                }
            }
        }
    });
    std::fs::write(out.join(format!("{name}.png")), png::encode_rgb8(&sheet).unwrap()).unwrap();
}

fn print(rows: &[Row]) {
    println!(
        "{:9} {:>3} l {:>8} {:>8} {:>8} {:>6} {:>6} {:>5}  <1s  <2s  <3s",
        "kind", "id", "err e-4", "answ", "lit", "cover", "slope", "s"
    );
    let line = |tag: &str, rows: &[&Row]| {
        let mean = |f: fn(&Row) -> f64| rows.iter().map(|r| f(r)).sum::<f64>() / rows.len().max(1) as f64;
        println!(
            "{tag:15} {:8.3} {:8.3} {:8.3} {:6.3} {:6.3} {:5.2}  {:.2} {:.2} {:.2}",
            mean(|r| r.error * 1e4),
            mean(|r| r.answered_error * 1e4),
            mean(|r| r.no_shadow_error * 1e4),
            mean(|r| r.coverage),
            mean(|r| r.slope),
            mean(|r| r.seconds),
            mean(|r| r.reliability[0]),
            mean(|r| r.reliability[1]),
            mean(|r| r.reliability[2])
        );
    };
    if rows.len() <= 60 {
        for r in rows {
            line(&format!("{:9} {:3} {}", r.name, r.pair_id, r.light), &[r]);
        }
    }
    for name in ["nadir", "oblique", "dynamic"] {
        let of: Vec<&Row> = rows.iter().filter(|r| r.name == name).collect();
        if !of.is_empty() {
            line(&format!("mean {name}"), &of);
        }
    }
    line("mean all", &rows.iter().collect::<Vec<_>>());
}
