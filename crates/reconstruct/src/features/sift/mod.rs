//! Scale-invariant features: extrema of differences of Gaussians, with a descriptor of gradients around each.
//!
//! # Source
//! Lowe 2004, "Distinctive image features from scale-invariant keypoints", IJCV 60(2); the root normalisation of the
//! descriptors from Arandjelović & Zisserman 2012, "Three things everyone should know to improve object retrieval".

mod descriptor;
mod extrema;
mod scale_space;
mod trigonometry;

use super::intensity::Intensity;
use super::{Features, Keypoint, coordinate_of, spread};
use extrema::Extremum;
use rayon::prelude::*;
use scale_space::{LEVELS, Octave};
use selenograph_geometry::Point2;
use selenograph_raster::Raster;
use serde::{Deserialize, Serialize};

/// Length of a descriptor: 4 × 4 cells of 8 directions.
pub const DESCRIPTOR_LEN: usize = 128;

/// What the surroundings of a keypoint look like: a unit vector without negative entries.
pub type Descriptor = [f32; DESCRIPTOR_LEN];

/// Keypoints of one piece of work.
const CHUNK: usize = 32;

/// Rows whose keypoints are described one level after the other.
const BAND_ROWS: u32 = 32;

/// Absent samples may come this close to a keypoint, in its standard deviations.
const KNOWN_SIGMAS: f64 = 4.0;

/// Resolution of the first octave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FirstOctave {
    /// The picture enlarged twice: more and smaller features.
    Doubled,
    /// The picture as it is: four times less work.
    #[default]
    Original,
}

/// How features are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Resolution of the first octave.
    pub first_octave: FirstOctave,
    /// Least contrast of an extremum of the difference of Gaussians, as a share of the picture's range, times the number of
    /// intervals an octave has (the scaling of OpenCV).
    pub contrast: f32,
    /// Largest ratio of the principal curvatures: beyond it the point slides along an edge.
    pub edge_ratio: f32,
    /// At most so many keypoints are kept (before several directions multiply them).
    pub max_keypoints: usize,
    /// Cells along the longer side of the grid over which they are spread; 0 keeps the strongest wherever they are.
    pub spread_cells: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            first_octave: FirstOctave::Original,
            contrast: 0.01,
            edge_ratio: 10.0,
            max_keypoints: 1000,
            spread_cells: 16,
        }
    }
}

/// The features of a picture; none where it shows nothing (one grey level, no data).
pub fn detect(picture: &Raster<f32>, options: &Options) -> Features<Descriptor> {
    Intensity::new(picture).map_or_else(Features::default, |intensity| detect_in(&intensity, options))
}

/// The features of a picture whose grey levels are stretched already.
pub fn detect_in(intensity: &Intensity, options: &Options) -> Features<Descriptor> {
    let octaves = scale_space::octaves(&intensity.image, options.first_octave);
    let found: Vec<Extremum> =
        octaves.iter().enumerate().flat_map(|(idx, octave)| extrema::find(octave, idx, options)).collect();
    let places: Vec<(f32, f32, f32)> = found
        .iter()
        .map(|e| {
            let step = octaves[e.octave_idx].step;
            (e.x * step, e.y * step, e.response)
        })
        .collect();
    let known: Vec<usize> = (0..found.len())
        .filter(|&i| {
            let radius = KNOWN_SIGMAS * f64::from(found[i].sigma() * octaves[found[i].octave_idx].step);
            intensity.is_known_around(f64::from(places[i].0), f64::from(places[i].1), radius)
        })
        .collect();
    let candidates: Vec<_> = known.iter().map(|&i| places[i]).collect();
    let size = [intensity.image.width, intensity.image.height];
    let kept = spread::spread(&candidates, size, options.spread_cells, options.max_keypoints);
    // Neighbours one after the other: their surroundings stay in the cache.
    let mut kept: Vec<usize> = kept.into_iter().map(|i| known[i]).collect();
    kept.sort_unstable_by_key(|&i| (found[i].octave_idx, found[i].y as u32 / BAND_ROWS, found[i].level, i));
    let kept: Vec<Extremum> = kept.into_iter().map(|i| found[i]).collect();
    describe_all(&octaves, &kept)
}

fn describe_all(octaves: &[Octave], kept: &[Extremum]) -> Features<Descriptor> {
    let chunks: Vec<Vec<(Keypoint, Descriptor)>> = kept
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut samples = descriptor::Samples::default();
            let mut described = Vec::with_capacity(chunk.len() + chunk.len() / 4);
            for extremum in chunk {
                let octave = &octaves[extremum.octave_idx];
                let image = &octave.gaussians[extremum.level];
                for angle_rad in descriptor::orientations(image, extremum, &mut samples) {
                    let keypoint = keypoint_of(extremum, octave, angle_rad);
                    described
                        .push((keypoint, descriptor::describe(image, extremum, angle_rad, &mut samples)));
                }
            }
            described
        })
        .collect();
    let (keypoints, descriptors) = chunks.into_iter().flatten().unzip();
    Features { keypoints, descriptors }
}

fn keypoint_of(extremum: &Extremum, octave: &Octave, angle_rad: f32) -> Keypoint {
    let place = |position: f32| coordinate_of(f64::from(position) * f64::from(octave.step));
    Keypoint {
        at: Point2::new(place(extremum.x), place(extremum.y)),
        sigma_px: extremum.sigma() * octave.step,
        angle_rad,
        response: extremum.response,
    }
}

/// The standard deviation of a (fractional) level, samples of its octave.
fn sigma_of_level(level: f32) -> f32 {
    scale_space::BASE_SIGMA as f32 * (level / LEVELS as f32).exp2()
}
