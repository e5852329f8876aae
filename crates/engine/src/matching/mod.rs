//! Reciprocal nearest neighbours among descriptors, fast or exact, without the matrix of all products.

mod screen;
mod search;

use crate::error::{Error, Result};
use crate::kernel::Simd;
use search::{NONE, Targets};

/// Rounds after which a start that still moves is given up, as the paper has it.
const MAX_ROUNDS: usize = 10;

/// Descriptors of an image, row-major over its pixels.
#[derive(Debug, Clone, Copy)]
pub struct DescriptorMap<'a> {
    /// Rows of pixels.
    pub height_px: usize,
    /// Columns of pixels.
    pub width_px: usize,
    /// Numbers of a descriptor.
    pub dim: usize,
    /// `height · width · dim` numbers, descriptors of (about) unit length.
    pub values: &'a [f32],
}

/// A pixel by column and row.
pub type PixelIndex = [u32; 2];

/// A match: a pixel of the first image, a pixel of the second.
pub type PixelPair = [PixelIndex; 2];

/// Two images ready to be matched.
pub struct Matcher<'a> {
    maps: [DescriptorMap<'a>; 2],
    targets: [Targets; 2],
    /// What is already known: for each pixel its nearest in the other image.
    known: [Vec<u32>; 2],
    level: Simd,
}

impl<'a> Matcher<'a> {
    /// Packs both images' descriptors.
    ///
    /// # Errors
    /// Maps that are empty, not as large as they say, or of different descriptors.
    pub fn new(first: DescriptorMap<'a>, second: DescriptorMap<'a>) -> Result<Self> {
        Self::with_simd(first, second, Simd::detect())
    }

    /// As [`Matcher::new`], with instructions of the caller's choice.
    ///
    /// # Errors
    /// As [`Matcher::new`], and instructions that this processor does not have.
    pub fn with_simd(first: DescriptorMap<'a>, second: DescriptorMap<'a>, level: Simd) -> Result<Self> {
        let level = level.checked()?;
        let maps = [first, second];
        for map in &maps {
            let expected = map.height_px * map.width_px * map.dim;
            if expected == 0 || map.values.len() != expected || expected > NONE as usize {
                let expected = format!("{} × {} × {}, more than none", map.height_px, map.width_px, map.dim);
                let found = map.values.len().to_string();
                return Err(Error::Matching { what: "number of descriptor values", expected, found });
            }
        }
        if first.dim != second.dim {
            let (expected, found) = (first.dim.to_string(), second.dim.to_string());
            return Err(Error::Matching { what: "size of the second image's descriptors", expected, found });
        }
        let targets = maps.map(|map| Targets::new(level, map.values, (map.height_px, map.width_px), map.dim));
        let known = maps.map(|map| vec![NONE; map.height_px * map.width_px]);
        Ok(Self { maps, targets, known, level })
    }

    /// Fast reciprocal matching: starts on a grid of every `subsample` pixels of the first image jump from
    /// nearest to nearest until they stay; those that do not within ten rounds are dropped.
    ///
    /// The result is sorted by pixel of the first image, then of the second, each pair once.
    ///
    /// # Errors
    /// A subsampling of zero.
    ///
    /// # Source
    /// Leroy et al., MASt3R (2024), §3.3.
    pub fn reciprocal(&mut self, subsample: usize) -> Result<Vec<PixelPair>> {
        if subsample == 0 {
            let expected = "at least one pixel".to_owned();
            return Err(Error::Matching { what: "subsample", expected, found: "0".to_owned() });
        }
        let (width, height) = (self.maps[0].width_px, self.maps[0].height_px);
        let rows = (subsample / 2..height).step_by(subsample);
        let starts = rows.flat_map(|y| (subsample / 2..width).step_by(subsample).map(move |x| y * width + x));
        let mut points: Vec<[u32; 2]> = starts.map(|pixel| [pixel as u32, NONE]).collect();
        let mut active: Vec<usize> = (0..points.len()).collect();
        for _ in 0..MAX_ROUNDS {
            for side in 0..2 {
                let queries: Vec<u32> = active.iter().map(|idx| points[*idx][side]).collect();
                self.learn(side, &queries);
                active.retain(|idx| {
                    let point = &mut points[*idx];
                    let next = self.known[side][point[side] as usize];
                    let moved = next != point[1 - side];
                    point[1 - side] = next;
                    moved
                });
            }
            if active.is_empty() {
                break;
            }
        }
        for idx in active {
            points[idx] = [NONE; 2];
        }
        points.retain(|point| point[0] != NONE);
        points.sort_unstable();
        points.dedup();
        Ok(points.into_iter().map(|point| self.pair(point)).collect())
    }

    /// Exact matching of all pixels: pairs of which each is the other's nearest.
    pub fn reciprocal_dense(&mut self) -> Vec<PixelPair> {
        let forward = self.nearest_of_all();
        self.learn(1, &forward);
        let pairs = forward.iter().enumerate().map(|(pixel, other)| [pixel as u32, *other]);
        let kept = pairs.filter(|pair| self.known[1][pair[1] as usize] == pair[0]);
        kept.map(|pair| self.pair(pair)).collect()
    }

