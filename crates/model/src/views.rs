//! What goes in and what is passed between encoder and decoder: images and tokens, with where they lie.
//!
//! Images of one call have one size. Training stores every image landscape: one that was taken portrait is stored
//! transposed (its axes swapped, not rotated), and the network sees it upright. Inference stores nothing transposed.

use std::marker::PhantomData;

use burn_tensor::{Device, Int, Tensor, TensorData};
use selenograph_network::config::IMAGE_CHANNELS;

use crate::error::{Error, Result};

/// Pixels along a token's side in the stem's maps: networks with a stem have patches of 16 pixels.
const STEM_PIXELS_PER_TOKEN: [usize; 2] = [8, 4];

/// Images of one stored size, values from −1 to 1, channels first.
#[derive(Debug, Clone)]
pub struct Images {
    pub(crate) pixels: Tensor<4>,
    pub(crate) transposed: Vec<bool>,
}

impl Images {
    /// Images as they were taken: `values` of `[count, 3, height, width]`.
    ///
    /// # Errors
    /// [`Error::Views`] if the values do not fill the images.
    pub fn upright(values: Vec<f32>, [count, height, width]: [usize; 3], device: &Device) -> Result<Self> {
        let expected = count * IMAGE_CHANNELS * height * width;
        if values.len() != expected || expected == 0 {
            return Err(Error::views("number of values", expected.max(1), values.len()));
        }
        let data = TensorData::new(values, [count, IMAGE_CHANNELS, height, width]);
        let pixels = Tensor::from_data(data, &device.clone().without_autodiff());
        Ok(Self { pixels, transposed: vec![false; count] })
    }

    /// Images stored landscape, each with the height and width that it was taken with: those that are higher than wide are
    /// stored transposed.
    ///
    /// # Errors
    /// [`Error::Views`] if the values do not fill the images, or a true size is neither the stored one nor its transpose.
    pub fn stored_landscape(
        values: Vec<f32>,
        [height, width]: [usize; 2],
        true_sizes: &[[usize; 2]],
        device: &Device,
    ) -> Result<Self> {
        if height > width {
            return Err(Error::views("stored size", "a landscape image", format!("{width}×{height}")));
        }
        for &[own_height, own_width] in true_sizes {
            if ![[height, width], [width, height]].contains(&[own_height, own_width]) {
                let expected = format!("{width}×{height} or its transpose");
                return Err(Error::views("true size", expected, format!("{own_width}×{own_height}")));
            }
        }
        let mut images = Self::upright(values, [true_sizes.len(), height, width], device)?;
        images.transposed = true_sizes.iter().map(|[height, width]| height > width).collect();
        Ok(images)
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.transposed.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.transposed.is_empty()
    }

    /// Where their tokens lie.
    ///
    /// # Errors
    /// [`Error::Views`] if a side is no whole number of patches.
    pub(crate) fn grid(&self, patch_px: usize) -> Result<Grid> {
        let [_, _, height, width] = self.pixels.dims();
        for (what, side) in [("height", height), ("width", width)] {
            if !side.is_multiple_of(patch_px) {
                return Err(Error::views(what, format!("a multiple of {patch_px} pixels"), side));
            }
        }
        Ok(Grid { rows: height / patch_px, columns: width / patch_px, transposed: self.transposed.clone() })
    }
}

/// Where the tokens of a batch of images lie: patches of the stored images, and which are stored transposed.
///
/// Tokens run along the rows of the upright image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grid {
    /// Rows of patches of a stored image.
    pub rows: usize,
    /// Columns of patches of a stored image.
    pub columns: usize,
    /// For each image, whether it is stored transposed.
    pub transposed: Vec<bool>,
}

impl Grid {
    /// Images.
    pub fn count(&self) -> usize {
        self.transposed.len()
    }

    /// Tokens of an image.
    pub fn num_tokens(&self) -> usize {
        self.rows * self.columns
    }

