//! The campaigns that come with the program, and how a file builds on one.

use super::campaign::Campaign;
use crate::Error;
use toml::{Table, Value};

/// The presets: name, and text of the TOML file.
pub const PRESETS: [(&str, &str); 6] = [
    ("paper-iccv2025", include_str!("../../../../presets/paper-iccv2025.toml")),
    ("paper-iccv2025-scripts", include_str!("../../../../presets/paper-iccv2025-scripts.toml")),
    ("polar-real", include_str!("../../../../presets/polar-real.toml")),
    ("descent", include_str!("../../../../presets/descent.toml")),
    ("training", include_str!("../../../../presets/training.toml")),
    ("hard-cases", include_str!("../../../../presets/hard-cases.toml")),
];

/// Keys of which one replaces the other when a file builds on a preset.
const EXCLUSIVE: [(&str, &str, &str); 2] =
    [("camera", "fov_deg", "focal_px"), ("oblique", "tilt_deg", "distance_over_altitude")];

/// The key of a file that names the preset it builds on.
pub const PRESET_KEY: &str = "preset";

/// Text of a preset.
///
/// # Errors
/// [`Error::UnknownPreset`] with the names there are.
pub fn preset_text(name: &str) -> Result<&'static str, Error> {
    PRESETS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text).ok_or_else(|| {
        Error::UnknownPreset { name: name.into(), known: PRESETS.map(|(known, _)| known).join(", ") }
    })
}

/// A preset as a table that other settings can be laid over.
///
/// # Errors
/// [`Error::UnknownPreset`], or [`Error::Campaign`] for a text that is no TOML.
pub fn preset_table(name: &str) -> Result<Table, Error> {
    parse_table(preset_text(name)?)
}

fn parse_table(text: &str) -> Result<Table, Error> {
    text.parse::<Table>()
        .map_err(|error| Error::Campaign { what: error.to_string().trim_end().into(), nearest: None })
}

/// Lays `over` on `base`: tables key by key, everything else (lists too) as a whole.
pub fn merge(base: &mut Table, over: Table) {
    for (section, one, other) in EXCLUSIVE {
        let new = over.get(section).and_then(Value::as_table);
        let old = base.get_mut(section).and_then(Value::as_table_mut);
        if let (Some(new), Some(old)) = (new, old) {
            for (said, replaced) in [(one, other), (other, one)] {
                if new.contains_key(said) && !new.contains_key(replaced) {
                    old.remove(replaced);
                }
            }
        }
    }
    merge_tables(base, over);
}

