//! How a file's tensors and a network's agree.

use super::StoredTensor;
use crate::layout::{Layout, Part, Purpose, TensorSpec};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Faults that an error tells; `weights info` tells all.
const TOLD: usize = 3;

/// A tensor that is not in the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Expected {
    /// Its name.
    pub name: String,
    /// The shape that the network needs.
    pub shape: Vec<usize>,
    /// Whether a forward pass reads it.
    pub needed: bool,
}

/// A tensor that the network does not have.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Found {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Vec<usize>,
}

/// A tensor of another shape.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Mismatch {
    /// Its name.
    pub name: String,
    /// The shape that the network needs.
    pub expected: Vec<usize>,
    /// The shape in the file.
    pub found: Vec<usize>,
}

/// Parameters of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PartFit {
    /// That the network has.
    pub needed: usize,
    /// That the file gives it, in the right shape.
    pub found: usize,
}

/// How a file's tensors and a network's agree.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Fit {
    /// Tensors that are not there.
    pub missing: Vec<Expected>,
    /// Tensors of another shape.
    pub wrong_shape: Vec<Mismatch>,
    /// Tensors that the network does not have.
    pub extra: Vec<Found>,
    /// Names that the file has more than once.
    pub duplicated: Vec<String>,
    /// Second names of tensors that the file has under both, as one set of bytes.
    pub num_shared: usize,
    /// Second names of tensors that the file holds twice.
    pub num_copies: usize,
    /// Parameters by part, each counted once.
    pub parts: BTreeMap<Part, PartFit>,
}

impl Fit {
    pub(super) fn new(
        layout: &Layout,
        tensors: &BTreeMap<String, StoredTensor>,
        renamed: &BTreeMap<String, String>,
        duplicated: Vec<String>,
    ) -> Self {
        let mut fit = Self {
            missing: Vec::new(),
            wrong_shape: Vec::new(),
            extra: Vec::new(),
            duplicated,
            num_shared: 0,
            num_copies: 0,
            parts: BTreeMap::new(),
        };
        let mut used = BTreeSet::new();
        for spec in layout.specs() {
            let name = renamed.get(&spec.name).unwrap_or(&spec.name);
            let tensor = tensors.get(name);
            used.insert(name.as_str());
            fit.account(spec, tensor);
            if let (Purpose::AliasOf(owner), Some(tensor)) = (&spec.purpose, tensors.get(&spec.name)) {
                match tensors.get(owner) {
                    Some(owner) if owner.shares_bytes(tensor) => fit.num_shared += 1,
                    Some(_) => fit.num_copies += 1,
                    None => {}
                }
            }
        }
        let left_over = tensors.iter().filter(|(name, _)| !used.contains(name.as_str()));
        fit.extra = left_over
            .map(|(name, tensor)| Found { name: name.clone(), shape: tensor.shape.clone() })
            .collect();
        fit
    }

    fn account(&mut self, spec: &TensorSpec, tensor: Option<&StoredTensor>) {
        let right = tensor.is_some_and(|tensor| tensor.shape == spec.shape);
        if !spec.is_alias() {
            let part = self.parts.entry(spec.part).or_default();
            part.needed += spec.len();
            part.found += if right { spec.len() } else { 0 };
        }
        match tensor {
            _ if right => {}
            Some(tensor) => self.wrong_shape.push(Mismatch {
                name: spec.name.clone(),
                expected: spec.shape.clone(),
                found: tensor.shape.clone(),
            }),
            // A second name is missed only together with the first, which is on the list.
            None if spec.is_alias() => {}
            None => self.missing.push(Expected {
                name: spec.name.clone(),
                shape: spec.shape.clone(),
                needed: spec.purpose != Purpose::Unused,
            }),
        }
    }

    /// Parts that the file has completely.
    pub fn complete_parts(&self) -> impl Iterator<Item = Part> {
        self.parts.iter().filter(|(_, fit)| fit.found == fit.needed).map(|(part, _)| *part)
    }

    /// What keeps the network from running, or `None`.
    pub fn faults(&self) -> Option<String> {
        let wrong = self
            .wrong_shape
            .iter()
            .map(|wrong| format!("`{}` is {:?}, expected {:?}", wrong.name, wrong.found, wrong.expected));
        let missing = self.missing.iter().filter(|missing| missing.needed);
        let missing = missing.map(|missing| format!("`{}` {:?} is missing", missing.name, missing.shape));
        let twice = self.duplicated.iter().map(|name| format!("`{name}` is there twice"));
        let faults: Vec<String> = twice.chain(wrong).chain(missing).collect();
        let more = faults.len().saturating_sub(TOLD);
        let told = faults[..faults.len() - more].join("; ");
        match (faults.is_empty(), more) {
            (true, _) => None,
            (false, 0) => Some(told),
            (false, more) => Some(format!("{told}; and {more} more")),
        }
    }
}