    /// For each pixel of the first image the flat index of its nearest in the second.
    pub fn nearest_of_all(&mut self) -> Vec<u32> {
        let all: Vec<u32> = (0..self.known[0].len() as u32).collect();
        self.learn(0, &all);
        self.known[0].clone()
    }

    /// Matches of given pixels of the first image: those from whose nearest the way back ends nearer than
    /// `tolerance_px`, in the order of the pixels' indices, each once.
    ///
    /// # Errors
    /// A pixel outside the image.
    pub fn match_points(&mut self, starts: &[PixelIndex], tolerance_px: f64) -> Result<Vec<PixelPair>> {
        let (width, height) = (self.maps[0].width_px, self.maps[0].height_px);
        if let Some(out) = starts.iter().find(|p| p[0] as usize >= width || p[1] as usize >= height) {
            let (expected, found) = (format!("inside {width} × {height}"), format!("{out:?}"));
            return Err(Error::Matching { what: "start", expected, found });
        }
        let mut pixels: Vec<u32> = starts.iter().map(|p| p[1] * width as u32 + p[0]).collect();
        pixels.sort_unstable();
        pixels.dedup();
        self.learn(0, &pixels);
        let there: Vec<u32> = pixels.iter().map(|pixel| self.known[0][*pixel as usize]).collect();
        self.learn(1, &there);
        let mut pairs = Vec::new();
        for (start, there) in pixels.into_iter().zip(there) {
            let [from, back] = [start, self.known[1][there as usize]].map(|pixel| self.place(0, pixel));
            let off = [0, 1].map(|axis| f64::from(from[axis]) - f64::from(back[axis]));
            if off[0].hypot(off[1]) < tolerance_px {
                pairs.push(self.pair([start, there]));
            }
        }
        Ok(pairs)
    }

    /// Looks up what is not known yet.
    fn learn(&mut self, side: usize, pixels: &[u32]) {
        let mut queries: Vec<u32> =
            pixels.iter().copied().filter(|pixel| self.known[side][*pixel as usize] == NONE).collect();
        queries.sort_unstable();
        queries.dedup();
        let mut found = vec![NONE; queries.len()];
        self.targets[1 - side].nearest(self.level, self.maps[side].values, &queries, &mut found);
        for (query, found) in queries.into_iter().zip(found) {
            // A descriptor that is not a number has no nearest: it goes to the first pixel, from where nothing
            // leads back to it.
            self.known[side][query as usize] = if found == NONE { 0 } else { found };
        }
    }

    fn place(&self, side: usize, pixel: u32) -> PixelIndex {
        let width = self.maps[side].width_px as u32;
        [pixel % width, pixel / width]
    }

    fn pair(&self, pixels: [u32; 2]) -> PixelPair {
        [self.place(0, pixels[0]), self.place(1, pixels[1])]
    }
}

/// One image as one decoding describes it.
#[derive(Debug, Clone, Copy)]
pub struct Described<'a> {
    /// Its descriptors.
    pub map: DescriptorMap<'a>,
    /// Their confidence, row-major.
    pub confidence: &'a [f32],
}

/// Matches of a pair decoded both ways, each way matched from either image; `ways[w][i]` is image i in way w.
///
/// Sorted, each pair once, with the geometric mean of both confidences in the first way that found it.
///
/// # Errors
/// As [`Matcher::new`] and [`Matcher::reciprocal`]; confidences that do not fill their images.
pub fn reciprocal_symmetric(
    ways: [[Described<'_>; 2]; 2],
    subsample: usize,
) -> Result<Vec<(PixelPair, f32)>> {
    let mut all = Vec::new();
    for way in ways {
        for image in way {
            let expected = image.map.height_px * image.map.width_px;
            if image.confidence.len() != expected {
                let (expected, found) = (expected.to_string(), image.confidence.len().to_string());
                return Err(Error::Matching { what: "number of confidences", expected, found });
            }
        }
        let forward = Matcher::new(way[0].map, way[1].map)?.reciprocal(subsample)?;
        let backward = Matcher::new(way[1].map, way[0].map)?.reciprocal(subsample)?;
        for pair in forward.into_iter().chain(backward.into_iter().map(|[b, a]| [a, b])) {
            let [q1, q2] = [0, 1].map(|side| {
                let [x, y] = pair[side].map(|at| at as usize);
                way[side].confidence[y * way[side].map.width_px + x]
            });
            all.push((pair, (q1 * q2).sqrt()));
        }
    }
    // The sort is stable: among equal pairs the first found stays first.
    all.sort_by_key(|(pair, _)| pair.map(|[x, y]| [y, x]));
    all.dedup_by_key(|(pair, _)| *pair);
    Ok(all)
}

/// Whether both pixels of a match lie at least `border_px` inside their images (width, height).
#[must_use]
pub fn inside_border(pair: PixelPair, sizes_px: [(usize, usize); 2], border_px: usize) -> bool {
    pair.iter().zip(sizes_px).all(|(pixel, (width, height))| {
        let inside = |at: u32, side: usize| (at as usize) >= border_px && (at as usize) + border_px < side;
        inside(pixel[0], width) && inside(pixel[1], height)
    })
}
