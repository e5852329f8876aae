//! The sections of a campaign that say how cameras fly.

use super::campaign::Campaign;
use super::interval::{Interval, check_number};
use crate::Error;
use crate::pair::Trajectory;
use serde::{Deserialize, Serialize};

/// Altitudes that a camera may be told to fly at, metres.
const ALTITUDES: Interval = Interval::new(1.0, 1e7);
const ANY_SHARE: Interval = Interval::new(0.0, 1.0);
const HALF_TURN: Interval = Interval::new(0.0, 180.0);

/// The paper's altitudes, metres.
const PAPER_LEVELS_M: [f64; 10] =
    [3_500.0, 6_200.0, 9_500.0, 12_800.0, 16_100.0, 19_400.0, 22_700.0, 26_000.0, 29_200.0, 30_500.0];

fn check_levels(section: &str, levels: &[f64], jitter_share: f64) -> Result<(), Error> {
    let key = format!("{section}.altitude_levels_m");
    if levels.is_empty() {
        return Err(Error::Value { key, expected: "at least one altitude".into(), found: "none".into() });
    }
    for level in levels {
        check_number(&key, *level, ALTITUDES)?;
    }
    check_number(&format!("{section}.altitude_jitter_share"), jitter_share, Interval::new(0.0, 0.9))
}

fn contradiction(section: &str, first: &str, second: &str, why: &str) -> Error {
    Error::Contradiction {
        first: format!("{section}.{first}"),
        second: format!("{section}.{second}"),
        why: why.into(),
    }
}

/// Which surface an altitude is measured from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AltitudeAbove {
    /// The median height of the ground round the site.
    Terrain,
    /// The reference sphere.
    Sphere,
}

/// Where the second nadir camera looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SecondCamera {
    /// Straight down, as the first.
    Vertical,
    /// Back at the site.
    Converging,
}

/// Which way the image's right is turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Heading {
    /// Any azimuth, drawn per pair; both cameras alike.
    Random,
    /// Along the world's +Y, as the reference scripts' fallback has it.
    WorldY,
    /// Dynamic only: across each camera's own line of sight, which turns freely (the reference scripts).
    Free,
}

/// `[nadir]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NadirSection {
    /// How many pairs.
    pub pairs: u64,
    /// Altitudes over the terrain, used in turn.
    pub altitude_levels_m: Vec<f64>,
    /// Each altitude varies by this share, up and down.
    pub altitude_jitter_share: f64,
    /// Baseline over altitude.
    pub b_over_h: Interval,
    /// Where the second camera looks.
    pub second_camera: SecondCamera,
    /// Direction of the baseline, which is the image's right.
    pub heading: Heading,
}

impl Default for NadirSection {
    fn default() -> Self {
        Self {
            pairs: 0,
            altitude_levels_m: PAPER_LEVELS_M.into(),
            altitude_jitter_share: 0.02,
            b_over_h: Interval::new(0.04, 0.10),
            second_camera: SecondCamera::Vertical,
            heading: Heading::Random,
        }
    }
}

impl NadirSection {
    pub(super) fn check(&self) -> Result<(), Error> {
        check_levels("nadir", &self.altitude_levels_m, self.altitude_jitter_share)?;
        if self.heading == Heading::Free {
            return Err(Error::Value {
                key: "nadir.heading".into(),
                expected: "`random` or `world-y`".into(),
                found: "free".into(),
            });
        }
        self.b_over_h.check("nadir.b_over_h", Interval::new(0.0, 2.0))
    }
}

/// How the two altitudes of an oblique pair relate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AltitudeStrategy {
    /// Each camera at the level, with its own jitter.
    Level,
    /// The reference scripts': same, close, different or progressive within 1 km round the level.
    Scripts,
}

