//! Photoclinometry: one surface whose renderings equal the pictures, whatever their Suns.
//!
//! The unknowns are heights over a plane, cell by cell on a regular grid, and the albedo of each cell. A grid over the ground, and
//! not a depth for each pixel of one of the pictures: no picture is better than the others, swapping two or adding a third changes
//! nothing; ground that one of them hides is a cell that it does not show; shadows and an elevation model that is known beforehand
//! live on the same cells; and the elevation model is the answer itself. Its price are cells that a slanting picture shows less
//! sharply than others, where the surface is no sharper than the picture.
//!
//! Each picture says of each cell how bright it is. The law of reflectance says how bright it would be, from the slopes that
//! neighbouring heights make and from the Sun. The difference is linearised, all pictures are gathered in one 4×4 tensor per cell
//! (two slopes, height, log albedo), and the surface moves by conjugate gradients under a thin plate, coarse to fine. Gains and
//! whatever else is unknown of a picture as a whole are eliminated jointly with it.
//!
//! # Source
//! Horn 1990, "Height and gradient from shading", IJCV 5(1) (integrability by making heights the unknowns); Alexandrov & Beyer 2018,
//! "Multiview shape-from-shading for planetary images", Earth and Space Science 5(10) (several pictures, exposures and albedo);
//! Triggs et al. 2000, "Bundle adjustment: a modern synthesis" (joint elimination).

mod anchor;
mod answer;
mod compared;
mod equations;
mod globals;
mod known_ground;
mod linearise;
mod patch;
mod picture;
mod run;
mod sharpened;
mod uncertainty;
mod weights;

use crate::View;
use crate::grid::plane::Plane;
use crate::prediction::{Fill, PredictedView};
use anchor::Anchor;
pub use compared::Compared;
use globals::{Free, Global, Globals, PHASE_POWERS, Shot};
pub use known_ground::{HeightOver, KnownGround};
use linearise::{LawTable, Surface};
pub use patch::Patch;
use picture::{PicturePyramid, Placed};
use run::Problem;
use selenograph_geometry::{Cam, Matrix3, Point3, PredA, Rigid3, Rotation3, Vector3};
use selenograph_raster::Raster;
use selenograph_render::brdf::Brdf;
use serde::{Deserialize, Serialize};
pub use sharpened::Sharpened;
use weights::Weights;

/// A picture with all that is known of it.
#[derive(Debug, Clone)]
pub struct Picture<'a> {
    /// Grey levels and camera.
    pub view: &'a View,
    /// Where the camera stands. The scene has the axes and origin of the first camera.
    pub cam_from_scene: Rigid3<Cam, PredA>,
    /// How surely, where it is to be found better.
    pub pose_sigma: Option<PoseSigma>,
    /// Unit vector to the Sun, in the scene's axes.
    pub sun: Vector3<f64>,
    /// Standard deviation of the Sun's direction, radians; 0 where it is known.
    pub sun_sigma_rad: f64,
}

/// How surely a camera's place is known against the first one's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseSigma {
    /// Standard deviation of the turn about each axis, radians.
    pub turn_rad: f64,
    /// Standard deviation of the direction of the baseline, radians.
    pub direction_rad: f64,
}

/// Settings of photoclinometry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShadingOptions {
    /// How the ground reflects.
    pub law: Brdf,
    /// Standard deviation of the second differences of heights, cells.
    pub curvature: f32,
    /// Standard deviation of the log albedo's steps between neighbours at the finest level, where the noise is `noise`.
    pub albedo_step: f32,
    /// Distance over which the albedo forgets itself, in the smaller side of the grid.
    pub albedo_reach: f32,
    /// Standard deviation of the pictures' noise, in their lit means, before it is estimated.
    pub noise: f32,
    /// Whether the noise, and the albedo's steps with its variance, are estimated from the pictures.
    pub estimate_weights: bool,
    /// Weight of stereo's answer, as a share of what its sigma says: its errors go together over the windows that it compares.
    pub stereo_share: f32,
    /// Residual that counts a quarter, in the picture's lit mean.
    pub robust: f32,
    /// Steps at each level, the finest first; the last is that of all coarser ones.
    pub steps: Vec<usize>,
    /// Conjugate-gradient steps in each.
    pub iterations: usize,
    /// Smaller side of the coarsest grid, cells.
    pub coarsest_cells: usize,
    /// Levels where stereo gives the start: its surface is right at the larger scales.
    pub levels_from_stereo: usize,
    /// Largest number of cells.
    pub max_cells: usize,
    /// Whether grey levels may have an offset.
    pub free_offset: bool,
    /// Whether the phase function may differ from the law's.
    pub free_phase: bool,
}

