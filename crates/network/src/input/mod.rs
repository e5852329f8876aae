//! A picture into a network's input: which part of it, in which size, and where that leaves the camera.
//!
//! [`Rule::Published`] is what the published networks were given: resized so that the longer side fits, cropped round the
//! middle to whole patches, squares to 4:3. [`Rule::Whole`] keeps all of the picture, the square too; what is no whole
//! number of patches is refused or padded, never cut.

pub use selenograph_raster::resample::pillow::Filter;

use crate::Error;
use selenograph_geometry::{Camera, pixel};
use selenograph_raster::Raster;
use selenograph_raster::resample::pillow;
use serde::{Deserialize, Serialize};

/// The size for which the published rule makes a square by another way.
const SMALL_SQUARE: usize = 224;
/// A grey level of this is mid-grey, 0 for the network.
const HALF_RANGE: f32 = 127.5;

/// A colour picture of 8 bits.
#[derive(Debug, Clone, PartialEq)]
pub struct Rgb8(Raster<[u8; 3]>);

impl Rgb8 {
    /// Of `width · height · 3` bytes, row by row.
    ///
    /// # Errors
    /// [`Error::Picture`] for an empty picture or another number of bytes.
    pub fn new(width: usize, height: usize, data: Vec<u8>) -> Result<Self, Error> {
        let len = width.checked_mul(height).and_then(|area| area.checked_mul(3));
        if width == 0 || height == 0 || len != Some(data.len()) {
            let expected = format!("three bytes for each pixel, found {} bytes", data.len());
            return Err(Error::Picture { width, height, expected });
        }
        Ok(Self(Raster { width, height, data: data.as_chunks().0.to_vec() }))
    }

    /// Of grey levels from 0 to 1; absent ones (NaN) become black, as in the files they come from.
    ///
    /// # Errors
    /// [`Error::Picture`] for an empty picture.
    pub fn from_unit_grey(grey: &Raster<f32>) -> Result<Self, Error> {
        let level = |value: &f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        let data = grey.rows().flatten().flat_map(|value| [level(value); 3]).collect();
        Self::new(grey.width, grey.height, data)
    }

    /// Width, pixels.
    pub fn width(&self) -> usize {
        self.0.width
    }

    /// Height, pixels.
    pub fn height(&self) -> usize {
        self.0.height
    }

    /// The bytes, row by row, red, green and blue of each pixel.
    pub fn data(&self) -> &[u8] {
        self.0.data.as_flattened()
    }

    /// What a network is given: red, green and blue planes, row by row, from −1 (black) to 1 (white).
    pub fn to_input(&self) -> Vec<f32> {
        let area = self.0.data.len();
        let mut planes = vec![0.0; 3 * area];
        for (idx, pixel) in self.0.data.iter().enumerate() {
            for (channel, value) in pixel.iter().enumerate() {
                planes[channel * area + idx] = f32::from(*value) / HALF_RANGE - 1.0;
            }
        }
        planes
    }
}

/// What is done to a side that is no whole number of patches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Border {
    /// The picture is refused.
    #[default]
    Refuse,
    /// Its last column or row is repeated up to the next whole patch.
    Pad,
}

/// How a picture becomes an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "rule")]
pub enum Rule {
    /// As the published networks were trained and are used.
    Published {
        /// Longer side, pixels; 512, and 224 for the small ones.
        size: usize,
        /// Whether a square stays one; otherwise it loses a quarter of its height.
        square: SquareCrop,
    },
    /// All of the picture; ours.
    Whole {
        /// Longest side, pixels; a larger picture is made smaller. `None` keeps every size.
        max_side: Option<usize>,
        /// What is done to a side that is no whole number of patches.
        border: Border,
    },
}

/// What the published rule makes of a square.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SquareCrop {
    /// Its middle rows, three quarters as high as wide.
    #[default]
    FourThirds,
    /// A square.
    Keep,
}

/// What becomes of a picture of a given size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct InputTransform {
    /// Width and height of the picture.
    pub source: [usize; 2],
    /// Width and height after resizing.
    pub resized: [usize; 2],
    /// How it is resized.
    pub filter: Filter,
    /// First column and row of the resized picture that are kept.
    pub origin: [usize; 2],
    /// Columns and rows of the resized picture that are kept: the first ones of the input.
    pub kept: [usize; 2],
    /// Width and height of the input; what lies beyond `kept` repeats its last column and row.
    pub input: [usize; 2],
}

