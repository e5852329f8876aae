//! The configuration of a checkpoint: from its own header, else from its model string, else from the shapes.

use super::StoredTensor;
use crate::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};
use crate::model_string::{Family, ModelString};
use crate::{Error, Preset};
use std::collections::BTreeMap;
use std::path::Path;

/// Channels of an attention head in every published network of the family.
const USUAL_HEAD_DIM: usize = 64;
/// Side of a patch and width of an MLP in every published network.
const USUAL_PATCH_PX: usize = 16;
const USUAL_MLP_RATIO: usize = 4;

/// Numbers of attention heads, for files that do not tell them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct HeadCounts {
    /// Of the encoder.
    pub encoder: Option<usize>,
    /// Of the decoders.
    pub decoder: Option<usize>,
}

pub(super) struct Deduced {
    pub family: Family,
    pub config: NetworkConfig,
    pub notes: Vec<String>,
}

/// The configuration in a header that we wrote.
pub(super) fn stored(text: &str, path: &Path) -> Result<Deduced, Error> {
    let config: NetworkConfig = serde_json::from_str(text)
        .map_err(|error| Error::malformed(path, "configuration", "that of a network", error.to_string()))?;
    let family = if config.descriptor_dim.is_some() { Family::Mast3r } else { Family::Dust3r };
    Ok(Deduced { family, config, notes: Vec::new() })
}

pub(super) fn deduce(
    tensors: &BTreeMap<String, StoredTensor>,
    model: Option<&ModelString>,
    heads: HeadCounts,
    path: &Path,
) -> Result<Deduced, Error> {
    let mut deducer = Deducer { tensors, model, path, notes: Vec::new() };
    let family = deducer.family()?;
    let patch_px = deducer.patch_px()?;
    let encoder = deducer.transformer(&ENCODER, heads.encoder)?;
    let decoder = deducer.transformer(&DECODER, heads.decoder)?;
    let mut config = NetworkConfig { patch_px, encoder, decoder, ..Preset::Mast3rVitl.config() };
    deducer.points(&mut config, family);
    deducer.descriptors(&mut config, family)?;
    deducer.modes(&mut config);
    Ok(Deduced { family, config, notes: deducer.notes })
}

/// Where a transformer's sizes stand in the model string and in the tensors.
struct Place {
    what: &'static str,
    blocks: &'static str,
    embedding: &'static str,
    sizes: fn(&ModelString) -> [Option<usize>; 3],
}

const ENCODER: Place = Place {
    what: "encoder",
    blocks: "enc_blocks.",
    embedding: "patch_embed.proj.weight",
    sizes: |model| [model.encoder_dim, model.encoder_blocks, model.encoder_heads],
};
const DECODER: Place = Place {
    what: "decoder",
    blocks: "dec_blocks.",
    embedding: "decoder_embed.weight",
    sizes: |model| [model.decoder_dim, model.decoder_blocks, model.decoder_heads],
};

struct Deducer<'a> {
    tensors: &'a BTreeMap<String, StoredTensor>,
    model: Option<&'a ModelString>,
    path: &'a Path,
    notes: Vec<String>,
}

