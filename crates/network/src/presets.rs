//! Networks that have a name.
//!
//! | preset | encoder | decoders | DPT levels, fusion, last | descriptor MLP | parameters |
//! | --- | --- | --- | --- | --- | --- |
//! | `mast3r-vitl` | 1024 × 24, 16 heads | 768 × 12, 12 heads | 96 192 384 768, 256, 128 | 1792 → 7168 | 688 638 856 |
//! | `base` | 768 × 12, 12 heads | 512 × 8, 8 heads | 72 144 288 576, 192, 96 (¾) | 1280 → 5120 | 254 589 992 |
//! | `small` | 384 × 12, 6 heads | 256 × 6, 4 heads | 48 96 192 384, 128, 64 (½) | 640 → 2560 | 80 319 816 |
//! | `tiny` | 128 × 4, 4 heads | 96 × 4, 3 heads | 24 48 96 192, 64, 32 (¼) | 224 → 896 | 16 442 728 |
//! | `hybrid` | stem 24 48 96, 192 × 6, 6 heads | 128 × 4, 4 heads | 24 48 96 128, 48, 48 | none | 6 560 778 |
//!
//! `hybrid` is ours: a convolutional stem makes its tokens, and its descriptors come from the dense heads.
//!
//! All have patches of 16 pixels, descriptors of 24 channels with a confidence of their own, MLPs four times as wide as
//! their tokens, and the modes of the published network. The factor is that of the DPT heads' widths.

use crate::Error;
use crate::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};

/// A network that has a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// The published MASt3R: ViT-L encoder, base decoders.
    Mast3rVitl,
    /// A student of about a third.
    Base,
    /// A student of about a tenth.
    Small,
    /// For tests and demonstrations.
    Tiny,
    /// Convolutions near the pixels, transformers above: learns from few pairs, for pictures of some 200 pixels.
    Hybrid,
}

impl Preset {
    /// All of them, the largest first.
    pub const ALL: [Self; 5] = [Self::Mast3rVitl, Self::Base, Self::Small, Self::Tiny, Self::Hybrid];

    /// The name that is typed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mast3rVitl => "mast3r-vitl",
            Self::Base => "base",
            Self::Small => "small",
            Self::Tiny => "tiny",
            Self::Hybrid => "hybrid",
        }
    }

    /// The preset of that name.
    ///
    /// # Errors
    /// [`Error::UnknownPreset`].
    pub fn from_name(name: &str) -> Result<Self, Error> {
        let known = Self::ALL.into_iter().find(|preset| preset.name() == name);
        known.ok_or_else(|| Error::UnknownPreset { name: name.to_owned() })
    }

    /// Its dimensions.
    pub fn config(self) -> NetworkConfig {
        match self {
            Self::Mast3rVitl => config((1024, 24, 16), (768, 12, 12), 4),
            Self::Base => config((768, 12, 12), (512, 8, 8), 3),
            Self::Small => config((384, 12, 6), (256, 6, 4), 2),
            Self::Tiny => config((128, 4, 4), (96, 4, 3), 1),
            Self::Hybrid => NetworkConfig {
                stem_dims: Some([24, 48, 96]),
                dpt_dims: [24, 48, 96, 128],
                dpt_fusion_dim: 48,
                dpt_last_dim: 48,
                ..config((192, 6, 6), (128, 4, 4), 1)
            },
        }
    }
}

/// Channels, blocks and heads of encoder and decoder; quarters of the published DPT widths.
fn config(encoder: (usize, usize, usize), decoder: (usize, usize, usize), quarters: usize) -> NetworkConfig {
    let transformer =
        |(dim, num_blocks, num_heads)| Transformer { dim, num_blocks, num_heads, mlp_dim: 4 * dim };
    NetworkConfig {
        patch_px: 16,
        stem_dims: None,
        encoder: transformer(encoder),
        decoder: transformer(decoder),
        rope_base: 100.0,
        dpt_dims: [24, 48, 96, 192].map(|dim| dim * quarters),
        dpt_fusion_dim: 64 * quarters,
        dpt_last_dim: 32 * quarters,
        descriptor_dim: Some(24),
        depth_mode: DepthMode::Exp,
        confidence: ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY },
        descriptor_confidence: Some(ConfidenceMode::Exp { min: 0.0, max: f64::INFINITY }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Layout;

    #[test]
    fn every_preset_has_the_parameters_that_are_stated() {
        let stated = [688_638_856, 254_589_992, 80_319_816, 16_442_728, 6_560_778];
        for (preset, expected) in Preset::ALL.into_iter().zip(stated) {
            let config = preset.config();
            config.check().unwrap();
            assert_eq!(Layout::new(&config).unwrap().num_parameters(), expected, "{}", preset.name());
            assert_eq!(Preset::from_name(preset.name()).unwrap(), preset);
        }
        assert!(Preset::from_name("huge").is_err());
    }

    #[test]
    fn a_configuration_survives_json_with_its_infinities() {
        let config = Preset::Small.config();
        let text = serde_json::to_string(&config).unwrap();
        assert_eq!(serde_json::from_str::<NetworkConfig>(&text).unwrap(), config, "{text}");
    }

    #[test]
    fn headers_from_before_there_were_stems_are_read() {
        let (tiny, hybrid) = (Preset::Tiny.config(), Preset::Hybrid.config());
        let [old, new] = [&tiny, &hybrid].map(|config| serde_json::to_string(config).unwrap());
        assert!(!old.contains("stem_dims") && new.contains(r#""stem_dims":[24,48,96]"#), "{old} {new}");
        for (text, config) in [(old, tiny), (new, hybrid)] {
            assert_eq!(serde_json::from_str::<NetworkConfig>(&text).unwrap(), config);
        }
    }

    #[test]
    fn dimensions_that_no_network_has_are_refused() {
        let broken: [fn(&mut NetworkConfig); 9] = [
            |config| config.encoder.num_heads = 0,
            |config| config.encoder.num_heads = 5,
            |config| config.decoder.dim = usize::MAX,
            |config| config.decoder.num_blocks = 1 << 40,
            |config| config.dpt_fusion_dim = 0,
            |config| config.descriptor_dim = Some(0),
            |config| config.stem_dims = Some([24, 0, 96]),
            |config| config.stem_dims = Some([24, 48, usize::MAX]),
            // The maps of a stem have no place in the heads of another patch size.
            |config| (config.patch_px, config.stem_dims) = (32, Some([24, 48, 96])),
        ];
        for spoil in broken {
            let mut config = Preset::Tiny.config();
            spoil(&mut config);
            assert!(config.check().is_err(), "{config:?}");
            assert!(Layout::new(&config).is_err());
        }
    }
}