/// `[oblique]`. `tilt_deg` or `distance_over_altitude`, not both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObliqueSection {
    /// How many pairs.
    pub pairs: u64,
    /// Altitudes, used in turn.
    pub altitude_levels_m: Vec<f64>,
    /// Each altitude varies by this share, up and down (`level`).
    pub altitude_jitter_share: f64,
    /// How the two altitudes relate.
    pub altitude_strategy: AltitudeStrategy,
    /// Half the band of the strategy `scripts`.
    pub altitude_band_m: f64,
    /// What altitudes are measured from.
    pub altitude_above: AltitudeAbove,
    /// Angle of the optical axis from the vertical at the camera; 20 to 35 if neither this nor
    /// `distance_over_altitude` is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt_deg: Option<Interval>,
    /// Horizontal distance to the target over the altitude (the reference scripts).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_over_altitude: Option<Interval>,
    /// The azimuths of the two cameras differ from a common one by up to this.
    pub azimuth_spread_deg: f64,
    /// The two targets lie this far east and west of the site.
    pub target_shift_m: f64,
    /// Least baseline over altitude: tilts and azimuths are drawn for each camera, and may nearly agree.
    pub min_b_over_h: f64,
}

impl Default for ObliqueSection {
    fn default() -> Self {
        Self {
            pairs: 0,
            altitude_levels_m: PAPER_LEVELS_M.into(),
            altitude_jitter_share: 0.02,
            altitude_strategy: AltitudeStrategy::Level,
            altitude_band_m: 1000.0,
            altitude_above: AltitudeAbove::Terrain,
            tilt_deg: None,
            distance_over_altitude: None,
            azimuth_spread_deg: 10.0,
            target_shift_m: 0.0,
            min_b_over_h: 0.04,
        }
    }
}

/// The tilt where nothing else is said, degrees (the paper's).
pub(super) const DEFAULT_TILT_DEG: Interval = Interval::new(20.0, 35.0);

impl ObliqueSection {
    pub(super) fn check(&self) -> Result<(), Error> {
        check_levels("oblique", &self.altitude_levels_m, self.altitude_jitter_share)?;
        if self.tilt_deg.is_some() && self.distance_over_altitude.is_some() {
            let why = "each of them decides the tilt";
            return Err(contradiction("oblique", "tilt_deg", "distance_over_altitude", why));
        }
        if let Some(tilt) = self.tilt_deg {
            tilt.check("oblique.tilt_deg", Interval::new(0.1, 80.0))?;
        }
        if let Some(distance) = self.distance_over_altitude {
            distance.check("oblique.distance_over_altitude", Interval::new(1e-3, 10.0))?;
        }
        check_number("oblique.altitude_band_m", self.altitude_band_m, Interval::new(0.0, 1e6))?;
        check_number("oblique.azimuth_spread_deg", self.azimuth_spread_deg, HALF_TURN)?;
        check_number("oblique.min_b_over_h", self.min_b_over_h, Interval::new(0.0, 1.0))?;
        check_number("oblique.target_shift_m", self.target_shift_m, Interval::new(0.0, 1e5))
    }
}

/// What `dynamic.b_over_h` measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OffsetMeaning {
    /// The distance between the two cameras in space, over their mean altitude: what `baseline_over_height` in `pair.json` tells.
    /// The second altitude is drawn within what the baseline leaves.
    BetweenCameras,
    /// The horizontal distance between the two cameras, over their mean altitude; their altitudes are drawn each by itself, and
    /// make the baseline longer.
    Horizontal,
    /// Each camera's own horizontal distance from the site, in its own direction (the reference scripts).
    FromSite,
}

/// `[dynamic]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DynamicSection {
    /// How many pairs.
    pub pairs: u64,
    /// Altitudes over the terrain, used in turn.
    pub altitude_levels_m: Vec<f64>,
    /// Each camera's altitude varies by this share, up and down.
    pub altitude_variation_share: f64,
    /// Baseline or horizontal offset over altitude.
    pub b_over_h: Interval,
    /// Which of them.
    pub b_over_h_of: OffsetMeaning,
    /// The target lies up to this far from the site, in any horizontal direction.
    pub target_shift_m: f64,
    /// Largest angles between the optical axis and the target, one drawn per camera.
    pub cone_deg: Vec<f64>,
    /// Their weights.
    pub cone_weights: Vec<f64>,
    /// Largest extra turns about the image's right, one drawn per camera.
    pub pitch_deg: Vec<f64>,
    /// Their weights.
    pub pitch_weights: Vec<f64>,
    /// Roll about the optical axis, up and down.
    pub roll_deg: f64,
    /// Which way the image's right is turned before the roll.
    pub heading: Heading,
}