impl Default for ShadingOptions {
    fn default() -> Self {
        Self {
            law: Brdf::default(),
            curvature: 0.22,
            albedo_step: 0.005,
            albedo_reach: 0.2,
            noise: 0.01,
            estimate_weights: true,
            stereo_share: 0.1,
            robust: 0.15,
            steps: vec![8],
            iterations: 40,
            coarsest_cells: 32,
            levels_from_stereo: 2,
            max_cells: 1 << 26,
            free_offset: false,
            free_phase: false,
        }
    }
}

impl ShadingOptions {
    /// Variances before they are estimated, at a level.
    fn weights(&self, surface: &Surface, level_idx: usize) -> Weights {
        let squared = |v: f32| f64::from(v).powi(2);
        Weights {
            noise2: squared(self.noise),
            curvature2: squared(self.curvature),
            albedo2_per_noise4: squared(self.albedo_step / (self.noise * self.noise))
                * f64::from(4u32.pow(level_idx as u32)),
            reach: f64::from(self.albedo_reach) * surface.width.min(surface.height) as f64,
        }
    }
}

/// What is known of the ground before its shading is looked at.
#[derive(Debug, Clone, Copy)]
pub struct Start<'a> {
    /// The plane that the heights are counted from.
    pub plane: Plane,
    /// Stereo's answer in the views of the first two pictures, where there is one.
    pub views: Option<&'a [PredictedView; 2]>,
    /// An elevation model that is to be sharpened; takes the place of `views`.
    pub ground: Option<KnownGround<'a>>,
    /// Smallest side of a cell, in the scene's unit; 0 for the sharpest picture's pixel.
    pub least_cell: f64,
}

/// One picture's part in the answer.
#[derive(Debug, Clone)]
pub struct Explained {
    /// Where the camera stands, after the fit.
    pub cam_from_scene: Rigid3<Cam, PredA>,
    /// How surely, where it was to be found better.
    pub pose_sigma: Option<PoseSigma>,
    /// Unit vector to the Sun in the scene's axes, after the fit.
    pub sun: Vector3<f64>,
    /// Standard deviation of the Sun's direction after the fit, radians; 0 where it was known.
    pub sun_sigma_rad: f64,
    /// Grey level of ground of radiance factor 1.
    pub gain: f64,
    /// Grey level at no light.
    pub offset: f64,
    /// Correlation of the picture with the model's, over the cells that another picture shows as well, if there is another.
    pub correlation: f64,
    /// Share of the picture's pixels that are lit and not saturated.
    pub lit_share: f64,
}

/// The surface, and how it explains the pictures.
#[derive(Debug, Clone)]
pub struct Shaded {
    /// The grid.
    pub patch: Patch,
    /// Heights over the plane, in cells.
    pub heights: Raster<f32>,
    /// Logarithm of the albedo against the law's.
    pub log_albedo: Raster<f32>,
    /// Standard deviation of the heights, cells.
    pub height_sigma: Raster<f32>,
    /// Standard deviation of the slope's tangent, where the ground is steepest.
    pub slope_sigma: Raster<f32>,
    /// Standard deviation of the log albedo.
    pub albedo_sigma: Raster<f32>,
    /// Heights of the ground that was known beforehand, in cells, NaN where it is not known; `None` where the surface began with
    /// something else.
    pub known: Option<Raster<f32>>,
    /// The pictures.
    pub pictures: Vec<Explained>,
    /// How many pictures show each cell lit.
    pub num_seen: Raster<u8>,
    /// Each picture and its model on the cells.
    pub compared: Vec<Compared>,
    /// Energy per compared cell, before the first and after each accepted step at the finest level.
    pub energies: Vec<f64>,
    placed: Vec<Placed>,
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The plane lies beside or behind the pictures.
    #[error("no picture sees the plane that the surface starts from")]
    NotSeen,
}

