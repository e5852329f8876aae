//! A campaign: everything that decides what pairs a plan holds and how they are rendered, as a TOML file.

use super::interval::{Interval, check_number};
use super::lighting::Light;
use super::rendering::{OutputSection, RenderSection, ToneSection};
use super::sections::{
    DescentSection, DynamicSection, IdenticalSection, LowLightSection, NadirSection, NoOverlapSection,
    ObliqueSection,
};
use crate::Error;
use selenograph_geometry::{Camera, Distortion};
use selenograph_render::Shadows;
use selenograph_terrain::cover::CoverLimits;
use serde::{Deserialize, Serialize};

/// A whole campaign. Every key has a default, so that a file says only what it changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Campaign {
    /// Its name, for people.
    pub name: String,
    /// Every random number derives from it.
    pub seed: u64,
    /// The camera of both views.
    pub camera: CameraSection,
    /// Where pairs are put.
    pub sites: SiteSection,
    /// When a place is refused.
    pub limits: LimitSection,
    /// Both cameras look down from one altitude.
    pub nadir: NadirSection,
    /// Level horizon, tilted views.
    pub oblique: ObliqueSection,
    /// Independent altitudes, offsets, tilts and rolls.
    pub dynamic: DynamicSection,
    /// One camera above the other.
    pub descent: DescentSection,
    /// Hard case: low light on flat ground.
    pub low_light: LowLightSection,
    /// Hard case: views that share no ground.
    pub no_overlap: NoOverlapSection,
    /// Hard case: the same view twice.
    pub identical: IdenticalSection,
    /// The Suns of every pair, in file order.
    pub lights: Vec<Light>,
    /// How images are made.
    pub render: RenderSection,
    /// How radiance becomes grey levels.
    pub tone: ToneSection,
    /// What is written beyond pictures, depth and records.
    pub output: OutputSection,
}

impl Default for Campaign {
    fn default() -> Self {
        Self {
            name: "campaign".into(),
            seed: 0,
            camera: CameraSection::default(),
            sites: SiteSection::default(),
            limits: LimitSection::default(),
            nadir: NadirSection::default(),
            oblique: ObliqueSection::default(),
            dynamic: DynamicSection::default(),
            descent: DescentSection::default(),
            low_light: LowLightSection::default(),
            no_overlap: NoOverlapSection::default(),
            identical: IdenticalSection::default(),
            lights: [(330.0, 20.0), (250.0, 20.0), (180.0, 15.0)].map(|(az, el)| Light::fixed(az, el)).into(),
            render: RenderSection::default(),
            tone: ToneSection::default(),
            output: OutputSection::default(),
        }
    }
}

/// `[camera]`: one pinhole for both views. `fov_deg` or `focal_px`, not both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSection {
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Field of view across the width (45 if neither this nor `focal_px` is given).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fov_deg: Option<f64>,
    /// Focal length in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<f64>,
    /// Principal point from the image's corner; the middle by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub principal_point_px: Option<[f64; 2]>,
    /// Side of a pixel on the sensor, millimetres: only for the records.
    pub pixel_pitch_mm: f64,
    /// Lens distortion.
    pub distortion: Distortion,
}

impl Default for CameraSection {
    fn default() -> Self {
        Self {
            width_px: 512,
            height_px: 512,
            fov_deg: None,
            focal_px: None,
            principal_point_px: None,
            // 512 pixels over 5.12 mm: a nominal sensor, since the reference names none.
            pixel_pitch_mm: 0.01,
            distortion: Distortion::default(),
        }
    }
}

impl CameraSection {
    /// Field of view where nothing else is said, degrees (the paper's).
    const DEFAULT_FOV_DEG: f64 = 45.0;

