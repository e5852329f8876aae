//! Rasters in memory, the files they come from and go to, and what is computed on them.
//!
//! Absent samples are NaN in memory; sentinels exist in files only and are resolved by the readers of [`dem`] and
//! the codecs.
#![forbid(unsafe_code)]

mod beside;
mod bounds;
pub mod codec;
pub mod colormap;
mod content;
pub mod dem;
pub mod error;
pub mod georef;
pub mod gradient;
pub mod illumination;
pub mod resample;
mod sample;
pub mod statistics;
mod tiff;

pub use error::Error;
pub use georef::Affine;

/// A grid of samples in memory, row after row from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Raster<T> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` samples, row-major.
    pub data: Vec<T>,
}

impl<T> Raster<T> {
    /// From samples in row-major order.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if `data` does not hold `width * height` samples.
    pub fn new(width: usize, height: usize, data: Vec<T>) -> Result<Self, Error> {
        match width.checked_mul(height) {
            Some(expected) if expected == data.len() => Ok(Self { width, height, data }),
            _ => Err(Error::SizeMismatch {
                what: "raster",
                expected: format!("{width}×{height} samples"),
                found: data.len().to_string(),
            }),
        }
    }

    /// Evaluates `f(x, y)` at every sample.
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> T) -> Self {
        let data = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect();
        Self { width, height, data }
    }

    /// The sample of column `x` in row `y`; `None` outside.
    #[inline]
    pub fn get(&self, x: usize, y: usize) -> Option<&T> {
        if x < self.width { self.data.get(y.checked_mul(self.width)?.checked_add(x)?) } else { None }
    }

    /// The samples of row `y`.
    ///
    /// # Panics
    /// If `y` is not below the height.
    #[inline]
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// Row `y`, to be changed.
    ///
    /// # Panics
    /// If `y` is not below the height.
    #[inline]
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[y * self.width..(y + 1) * self.width]
    }

    /// The rows from the top.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[T]> {
        self.data.chunks_exact(self.width.max(1))
    }

    /// A raster of the same size with each sample replaced.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Raster<U> {
        Raster { width: self.width, height: self.height, data: self.data.iter().map(f).collect() }
    }
}

impl<T: Clone> Raster<T> {
    /// The same value everywhere.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }
}

impl<T> std::ops::Index<(usize, usize)> for Raster<T> {
    type Output = T;
    /// The sample of column `x` in row `y`.
    #[inline]
    fn index(&self, (x, y): (usize, usize)) -> &T {
        &self.row(y)[x]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Raster<T> {
    #[inline]
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        &mut self.row_mut(y)[x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_row_major() {
        let raster = Raster::from_fn(3, 2, |x, y| 10 * y + x);
        assert_eq!(raster.data, [0, 1, 2, 10, 11, 12]);
        assert_eq!(raster[(2, 1)], 12);
        assert_eq!(raster.get(3, 0), None);
        assert_eq!(raster.get(0, 2), None);
        assert_eq!(raster.rows().map(<[usize]>::len).collect::<Vec<_>>(), [3, 3]);
        assert_eq!(raster.map(|v| v * 2).row(1), [20, 22, 24]);
    }

    #[test]
    fn a_wrong_number_of_samples_is_refused() {
        assert!(Raster::new(2, 2, vec![0u8; 3]).is_err());
        assert!(Raster::new(usize::MAX, 2, vec![0u8; 3]).is_err());
    }
}
