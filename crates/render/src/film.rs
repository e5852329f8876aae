//! From radiance to grey levels: one gain for all pictures that belong together, or the stretch of the reference.

use crate::Error;
use selenograph_raster::Raster;
use serde::{Deserialize, Serialize};

/// How a picture's grey levels follow its radiance. Both are linear.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "mode", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Tone {
    /// One gain for the pictures of a pair: the given quantile of their radiance becomes the given share of full scale.
    Gain {
        /// Quantile of the radiance of all pictures together, in (0, 1].
        quantile: f64,
        /// Share of full scale, in (0, 1].
        level: f64,
    },
    /// Each picture from its own minimum to its own maximum, as the StereoLunar pictures are. Destroys radiometry.
    MinMax,
}

impl Default for Tone {
    /// Leaves headroom above the 99.5 % quantile so that few pixels clip, and those are counted.
    fn default() -> Self {
        Self::Gain { quantile: 0.995, level: 0.9 }
    }
}

/// `level = gain · radiance + offset`, in shares of full scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Exposure {
    /// Full scales per unit of radiance factor.
    pub gain: f64,
    /// Share of full scale at no radiance.
    pub offset: f64,
}

impl Tone {
    /// Refuses settings that no exposure can follow.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn validate(&self) -> Result<(), Error> {
        let Self::Gain { quantile, level } = self else { return Ok(()) };
        for (name, value) in [("tone.quantile", *quantile), ("tone.level", *level)] {
            if !(value > 0.0 && value <= 1.0) {
                return Err(Error::Setting {
                    name,
                    expected: "above 0 and at most 1",
                    found: value.to_string(),
                });
            }
        }
        Ok(())
    }

    /// The exposure of each of the pictures of a pair. Pictures without any light get gain 1.
    pub fn exposures(&self, pictures: &[&Raster<f32>]) -> Vec<Exposure> {
        match *self {
            Self::Gain { quantile, level } => {
                let mut all: Vec<f32> =
                    pictures.iter().flat_map(|p| p.data.iter().copied()).filter(|v| v.is_finite()).collect();
                let at = ((all.len() as f64 * quantile).ceil() as usize).clamp(1, all.len().max(1)) - 1;
                let bright = if all.is_empty() {
                    0.0
                } else {
                    f64::from(*all.select_nth_unstable_by(at, f32::total_cmp).1)
                };
                let gain = if bright > 0.0 { level / bright } else { 1.0 };
                vec![Exposure { gain, offset: 0.0 }; pictures.len()]
            }
            Self::MinMax => pictures
                .iter()
                .map(|p| {
                    let (low, high) = p
                        .data
                        .iter()
                        .filter(|v| v.is_finite())
                        .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
                    let span = f64::from(high) - f64::from(low);
                    let gain = if span > 0.0 { 1.0 / span } else { 1.0 };
                    Exposure { gain, offset: if span > 0.0 { -f64::from(low) * gain } else { 0.0 } }
                })
                .collect(),
        }
    }
}

impl Exposure {
    fn level(&self, radiance: f32) -> f64 {
        (self.gain * f64::from(radiance) + self.offset).clamp(0.0, 1.0)
    }

    /// 8-bit grey levels, rounded down as the reference does.
    pub fn to_u8(&self, picture: &Raster<f32>) -> Raster<u8> {
        let data = picture.data.iter().map(|v| (self.level(*v) * 255.0).floor() as u8).collect();
        Raster { width: picture.width, height: picture.height, data }
    }

    /// 16-bit grey levels, rounded to the nearest.
    pub fn to_u16(&self, picture: &Raster<f32>) -> Raster<u16> {
        let data = picture.data.iter().map(|v| (self.level(*v) * 65_535.0).round() as u16).collect();
        Raster { width: picture.width, height: picture.height, data }
    }

    /// Pixels brighter than full scale.
    pub fn num_clipped(&self, picture: &Raster<f32>) -> usize {
        picture.data.iter().filter(|v| self.gain * f64::from(**v) + self.offset > 1.0).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(scale: f32) -> Raster<f32> {
        Raster { width: 10, height: 10, data: (0..100).map(|k| scale * k as f32).collect() }
    }

    #[test]
    fn a_pair_shares_one_gain_and_clipping_is_counted() {
        let (a, b) = (picture(0.001), picture(0.002));
        let exposures = Tone::Gain { quantile: 0.9, level: 0.8 }.exposures(&[&a, &b]);
        assert_eq!(exposures[0], exposures[1]);
        let e = exposures[0];
        // Same radiance, same level, whichever picture it is in.
        assert_eq!(e.to_u16(&a).data[80], e.to_u16(&b).data[40]);
        assert!(e.num_clipped(&b) > 0 && e.num_clipped(&a) == 0);
    }

    #[test]
    fn min_max_stretches_each_picture_to_full_scale() {
        let (a, b) = (picture(0.001), picture(0.002));
        let e = Tone::MinMax.exposures(&[&a, &b]);
        assert_eq!(e[0].to_u8(&a).data, e[1].to_u8(&b).data);
        assert_eq!((e[0].to_u8(&a).data[0], e[0].to_u8(&a).data[99]), (0, 255));
    }

    #[test]
    fn darkness_has_a_finite_exposure() {
        let dark = Raster { width: 2, height: 1, data: vec![0.0, 0.0] };
        for tone in [Tone::default(), Tone::MinMax] {
            let e = tone.exposures(&[&dark])[0];
            assert!(e.gain.is_finite());
            assert_eq!(e.to_u8(&dark).data, vec![0, 0]);
        }
        assert!(Tone::Gain { quantile: 0.0, level: 1.0 }.validate().is_err());
    }
}
