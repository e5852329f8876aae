//! The networks of crate `model`, to be trained.

use crate::Error;
use crate::activations;
use crate::batch::{PairImages, ViewOutput};
use crate::frozen::{FrozenEncoder, stored};
use crate::network::{Changes, Gradients, PairNetwork};
use burn_tensor::{Device, Tensor};
use selenograph_model::{Features, Inputs, Model, Output, Parameter, SavedActivations};
use selenograph_network::checkpoint;
use selenograph_network::layout::Part;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Which parameters stay as they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Frozen {
    /// All learn.
    None,
    /// The encoder's patches and blocks; its last norm learns.
    #[default]
    Encoder,
}

/// A network of crate `model` with what is written into the header of its file.
pub struct ModelNetwork {
    model: Model,
    frozen: Frozen,
    keep: SavedActivations,
    metadata: BTreeMap<String, String>,
    cache_bytes: usize,
    /// Made when it is first needed, and again after its weights were changed.
    encoder: Mutex<Option<Arc<FrozenEncoder>>>,
}

impl ModelNetwork {
    /// A model to be trained; `license` and `provenance` go into the header of its files.
    pub fn new(
        model: Model,
        frozen: Frozen,
        keep: SavedActivations,
        license: Option<&str>,
        provenance: &str,
    ) -> Self {
        let mut metadata = checkpoint::header(model.config(), license);
        metadata.insert(checkpoint::key::PROVENANCE.to_owned(), provenance.to_owned());
        Self { model, frozen, keep, metadata, cache_bytes: 0, encoder: Mutex::new(None) }
    }

    /// The same, keeping up to so many bytes of what a frozen encoder makes of pictures: for runs in which the same
    /// picture comes again.
    #[must_use]
    pub fn with_encoding_cache(self, cache_bytes: usize) -> Self {
        Self { cache_bytes, encoder: Mutex::new(None), ..self }
    }

    /// The same, whose files also say the longest side of the pictures that it learns from.
    #[must_use]
    pub fn with_input_px(mut self, side: usize) -> Self {
        self.metadata.insert(checkpoint::key::INPUT_PX.to_owned(), side.to_string());
        self
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    fn is_frozen(&self, parameter: &Parameter) -> bool {
        match self.frozen {
            Frozen::None => false,
            Frozen::Encoder => matches!(parameter.spec().part, Part::Stem | Part::PatchEmbed | Part::Encoder),
        }
    }

    fn trains(&self, parameter: &Parameter) -> bool {
        parameter.is_computed() && !self.is_frozen(parameter)
    }

    fn encodes_off_the_tape(&self) -> bool {
        self.frozen == Frozen::Encoder && self.model.config().stem_dims.is_none()
    }

    /// What a frozen encoder makes of the pictures; none where it learns, or where the heads read a stem's maps too.
    ///
    /// # Errors
    /// [`Error::Engine`], [`Error::Model`] for pictures that do not fit the network.
    pub fn features(&self, images: &PairImages) -> Result<Option<Features>, Error> {
        if !self.encodes_off_the_tape() {
            return Ok(None);
        }
        self.encoder()?.features(&self.model, images).map(Some)
    }

    /// The frozen encoder, made if need be: by one of the batches side by side, while the others wait.
    fn encoder(&self) -> Result<Arc<FrozenEncoder>, Error> {
        let mut slot = self.encoder.lock().unwrap_or_else(PoisonError::into_inner);
        match &*slot {
            Some(encoder) => Ok(encoder.clone()),
            None => {
                let made = Arc::new(FrozenEncoder::new(&self.model, self.cache_bytes)?);
                Ok(slot.insert(made).clone())
            }
        }
    }
}

/// Places of the first and second view of each item: every pair both ways.
fn both_ways(images: &PairImages) -> Vec<[usize; 2]> {
    (0..images.portrait.len()).map(|place| [place, place ^ 1]).collect()
}

fn views([a, b]: &[Output; 2]) -> Result<[ViewOutput; 2], Error> {
    Ok([view(a)?, view(b)?])
}

fn view(output: &Output) -> Result<ViewOutput, Error> {
    let missing = || Error::Batch {
        what: "the network's output",
        expected: "descriptors".into(),
        found: "a network without them".into(),
    };
    Ok(ViewOutput {
        points: output.points.clone(),
        confidence: output.confidence.clone(),
        descriptors: output.descriptors.clone().ok_or_else(missing)?,
        descriptor_confidence: output.descriptor_confidence.clone().ok_or_else(missing)?,
    })
}

impl PairNetwork for ModelNetwork {
    fn forward(&self, images: &PairImages) -> Result<[ViewOutput; 2], Error> {
        let encoding = match self.features(images)? {
            Some(features) => self.model.normalize(&features),
            None => self.model.encode(&stored(images, &self.device())?)?,
        };
        let [first, second] = [0, 1].map(|side| {
            let places: Vec<usize> = both_ways(images).iter().map(|pair| pair[side]).collect();
            encoding.select(&places)
        });
        views(&self.model.decode(&first?, &second?)?)
    }

