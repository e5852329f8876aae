//! The reference's tensors, on the device that `SELENOGRAPH_TEST_DEVICE` names (default `cpu`).
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and says what it ran on"
)]

mod goldens;

use goldens::{Collected, Golden, inference_cases, network, root, training_cases, with_tensors};
use selenograph_model::{Device, Images, Output, device};
use std::path::Path;

fn test_device() -> Device {
    let name = std::env::var_os("SELENOGRAPH_TEST_DEVICE").unwrap_or_else(|| "cpu".into());
    device::parse(name.to_str().unwrap()).unwrap()
}

fn images(golden: &Golden, name: &str, device: &Device) -> Images {
    let &[count, _, height, width] = golden.shape(name) else { panic!("images have four axes") };
    Images::upright(golden.values(name).to_vec(), [count, height, width], device).unwrap()
}

fn check_output(golden: &Golden, name: &str, points: &str, output: &Output) -> f32 {
    let errors = [
        golden.compare(&format!("{name}.{points}"), &output.points),
        golden.compare(&format!("{name}.conf"), &output.confidence),
        golden.compare(&format!("{name}.desc"), output.descriptors.as_ref().unwrap()),
        golden.compare(&format!("{name}.desc_conf"), output.descriptor_confidence.as_ref().unwrap()),
    ];
    errors.into_iter().fold(0.0, f32::max)
}

/// A batch, with every intermediate that the reference kept; and the same on the tape, whose layers differ.
fn check_case(case: &Path) {
    let device = test_device();
    let golden = Golden::open(case);
    let plain = network(case.parent().unwrap(), &device);
    let tracked = plain.tracked(&|_| true);
    for (mode, model) in [("plain", &plain), ("tracked", &tracked)] {
        let seen = Collected::default();
        let [a, b] = [(1, ".1"), (2, ".2")].map(|(view, suffix)| {
            let probe = seen.probe(suffix);
            model.encode_probed(&images(&golden, &format!("img{view}"), &device), Some(&probe)).unwrap()
        });
        let probe = seen.probe("");
        let [first, second] = model.decode_probed(&a, &b, Some(&probe)).unwrap();
        let inner = golden.compare_all(&seen);
        let outer = check_output(&golden, "out1", "pts3d", &first).max(check_output(
            &golden,
            "out2",
            "pts3d_in_other_view",
            &second,
        ));
        let (name, count) = (case.display(), seen.len());
        println!("{name} {mode}: {count} intermediates, worst {inner:.1e}; outputs {outer:.1e}");
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

#[test]
fn shared_golden_symmetric() {
    let Some(root) = root("golden swapped") else { return };
    let device = test_device();
    for case in with_tensors(&root, &["img1", "img2", "out1.pts3d", "swap22.pts3d"]) {
        let golden = Golden::open(&case);
        let model = network(case.parent().unwrap(), &device);
        let [a, b] = ["img1", "img2"].map(|name| images(&golden, name, &device));
        let [forward, backward] = model.infer_symmetric(&a, &b).unwrap();
        check_output(&golden, "out1", "pts3d", &forward[0]);
        check_output(&golden, "out2", "pts3d_in_other_view", &forward[1]);
        check_output(&golden, "swap22", "pts3d", &backward[0]);
        check_output(&golden, "swap12", "pts3d_in_other_view", &backward[1]);
    }
}

/// A symmetrised training batch with portrait images stored transposed, each image encoded once.
#[test]
fn shared_golden_many_aspect_ratios() {
    let Some(root) = root("golden many aspect ratios") else { return };
    for case in training_cases(&root) {
        check_training_case(&case);
    }
}

fn check_training_case(case: &Path) {
    let device = test_device();
    let golden = Golden::open(case);
    let model = network(case.parent().unwrap(), &device);
    let &[pairs, _, height, width] = golden.shape("gt1.img") else { panic!("images have four axes") };
    let len = golden.values("gt1.img").len() / pairs;
    let (mut values, mut sizes) = (Vec::new(), Vec::new());
    for pair in 0..pairs {
        for view in ["gt1", "gt2"] {
            values.extend_from_slice(&golden.values(&format!("{view}.img"))[pair * len..][..len]);
            let size = &golden.values(&format!("{view}.true_shape"))[2 * pair..][..2];
            sizes.push([size[0] as usize, size[1] as usize]);
        }
    }
    if !sizes.contains(&[width, height]) {
        println!("SKIP shared-data: {} has no portrait image", case.display());
    }
    let stored = Images::stored_landscape(values, [height, width], &sizes, &device).unwrap();
    let all = model.encode(&stored).unwrap();
    let places: Vec<usize> = (0..2 * pairs).map(|place| place ^ 1).collect();
    for model in [&model, &model.tracked(&|_| true)] {
        let [first, second] = model.decode(&all, &all.select(&places).unwrap()).unwrap();
        check_output(&golden, "pred1", "pts3d", &first);
        check_output(&golden, "pred2", "pts3d_in_other_view", &second);
    }
}
