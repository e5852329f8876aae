//! Settings in layers: defaults ‹ preset ‹ file ‹ environment ‹ flags, and where each value came from.

use crate::args::campaign::CampaignChoice;
use crate::exit::refuse;
use anyhow::Context;
use selenograph_dataset::Error;
use selenograph_dataset::plan::Campaign;
use selenograph_dataset::plan::preset::{PRESET_KEY, merge, preset_table};
use std::path::Path;
use toml::de::DeTable;
use toml::{Table, Value};

/// Layers laid over each other.
#[derive(Debug, Default)]
pub struct Layers {
    merged: Table,
    layers: Vec<(Table, String)>,
}

impl Layers {
    /// The layers that a command line asks for.
    ///
    /// # Errors
    /// An unknown preset, a file that cannot be read, an assignment that is none.
    pub fn from_choice(choice: &CampaignChoice) -> anyhow::Result<Self> {
        let mut layers = Self::default();
        if let Some(name) = &choice.preset {
            layers.add_preset(name)?;
        }
        if let Some(path) = &choice.campaign {
            layers.add_file(path)?;
        }
        if let Some(seed) = choice.seed {
            // Clap has looked at the environment already; the flag wins there.
            layers.add_text(&format!("seed = {seed}"), "--seed or SELENOGRAPH_SEED")?;
        }
        for assignment in &choice.set {
            layers.add_assignment(assignment)?;
        }
        Ok(layers)
    }

    fn add_preset(&mut self, name: &str) -> anyhow::Result<()> {
        self.add_table(preset_table(name)?, format!("preset {name}"));
        Ok(())
    }

    fn add_file(&mut self, path: &Path) -> anyhow::Result<()> {
        let text = selenograph_files::regular::read_to_string(path)
            .with_context(|| format!("cannot read campaign `{}`", path.display()))?;
        self.add_text(&text, &path.display().to_string())
    }

    /// Lays the text of a TOML file, and the preset that it names, over what is there.
    fn add_text(&mut self, text: &str, origin: &str) -> anyhow::Result<()> {
        // The text by itself first: only here are its lines known. Values are checked when all layers are together.
        let alone = Campaign::from_toml(&without_preset(text)).map(|_| ());
        let Ok(mut table) = text.parse::<Table>() else { return alone.context(origin.to_owned()) };
        match table.remove(PRESET_KEY) {
            Some(Value::String(_)) if !self.layers.is_empty() => {
                return Err(refuse(
                    format!("{origin} names a preset, and --preset names one too"),
                    "leave one of them out",
                ));
            }
            Some(Value::String(name)) => self.add_preset(&name)?,
            Some(other) => {
                return Err(refuse(
                    format!("{origin}: `{PRESET_KEY}` must be a name, found {other}"),
                    "`selenograph presets` lists the names",
                ));
            }
            None => {}
        }
        self.add_table(table, origin.to_owned());
        match alone {
            // One end of a range is no range by itself, and one over what is there.
            Err(error @ Error::Campaign { .. }) if self.is_malformed() => {
                Err(error).context(origin.to_owned())
            }
            _ => Ok(()),
        }
    }

    fn is_malformed(&self) -> bool {
        matches!(Campaign::from_table(self.merged.clone()), Err(Error::Campaign { .. }))
    }

    /// Lays one `key=value` over what is there; the value is TOML, or a string where it is none.
    fn add_assignment(&mut self, assignment: &str) -> anyhow::Result<()> {
        let (key, value) = key_and_value(assignment, "nadir.pairs=20")?;
        self.add_text(&format!("{key} = {value}"), &format!("--set {key}"))
    }

    fn add_table(&mut self, table: Table, origin: String) {
        merge(&mut self.merged, table.clone());
        self.layers.push((table, origin));
    }

    /// Where a key's value came from: the last layer that names it.
    pub fn origin(&self, key: &str) -> &str {
        let named = self.layers.iter().rev().find(|(table, _)| names(table, key));
        named.map_or("default", |(_, origin)| origin)
    }

    /// The campaign, checked.
    ///
    /// # Errors
    /// A value outside its range, or keys that contradict each other.
    pub fn campaign(&self) -> anyhow::Result<Campaign> {
        if self.layers.is_empty() {
            return Err(refuse(
                "no campaign is named",
                "pass --preset NAME (`selenograph presets` lists them) or a campaign file",
            ));
        }
        Ok(Campaign::from_table(self.merged.clone())?)
    }
}

