//! An elevation model sharpened by the shading of pictures whose cameras and Suns are known.
//!
//! The model's long waves stay as they are: it is its own prior, held tightly over its resolution and loosely below it. What shading
//! changes is carried onto a grid of the model's, and fades out towards the border of what the pictures see.
//!
//! # Source
//! Alexandrov & Beyer 2018, "Multiview shape-from-shading for planetary images", Earth and Space Science 5(10).

mod agreement;
mod quality;
#[cfg(test)]
mod tests;
mod view_of;

pub use agreement::Octave;
pub use quality::Quality;

use crate::View;
use crate::grid::fade;
use crate::grid::plane::{self, Plane};
use crate::scale::dem::DemPatch;
use crate::shading::{self, Compared, KnownGround, Picture, Shaded, ShadingOptions, Sharpened, Start};
use agreement::Verdict;
use rayon::prelude::*;
use selenograph_geometry::{BodyFixed, Cam, Point3, PredA, Rigid3, Vector3, pixel};
use selenograph_raster::dem::DemReader;
use selenograph_raster::{Affine, Raster};
use serde::{Deserialize, Serialize};
use view_of::Seen;

/// A picture that is to sharpen an elevation model.
#[derive(Debug, Clone)]
pub struct PlacedPicture {
    /// Grey levels and camera.
    pub view: View,
    /// Where the camera stands on the body, metres.
    pub body_from_cam: Rigid3<BodyFixed, Cam>,
    /// Unit vector to the Sun in the body's axes.
    pub sun: Vector3<f64>,
    /// Standard deviation of the Sun's direction, radians.
    pub sun_sigma_rad: f64,
}

/// Settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefineOptions {
    /// Photoclinometry.
    pub shading: ShadingOptions,
    /// Standard deviation of the model's heights over its resolution, metres; `None` estimates it from the model's roughness.
    pub sigma_m: Option<f64>,
    /// Length below which the model holds no relief, metres; `None` estimates it from the model's own smoothness.
    pub resolution_m: Option<f64>,
    /// Side of a cell of the result, metres on the ground, no larger than the model's; `None` keeps the model's grid.
    pub cell_m: Option<f64>,
    /// Largest number of cells of the part of the model that the pictures may see.
    pub max_window_cells: usize,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            shading: ShadingOptions::default(),
            sigma_m: None,
            resolution_m: None,
            cell_m: None,
            max_window_cells: 1 << 27,
        }
    }
}

/// Why an elevation model is not sharpened.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A camera that has no part of the model in sight.
    #[error(
        "picture {number} does not see the elevation model: expected ground of it in the picture, found none"
    )]
    NotInSight {
        /// Which picture, from 1.
        number: usize,
    },
    /// A Sun that lights nothing.
    #[error("the Sun of picture {number} stands {below_deg:.1}° below the horizon of the ground it shows")]
    SunBelow {
        /// Which picture, from 1.
        number: usize,
        /// How far, degrees.
        below_deg: f64,
    },
    /// The model under this Sun does not look like the picture.
    #[error(
        "picture {number} does not show this ground: the elevation model under its Sun is like it with a correlation of {correlation:.2} at best, expected at least {least}"
    )]
    OtherGround {
        /// Which picture, from 1.
        number: usize,
        /// Correlation of the model's rendering with the picture, in the octave that is likest.
        correlation: f64,
        /// The least that is taken.
        least: f64,
    },
    /// The best surface does not look like the picture either.
    #[error(
        "picture {number} is not explained by any surface near the elevation model: correlation {correlation:.2}, expected at least {least}"
    )]
    NotExplained {
        /// Which picture, from 1.
        number: usize,
        /// Correlation of the fitted model's rendering with the picture.
        correlation: f64,
        /// The least that is taken.
        least: f64,
    },
    /// Pictures that may see more of a model than memory should hold.
    #[error("the pictures may see {found} cells of the elevation model, expected at most {most}")]
    TooLarge {
        /// Cells.
        found: usize,
        /// Their limit.
        most: usize,
    },
    /// A cell of the result that the model does not have.
    #[error("cells of {found} m: expected a side above 0 and up to the model's own, {most:.3} m")]
    Cell {
        /// What was asked for, metres.
        found: f64,
        /// The model's own, metres.
        most: f64,
    },
}