    /// Rows and columns of an image's upright grid.
    pub fn upright(&self, transposed: bool) -> [usize; 2] {
        if transposed { [self.columns, self.rows] } else { [self.rows, self.columns] }
    }

    /// The images of each orientation, those stored as they were taken first; orientations without images are left out.
    pub(crate) fn groups(&self) -> Vec<(bool, Vec<usize>)> {
        let of = |orientation: bool| -> Vec<usize> {
            (0..self.count()).filter(|idx| self.transposed[*idx] == orientation).collect()
        };
        [false, true].map(|each| (each, of(each))).into_iter().filter(|(_, each)| !each.is_empty()).collect()
    }
}

/// Tokens before the encoder's last normalisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Raw {}
/// Tokens after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Normed {}

/// What the encoder's blocks know of images, before `enc_norm`: what can be cached while that still learns.
pub type Features = Tokens<Raw>;
/// What the encoder knows of images: what the decoders and heads read.
pub type Encoding = Tokens<Normed>;

/// Tokens of a batch of images.
#[derive(Debug, Clone)]
pub struct Tokens<Stage> {
    /// `[images, tokens, channels]`.
    pub values: Tensor<3>,
    /// Where they lie.
    pub grid: Grid,
    /// The stem's maps at a half and a quarter of the stored images' size, for networks that have one.
    pub(crate) maps: Option<StemMaps>,
    stage: PhantomData<Stage>,
}

/// Maps of a stem, `[images, channels, height, width]` as the images are stored, the finer first.
pub(crate) type StemMaps = [Tensor<4>; 2];

impl<Stage> Tokens<Stage> {
    pub(crate) fn new(values: Tensor<3>, grid: Grid) -> Self {
        Self { values, grid, maps: None, stage: PhantomData }
    }

    pub(crate) fn with_maps(self, maps: Option<StemMaps>) -> Self {
        Self { maps, ..self }
    }

    /// From numbers in memory, `[images, tokens, channels]`: from a cache or from another executor.
    ///
    /// # Errors
    /// [`Error::Views`] if they do not fill the grid.
    pub fn from_values(values: Vec<f32>, grid: Grid, channels: usize, device: &Device) -> Result<Self> {
        let shape = [grid.count(), grid.num_tokens(), channels];
        let expected: usize = shape.iter().product();
        if values.len() != expected || expected == 0 {
            return Err(Error::views("number of token values", expected, values.len()));
        }
        let device = device.clone().without_autodiff();
        Ok(Self::new(Tensor::from_data(TensorData::new(values, shape), &device), grid))
    }

    /// With the maps of a stem from numbers in memory, as [`Tokens::maps()`] has them; each with so many channels.
    ///
    /// # Errors
    /// [`Error::Views`] if they do not fill the images.
    pub fn with_map_values(self, values: [Vec<f32>; 2], channels: [usize; 2]) -> Result<Self> {
        let device = self.values.device().without_autodiff();
        let map = |values: Vec<f32>, per_token: usize, channels: usize| {
            let (rows, columns) = (per_token * self.grid.rows, per_token * self.grid.columns);
            let shape = [self.grid.count(), rows, columns, channels];
            let expected: usize = shape.iter().product();
            if values.len() != expected {
                return Err(Error::views("number of values of a stem's map", expected, values.len()));
            }
            let map = Tensor::<4>::from_data(TensorData::new(values, shape), &device);
            Ok(map.permute([0, 3, 1, 2]))
        };
        let [half, quarter] = values;
        let maps = [
            map(half, STEM_PIXELS_PER_TOKEN[0], channels[0])?,
            map(quarter, STEM_PIXELS_PER_TOKEN[1], channels[1])?,
        ];
        Ok(self.with_maps(Some(maps)))
    }

    /// The stem's maps at a half and a quarter of the stored images' size, `[images, height, width, channels]`.
    pub fn maps(&self) -> Option<[Tensor<4>; 2]> {
        let maps = self.maps.as_ref()?;
        Some(maps.each_ref().map(|map| map.clone().permute([0, 2, 3, 1])))
    }