impl Deducer<'_> {
    fn has(&self, part: &str) -> bool {
        self.tensors.keys().any(|name| name.contains(part))
    }

    fn side(&self, name: &str, side: usize) -> Option<usize> {
        self.tensors.get(name)?.shape.get(side).copied()
    }

    fn unknown(&self, what: &str) -> Error {
        Error::Unknown { path: self.path.to_owned(), what: what.to_owned() }
    }

    fn family(&mut self) -> Result<Family, Error> {
        if !self.has("enc_blocks.") && self.model.is_none() {
            return Err(Error::NotACheckpoint {
                path: self.path.to_owned(),
                expected: "tensors of the MASt3R family (`enc_blocks`, `dec_blocks`, `downstream_head1`)",
                found: format!("{} other tensors", self.tensors.len()),
            });
        }
        let by_tensors = if self.has(".head_local_features.") {
            Family::Mast3r
        } else if self.has("downstream_head") {
            Family::Dust3r
        } else {
            Family::Croco
        };
        let family = self.model.map_or(by_tensors, |model| model.family);
        match family {
            Family::Mast3r => {}
            Family::Dust3r => {
                self.notes.push("DUSt3R: points and their confidence, no descriptors".into());
            }
            Family::Croco => {
                self.notes.push("CroCo: encoder and decoder, no heads; these are as in mast3r-vitl".into());
            }
        }
        Ok(family)
    }

    fn patch_px(&mut self) -> Result<usize, Error> {
        let stated = self.model.and_then(|model| model.patch_px);
        if let Some(side) = stated.or_else(|| self.side("patch_embed.proj.weight", 2)) {
            return Ok(side);
        }
        if self.model.is_none() {
            return Err(self.unknown("the size of a patch"));
        }
        self.notes.push(format!("size of a patch not stated: {USUAL_PATCH_PX} pixels assumed"));
        Ok(USUAL_PATCH_PX)
    }

    fn transformer(&mut self, place: &Place, heads: Option<usize>) -> Result<Transformer, Error> {
        let what = place.what;
        let [dim, blocks, stated_heads] = self.model.map_or([None; 3], place.sizes);
        let dim = dim.or_else(|| self.side(place.embedding, 0));
        let dim = dim.ok_or_else(|| self.unknown(&format!("how wide the {what} is")))?;
        let indices = self
            .tensors
            .keys()
            .filter_map(|name| name.strip_prefix(place.blocks)?.split('.').next()?.parse::<usize>().ok());
        let num_blocks = blocks.or_else(|| indices.max().map(|last| last.saturating_add(1)));
        let num_blocks =
            num_blocks.ok_or_else(|| self.unknown(&format!("how many blocks the {what} has")))?;
        let first_mlp = format!("{}0.mlp.fc1.weight", place.blocks);
        let stated_mlp = self.model.and_then(|model| model.mlp_ratio).map(|ratio| ratio.saturating_mul(dim));
        let mlp_dim =
            stated_mlp.or_else(|| self.side(&first_mlp, 0)).unwrap_or(dim.saturating_mul(USUAL_MLP_RATIO));
        let num_heads = match heads.or(stated_heads) {
            Some(heads) => heads,
            None if dim.is_multiple_of(USUAL_HEAD_DIM) && dim > 0 => {
                let heads = dim / USUAL_HEAD_DIM;
                let note =
                    format!("number of the {what}'s heads not stated: {heads} assumed, 64 channels each");
                self.notes.push(note);
                heads
            }
            None => return Err(self.unknown(&format!("how many heads the {what} has ({dim} channels)"))),
        };
        Ok(Transformer { dim, num_blocks, num_heads, mlp_dim })
    }

    /// Widths of the DPT heads, which no model string tells; the published ones where there are no heads.
    fn points(&self, config: &mut NetworkConfig, family: Family) {
        if family == Family::Croco {
            return;
        }
        for head in ["downstream_head1.dpt", "downstream_head2.dpt"] {
            for (level, dim) in config.dpt_dims.iter_mut().enumerate() {
                let name = format!("{head}.act_postprocess.{level}.0.weight");
                *dim = self.side(&name, 0).unwrap_or(*dim);
            }
            let fusion = self.side(&format!("{head}.scratch.refinenet1.out_conv.weight"), 0);
            config.dpt_fusion_dim = fusion.unwrap_or(config.dpt_fusion_dim);
            let last = self.side(&format!("{head}.head.2.weight"), 0);
            config.dpt_last_dim = last.unwrap_or(config.dpt_last_dim);
            if fusion.is_some() {
                break;
            }
        }
    }

    /// The MLP gives the descriptor and, after it, its confidence for each pixel of a patch.
    fn descriptors(&self, config: &mut NetworkConfig, family: Family) -> Result<(), Error> {
        if family != Family::Mast3r {
            config.descriptor_dim = None;
            config.descriptor_confidence = None;
            return Ok(());
        }
        let stated = self.model.and_then(|model| model.descriptor_dim);
        let two = self.model.and_then(|model| model.two_confidences);
        let rows = self.side("downstream_head1.head_local_features.fc2.weight", 0);
        let area = config.patch_px.saturating_mul(config.patch_px).max(1);
        let channels = rows.filter(|rows| rows.is_multiple_of(area)).map(|rows| rows / area);
        let two = two.or_else(|| Some(channels? == stated? + 1)).unwrap_or(true);
        let dim = stated.or_else(|| channels?.checked_sub(usize::from(two)));
        config.descriptor_dim = Some(dim.ok_or_else(|| self.unknown("how many channels a descriptor has"))?);
        let mode = self.model.and_then(|model| model.descriptor_confidence);
        config.descriptor_confidence = two.then(|| mode.or(config.descriptor_confidence)).flatten();
        Ok(())
    }

    fn modes(&mut self, config: &mut NetworkConfig) {
        let mut silent = Vec::new();
        let mut note = |stated: bool, what: &'static str| {
            if !stated {
                silent.push(what);
            }
        };
        let rope = self.model.and_then(|model| model.rope_base);
        let depth_mode = self.model.and_then(|model| model.depth_mode);
        let confidence = self.model.and_then(|model| model.confidence);
        note(rope.is_some(), "base 100 of the rotary positions");
        note(depth_mode.is_some(), "distance `exp`");
        note(confidence.is_some(), "confidence from 1 on, `exp`");
        config.rope_base = rope.unwrap_or(config.rope_base);
        config.depth_mode = depth_mode.unwrap_or(DepthMode::Exp);
        config.confidence = confidence.unwrap_or(ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY });
        if !silent.is_empty() {
            self.notes.push(format!("not stated, assumed as published: {}", silent.join(", ")));
        }
    }
}
