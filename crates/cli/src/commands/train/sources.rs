//! Where a run's pairs come from, and that none of them sees held-out ground.

use super::request::Request;
use crate::exit::refuse;
use crate::ui::Ui;
use anyhow::Context;
use selenograph_dataset::augment::Augmentation;
use selenograph_dataset::loader::{Faults, LoaderOptions, Mixture, Source, shared_ground};
use selenograph_dataset::plan::Campaign;
use selenograph_dataset::plan::preset::preset_text;
use selenograph_dataset::split::Split;
use selenograph_geometry::pixel::PixelConvention;
use selenograph_terrain::Terrain;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Pairs to learn from and, where there are any, held-out ones.
///
/// # Errors
/// Folders without pairs, or with missing files; no truth to learn from; pairs to learn from that see held-out ground,
/// unless that is allowed.
pub fn mixtures(
    request: &Request,
    split: Option<&Split>,
    ui: &Ui,
) -> anyhow::Result<(Mixture, Option<Mixture>)> {
    let mut val: Vec<Source> = all(&request.val)?;
    let mut learn = match (&request.split, split) {
        (_, Some(split)) => {
            let folder = only(&request.data, "--split")?;
            val.push(Source::pairs(&name(folder), folder, Some(&split.val))?);
            let mut learn = all_triplets(&request.triplets)?;
            learn.push(Source::pairs(&name(folder), folder, Some(&split.train))?);
            learn
        }
        (Some(file), None) => {
            let mut learn = all(&request.data)?;
            learn.push(triplets(only(&request.triplets, "--split")?, Some(file))?);
            learn
        }
        (None, None) => all(&request.data)?.into_iter().chain(all_triplets(&request.triplets)?).collect(),
    };
    if let Some(file) = &request.val_split {
        val.push(triplets(only(&request.triplets, "--val-split")?, Some(file))?);
    }
    if let (Some(campaign), Some(terrain)) = (&request.campaign, &request.terrain) {
        learn.push(flight(campaign, terrain, &val)?);
    }
    if request.no_verify {
        for sources in [&mut learn, &mut val] {
            *sources = std::mem::take(sources).into_iter().map(Source::unverified).collect();
        }
    }
    if request.teacher.is_none() && !learn.iter().any(Source::has_truth) {
        return Err(refuse(
            format!("`{}` holds no depth: there is nothing to learn from", names(&learn)),
            "pass a dataset with truth maps, or a network that knows with --teacher",
        ));
    }
    if request.settings.loader.faults == Faults::Refuse {
        learn.iter().chain(&val).try_for_each(Source::check_files)?;
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

fn names(sources: &[Source]) -> String {
    sources.iter().map(|source| source.name.as_str()).collect::<Vec<_>>().join("`, `")
}

fn all(folders: &[PathBuf]) -> anyhow::Result<Vec<Source>> {
    folders.iter().map(|path| Ok(Source::pairs(&name(path), path, None)?)).collect()
}

fn all_triplets(folders: &[PathBuf]) -> anyhow::Result<Vec<Source>> {
    folders.iter().map(|path| triplets(path, None)).collect()
}

fn triplets(path: &Path, split: Option<&PathBuf>) -> anyhow::Result<Source> {
    Ok(Source::triplets(&name(path), path, split.map(PathBuf::as_path), PixelConvention::Center)?)
}

/// What `data split` wrote, where `--split` names it; a split of triplets is read with them.
///
/// # Errors
/// A file that is something else.
pub fn own_split(request: &Request) -> anyhow::Result<Option<Split>> {
    let is_own = |file: &&PathBuf| file.extension().is_none_or(|extension| extension != "npz");
    let Some(file) = request.split.as_ref().filter(is_own) else { return Ok(None) };
    let text = selenograph_files::regular::read_to_string(file)
        .with_context(|| format!("cannot read `{}`", file.display()))?;
    serde_json::from_str(&text).map(Some).map_err(|error| {
        refuse(
            format!("`{}` is no split: {error}", file.display()),
            "pass train.npz of triplets, or what `data split` wrote",
        )
    })
}

/// The one folder that a split divides.
fn only<'a>(folders: &'a [PathBuf], flag: &str) -> anyhow::Result<&'a Path> {
    match folders {
        [one] => Ok(one),
        others => Err(refuse(
            format!("{flag} divides one folder, and {} are given", others.len()),
            "pass one --data with a .json of `data split`, or one --triplets with an .npz",
        )),
    }
}

/// A campaign over a terrain, kept off held-out ground.
fn flight(campaign: &str, terrain: &Path, val: &[Source]) -> anyhow::Result<Source> {
    let text = if Path::new(campaign).is_file() {
        selenograph_files::regular::read_to_string(Path::new(campaign))
            .with_context(|| format!("cannot read campaign `{campaign}`"))?
    } else {
        preset_text(campaign)?.to_owned()
    };
    let terrain = Arc::new(Terrain::open(terrain)?);
    let mut source = Source::flight(&name(Path::new(campaign)), Campaign::from_toml(&text)?, terrain)?;
    source.keep_off(val)?;
    Ok(source)
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