/// Key and value of an assignment; the value is TOML, or a string where it is none.
///
/// # Errors
/// What is no assignment; `example` is one.
pub fn key_and_value<'a>(assignment: &'a str, example: &str) -> anyhow::Result<(&'a str, String)> {
    let Some((key, value)) = assignment.split_once('=') else {
        return Err(refuse(
            format!("--set: `{assignment}` is not an assignment"),
            format!("write it as key=value, for example --set {example}"),
        ));
    };
    let (key, value) = (key.trim(), value.trim());
    let is_toml = format!("x = {value}").parse::<Table>().is_ok();
    Ok((key, if is_toml { value.to_owned() } else { format!("{value:?}") }))
}

/// The text with blanks where it names a preset, so that all else keeps its line and column.
fn without_preset(text: &str) -> String {
    let table = DeTable::parse(text).ok();
    let entry = table.as_ref().and_then(|table| table.get_ref().get_key_value(PRESET_KEY));
    let Some((key, value)) = entry else { return text.to_owned() };
    let span = key.span().start..value.span().end;
    let blank: String = text[span.clone()].chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect();
    format!("{}{blank}{}", &text[..span.start], &text[span.end..])
}

/// Whether a table holds a value under a dotted key.
fn names(table: &Table, key: &str) -> bool {
    match key.split_once('.') {
        None => table.contains_key(key),
        Some((first, rest)) => match table.get(first) {
            Some(Value::Table(inner)) => names(inner, rest),
            _ => false,
        },
    }
}

/// Every leaf of a resolved campaign as dotted key and value.
///
/// # Errors
/// If the campaign cannot be written as TOML.
pub fn leaves(campaign: &Campaign) -> anyhow::Result<Vec<(String, Value)>> {
    fn walk(table: &Table, prefix: &str, found: &mut Vec<(String, Value)>) {
        for (name, value) in table {
            let key = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
            match value {
                Value::Table(inner) => walk(inner, &key, found),
                leaf => found.push((key, leaf.clone())),
            }
        }
    }
    let mut found = Vec::new();
    walk(&campaign.to_toml()?.parse()?, "", &mut found);
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_layer_wins_and_says_so() {
        let mut layers = Layers::default();
        layers.add_text("preset = \"paper-iccv2025\"\nseed = 5\n", "mine.toml").unwrap();
        layers.add_assignment("nadir.pairs = 7").unwrap();
        layers.add_assignment("camera.focal_px=900.0").unwrap();
        let campaign = layers.campaign().unwrap();
        assert_eq!((campaign.seed, campaign.nadir.pairs), (5, 7));
        assert_eq!((campaign.camera.fov_deg, campaign.camera.focal_px), (None, Some(900.0)));
        assert_eq!(layers.origin("nadir.pairs"), "--set nadir.pairs");
        assert_eq!(layers.origin("seed"), "mine.toml");
        assert_eq!(layers.origin("oblique.pairs"), "preset paper-iccv2025");
        assert_eq!(layers.origin("limits.max_attempts"), "default");
        assert!(leaves(&campaign).unwrap().iter().any(|(key, _)| key == "sites.lat_deg.min"));
    }

    #[test]
    fn words_need_no_quotes_in_assignments() {
        let mut layers = Layers::default();
        layers.add_assignment("nadir.pairs=1").unwrap();
        layers.add_assignment("render.shadows=attached").unwrap();
        assert_eq!(layers.origin("render.shadows"), "--set render.shadows");
        assert!(layers.add_assignment("render.shadows").is_err());
        assert!(layers.campaign().is_ok());
    }

    #[test]
    fn one_end_of_a_range_is_set_over_what_is_there() {
        let mut layers = Layers::default();
        layers.add_preset("hard-cases").unwrap();
        layers.add_assignment("sites.lat_deg.max=-88.5").unwrap();
        let lat_deg = layers.campaign().unwrap().sites.lat_deg;
        assert_eq!((lat_deg.min, lat_deg.max), (-90.0, -88.5));
        // Where nothing is there it is still no range, and a key that does not exist is none.
        assert!(layers.add_assignment("sites.lon_deg.max=20.0").is_err());
        assert!(layers.add_assignment("sites.lat_deg.most=20.0").is_err());
    }

    #[test]
    fn a_preset_is_taken_out_wherever_toml_lets_it_stand() {
        for (text, left) in [
            ("preset = \"descent\"\nseed = 5\n", "                  \nseed = 5\n"),
            ("\"preset\"='descent' # why\nseed = 5", "                   # why\nseed = 5"),
            ("name = \"\"\"\npreset = 1\n\"\"\"\n", "name = \"\"\"\npreset = 1\n\"\"\"\n"),
            ("[nadir]\npreset = 1\n", "[nadir]\npreset = 1\n"),
        ] {
            assert_eq!(without_preset(text), left);
        }
    }

    #[test]
    fn a_preset_is_named_once() {
        let mut layers = Layers::default();
        layers.add_preset("descent").unwrap();
        assert!(layers.add_text("preset = \"polar-real\"", "x.toml").is_err());
    }
}
