//! A picture from a surface and a Sun, and how well it agrees with a given one.

use super::surface::ViewSurface;
use rayon::prelude::*;
use selenograph_geometry::Vector3;
use selenograph_raster::Raster;

/// A rendered picture beside the given one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Pearson's correlation over all pixels with depth.
    pub pearson: f64,
    /// Root mean square of the difference after the gain, grey levels.
    pub rmse_levels: f64,
    /// Grey levels per unit of radiance factor: least squares through zero.
    pub gain: f64,
    /// Pixels compared.
    pub num_pixels: usize,
}

/// Lights a surface from one direction (attached shadows only) and blurs it; NaN where there is no surface.
///
/// `shade(mu0, mu, cos_phase)` is called with positive cosines only.
pub fn render(
    surface: &ViewSurface,
    to_sun: &Vector3<f64>,
    psf_sigma_px: f64,
    shade: impl Fn(f64, f64, f64) -> f64 + Sync,
) -> Raster<f64> {
    let facets = &surface.facets;
    let data = facets
        .data
        .par_iter()
        .map(|facet| match facet {
            None => f64::NAN,
            Some(facet) => {
                let (mu0, mu) = (facet.normal.dot(to_sun), facet.normal.dot(&facet.to_eye));
                if mu0 > 0.0 && mu > 0.0 { shade(mu0, mu, facet.to_eye.dot(to_sun)) } else { 0.0 }
            }
        })
        .collect();
    blurred(&Raster { width: facets.width, height: facets.height, data }, psf_sigma_px)
}

/// Gaussian blur in which absent (NaN) samples neither give nor receive.
fn blurred(sharp: &Raster<f64>, sigma_px: f64) -> Raster<f64> {
    if sigma_px <= 0.0 {
        return sharp.clone();
    }
    // Beyond four sigma a Gaussian holds 6e-5 of its volume.
    let reach = (4.0 * sigma_px).ceil() as i64;
    let weights: Vec<f64> = (-reach..=reach).map(|d| (-0.5 * (d as f64 / sigma_px).powi(2)).exp()).collect();
    let (width, height) = (sharp.width as i64, sharp.height as i64);
    let data = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| {
            let weights = &weights;
            (0..width).map(move |x| {
                if sharp[(x as usize, y as usize)].is_nan() {
                    return f64::NAN;
                }
                let (mut sum, mut total) = (0.0, 0.0);
                for ny in (y - reach).max(0)..=(y + reach).min(height - 1) {
                    for nx in (x - reach).max(0)..=(x + reach).min(width - 1) {
                        let value = sharp[(nx as usize, ny as usize)];
                        let weight = weights[(ny - y + reach) as usize] * weights[(nx - x + reach) as usize];
                        if !value.is_nan() {
                            sum += weight * value;
                            total += weight;
                        }
                    }
                }
                sum / total
            })
        })
        .collect();
    Raster { width: sharp.width, height: sharp.height, data }
}

/// Compares a rendering with a picture of the same size; `None` if they have no pixel in common or one is uniform.
pub fn compare(rendered: &Raster<f64>, picture: &Raster<u8>) -> Option<Agreement> {
    let pairs = || {
        rendered
            .data
            .iter()
            .zip(&picture.data)
            .filter(|(value, _)| value.is_finite())
            .map(|(&value, &level)| (value, f64::from(level)))
    };
    let num_pixels = pairs().count();
    let n = num_pixels as f64;
    let sums =
        pairs().fold([0.0; 5], |s, (a, b)| [s[0] + a, s[1] + b, s[2] + a * a, s[3] + b * b, s[4] + a * b]);
    let [a, b, aa, bb, ab] = sums.map(|sum| sum / n);
    let spread = ((aa - a * a) * (bb - b * b)).sqrt();
    // An empty picture gives NaN.
    if spread.is_nan() || spread <= 0.0 {
        return None;
    }
    let gain = ab / aa;
    let square = pairs().map(|(value, level)| (gain * value - level).powi(2)).sum::<f64>() / n;
    Some(Agreement { pearson: (ab - a * b) / spread, rmse_levels: square.sqrt(), gain, num_pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn proportional_pictures_agree_perfectly() {
        let rendered =
            Raster::from_fn(20, 10, |x, y| if x == 3 { f64::NAN } else { (x + 2 * y) as f64 / 100.0 });
        let picture = Raster::from_fn(20, 10, |x, y| (3 * (x + 2 * y)) as u8);
        let found = compare(&rendered, &picture).unwrap();
        assert!((found.pearson - 1.0).abs() < 1e-12 && found.rmse_levels < 1e-9);
        assert!((found.gain - 300.0).abs() < 1e-9);
        assert_eq!(found.num_pixels, 190);
        assert!(compare(&Raster::filled(4, 4, 1.0), &Raster::filled(4, 4, 7)).is_none());
        assert!(compare(&Raster::filled(4, 4, f64::NAN), &Raster::filled(4, 4, 7)).is_none());
    }

    #[test]
    fn blur_keeps_a_constant_beside_holes_and_edges() {
        let mut sharp = Raster::filled(9, 7, 2.5);
        sharp[(4, 3)] = f64::NAN;
        let soft = blurred(&sharp, 0.6);
        assert!(soft[(4, 3)].is_nan());
        assert!(soft.data.iter().filter(|v| v.is_finite()).all(|v| (v - 2.5).abs() < 1e-12));
        // A point spreads to the ceiling of a 0.6 px Gaussian: 1/(Σ w)² = 0.4406.
        let mut point = Raster::filled(9, 7, 0.0);
        point[(4, 3)] = 1.0;
        assert!((blurred(&point, 0.6)[(4, 3)] - 0.4406).abs() < 1e-3);
    }
}
