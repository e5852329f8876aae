//! Which items belong together.

use crate::dataset_source::load::ItemRecord;
use crate::run::Line;
use selenograph_dataset::pair::Trajectory;

/// By what a table is broken down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Breakdown {
    /// Not at all.
    All,
    /// By how the pair was flown.
    Trajectory,
    /// By the light of view A.
    Light,
    /// By the altitude over the ground.
    Altitude,
    /// By the share of A that B sees.
    Overlap,
    /// By the angle between the Suns of the two views.
    Illumination,
}

/// Bounds of the altitude bands, metres.
const ALTITUDES_M: [f64; 4] = [5e3, 10e3, 20e3, 30e3];
/// Bounds of the overlap classes.
const OVERLAPS: [f64; 3] = [0.5, 0.75, 0.9];
/// Bounds of the illumination classes, degrees.
const ILLUMINATIONS_DEG: [f64; 3] = [30.0, 60.0, 90.0];
/// Two pictures under Suns nearer to each other than this are under the same light, degrees.
const SAME_LIGHT_DEG: f64 = 1e-6;

impl Breakdown {
    /// All that split.
    pub const SPLITS: [Self; 5] =
        [Self::Trajectory, Self::Light, Self::Altitude, Self::Overlap, Self::Illumination];

    /// Its name in file names and headings.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Trajectory => "trajectory",
            Self::Light => "light",
            Self::Altitude => "altitude",
            Self::Overlap => "overlap",
            Self::Illumination => "illumination",
        }
    }

    /// Order and name of an item's class.
    pub fn class_of(self, item: &ItemRecord) -> (usize, String) {
        match self {
            Self::All => (0, "all".into()),
            Self::Trajectory => match item.trajectory {
                Some(flown) => {
                    let order = Trajectory::ALL.iter().position(|t| *t == flown).unwrap_or(0);
                    (order, flown.as_str().into())
                }
                None => (Trajectory::ALL.len(), "unknown".into()),
            },
            Self::Light => (usize::try_from(item.light_a).unwrap_or(0), format!("light {}", item.light_a)),
            Self::Altitude => banded(item.altitude_m, &ALTITUDES_M, |m| format!("{} km", m / 1e3)),
            Self::Overlap => banded(item.overlap_share, &OVERLAPS, |share| format!("{} %", share * 100.0)),
            Self::Illumination => match item.illumination_difference_deg {
                Some(angle) if angle < SAME_LIGHT_DEG => (0, "same light".into()),
                Some(angle) => {
                    let (order, name) = banded(angle, &ILLUMINATIONS_DEG, |deg| format!("{deg}°"));
                    (order + 1, name)
                }
                None => (usize::MAX, "other light, Suns unknown".into()),
            },
        }
    }

    /// The classes that the lines fall into, in order, each with its lines.
    pub fn split<'a>(self, lines: impl IntoIterator<Item = &'a Line>) -> Vec<(String, Vec<&'a Line>)> {
        let mut classes: std::collections::BTreeMap<(usize, String), Vec<&Line>> =
            std::collections::BTreeMap::new();
        for line in lines {
            classes.entry(self.class_of(&line.item)).or_default().push(line);
        }
        classes.into_iter().map(|((_, name), lines)| (name, lines)).collect()
    }
}

/// Whether the pair has an answer to compare: two views of different places that share ground.
pub fn has_an_answer(item: &ItemRecord) -> bool {
    !matches!(item.trajectory, Some(Trajectory::NoOverlap | Trajectory::Identical))
}

/// Number and name of the band that a value lies in.
fn banded(value: f64, bounds: &[f64], name: impl Fn(f64) -> String) -> (usize, String) {
    let band = bounds.iter().take_while(|bound| value >= **bound).count();
    let text = match (band.checked_sub(1).map(|k| bounds[k]), bounds.get(band)) {
        (None, Some(high)) => format!("below {}", name(*high)),
        (Some(low), Some(high)) => format!("{} to {}", name(low), name(*high)),
        (Some(low), None) => format!("from {}", name(low)),
        (None, None) => "all".into(),
    };
    (band, text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::lines::tests::line;

    #[test]
    fn bands_have_their_lower_bound_inside() {
        let of = |value: f64| banded(value, &ALTITUDES_M, |m| format!("{} km", m / 1e3));
        assert_eq!(of(4999.9), (0, "below 5 km".into()));
        assert_eq!(of(5000.0), (1, "5 km to 10 km".into()));
        assert_eq!(of(1e6), (4, "from 30 km".into()));
    }

    #[test]
    fn lines_are_split_in_order() {
        let mut lines: Vec<Line> = (0..4).map(|k| line("sift", "a", k, Some(0.1), 0.1)).collect();
        lines[0].item.trajectory = Some(Trajectory::Dynamic);
        lines[1].item.trajectory = None;
        let classes = Breakdown::Trajectory.split(&lines);
        let names: Vec<(&str, usize)> = classes.iter().map(|(name, l)| (name.as_str(), l.len())).collect();
        assert_eq!(names, [("nadir", 2), ("dynamic", 1), ("unknown", 1)]);
        lines[2].item.illumination_difference_deg = Some(75.0);
        lines[3].item.illumination_difference_deg = None;
        let classes = Breakdown::Illumination.split(&lines);
        let names: Vec<&str> = classes.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["same light", "60° to 90°", "other light, Suns unknown"]);
    }
}