    fn learn(
        &self,
        images: &PairImages,
        loss: &mut dyn FnMut(&[ViewOutput; 2]) -> Result<Tensor<1>, Error>,
    ) -> Result<Gradients, Error> {
        let features = self.features(images)?;
        let pixels;
        let inputs = match &features {
            Some(features) => Inputs::Features(features),
            None => {
                pixels = stored(images, &self.device())?;
                Inputs::Images(&pixels)
            }
        };
        let learned = self.model.learn(
            &|parameter| self.trains(parameter),
            inputs,
            &both_ways(images),
            self.keep,
            &mut |output| loss(&views(output)?),
        )?;
        let named = self.model.parameters().iter().zip(learned.gradients.iter());
        Ok(named.filter_map(|(one, gradient)| Some((one.name().to_owned(), gradient?.clone()))).collect())
    }

    fn visit(&self, visitor: &mut dyn FnMut(&str, &[usize], Tensor<1>)) {
        for parameter in self.model.parameters().iter() {
            visitor(parameter.name(), &parameter.spec().shape, parameter.value().clone());
        }
    }

    fn update(&mut self, changes: &mut Changes<'_>) -> Result<(), Error> {
        for idx in 0..self.model.parameters().len() {
            let parameter = self.model.parameters().at(idx);
            let value = parameter.value().clone();
            let changed = changes(parameter.name(), &parameter.spec().shape, value);
            if let Some(changed) = changed {
                if self.is_frozen(self.model.parameters().at(idx)) {
                    self.encoder.get_mut().unwrap_or_else(PoisonError::into_inner).take();
                }
                self.model.parameters_mut().set(idx, changed)?;
            }
        }
        Ok(())
    }

    fn device(&self) -> Device {
        self.model.device()
    }

    fn metadata(&self) -> BTreeMap<String, String> {
        self.metadata.clone()
    }

    fn learns(&self, name: &str) -> bool {
        self.model.parameters().get(name).is_some_and(|parameter| self.trains(parameter))
    }

    fn activation_bytes(&self, size: [usize; 2]) -> u64 {
        activations::floats(self.model.config(), self.frozen, self.keep, size) * 4
    }

    fn resident_bytes(&self) -> u64 {
        if !self.encodes_off_the_tape() {
            return 0;
        }
        // The engine's copy of the encoder's weights.
        let frozen = self.model.parameters().iter().filter(|parameter| self.is_frozen(parameter));
        let is_cpu = selenograph_model::device::is_cpu(&self.device());
        let packed: usize = if is_cpu { frozen.map(|parameter| 4 * parameter.spec().len()).sum() } else { 0 };
        (packed + self.cache_bytes) as u64
    }
}
