//! A view as a network's input, and what had to be done to it.

use crate::Error;
use selenograph_network::input::{InputTransform, Rgb8, Rule};
use selenograph_raster::{Raster, statistics};

/// A picture that a network can be given.
pub(crate) struct Input {
    pub transform: InputTransform,
    pub image: Rgb8,
    /// Whether all of it has one grey level.
    pub is_blank: bool,
    /// What was done to the picture, in sentences.
    pub notes: Vec<String>,
}

/// Makes an input of a picture.
///
/// # Errors
/// [`Error::Network`] for a picture below one patch.
pub(crate) fn input(picture: &Raster<f32>, rule: Rule, patch_px: usize) -> Result<Input, Error> {
    let transform = InputTransform::new(picture.width, picture.height, rule, patch_px)?;
    let mut notes = Vec::new();
    let known = || picture.data.iter().copied().filter(|level| level.is_finite());
    let (low, high) = known().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let grey = if low < 0.0 || high > 1.0 {
        // Radiances and the like: a network knows pictures only.
        let [low, high] = statistics::quantiles(known().map(f64::from), [0.001, 0.999]).unwrap_or([0.0, 1.0]);
        notes.push(format!("grey levels from {low:.4} to {high:.4} were stretched to those of a picture"));
        let width = (high - low).max(f64::MIN_POSITIVE);
        Rgb8::from_unit_grey(&picture.map(|level| ((f64::from(*level) - low) / width) as f32))?
    } else {
        Rgb8::from_unit_grey(picture)?
    };
    notes.extend(described(&transform));
    Ok(Input {
        image: transform.apply(&grey)?,
        transform,
        is_blank: low.partial_cmp(&high) != Some(std::cmp::Ordering::Less),
        notes,
    })
}

/// What a transform does to a picture; nothing for a picture that is taken as it is.
fn described(transform: &InputTransform) -> Vec<String> {
    let size = |[width, height]: [usize; 2]| format!("{width}×{height}");
    let mut notes = Vec::new();
    if transform.resized != transform.source {
        notes.push(format!("resized from {} to {}", size(transform.source), size(transform.resized)));
    }
    if transform.kept != transform.resized {
        let [x, y] = transform.origin;
        let percent = 100.0 * transform.lost_share();
        notes.push(format!(
            "cropped to {} from column {x} and row {y} on: {percent:.1} % of it has no points",
            size(transform.kept)
        ));
    }
    if transform.input != transform.kept {
        notes.push(format!("padded to {} by repeating its last column and row", size(transform.input)));
    }
    notes
}
