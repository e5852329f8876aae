//! Layers by their names in the checkpoint.
//!
//! A [`Scope`] is a place in the checkpoint's tree of names; the network's parts are functions of a scope and tensors, and
//! read as the tree does.

use burn_tensor::ops::ConvOptions;
use burn_tensor::{FloatDType, Tensor, activation, module};
use selenograph_network::config::NORM_EPSILON;

use crate::parameters::Parameters;

/// In which numbers linear layers, convolutions and attention multiply. Norms, softmax, the residual stream, upsampling and
/// what makes points and confidences stay in f32, as do the parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// Everything in f32.
    #[default]
    F32,
    /// Products in bf16: for graphics cards with units for it.
    Bf16,
}

/// Receives intermediates by the names of the network's parts (`enc_block3`, `dec1_block0`, `head2.act1` …), with their
/// shapes, flat.
pub type Probe<'a> = dyn Fn(&str, &[usize], Tensor<1>) + 'a;

/// A place in the tree of names.
pub(crate) struct Scope<'a> {
    parameters: &'a Parameters,
    precision: Precision,
    probe: Option<&'a Probe<'a>>,
    path: String,
}

impl<'a> Scope<'a> {
    pub(crate) fn root(
        parameters: &'a Parameters,
        precision: Precision,
        probe: Option<&'a Probe<'a>>,
    ) -> Self {
        Self { parameters, precision, probe, path: String::new() }
    }

    /// A branch of this place.
    pub(crate) fn under(&self, name: impl std::fmt::Display) -> Self {
        Self { path: format!("{}{name}.", self.path), ..*self }
    }

    /// Shows an intermediate to the probe, if there is one.
    pub(crate) fn see<const D: usize>(&self, name: impl FnOnce() -> String, value: &Tensor<D>) {
        if let Some(probe) = self.probe {
            let dims = value.dims();
            probe(&name(), &dims, value.clone().reshape([dims.iter().product::<usize>()]));
        }
    }

    fn value(&self, name: &str) -> Tensor<1> {
        self.parameters.value(&format!("{}{name}", self.path))
    }

    /// Sizes of a parameter.
    fn shape(&self, name: &str) -> &[usize] {
        let name = format!("{}{name}", self.path);
        self.parameters.get(&name).map_or(&[], |parameter| &parameter.spec().shape)
    }

    /// Numbers to multiply.
    pub(crate) fn factor<const D: usize>(&self, value: Tensor<D>) -> Tensor<D> {
        match self.precision {
            Precision::F32 => value,
            Precision::Bf16 => value.cast(FloatDType::BF16),
        }
    }

    /// A product, `[.., m, k] · [.., k, n]`, in f32.
    pub(crate) fn product<const D: usize>(&self, a: Tensor<D>, b: Tensor<D>) -> Tensor<D> {
        self.factor(a).matmul(self.factor(b)).cast(FloatDType::F32)
    }

    /// A linear layer on the last axis; a convolution of the size of a patch or of one pixel is one too.
    pub(crate) fn linear(&self, name: &str, x: Tensor<3>) -> Tensor<3> {
        let [batch, tokens, inputs] = x.dims();
        let at = self.under(name);
        let outputs = at.shape("weight").first().copied().unwrap_or(0);
        let weight = at.value("weight").reshape([outputs, inputs]).transpose();
        let product = at.product(x.reshape([batch * tokens, inputs]), weight);
        (product + at.value("bias").reshape([1, outputs])).reshape([batch, tokens, outputs])
    }

    /// A layer normalisation over the last axis.
    pub(crate) fn norm(&self, name: &str, x: Tensor<3>) -> Tensor<3> {
        let at = self.under(name);
        module::layer_norm(x, at.value("weight"), Some(at.value("bias")), NORM_EPSILON)
    }

    /// `fc2(gelu(fc1(x)))`.
    pub(crate) fn mlp(&self, name: &str, x: Tensor<3>) -> Tensor<3> {
        let at = self.under(name);
        at.linear("fc2", gelu(at.linear("fc1", x)))
    }

    /// A 3×3 convolution over a border of zeros, without its bias.
    pub(crate) fn conv3_unbiased(&self, name: &str, x: Tensor<4>, stride: usize) -> Tensor<4> {
        let at = self.under(name);
        let &[outputs, inputs, height, width] = at.shape("weight") else { return x };
        let weight = at.factor(at.value("weight").reshape([outputs, inputs, height, width]));
        let options = ConvOptions::new([stride; 2], [1, 1], [1, 1], 1);
        module::conv2d(at.factor(x), weight, None, options).cast(FloatDType::F32)
    }

    /// A 3×3 convolution over a border of zeros.
    pub(crate) fn conv3(&self, name: &str, x: Tensor<4>, stride: usize) -> Tensor<4> {
        let sum = self.conv3_unbiased(name, x, stride);
        self.under(name).biased(sum)
    }

    /// A convolution of one pixel, `[batch, channels, height, width]`.
    pub(crate) fn conv1(&self, name: &str, x: Tensor<4>) -> Tensor<4> {
        let [batch, inputs, height, width] = x.dims();
        let at = self.under(name);
        let outputs = at.shape("weight").first().copied().unwrap_or(0);
        let weight = at.value("weight").reshape([1, outputs, inputs]);
        let product = at.product(weight, x.reshape([batch, inputs, height * width]));
        at.biased(product.reshape([batch, outputs, height, width]))
    }

    /// A transposed convolution whose kernel is its stride, on tokens of a grid: each becomes `side²` pixels. Gives
    /// `[batch, channels, side · rows, side · columns]`.
    pub(crate) fn unfold(
        &self,
        name: &str,
        x: Tensor<3>,
        [rows, columns]: [usize; 2],
        side: usize,
    ) -> Tensor<4> {
        let [batch, tokens, inputs] = x.dims();
        let at = self.under(name);
        let outputs = at.shape("weight").get(1).copied().unwrap_or(0);
        let weight = at.value("weight").reshape([inputs, outputs * side * side]);
        let product = at.product(x.reshape([batch * tokens, inputs]), weight);
        let pixels = product
            .reshape([batch, rows, columns, outputs, side, side])
            .permute([0, 3, 1, 4, 2, 5])
            .reshape([batch, outputs, rows * side, columns * side]);
        at.biased(pixels)
    }

    fn biased(&self, x: Tensor<4>) -> Tensor<4> {
        let channels = x.dims()[1];
        x + self.value("bias").reshape([1, channels, 1, 1])
    }

    /// The same place with products in f32: for what becomes coordinates.
    pub(crate) fn exact(&self) -> Self {
        Self { path: self.path.clone(), precision: Precision::F32, ..*self }
    }
}

/// GELU, exact.
///
/// burn's own is exact on the CPU; on other devices its derivative is that of the tanh approximation, off by up to 1e-3:
/// there it is put together, and derived, from `erf`.
fn gelu(x: Tensor<3>) -> Tensor<3> {
    if crate::device::is_cpu(&x.device()) {
        return activation::gelu(x);
    }
    let cdf = (x.clone() * std::f64::consts::FRAC_1_SQRT_2).erf() + 1.0;
    x * cdf * 0.5
}