    /// Those of the images at these places, in this order; a place may come more than once.
    ///
    /// # Errors
    /// [`Error::Views`] for a place that is not there, or for none.
    pub fn select(&self, places: &[usize]) -> Result<Self> {
        if places.is_empty() {
            return Err(Error::views("number of places in the batch", "at least 1", 0));
        }
        if let Some(outside) = places.iter().find(|place| **place >= self.grid.count()) {
            return Err(Error::views("place in the batch", format!("below {}", self.grid.count()), outside));
        }
        let transposed = places.iter().map(|place| self.grid.transposed[*place]).collect();
        let grid = Grid { transposed, ..self.grid };
        let maps = self.maps.as_ref().map(|maps| maps.each_ref().map(|map| select(map.clone(), places)));
        Ok(Self::new(select(self.values.clone(), places), grid).with_maps(maps))
    }
}

/// The entries of the first axis at these places.
pub(crate) fn select<const D: usize>(values: Tensor<D>, places: &[usize]) -> Tensor<D> {
    if places.iter().copied().eq(0..values.dims()[0]) {
        return values;
    }
    let numbers: Vec<i64> = places.iter().map(|place| *place as i64).collect();
    let device = values.device().without_autodiff();
    let indices = Tensor::<1, Int>::from_data(TensorData::new(numbers, [places.len()]), &device);
    values.select(0, indices)
}

/// Puts the results of groups of images (the batch first) back into the images' order.
pub(crate) fn gather<const D: usize>(groups: &[(bool, Vec<usize>)], parts: Vec<Tensor<D>>) -> Tensor<D> {
    let order: Vec<usize> = groups.iter().flat_map(|(_, places)| places.iter().copied()).collect();
    let mut back = vec![0; order.len()];
    for (position, place) in order.iter().enumerate() {
        back[*place] = position;
    }
    select(Tensor::cat(parts, 0), &back)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_do_not_fit_are_errors() {
        let device = Device::flex();
        let zeros = |count: usize| vec![0.0_f32; count];
        assert!(Images::upright(zeros(3 * 16 * 16 - 1), [1, 16, 16], &device).is_err());
        assert!(Images::upright(Vec::new(), [0, 16, 16], &device).is_err());
        assert!(Images::upright(zeros(3 * 16 * 24), [1, 16, 24], &device).unwrap().grid(16).is_err());
        let stored =
            |size, true_size| Images::stored_landscape(zeros(3 * 16 * 32), size, &[true_size], &device);
        assert!(stored([32, 16], [32, 16]).is_err());
        assert!(stored([16, 32], [16, 16]).is_err());
        let portrait = stored([16, 32], [32, 16]).unwrap();
        assert_eq!(portrait.grid(16).unwrap().upright(portrait.transposed[0]), [2, 1]);
        let grid = portrait.grid(16).unwrap();
        assert!(Features::from_values(zeros(7), grid.clone(), 4, &device).is_err());
        let features = Features::from_values(zeros(8), grid, 4, &device).unwrap();
        assert!(features.select(&[0, 1]).is_err());
        assert!(features.select(&[]).is_err());
        assert_eq!(features.select(&[0, 0]).unwrap().grid.transposed, [true, true]);
    }

    #[test]
    fn groups_come_back_in_order() {
        let grid = Grid { rows: 1, columns: 2, transposed: vec![true, false, true, false, false] };
        let numbers = |places: &[usize]| {
            let values: Vec<f32> = places.iter().map(|place| *place as f32).collect();
            Tensor::<1>::from_data(TensorData::new(values, [places.len()]), &Device::flex())
        };
        let groups = grid.groups();
        let parts = groups.iter().map(|(_, places)| numbers(places)).collect();
        assert_eq!(gather(&groups, parts).try_into_vec_as::<f32>().unwrap(), [0.0, 1.0, 2.0, 3.0, 4.0]);
    }
}
