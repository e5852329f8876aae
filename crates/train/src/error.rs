//! What can go wrong in training.

use std::path::{Path, PathBuf};

/// What can go wrong in training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("cannot {action} `{}`: {source}", path.display())]
    Io {
        /// `read`, `write` …
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file or folder that cannot be written.
    #[error(transparent)]
    Files(#[from] selenograph_files::Error),
    /// A checkpoint of weights.
    #[error(transparent)]
    Network(#[from] selenograph_network::Error),
    /// The pairs.
    #[error(transparent)]
    Dataset(#[from] selenograph_dataset::Error),
    /// The layers of crate `model`.
    #[error(transparent)]
    Model(#[from] selenograph_model::Error),
    /// The frozen encoder.
    #[error(transparent)]
    Engine(#[from] selenograph_engine::Error),
    /// Another network refuses its input, or its parameters.
    #[error("the network: {0}")]
    Layers(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The report.
    #[error(transparent)]
    Report(#[from] selenograph_report::Error),
    /// Pairs that make no batch.
    #[error("batch: {what} is {found}, expected {expected}")]
    Batch {
        /// Which property.
        what: &'static str,
        /// What would do.
        expected: String,
        /// What is there.
        found: String,
    },
    /// Settings that are no settings.
    #[error("{what}: {message}")]
    Settings {
        /// The file or preset.
        what: String,
        /// What is wrong, where.
        message: String,
    },
    /// A loss that is no number.
    #[error("step {step}: the loss is {found}; the batch is kept in `{}`", batch.display())]
    Diverged {
        /// The step.
        step: u64,
        /// The total loss.
        found: f64,
        /// Where the batch is.
        batch: PathBuf,
    },
    /// A folder that is no run, or of another network.
    #[error("`{}` cannot be resumed: {what}", path.display())]
    Resume {
        /// The folder.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// Not enough time for a step and a checkpoint.
    #[error("the budget of {budget_s:.1} s is too short: one step and one checkpoint take {needed_s:.1} s")]
    BudgetTooShort {
        /// The budget.
        budget_s: f64,
        /// What one step and one checkpoint take.
        needed_s: f64,
    },
    /// It would not fit into memory.
    #[error(
        "training needs about {needed_gib:.1} GiB, {available_gib:.1} GiB are free; {}",
        fits(*batch_that_fits)
    )]
    OutOfMemoryForeseen {
        /// Estimate.
        needed_gib: f64,
        /// What is free.
        available_gib: f64,
        /// Pairs that would fit; 0 if not even one does.
        batch_that_fits: usize,
    },
}

fn fits(batch: usize) -> String {
    match batch {
        0 => "not even one pair fits".into(),
        1 => "one pair a batch would fit".into(),
        n => format!("{n} pairs a batch would fit"),
    }
}

impl Error {
    /// Adds the action and the path to an error of the system.
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// What the user can do about it, if anything is known.
    pub fn hint(&self) -> Option<&'static str> {
        match self {
            Self::Report(error) => error.hint(),
            Self::Model(error) => error.hint(),
            Self::Engine(error) => error.hint(),
            Self::Network(selenograph_network::Error::Io { action: "write", .. })
            | Self::Network(selenograph_network::Error::Files(_))
            | Self::Files(_)
            | Self::Io { action: "write", .. } => Some(
                "is there space, and may you write there? the last checkpoint is whole: `train resume` goes on from it",
            ),
            Self::Network(error) => error.hint(),
            Self::Io { .. } | Self::Layers(_) | Self::Dataset(_) => None,
            Self::Batch { .. } => {
                Some("give each batch pairs of one size; `matches.count` holds for all sources")
            }
            Self::Settings { .. } => Some("`train run … --dry-run` prints every key with its value"),
            Self::Diverged { .. } => {
                Some("a smaller learning rate, or `clip`; the last checkpoint is from before")
            }
            Self::Resume { .. } => Some("give the folder that `train run --out` made"),
            Self::BudgetTooShort { .. } => Some("a longer `--for`, a smaller batch, or a smaller network"),
            Self::OutOfMemoryForeseen { .. } => {
                Some("`--batch` with fewer pairs and `--accumulate` with more give the same gradient")
            }
        }
    }
}
