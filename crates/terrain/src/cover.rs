//! Whether a terrain carries a picture: how much of it would show cells too coarse for it, or no ground at all.

use serde::{Deserialize, Serialize};

/// What a picture asks of the terrain under it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CoverLimits {
    /// A cell is coarse if it is larger than this many times the pixel's footprint.
    pub coarse_factor: f64,
    /// Largest share of pixels that may see coarse cells.
    pub max_coarse_share: f64,
    /// Largest share of pixels that may see absent ground.
    pub max_absent_share: f64,
}

impl Default for CoverLimits {
    fn default() -> Self {
        Self { coarse_factor: 4.0, max_coarse_share: 0.02, max_absent_share: 0.0 }
    }
}

/// What one pixel sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Seen {
    /// Terrain of an effective cell size, with a footprint (ground sampling distance) of the pixel, both in metres.
    Ground {
        /// Effective cell size, metres.
        cell_m: f64,
        /// Ground sampling distance, metres.
        gsd_m: f64,
    },
    /// The terrain's edge or a hole in it.
    Absent,
    /// Space above the horizon: it asks nothing of the terrain.
    Sky,
}

/// Shares of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coverage {
    /// Pixels looked at, sky included.
    pub num_pixels: usize,
    /// Pixels that see cells that are too coarse.
    pub num_coarse: usize,
    /// Pixels that see absent ground.
    pub num_absent: usize,
    /// Pixels that see sky.
    pub num_sky: usize,
    /// Largest cell size over GSD.
    pub max_cells_per_gsd: f64,
}

impl Coverage {
    /// Counts the pixels of a picture.
    pub fn of(pixels: impl IntoIterator<Item = Seen>, limits: &CoverLimits) -> Self {
        let mut coverage = Self::default();
        for seen in pixels {
            coverage.num_pixels += 1;
            match seen {
                Seen::Ground { cell_m, gsd_m } => {
                    let ratio = cell_m / gsd_m;
                    coverage.max_cells_per_gsd = coverage.max_cells_per_gsd.max(ratio);
                    // A size that is not a number counts as coarse: nobody knows what it shows.
                    if ratio > limits.coarse_factor || ratio.is_nan() {
                        coverage.num_coarse += 1;
                    }
                }
                Seen::Absent => coverage.num_absent += 1,
                Seen::Sky => coverage.num_sky += 1,
            }
        }
        coverage
    }

    /// Share of pixels that see coarse cells; 0 of no pixels.
    pub(crate) fn coarse_share(&self) -> f64 {
        self.share(self.num_coarse)
    }

    /// Share of pixels that see absent ground; 0 of no pixels.
    pub fn absent_share(&self) -> f64 {
        self.share(self.num_absent)
    }

    /// Whether the terrain carries the picture. A picture without ground is not carried.
    pub fn is_enough(&self, limits: &CoverLimits) -> bool {
        self.num_pixels > self.num_sky
            && self.coarse_share() <= limits.max_coarse_share
            && self.absent_share() <= limits.max_absent_share
    }

    fn share(&self, count: usize) -> f64 {
        if self.num_pixels == 0 { 0.0 } else { count as f64 / self.num_pixels as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(coarse: usize, absent: usize, sky: usize) -> Coverage {
        let fine = Seen::Ground { cell_m: 5.0, gsd_m: 2.0 };
        let bad = Seen::Ground { cell_m: 40.0, gsd_m: 9.9 };
        let rest = 1000 - coarse - absent - sky;
        let pixels = [(fine, rest), (bad, coarse), (Seen::Absent, absent), (Seen::Sky, sky)];
        let pixels = pixels.into_iter().flat_map(|(seen, count)| std::iter::repeat_n(seen, count));
        Coverage::of(pixels, &CoverLimits::default())
    }

    #[test]
    fn two_percent_of_coarse_pixels_are_allowed_and_no_hole() {
        let limits = CoverLimits::default();
        assert!(picture(20, 0, 0).is_enough(&limits));
        assert!(!picture(21, 0, 0).is_enough(&limits));
        assert!(!picture(0, 1, 0).is_enough(&limits));
        assert!(picture(0, 0, 900).is_enough(&limits));
        assert!(!picture(0, 0, 1000).is_enough(&limits));
        assert!((picture(20, 5, 0).absent_share() - 0.005).abs() < 1e-12);
    }

    #[test]
    fn four_cells_per_pixel_is_the_limit_itself() {
        let limits = CoverLimits::default();
        let at = |cell_m: f64| Coverage::of([Seen::Ground { cell_m, gsd_m: 10.0 }], &limits).num_coarse;
        assert_eq!((at(40.0), at(40.1), at(f64::NAN)), (0, 1, 1));
    }
}
