//! What was asked for, kept in the run's folder so that it can be gone on with.

use crate::args::train::Run;
use crate::commands::clock::now_utc;
use crate::exit::refuse;
use crate::ui::Ui;
use anyhow::Context;
use selenograph_files::record::{self, RUN_NAME, RunRecord};
use selenograph_files::{checksum, regular};
use selenograph_model::{Device, Model, SavedActivations};
use selenograph_network::layout::Layout;
use selenograph_network::{Checkpoint, NetworkConfig, Preset, random};
use selenograph_train::batch::AssemblySettings;
use selenograph_train::run::Precision;
use selenograph_train::run::preset::{RunSettings, preset_text};
use selenograph_train::{Frozen, ModelNetwork};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a run is put on record as, also when it is gone on with.
pub const COMMAND: &str = "train run";

/// What was asked for.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    pub first_weights: Option<PathBuf>,
    pub first_network: Option<String>,
    pub teacher: Option<PathBuf>,
    pub data: Vec<PathBuf>,
    pub triplets: Vec<PathBuf>,
    #[serde(default)]
    pub split: Option<PathBuf>,
    #[serde(default)]
    pub val_split: Option<PathBuf>,
    pub campaign: Option<String>,
    pub terrain: Option<PathBuf>,
    pub val: Vec<PathBuf>,
    pub allow_leak: bool,
    #[serde(default)]
    pub no_verify: bool,
    pub budget_s: Option<f64>,
    pub device: String,
    /// Files that decide what is learnt, with their BLAKE3.
    #[serde(skip)]
    pub inputs: BTreeMap<String, String>,
    /// `settings` in the records of older versions.
    #[serde(rename = "run", alias = "settings")]
    pub settings: RunSettings,
}

impl Request {
    /// Of a command line.
    ///
    /// # Errors
    /// Settings that are none.
    pub fn from_args(args: &Run) -> anyhow::Result<Self> {
        let absolute = |path: &PathBuf| std::path::absolute(path);
        let all = |paths: &[PathBuf]| paths.iter().map(absolute).collect::<Result<Vec<_>, _>>();
        Ok(Self {
            first_weights: args.start.weights.as_ref().map(absolute).transpose()?,
            first_network: args.start.network.clone(),
            teacher: args.start.teacher.as_ref().map(absolute).transpose()?,
            data: all(&args.pairs.data)?,
            triplets: all(&args.pairs.triplets)?,
            split: args.pairs.split.as_ref().map(absolute).transpose()?,
            val_split: args.pairs.val_split.as_ref().map(absolute).transpose()?,
            campaign: args.pairs.campaign.as_ref().map(|name| place_or_preset(name)).transpose()?,
            terrain: args.pairs.terrain.as_ref().map(absolute).transpose()?,
            val: all(&args.pairs.val)?,
            allow_leak: args.pairs.allow_leak,
            no_verify: args.pairs.no_verify,
            budget_s: args.means.budget_s,
            device: args.means.device.clone(),
            inputs: BTreeMap::new(),
            settings: settings(args)?,
        })
    }

