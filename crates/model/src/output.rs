//! What a head says about its view: from raw channels to points, confidences and descriptors.

use burn_tensor::Tensor;
use selenograph_network::NetworkConfig;
use selenograph_network::config::{ConfidenceMode, DepthMode};

use crate::dpt::upsampled;
use crate::scope::Scope;
use crate::views::{Grid, StemMaps, gather, select};

/// Shortest length that gives a direction.
const MIN_LENGTH: f64 = 1e-8;

/// What the network says about a batch of views, pixel by pixel as the images are stored.
#[derive(Debug, Clone)]
pub struct Output {
    /// Points in the frame of the first view's camera (OpenCV axes), `[images, height, width, 3]`.
    pub points: Tensor<4>,
    /// Their confidence, `[images, height, width]`.
    pub confidence: Tensor<3>,
    /// Unit descriptors, `[images, height, width, channels]`; none where the network has no descriptor head.
    pub descriptors: Option<Tensor<4>>,
    /// Their confidence, `[images, height, width]`; that of the points where the network has none of its own.
    pub descriptor_confidence: Option<Tensor<3>>,
}

impl Output {
    /// Upright views as they are stored.
    fn transposed(self) -> Self {
        Self {
            points: self.points.swap_dims(1, 2),
            confidence: self.confidence.swap_dims(1, 2),
            descriptors: self.descriptors.map(|each| each.swap_dims(1, 2)),
            descriptor_confidence: self.descriptor_confidence.map(|each| each.swap_dims(1, 2)),
        }
    }

    fn gathered(groups: &[(bool, Vec<usize>)], parts: Vec<Self>) -> Self {
        let all = |of: &dyn Fn(&Self) -> Option<Tensor<4>>| -> Option<Tensor<4>> {
            Some(gather(groups, parts.iter().map(of).collect::<Option<Vec<_>>>()?))
        };
        let flat = |of: &dyn Fn(&Self) -> Option<Tensor<3>>| -> Option<Tensor<3>> {
            Some(gather(groups, parts.iter().map(of).collect::<Option<Vec<_>>>()?))
        };
        let points = gather(groups, parts.iter().map(|part| part.points.clone()).collect());
        let confidence = gather(groups, parts.iter().map(|part| part.confidence.clone()).collect());
        let descriptors = all(&|part| part.descriptors.clone());
        let descriptor_confidence = flat(&|part| part.descriptor_confidence.clone());
        Self { points, confidence, descriptors, descriptor_confidence }
    }
}

/// What a head reads: tokens at the four hooks, and the maps of the stem if there is one.
pub(crate) struct HeadInputs<'a> {
    pub hooks: [Tensor<3>; 4],
    pub maps: Option<&'a StemMaps>,
}

/// One view's head at `downstream_headN`, for images of any orientations.
pub(crate) fn head(
    at: &Scope<'_>,
    label: &str,
    config: &NetworkConfig,
    inputs: &HeadInputs<'_>,
    grid: &Grid,
) -> Output {
    let groups = grid.groups();
    let parts = groups
        .iter()
        .map(|(transposed, places)| {
            let hooks = inputs.hooks.each_ref().map(|hook| select(hook.clone(), places));
            let upright = |map: &Tensor<4>| {
                let own = select(map.clone(), places);
                if *transposed { own.swap_dims(2, 3) } else { own }
            };
            let maps = inputs.maps.map(|maps| maps.each_ref().map(upright));
            let own = HeadInputs { hooks, maps: maps.as_ref() };
            let output = upright_head(at, label, config, &own, grid.upright(*transposed));
            if *transposed { output.transposed() } else { output }
        })
        .collect();
    Output::gathered(&groups, parts)
}

fn upright_head(
    at: &Scope<'_>,
    label: &str,
    config: &NetworkConfig,
    HeadInputs { hooks, maps }: &HeadInputs<'_>,
    [rows, columns]: [usize; 2],
) -> Output {
    let [map, features] = crate::dpt::dpt(&at.under("dpt"), label, hooks, *maps, [rows, columns]);
    let points = points(config.depth_mode, map.clone().narrow(1, 0, 3)).permute([0, 2, 3, 1]);
    let confidence = confidence(config.confidence, map.narrow(1, 3, 1).squeeze_dim(1));
    let (Some(dim), Some(channels)) = (config.descriptor_dim, config.descriptor_channels()) else {
        return Output { points, confidence, descriptors: None, descriptor_confidence: None };
    };
    let pixels =
        if maps.is_some() {
            upsampled(at.exact().conv1("head_local_features", features)).permute([0, 2, 3, 1])
        } else {
            let both = Tensor::cat(vec![hooks[0].clone(), hooks[3].clone()], 2);
            let raw = at.mlp("head_local_features", both);
            at.see(|| format!("{label}.mlp_out"), &raw);
            let (images, patch) = (raw.dims()[0], config.patch_px);
            raw.reshape([images, rows, columns, channels, patch, patch])
                .permute([0, 1, 4, 2, 5, 3])
                .reshape([images, rows * patch, columns * patch, channels])
        };
    let vectors = pixels.clone().narrow(3, 0, dim);
    let lengths = vectors.clone().square().sum_dim(3).sqrt();
    let own = config.descriptor_confidence.map(|mode| {
        let raw: Tensor<3> = pixels.narrow(3, dim, 1).squeeze_dim(3);
        self::confidence(mode, raw)
    });
    Output {
        points,
        descriptors: Some(vectors / lengths),
        descriptor_confidence: Some(own.unwrap_or_else(|| confidence.clone())),
        confidence,
    }
}

/// Points from raw vectors, `[images, 3, height, width]`.
fn points(mode: DepthMode, raw: Tensor<4>) -> Tensor<4> {
    if mode == DepthMode::Linear {
        return raw;
    }
    // The bound on the square keeps the derivative of the root finite.
    let length = raw.clone().square().sum_dim(1).clamp_min(MIN_LENGTH * MIN_LENGTH).sqrt();
    let factor = match mode {
        DepthMode::Linear | DepthMode::Square => length,
        DepthMode::Exp => (length.clone().exp() - 1.0) / length,
    };
    raw * factor
}

/// Confidences from raw channels.
fn confidence(mode: ConfidenceMode, raw: Tensor<3>) -> Tensor<3> {
    match mode {
        ConfidenceMode::Exp { min, max } if max.is_infinite() => raw.exp() + min,
        ConfidenceMode::Exp { min, max } => raw.exp().clamp_max(max - min) + min,
        ConfidenceMode::Sigmoid { min, max } => burn_tensor::activation::sigmoid(raw) * (max - min) + min,
    }
}
