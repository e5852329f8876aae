//! One planned pair rendered in memory: truth of both views, radiance under every Sun, what the views share.

use crate::Error;
use crate::covisibility::{self, Sight};
use crate::pair::{OverlapRecord, ViewName};
use crate::plan::rendering::RenderSection;
use crate::plan::{Campaign, PlacedPair, Refusal, Row};
use crate::rng::rng;
use selenograph_geometry::Body;
use selenograph_raster::Raster;
use selenograph_render::{
    Albedo, Error as RenderError, LightMaps, RadianceSettings, Shadows, Sun, Tracer, Truth, Viewpoint,
    radiance,
};
use selenograph_terrain::cover::{Coverage, Seen};

/// One pixel of so many along each axis decides the overlap (16 384 of a 512 × 512 picture: ±0.4 % at most).
pub(crate) const OVERLAP_STRIDE: usize = 4;

/// A rendered view.
pub struct SceneView {
    /// Which.
    pub name: ViewName,
    /// Camera and pose.
    pub view: Viewpoint,
    /// Geometry of each pixel.
    pub truth: Truth,
    /// Per Sun: radiance factor.
    pub radiance: Vec<Raster<f32>>,
    /// Per Sun: angles and lit mask.
    pub light: Vec<LightMaps>,
    /// Where each pixel's ground is in the other view: all of them, or every few.
    pub sights: Vec<Sight>,
}

/// A rendered pair.
pub struct Scene {
    /// A and B.
    pub views: [SceneView; 2],
    /// The Suns.
    pub suns: Vec<Sun>,
    /// Overlap both ways.
    pub overlap: OverlapRecord,
    /// Rays that were cast, as far as they can be counted beforehand.
    pub num_rays: u64,
}

/// The Suns of a pair as the renderer has them.
///
/// # Errors
/// [`Error::Render`] for a direction that is none.
pub fn suns(body: &Body, placed: &PlacedPair, settings: &RenderSection) -> Result<Vec<Sun>, Error> {
    let sun = |angles: &crate::plan::SunAngles| {
        let mut sun = Sun::from_vector(angles.direction(body, &placed.site))?;
        sun.angular_radius_rad = settings.sun_angular_radius_deg.to_radians();
        sun.limb_darkening = settings.limb_darkening;
        Ok(sun)
    };
    placed.suns.iter().map(sun).collect()
}

/// Renders a pair, or says what a full-size picture shows that the plan's coarse probe missed.
///
/// # Errors
/// [`Error::Render`] for settings that no picture can be made with.
pub fn render(
    campaign: &Campaign,
    tracer: &Tracer<'_>,
    row: &Row,
    placed: &PlacedPair,
) -> Result<Result<Box<Scene>, Refusal>, Error> {
    let suns = suns(&tracer.terrain().body, placed, &campaign.render)?;
    let [a, b] = placed.views();
    let (truth_a, truth_b) = match (truth(campaign, tracer, &a)?, truth(campaign, tracer, &b)?) {
        (Ok(truth_a), Ok(truth_b)) => (truth_a, truth_b),
        (Err(refusal), _) | (_, Err(refusal)) => return Ok(Err(refusal)),
    };
    let stride = if campaign.output.correspondence { 1 } else { OVERLAP_STRIDE };
    let a_in_b = covisibility::correspondence(tracer, &a, &truth_a, &b, stride);
    let b_in_a = covisibility::correspondence(tracer, &b, &truth_b, &a, stride);
    let overlap = covisibility::overlap(&a_in_b, &b_in_a);
    let make = |name: ViewName, view: Viewpoint, truth: Truth, sights: Vec<Sight>| {
        let settings = radiance_settings(campaign, row.pair_id, name);
        let pictures = radiance(tracer, &view, &truth, &suns, &settings)?;
        let light = suns
            .iter()
            .map(|sun| LightMaps::cast(tracer, &view, &truth, sun, campaign.render.shadows))
            .collect();
        Ok::<_, Error>(SceneView { name, view, truth, radiance: pictures, light, sights })
    };
    let views = [make(ViewName::A, a, truth_a, a_in_b)?, make(ViewName::B, b, truth_b, b_in_a)?];
    let num_rays = count_rays(campaign, &views, suns.len());
    Ok(Ok(Box::new(Scene { views, suns, overlap, num_rays })))
}

/// The truth of a view, or why the pair is refused.
fn truth(
    campaign: &Campaign,
    tracer: &Tracer<'_>,
    view: &Viewpoint,
) -> Result<Result<Truth, Refusal>, Error> {
    match Truth::cast(tracer, view) {
        Err(RenderError::CameraBelowGround { .. }) => Ok(Err(Refusal::BelowGround)),
        Err(error) => Err(error.into()),
        Ok(truth) => Ok(match refused(campaign, view, &truth) {
            Some(refusal) => Err(refusal),
            None => Ok(truth),
        }),
    }
}

/// The settings of a view's pictures; its rays are its own.
pub(crate) fn radiance_settings(campaign: &Campaign, pair_id: u64, name: ViewName) -> RadianceSettings {
    let RenderSection { rays_per_pixel, psf_sigma_px, shadows, albedo, brdf, .. } = campaign.render;
    let purpose = match name {
        ViewName::A => "rays a",
        ViewName::B => "rays b",
    };
    RadianceSettings {
        rays_per_pixel,
        psf_sigma_px,
        shadows,
        brdf,
        albedo: Albedo::Constant(albedo),
        seed: rng(campaign.seed, "pair", pair_id, purpose).next_u64(),
        ..RadianceSettings::default()
    }
}

/// The limits of the campaign, pixel by pixel.
fn refused(campaign: &Campaign, view: &Viewpoint, truth: &Truth) -> Option<Refusal> {
    if truth.num_absent > 0 {
        return Some(Refusal::TerrainAbsent);
    }
    if truth.num_sky > 0 {
        return Some(Refusal::Sky);
    }
    let limits = campaign.limits.cover();
    let pixels = truth.depth_z.iter().zip(&truth.cell_m);
    let seen = pixels.map(|(depth_z, cell_m)| Seen::Ground {
        cell_m: f64::from(*cell_m),
        gsd_m: depth_z / view.camera.fx,
    });
    (!Coverage::of(seen, &limits).is_enough(&limits)).then_some(Refusal::Coarse)
}

/// Camera rays, and one ray to each Sun from each of their hits where shadows are cast.
fn count_rays(campaign: &Campaign, views: &[SceneView], num_suns: usize) -> u64 {
    let to_suns = match campaign.render.shadows {
        Shadows::Cast => num_suns as u64,
        Shadows::Attached => 0,
    };
    let per_pixel = (1 + u64::from(campaign.render.rays_per_pixel)) * (1 + to_suns);
    views.iter().map(|v| v.truth.depth_z.len() as u64 * per_pixel + v.sights.len() as u64).sum()
}
