//! The whole network against the reference's intermediates and outputs, part by part.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it read"
)]
#![allow(dead_code, unused_imports, reason = "the reader of goldens serves two tests")]

mod goldens;

use goldens::{
    Collected, Golden, OwnImage, Tolerance, inference_cases, network, root, training_cases, with_tensors,
};
use selenograph_engine::{Engine, HeadOutput, Simd};
use std::path::Path;

/// `max(5e-4, 10 × figure)` of the goldens' README, relative to the tensor's largest value.
const TOLERANCE: Tolerance = Tolerance(5e-4);

/// Every set of instructions that this processor has.
fn engines(folder: &Path) -> Vec<Engine> {
    [Simd::Plain, Simd::Avx2, Simd::Avx512]
        .into_iter()
        .filter(|level| level.is_present())
        .map(|level| network(folder, level))
        .collect()
}

fn check_output(golden: &Golden, name: &str, points: &str, item: usize, output: &HeadOutput) -> f32 {
    let errors = [
        golden.compare(&format!("{name}.{points}"), item, &output.points, TOLERANCE),
        golden.compare(&format!("{name}.conf"), item, &output.confidence, TOLERANCE),
        golden.compare(&format!("{name}.desc"), item, &output.descriptors, TOLERANCE),
        golden.compare(&format!("{name}.desc_conf"), item, &output.descriptor_confidence, TOLERANCE),
    ];
    errors.into_iter().fold(0.0, f32::max)
}

/// All batch items of a case, with every intermediate that the reference kept.
fn check_case(case: &Path) {
    let golden = Golden::open(case);
    for engine in engines(case.parent().unwrap()) {
        for item in 0..golden.shape("img1")[0] {
            let mut seen = Collected::default();
            let encodings = [1, 2].map(|view| {
                let image = golden.image(&format!("img{view}"), item);
                let mut own = Collected::default();
                let encoding = engine.encode_probed(&[image.borrowed()], &mut own).unwrap();
                seen.adopt(own, view);
                encoding.into_iter().next().unwrap()
            });
            let pair = (&encodings[0], &encodings[1]);
            let [a, b] = engine.decode_probed(&[pair], &mut seen).unwrap().swap_remove(0);
            let inner = golden.compare_all(&seen, item, TOLERANCE);
            let outer = check_output(&golden, "out1", "pts3d", item, &a).max(check_output(
                &golden,
                "out2",
                "pts3d_in_other_view",
                item,
                &b,
            ));
            println!(
                "{} {}: {} intermediates, worst {inner:.1e}; outputs {outer:.1e}",
                case.display(),
                engine.simd().name(),
                seen.len()
            );
        }
    }
}

/// Square, landscape, portrait, mixed views with odd grids, of more than one network.
#[test]
fn shared_golden_every_case() {
    let Some(root) = root("golden inference") else { return };
    for case in inference_cases(&root) {
        check_case(&case);
    }
}

/// Cases that the reference also decoded the other way round, with their networks and first pairs.
fn swapped_cases(root: &Path) -> Vec<(Golden, Engine, OwnImage, OwnImage)> {
    let open = |case: std::path::PathBuf| {
        let golden = Golden::open(&case);
        let (a, b) = (golden.image("img1", 0), golden.image("img2", 0));
        (golden, network(case.parent().unwrap(), Simd::detect()), a, b)
    };
    with_tensors(root, &["img1", "img2", "out1.pts3d", "swap22.pts3d"]).into_iter().map(open).collect()
}

#[test]
fn shared_golden_symmetric() {
    let Some(root) = root("golden swapped") else { return };
    for (golden, engine, a, b) in swapped_cases(&root) {
        let [forward, backward] = engine.infer_symmetric(a.borrowed(), b.borrowed()).unwrap();
        check_output(&golden, "out1", "pts3d", 0, &forward[0]);
        check_output(&golden, "out2", "pts3d_in_other_view", 0, &forward[1]);
        check_output(&golden, "swap22", "pts3d", 0, &backward[0]);
        check_output(&golden, "swap12", "pts3d_in_other_view", 0, &backward[1]);
        // Alone, in a batch, from a cache: the same bits.
        assert_eq!(engine.infer(a.borrowed(), b.borrowed()).unwrap(), forward);
        assert_eq!(engine.infer(b.borrowed(), a.borrowed()).unwrap(), backward);
    }
}

#[test]
fn shared_golden_any_number_of_threads() {
    let Some(root) = root("golden threads") else { return };
    for (_, engine, a, b) in swapped_cases(&root) {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| engine.infer(a.borrowed(), b.borrowed()).unwrap())
        };
        let one = run(1);
        for threads in [2, 3, 7] {
            assert_eq!(run(threads), one, "{threads} threads");
        }
    }
}

/// Training stores portrait images transposed; upright, the network gives the same.
#[test]
fn shared_golden_many_aspect_ratios() {
    let Some(root) = root("golden many aspect ratios") else { return };
    for case in training_cases(&root) {
        let golden = Golden::open(&case);
        let engine = network(case.parent().unwrap(), Simd::detect());
        for pair in 0..golden.shape("gt1.img")[0] {
            let views = [1, 2].map(|view| golden.upright_image(view, pair));
            let encodings = engine.encode(&[views[0].0.borrowed(), views[1].0.borrowed()]).unwrap();
            for (item, (first, second)) in [(2 * pair, (0, 1)), (2 * pair + 1, (1, 0))] {
                let outputs = engine.decode(&[(&encodings[first], &encodings[second])]).unwrap();
                for (side, view) in [(0, first), (1, second)] {
                    let output = goldens::stored(&outputs[0][side], views[view].1);
                    let points = if side == 0 { "pts3d" } else { "pts3d_in_other_view" };
                    check_output(&golden, &format!("pred{}", side + 1), points, item, &output);
                }
            }
        }
    }
}
