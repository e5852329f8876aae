//! Reading and comparing the reference's tensors.

#[path = "../../../network/testdata/golden_file.rs"]
#[allow(dead_code, reason = "every crate takes what it needs")]
mod golden_file;

pub use golden_file::{Golden, root};

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
        let top = expected.iter().fold(0.0_f32, |top, v| top.max(v.abs()));
        let differences = expected.iter().zip(&found).map(|(a, b)| (a - b).abs());
        let worst =
            differences.fold(0.0_f32, |worst, v| if v.is_nan() { f32::INFINITY } else { worst.max(v) });
        assert!(worst <= TOLERANCE * top, "{name}: off by {worst}, largest value {top}");
        worst / top
    }

    /// Compares everything seen that the golden holds, and wants everything that it holds seen.
    pub fn compare_all(&self, seen: &Collected) -> f32 {
        let inner = self
            .0
            .keys()
            .filter(|name| !["img", "pos", "out", "swap"].iter().any(|prefix| name.starts_with(prefix)));
        let seen = seen.0.borrow();
        inner.fold(0.0, |worst, name| {
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

/// A small network with the goldens' weights.
pub fn network(folder: &Path, device: &Device) -> Model {
    let weights = Golden::open(&folder.join("model.safetensors"));
    Model::new(&golden_file::config(folder), device, &mut |name| {
        weights.0.get(name).cloned().ok_or_else(|| format!("no tensor `{name}`").into())
    })
    .unwrap()
}