impl InputTransform {
    /// What becomes of a picture of `width × height` for patches of `patch_px`.
    ///
    /// # Errors
    /// [`Error::Picture`] for a picture below one patch, and where the rule gives no whole number of patches.
    pub fn new(width: usize, height: usize, rule: Rule, patch_px: usize) -> Result<Self, Error> {
        let refuse = |expected: String| Error::Picture { width, height, expected };
        if width == 0 || height == 0 || patch_px == 0 || width.max(height) > 1 << 20 {
            return Err(refuse("1 to 1048576 pixels a side".into()));
        }
        let transform = match rule {
            Rule::Published { size, square } => published([width, height], size, square, patch_px),
            Rule::Whole { max_side, border } => whole([width, height], max_side, border, patch_px),
        };
        let below = |side: &usize| *side < patch_px;
        if transform.kept.iter().any(below) {
            let [w, h] = transform.resized;
            return Err(refuse(format!("at least one patch of {patch_px} pixels a side, also as {w}×{h}")));
        }
        if transform.input.iter().any(|side| !side.is_multiple_of(patch_px)) {
            let [w, h] = transform.input;
            return Err(refuse(format!("sides of whole patches of {patch_px} pixels; this gives {w}×{h}")));
        }
        Ok(transform)
    }

    /// The input of a picture of the transform's size.
    ///
    /// # Errors
    /// [`Error::Picture`] for a picture of another size.
    pub fn apply(&self, picture: &Rgb8) -> Result<Rgb8, Error> {
        self.check_source(picture.width(), picture.height())?;
        let resized = pillow::resize(&picture.0, self.resized[0], self.resized[1], self.filter);
        let [width, height] = self.input;
        let kept = |side: usize, value: usize| self.origin[side] + value.min(self.kept[side] - 1);
        Ok(Rgb8(Raster::from_fn(width, height, |x, y| resized[(kept(0, x), kept(1, y))])))
    }

    /// The camera of the input.
    ///
    /// # Errors
    /// [`Error::Picture`] for the camera of a picture of another size.
    pub fn camera(&self, camera: &Camera) -> Result<Camera, Error> {
        self.check_source(camera.width, camera.height)?;
        let resized = pixel::resize(camera, self.resized[0], self.resized[1])?;
        let cropped = pixel::crop(&resized, self.origin[0], self.origin[1], self.kept[0], self.kept[1])?;
        // Padding is on the far sides: it moves nothing.
        Ok(Camera { width: self.input[0], height: self.input[1], ..cropped })
    }

    /// Continuous coordinates in the picture of a place in the input.
    pub fn source_from_input(&self, x: f64, y: f64) -> [f64; 2] {
        let back = |side: usize, value: f64| {
            (value + self.origin[side] as f64) * self.source[side] as f64 / self.resized[side] as f64
        };
        [back(0, x), back(1, y)]
    }

    /// Continuous coordinates in the input of a place in the picture; may lie outside the input.
    pub fn input_from_source(&self, x: f64, y: f64) -> [f64; 2] {
        let forth = |side: usize, value: f64| {
            value * self.resized[side] as f64 / self.source[side] as f64 - self.origin[side] as f64
        };
        [forth(0, x), forth(1, y)]
    }

    /// Share of the picture's area that is cut away.
    pub fn lost_share(&self) -> f64 {
        let area = |sides: [usize; 2]| sides[0] as f64 * sides[1] as f64;
        1.0 - area(self.kept) / area(self.resized)
    }

    fn check_source(&self, width: usize, height: usize) -> Result<(), Error> {
        let [w, h] = self.source;
        if [width, height] == self.source {
            Ok(())
        } else {
            Err(Error::Picture { width, height, expected: format!("{w}×{h}, as planned") })
        }
    }
}

/// Sides scaled so that the longer one becomes `size`, halves rounded to even.
fn scaled(source: [usize; 2], size: usize) -> [usize; 2] {
    let longest = source[0].max(source[1]);
    source.map(|side| ((side as f64 * size as f64 / longest as f64).round_ties_even() as usize).max(1))
}

fn filter_for(source: [usize; 2], size: usize) -> Filter {
    if source[0].max(source[1]) > size { Filter::Lanczos } else { Filter::Bicubic }
}

fn published(source: [usize; 2], size: usize, square: SquareCrop, patch_px: usize) -> InputTransform {
    let [w, h] = source.map(|side| side as f64);
    let long = if size == SMALL_SQUARE {
        (SMALL_SQUARE as f64 * (w / h).max(h / w)).round_ties_even() as usize
    } else {
        size
    };
    let resized = scaled(source, long);
    let middle = resized.map(|side| side / 2);
    let half = if size == SMALL_SQUARE {
        [middle[0].min(middle[1]); 2]
    } else {
        let [x, y] = middle.map(|middle| (2 * middle) / patch_px * patch_px / 2);
        if resized[0] == resized[1] && square == SquareCrop::FourThirds { [x, 3 * x / 4] } else { [x, y] }
    };
    let kept = half.map(|half| 2 * half);
    InputTransform {
        source,
        resized,
        filter: filter_for(source, long),
        origin: [0, 1].map(|side| middle[side] - half[side]),
        kept,
        input: kept,
    }
}

