//! The exposures of a pair, derived again: bits and shares from pictures and masks, gain and offset from the pictures and the
//! radiance that depth, Sun and the campaign's law give.

use super::record::{Told, kept};
use crate::Error;
use crate::pair::{ExposureRecord, ViewName};
use crate::photometric::fit::render;
use crate::photometric::surface::ViewSurface;
use crate::plan::Campaign;
use crate::plan::rendering::ToneKind;
use crate::stored::RawView;
use selenograph_geometry::Vector3;
use selenograph_raster::codec::Picture;
use selenograph_raster::{Raster, statistics};

/// How far a gain may lie from the one that is derived, as a share of it; and an offset, as a share of full scale.
///
/// The radiance here is that of a pixel's middle, on a surface that is smooth between pixels; the picture's is a mean over
/// rays, on the terrain itself. Of 33 pairs of 512² like those of `demo`, under three Suns each, all stay within a third of this.
const TOLERANCE: f64 = 0.1;

/// Fewer pixels in full light than this tell nothing of an exposure.
const LEAST_PIXELS: usize = 64;

/// A picture: its bits, the shares of full scale of its pixels, and how many are at full scale.
struct Levels {
    bits: u8,
    shares: Raster<f64>,
    num_full: usize,
}

impl Levels {
    fn of(picture: Picture) -> Self {
        let levels = |bits, full: f64, levels: Raster<f64>, to_middle: f64| Self {
            bits,
            num_full: levels.data.iter().filter(|level| **level >= full).count(),
            shares: levels.map(|level| if *level >= full { f64::NAN } else { (level + to_middle) / full }),
        };
        match picture {
            Picture::Grey16(grey) => levels(16, f64::from(u16::MAX), grey.map(|v| f64::from(*v)), 0.0),
            // Rounded down: half a level more is the middle of what became it.
            Picture::Grey8(grey) => levels(8, f64::from(u8::MAX), grey.map(|v| f64::from(*v)), 0.5),
            Picture::Rgb8(rgb) => levels(8, f64::INFINITY, rgb.map(|_| 0.0), 0.0),
        }
    }
}

/// What each view shows to the Sun, worked out once for all lights; `None` without a campaign, whose law it needs.
pub(super) struct Lit<'a> {
    campaign: &'a Campaign,
    surfaces: [ViewSurface; 2],
}

impl<'a> Lit<'a> {
    pub fn new(campaign: Option<&'a Campaign>, views: [&RawView; 2]) -> Result<Option<Self>, Error> {
        let Some(campaign) = campaign else { return Ok(None) };
        let [a, b] = views.map(ViewSurface::new);
        Ok(Some(Self { campaign, surfaces: [a?, b?] }))
    }

    /// Radiance (I/F) and share of full scale of the pixels that are in full light, with everything round them.
    fn samples(
        &self,
        idx: usize,
        to_sun: &Vector3<f64>,
        shares: &Raster<f64>,
        lit: Option<&Raster<u8>>,
    ) -> Vec<[f64; 2]> {
        let settings = &self.campaign.render;
        let radiance = render(&self.surfaces[idx], to_sun, settings.psf_sigma_px, |mu0, mu, cos_phase| {
            settings.brdf.radiance_factor(mu0, mu, cos_phase, settings.albedo)
        });
        // As far as the point spread reaches.
        let reach = (4.0 * settings.psf_sigma_px).ceil() as usize;
        let is_lit = |x: usize, y: usize| {
            lit.is_none_or(|lit| lit.get(x, y) != Some(&0)) && shares.get(x, y).is_some_and(|s| !s.is_nan())
        };
        let rows = |x: usize| x.saturating_sub(reach)..=x + reach;
        let mut samples = Vec::new();
        for y in reach..shares.height.saturating_sub(reach) {
            for x in reach..shares.width.saturating_sub(reach) {
                let value = radiance[(x, y)];
                if value > 0.0 && rows(y).all(|y| rows(x).all(|x| is_lit(x, y))) {
                    samples.push([value, shares[(x, y)]]);
                }
            }
        }
        samples
    }
}

/// Gain where there is no offset: the median ratio.
fn gain(samples: &[[f64; 2]]) -> Option<f64> {
    (samples.len() >= LEAST_PIXELS).then(|| statistics::median(samples.iter().map(|[x, y]| y / x))).flatten()
}

