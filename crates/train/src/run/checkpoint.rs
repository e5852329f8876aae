//! Checkpoints: a folder each, complete as soon as it has its name.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `weights.safetensors` | the network, as every command reads it |
//! | `optimizer.safetensors` | means and mean squares of the gradients, `mean.<name>` and `square.<name>` |
//! | `average.safetensors` | averaged weights, where they are kept |
//! | `state.json` | where the run stands |
//!
//! All else that is random or ordered follows from the seed and the number of batches taken.

use crate::Error;
use crate::network::PairNetwork;
use crate::optimizer::{AdamW, AdamWSettings, LossScale, Moments, WeightAverage};
use burn_tensor::{Device, Tensor, TensorData};
use selenograph_files::{FileDraft, FolderDraft, clear_drafts, regular};
use selenograph_network::ElementType;
use selenograph_network::checkpoint::TensorFile;
use selenograph_network::safetensors::{Entry, Writer};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const WEIGHTS: &str = "weights.safetensors";
const OPTIMIZER: &str = "optimizer.safetensors";
const AVERAGE: &str = "average.safetensors";
const STATE: &str = "state.json";
/// Begins the name of a checkpoint's folder.
const PREFIX: &str = "step-";

/// Where a run stands.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    /// Steps made.
    pub step: u64,
    /// Steps of the whole run; `None` as long as a budget of time has not been sized.
    pub total_steps: Option<u64>,
    /// Where the schedule stood when a budget was last sized.
    #[serde(default)]
    pub sized: Anchor,
    /// Batches taken from the source.
    pub batches: u64,
    /// Seconds of training, earlier sittings included.
    pub elapsed_s: f64,
    /// Factor on the loss, where it is scaled.
    pub loss_scale: Option<LossScale>,
    /// Smallest score of a validation.
    pub best_score: Option<f64>,
    /// Steps of each parameter that had a gradient.
    pub parameter_steps: BTreeMap<String, u64>,
}

/// A step, and the fractional epoch of the schedule after it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Anchor {
    /// The step.
    pub step: u64,
    /// The epoch.
    pub epoch: f64,
}

/// The checkpoints of a run.
#[derive(Debug, Clone)]
pub struct Checkpoints {
    folder: PathBuf,
    keep: usize,
}

/// What a checkpoint is made of.
pub(crate) struct Saved<'a> {
    /// The network.
    pub network: &'a dyn PairNetwork,
    /// Its optimiser.
    pub optimizer: &'a AdamW,
    /// Its averaged weights.
    pub average: Option<&'a WeightAverage>,
    /// Where the run stands; the steps of the parameters are filled in.
    pub state: RunState,
}

impl Checkpoints {
    /// Those in `folder`, of which the last `keep` are kept.
    pub fn new(folder: PathBuf, keep: usize) -> Self {
        Self { folder, keep: keep.max(1) }
    }

    /// Writes one beside the others, gives it its name when it is whole, and drops the oldest.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Network`]; the others stay as they are.
    pub(crate) fn save(&self, mut saved: Saved<'_>) -> Result<PathBuf, Error> {
        let target = self.folder.join(format!("{PREFIX}{:08}", saved.state.step));
        // What a sitting that was killed did not finish.
        clear_drafts(&self.folder, |_| true)?;
        let draft = FolderDraft::beside(&target)?;
        let moments = saved.optimizer.moments();
        saved.state.parameter_steps = moments.iter().map(|(name, one)| (name.clone(), one.steps)).collect();
        write_all(draft.path(), &saved)?;
        remove(&target)?;
        draft.commit()?;
        for old in self.list()?.iter().rev().skip(self.keep) {
            remove(old)?;
        }
        Ok(target)
    }

