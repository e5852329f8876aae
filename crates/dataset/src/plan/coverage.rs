//! Whether the terrain carries a pair: a coarse grid of rays over both pictures, their borders included.

use super::campaign::LimitSection;
use super::flight::Pose;
use super::ground::clearance_m;
use selenograph_geometry::{Camera, Point2, Point3, UnitVector3, Vector3};
use selenograph_render::{Hit, Tracer, Viewpoint};
use selenograph_terrain::cover::{Coverage, Seen};
use serde::{Deserialize, Serialize};

/// Why an attempt at a pair was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Refusal {
    /// No layer of the terrain is fine enough for the altitude.
    NoFineLayer,
    /// The picture, or the ground round the site, leaves the terrain or meets a hole.
    TerrainAbsent,
    /// The picture shows sky.
    Sky,
    /// Too much of the picture sees cells that are coarse against its pixels.
    Coarse,
    /// A camera below, or too near, the ground.
    BelowGround,
    /// The baseline of an oblique pair is too short.
    Baseline,
    /// The epipole of a descent lies outside a picture.
    Epipole,
    /// The two views share too little ground.
    Overlap,
    /// A Sun lights too little of the ground.
    Dark,
    /// A draw that leaves a camera's roll undefined.
    Degenerate,
}

impl Refusal {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::NoFineLayer,
        Self::TerrainAbsent,
        Self::Sky,
        Self::Coarse,
        Self::BelowGround,
        Self::Baseline,
        Self::Epipole,
        Self::Overlap,
        Self::Dark,
        Self::Degenerate,
    ];

    /// The name in files and reports.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::NoFineLayer => "no-fine-layer",
            Self::TerrainAbsent => "terrain-absent",
            Self::Sky => "sky",
            Self::Coarse => "coarse",
            Self::BelowGround => "below-ground",
            Self::Baseline => "baseline",
            Self::Epipole => "epipole",
            Self::Overlap => "overlap",
            Self::Dark => "dark",
            Self::Degenerate => "degenerate",
        }
    }

    /// From the name in files.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|r| r.as_str() == name)
    }
}

/// Standard deviations of the point spread that the probe looks beyond the picture's border.
const MARGIN_SIGMAS: f64 = 4.0;

/// Probes the ground that a picture sees, `limits.probe_rays` rays along each side, as far out as the blur reaches.
///
/// # Errors
/// The first [`Refusal`] met.
pub fn probe(
    tracer: &Tracer<'_>,
    camera: &Camera,
    world_from_cam: &Pose,
    limits: &LimitSection,
    psf_sigma_px: f64,
) -> Result<Vec<Point3<f64>>, Refusal> {
    let origin = world_from_cam.origin();
    let clearance = clearance_m(tracer.terrain(), &origin).ok_or(Refusal::TerrainAbsent)?;
    if clearance < limits.min_clearance_m.max(f64::MIN_POSITIVE) {
        return Err(Refusal::BelowGround);
    }
    let side = limits.probe_rays;
    let margin = MARGIN_SIGMAS * psf_sigma_px;
    let at = |k: usize, size: usize| (size as f64 + 2.0 * margin) * k as f64 / (side - 1) as f64 - margin;
    let mut ground = Vec::with_capacity(side * side);
    let mut pixels = Vec::with_capacity(side * side);
    for j in 0..side {
        for i in 0..side {
            let pixel = Point2::new(at(i, camera.width), at(j, camera.height));
            // Outside the lens model there is no ray and nothing to refuse.
            let Some(ray) = camera.ray_z1(&pixel) else { continue };
            match tracer.first_hit(origin, world_from_cam.vector(&ray), 0.0, f64::INFINITY) {
                // The first of either is enough: the other rays need not be cast.
                Hit::Absent => return Err(Refusal::TerrainAbsent),
                Hit::Sky => return Err(Refusal::Sky),
                Hit::Surface(hit) => {
                    let cell_m = tracer.terrain().layers[hit.layer_idx].effective_cell_m(hit.at);
                    pixels.push(Seen::Ground { cell_m, gsd_m: hit.t / camera.fx });
                    ground.push(hit.point);
                }
            }
        }
    }
    let cover = limits.cover();
    if !Coverage::of(pixels, &cover).is_enough(&cover) {
        return Err(Refusal::Coarse);
    }
    Ok(ground)
}

/// Share of points inside a camera's frame (occlusion left aside).
pub fn share_in_frame(camera: &Camera, world_from_cam: &Pose, points: &[Point3<f64>]) -> f64 {
    let cam_from_world = world_from_cam.inverse();
    let inside = points.iter().filter(|p| in_frame(camera, camera.project(&cam_from_world.point(p))));
    inside.count() as f64 / points.len().max(1) as f64
}

/// Whether a pixel lies in the image.
pub fn in_frame(camera: &Camera, pixel: Option<Point2<f64>>) -> bool {
    pixel.is_some_and(|p| {
        (0.0..=camera.width as f64).contains(&p.x) && (0.0..=camera.height as f64).contains(&p.y)
    })
}

/// Whether the other camera's centre, seen or extended backwards, projects into the picture.
pub fn epipole_inside(camera: &Camera, world_from_cam: &Pose, other: &Point3<f64>) -> bool {
    let seen = world_from_cam.inverse().point(other);
    // The epipole is where the line of the baseline pierces the image plane, whichever way it points.
    in_frame(camera, camera.project(&Point3::from(seen.coords * seen.z.signum())))
}

/// Share of ground points that the centre of a Sun reaches, cast shadows included.
pub fn lit_share(tracer: &Tracer<'_>, points: &[Point3<f64>], sun: &Vector3<f64>) -> f64 {
    let towards = UnitVector3::new_normalize(*sun).into_inner();
    let lit = points.iter().filter(|p| !tracer.occluded(**p, towards)).count();
    lit as f64 / points.len().max(1) as f64
}

/// Checks both pictures of a pair and what they share.
///
/// # Errors
/// The first [`Refusal`] met.
pub fn check_pair(
    tracer: &Tracer<'_>,
    views: &[Viewpoint; 2],
    limits: &LimitSection,
    psf_sigma_px: f64,
    min_overlap: f64,
    suns: &[Vector3<f64>],
) -> Result<(), Refusal> {
    let [a, b] = views;
    let ground_a = probe(tracer, &a.camera, &a.world_from_cam, limits, psf_sigma_px)?;
    let ground_b = probe(tracer, &b.camera, &b.world_from_cam, limits, psf_sigma_px)?;
    if min_overlap > 0.0 {
        let shared = share_in_frame(&b.camera, &b.world_from_cam, &ground_a).min(share_in_frame(
            &a.camera,
            &a.world_from_cam,
            &ground_b,
        ));
        if shared < min_overlap {
            return Err(Refusal::Overlap);
        }
    }
    if limits.min_lit_share > 0.0 {
        for sun in suns {
            for ground in [&ground_a, &ground_b] {
                if lit_share(tracer, ground, sun) < limits.min_lit_share {
                    return Err(Refusal::Dark);
                }
            }
        }
    }
    Ok(())
}