impl Error {
    /// What the user can do about it.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::NotInSight { .. } => {
                "each camera file must hold where its picture was taken from, in the body's frame, and the elevation model that ground"
            }
            Self::SunBelow { .. } => {
                "azimuths count clockwise from north; a vector X,Y,Z points towards the Sun"
            }
            Self::OtherGround { .. } => {
                "is the camera's place right to some cells of the model, and the Sun this picture's? Nothing was sharpened"
            }
            Self::NotExplained { .. } => {
                "leave that picture out, or give another --law; nothing was sharpened"
            }
            Self::TooLarge { .. } => "cut the elevation model to the ground of interest first",
            Self::Cell { .. } => "leave --cell-m out for the model's own grid",
        }
    }
}

/// The sharpened window of an elevation model. All rasters are of its grid.
#[derive(Debug)]
pub struct Refined {
    /// The window as it was given, on the grid of the result.
    pub given: DemPatch,
    /// Heights, metres above the sphere; those given where no picture sees the ground, NaN where none were given.
    pub heights: Raster<f32>,
    /// Heights less those given, metres.
    pub change: Raster<f32>,
    /// Albedo against the mean; NaN where no picture sees the ground.
    pub albedo: Raster<f32>,
    /// Each picture less its model in the picture's lit mean; NaN where it shows nothing.
    pub residuals: Vec<Raster<f32>>,
    /// How much of the change counts, 0 to 1.
    pub weight: Raster<f32>,
    /// How like each picture a rendering of the model as given is, octave by octave.
    pub octaves: Vec<Vec<Octave>>,
    /// What the model was taken for.
    pub quality: Quality,
    /// The surface on its own cells, and the pictures on them.
    pub shaded: Shaded,
    /// First column and row of the window in the file.
    pub first: [usize; 2],
    /// Cells that a picture sees, that have a height, and where the surface was not found.
    pub num_lost: usize,
    /// What is to be known of the answer, in sentences.
    pub notes: Vec<String>,
}

/// Correlation of a picture with its model in the end below which the surface is not believed.
const LEAST_CORRELATION: f64 = 0.9;
/// Cells over which a change fades out, at least and at most; between them twice the resolution.
const FADE_CELLS: [f64; 2] = [8.0, 64.0];

/// Sharpens the part of an elevation model that pictures see.
///
/// # Errors
/// [`crate::Error::Refine`] for pictures that do not belong to the model, [`crate::Error::Undetermined`] for ground that is no surface,
/// and those of the reader.
pub fn refine(
    reader: &mut DemReader,
    pictures: &[PlacedPicture],
    options: &RefineOptions,
) -> Result<Refined, crate::Error> {
    let (model, first) = view_of::window(reader, pictures, options.max_window_cells)?;
    let seen = Seen::of(&model, pictures)?;
    sunlit(&model, &seen, pictures)?;
    let columns = seen.columns.clone();
    let rows = seen.rows.clone();
    let first = [first[0] + columns.start, first[1] + rows.start];
    let window = model.cropped(columns, rows)?;
    let given = on_grid(&window, options.cell_m)?;
    let scene = Scene::new(pictures);
    let plane = scene.plane(&seen)?;
    let height_over = |point: &Vector3<f64>| model.height_over(&scene.in_body(point));
    let in_scene = scene.pictures(pictures);
    let shade = |quality: &Quality, shading: &ShadingOptions| {
        let ground = KnownGround {
            height_over: &height_over,
            resolution: quality.resolution_m,
            sigma: quality.sigma_m,
            missing_relief: quality.missing_relief_m,
        };
        let start = Start { plane, views: None, ground: Some(ground), least_cell: given.cell_m() };
        let shaded = shading::shade(&in_scene, &start, shading);
        shaded.map(|shaded| (shaded, ground)).map_err(|_| Error::NotInSight { number: 1 })
    };
    // Without a step and on the finest cells: the model as it is, and the pictures on it.
    let as_given = ShadingOptions { steps: vec![0], ..options.shading.clone() };
    let (first_look, _) = shade(&Quality::of(&window, 0.0, None, None), &as_given)?;
    let cell_m = first_look.patch.cell;
    let octaves: Vec<Vec<Octave>> =
        first_look.compared.iter().map(|compared| agreement::octaves(compared, cell_m)).collect();
    drop(first_look);
    let (from_m, mut notes) = same_ground(&octaves)?;
    let quality = Quality::of(&window, from_m, options.resolution_m, options.sigma_m);
    notes.push(quality.sentence());
    let (shaded, ground) = shade(&quality, &options.shading)?;
    believed(&shaded)?;
    notes.extend(doubts(&shaded));
    let sharpened = shaded.sharpened(&ground).ok_or(Error::NotInSight { number: 1 })?;
    let carried = carry(&given, &scene, pictures, &shaded, &sharpened);
    drop(sharpened);
    Ok(finish(given, carried, octaves, quality, first, notes, shaded))
}

