//! An encoder that stays as it is: off the tape, on CPUs in crate `engine`, and what it made of a picture may be kept.

use crate::Error;
use crate::batch::PairImages;
use crate::run::checkpoint::host_values;
use blake3::Hash;
use burn_tensor::Device;
use selenograph_engine::{Encoder, Image};
use selenograph_model::{Features, Grid, Images, Model};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of a number.
const FLOAT: usize = size_of::<f32>();

/// The blocks of one model's encoder. It lives as long as their weights are the same, and so does what it keeps.
pub(crate) struct FrozenEncoder {
    /// On a CPU; elsewhere the model computes them itself.
    engine: Option<Encoder>,
    kept: Option<Mutex<Kept>>,
}

/// Encodings of the pictures that came first, by what is in the picture. Nothing makes room for others: when every
/// picture comes once an epoch, in any order, the last one used is no likelier to come next than the first.
struct Kept {
    values: HashMap<Hash, Arc<[f32]>>,
    free_bytes: usize,
}

impl FrozenEncoder {
    /// Of a model without a stem, keeping encodings of up to `cache_bytes`.
    pub fn new(model: &Model, cache_bytes: usize) -> Result<Self, Error> {
        let mut source = |name: &str| {
            let parameter =
                model.parameters().get(name).ok_or_else(|| format!("the model has no `{name}`"))?;
            Ok((parameter.spec().shape.clone(), host_values(parameter.value())))
        };
        let is_cpu = selenograph_model::device::is_cpu(&model.device());
        let engine = is_cpu.then(|| Encoder::new(model.config(), &mut source)).transpose()?;
        let kept = || Mutex::new(Kept { values: HashMap::new(), free_bytes: cache_bytes });
        Ok(Self { engine, kept: (cache_bytes > 0).then(kept) })
    }

    /// What the encoder's blocks know of the pictures; `model` is the one that it was made of.
    pub fn features(&self, model: &Model, images: &PairImages) -> Result<Features, Error> {
        if self.engine.is_none() && self.kept.is_none() {
            return Ok(model.encode_blocks(&stored(images, &model.device())?)?);
        }
        let count = images.portrait.len();
        let keys = self.kept.as_ref().map(|_| (0..count).map(|place| key(images, place)).collect::<Vec<_>>());
        let mut found: Vec<Option<Arc<[f32]>>> = match (&self.kept, &keys) {
            (Some(kept), Some(keys)) => {
                let kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
                keys.iter().map(|key| kept.values.get(key).cloned()).collect()
            }
            _ => vec![None; count],
        };
        let missing: Vec<usize> = (0..count).filter(|place| found[*place].is_none()).collect();
        if !missing.is_empty() {
            for (place, encoded) in missing.iter().zip(self.encoded(model, images, &missing)?) {
                if let (Some(kept), Some(keys)) = (&self.kept, &keys) {
                    kept.lock().unwrap_or_else(PoisonError::into_inner).push(keys[*place], &encoded);
                }
                found[*place] = Some(encoded);
            }
        }
        let patch = model.config().patch_px;
        let [rows, columns] = images.size.map(|side| side / patch);
        let grid = Grid { rows, columns, transposed: images.portrait.clone() };
        let values = found.iter().flatten().flat_map(|one| one.iter().copied()).collect();
        Ok(Features::from_values(values, grid, model.config().encoder.dim, &model.device())?)
    }

    /// The tokens of the pictures at these places, in the order of the upright patches.
    fn encoded(
        &self,
        model: &Model,
        images: &PairImages,
        places: &[usize],
    ) -> Result<Vec<Arc<[f32]>>, Error> {
        let Some(engine) = &self.engine else {
            let features = model.encode_blocks(&stored(&images.select(places), &model.device())?)?;
            let values = host_values(&features.values);
            return Ok(values.chunks(values.len() / places.len()).map(Arc::from).collect());
        };
        let upright: Vec<_> = places.iter().map(|place| images.upright(*place)).collect();
        let pictures: Vec<_> = upright
            .iter()
            .map(|([height_px, width_px], values)| Image {
                height_px: *height_px,
                width_px: *width_px,
                values,
            })
            .collect();
        Ok(engine.encode(&pictures)?.into_iter().map(Arc::from).collect())
    }
}

impl Kept {
    fn push(&mut self, key: Hash, values: &Arc<[f32]>) {
        let bytes = FLOAT * values.len();
        if bytes <= self.free_bytes && self.values.insert(key, values.clone()).is_none() {
            self.free_bytes -= bytes;
        }
    }
}

/// The pictures as the model takes them.
pub(crate) fn stored(images: &PairImages, device: &Device) -> Result<Images, Error> {
    let [height, width] = images.size;
    let true_size = |portrait: &bool| if *portrait { [width, height] } else { [height, width] };
    let true_sizes: Vec<_> = images.portrait.iter().map(true_size).collect();
    Ok(Images::stored_landscape(images.values.clone(), images.size, &true_sizes, device)?)
}

/// Of all that decides what the encoder makes of a picture: its size, how it is stored, its values.
fn key(images: &PairImages, place: usize) -> Hash {
    let mut hasher = blake3::Hasher::new();
    for side in images.size {
        hasher.update(&(side as u64).to_le_bytes());
    }
    hasher.update(&[u8::from(images.portrait[place])]);
    let bytes: Vec<u8> = images.picture(place).iter().flat_map(|value| value.to_le_bytes()).collect();
    hasher.update(&bytes).finalize()
}
