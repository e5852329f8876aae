//! A network, loaded once, and what it says of views.

use crate::encoded::EncodedView;
use crate::executor::Loaded;
use crate::gather::{Outputs, Seen, gather, nothing};
use crate::picture::Input;
use crate::progress::{Progress, Report, Step};
use crate::{Density, Error, Executor, Passes, PredictOptions, grid, picture};
use selenograph_engine::{HeadOutput, Image};
use selenograph_network::Checkpoint;
use selenograph_network::checkpoint::HeadCounts;
use selenograph_network::input::InputTransform;
use selenograph_network::model_string::Family;
use selenograph_reconstruct::View;
use selenograph_reconstruct::evidence::FocalKnowledge;
use selenograph_reconstruct::learned::LearnedInput;
use serde::Serialize;
use std::path::Path;

/// What a predictor is made of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct About {
    /// The checkpoint's file name.
    pub checkpoint: String,
    /// Its family.
    pub family: &'static str,
    /// Parameters of its network.
    pub parameters: usize,
    /// Licence of the weights, where the file states it.
    pub license: Option<String>,
    /// What runs it.
    pub executor: String,
    /// Whether it matches; if not, a pose comes from points only.
    pub has_descriptors: bool,
    /// What was assumed while reading the checkpoint, in sentences.
    pub notes: Vec<String>,
}

impl About {
    /// Of a checkpoint and what would run it; nothing is loaded.
    pub fn new(checkpoint: &Checkpoint, executor: &Executor) -> Self {
        let has_descriptors = checkpoint.config().descriptor_dim.is_some();
        let mut notes = checkpoint.notes().to_vec();
        if !has_descriptors {
            notes
                .push("it has no descriptors: there are no matches, and a pose comes from its points".into());
        }
        let name = checkpoint.path().file_name();
        Self {
            checkpoint: name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default(),
            family: checkpoint.family().name(),
            parameters: checkpoint.layout().num_parameters(),
            license: checkpoint.license().map(str::to_owned),
            executor: executor.describe(),
            has_descriptors,
            notes,
        }
    }

    /// In one line.
    pub fn sentence(&self) -> String {
        let license = self.license.as_deref().unwrap_or("not stated");
        let Self { checkpoint, family, parameters, executor, .. } = self;
        format!("{executor}: {family} `{checkpoint}`, {parameters} parameters, licence: {license}")
    }
}

/// A network that is ready to look at pictures.
pub struct Predictor {
    loaded: Loaded,
    options: PredictOptions,
    about: About,
}

/// What a network says of two views.
#[derive(Debug, Clone)]
pub struct Predicted {
    /// Points and matches on the pictures' grids, for [`selenograph_reconstruct::pipeline::reconstruct`].
    pub input: LearnedInput,
    /// What was done to either picture, in sentences.
    pub notes: [Vec<String>; 2],
}

impl Predictor {
    /// Reads a checkpoint and packs its weights.
    ///
    /// # Errors
    /// As [`Predictor::new`].
    pub fn open(path: &Path, heads: HeadCounts, options: &PredictOptions) -> Result<Self, Error> {
        Self::new(&Checkpoint::open_with(path, heads)?, options, &mut |_| {})
    }

