//! A network's parameters: flat tensors under the names of the checkpoints.
//!
//! Each is kept as a tensor of one axis, in the checkpoint's order of values; its shape is in its [`TensorSpec`]. Optimisers
//! and checkpoints need no more, and layers give it its axes where they use it.

use std::collections::BTreeMap;

use burn_tensor::{Device, Gradients as Tape, Tensor, TensorData};
use selenograph_network::NetworkConfig;
use selenograph_network::layout::{Layout, Purpose, TensorSpec};

use crate::error::{Error, Result, SourceError};

/// A tensor as the checkpoint has it: its shape and its values, row-major.
pub type NamedTensor = (Vec<usize>, Vec<f32>);

/// One parameter.
#[derive(Debug, Clone)]
pub struct Parameter {
    spec: TensorSpec,
    value: Tensor<1>,
}

impl Parameter {
    /// Name, shape and part.
    pub fn spec(&self) -> &TensorSpec {
        &self.spec
    }

    /// Name in a checkpoint.
    pub fn name(&self) -> &str {
        &self.spec.name
    }

    /// Its values, flat, in f32.
    pub fn value(&self) -> &Tensor<1> {
        &self.value
    }

    /// Whether a forward pass reads it: the others never get a gradient.
    pub fn is_computed(&self) -> bool {
        self.spec.purpose == Purpose::Computed
    }
}

/// All parameters of a network that own their values, in the order of [`Layout::owned`].
#[derive(Debug, Clone)]
pub struct Parameters {
    list: Vec<Parameter>,
    by_name: BTreeMap<String, usize>,
}

impl Parameters {
    /// Reads every tensor once, by its name in the checkpoint.
    ///
    /// # Errors
    /// [`Error::Network`], [`Error::Weights`], [`Error::TensorShape`], [`Error::TensorLength`].
    pub fn read(
        config: &NetworkConfig,
        device: &Device,
        source: &mut dyn FnMut(&str) -> std::result::Result<NamedTensor, SourceError>,
    ) -> Result<Self> {
        let layout = Layout::new(config)?;
        let device = device.clone().without_autodiff();
        let list = layout
            .owned()
            .map(|spec| {
                let (shape, values) = source(&spec.name)
                    .map_err(|source| Error::Weights { name: spec.name.clone(), source })?;
                if shape != spec.shape {
                    let (name, expected) = (spec.name.clone(), spec.shape.clone());
                    return Err(Error::TensorShape { name, expected, found: shape });
                }
                Ok(Parameter { spec: spec.clone(), value: flat(spec, values, &device)? })
            })
            .collect::<Result<Vec<_>>>()?;
        let by_name = list.iter().enumerate().map(|(idx, each)| (each.spec.name.clone(), idx)).collect();
        Ok(Self { list, by_name })
    }

    /// Of no network, for tests of layers that have none.
    #[cfg(test)]
    pub(crate) fn none() -> Self {
        Self { list: Vec::new(), by_name: BTreeMap::new() }
    }

    /// How many tensors there are.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// All of them, in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Parameter> {
        self.list.iter()
    }

    /// The parameter at a place in the order.
    pub fn at(&self, idx: usize) -> &Parameter {
        &self.list[idx]
    }

    /// The place of a name in the order.
    pub fn idx(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// The parameter of that name.
    pub fn get(&self, name: &str) -> Option<&Parameter> {
        Some(&self.list[self.idx(name)?])
    }

    /// Replaces a parameter's values by a flat tensor on the same device.
    ///
    /// # Errors
    /// [`Error::TensorLength`].
    pub fn set(&mut self, idx: usize, value: Tensor<1>) -> Result<()> {
        let Parameter { spec, value: kept } = &mut self.list[idx];
        let found = value.dims()[0];
        if found != spec.len() {
            return Err(Error::TensorLength { name: spec.name.clone(), shape: spec.shape.clone(), found });
        }
        *kept = value;
        Ok(())
    }

    /// The same with every value mapped, in order.
    pub(crate) fn map(&self, change: &dyn Fn(&Parameter) -> Tensor<1>) -> Self {
        let list =
            self.list.iter().map(|each| Parameter { spec: each.spec.clone(), value: change(each) }).collect();
        Self { list, by_name: self.by_name.clone() }
    }

    /// The values of a name that the layout has: what layers ask for.
    pub(crate) fn value(&self, name: &str) -> Tensor<1> {
        self.list[self.by_name[name]].value.clone()
    }
}

fn flat(spec: &TensorSpec, values: Vec<f32>, device: &Device) -> Result<Tensor<1>> {
    let found = values.len();
    if found != spec.len() {
        return Err(Error::TensorLength { name: spec.name.clone(), shape: spec.shape.clone(), found });
    }
    Ok(Tensor::from_data(TensorData::new(values, [found]), device))
}

/// Gradients of a loss by each parameter, in the parameters' order; `None` where there is none.
#[derive(Debug, Clone)]
pub struct Gradients {
    list: Vec<Option<Tensor<1>>>,
}

impl Gradients {
    /// None of `count` parameters has one.
    pub fn none(count: usize) -> Self {
        Self { list: vec![None; count] }
    }

    /// Takes those of a network's learning parameters off the tape.
    pub(crate) fn collect(parameters: &Parameters, tape: &mut Tape) -> Self {
        Self { list: parameters.iter().map(|each| each.value.grad_remove(tape)).collect() }
    }

    /// The gradient at a place in the parameters' order, flat.
    pub fn at(&self, idx: usize) -> Option<&Tensor<1>> {
        self.list.get(idx)?.as_ref()
    }

    /// All of them, in the parameters' order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Option<&Tensor<1>>> {
        self.list.iter().map(Option::as_ref)
    }

    /// Changes each of them, for scaling and clipping.
    pub fn map(self, change: &dyn Fn(Tensor<1>) -> Tensor<1>) -> Self {
        Self { list: self.list.into_iter().map(|each| each.map(change)).collect() }
    }

    /// Adds those of another part of the batch, of the same network.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        let sum = |pair: (Option<Tensor<1>>, Option<Tensor<1>>)| match pair {
            (Some(a), Some(b)) => Some(a + b),
            (a, b) => a.or(b),
        };
        Self { list: self.list.into_iter().zip(other.list).map(sum).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_network::Preset;

    #[test]
    fn tensors_that_do_not_fit_are_named() {
        let config = Preset::Tiny.config();
        let layout = Layout::new(&config).unwrap();
        let spec = |name: &str| layout.get(name).map(|spec| spec.shape.clone()).unwrap();
        let read = |spoiled: &dyn Fn(&str) -> std::result::Result<NamedTensor, SourceError>| {
            Parameters::read(&config, &Device::flex(), &mut |name| spoiled(name)).unwrap_err()
        };
        let absent = read(&|name| Err(format!("no {name}").into()));
        assert!(matches!(absent, Error::Weights { name, .. } if name == "mask_token"));
        let shape = read(&|_| Ok((vec![3], vec![0.0; 3])));
        assert!(matches!(shape, Error::TensorShape { found, .. } if found == [3]));
        let length = read(&|name| Ok((spec(name), Vec::new())));
        assert!(matches!(length, Error::TensorLength { found: 0, .. }));
    }
}
