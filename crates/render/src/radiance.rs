//! Pictures: the mean radiance factor of each pixel's rays, for several Suns at once.

use crate::dispatch;
use crate::horizon::Horizon;
use crate::job::{Job, TILE};
use crate::kernel::MAX_SUNS;
use crate::pattern::{Patterns, turned};
use crate::sun::SunDisc;
use crate::tile::Tile;
use crate::{Error, InstructionSet, Interpolation, RadianceSettings, Shadows, Sun, Tracer, Truth, Viewpoint};
use rayon::prelude::*;
use selenograph_geometry::{Point2, pixel};
use selenograph_raster::Raster;

/// Radiance factor (I/F) of every pixel under each Sun: the mean over rays spread by the Gaussian point spread, each with a
/// direction of its own on the Sun's disc. Rays that meet no terrain count as black.
///
/// # Shapes and units
/// One raster of `width × height` per Sun. `truth` is that of the same view.
/// # Errors
/// [`Error::Setting`] for unusable settings or a truth of another size.
pub fn radiance(
    tracer: &Tracer<'_>,
    view: &Viewpoint,
    truth: &Truth,
    suns: &[Sun],
    settings: &RadianceSettings,
) -> Result<Vec<Raster<f32>>, Error> {
    settings.validate()?;
    let (width, height) = (view.camera.width, view.camera.height);
    if (truth.width, truth.height) != (width, height) {
        return Err(Error::Setting {
            name: "truth",
            expected: "the truth of the same view",
            found: format!("{}×{} for a picture of {width}×{height}", truth.width, truth.height),
        });
    }
    let mut job = Job {
        tracer,
        view,
        truth,
        settings,
        patterns: Patterns::new(settings.rays_per_pixel as usize, suns.first(), settings.seed),
        suns: suns.iter().map(SunDisc::new).collect(),
        horizons: Vec::new(),
    };
    if suns.len() > MAX_SUNS {
        return Err(Error::Setting {
            name: "suns",
            expected: "at most 8 Suns in one call",
            found: suns.len().to_string(),
        });
    }
    let tiles_x = width.div_ceil(TILE);
    let num_tiles = tiles_x * height.div_ceil(TILE);
    let corner = |n: usize| [(n % tiles_x) * TILE, (n / tiles_x) * TILE];
    let fast: Vec<Option<Tile>> = (0..num_tiles).into_par_iter().map(|n| job.fast_tile(corner(n))).collect();
    job.horizons = job.horizons_under(&fast);
    let job = &job;
    let brdf = settings.brdf.prepared();
    let tiles: Vec<Vec<f32>> = (0..num_tiles)
        .into_par_iter()
        .map(|n| {
            let mut out = vec![0.0; suns.len() * TILE * TILE];
            match &fast[n] {
                Some(tile) => dispatch::tile(job, tile, &brdf, corner(n), &mut out),
                None => job.exact_tile(corner(n), &mut out),
            }
            out
        })
        .collect();
    Ok((0..suns.len())
        .map(|s| {
            Raster::from_fn(width, height, |x, y| {
                let tile = &tiles[(y / TILE) * tiles_x + x / TILE];
                tile[(s * TILE + y % TILE) * TILE + x % TILE]
            })
        })
        .collect())
}

impl Job<'_> {
    /// The tile at a pixel, if the fast path applies there.
    fn fast_tile(&self, [x0, y0]: [usize; 2]) -> Option<Tile> {
        let exact = self.settings.instruction_set == InstructionSet::Exact;
        if exact || self.tracer.interpolation() != Interpolation::Bilinear {
            return None;
        }
        Tile::new(self, x0, y0)
    }

    /// The horizon of each Sun on each layer that a fast tile lies on.
    fn horizons_under(&self, fast: &[Option<Tile>]) -> Vec<Vec<Option<Horizon>>> {
        let terrain = self.tracer.terrain();
        let mut ground: Vec<Option<[f64; 4]>> = vec![None; terrain.layers.len()];
        if self.settings.shadows == Shadows::Cast {
            for tile in fast.iter().flatten() {
                let first = tile.base.map(f64::from);
                let last = [first[0] + f64::from(tile.cells[0]), first[1] + f64::from(tile.cells[1])];
                let all = ground[tile.layer_idx].get_or_insert([first[0], first[1], last[0], last[1]]);
                *all = [all[0].min(first[0]), all[1].min(first[1]), all[2].max(last[0]), all[3].max(last[1])];
            }
        }
        self.suns
            .par_iter()
            .map(|disc| {
                let of_layer = |(idx, ground): (usize, &Option<[f64; 4]>)| {
                    ground.and_then(|ground| Horizon::new(terrain, idx, ground, disc))
                };
                ground.iter().enumerate().map(of_layer).collect()
            })
            .collect()
    }

    /// Every ray of a tile by the exact tracer, in f64. `out`: `suns × TILE × TILE`.
    fn exact_tile(&self, [x0, y0]: [usize; 2], out: &mut [f32]) {
        for y in y0..(y0 + TILE).min(self.truth.height) {
            for x in x0..(x0 + TILE).min(self.truth.width) {
                self.exact_pixel(x, y, &mut |s, value| out[(s * TILE + y - y0) * TILE + x - x0] = value);
            }
        }
    }

    fn exact_pixel(&self, x: usize, y: usize, put: &mut dyn FnMut(usize, f32)) {
        let pattern = self.patterns.of_pixel(y * self.truth.width + x);
        let mut sums = vec![0.0f64; self.suns.len()];
        let sigma = self.settings.psf_sigma_px as f32;
        for packet in pattern.packets {
            for lane in (0..packet.weight.len()).filter(|lane| packet.weight[*lane] > 0.0) {
                let [dx, dy] =
                    turned(pattern.psf_turn, sigma * packet.psf_x[lane], sigma * packet.psf_y[lane]);
                let disc = turned(pattern.sun_turn, packet.sun_x[lane], packet.sun_y[lane]);
                let at =
                    Point2::new(pixel::center_of(x) + f64::from(dx), pixel::center_of(y) + f64::from(dy));
                self.exact_ray(&at, disc, f64::from(packet.weight[lane]), &mut sums);
            }
        }
        let albedo = self.pixel_albedo(x, y);
        for (s, sum) in sums.iter().enumerate() {
            put(s, (albedo * sum) as f32);
        }
    }
}