/// Gain and offset by least squares; `None` where the radiance hardly varies.
fn gain_and_offset(samples: &[[f64; 2]]) -> Option<[f64; 2]> {
    let n = samples.len() as f64;
    let mean = |value: fn(&[f64; 2]) -> f64| samples.iter().map(value).sum::<f64>() / n;
    let (x, y) = (mean(|s| s[0]), mean(|s| s[1]));
    let sums = samples.iter().map(|s| [(s[0] - x).powi(2), (s[0] - x) * (s[1] - y)]);
    let [xx, xy] = sums.fold([0.0; 2], |sum, s| [sum[0] + s[0], sum[1] + s[1]]);
    let varies = samples.len() >= LEAST_PIXELS && (xx / n).sqrt() > 0.05 * x;
    varies.then(|| [xy / xx, y - xy / xx * x])
}

impl Told<'_> {
    /// Those that pictures and masks confirm as they are told, the others as they have to be.
    pub(super) fn exposures(&self) -> Result<Vec<ExposureRecord>, Error> {
        let told = &self.record.exposures;
        let campaign = self.campaign();
        let num_wanted = if campaign.is_some() { 2 * self.record.suns.len() } else { told.len() };
        let lit = Lit::new(campaign.filter(|_| !told.is_empty()), self.views)?;
        let mut again: Vec<ExposureRecord> = Vec::new();
        for (light_idx, both) in told[..told.len().min(num_wanted)].chunks(2).enumerate() {
            again.extend(self.light(light_idx, both, lit.as_ref())?);
        }
        // One that is lacking differs from what is there by its being there.
        let lacking = told.last().cloned().unwrap_or_else(|| ExposureRecord {
            light_idx: 0,
            view: ViewName::A,
            tone: String::new(),
            gain: 0.0,
            offset: 0.0,
            bits: 0,
            saturated_share: 0.0,
            lit_share: 0.0,
        });
        again.resize(num_wanted, lacking);
        Ok(again)
    }

    /// The exposures under one light, of A and, where it is told, of B.
    fn light(
        &self,
        light_idx: usize,
        told: &[ExposureRecord],
        surfaces: Option<&Lit<'_>>,
    ) -> Result<Vec<ExposureRecord>, Error> {
        let light = light_idx as u64;
        let to_sun =
            self.record.suns.get(light_idx).copied().flatten().map(|sun| Vector3::from(sun.direction));
        let (mut again, mut samples) = (Vec::new(), Vec::new());
        for ((idx, view), told) in ViewName::BOTH.into_iter().enumerate().zip(told) {
            let depth_z = self.depths[idx];
            let num_pixels = depth_z.data.len().max(1) as f64;
            let levels = Levels::of(self.open.picture(view, light, (depth_z.width, depth_z.height))?);
            let lit = self.open.lit(view, light)?;
            let mut exposure = ExposureRecord { light_idx, view, bits: levels.bits, ..told.clone() };
            if let Some(surfaces) = surfaces {
                exposure.tone = surfaces.campaign.tone.kind.as_str().into();
            }
            // What is just below full scale is rounded up to it.
            exposure.saturated_share = told.saturated_share.clamp(0.0, levels.num_full as f64 / num_pixels);
            if let Some(lit) = &lit {
                exposure.lit_share = lit.data.iter().filter(|lit| **lit > 0).count() as f64 / num_pixels;
            }
            let seen = surfaces.zip(to_sun);
            samples.push(seen.map_or_else(Vec::new, |(surfaces, to_sun)| {
                surfaces.samples(idx, &to_sun, &levels.shares, lit.as_ref())
            }));
            again.push(exposure);
        }
        if again.iter().all(|exposure| exposure.tone == ToneKind::PairGain.as_str()) {
            one_gain(&mut again, &samples.concat());
        } else {
            for (exposure, samples) in again.iter_mut().zip(&samples) {
                stretched(exposure, samples);
            }
        }
        Ok(again)
    }
}

/// Both views have the gain of the first, or the one that is derived, and no offset.
fn one_gain(both: &mut [ExposureRecord], samples: &[[f64; 2]]) {
    let Some(first) = both.first().map(|first| possible(first.gain)) else { return };
    let gain = gain(samples).map_or(first, |gain| kept(Some(first), gain, TOLERANCE * gain));
    for exposure in both {
        (exposure.gain, exposure.offset) = (gain, 0.0);
    }
}

/// Radiance is not negative: what becomes black is none, or some that the offset takes away.
fn stretched(exposure: &mut ExposureRecord, samples: &[[f64; 2]]) {
    (exposure.gain, exposure.offset) = (possible(exposure.gain), exposure.offset.min(0.0));
    if let Some([gain, offset]) = gain_and_offset(samples) {
        exposure.gain = kept(Some(exposure.gain), gain, TOLERANCE * gain);
        exposure.offset = kept(Some(exposure.offset), offset, TOLERANCE);
    }
}

/// A gain that is none becomes that of pictures without light.
fn possible(gain: f64) -> f64 {
    if gain.is_finite() && gain > 0.0 { gain } else { 1.0 }
}
