//! The loader's benchmark: CPU seconds per sample, from files and from a campaign flown meanwhile, and where they go.
//!
//! `cargo run --release -p selenograph-dataset --example loader_bench -- [--dataset DIR] [--triplets DIR] [--terrain DIR] [--campaign FILE] [--rays N] [--size PX] [--samples N] [--workers N] [--sheet out.png]`
//!
//! Without `--dataset` and `--triplets` a campaign is flown: over `--terrain`, or over synthetic craters round the south pole
//! (4096² nodes of 20 m). `--campaign` is a TOML file or the name of a preset. Each line is one way of loading; the
//! differences between lines say what a step costs. `--sheet` draws the first samples, A above B.

#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::print_stdout, reason = "a benchmark prints its figures")]

use selenograph_dataset::augment::{Augmentation, Fidelity, Photometric, Windows};
use selenograph_dataset::correspondence::MatchRule;
use selenograph_dataset::loader::{Loader, LoaderOptions, Mixture, Source};
use selenograph_dataset::plan::Campaign;
use selenograph_dataset::sample::TrainingPair;
use selenograph_geometry::{Body, PixelConvention};
use selenograph_raster::Raster;
use selenograph_raster::codec::png;
use selenograph_terrain::synth::{Synth, SynthSettings, south_polar_grid};
use selenograph_terrain::{Layer, Terrain};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

struct Arguments(Vec<String>);

impl Arguments {
    fn value(&self, name: &str) -> Option<&String> {
        self.0.iter().position(|a| a == name).and_then(|k| self.0.get(k + 1))
    }

    fn number(&self, name: &str, default: usize) -> Outcome<usize> {
        Ok(self.value(name).map_or(Ok(default), |v| v.parse())?)
    }
}

fn synthetic() -> Outcome<Terrain> {
    let body = Body::moon();
    let grid = south_polar_grid(body.clone(), 4096, 20.0)?;
    let mut heights = Vec::new();
    Synth::new(grid.clone(), &SynthSettings::default(), None)?.read_rows(0, 4096, &mut heights);
    Ok(Terrain::new(body, vec![Layer::from_heights(grid, heights)?])?)
}

fn campaign(arguments: &Arguments) -> Outcome<Campaign> {
    let mut campaign = match arguments.value("--campaign") {
        Some(path) if Path::new(path).is_file() => Campaign::from_toml(&std::fs::read_to_string(path)?)?,
        Some(preset) => Campaign::preset(preset)?,
        None => {
            let mut campaign = Campaign::preset("paper-iccv2025")?;
            // Low enough for the synthetic cap.
            for levels in [
                &mut campaign.nadir.altitude_levels_m,
                &mut campaign.oblique.altitude_levels_m,
                &mut campaign.dynamic.altitude_levels_m,
            ] {
                *levels = vec![3_500.0, 6_200.0, 9_500.0];
            }
            campaign.sites.lat_deg.max = -88.9;
            campaign.sites.lat_deg.min = -90.0;
            campaign
        }
    };
    campaign.render.rays_per_pixel =
        arguments.number("--rays", campaign.render.rays_per_pixel as usize)? as u32;
    Ok(campaign)
}

