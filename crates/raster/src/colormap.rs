//! Numbers as colours, for looking.

use crate::Raster;

/// A colour map over `[0, 1]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colormap {
    /// Matplotlib's viridis: dark blue to yellow.
    Viridis,
    /// Matplotlib's inferno, a heat map: black over red to pale yellow.
    Inferno,
    /// Black to white.
    Grey,
}

/// Colour of absent samples.
pub const ABSENT: [u8; 3] = [96, 96, 110];

/// Polynomial coefficients in rising order, red, green and blue, after M. Zucker's fits to Matplotlib's tables
/// (CC0, shadertoy.com/view/WlfXRN); they stay within 0.02 of the tables.
const VIRIDIS: [[f64; 3]; 7] = [
    [0.277_727_327_223_417_7, 0.005_407_344_544_966_578, 0.334_099_805_335_306_1],
    [0.105_093_043_108_577_4, 1.404_613_529_898_575, 1.384_590_162_594_685],
    [-0.330_861_828_725_556_3, 0.214_847_559_468_213, 0.095_095_163_028_236_59],
    [-4.634_230_498_983_486, -5.799_100_973_351_585, -19.332_440_956_279_87],
    [6.228_269_936_347_081, 14.179_933_366_805_09, 56.690_552_600_681_05],
    [4.776_384_997_670_288, -13.745_145_377_746_01, -65.353_032_633_372_34],
    [-5.435_455_855_934_631, 4.645_852_612_178_535, 26.312_435_249_583_2],
];

/// See [`VIRIDIS`].
const INFERNO: [[f64; 3]; 7] = [
    [0.000_218_940_369_119_226_5, 0.001_651_004_631_001_012, -0.019_480_898_437_091_84],
    [0.106_513_419_485_611_6, 0.563_956_436_788_409_1, 3.932_712_388_889_277],
    [11.602_493_082_471_87, -3.972_853_965_665_698, -15.942_394_106_291_4],
    [-41.703_996_131_394_59, 17.436_398_882_053_13, 44.354_145_198_728_13],
    [77.162_935_699_427, -33.402_358_942_100_92, -81.807_309_257_389_93],
    [-71.319_428_244_992_14, 32.626_064_263_977_23, 73.209_519_858_032_02],
    [25.131_126_224_773_41, -12.242_668_952_385_67, -23.070_325_002_871_72],
];

impl Colormap {
    /// The colour of a fraction (clamped to `[0, 1]`); NaN has the colour [`ABSENT`].
    pub fn color(self, fraction: f64) -> [u8; 3] {
        if fraction.is_nan() {
            return ABSENT;
        }
        let t = fraction.clamp(0.0, 1.0);
        let to_byte = |value: f64| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        let polynomial = |coefficients: &[[f64; 3]; 7]| {
            std::array::from_fn(|channel| {
                to_byte(coefficients.iter().rev().fold(0.0, |sum, c| sum * t + c[channel]))
            })
        };
        match self {
            Self::Viridis => polynomial(&VIRIDIS),
            Self::Inferno => polynomial(&INFERNO),
            Self::Grey => [to_byte(t); 3],
        }
    }

    /// Colours of a raster, `low` and below at the map's start, `high` and above at its end.
    pub fn paint(self, raster: &Raster<f32>, low: f64, high: f64) -> Raster<[u8; 3]> {
        let span = if high > low { high - low } else { 1.0 };
        raster.map(
            |&value| {
                if value.is_finite() { self.color((f64::from(value) - low) / span) } else { ABSENT }
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `matplotlib.colormaps["viridis"](t, bytes=True)` and the same of inferno at t = 0, 0.25, 0.5, 0.75, 1.
    #[test]
    fn close_to_matplotlib() {
        let viridis = [[68, 1, 84], [58, 82, 139], [32, 144, 140], [94, 201, 97], [253, 231, 36]];
        let inferno = [[0, 0, 3], [87, 15, 109], [187, 55, 84], [249, 142, 8], [252, 254, 164]];
        for (map, table) in [(Colormap::Viridis, viridis), (Colormap::Inferno, inferno)] {
            for (i, expected) in table.iter().enumerate() {
                let found = map.color(i as f64 / 4.0);
                let worst = found.iter().zip(expected).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
                assert!(worst <= 8, "{map:?} {i}: {found:?} {expected:?}");
            }
        }
    }

    #[test]
    fn absent_and_out_of_range() {
        assert_eq!(Colormap::Viridis.color(f64::NAN), ABSENT);
        assert_eq!(Colormap::Grey.color(-3.0), [0; 3]);
        let raster = Raster { width: 4, height: 1, data: vec![1.0, 3.0, f32::NAN, f32::INFINITY] };
        assert_eq!(Colormap::Grey.paint(&raster, 1.0, 3.0).data, [[0; 3], [255; 3], ABSENT, ABSENT]);
    }
}
