//! Which configurations the layers can run.

use selenograph_network::config::NetworkConfig;

use crate::error::{Error, Result};

/// What the layers take for granted.
pub(crate) fn check(config: &NetworkConfig) -> Result<()> {
    let wrong = |what, expected: &str, found: String| {
        Err(Error::Config { what, expected: expected.to_owned(), found })
    };
    if config.patch_px != 16 {
        // The dense heads enlarge sixteen times.
        return wrong("patch_px", "16", config.patch_px.to_string());
    }
    for shape in [&config.encoder, &config.decoder] {
        let heads = shape.num_heads;
        if heads == 0 || shape.dim % heads != 0 || (shape.dim / heads) % 4 != 0 || shape.dim == 0 {
            let found = format!("{} channels in {heads} heads", shape.dim);
            return wrong("transformer", "heads of a multiple of four channels", found);
        }
        if shape.num_blocks == 0 || shape.mlp_dim == 0 {
            return wrong("transformer", "at least one block", format!("{shape:?}"));
        }
    }
    if config.decoder.num_blocks < 4 {
        let found = config.decoder.num_blocks.to_string();
        return wrong("decoder.num_blocks", "four or more, for the heads' four levels", found);
    }
    let widths = [config.dpt_fusion_dim, config.dpt_last_dim, config.descriptor_dim.unwrap_or(1)];
    if config.dpt_dims.iter().chain(&widths).any(|width| *width == 0) {
        return wrong("heads", "positive widths", format!("{:?} {widths:?}", config.dpt_dims));
    }
    if let Some(dims) = config.stem_dims.filter(|dims| dims.contains(&0)) {
        return wrong("stem_dims", "positive widths", format!("{dims:?}"));
    }
    if !(config.rope_base > 1.0 && config.rope_base.is_finite()) {
        return wrong("rope_base", "a number above 1", config.rope_base.to_string());
    }
    Ok(())
}