    /// The camera.
    ///
    /// # Errors
    /// [`Error::Contradiction`] for both a field of view and a focal length, [`Error::Geometry`] for a camera that
    /// cannot be.
    pub fn camera(&self) -> Result<Camera, Error> {
        let mut camera = match (self.fov_deg, self.focal_px) {
            (Some(_), Some(_)) => {
                return Err(Error::Contradiction {
                    first: "camera.fov_deg".into(),
                    second: "camera.focal_px".into(),
                    why: "each of them decides the focal length".into(),
                });
            }
            (None, Some(focal)) => {
                check_number("camera.focal_px", focal, Interval::new(1e-3, 1e9))?;
                Camera::from_fov(
                    self.width_px,
                    self.height_px,
                    2.0 * (self.width_px as f64 / 2.0 / focal).atan(),
                )
                .map(|c| Camera { fx: focal, fy: focal, ..c })?
            }
            (fov, None) => Camera::from_fov(
                self.width_px,
                self.height_px,
                fov.unwrap_or(Self::DEFAULT_FOV_DEG).to_radians(),
            )?,
        };
        if let Some([cx, cy]) = self.principal_point_px {
            check_number("camera.principal_point_px[0]", cx, Interval::new(0.0, self.width_px as f64))?;
            check_number("camera.principal_point_px[1]", cy, Interval::new(0.0, self.height_px as f64))?;
            (camera.cx, camera.cy) = (cx, cy);
        }
        Ok(camera.with_distortion(self.distortion))
    }
}

/// How sites are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Placement {
    /// Uniform over the area of the latitude and longitude ranges.
    Area,
    /// The order of the reference scripts: a jittered grid, from the pole outwards, used up level after level.
    ScriptGrid,
    /// Within a layer of the terrain that is fine enough for the pair's altitude.
    Layers,
}

/// `[sites]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SiteSection {
    /// How they are chosen.
    pub placement: Placement,
    /// Latitudes (`area`, `script-grid`).
    pub lat_deg: Interval,
    /// East longitudes (`area`, `script-grid`); above 360 wraps round.
    pub lon_deg: Interval,
    /// Bands of latitude of the grid (`script-grid`).
    pub grid_lat: usize,
    /// Longitudes of the grid before thinning (`script-grid`).
    pub grid_lon: usize,
    /// Width of the ground whose median height is the site's height; by default what the camera sees from above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub footprint_m: Option<f64>,
}

impl Default for SiteSection {
    fn default() -> Self {
        Self {
            placement: Placement::Area,
            lat_deg: Interval::new(-90.0, -87.0),
            lon_deg: Interval::new(0.0, 360.0),
            grid_lat: 25,
            grid_lon: 50,
            footprint_m: None,
        }
    }
}

/// `[limits]`: when an attempt is refused, and how many attempts a pair has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LimitSection {
    /// Attempts before a pair becomes a listed skip.
    pub max_attempts: u32,
    /// Rays along each side of the picture that probe it (its border included).
    pub probe_rays: usize,
    /// Largest share of pixels that may see cells above `coarse_factor` times their GSD.
    pub max_coarse_share: f64,
    /// See `max_coarse_share`.
    pub coarse_factor: f64,
    /// Smallest share of A's pixels whose ground lies in B's frame, and the reverse (0: not asked).
    pub min_overlap: f64,
    /// Smallest share of the ground that each Sun must light, cast shadows included (0: not asked).
    pub min_lit_share: f64,
    /// Least height of a camera over the terrain straight below it.
    pub min_clearance_m: f64,
}

impl Default for LimitSection {
    fn default() -> Self {
        Self {
            max_attempts: 50,
            probe_rays: 32,
            max_coarse_share: 0.02,
            coarse_factor: 4.0,
            min_overlap: 0.0,
            min_lit_share: 0.0,
            min_clearance_m: 100.0,
        }
    }
}

impl LimitSection {
    /// The limits as the terrain's coverage takes them: nothing absent is ever allowed.
    pub fn cover(&self) -> CoverLimits {
        CoverLimits {
            coarse_factor: self.coarse_factor,
            max_coarse_share: self.max_coarse_share,
            max_absent_share: 0.0,
        }
    }