fn merge_tables(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => {
                // A reflectance law or a tone of another kind has other keys: nothing of the old one is kept.
                let kind_changes =
                    ["law", "kind"].iter().any(|tag| new.get(*tag).is_some_and(|v| old.get(*tag) != Some(v)));
                if kind_changes {
                    old.clear();
                }
                merge_tables(old, new);
            }
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

impl Campaign {
    /// A preset.
    ///
    /// # Errors
    /// [`Error::UnknownPreset`].
    pub fn preset(name: &str) -> Result<Self, Error> {
        Self::from_toml(preset_text(name)?)
    }

    /// From the text of a campaign file, which may build on a preset (`preset = "polar-real"`).
    ///
    /// # Errors
    /// [`Error::Campaign`] for syntax, unknown keys (with the nearest known one) and wrong types; then as
    /// [`Campaign::check`].
    pub fn from_toml(text: &str) -> Result<Self, Error> {
        // Straight from the text, so that the message shows the line; only then, if asked for, over a preset.
        let mut table = parse_table(text)?;
        let Some(preset) = table.remove(PRESET_KEY) else {
            let campaign: Self = toml::from_str(text).map_err(|error| refused(&error))?;
            campaign.check()?;
            return Ok(campaign);
        };
        let name = preset.as_str().ok_or_else(|| Error::Value {
            key: PRESET_KEY.into(),
            expected: "the name of a preset".into(),
            found: preset.to_string(),
        })?;
        let mut base = preset_table(name)?;
        merge(&mut base, table);
        Self::from_table(base)
    }

    /// From a table that several sources were merged into.
    ///
    /// # Errors
    /// As [`Campaign::from_toml`].
    pub fn from_table(table: Table) -> Result<Self, Error> {
        let campaign: Self = table.try_into().map_err(|error| refused(&error))?;
        campaign.check()?;
        Ok(campaign)
    }

    /// The resolved campaign as TOML, every key told.
    ///
    /// # Errors
    /// [`Error::Campaign`] if a value has no place in TOML (a seed above 2⁶³ − 1).
    pub fn to_toml(&self) -> Result<String, Error> {
        toml::to_string(self).map_err(|error| Error::Campaign { what: error.to_string(), nearest: None })
    }

    /// Checksum of the resolved campaign (hex).
    ///
    /// # Errors
    /// As [`Campaign::to_toml`].
    pub fn checksum(&self) -> Result<String, Error> {
        Ok(selenograph_files::checksum::of_bytes(self.to_toml()?.as_bytes()).to_string())
    }
}

/// A parser's refusal, with the nearest known key where an unknown one was used. The parser lists all that are known: of a campaign
/// that is no help.
fn refused(error: &toml::de::Error) -> Error {
    let text = error.to_string();
    let lines: Vec<&str> =
        text.trim_end().lines().map(|line| line.split(", expected one of").next().unwrap_or(line)).collect();
    Error::Campaign { what: lines.join("\n"), nearest: suggestion(error.message()) }
}

/// The name nearest to the unknown one in serde's "unknown field `x`, expected one of `a`, `b`".
pub fn suggestion(message: &str) -> Option<String> {
    if !message.contains("unknown ") {
        return None;
    }
    let mut names = message.split('`').skip(1).step_by(2);
    let unknown = names.next()?;
    let nearest = names.map(|name| (strsim::levenshtein(unknown, name), name)).min()?;
    // Half of the letters wrong is another word.
    (nearest.0 <= unknown.chars().count().div_ceil(2)).then(|| nearest.1.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pair::Trajectory;
    use crate::plan::interval::Interval;

    #[test]
    fn every_preset_reads_and_round_trips() {
        for (name, text) in PRESETS {
            let campaign = Campaign::preset(name).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(campaign.name, name);
            assert!(text.starts_with('#'), "{name}: says first what it is for");
            let again = Campaign::from_toml(&campaign.to_toml().unwrap()).unwrap();
            assert_eq!(again, campaign);
            assert_eq!(again.checksum().unwrap(), campaign.checksum().unwrap());
        }
        assert!(matches!(Campaign::preset("paper"), Err(Error::UnknownPreset { .. })));
    }

    #[test]
    fn a_file_builds_on_a_preset() {
        let text = "preset = \"paper-iccv2025\"\nseed = 9\nnadir.pairs = 3\ncamera.focal_px = 700.0\n\
                    [tone]\nkind = \"min-max\"\nbits = 8\n";
        let campaign = Campaign::from_toml(text).unwrap();
        assert_eq!((campaign.seed, campaign.nadir.pairs), (9, 3));
        assert_eq!(campaign.nadir.b_over_h, Interval::new(0.04, 0.10));
        assert_eq!(campaign.camera.camera().unwrap().fx, 700.0);
        assert_eq!(campaign.pairs_by_trajectory()[0], (Trajectory::Nadir, 3));
    }

    #[test]
    fn unknown_keys_come_with_a_suggestion_and_a_line() {
        let error = Campaign::from_toml("[nadir]\npairs = 1\naltitude_level_m = [1.0]\n").unwrap_err();
        let Error::Campaign { what, nearest } = error else { panic!("{error}") };
        assert_eq!(nearest.as_deref(), Some("altitude_levels_m"));
        assert!(what.contains("line 3") && what.ends_with("unknown field `altitude_level_m`"), "{what}");
        let error = Campaign::from_toml("preset = \"descent\"\n[nadir]\npears = 1\n").unwrap_err();
        assert!(matches!(error, Error::Campaign { nearest: Some(ref key), .. } if key == "pairs"), "{error}");
        assert_eq!(suggestion("unknown field `zzz`, expected `abc`"), None);
    }

    #[test]
    fn contradictions_name_both_keys() {
        let cases = [
            ("[nadir]\npairs=1\nb_over_h={min=0.2,max=0.1}", "nadir.b_over_h.min", "nadir.b_over_h.max"),
            ("nadir.pairs=1\n[camera]\nfov_deg=45.0\nfocal_px=600.0", "camera.fov_deg", "camera.focal_px"),
            (
                "[oblique]\npairs=1\ntilt_deg={min=20.0,max=30.0}\ndistance_over_altitude={min=0.5,max=1.0}",
                "oblique.tilt_deg",
                "oblique.distance_over_altitude",
            ),
            (
                "nadir.pairs=1\nlimits.min_lit_share=0.1\nrender.shadows=\"attached\"",
                "limits.min_lit_share",
                "render.shadows",
            ),
            ("nadir.pairs=1\ntone={kind=\"min-max\",quantile=0.9}", "tone.kind", "tone.quantile"),
            ("[dynamic]\npairs=1\ncone_deg=[1.0,2.0]", "dynamic.cone_deg", "dynamic.cone_weights"),
        ];
        for (text, first, second) in cases {
            match Campaign::from_toml(text) {
                Err(Error::Contradiction { first: f, second: s, .. }) => {
                    assert_eq!((f.as_str(), s.as_str()), (first, second));
                }
                other => panic!("{text}: {other:?}"),
            }
        }
    }

    #[test]
    fn absurd_values_are_refused_by_name() {
        for (text, key) in [
            ("nadir.pairs=1\nrender.rays_per_pixel=0", "render.rays_per_pixel"),
            ("nadir.pairs=1\nlights=[]", "lights"),
            ("nadir.pairs=1\nsites.lat_deg={min=-91.0,max=0.0}", "sites.lat_deg.min"),
            ("nadir.pairs=0", "nadir.pairs, oblique.pairs, …"),
            ("nadir.pairs=1\nnadir.altitude_levels_m=[nan]", "nadir.altitude_levels_m"),
            ("nadir.pairs=1\ncamera.focal_px=-3.0", "camera.focal_px"),
            ("nadir.pairs=1000000000000", "nadir.pairs"),
            ("nadir.pairs=900000\nlow_light.pairs=900000", "low_light.pairs"),
            ("nadir.pairs=1\ncamera.width_px=1000000000", "camera.width_px"),
            ("nadir.pairs=1\nsites.grid_lat=90000\nsites.grid_lon=90000", "sites.grid_lat × sites.grid_lon"),
        ] {
            match Campaign::from_toml(text) {
                Err(Error::Value { key: found, .. }) => assert_eq!(found, key),
                other => panic!("{text}: {other:?}"),
            }
        }
        assert!(matches!(
            Campaign::from_toml("nadir.pairs=1\ncamera.fov_deg=190.0"),
            Err(Error::Geometry(_))
        ));
    }
}
