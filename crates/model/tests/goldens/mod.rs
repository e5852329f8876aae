//! Reading and comparing the reference's tensors.

#[path = "../../../network/testdata/golden_file.rs"]
#[allow(dead_code, reason = "every crate takes what it needs")]
mod golden_file;

pub use golden_file::{Golden, inference_cases, root, training_cases, with_tensors};

use selenograph_model::{Device, Model, Tensor};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

/// `golden/README.md`: 5e-4, or ten times the reference's own rounding (at most 2.4e-4), relative to a tensor's largest value.
const TOLERANCE: f32 = 5e-4;

impl Golden {
    /// Panics beyond the tolerance; returns the difference, relative to the largest value.
    pub fn compare<const D: usize>(&self, name: &str, found: &Tensor<D>) -> f32 {
        let (shape, expected) = &self.0[name];
        assert_eq!(shape, &found.dims(), "{name}");
        let found = found.clone().without_autodiff().try_into_vec_as::<f32>().unwrap();
        let error = golden_file::relative_error(&found, expected);
        assert!(error <= TOLERANCE, "{name}: off by {error} of the largest value");
        error
    }

    /// Compares everything seen that the golden holds, and wants everything that it holds seen.
    pub fn compare_all(&self, seen: &Collected) -> f32 {
        let seen = seen.0.borrow();
        self.intermediates().fold(0.0, |worst, name| {
            let (shape, value) = seen.get(name).unwrap_or_else(|| panic!("`{name}` was not seen"));
            assert_eq!(shape, self.shape(name), "{name}");
            let flat =
                Self(BTreeMap::from([(name.clone(), (vec![value.dims()[0]], self.values(name).to_vec()))]));
            worst.max(flat.compare(name, value))
        })
    }
}

/// Intermediates by name.
#[derive(Default)]
pub struct Collected(RefCell<BTreeMap<String, (Vec<usize>, Tensor<1>)>>);

impl Collected {
    /// A probe that puts `suffix` after every name.
    pub fn probe<'a>(&'a self, suffix: &'a str) -> impl Fn(&str, &[usize], Tensor<1>) + 'a {
        move |name, shape, value| {
            self.0.borrow_mut().insert(format!("{name}{suffix}"), (shape.to_vec(), value));
        }
    }

    pub fn len(&self) -> usize {
        self.0.borrow().len()
    }
}

/// The network with the goldens' weights in `folder`.
pub fn network(folder: &Path, device: &Device) -> Model {
    let weights = Golden::open(&golden_file::weights(folder));
    Model::new(&golden_file::config(folder), device, &mut |name| {
        weights.0.get(name).cloned().ok_or_else(|| format!("no tensor `{name}`").into())
    })
    .unwrap()
}
