//! `config show`.

use crate::args::campaign::ConfigShow;
use crate::exit::Outcome;
use crate::settings::{Layers, leaves};
use crate::ui::Ui;
use serde::Serialize;

#[derive(Serialize)]
struct Setting<'a> {
    key: String,
    value: toml::Value,
    origin: &'a str,
}

/// Prints every key of the resolved campaign.
///
/// # Errors
/// A campaign that cannot be read or contradicts itself.
pub fn run(args: &ConfigShow, ui: &Ui) -> anyhow::Result<Outcome> {
    let layers = Layers::from_choice(&args.choice)?;
    let settings: Vec<Setting<'_>> = leaves(&layers.campaign()?)?
        .into_iter()
        .map(|(key, value)| Setting { origin: layers.origin(&key), key, value })
        .collect();
    if ui.json {
        ui.data_json(&settings)?;
        return Ok(Outcome::Done);
    }
    for setting in settings {
        ui.data(&format!("{} = {}  # {}", setting.key, setting.value, setting.origin))?;
    }
    Ok(Outcome::Done)
}
