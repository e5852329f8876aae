//! Samples as files hold them, and the law that turns them into heights.

use serde::Serialize;

/// Type of a stored sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SampleType {
    /// 8-bit unsigned.
    U8,
    /// 8-bit signed.
    I8,
    /// 16-bit unsigned.
    U16,
    /// 16-bit signed.
    I16,
    /// 32-bit unsigned.
    U32,
    /// 32-bit signed.
    I32,
    /// 32-bit IEEE 754.
    F32,
    /// 64-bit IEEE 754.
    F64,
}

impl SampleType {
    /// Bytes of one sample.
    pub fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Whether samples are floating-point.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }
}

/// Order of the bytes of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ByteOrder {
    /// Least significant byte first (`LSB`, `II`, PC).
    Little,
    /// Most significant byte first (`MSB`, `MM`, IEEE, Sun).
    Big,
}

/// Floats at least this large are absent whatever the label says: ISIS keeps its special pixels (NULL, saturation)
/// in the last representable numbers, from −3.402 822 655e38 outwards.
const SPECIAL_PIXEL_MAGNITUDE: f64 = 3.402_822_6e38;

/// Stored number → height above the sphere: `gain · stored + bias`, absent where the file says so.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HeightLaw {
    gain: f64,
    bias: f64,
    absent: Vec<f64>,
}

impl HeightLaw {
    /// From the file's `scale` and `offset` (in units of `unit_m` metres), its no-data numbers, and the radius of the
    /// sphere. An offset of planetary size means that the file holds radii; they are brought down to heights.
    pub(crate) fn new(scale: f64, offset: f64, unit_m: f64, radius_m: f64, nodata: &[f64]) -> Self {
        let holds_radii = (offset * unit_m).abs() > 0.5 * radius_m;
        let bias = if holds_radii { offset * unit_m - radius_m } else { offset * unit_m };
        // 1737.4 km · 1000 is not exactly 1 737 400 in binary; a nanometre would spoil exact heights for nothing.
        let bias = if bias.abs() < 1e-6 { 0.0 } else { bias };
        Self { gain: scale * unit_m, bias, absent: nodata.to_vec() }
    }

    /// The same for samples that are radii without an offset that says so.
    pub(crate) fn of_radii(self, radius_m: f64) -> Self {
        Self { bias: self.bias - radius_m, ..self }
    }

    /// The height of a stored number.
    pub(crate) fn height(&self, stored: f64) -> f32 {
        (stored * self.gain + self.bias) as f32
    }

    /// The stored number of a height.
    pub(crate) fn stored(&self, height: f32) -> f64 {
        (f64::from(height) - self.bias) / self.gain
    }

    /// Heights of every `stride`-th sample from sample `first` on, one per element of `out`.
    pub(crate) fn decode(
        &self,
        bytes: &[u8],
        sample_type: SampleType,
        order: ByteOrder,
        first: usize,
        stride: usize,
        out: &mut [f32],
    ) {
        macro_rules! decode_as {
            ($number:ty) => {{
                // No-data numbers as this type holds them: −3.4028226550889045e+38 is rounded to f32 once, here,
                // and −9999 in a file of bytes is no number of it.
                let stored_as = |v: f64| f64::from(v as $number);
                let absent: Vec<f64> = (self.absent.iter())
                    .filter(|v| sample_type.is_float() || stored_as(**v) == **v)
                    .map(|v| stored_as(*v))
                    .collect();
                let samples = bytes.chunks_exact(size_of::<$number>()).skip(first).step_by(stride);
                for (height, sample) in out.iter_mut().zip(samples) {
                    let mut raw = [0u8; size_of::<$number>()];
                    raw.copy_from_slice(sample);
                    let stored = f64::from(match order {
                        ByteOrder::Little => <$number>::from_le_bytes(raw),
                        ByteOrder::Big => <$number>::from_be_bytes(raw),
                    });
                    let special = stored.is_nan() || stored.abs() >= SPECIAL_PIXEL_MAGNITUDE;
                    *height = if special || absent.contains(&stored) {
                        f32::NAN
                    } else {
                        self.height(stored)
                    };
                }
            }};
        }
        match sample_type {
            SampleType::U8 => decode_as!(u8),
            SampleType::I8 => decode_as!(i8),
            SampleType::U16 => decode_as!(u16),
            SampleType::I16 => decode_as!(i16),
            SampleType::U32 => decode_as!(u32),
            SampleType::I32 => decode_as!(i32),
            SampleType::F32 => decode_as!(f32),
            SampleType::F64 => decode_as!(f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heights(law: &HeightLaw, bytes: &[u8], sample_type: SampleType, order: ByteOrder) -> Vec<f32> {
        let mut out = vec![0.0; bytes.len() / sample_type.size()];
        law.decode(bytes, sample_type, order, 0, 1, &mut out);
        out
    }

    #[test]
    fn radii_become_heights_in_metres_and_kilometres() {
        let half_metres = HeightLaw::new(0.5, 1_737_400.0, 1.0, 1_737_400.0, &[]);
        let bytes: Vec<u8> = [-3i16, 4001].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(heights(&half_metres, &bytes, SampleType::I16, ByteOrder::Little), [-1.5, 2000.5]);
        let kilometres = HeightLaw::new(1.0, 1737.4, 1000.0, 1_737_400.0, &[]);
        let bytes: Vec<u8> = [-1.25f32, 0.5].iter().flat_map(|v| v.to_be_bytes()).collect();
        assert_eq!(heights(&kilometres, &bytes, SampleType::F32, ByteOrder::Big), [-1250.0, 500.0]);
    }

    #[test]
    fn absent_samples_are_nan() {
        let law = HeightLaw::new(1.0, 0.0, 1.0, 1_737_400.0, &[-3.402_822_655_088_904_5e38, -9999.0]);
        let values = [f32::from_bits(0xFF7F_FFFB), -9999.0, f32::INFINITY, f32::from_bits(0xFF7F_FFFF), 7.0];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let out = heights(&law, &bytes, SampleType::F32, ByteOrder::Little);
        assert!(out[..4].iter().all(|h| h.is_nan()));
        assert_eq!(out[4], 7.0);
    }

    #[test]
    fn a_no_data_number_that_the_type_cannot_hold_marks_nothing() {
        let law = HeightLaw::new(1.0, 0.0, 1.0, 1.0, &[-9999.0, 7.0]);
        let out = heights(&law, &[0, 7, 241], SampleType::U8, ByteOrder::Little);
        assert!(out[0] == 0.0 && out[1].is_nan() && out[2] == 241.0);
    }

    #[test]
    fn one_band_of_several_is_picked() {
        let law = HeightLaw::new(1.0, 0.0, 1.0, 1.0, &[]);
        let mut out = [0.0; 2];
        law.decode(&[1, 2, 3, 4, 5, 6], SampleType::U8, ByteOrder::Little, 2, 3, &mut out);
        assert_eq!(out, [3.0, 6.0]);
    }
}