/// The length from which on the pictures confirm the model, metres, and what is to be said of it.
fn same_ground(octaves: &[Vec<Octave>]) -> Result<(f64, Vec<String>), Error> {
    match agreement::judge(octaves) {
        Verdict::Agrees { from_m } => Ok((from_m, Vec::new())),
        Verdict::TooSmooth { longest_m } => {
            let note = "the elevation model is too smooth to be recognised in the pictures: that they show one ground rests on the cameras alone";
            Ok((longest_m, vec![note.to_owned()]))
        }
        Verdict::OtherGround { picture, correlation } => {
            Err(Error::OtherGround { number: picture + 1, correlation, least: agreement::SAME_GROUND })
        }
    }
}

/// Whether the surface explains the pictures.
fn believed(shaded: &Shaded) -> Result<(), Error> {
    for (k, explained) in shaded.pictures.iter().enumerate() {
        let correlation = explained.correlation;
        if correlation.is_nan() || correlation < LEAST_CORRELATION {
            return Err(Error::NotExplained { number: k + 1, correlation, least: LEAST_CORRELATION });
        }
    }
    Ok(())
}

/// Root mean square of picture less rendering, in the picture's lit mean, from which on it is said: pictures with noise of 1 % and
/// fine albedo of 2 % leave 0.007 where the law is theirs, and 0.083 where it is not.
const SURPRISING_RESIDUAL: f64 = 0.03;

/// What is to be said of pictures that the surface explains, but not well.
fn doubts(shaded: &Shaded) -> Vec<String> {
    let doubt = |(k, compared): (usize, &Compared)| {
        let residual = compared.residual();
        let squares = residual.data.iter().filter(|r| r.is_finite()).map(|r| f64::from(*r).powi(2));
        let (sum, count) = squares.fold((0.0, 0usize), |(sum, count), square| (sum + square, count + 1));
        let rms = (sum / count.max(1) as f64).sqrt();
        (rms > SURPRISING_RESIDUAL).then(|| {
            format!(
                "picture {} and its rendering differ by {:.1} % of its mean brightness (rms), which noise does not explain: its law (--law), \
                 its Sun or its camera may be another, and the pictures then contradict each other",
                k + 1,
                100.0 * rms
            )
        })
    };
    shaded.compared.iter().enumerate().filter_map(doubt).collect()
}

/// The pictures' own frame: axes and origin of the first camera.
struct Scene {
    body_from_scene: Rigid3<BodyFixed, PredA>,
    scene_from_body: Rigid3<PredA, BodyFixed>,
}

impl Scene {
    fn new(pictures: &[PlacedPicture]) -> Self {
        let body_from_scene: Rigid3<BodyFixed, PredA> =
            pictures.first().map_or_else(Rigid3::identity, |p| p.body_from_cam.relabel());
        Self { body_from_scene, scene_from_body: body_from_scene.inverse() }
    }

    fn in_body(&self, point: &Vector3<f64>) -> Point3<f64> {
        self.body_from_scene.point(&Point3::from(*point))
    }

    fn in_scene(&self, point: &Point3<f64>) -> Vector3<f64> {
        self.scene_from_body.point(point).coords
    }

    fn plane(&self, seen: &Seen) -> Result<Plane, crate::Error> {
        let points: Vec<Vector3<f64>> = seen.points.iter().map(|p| self.in_scene(p)).collect();
        plane::fit(&points, &Vector3::zeros())
    }

    fn pictures<'a>(&self, pictures: &'a [PlacedPicture]) -> Vec<Picture<'a>> {
        let placed = |picture: &'a PlacedPicture| Picture {
            view: &picture.view,
            cam_from_scene: &picture.body_from_cam.inverse() * &self.body_from_scene,
            pose_sigma: None,
            sun: self.scene_from_body.vector(&picture.sun),
            sun_sigma_rad: picture.sun_sigma_rad,
        };
        pictures.iter().map(placed).collect()
    }
}

/// Every Sun stands above the horizon of the middle of what is seen.
fn sunlit(model: &DemPatch, seen: &Seen, pictures: &[PlacedPicture]) -> Result<(), Error> {
    let place = model.body().place(&seen.middle());
    for (k, picture) in pictures.iter().enumerate() {
        let (_, elevation) = model.body().azimuth_elevation(&place, &picture.sun);
        if elevation <= 0.0 {
            return Err(Error::SunBelow { number: k + 1, below_deg: -elevation.to_degrees() });
        }
    }
    Ok(())
}

