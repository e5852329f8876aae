//! Settings of the methods that an evaluation changes: parts switched off one by one.

use crate::Error;
use selenograph_dataset::plan::preset::{merge, suggestion};
use selenograph_reconstruct::pipeline::Options;
use serde::{Deserialize, Serialize};
use std::fmt;
use toml::{Table, Value};

/// The parts of [`Options`] that may be set; the others an evaluation decides itself.
const PARTS: [&str; 4] = ["orb", "sift", "stereo", "shading"];
/// What of them is decided as well: the whole image is judged.
const COMPLETION: &str = "completion";

/// Settings of the methods of `reconstruct` that are not the usual ones, by part and key.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Overrides(Table);

impl Overrides {
    /// Lays one key over what is there; `value` is TOML.
    ///
    /// # Errors
    /// [`Error::Setting`] for a key that there is not, or that an evaluation decides, and a value of another type.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), Error> {
        let wrong = |what: String, nearest| Error::Setting { key: key.to_owned(), what, nearest };
        let table: Table =
            format!("{key} = {value}").parse().map_err(|_| wrong("no key with a value".to_owned(), None))?;
        for (part, keys) in &table {
            if !PARTS.contains(&part.as_str()) || !keys.is_table() {
                return Err(wrong(format!("expected a key of {}", PARTS.join(", ")), None));
            }
            if part == "stereo" && keys.get(COMPLETION).is_some() {
                return Err(wrong("an evaluation judges the whole image".to_owned(), None));
            }
        }
        let mut merged = self.clone();
        merge(&mut merged.0, table);
        merged.checked().map_err(|error| {
            let message = error.message().to_owned();
            let what = message.split(", expected one of").next().unwrap_or(&message).to_owned();
            wrong(what, suggestion(&message))
        })?;
        *self = merged;
        Ok(())
    }

    /// Whether everything is as usual.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The settings of the methods.
    ///
    /// # Errors
    /// [`Error::Setting`] for a record of another version.
    pub fn options(&self) -> Result<Options, Error> {
        self.checked().map_err(|error| Error::Setting {
            key: "set".to_owned(),
            what: error.message().to_owned(),
            nearest: None,
        })
    }

    fn checked(&self) -> Result<Options, toml::de::Error> {
        // Each part has its defaults, and takes the rest from them.
        self.0.clone().try_into()
    }
}

impl fmt::Display for Overrides {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = self.0.iter().filter_map(|(part, keys)| Some((part, keys.as_table()?)));
        let leaves = parts.flat_map(|(part, keys)| keys.iter().map(move |leaf| (part, leaf)));
        for (k, (part, (key, value))) in leaves.enumerate() {
            let comma = if k > 0 { ", " } else { "" };
            write!(f, "{comma}{part}.{key} = {}", Shown(value))?;
        }
        Ok(())
    }
}

/// A value without the quotes of text.
struct Shown<'a>(&'a Value);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Value::String(text) => f.write_str(text),
            other => write!(f, "{other}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_set_over_their_defaults_and_what_is_none_is_told() {
        let mut set = Overrides::default();
        set.set("shading.estimate_weights", "false").unwrap();
        set.set("shading.noise", "0.02").unwrap();
        let options = set.options().unwrap();
        assert!(!options.shading.estimate_weights);
        assert_eq!((options.shading.noise, &options.stereo), (0.02, &Options::default().stereo));
        assert_eq!(set.to_string(), "shading.estimate_weights = false, shading.noise = 0.02");
        let nearest = |set: &mut Overrides, key: &str, value: &str| match set.set(key, value) {
            Err(Error::Setting { nearest, .. }) => nearest,
            other => panic!("{key}: {other:?}"),
        };
        assert_eq!(nearest(&mut set, "shading.noize", "1.0"), Some("noise".to_owned()));
        for (key, value) in [
            ("method", "\"orb\""),
            ("shading", "1"),
            ("shading.noise", "\"much\""),
            ("stereo.completion", "\"none\""),
            ("shading.noise.x", "1"),
        ] {
            assert_eq!(nearest(&mut set, key, value), None, "{key}");
        }
        // What was refused has left no trace.
        assert_eq!(set.options().unwrap(), options);
    }
}
