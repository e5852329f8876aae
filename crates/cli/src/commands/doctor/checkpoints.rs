//! Checkpoints that lie about, each in one line.

use selenograph_network::checkpoint::Checkpoint;
use selenograph_network::{NetworkConfig, Preset};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What files of weights end with.
const ENDINGS: [&str; 3] = ["pth", "pt", "safetensors"];

/// A file of weights, or what should be one.
#[derive(Debug, Serialize)]
pub struct Found {
    /// The file.
    file: PathBuf,
    /// Whether it was named, not only found.
    asked_for: bool,
    /// What it holds.
    #[serde(flatten)]
    state: State,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum State {
    /// A checkpoint.
    Checkpoint(Contents),
    /// Why it cannot be read.
    Error(String),
}

#[derive(Debug, Serialize)]
struct Contents {
    family: &'static str,
    /// Name of a preset or dimensions.
    network: String,
    parameters: usize,
    number_format: &'static str,
    license: Option<String>,
    complete: bool,
}

impl Found {
    /// In the folders and files that were named, in the current folder and in the one that the environment names.
    pub fn search(named: &[PathBuf], weights_folder: Option<PathBuf>) -> Vec<Self> {
        let mut files = Vec::new();
        for path in named {
            let inside = if path.is_dir() { weights_in(path) } else { vec![path.clone()] };
            files.extend(inside.into_iter().map(|file| (file, true)));
        }
        for folder in [Some(PathBuf::from(".")), weights_folder].into_iter().flatten() {
            files.extend(weights_in(&folder).into_iter().map(|file| (file, false)));
        }
        let mut found: Vec<Self> = Vec::new();
        let mut seen = Vec::new();
        for (file, asked_for) in files {
            let place = file.canonicalize().unwrap_or_else(|_| file.clone());
            if !seen.contains(&place) {
                seen.push(place);
                found.push(Self { state: State::of(&file), file, asked_for });
            }
        }
        found
    }

    /// Whether it was named and cannot be read.
    pub fn fails(&self) -> bool {
        self.asked_for && matches!(self.state, State::Error(_))
    }

    /// In one line.
    pub fn sentence(&self) -> String {
        let file = self.file.display();
        match &self.state {
            State::Error(why) => format!("{file}: not readable: {why}"),
            State::Checkpoint(contents) => {
                let Contents { family, network, parameters, number_format, complete, .. } = contents;
                let license = contents.license.as_deref().unwrap_or("licence unknown");
                let missing = if *complete { "" } else { ", incomplete" };
                format!(
                    "{file}: {family} {network}, {parameters} parameters in {number_format}{missing}, {license}"
                )
            }
        }
    }
}

impl State {
    fn of(file: &Path) -> Self {
        match Checkpoint::open(file) {
            Ok(checkpoint) => Self::Checkpoint(Contents::new(&checkpoint)),
            Err(error) => Self::Error(error.to_string().lines().collect::<Vec<_>>().join(" ")),
        }
    }
}

impl Contents {
    fn new(checkpoint: &Checkpoint) -> Self {
        let mut counts = BTreeMap::new();
        for tensor in checkpoint.names().filter_map(|name| checkpoint.tensor(name)) {
            *counts.entry(tensor.element.name()).or_insert(0) += tensor.len();
        }
        let most = counts.into_iter().max_by_key(|(_, count)| *count);
        Self {
            family: checkpoint.family().name(),
            network: described(checkpoint.config()),
            parameters: checkpoint.layout().num_parameters(),
            number_format: most.map_or("nothing", |(name, _)| name),
            license: checkpoint.license().map(str::to_owned),
            complete: checkpoint.fit().faults().is_none(),
        }
    }
}

/// The preset's name, or width and depth of encoder and decoders.
fn described(config: &NetworkConfig) -> String {
    let preset = Preset::ALL.into_iter().find(|preset| preset.config() == *config);
    preset.map_or_else(
        || {
            let [encoder, decoder] =
                [config.encoder, config.decoder].map(|shape| format!("{}×{}", shape.dim, shape.num_blocks));
            format!("encoder {encoder}, decoders {decoder}")
        },
        |preset| preset.name().to_owned(),
    )
}

/// Files of a folder that end as weights do, by name.
fn weights_in(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().and_then(|e| e.to_str()).is_some_and(|e| ENDINGS.contains(&e)))
        .map(|path| path.strip_prefix(".").map(Path::to_owned).unwrap_or(path))
        .collect();
    files.sort();
    files
}