/// The window on the grid of the result.
fn on_grid(window: &DemPatch, cell_m: Option<f64>) -> Result<DemPatch, crate::Error> {
    let most = window.cell_m();
    let share = match cell_m {
        None => return Ok(window.clone()),
        Some(cell) if cell > 0.0 && cell <= most * (1.0 + 1e-6) => cell / most,
        Some(found) => return Err(Error::Cell { found, most }.into()),
    };
    let [a0, a1, a2, a3, a4, a5] = window.map_from_pixel().coefficients;
    let map = Affine::new([a0, a1 * share, a2 * share, a3, a4 * share, a5 * share]);
    let count = |cells: usize| (cells as f64 / share).round() as usize;
    let (width, height) = (count(window.heights().width), count(window.heights().height));
    let heights = Raster::from_fn(width, height, |x, y| {
        let [x, y] = map.apply(pixel::center_of(x), pixel::center_of(y));
        window.height(x, y).map_or(f32::NAN, |h| h as f32)
    });
    DemPatch::new(heights, window.crs().clone(), &map)
}

/// What is found at a cell of the result.
#[derive(Debug, Clone)]
struct Carried {
    /// Metres; NaN where nothing was found.
    rise: f32,
    log_albedo: f32,
    residuals: Vec<f32>,
    in_sight: bool,
}

/// The surface on the grid of the result.
fn carry(
    given: &DemPatch,
    scene: &Scene,
    pictures: &[PlacedPicture],
    shaded: &Shaded,
    sharpened: &Sharpened<'_>,
) -> Vec<Carried> {
    let heights = given.heights();
    let cams: Vec<_> = pictures.iter().map(|p| (p.body_from_cam.inverse(), &p.view)).collect();
    let residuals: Vec<Raster<f32>> = shaded.compared.iter().map(Compared::residual).collect();
    let width = heights.width;
    let nothing = Carried {
        rise: f32::NAN,
        log_albedo: f32::NAN,
        residuals: vec![f32::NAN; cams.len()],
        in_sight: false,
    };
    let at = |i: usize| -> Option<Carried> {
        let height_m = heights.data[i];
        let [x, y] = given.map_from_pixel().apply(pixel::center_of(i % width), pixel::center_of(i / width));
        let point = given.point(x, y, f64::from(height_m)).filter(|_| height_m.is_finite())?;
        let in_sight = cams.iter().any(|(cam_from_body, view)| view_of::shows(view, cam_from_body, &point));
        if !in_sight {
            return None;
        }
        let up = scene.scene_from_body.vector(&given.body().up(&given.body().place(&point)));
        let in_scene = scene.in_scene(&point);
        let rise = sharpened.rise(&in_scene, &up);
        let surface = in_scene + up * rise.unwrap_or(0.0);
        let value = |raster: &Raster<f32>| sharpened.value(raster, &surface).unwrap_or(f32::NAN);
        Some(Carried {
            rise: rise.map_or(f32::NAN, |r| r as f32),
            log_albedo: value(&shaded.log_albedo),
            residuals: residuals.iter().map(value).collect(),
            in_sight,
        })
    };
    (0..heights.data.len()).into_par_iter().map(|i| at(i).unwrap_or_else(|| nothing.clone())).collect()
}

fn finish(
    given: DemPatch,
    carried: Vec<Carried>,
    octaves: Vec<Vec<Octave>>,
    quality: Quality,
    first: [usize; 2],
    notes: Vec<String>,
    shaded: Shaded,
) -> Refined {
    let (width, height) = (given.heights().width, given.heights().height);
    let [least, most] = FADE_CELLS;
    let reach = (2.0 * quality.resolution_m / given.cell_m()).clamp(least, most) as u16;
    let steps = fade::steps_inside(width, height, |i| !carried[i].rise.is_nan(), reach);
    let raster =
        |f: &dyn Fn(usize) -> f32| Raster { width, height, data: (0..width * height).map(f).collect() };
    let weight = raster(&|i| smooth_step(f32::from(steps[i].saturating_sub(1)) / f32::from(reach - 1)));
    let heights = given.heights();
    let change = raster(&|i| match heights.data[i] {
        h if h.is_nan() => f32::NAN,
        _ if weight.data[i] > 0.0 => weight.data[i] * carried[i].rise,
        _ => 0.0,
    });
    Refined {
        heights: raster(&|i| heights.data[i] + change.data[i]),
        albedo: raster(&|i| carried[i].log_albedo.exp()),
        residuals: (0..octaves.len()).map(|k| raster(&|i| carried[i].residuals[k])).collect(),
        num_lost: carried.iter().filter(|c| c.in_sight && c.rise.is_nan()).count(),
        given,
        change,
        weight,
        octaves,
        quality,
        shaded,
        first,
        notes,
    }
}

/// 0 to 1 without a step in the slope at either end.
fn smooth_step(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}
