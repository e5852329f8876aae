//! `presets`.

use crate::args::campaign::Presets;
use crate::exit::Outcome;
use crate::ui::Ui;
use selenograph_dataset::plan::preset::{PRESETS, preset_text};
use serde::Serialize;

#[derive(Serialize)]
struct Entry {
    name: &'static str,
    about: String,
}

/// Lists the presets, or prints one.
///
/// # Errors
/// An unknown name.
pub fn run(args: &Presets, ui: &Ui) -> anyhow::Result<Outcome> {
    if let Some(name) = &args.name {
        ui.data(preset_text(name)?.trim_end())?;
        return Ok(Outcome::Done);
    }
    let entries: Vec<Entry> =
        PRESETS.iter().map(|(name, text)| Entry { name, about: first_comment(text) }).collect();
    if ui.json {
        ui.data_json(&entries)?;
    } else {
        for entry in entries {
            ui.data(&format!("{:<24} {}", entry.name, entry.about))?;
        }
    }
    Ok(Outcome::Done)
}

/// The comment at the head of a preset, which says what it is for.
fn first_comment(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map_while(|line| line.strip_prefix('#')).map(str::trim).collect();
    lines.join(" ")
}