fn whole(source: [usize; 2], max_side: Option<usize>, border: Border, patch_px: usize) -> InputTransform {
    let longest = source[0].max(source[1]);
    let resized = match max_side {
        Some(max) if longest > max => scaled(source, max),
        _ => source,
    };
    let input = match border {
        Border::Refuse => resized,
        Border::Pad => resized.map(|side| side.next_multiple_of(patch_px)),
    };
    InputTransform { source, resized, filter: Filter::Lanczos, origin: [0, 0], kept: resized, input }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUBLISHED: Rule = Rule::Published { size: 512, square: SquareCrop::FourThirds };

    #[test]
    fn a_square_loses_a_quarter_of_its_height_and_the_camera_follows() {
        let transform = InputTransform::new(512, 512, PUBLISHED, 16).unwrap();
        assert_eq!((transform.input, transform.origin), ([512, 384], [0, 64]));
        assert_eq!(transform.lost_share(), 0.25);
        let camera = Camera::from_fov(512, 512, 0.8).unwrap();
        let cropped = transform.camera(&camera).unwrap();
        assert_eq!((cropped.cx, cropped.cy, cropped.fx), (camera.cx, camera.cy - 64.0, camera.fx));
        assert!(transform.camera(&Camera::from_fov(512, 384, 0.8).unwrap()).is_err());
    }

    #[test]
    fn ours_keeps_the_whole_picture_or_says_no() {
        let rule = |border| Rule::Whole { max_side: Some(512), border };
        let square = InputTransform::new(512, 512, rule(Border::Refuse), 16).unwrap();
        assert_eq!((square.input, square.lost_share()), ([512, 512], 0.0));
        assert!(InputTransform::new(512, 500, rule(Border::Refuse), 16).is_err());
        let padded = InputTransform::new(512, 500, rule(Border::Pad), 16).unwrap();
        assert_eq!((padded.kept, padded.input), ([512, 500], [512, 512]));
        let picture = Rgb8::new(512, 500, (0..512 * 500 * 3).map(|i| (i % 251) as u8).collect()).unwrap();
        let input = padded.apply(&picture).unwrap();
        assert_eq!(input.data()[..picture.data().len()], *picture.data());
        assert_eq!(input.data()[511 * 1536..], picture.data()[499 * 1536..]);
        let camera = Camera::from_fov(512, 500, 0.8).unwrap();
        assert_eq!(padded.camera(&camera).unwrap().cy, camera.cy);
    }

    #[test]
    fn places_go_there_and_back() {
        let transform = InputTransform::new(1024, 700, PUBLISHED, 16).unwrap();
        let [x, y] = transform.input_from_source(300.25, 400.5);
        let [sx, sy] = transform.source_from_input(x, y);
        // Two roundings of f64 at these sizes.
        const TOLERANCE: f64 = 1e-9;
        assert!((sx - 300.25).abs() < TOLERANCE && (sy - 400.5).abs() < TOLERANCE);
        let camera = Camera::from_fov(1024, 700, 0.8).unwrap();
        let [cx, cy] = transform.input_from_source(camera.cx, camera.cy);
        let moved = transform.camera(&camera).unwrap();
        assert!((moved.cx - cx).abs() < TOLERANCE && (moved.cy - cy).abs() < TOLERANCE);
    }

    #[test]
    fn impossible_pictures_are_refused() {
        for (width, height) in [(0, 5), (1, 1), (512, 15), (4000, 20), (usize::MAX, 512)] {
            assert!(
                InputTransform::new(width, height, PUBLISHED, 16).is_err() || width == 1,
                "{width}×{height}"
            );
        }
        let odd = Rule::Published { size: 48, square: SquareCrop::FourThirds };
        assert!(InputTransform::new(48, 48, odd, 16).is_err());
        assert!(Rgb8::new(4, 4, vec![0; 47]).is_err());
    }

    #[test]
    fn grey_levels_span_the_networks_range() {
        let grey = Raster::new(3, 1, vec![0.0, 1.0, f32::NAN]).unwrap();
        let input = Rgb8::from_unit_grey(&grey).unwrap().to_input();
        assert_eq!(input, [-1.0, 1.0, -1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0]);
    }
}
