//! Convolutions of three by three.

use crate::error::Result;
use crate::gemm::{Conv3Input, Finish, Input, gemm};
use crate::packed::Packed;
use crate::transformer::Context;
use crate::upsample::Pixels;
use crate::weights::Reader;

/// `x + conv2(relu(conv1(relu(x))))`.
pub(crate) struct Residual {
    pub conv1: Packed,
    pub conv2: Packed,
}

impl Residual {
    pub(crate) fn read(reader: &mut Reader<'_>, prefix: &str, dim: usize) -> Result<Self> {
        Ok(Self {
            conv1: reader.conv3(&format!("{prefix}.conv1"), dim, dim, true)?,
            conv2: reader.conv3(&format!("{prefix}.conv2"), dim, dim, true)?,
        })
    }

    pub(crate) fn num_bytes(&self) -> usize {
        self.conv1.num_bytes() + self.conv2.num_bytes()
    }
}

impl Context<'_> {
    /// A convolution of every `stride`-th pixel's neighbourhood; of `zeros` there are as many as a pixel has channels, or more.
    pub(crate) fn conv3(
        &self,
        from: &Pixels<'_>,
        stride: usize,
        layer: &Packed,
        zeros: &[f32],
        finish: &Finish<'_>,
    ) {
        let out_width = from.width.div_ceil(stride);
        let input = Input::Conv3(Conv3Input {
            data: from.data,
            size: (from.width, from.height),
            channels: from.channels,
            first_row: 0,
            stride,
            out_width,
            out_first_row: 0,
            zeros,
        });
        gemm(self.level, &input, out_width * from.height.div_ceil(stride), layer, finish);
    }
}