    /// Keeps a copy of `checkpoint`'s weights (the averaged ones, where there are) under another name.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn keep_weights(&self, checkpoint: &Path, name: &str) -> Result<(), Error> {
        let average = checkpoint.join(AVERAGE);
        let source = if average.exists() { average } else { checkpoint.join(WEIGHTS) };
        let target = self.folder.join(name);
        let mut draft = FileDraft::new(&target)?;
        let copied = std::fs::File::open(&source).and_then(|mut file| std::io::copy(&mut file, &mut draft));
        copied.map_err(selenograph_files::Error::io("write", &target))?;
        Ok(draft.commit()?)
    }

    /// The whole ones, oldest first.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn list(&self) -> Result<Vec<PathBuf>, Error> {
        if !self.folder.exists() {
            return Ok(Vec::new());
        }
        let entries = std::fs::read_dir(&self.folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let entries = entries.map_err(Error::io("read", &self.folder))?;
        let named = entries.iter().filter(|entry| entry.file_name().to_string_lossy().starts_with(PREFIX));
        let mut found: Vec<PathBuf> = named.map(std::fs::DirEntry::path).collect();
        found.sort();
        Ok(found)
    }

    /// The weights of the last one, for a network that is made of them.
    ///
    /// # Errors
    /// [`Error::Resume`] if there is none.
    pub fn last_weights(&self) -> Result<PathBuf, Error> {
        Ok(self.last()?.join(WEIGHTS))
    }

    /// The last one.
    pub(super) fn last(&self) -> Result<PathBuf, Error> {
        self.list()?
            .pop()
            .ok_or_else(|| Error::Resume { path: self.folder.clone(), what: "it holds no checkpoint".into() })
    }

    /// Where the last one stands.
    ///
    /// # Errors
    /// [`Error::Resume`], [`Error::Io`].
    pub fn last_state(&self) -> Result<RunState, Error> {
        let path = self.last()?.join(STATE);
        let text = regular::read_to_string(&path).map_err(Error::io("read", &path))?;
        serde_json::from_str(&text).map_err(|error| Error::Resume { path, what: error.to_string() })
    }

    /// The optimiser of the last one.
    ///
    /// # Errors
    /// [`Error::Resume`], [`Error::Network`].
    pub(crate) fn last_optimizer(
        &self,
        settings: AdamWSettings,
        state: &RunState,
        device: &Device,
    ) -> Result<AdamW, Error> {
        let mut values = read_tensors(&self.last()?.join(OPTIMIZER), device)?;
        let mut moments = BTreeMap::new();
        for (name, steps) in &state.parameter_steps {
            let mean = values.remove(&format!("mean.{name}"));
            let square = values.remove(&format!("square.{name}"));
            let (Some(mean), Some(square)) = (mean, square) else {
                let what = format!("the optimiser knows nothing of `{name}`");
                return Err(Error::Resume { path: self.folder.clone(), what });
            };
            moments.insert(name.clone(), Moments { steps: *steps, mean, square });
        }
        Ok(AdamW::resume(settings, moments))
    }

    /// The averaged weights of the last one; none where none were kept.
    ///
    /// # Errors
    /// [`Error::Resume`], [`Error::Network`].
    pub(crate) fn last_average(&self, device: &Device) -> Result<BTreeMap<String, Tensor<1>>, Error> {
        let path = self.last()?.join(AVERAGE);
        if path.exists() { read_tensors(&path, device) } else { Ok(BTreeMap::new()) }
    }
}

/// The weights of a network as every command reads them.
///
/// # Errors
/// [`Error::Network`] if the file cannot be written.
pub fn write_weights(network: &dyn PairNetwork, path: &Path) -> Result<(), Error> {
    write_tensors(path, &parameters(network), &network.metadata())
}

fn parameters(network: &dyn PairNetwork) -> Vec<Named> {
    let mut parameters = Vec::new();
    network.visit(&mut |name, shape, value| parameters.push((name.to_owned(), shape.to_vec(), value)));
    parameters
}

fn write_all(folder: &Path, saved: &Saved<'_>) -> Result<(), Error> {
    let metadata = saved.network.metadata();
    let weights = parameters(saved.network);
    write_tensors(&folder.join(WEIGHTS), &weights, &metadata)?;
    if let Some(average) = saved.average {
        let mut averaged = weights;
        for (name, _, value) in &mut averaged {
            if let Some(mean) = average.values().get(name) {
                *value = mean.clone();
            }
        }
        write_tensors(&folder.join(AVERAGE), &averaged, &metadata)?;
    }
    let moments = saved.optimizer.moments().iter().flat_map(|(name, one)| {
        let len = one.mean.dims().to_vec();
        [
            (format!("mean.{name}"), len.clone(), one.mean.clone()),
            (format!("square.{name}"), len, one.square.clone()),
        ]
    });
    write_tensors(&folder.join(OPTIMIZER), &moments.collect::<Vec<_>>(), &BTreeMap::new())?;
    let path = folder.join(STATE);
    let mut draft = FileDraft::new(&path)?;
    serde_json::to_writer_pretty(&mut draft, &saved.state)
        .map_err(|error| selenograph_files::Error::io("write", &path)(error.into()))?;
    draft.sync()?;
    Ok(draft.commit()?)
}

type Named = (String, Vec<usize>, Tensor<1>);

fn write_tensors(path: &Path, tensors: &[Named], metadata: &BTreeMap<String, String>) -> Result<(), Error> {
    let entry = |(name, shape, _): &Named| Entry {
        name: name.clone(),
        element: ElementType::F32,
        shape: shape.clone(),
    };
    let mut writer = Writer::create(path, tensors.iter().map(entry).collect(), metadata)?;
    for (_, _, value) in tensors {
        writer.write(&host_values(value))?;
    }
    Ok(writer.finish()?)
}

/// The values of a tensor, single precision.
pub(crate) fn host_values<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.try_to_vec_as::<f32>().unwrap_or_default()
}

fn read_tensors(path: &Path, device: &Device) -> Result<BTreeMap<String, Tensor<1>>, Error> {
    let file = TensorFile::open(path)?;
    let mut tensors = BTreeMap::new();
    for (name, _) in file.tensors() {
        let values = file.read(name)?;
        let len = values.len();
        tensors.insert(name.to_owned(), Tensor::from_data(TensorData::new(values, [len]), device));
    }
    Ok(tensors)
}

fn remove(folder: &Path) -> Result<(), Error> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(Error::io("write", folder)(error)),
        _ => Ok(()),
    }
}
