//! Medians of time and error of the relative pose on simulated scenes, and the scenes themselves for other programs:
//! `RAYON_NUM_THREADS=1 cargo run --release -p selenograph-pose --example pose_bench [-- scenes.jsonl]`, then
//! `python crates/pose/testdata/compare.py scenes.jsonl`.
#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::print_stdout, reason = "an example's result is what it prints")]

use selenograph_pose::problems::{Scene, SceneKind};
use selenograph_pose::relative::{Order, Refinement, RelativeOptions, estimate};
use std::io::Write;
use std::time::Instant;

const FOCAL: f64 = 618.0;
const TRIALS: u64 = 40;
const MATCHES: usize = 2000;
const REPEATS: usize = 5;

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Scenes of one kind: their name, kind, share of outliers, and whether coordinates are whole pixels (else normal noise of 0.3 px).
struct Case {
    name: &'static str,
    kind: SceneKind,
    outliers: f64,
    whole_pixels: bool,
}

impl Case {
    fn scene(&self, seed: u64) -> Scene {
        let scene = Scene::new(&self.kind, MATCHES, seed).with_outliers(self.outliers);
        if self.whole_pixels { scene.with_rounding(1.0 / FOCAL) } else { scene.with_noise(0.3 / FOCAL) }
    }
}

fn cases() -> [Case; 5] {
    let nadir = SceneKind::Nadir { relief_parallax: 0.9 / FOCAL };
    [
        Case { name: "general30", kind: SceneKind::General, outliers: 0.3, whole_pixels: false },
        Case { name: "general60", kind: SceneKind::General, outliers: 0.6, whole_pixels: false },
        Case { name: "nadir0_rounded", kind: nadir, outliers: 0.0, whole_pixels: true },
        Case { name: "nadir30", kind: nadir, outliers: 0.3, whole_pixels: false },
        Case { name: "planar30", kind: SceneKind::Planar, outliers: 0.3, whole_pixels: false },
    ]
}

fn write_scenes(path: &str) -> std::io::Result<()> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    for case in cases() {
        for seed in 0..TRIALS {
            let scene = case.scene(seed);
            let rows: Vec<[f64; 4]> = scene.matches.iter().map(|m| [m.a.x, m.a.y, m.b.x, m.b.y]).collect();
            let motion = scene.motion();
            let (r, t) = (motion.rotation.transpose(), motion.translation);
            writeln!(
                file,
                r#"{{"case":"{}","matches":{rows:?},"rotation":{:?},"translation":{:?}}}"#,
                case.name,
                r.as_slice(),
                t.as_slice()
            )?;
        }
    }
    Ok(())
}

fn main() -> std::io::Result<()> {
    if let Some(path) = std::env::args().nth(1) {
        write_scenes(&path)?;
    }
    println!(
        "case            refinement     ms  samples  rotation°  direction° (90 %, worst)  without answer"
    );
    for case in cases() {
        for refinement in [Refinement::None, Refinement::Local, Refinement::Full] {
            let (mut times, mut rotations, mut directions, mut samples) = (vec![], vec![], vec![], vec![]);
            for seed in 0..TRIALS {
                let scene = case.scene(seed);
                let options = RelativeOptions {
                    threshold: 1.0 / FOCAL,
                    seed,
                    refinement,
                    order: Order::Random,
                    ..RelativeOptions::default()
                };
                // The shortest of several runs: what the machine does besides only adds.
                let mut shortest = f64::INFINITY;
                for _ in 0..REPEATS {
                    let start = Instant::now();
                    std::hint::black_box(estimate(&scene.matches, &options).is_ok());
                    shortest = shortest.min(start.elapsed().as_secs_f64() * 1e3);
                }
                times.push(shortest);
                let found = estimate(&scene.matches, &options);
                if let Ok(found) = found {
                    rotations.push(scene.rotation_error_rad(&found.cam_b_from_cam_a).to_degrees());
                    directions.push(scene.direction_error_rad(&found.cam_b_from_cam_a).to_degrees());
                    samples.push(found.iterations as f64);
                }
            }
            let (middle, failed) = (median(&mut directions), TRIALS as usize - directions.len());
            let at =
                |share: f64| directions.get((share * directions.len() as f64) as usize).or(directions.last());
            println!(
                "{:15} {:10} {:6.2} {:8.0} {:10.4} {middle:11.4} ({:.3}, {:.3}) {failed:10}",
                case.name,
                format!("{refinement:?}"),
                median(&mut times),
                median(&mut samples),
                median(&mut rotations),
                at(0.9).copied().unwrap_or(f64::NAN),
                at(1.0).copied().unwrap_or(f64::NAN),
            );
        }
    }
    Ok(())
}