impl Default for DynamicSection {
    fn default() -> Self {
        Self {
            pairs: 0,
            altitude_levels_m: PAPER_LEVELS_M.into(),
            altitude_variation_share: 0.3,
            b_over_h: Interval::new(0.05, 0.18),
            b_over_h_of: OffsetMeaning::BetweenCameras,
            target_shift_m: 500.0,
            cone_deg: vec![10.0],
            cone_weights: vec![1.0],
            pitch_deg: vec![0.0],
            pitch_weights: vec![1.0],
            roll_deg: 10.0,
            heading: Heading::Random,
        }
    }
}

impl DynamicSection {
    pub(super) fn check(&self) -> Result<(), Error> {
        check_levels("dynamic", &self.altitude_levels_m, self.altitude_variation_share)?;
        self.b_over_h.check("dynamic.b_over_h", Interval::new(0.0, 2.0))?;
        check_number("dynamic.target_shift_m", self.target_shift_m, Interval::new(0.0, 1e5))?;
        check_number("dynamic.roll_deg", self.roll_deg, HALF_TURN)?;
        let lists = [
            ("cone_deg", &self.cone_deg, "cone_weights", &self.cone_weights),
            ("pitch_deg", &self.pitch_deg, "pitch_weights", &self.pitch_weights),
        ];
        for (name, angles, weights_name, weights) in lists {
            if angles.len() != weights.len() || angles.is_empty() {
                let why = format!("{} angles for {} weights", angles.len(), weights.len());
                return Err(contradiction("dynamic", name, weights_name, &why));
            }
            for angle in angles {
                check_number(&format!("dynamic.{name}"), *angle, Interval::new(0.0, 80.0))?;
            }
            for weight in weights {
                check_number(&format!("dynamic.{weights_name}"), *weight, ANY_SHARE)?;
            }
            if weights.iter().sum::<f64>() <= 0.0 {
                return Err(Error::Value {
                    key: format!("dynamic.{weights_name}"),
                    expected: "a positive sum".into(),
                    found: "0".into(),
                });
            }
        }
        Ok(())
    }
}

/// `[descent]`: A above, B below; each looks down at the same ground, so that the epipole lies inside the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DescentSection {
    /// How many pairs.
    pub pairs: u64,
    /// Altitudes of A over the terrain, used in turn.
    pub altitude_levels_m: Vec<f64>,
    /// Each altitude varies by this share, up and down.
    pub altitude_jitter_share: f64,
    /// Altitude of B over that of A.
    pub altitude_ratio: Interval,
    /// Horizontal drift between the two, over the altitude that was lost.
    pub drift: Interval,
    /// Each optical axis leans from the vertical by up to this.
    pub tilt_deg: f64,
    /// Roll between the two, up and down.
    pub roll_deg: f64,
}

impl Default for DescentSection {
    fn default() -> Self {
        Self {
            pairs: 0,
            altitude_levels_m: PAPER_LEVELS_M.into(),
            altitude_jitter_share: 0.02,
            altitude_ratio: Interval::new(0.5, 0.9),
            drift: Interval::new(0.0, 0.1),
            tilt_deg: 3.0,
            roll_deg: 10.0,
        }
    }
}

impl DescentSection {
    pub(super) fn check(&self) -> Result<(), Error> {
        check_levels("descent", &self.altitude_levels_m, self.altitude_jitter_share)?;
        self.altitude_ratio.check("descent.altitude_ratio", Interval::new(0.01, 0.999))?;
        self.drift.check("descent.drift", Interval::new(0.0, 1.0))?;
        check_number("descent.tilt_deg", self.tilt_deg, Interval::new(0.0, 45.0))?;
        check_number("descent.roll_deg", self.roll_deg, HALF_TURN)
    }
}

/// `[low_light]`: nadir pairs on the flattest of several sites, under Suns near the horizon.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LowLightSection {
    /// How many pairs.
    pub pairs: u64,
    /// Altitudes over the terrain, used in turn.
    pub altitude_levels_m: Vec<f64>,
    /// Baseline over altitude.
    pub b_over_h: Interval,
    /// Sites compared; the one with the least relief is taken.
    pub candidates: usize,
    /// Elevation of every Sun of these pairs (their azimuths are those of `lights`).
    pub elevation_deg: Interval,
}

