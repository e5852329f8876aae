//! Held-out pairs before the evaluator while a run learns: its network as `evaluate -m mast3r` would judge it.

use super::request::Request;
use crate::args::network::NetworkChoice;
use crate::commands::network::{self, builtin};
use crate::ui::Ui;
use anyhow::Context;
use selenograph_dataset::augment::SunChoice;
use selenograph_dataset::split::Split;
use selenograph_evaluate::dataset_source::{Choice, LightChoice, Source};
use selenograph_evaluate::method::Method;
use selenograph_evaluate::method::network::Network;
use selenograph_evaluate::run::{self, EVALUATION, Line, RunOptions, Settings};
use selenograph_files::{Existing, HeldFolder, Sharing};
use selenograph_network::Checkpoint;
use selenograph_train::network::PairNetwork;
use selenograph_train::run::checkpoint::write_weights;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where the lines of each examination are, in the run's folder.
const FOLDER: &str = "evaluations";
/// The weights while they are examined.
const WEIGHTS: &str = ".examined.safetensors";
/// The error of a pose that is not there.
const NO_POSE_DEG: f64 = 180.0;

/// The pairs, and how they are looked at.
pub struct Examination {
    sources: Vec<Source>,
    settings: Settings,
    device: String,
    folder: PathBuf,
}

impl Examination {
    /// Of the run in `folder`: the folders of `--val`, and what a split of `--data` holds out. `None` where there is neither, or
    /// no pair is to be evaluated. Held-out triplets are for the test criterion only.
    ///
    /// # Errors
    /// Folders without pairs.
    pub fn open(request: &Request, split: Option<&Split>, folder: &Path) -> anyhow::Result<Option<Self>> {
        let wanted = request.settings.learning.validation.evaluated;
        let mut parts: Vec<(&Path, Vec<String>)> =
            request.val.iter().map(|path| (path.as_path(), Vec::new())).collect();
        if let (Some(split), [data]) = (split, request.data.as_slice()) {
            parts.push((data, split.val.iter().map(u64::to_string).collect()));
        }
        if wanted == 0 || parts.is_empty() {
            return Ok(None);
        }
        let lights = match request.settings.loader.augmentation.suns {
            SunChoice::Independent => LightChoice::Both,
            SunChoice::First | SunChoice::Shared => LightChoice::Same,
        };
        let share = wanted.div_ceil(parts.len());
        let open = |(path, pairs): (&Path, Vec<String>)| -> anyhow::Result<Source> {
            let no_verify = request.no_verify;
            let choice = Choice { pairs, limit: Some(share), lights, no_verify, ..Choice::default() };
            let mut source = Source::open(path, &choice)?;
            // One item a pair, in turn of another light.
            for (n, entry) in source.entries.iter_mut().enumerate() {
                let num_lights = entry.lights.len();
                entry.lights.rotate_left(n.checked_rem(num_lights).unwrap_or(0));
                entry.lights.truncate(1);
            }
            Ok(source)
        };
        let sources = parts.into_iter().map(open).collect::<anyhow::Result<_>>()?;
        let settings = Settings {
            lights,
            methods: vec![Method::Pictures(selenograph_reconstruct::pipeline::Method::Mast3r)],
            reference_frame: None,
            ..Settings::default()
        };
        let (device, folder) = (request.device.clone(), folder.to_owned());
        Ok(Some(Self { sources, settings, device, folder }))
    }

    /// Medians of the errors of pose and points, and the share of pairs without a pose. The lines stay in the run's folder.
    ///
    /// # Errors
    /// A disk that is full, pairs that cannot be read.
    pub fn hold(
        &self,
        network: &dyn PairNetwork,
        step: u64,
        ui: &Ui,
    ) -> anyhow::Result<BTreeMap<String, f64>> {
        let path = self.folder.join(WEIGHTS);
        let written = write_weights(network, &path).map_err(anyhow::Error::from);
        let found = written.and_then(|()| self.evaluate(&path, step, ui));
        // Also what was written of it to a disk that is full.
        let _ = std::fs::remove_file(&path);
        Ok(medians(&found?))
    }

    fn evaluate(&self, weights: &Path, step: u64, ui: &Ui) -> anyhow::Result<Vec<Line>> {
        let choice = NetworkChoice {
            weights: Some(weights.to_owned()),
            device: self.device.clone(),
            ..NetworkChoice::default()
        };
        let checkpoint = Checkpoint::open(weights)?;
        let predictor = network::load(&checkpoint, &network::options(&choice)?, ui)?;
        let network = Network::new(predictor, builtin::checksum(&checkpoint)?);
        let settings = Settings { network: Some(network.record().clone()), ..self.settings.clone() };
        let folder = self.folder.join(FOLDER).join(format!("step-{step:08}"));
        let mut lines = Vec::new();
        for (n, source) in self.sources.iter().enumerate() {
            let out = if self.sources.len() == 1 { folder.clone() } else { folder.join(n.to_string()) };
            // A sitting that was killed may have examined this step before.
            let out = HeldFolder::take(&out, &EVALUATION, Existing::Replace, Sharing::Alone)?;
            let options = RunOptions {
                out: &out,
                started: None,
                progress: &|_| {},
                clock: &|| 0.0,
                network: Some(&network),
            };
            let found = run::evaluate(source, &settings, &options)
                .with_context(|| format!("held-out pairs of `{}`", source.root.display()))?;
            lines.extend(found.1.into_iter().flatten());
        }
        Ok(lines)
    }
}

fn medians(lines: &[Line]) -> BTreeMap<String, f64> {
    let counted = |error: Option<f64>| error.map(|deg| if deg.is_finite() { deg } else { NO_POSE_DEG });
    let of = |value: &dyn Fn(&Line) -> Option<f64>| -> Option<f64> {
        let mut values: Vec<f64> = lines.iter().filter_map(value).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let num_failed = lines.iter().filter(|line| line.metrics.pose_failed).count();
    let quantities = [
        ("rra_deg", of(&|line| counted(Some(line.metrics.rra_counted_deg())))),
        ("rta_deg", of(&|line| counted(line.metrics.rta_counted_deg()))),
        ("point_error_rel", of(&|line| line.metrics.overlap.numbers.point_error_rel)),
        ("no_pose", (!lines.is_empty()).then(|| num_failed as f64 / lines.len() as f64)),
    ];
    quantities.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
}
