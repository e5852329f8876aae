//! Settings of runs that come with the program, and how a file builds on one.

use super::settings::TrainSettings;
use crate::Error;
use selenograph_dataset::loader::LoaderOptions;
use selenograph_dataset::plan::preset::{merge, suggestion};
use serde::{Deserialize, Serialize};
use toml::Table;

/// The presets: name, and text of the TOML file.
pub const PRESETS: [(&str, &str); 2] = [
    ("paper-iccv2025", include_str!("../../../../presets/train/paper-iccv2025.toml")),
    ("from-scratch", include_str!("../../../../presets/train/from-scratch.toml")),
];

/// All that decides a run but its pairs and its first weights.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RunSettings {
    /// What is done with the pairs.
    pub learning: TrainSettings,
    /// How they are loaded.
    pub loader: LoaderOptions,
}

/// Text of a preset.
///
/// # Errors
/// [`Error::Settings`] with the names there are.
pub fn preset_text(name: &str) -> Result<&'static str, Error> {
    PRESETS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text).ok_or_else(|| Error::Settings {
        what: format!("preset `{name}`"),
        message: format!("there are {}", PRESETS.map(|(known, _)| known).join(", ")),
    })
}

impl RunSettings {
    /// Layers of TOML over the defaults, each with its name: a later one wins, key by key.
    ///
    /// # Errors
    /// [`Error::Settings`] naming the layer and the key.
    pub fn from_layers(layers: &[(String, String)]) -> Result<Self, Error> {
        let mut merged = Table::new();
        for (what, text) in layers {
            let wrong =
                |error: toml::de::Error| Error::Settings { what: what.clone(), message: told(&error, text) };
            // Each by itself first: only here is known where a wrong key comes from.
            toml::from_str::<Self>(text).map_err(wrong)?;
            merge(&mut merged, text.parse().map_err(wrong)?);
        }
        let settings: Self = merged.try_into().map_err(|error: toml::de::Error| Error::Settings {
            what: "settings".into(),
            message: error.to_string(),
        })?;
        settings.learning.check()?;
        Ok(settings)
    }

    /// The settings as a file, every key told.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }
}

/// A parser's refusal in one line, with the nearest known key where an unknown one was used.
fn told(error: &toml::de::Error, text: &str) -> String {
    let message = error.message().split(", expected one of").next().unwrap_or_default();
    // What comes from one key on the command line has no lines.
    let span = error.span().filter(|_| text.lines().count() > 1);
    let line = span.map(|span| text[..span.start].matches('\n').count() + 1);
    let place = line.map_or(String::new(), |line| format!("line {line}: "));
    match suggestion(error.message()) {
        Some(nearest) => format!("{place}{message}; did you mean `{nearest}`?"),
        None => format!("{place}{message}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_dataset::augment::Augmentation;

    /// What the paper's run resolves to: every line a promise. What is not in the preset's file are defaults, which must
    /// not move either.
    #[test]
    fn the_paper_s_preset_is_pinned() {
        let layer = ("preset".to_owned(), preset_text("paper-iccv2025").unwrap().to_owned());
        let settings = RunSettings::from_layers(&[layer]).unwrap();
        let text = settings.to_toml();
        println!("{text}");
        assert_eq!(text, include_str!("../../testdata/paper-iccv2025.resolved.toml"));
        assert_eq!(settings.loader.augmentation, Augmentation::published());
    }

    #[test]
    fn every_preset_resolves_and_a_wrong_key_is_named() {
        for (name, text) in PRESETS {
            RunSettings::from_layers(&[(name.into(), text.into())]).unwrap();
        }
        let wrong = |text: &str| {
            let layers = [("mine.toml".to_owned(), text.to_owned())];
            RunSettings::from_layers(&layers).unwrap_err().to_string()
        };
        let unknown = wrong("[learning]\nlearning_rat = 1e-3");
        assert_eq!(unknown, "mine.toml: line 2: unknown field `learning_rat`; did you mean `learning_rate`?");
        assert!(wrong("[learning]\n\nepochs = x").starts_with("mine.toml: line 3: "));
        assert!(wrong("[learning]\nlearning_rate = 0.0").contains("learning_rate"));
        let layers = [("a", "[learning]\nepochs = 3.0"), ("b", "[learning]\nclip = 1.0")];
        let both = RunSettings::from_layers(&layers.map(|(a, b)| (a.to_owned(), b.to_owned()))).unwrap();
        assert_eq!((both.learning.epochs, both.learning.clip), (3.0, Some(1.0)));
    }
}
