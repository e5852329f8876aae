//! From named tensors to packed layers.

use crate::error::{Error, Result, SourceError};
use crate::packed::Packed;

/// A tensor as the checkpoint has it: its shape and its values, row-major.
pub type NamedTensor = (Vec<usize>, Vec<f32>);

/// Reads tensors by name and checks their shapes.
pub(crate) struct Reader<'a> {
    source: &'a mut dyn FnMut(&str) -> std::result::Result<NamedTensor, SourceError>,
}

/// Scale and shift of a layer normalisation.
pub(crate) struct Norm {
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(
        source: &'a mut dyn FnMut(&str) -> std::result::Result<NamedTensor, SourceError>,
    ) -> Self {
        Self { source }
    }

    /// The values of a tensor of this shape.
    pub(crate) fn values(&mut self, name: &str, expected: &[usize]) -> Result<Vec<f32>> {
        let (shape, values) =
            (self.source)(name).map_err(|source| Error::Weights { name: name.to_owned(), source })?;
        if shape != expected {
            let expected = expected.to_vec();
            return Err(Error::TensorShape { name: name.to_owned(), expected, found: shape });
        }
        if values.len() != shape.iter().product::<usize>() {
            return Err(Error::TensorLength { name: name.to_owned(), shape, found: values.len() });
        }
        Ok(values)
    }

    /// `prefix.weight` and `prefix.bias` of a layer normalisation.
    pub(crate) fn norm(&mut self, prefix: &str, dim: usize) -> Result<Norm> {
        Ok(Norm {
            weight: self.values(&format!("{prefix}.weight"), &[dim])?,
            bias: self.values(&format!("{prefix}.bias"), &[dim])?,
        })
    }

    /// `prefix.weight [outputs, inputs]` and `prefix.bias`.
    pub(crate) fn linear(&mut self, prefix: &str, inputs: usize, outputs: usize) -> Result<Packed> {
        let weights = self.values(&format!("{prefix}.weight"), &[outputs, inputs])?;
        let bias = self.values(&format!("{prefix}.bias"), &[outputs])?;
        Ok(Packed::linear(&weights, inputs, outputs, Some(&bias)))
    }

    /// Two linear layers on the same input, one after the other in the output.
    pub(crate) fn joined(&mut self, prefixes: [&str; 2], inputs: usize, outputs: usize) -> Result<Packed> {
        let mut weights = Vec::new();
        let mut bias = Vec::new();
        for prefix in prefixes {
            weights.extend(self.values(&format!("{prefix}.weight"), &[outputs, inputs])?);
            bias.extend(self.values(&format!("{prefix}.bias"), &[outputs])?);
        }
        Ok(Packed::linear(&weights, inputs, 2 * outputs, Some(&bias)))
    }

    /// A 1×1 convolution: a linear layer on channels.
    pub(crate) fn conv1(&mut self, prefix: &str, inputs: usize, outputs: usize) -> Result<Packed> {
        let weights = self.values(&format!("{prefix}.weight"), &[outputs, inputs, 1, 1])?;
        let bias = self.values(&format!("{prefix}.bias"), &[outputs])?;
        Ok(Packed::linear(&weights, inputs, outputs, Some(&bias)))
    }

    /// A 3×3 convolution.
    pub(crate) fn conv3(
        &mut self,
        prefix: &str,
        inputs: usize,
        outputs: usize,
        biased: bool,
    ) -> Result<Packed> {
        let weights = self.values(&format!("{prefix}.weight"), &[outputs, inputs, 3, 3])?;
        let bias = if biased { Some(self.values(&format!("{prefix}.bias"), &[outputs])?) } else { None };
        Ok(Packed::conv3(&weights, inputs, outputs, bias.as_deref()))
    }

    /// A transposed convolution whose kernel does not overlap: a linear layer to `side²` pixels of `dim`
    /// channels.
    pub(crate) fn unfold(&mut self, prefix: &str, dim: usize, side: usize) -> Result<Packed> {
        let area = side * side;
        let weights = self.values(&format!("{prefix}.weight"), &[dim, dim, side, side])?;
        let bias = self.values(&format!("{prefix}.bias"), &[dim])?;
        let repeated: Vec<f32> = (0..area).flat_map(|_| bias.iter().copied()).collect();
        Ok(Packed::new(&[dim], area * dim, Some(&repeated), |output, input| {
            weights[(input * dim + output % dim) * area + output / dim]
        }))
    }
}