    fn check(&self) -> Result<(), Error> {
        let share = Interval::new(0.0, 1.0);
        check_number("limits.max_attempts", self.max_attempts.into(), Interval::new(1.0, 1e6))?;
        check_number("limits.probe_rays", self.probe_rays as f64, Interval::new(2.0, 1024.0))?;
        check_number("limits.max_coarse_share", self.max_coarse_share, share)?;
        check_number("limits.coarse_factor", self.coarse_factor, Interval::new(0.1, 1e6))?;
        check_number("limits.min_overlap", self.min_overlap, share)?;
        check_number("limits.min_lit_share", self.min_lit_share, share)?;
        check_number("limits.min_clearance_m", self.min_clearance_m, Interval::new(0.0, 1e7))
    }
}

/// Longest side of a picture, pixels: its truth maps are held in memory.
const MAX_SIDE_PX: f64 = 16_384.0;

impl Campaign {
    /// Checks every value against its range and against the others.
    ///
    /// # Errors
    /// [`Error::Value`], [`Error::Contradiction`] or [`Error::Geometry`], whichever comes first.
    pub fn check(&self) -> Result<(), Error> {
        for (key, side) in
            [("camera.width_px", self.camera.width_px), ("camera.height_px", self.camera.height_px)]
        {
            check_number(key, side as f64, Interval::new(1.0, MAX_SIDE_PX))?;
        }
        self.camera.camera()?;
        check_number("camera.pixel_pitch_mm", self.camera.pixel_pitch_mm, Interval::new(1e-6, 1e3))?;
        self.sites.lat_deg.check("sites.lat_deg", Interval::new(-90.0, 90.0))?;
        self.sites.lon_deg.check("sites.lon_deg", Interval::new(-360.0, 720.0))?;
        check_number("sites.grid_lat", self.sites.grid_lat as f64, Interval::new(1.0, 1e5))?;
        check_number("sites.grid_lon", self.sites.grid_lon as f64, Interval::new(1.0, 1e5))?;
        let num_sites = self.sites.grid_lat as f64 * self.sites.grid_lon as f64;
        check_number("sites.grid_lat × sites.grid_lon", num_sites, Interval::new(1.0, 1e7))?;
        if let Some(width) = self.sites.footprint_m {
            check_number("sites.footprint_m", width, Interval::new(0.0, 1e6))?;
        }
        self.limits.check()?;
        self.nadir.check()?;
        self.oblique.check()?;
        self.dynamic.check()?;
        self.descent.check()?;
        self.low_light.check()?;
        self.no_overlap.check()?;
        self.identical.check()?;
        self.check_lights()?;
        self.render.check()?;
        self.tone.check()?;
        self.check_pairs()?;
        if self.num_pairs() == 0 {
            return Err(Error::Value {
                key: "nadir.pairs, oblique.pairs, …".into(),
                expected: "at least one pair in one of the sections".into(),
                found: "none".into(),
            });
        }
        Ok(())
    }

    fn check_lights(&self) -> Result<(), Error> {
        if self.lights.is_empty() || self.lights.len() > 32 {
            return Err(Error::Value {
                key: "lights".into(),
                expected: "1 to 32 Suns".into(),
                found: self.lights.len().to_string(),
            });
        }
        for (idx, light) in self.lights.iter().enumerate() {
            light.check(idx)?;
        }
        if self.limits.min_lit_share > 0.0 && self.render.shadows == Shadows::Attached {
            return Err(Error::Contradiction {
                first: "limits.min_lit_share".into(),
                second: "render.shadows".into(),
                why: "attached shadows leave no ground in cast shadow, so the lit share is not the picture's"
                    .into(),
            });
        }
        Ok(())
    }

    /// Pairs of all sections together.
    pub fn num_pairs(&self) -> u64 {
        self.pairs_by_trajectory().iter().map(|(_, pairs)| pairs).sum()
    }
}
