//! Where an elevation model and a picture are of one ground: octave by octave, how like the picture the model's rendering is.
//!
//! The longest waves of two landscapes agree by chance (two slopes lie towards the Sun or they do not), the shortest of a coarse model
//! are missing. In between a model of the right ground, at the right place, is like the picture in every octave that it holds, and one
//! of other ground in none.

use crate::shading::Compared;
use selenograph_raster::Raster;
use serde::Serialize;

/// One octave.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Octave {
    /// Side of the squares whose means are compared within squares of twice the side, metres: half its shorter wavelengths.
    pub length_m: f64,
    /// Correlation of picture and rendering.
    pub correlation: f64,
    /// Contrast of the rendering in that of the picture.
    pub contrast: f64,
    /// Means compared.
    pub num_means: usize,
}

/// Least correlation of an octave that the model holds, in that of the likest one: a sixth of its brightness is not the picture's.
const HELD: f64 = 0.92;
/// Least correlation of the likest octave of one ground, and the contrast from which on an octave is looked at: less is no relief.
pub(super) const SAME_GROUND: f64 = 0.5;
const LEAST_CONTRAST: f64 = 0.3;
/// Fewer means than this are alike by chance.
const LEAST_MEANS: usize = 200;
/// Share of a square's four parts that must be there: all.
const PARTS: usize = 4;

/// The octaves of a picture and its rendering on cells of `cell_m`, the shortest first.
pub(super) fn octaves(compared: &Compared, cell_m: f64) -> Vec<Octave> {
    let both: Vec<f32> = compared.picture.data.iter().zip(&compared.model.data).map(|(p, m)| p + m).collect();
    // Both are absent where either is.
    let masked = |raster: &Raster<f32>| Raster {
        width: raster.width,
        height: raster.height,
        data: raster.data.iter().zip(&both).map(|(v, b)| if b.is_nan() { f32::NAN } else { *v }).collect(),
    };
    let (mut picture, mut model) = (masked(&compared.picture), masked(&compared.model));
    let mut length_m = cell_m;
    let mut found = Vec::new();
    while picture.width >= 2 && picture.height >= 2 {
        let (coarser_picture, coarser_model) = (halved(&picture), halved(&model));
        let octave = compare([&picture, &coarser_picture], [&model, &coarser_model], length_m);
        if octave.num_means < LEAST_MEANS {
            break;
        }
        found.push(octave);
        (picture, model) = (coarser_picture, coarser_model);
        length_m *= 2.0;
    }
    found
}

/// Means of two by two; NaN where one of them is.
fn halved(raster: &Raster<f32>) -> Raster<f32> {
    Raster::from_fn(raster.width / 2, raster.height / 2, |x, y| {
        let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| raster[(2 * x + i, 2 * y + j)]);
        four.iter().sum::<f32>() / PARTS as f32
    })
}

/// Deviations from the means of two by two.
fn compare(picture: [&Raster<f32>; 2], model: [&Raster<f32>; 2], length_m: f64) -> Octave {
    let (mut pp, mut mm, mut pm, mut n) = (0.0f64, 0.0f64, 0.0f64, 0usize);
    for y in 0..2 * picture[1].height {
        for x in 0..2 * picture[1].width {
            let deviation = |of: [&Raster<f32>; 2]| f64::from(of[0][(x, y)] - of[1][(x / 2, y / 2)]);
            let (p, m) = (deviation(picture), deviation(model));
            if p.is_finite() && m.is_finite() {
                (pp, mm, pm, n) = (pp + p * p, mm + m * m, pm + p * m, n + 1);
            }
        }
    }
    let correlation = if pp > 0.0 && mm > 0.0 { pm / (pp * mm).sqrt() } else { 0.0 };
    Octave { length_m, correlation, contrast: (mm / pp.max(1e-30)).sqrt(), num_means: n }
}

/// What the octaves of all pictures say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// The model holds relief from this length on, metres.
    Agrees { from_m: f64 },
    /// The model has no relief that could be recognised; the longest length looked at, metres.
    TooSmooth { longest_m: f64 },
    /// Not the ground of this picture, from 0; the correlation of the likest octave.
    OtherGround { picture: usize, correlation: f64 },
}

/// Judges pictures by their octaves.
pub(super) fn judge(pictures: &[Vec<Octave>]) -> Verdict {
    let shown = |octaves: &[Octave]| -> Vec<Octave> {
        octaves.iter().filter(|o| o.contrast >= LEAST_CONTRAST).copied().collect()
    };
    let longest_m = pictures.iter().flatten().map(|o| o.length_m).fold(0.0, f64::max);
    let mut from_m = f64::INFINITY;
    let mut any = false;
    for (picture, octaves) in pictures.iter().enumerate() {
        let shown = shown(octaves);
        let best = shown.iter().map(|o| o.correlation).fold(f64::NEG_INFINITY, f64::max);
        if shown.is_empty() {
            continue;
        }
        any = true;
        if best < SAME_GROUND {
            return Verdict::OtherGround { picture, correlation: best };
        }
        // From long waves to short ones, as far as they agree without a break.
        let likest = shown.iter().rposition(|o| o.correlation >= HELD * best).unwrap_or(0);
        let held = shown[..=likest].iter().rev().take_while(|o| o.correlation >= HELD * best);
        from_m = held.last().map_or(from_m, |o| from_m.min(o.length_m));
    }
    if any { Verdict::Agrees { from_m } } else { Verdict::TooSmooth { longest_m } }
}