/// Fits one surface to the pictures.
///
/// # Errors
/// [`Error::NotSeen`] where the start has nothing to do with the pictures.
pub fn shade(pictures: &[Picture<'_>], start: &Start<'_>, options: &ShadingOptions) -> Result<Shaded, Error> {
    let mut num_levels = 1;
    let mut side = pictures.iter().map(|p| p.view.image.width.min(p.view.image.height)).min().unwrap_or(0);
    let cover = |multiple: usize| {
        Patch::cover(&start.plane, pictures, start.least_cell, options.max_cells, multiple)
            .ok_or(Error::NotSeen)
    };
    if start.least_cell > 0.0 {
        let (patch, _) = cover(1)?;
        side = side.min(patch.width).min(patch.height);
    }
    while side >> num_levels >= options.coarsest_cells {
        num_levels += 1;
    }
    let multiple = 1 << (num_levels - 1);
    let (patch, pixels_per_cell) = cover(multiple)?;
    let pyramids = pictures.iter().map(|p| PicturePyramid::new(p, num_levels + 2)).collect();
    let mut anchors: Vec<Anchor> = Vec::new();
    let mut used = num_levels;
    if let Some(ground) = &start.ground {
        anchors.push(Anchor::of_ground(ground, &patch));
        used = (1 + ground.levels(patch.cell)).min(num_levels);
    } else if let Some(views) = start.views {
        let eye = |k: usize| pictures[k].cam_from_scene.inverse().origin();
        anchors.push(Anchor::of_views(views, [eye(0), eye(1)], &patch, options.stereo_share));
        used = options.levels_from_stereo.min(num_levels);
    }
    for _ in 1..if anchors.is_empty() { 0 } else { num_levels } {
        let coarser = anchors[anchors.len() - 1].halved();
        anchors.push(coarser);
    }
    let surfaces: Vec<Surface> = (0..used)
        .map(|level_idx| {
            let (width, height) = (patch.width >> level_idx, patch.height >> level_idx);
            Surface {
                width,
                height,
                scale: (1u32 << level_idx) as f32,
                sight: patch.sight,
                heights: vec![0.0; width * height],
                albedo: vec![0.0; width * height],
            }
        })
        .collect();
    let mut problem =
        Problem { pyramids, pixels_per_cell, law: LawTable::new(&options.law), options, anchors };
    let mut surfaces = surfaces;
    if let (Some(anchor), Some(coarsest)) = (problem.anchors.get(used - 1), surfaces.last_mut()) {
        coarsest.heights = anchor.carried_on();
    }
    let placed: Vec<Placed> = pictures.iter().map(|p| Placed::new(p, &patch)).collect();
    let globals = problem.start_globals(pictures, &placed, &surfaces[used - 1], used - 1);
    let solution = problem.run(surfaces, globals).ok_or(Error::NotSeen)?;
    let raster = |data: &Vec<f32>| Raster { width: patch.width, height: patch.height, data: data.clone() };
    let num_seen = linearise::num_seen(&solution.state.surface, &solution.state.globals, &problem.shown(0));
    let compared = problem.compared(&solution.state.surface, &solution.state.globals, 0);
    let sure = uncertainty::uncertainty(&problem, &solution);
    let free = &solution.state.globals.free;
    let explained = solution
        .state
        .globals
        .shots
        .iter()
        .zip(&problem.pyramids)
        .zip(pictures)
        .enumerate()
        .map(|(k, ((shot, pyramid), picture))| Explained {
            cam_from_scene: match (picture.pose_sigma, k) {
                (None, _) | (_, 0) => picture.cam_from_scene,
                (Some(_), 1) => with_baseline_of(shot.pose(&patch), picture, &pictures[0]),
                (Some(_), _) => shot.pose(&patch),
            },
            pose_sigma: sure
                .of_globals(free, |g| matches!(g, Global::Turn(of, _) if of == k))
                .zip(sure.of_globals(free, |g| matches!(g, Global::Move(of, _) if of == k)))
                .map(|(turn_rad, direction_rad)| PoseSigma { turn_rad, direction_rad }),
            sun: patch.vector(shot.placed.sun),
            sun_sigma_rad: sure
                .of_globals(free, |g| matches!(g, Global::Sun(of, _) if of == k))
                .unwrap_or(0.0),
            gain: f64::from(shot.gain * pyramid.mean),
            offset: f64::from(shot.offset * pyramid.mean),
            correlation: compared[k].correlation(&num_seen, pictures.len().min(2)),
            lit_share: f64::from(pyramid.lit_share),
        })
        .collect();
    Ok(Shaded {
        height_sigma: sure.heights,
        slope_sigma: sure.slopes,
        albedo_sigma: sure.albedo,
        heights: raster(&solution.state.surface.heights),
        log_albedo: raster(&solution.state.surface.albedo),
        known: problem.anchors.first().filter(|_| start.ground.is_some()).map(Anchor::known),
        num_seen,
        pictures: explained,
        compared,
        energies: solution.energies,
        placed: solution.state.globals.shots.iter().map(|shot| shot.placed).collect(),
        patch,
    })
}

impl Problem<'_> {
    /// Everything as it is known, and gains that make the model as bright as the pictures.
    fn start_globals(
        &mut self,
        pictures: &[Picture<'_>],
        placed: &[Placed],
        surface: &Surface,
        level_idx: usize,
    ) -> Globals {
        let shots = placed.iter().map(|&placed| Shot { gain: 1.0, offset: 0.0, placed }).collect();
        let mut globals = Globals { shots, phase: [0.0; PHASE_POWERS], free: Vec::new() };
        let shown = self.shown(level_idx);
        for (k, shown) in shown.iter().enumerate() {
            globals.shots[k].gain = linearise::first_gain(surface, &globals, k, shown, &self.law);
        }
        let mut add = |global: Global, sigma: f64| globals.free.push(Free { global, sigma, deviation: 0.0 });
        for (k, picture) in pictures.iter().enumerate() {
            add(Global::Gain(k), f64::INFINITY);
            if self.options.free_offset {
                add(Global::Offset(k), OFFSET_SIGMA);
            }
            if picture.sun_sigma_rad > 0.0 {
                for axis in 0..2 {
                    add(Global::Sun(k, axis), picture.sun_sigma_rad);
                }
            }
            if let Some(sigma) = picture.pose_sigma.filter(|_| k > 0) {
                for axis in 0..3 {
                    add(Global::Turn(k, axis), sigma.turn_rad);
                }
                // The length of the first baseline is the unit.
                for axis in 0..if k == 1 { 2 } else { 3 } {
                    add(Global::Move(k, axis), sigma.direction_rad);
                }
            }
        }
        if self.options.free_phase {
            for power in 0..PHASE_POWERS {
                add(Global::Phase(power), PHASE_SIGMA);
            }
        }
        globals
    }
}

/// Standard deviation of a picture's offset, in its lit mean.
const OFFSET_SIGMA: f64 = 0.2;
/// Standard deviation of the phase polynomial's coefficients.
const PHASE_SIGMA: f64 = 0.5;

/// A pose that was found, at the distance from the first camera that the picture's given one has: nothing here tells lengths, and
/// the cells' f32 must not change the unit.
fn with_baseline_of(
    found: Rigid3<Cam, PredA>,
    picture: &Picture<'_>,
    first: &Picture<'_>,
) -> Rigid3<Cam, PredA> {
    let first = first.cam_from_scene.inverse().origin();
    let length = (picture.cam_from_scene.inverse().origin() - first).norm();
    let baseline = found.inverse().origin() - first;
    let factor = length / baseline.norm();
    if !factor.is_finite() {
        return found;
    }
    let rotation = Rotation3::from_matrix(&found.rotation());
    Rigid3::new(rotation, Point3::from(-(rotation * (first + baseline * factor).coords)))
}

impl Shot {
    /// The camera's pose in the scene.
    fn pose(&self, patch: &Patch) -> Rigid3<Cam, PredA> {
        // Columns of the rotation belong to the grid's axes, two of which make it left-handed: back through them.
        let columns = Matrix3::from_fn(|i, j| f64::from(self.placed.rotation[i][j]));
        let axes = Matrix3::from_columns(&patch.axes);
        let rotation = Rotation3::from_matrix(&(columns * axes.transpose()));
        let corner = Vector3::from(self.placed.translation.map(f64::from)) * patch.cell;
        Rigid3::new(rotation, Point3::from(corner - rotation * patch.corner))
    }
}

impl Shaded {
    /// Points of a picture's pixels in the scene's frame.
    pub fn view(&self, picture: usize, view: &View) -> PredictedView {
        let ground = answer::Ground::new(&self.patch, &self.heights);
        let pose = &self.pictures[picture].cam_from_scene;
        let met = ground.pixels(&view.camera, pose, &self.placed[picture]);
        let (width, height) = (met.width, met.height);
        let points = met.map(|p| {
            let point = self.patch.point_of(*p);
            std::array::from_fn(|i| point[i] as f32)
        });
        let cell = |c: f32, count: usize| (c.max(0.0) as usize).min(count - 1);
        let cell_of = |p: &[f32; 3]| (cell(p[0], self.patch.width), cell(p[1], self.patch.height));
        let eye = self.placed[picture].eye;
        let sigma = met.map(|p| {
            if p[0].is_nan() {
                return f32::NAN;
            }
            let position = self.patch.sight.position(*p);
            let ray: [f32; 3] = std::array::from_fn(|i| position[i] - eye[i]);
            // A cell of height is so much of the ray's length.
            let along_ray = ray.iter().map(|c| c * c).sum::<f32>().sqrt() / ray[2].abs();
            self.height_sigma[cell_of(p)] * along_ray * self.patch.cell as f32
        });
        // One picture alone tells a slope along its Sun: what follows from that is no measurement.
        let fill = met.map(|p| match p[0].is_nan() {
            true => Fill::Absent,
            false if self.num_seen[cell_of(p)] > 1 => Fill::Measured,
            false => Fill::Completed,
        });
        PredictedView {
            confidence: fill.map(|fill| match fill {
                Fill::Absent => 0.0,
                Fill::Completed => 0.5,
                Fill::Measured => 1.0,
            }),
            sigma: Some(sigma),
            fill,
            points: Raster { width, height, data: points.data },
        }
    }
}

#[cfg(test)]
mod tests;