/// Ways of loading, from everything to nothing but what it takes.
fn ways() -> [(&'static str, Augmentation, MatchRule, bool); 5] {
    let photometric = Augmentation { photometric: Some(Photometric::default()), ..Augmentation::physical() };
    let window = Augmentation { windows: Windows::Matched, ..Augmentation::default() };
    [
        ("published", Augmentation::published(), MatchRule::Reciprocal, true),
        ("physical", Augmentation::physical(), MatchRule::Seen, true),
        ("physical and photometric", photometric, MatchRule::Seen, true),
        ("window and matches only", window, MatchRule::Reciprocal, true),
        (
            "bare",
            Augmentation { fidelity: Fidelity::Exact, ..Augmentation::default() },
            MatchRule::Reciprocal,
            false,
        ),
    ]
}

fn main() -> Outcome<()> {
    let arguments = Arguments(std::env::args().skip(1).collect());
    let size = arguments.number("--size", 256)?;
    let samples = arguments.number("--samples", 16)?;
    let terrain =
        match (arguments.value("--dataset"), arguments.value("--triplets"), arguments.value("--terrain")) {
            (None, None, None) => Some(Arc::new(synthetic()?)),
            (None, None, Some(folder)) => Some(Arc::new(Terrain::open(Path::new(folder))?)),
            _ => None,
        };
    for (name, augmentation, match_rule, matches) in ways() {
        let source = match (&terrain, arguments.value("--dataset"), arguments.value("--triplets")) {
            (Some(terrain), ..) => Source::flight("flight", campaign(&arguments)?, terrain.clone())?,
            (None, Some(folder), _) => Source::pairs("pairs", Path::new(folder), None)?,
            (None, None, folder) => {
                let folder = PathBuf::from(folder.ok_or("no source")?);
                Source::triplets("triplets", &folder, None, PixelConvention::Corner)?
            }
        };
        let options = LoaderOptions {
            batch_size: 1,
            sizes: vec![[size, size]],
            num_matches: if matches { 8192.min(size * size) } else { 0 },
            match_rule,
            augmentation,
            num_workers: arguments.number("--workers", 2)?,
            // Few samples are made that are not taken.
            queue_batches: 1,
            ..LoaderOptions::default()
        };
        let mixture = Arc::new(Mixture::new(vec![source], options)?);
        let (started, cpu) = (Instant::now(), cpu_seconds()?);
        let mut loader = Loader::start(mixture, 0)?;
        let mut pairs = Vec::new();
        let mut replaced = 0;
        for _ in 0..samples {
            let batch = loader.next_batch()?;
            replaced += batch.replaced.len();
            pairs.extend(batch.pairs);
        }
        let made = (cpu_seconds()? - cpu) / samples as f64;
        let rate = samples as f64 / started.elapsed().as_secs_f64();
        println!(
            "{name}: cpu_s_per_sample={made:.4} samples_per_s={rate:.2} replaced={replaced} waits={}",
            loader.num_waits()
        );
        if let Some(path) = arguments.value("--sheet") {
            let path = PathBuf::from(path).with_extension(format!("{}.png", name.replace(' ', "-")));
            std::fs::write(path, png::encode_rgb8(&sheet(&pairs[..pairs.len().min(6)]))?)?;
        }
    }
    Ok(())
}

/// CPU time of the process; what the workers made beyond the samples taken is in it.
fn cpu_seconds() -> Outcome<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    // User and system time, in hundredths of a second.
    Ok((fields[11].parse::<f64>()? + fields[12].parse::<f64>()?) / 100.0)
}

/// Pairs side by side, A above B, some matches marked by the same colour in both.
fn sheet(pairs: &[TrainingPair]) -> Raster<[u8; 3]> {
    let (w, h) = (pairs[0].views[0].rgb.width, pairs[0].views[0].rgb.height);
    let mut sheet =
        Raster::from_fn(pairs.len() * w, 2 * h, |x, y| pairs[x / w].views[y / h].rgb[(x % w, y % h)]);
    for (n, pair) in pairs.iter().enumerate() {
        let valid = pair.matches.valid.iter().filter(|valid| **valid).count();
        for k in (0..valid).step_by((valid / 12).max(1)) {
            let colour = [(k * 97 % 256) as u8, (k * 57 % 256) as u8 | 128, (k * 31 % 256) as u8];
            for (view, [x, y]) in [pair.matches.a[k], pair.matches.b[k]].into_iter().enumerate() {
                for (dx, dy) in (0..5).flat_map(|dx| (0..5).map(move |dy| (dx, dy))) {
                    let (x, y) = (
                        (x as usize + dx).saturating_sub(2).min(w - 1),
                        (y as usize + dy).saturating_sub(2).min(h - 1),
                    );
                    sheet[(n * w + x, view * h + y)] = colour;
                }
            }
        }
    }
    sheet
}