    /// Of a run's folder.
    ///
    /// # Errors
    /// A folder that is no run.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let is_none = |why: String| {
            refuse(
                format!("`{}` is no run of training: `{RUN_NAME}`: {why}", folder.display()),
                "give the folder that `train run --out` made",
            )
        };
        let found = record::read(&folder.join(RUN_NAME)).map_err(|error| is_none(error.to_string()))?;
        if found.command != COMMAND {
            return Err(is_none(format!("it is the record of `{}`", found.command)));
        }
        let request: Self = found
            .settings
            .try_into()
            .map_err(|error: toml::de::Error| is_none(error.message().to_owned()))?;
        Ok(Self { inputs: found.inputs, ..request })
    }

    /// Into a run's folder.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        let now = now_utc();
        let mut record = RunRecord::<_, ()>::new(COMMAND, self);
        record.started = Some(&now);
        record.inputs = self.inputs.clone();
        Ok(record.write(&folder.join(RUN_NAME))?)
    }

    /// Takes down the checksums of what is read.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn take_down_inputs(&mut self) -> anyhow::Result<()> {
        self.inputs = checksum::of_files(&self.files(self.first_weights.iter()))?;
        Ok(())
    }

    /// Files that are not what the run began with; its first weights are not needed again.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn changed_inputs(&self) -> anyhow::Result<Vec<String>> {
        let now = checksum::of_files(&self.files(None))?;
        let is_other = |path: &String, sum: &String| self.inputs.get(path).is_some_and(|then| then != sum);
        Ok(now.into_iter().filter(|(path, sum)| is_other(path, sum)).map(|(path, _)| path).collect())
    }

    /// What a checksum can be taken of in little time: a dataset's own record, not its pictures.
    fn files<'a>(&'a self, weights: impl IntoIterator<Item = &'a PathBuf>) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = weights.into_iter().chain(&self.teacher).cloned().collect();
        files.extend(self.split.iter().chain(&self.val_split).cloned());
        let campaign = self.campaign.iter().map(PathBuf::from);
        let records = self
            .data
            .iter()
            .chain(&self.val)
            .flat_map(|folder| ["run.toml", "campaign.toml", "plan.csv"].map(|name| folder.join(name)));
        let terrain = self.terrain.iter().map(|folder| folder.join("terrain.json"));
        // A preset's name is no file, and imported datasets have no plan.
        files.extend(campaign.chain(records).chain(terrain).filter(|path| path.is_file()));
        files
    }

    /// As a file.
    ///
    /// # Errors
    /// If a value has no form in TOML.
    pub fn to_toml(&self) -> anyhow::Result<String> {
        Ok(toml::to_string(self)?)
    }

    /// How pairs become batches.
    pub fn assembly(&self) -> AssemblySettings {
        let loss = &self.settings.learning.loss;
        AssemblySettings { match_block: loss.matching.block, epipolar: loss.epipolar_weight > 0.0 }
    }

    /// The network, with the weights of a file or random ones.
    ///
    /// # Errors
    /// Weights of another architecture, a device that cannot.
    pub fn network(&self, weights: Option<&Path>, device: &Device, ui: &Ui) -> anyhow::Result<ModelNetwork> {
        let learning = &self.settings.learning;
        let (model, license) = match (weights, &self.first_network) {
            (Some(path), _) => read(path, device)?,
            (None, Some(name)) => (fresh(name, self.settings.loader.seed, device)?, None),
            (None, None) => {
                return Err(refuse("no network is named", "pass --weights FILE or --network NAME"));
            }
        };
        if self.first_network.is_some() && learning.frozen == Frozen::Encoder {
            ui.note("note: an encoder that has learnt nothing stays as it is; `--set learning.frozen=\"none\"` lets it learn");
        }
        let precision = match learning.precision {
            Precision::Bf16 if self.device != "cpu" => selenograph_model::Precision::Bf16,
            Precision::Bf16 => {
                ui.note("note: in f32, as bf16 is slower on the CPU");
                selenograph_model::Precision::F32
            }
            Precision::F32 => selenograph_model::Precision::F32,
        };
        let provenance =
            format!("trained by selenograph {} from {}", env!("CARGO_PKG_VERSION"), self.origin());
        let keep =
            if learning.recompute { SavedActivations::BlockInputs } else { SavedActivations::Everything };
        let model = model.with_precision(precision);
        let network = ModelNetwork::new(model, learning.frozen, keep, license.as_deref(), &provenance);
        let network = network.with_encoding_cache(learning.encoding_cache_mib << 20);
        Ok(match self.settings.loader.sizes.iter().flatten().max() {
            Some(side) => network.with_input_px(*side),
            None => network,
        })
    }

    /// The network whose predictions stand in for the truth.
    ///
    /// # Errors
    /// As [`Request::network`].
    pub fn teacher(&self, device: &Device, ui: &Ui) -> anyhow::Result<Option<ModelNetwork>> {
        self.teacher.as_deref().map(|path| self.network(Some(path), device, ui)).transpose()
    }

    fn origin(&self) -> String {
        match (&self.first_weights, &self.first_network) {
            (Some(path), _) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            (None, Some(name)) => format!("a random `{name}`, seed {}", self.settings.loader.seed),
            (None, None) => String::new(),
        }
    }
}

/// A campaign's file by its whole path, so that a run can be gone on with from anywhere; the name of a preset as it is.
fn place_or_preset(name: &str) -> anyhow::Result<String> {
    let path = Path::new(name);
    if !path.is_file() {
        return Ok(name.to_owned());
    }
    Ok(std::path::absolute(path)?.display().to_string())
}

fn read(path: &Path, device: &Device) -> anyhow::Result<(Model, Option<String>)> {
    let checkpoint = Checkpoint::open(path)?;
    checkpoint.check_complete()?;
    if checkpoint.config().descriptor_dim.is_none() {
        return Err(refuse(
            format!("`{}` is a network without descriptors", path.display()),
            "begin with weights of the MASt3R family, or with --network; DUSt3R's have no descriptors to learn",
        ));
    }
    let mut source = |name: &str| Ok(checkpoint.read_with_shape(name)?);
    let model = Model::new(checkpoint.config(), device, &mut source)?;
    Ok((model, checkpoint.license().map(str::to_owned)))
}

fn fresh(name: &str, seed: u64, device: &Device) -> anyhow::Result<Model> {
    let config: NetworkConfig = Preset::from_name(name)?.config();
    let layout = Layout::new(&config)?;
    let mut source = |name: &str| {
        let spec = layout.get(name).ok_or_else(|| format!("no tensor `{name}`"))?;
        Ok((spec.shape.clone(), random::values(spec, seed)))
    };
    Ok(Model::new(&config, device, &mut source)?)
}

/// The settings of a command line: preset, file, keys.
fn settings(args: &Run) -> anyhow::Result<RunSettings> {
    let choice = &args.settings;
    let mut layers = Vec::new();
    if let Some(name) = &choice.preset {
        layers.push((format!("preset {name}"), preset_text(name)?.to_owned()));
    }
    if let Some(path) = &choice.settings {
        let text =
            regular::read_to_string(path).with_context(|| format!("cannot read `{}`", path.display()))?;
        layers.push((path.display().to_string(), text));
    }
    let mut assign = |flag: &str, key: &str, value: &str| {
        layers.push((flag.to_owned(), format!("{key} = {value}")));
    };
    if let Some(batch) = choice.batch {
        assign("--batch", "loader.batch_size", &batch.to_string());
    }
    if let Some(count) = choice.accumulate {
        assign("--accumulate", "learning.accumulate", &count.to_string());
    }
    if let Some(seed) = choice.seed {
        assign("--seed", "loader.seed", &seed.to_string());
    }
    if args.pairs.skip_faulty {
        assign("--skip-faulty", "loader.faults", "\"replace\"");
    }
    for assignment in &choice.set {
        let (key, value) = assignment.split_once('=').ok_or_else(|| {
            refuse(
                format!("--set {assignment}: no value"),
                "write it as key=value, such as learning.epochs=3",
            )
        })?;
        assign(&format!("--set {assignment}"), key, value);
    }
    Ok(RunSettings::from_layers(&layers)?)
}
