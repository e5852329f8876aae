//! The dense head: four levels of tokens into a map of four channels per pixel (Ranftl et al. 2021, "Vision Transformers for
//! Dense Prediction").

use burn_tensor::{Device, Tensor, TensorData, activation};

use crate::scope::Scope;
use crate::views::StemMaps;
use selenograph_network::config::STEM_VARIANCE_FLOOR;

/// Images with mean 0 and variance 1 each, over all their pixels and colours.
pub(crate) fn standardised(images: Tensor<4>) -> Tensor<4> {
    let [count, colors, height, width] = images.dims();
    let flat = images.reshape([count, colors * height * width]);
    let centred = flat.clone() - flat.mean_dim(1);
    let variance = centred.clone().square().mean_dim(1);
    let scaled = centred / (variance + STEM_VARIANCE_FLOOR).sqrt();
    scaled.reshape([count, colors, height, width])
}

/// Maps at a half, a quarter and an eighth of the size of images, `[images, channels, height, width]`.
pub(crate) fn stem(at: &Scope<'_>, images: Tensor<4>) -> [Tensor<4>; 3] {
    let mut x = images;
    [0, 1, 2].map(|level: usize| {
        let at = at.under(level);
        x = residual(&at, at.conv3("down", x.clone(), 2));
        x.clone()
    })
}

/// The map `[images, 4, height, width]` and the features it is linear in (with a stem at half its size), from the tokens at the four hooks, which lie on a
/// grid of `[rows, columns]`, and the maps of the stem if there is one; `at` is the place `dpt`, `label` what the probe knows
/// the head by.
pub(crate) fn dpt(
    at: &Scope<'_>,
    label: &str,
    hooks: &[Tensor<3>; 4],
    maps: Option<&StemMaps>,
    grid: [usize; 2],
) -> [Tensor<4>; 2] {
    let scratch = at.under("scratch");
    let levels = [0, 1, 2, 3].map(|level| {
        let x = level_of(&at.under(format!("act_postprocess.{level}")), hooks[level].clone(), level, grid);
        at.see(|| format!("{label}.act{level}"), &x);
        let mut x = scratch.conv3_unbiased(&format!("layer{}_rn", level + 1), x, 1);
        if let (0, Some([_, quarter])) = (level, maps) {
            x = x + scratch.conv1("stem1_rn", quarter.clone());
        }
        at.see(|| format!("{label}.layer_rn{level}"), &x);
        x
    });
    let mut fused: Option<Tensor<4>> = None;
    for (level, x) in levels.into_iter().enumerate().rev() {
        let name = format!("refinenet{}", level + 1);
        let mut next = refine(&scratch.under(&name), x, fused);
        at.see(|| format!("{label}.{name}"), &next);
        if level == 3 {
            // Odd grids were rounded up on their way down.
            next = next.narrow(2, 0, grid[0]).narrow(3, 0, grid[1]);
        }
        fused = Some(next);
    }
    let Some(mut x) = fused else { return [0, 1].map(|_| hooks[0].clone().unsqueeze()) };
    if let Some([half, _]) = maps {
        x = x + scratch.conv1("stem0_rn", half.clone());
    }
    let head = at.under("head");
    let x = head.conv3("0", x, 1);
    // With a stem the last layers work at half the size: their outputs are smooth, and small networks have no time to lose.
    let x = if maps.is_some() { x } else { upsampled(x) };
    let features = activation::relu(head.conv3("2", x, 1));
    let map = head.exact().conv1("4", features.clone());
    let map = if maps.is_some() { upsampled(map) } else { map };
    at.see(|| format!("{label}.dpt_out"), &map);
    [map, features]
}

/// Tokens as a map of the level's size: 4, 2, 1 and ½ pixels for each token.
fn level_of(at: &Scope<'_>, tokens: Tensor<3>, level: usize, [rows, columns]: [usize; 2]) -> Tensor<4> {
    let x = at.linear("0", tokens);
    if level < 2 {
        return at.unfold("1", x, [rows, columns], [4, 2][level]);
    }
    let [images, _, channels] = x.dims();
    let x = x.swap_dims(1, 2).reshape([images, channels, rows, columns]);
    if level == 2 { x } else { at.conv3("1", x, 2) }
}

/// Fuses a level with what came from below it, and doubles its size.
fn refine(at: &Scope<'_>, level: Tensor<4>, below: Option<Tensor<4>>) -> Tensor<4> {
    let sum = match below {
        Some(below) => below + residual(&at.under("resConfUnit1"), level),
        None => level,
    };
    at.conv1("out_conv", upsampled(residual(&at.under("resConfUnit2"), sum)))
}

fn residual(at: &Scope<'_>, x: Tensor<4>) -> Tensor<4> {
    let inner = at.conv3("conv1", activation::relu(x.clone()), 1);
    x + at.conv3("conv2", activation::relu(inner), 1)
}

/// Twice the size, bilinear, corners on corners.
///
/// As two products with small matrices: exactly linear, its derivative the transposed products, and the same on every device.
pub(crate) fn upsampled(x: Tensor<4>) -> Tensor<4> {
    let [images, channels, height, width] = x.dims();
    let device = x.device().without_autodiff();
    let wide = x
        .reshape([images * channels * height, width])
        .matmul(doubling(width, &device).transpose())
        .reshape([images * channels, height, 2 * width]);
    let high = doubling(height, &device).unsqueeze::<3>().matmul(wide);
    high.reshape([images, channels, 2 * height, 2 * width])
}

/// The matrix `[2 len, len]` that doubles a row.
fn doubling(len: usize, device: &Device) -> Tensor<2> {
    let mut weights = vec![0.0_f32; 2 * len * len];
    for (target, row) in weights.chunks_exact_mut(len).enumerate() {
        // In f64: the source position is a ratio of integers, and its fraction a weight.
        let position = (target * (len - 1)) as f64 / (2 * len - 1) as f64;
        let below = position.floor();
        let idx = below as usize;
        row[idx] = (1.0 - (position - below)) as f32;
        if let Some(next) = row.get_mut(idx + 1) {
            *next = (position - below) as f32;
        }
    }
    Tensor::from_data(TensorData::new(weights, [2 * len, len]), device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubling_keeps_corners_and_ramps() {
        /// Rounding of weights of f32 times values of up to ten.
        const ROUNDING: f32 = 3e-6;
        let (height, width) = (3, 5);
        let value = |y: f32, x: f32| 1.5 * y - 0.75 * x + 2.0;
        let values: Vec<f32> =
            (0..height * width).map(|idx| value((idx / width) as f32, (idx % width) as f32)).collect();
        let x = Tensor::from_data(TensorData::new(values, [1, 1, height, width]), &Device::flex());
        let found = upsampled(x).try_into_vec_as::<f32>().unwrap();
        for (idx, found) in found.into_iter().enumerate() {
            let (y, x) = (idx / (2 * width), idx % (2 * width));
            let scale = |target: usize, len: usize| (target * (len - 1)) as f32 / (2 * len - 1) as f32;
            assert!((found - value(scale(y, height), scale(x, width))).abs() < ROUNDING, "{y} {x}");
        }
    }

    #[test]
    fn doubling_one_pixel_repeats_it() {
        let x = Tensor::from_data(TensorData::new(vec![7.0_f32], [1, 1, 1, 1]), &Device::flex());
        assert_eq!(upsampled(x).try_into_vec_as::<f32>().unwrap(), [7.0; 4]);
    }
}