    /// Packs the weights of a checkpoint; `progress` is told of every tensor.
    ///
    /// # Errors
    /// [`Error::Network`] for tensors that are missing or of another shape, by name; [`Error::NoPoints`] for a network without heads;
    /// [`Error::NoDescriptors`] where dense matches are asked for of one that does not match.
    pub fn new(
        checkpoint: &Checkpoint,
        options: &PredictOptions,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Self, Error> {
        let (path, family) = (checkpoint.path().to_owned(), checkpoint.family());
        if family == Family::Croco {
            return Err(Error::NoPoints { path, family: family.name() });
        }
        let about = About::new(checkpoint, &options.executor);
        if options.density == Density::Dense && !about.has_descriptors {
            return Err(Error::NoDescriptors { path, family: family.name() });
        }
        checkpoint.check_complete()?;
        let loaded = Loaded::new(checkpoint, &options.executor, progress)?;
        Ok(Self { loaded, options: options.clone(), about })
    }

    /// What it is made of.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// How it is run and matched.
    pub fn options(&self) -> &PredictOptions {
        &self.options
    }

    /// What it says of two views. With [`FocalKnowledge::Guessed`] the cameras' focal lengths are replaced by those that the
    /// points imply, one for both pictures if they have one size.
    ///
    /// # Errors
    /// [`Error::Network`] for a picture below one patch.
    pub fn predict(
        &self,
        views: &[View; 2],
        focal: FocalKnowledge,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Predicted, Error> {
        let encoded = self.encode(&views.each_ref(), progress)?;
        self.predict_encoded([&encoded[0], &encoded[1]], focal, progress)
    }

    /// Encodes views, together.
    ///
    /// # Errors
    /// [`Error::Network`] for a picture below one patch.
    pub fn encode(
        &self,
        views: &[&View],
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Vec<EncodedView>, Error> {
        let patch_px = self.loaded.config().patch_px;
        let inputs: Vec<Input> = views
            .iter()
            .map(|view| picture::input(&view.image, self.options.input, patch_px))
            .collect::<Result<_, _>>()?;
        let values: Vec<Vec<f32>> = inputs.iter().map(|input| input.image.to_input()).collect();
        let images: Vec<Image<'_>> = inputs
            .iter()
            .zip(&values)
            .map(|(input, values)| Image {
                height_px: input.image.height(),
                width_px: input.image.width(),
                values,
            })
            .collect();
        let encodings = self.loaded.encode(&images, progress)?;
        let all = encodings.into_iter().zip(inputs).zip(views);
        Ok(all
            .map(|((encoding, input), view)| EncodedView {
                camera: view.camera.clone(),
                transform: input.transform,
                encoding,
                is_blank: input.is_blank,
                notes: input.notes,
            })
            .collect())
    }

    /// What it says of two views that are encoded.
    ///
    /// # Errors
    /// [`Error::Engine`] for encodings of another network.
    pub fn predict_encoded(
        &self,
        [a, b]: [&EncodedView; 2],
        focal: FocalKnowledge,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Predicted, Error> {
        let notes = [a.notes.clone(), b.notes.clone()];
        let views = [Seen::of(a), Seen::of(b)];
        if a.is_blank || b.is_blank {
            // A network has an answer to blank paper too.
            return Ok(Predicted { input: nothing(views, focal, self.loaded.config().patch_px), notes });
        }
        let both_ways = self.options.passes == Passes::Symmetric || focal == FocalKnowledge::Guessed;
        let (forward, backward) = self.decode([a, b], both_ways, progress)?;
        progress(Progress { step: Step::Match, done: 0, of: 1 });
        let outputs = Outputs { forward: &forward, backward: backward.as_ref() };
        let input = gather(outputs, views, focal, self.loaded.config(), &self.options)?;
        progress(Progress { step: Step::Match, done: 1, of: 1 });
        Ok(Predicted { input, notes })
    }

    /// Outputs in the frame of A and, where asked for, in that of B; without padding.
    fn decode(
        &self,
        [a, b]: [&EncodedView; 2],
        both_ways: bool,
        progress: Report<'_>,
    ) -> Result<([HeadOutput; 2], Option<[HeadOutput; 2]>), Error> {
        let mut pairs = vec![(&a.encoding, &b.encoding)];
        if both_ways {
            pairs.push((&b.encoding, &a.encoding));
        }
        let mut outputs = self.loaded.decode(&pairs, progress)?.into_iter();
        let mut next = |first: &InputTransform, second: &InputTransform| {
            outputs.next().map(|[x, y]| [grid::without_padding(x, first), grid::without_padding(y, second)])
        };
        let wrong = || selenograph_engine::Error::Image {
            what: "number of decoded pairs",
            expected: pairs.len().to_string(),
            found: "0".into(),
        };
        let forward = next(&a.transform, &b.transform).ok_or_else(wrong)?;
        Ok((forward, next(&b.transform, &a.transform)))
    }
}
