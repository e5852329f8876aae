//! The heights against an elevation model that was named: one that took no part in the answer, or the one that placed it.

use super::known;
use crate::args::reconstruct::Reconstruct;
use crate::ui::Ui;
use selenograph_reconstruct::pipeline::Reconstruction;
use selenograph_reconstruct::priors::Priors;
use selenograph_reconstruct::products::Products;
use selenograph_reconstruct::reference::{Residuals, compare};
use selenograph_reconstruct::scale::ScaleSource;
use selenograph_reconstruct::scale::dem::DemPatch;
use serde::Serialize;

/// An elevation model to compare with.
pub struct Reference {
    file: String,
    patch: DemPatch,
    is_prior: bool,
}

/// What came of it: a part of `reconstruction.json`.
#[derive(Serialize)]
pub struct Record {
    /// The file.
    pub file: String,
    /// Whether the answer was laid onto it: then it is no independent witness of place and size.
    pub placed_by_it: bool,
    /// The numbers.
    #[serde(flatten)]
    pub residuals: Residuals,
}

impl Reference {
    /// That of `--reference`, else that of `--dem`.
    ///
    /// # Errors
    /// A file that is no elevation model, or not of this place.
    pub fn read(args: &Reconstruct, priors: &Priors) -> anyhow::Result<Option<Self>> {
        let of = |path: &std::path::Path, patch, is_prior| Self {
            file: path.display().to_string(),
            patch,
            is_prior,
        };
        Ok(match (&args.products.reference, &args.known.dem, &priors.dem) {
            (Some(path), ..) => Some(of(path, known::dem("--reference", path, &priors.world)?, false)),
            (None, Some(path), Some(patch)) => Some(of(path, patch.clone(), true)),
            (None, ..) => None,
        })
    }

    /// The heights against it; `None`, with a note, where they lie on no map of the body, or elsewhere.
    ///
    /// # Errors
    /// Ground in common that is a line.
    pub fn compared(
        &self,
        found: &Reconstruction,
        made: &Products,
        ui: &Ui,
    ) -> anyhow::Result<Option<Record>> {
        let residuals = compare(&made.dem, &self.patch)?;
        if residuals.is_none() {
            ui.note(&format!(
                "note: `{}`: not compared; heights without a size have no place on it, or hardly any lie over it",
                self.file
            ));
        }
        Ok(residuals.map(|residuals| Record {
            file: self.file.clone(),
            placed_by_it: self.is_prior && found.placement.source == Some(ScaleSource::Dem),
            residuals,
        }))
    }
}
