//! Where a run's pairs come from, and that none of them sees held-out ground.

use super::request::Request;
use crate::exit::refuse;
use crate::ui::Ui;
use anyhow::Context;
use selenograph_dataset::augment::Augmentation;
use selenograph_dataset::loader::{LoaderOptions, Mixture, Source, shared_ground};
use selenograph_dataset::plan::Campaign;
use selenograph_dataset::plan::preset::preset_text;
use selenograph_geometry::pixel::PixelConvention;
use selenograph_terrain::Terrain;
use std::path::Path;
use std::sync::Arc;

/// Pairs to learn from and, where there are any, held-out ones.
///
/// # Errors
/// Folders without pairs; pairs to learn from that see held-out ground, unless that is allowed.
pub fn mixtures(request: &Request, ui: &Ui) -> anyhow::Result<(Mixture, Option<Mixture>)> {
    let val: Vec<Source> = request.val.iter().map(|path| pairs(path)).collect::<anyhow::Result<_>>()?;
    let mut learn: Vec<Source> =
        request.data.iter().map(|path| pairs(path)).collect::<anyhow::Result<_>>()?;
    for path in &request.triplets {
        learn.push(Source::triplets(&name(path), path, None, PixelConvention::Center)?);
    }
    if let (Some(campaign), Some(terrain)) = (&request.campaign, &request.terrain) {
        learn.push(flight(campaign, terrain, &val)?);
    }
    let leaks = ui.timed("look for shared ground", || shared_ground(&learn, &val))?;
    if let Some(leak) = leaks.first() {
        let text = format!(
            "{} held-out pairs are seen while learning: pair {} of `{}` by pair {} of `{}`",
            leaks.len(),
            leak.val.1,
            leak.val.0,
            leak.train.1,
            leak.train.0
        );
        if !request.allow_leak {
            return Err(refuse(text, "`data split` makes parts that share no ground; or pass --allow-leak"));
        }
        ui.note(&format!("warning: {text}"));
    }
    let options = &request.settings.loader;
    let judge = LoaderOptions {
        pairs_per_epoch: None,
        augmentation: Augmentation { fidelity: options.augmentation.fidelity, ..Augmentation::default() },
        ..options.clone()
    };
    let judge = if val.is_empty() { None } else { Some(Mixture::new(val, judge)?) };
    Ok((Mixture::new(learn, options.clone())?, judge))
}

fn pairs(path: &Path) -> anyhow::Result<Source> {
    Ok(Source::pairs(&name(path), path, None)?)
}

/// A campaign over a terrain, kept off held-out ground.
fn flight(campaign: &str, terrain: &Path, val: &[Source]) -> anyhow::Result<Source> {
    let text = if Path::new(campaign).is_file() {
        std::fs::read_to_string(campaign).with_context(|| format!("cannot read campaign `{campaign}`"))?
    } else {
        preset_text(campaign)?.to_owned()
    };
    let terrain = Arc::new(Terrain::open(terrain)?);
    let mut source = Source::flight(campaign, Campaign::from_toml(&text)?, terrain)?;
    source.keep_off(val)?;
    Ok(source)
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
