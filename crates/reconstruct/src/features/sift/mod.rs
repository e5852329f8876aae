//! Scale-invariant features: extrema of differences of Gaussians, with a descriptor of gradients around each.
//!
//! # Source
//! Lowe 2004, "Distinctive image features from scale-invariant keypoints", IJCV 60(2); the root normalisation of the
//! descriptors from Arandjelović & Zisserman 2012, "Three things everyone should know to improve object retrieval".

mod descriptor;
mod extrema;
mod options;
mod scale_space;
mod trigonometry;

use super::intensity::Intensity;
use super::{Features, Keypoint, coordinate_of, spread};
use extrema::Extremum;
use rayon::prelude::*;
use scale_space::Octave;
use selenograph_geometry::Point2;
use selenograph_raster::Raster;

pub use descriptor::{DESCRIPTOR_LEN, Descriptor};
pub use options::{FirstOctave, Options};

/// Keypoints of one piece of work.
const CHUNK: usize = 32;

/// Rows whose keypoints are described one level after the other.
const BAND_ROWS: u32 = 32;

/// Absent samples may come this close to a keypoint, in its standard deviations.
const KNOWN_SIGMAS: f64 = 4.0;

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
