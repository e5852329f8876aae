//! Image sequences into pairs: which frames are wanted, where they are cut, and streams of video read frame by frame.
//!
//! One frame is in memory at a time, whatever the length of the sequence.

mod jpeg_stream;
mod stream;
mod y4m;

pub use stream::{FrameStream, StreamFormat};

use crate::Error;
use selenograph_geometry::{Camera, pixel};
use selenograph_raster::Raster;
use selenograph_raster::codec::Picture;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Which frames make pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pairing {
    /// Every so many frames a pair begins, from the first frame on.
    pub every: usize,
    /// So many frames later comes its second view.
    pub gap: usize,
}

impl Pairing {
    /// Checked.
    ///
    /// # Errors
    /// [`Error::Value`] for a zero.
    pub fn new(every: usize, gap: usize) -> Result<Self, Error> {
        for (key, value) in [("every", every), ("gap", gap)] {
            if value == 0 {
                return Err(Error::Value { key, expected: "at least 1 frame", found: "0".into() });
            }
        }
        Ok(Self { every, gap })
    }

    /// Whether some pair has this frame.
    pub fn wants(&self, frame_idx: usize) -> bool {
        frame_idx.is_multiple_of(self.every)
            || frame_idx.checked_sub(self.gap).is_some_and(|first| first.is_multiple_of(self.every))
    }

    /// The pairs whose frames are both there.
    pub fn pairs(&self, there: &BTreeSet<usize>) -> Vec<[usize; 2]> {
        let begins = there.iter().filter(|idx| idx.is_multiple_of(self.every));
        begins.map(|a| [*a, a + self.gap]).filter(|[_, b]| there.contains(b)).collect()
    }
}

/// What is cut out of every frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Its first column and row in the frame; the middle of the frame where absent.
    pub left_top: Option<[usize; 2]>,
}

impl Window {
    /// First column and row in a frame of this size.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the window does not fit.
    pub fn place(&self, width: usize, height: usize) -> Result<[usize; 2], Error> {
        let middle = || [width.saturating_sub(self.width) / 2, height.saturating_sub(self.height) / 2];
        let [left, top] = self.left_top.unwrap_or_else(middle);
        if self.width == 0 || self.height == 0 || left + self.width > width || top + self.height > height {
            return Err(Error::SizeMismatch {
                what: "frame",
                expected: format!("at least {}×{}", left + self.width.max(1), top + self.height.max(1)),
                found: format!("{width}×{height}"),
            });
        }
        Ok([left, top])
    }

    /// The window of a frame, as grey levels of 8 or 16 bits.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if it does not fit.
    pub fn cut(&self, frame: &Picture) -> Result<Picture, Error> {
        let (width, height) = frame.size();
        let from = self.place(width, height)?;
        Ok(match frame {
            Picture::Grey8(raster) => Picture::Grey8(self.part(raster, from, |v| *v)),
            Picture::Grey16(raster) => Picture::Grey16(self.part(raster, from, |v| *v)),
            // Luma of ITU-R BT.601 in whole numbers, rounded.
            Picture::Rgb8(raster) => Picture::Grey8(self.part(raster, from, |&[red, green, blue]| {
                let sum = 299 * u32::from(red) + 587 * u32::from(green) + 114 * u32::from(blue);
                ((sum + 500) / 1000) as u8
            })),
        })
    }

    fn part<T, U>(&self, raster: &Raster<T>, [left, top]: [usize; 2], grey: impl Fn(&T) -> U) -> Raster<U> {
        Raster::from_fn(self.width, self.height, |x, y| grey(&raster[(left + x, top + y)]))
    }

    /// The camera of the window.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if it does not fit.
    pub fn camera(&self, camera: &Camera) -> Result<Camera, Error> {
        let [left, top] = self.place(camera.width, camera.height)?;
        Ok(pixel::crop(camera, left, top, self.width, self.height)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_begin_every_so_often_and_both_frames_are_wanted() {
        let pairing = Pairing::new(10, 3).unwrap();
        let wanted: BTreeSet<usize> = (0..25).filter(|idx| pairing.wants(*idx)).collect();
        assert_eq!(wanted.iter().copied().collect::<Vec<_>>(), [0, 3, 10, 13, 20, 23]);
        assert_eq!(pairing.pairs(&wanted), [[0, 3], [10, 13], [20, 23]]);
        let short: BTreeSet<usize> = wanted.into_iter().filter(|idx| *idx != 13 && *idx < 23).collect();
        assert_eq!(pairing.pairs(&short), [[0, 3]]);
        // Neighbours share frames where the gap is the interval.
        assert_eq!(Pairing::new(1, 1).unwrap().pairs(&(0..4).collect()), [[0, 1], [1, 2], [2, 3]]);
        assert!(Pairing::new(0, 1).is_err() && Pairing::new(1, 0).is_err());
    }

    #[test]
    fn the_window_and_its_camera_move_together() {
        let frame = Picture::Grey16(Raster::from_fn(7, 5, |x, y| (10 * y + x) as u16));
        let window = Window { width: 3, height: 2, left_top: Some([4, 3]) };
        let Picture::Grey16(cut) = window.cut(&frame).unwrap() else { panic!("another depth of samples") };
        assert_eq!(cut.data, [34, 35, 36, 44, 45, 46]);
        let camera = Camera::from_fov(7, 5, 0.8).unwrap();
        assert_eq!(window.camera(&camera).unwrap().cx, camera.cx - 4.0);
        let middle = Window { left_top: None, ..window };
        assert_eq!(middle.place(7, 5).unwrap(), [2, 1]);
        assert!(middle.place(2, 5).is_err() && Window { width: 0, ..window }.place(7, 5).is_err());
    }

    #[test]
    fn colours_become_their_luma() {
        let frame = Picture::Rgb8(Raster { width: 2, height: 1, data: vec![[255, 0, 0], [9, 9, 9]] });
        let window = Window { width: 2, height: 1, left_top: None };
        assert_eq!(
            window.cut(&frame).unwrap(),
            Picture::Grey8(Raster { width: 2, height: 1, data: vec![76, 9] })
        );
    }
}