impl Default for LowLightSection {
    fn default() -> Self {
        Self {
            pairs: 0,
            altitude_levels_m: PAPER_LEVELS_M.into(),
            b_over_h: Interval::new(0.04, 0.10),
            candidates: 16,
            elevation_deg: Interval::new(0.5, 3.0),
        }
    }
}

impl LowLightSection {
    pub(super) fn check(&self) -> Result<(), Error> {
        check_levels("low_light", &self.altitude_levels_m, 0.0)?;
        self.b_over_h.check("low_light.b_over_h", Interval::new(0.0, 2.0))?;
        check_number("low_light.candidates", self.candidates as f64, Interval::new(1.0, 1000.0))?;
        self.elevation_deg.check("low_light.elevation_deg", Interval::new(-90.0, 90.0))
    }
}

/// `[no_overlap]`: two nadir views that share no ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoOverlapSection {
    /// How many pairs.
    pub pairs: u64,
    /// Altitudes over the terrain, used in turn.
    pub altitude_levels_m: Vec<f64>,
    /// Distance between the cameras over the width of the ground that one of them sees.
    pub footprints_apart: Interval,
}

impl Default for NoOverlapSection {
    fn default() -> Self {
        Self {
            pairs: 0,
            altitude_levels_m: PAPER_LEVELS_M.into(),
            // Above the square root of 2, so that no turn brings the corners together, and some more for relief.
            footprints_apart: Interval::new(1.8, 2.5),
        }
    }
}

impl NoOverlapSection {
    pub(super) fn check(&self) -> Result<(), Error> {
        check_levels("no_overlap", &self.altitude_levels_m, 0.0)?;
        self.footprints_apart.check("no_overlap.footprints_apart", Interval::new(1.5, 100.0))
    }
}

/// `[identical]`: the same view twice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IdenticalSection {
    /// How many pairs.
    pub pairs: u64,
    /// Altitudes over the terrain, used in turn.
    pub altitude_levels_m: Vec<f64>,
}

impl Default for IdenticalSection {
    fn default() -> Self {
        Self { pairs: 0, altitude_levels_m: PAPER_LEVELS_M.into() }
    }
}

impl IdenticalSection {
    pub(super) fn check(&self) -> Result<(), Error> {
        check_levels("identical", &self.altitude_levels_m, 0.0)
    }
}

/// Most pairs of a campaign: a plan is held in memory, row by row.
const MAX_PAIRS: u64 = 1_000_000;

impl Campaign {
    /// Refuses more pairs than a plan may have, by the section that passes the limit.
    pub(super) fn check_pairs(&self) -> Result<(), Error> {
        let mut left = MAX_PAIRS;
        for (trajectory, pairs) in self.pairs_by_trajectory() {
            left = left.checked_sub(pairs).ok_or_else(|| Error::Value {
                key: format!("{}.pairs", trajectory.as_str().replace('-', "_")),
                expected: format!("at most {MAX_PAIRS} pairs in all sections together"),
                found: pairs.to_string(),
            })?;
        }
        Ok(())
    }

    /// How many pairs each trajectory has; pair numbers run through them in this order.
    pub fn pairs_by_trajectory(&self) -> [(Trajectory, u64); 7] {
        [
            (Trajectory::Nadir, self.nadir.pairs),
            (Trajectory::Oblique, self.oblique.pairs),
            (Trajectory::Dynamic, self.dynamic.pairs),
            (Trajectory::Descent, self.descent.pairs),
            (Trajectory::LowLight, self.low_light.pairs),
            (Trajectory::NoOverlap, self.no_overlap.pairs),
            (Trajectory::Identical, self.identical.pairs),
        ]
    }

    /// The altitudes of a trajectory, metres.
    pub fn altitude_levels_m(&self, trajectory: Trajectory) -> &[f64] {
        match trajectory {
            Trajectory::Nadir => &self.nadir.altitude_levels_m,
            Trajectory::Oblique => &self.oblique.altitude_levels_m,
            Trajectory::Dynamic => &self.dynamic.altitude_levels_m,
            Trajectory::Descent => &self.descent.altitude_levels_m,
            Trajectory::LowLight => &self.low_light.altitude_levels_m,
            Trajectory::NoOverlap => &self.no_overlap.altitude_levels_m,
            Trajectory::Identical => &self.identical.altitude_levels_m,
        }
    }
}
