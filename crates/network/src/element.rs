//! The numbers of a stored tensor: their types, and how they become f32.

use half::{bf16, f16};
use serde::Serialize;

/// Type of a stored tensor's elements; always little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ElementType {
    /// IEEE 754 binary16.
    F16,
    /// The upper half of an f32.
    Bf16,
    /// IEEE 754 binary32.
    F32,
    /// IEEE 754 binary64.
    F64,
    /// Signed, 8 bits.
    I8,
    /// Signed, 16 bits.
    I16,
    /// Signed, 32 bits.
    I32,
    /// Signed, 64 bits.
    I64,
    /// Unsigned, 8 bits.
    U8,
    /// One byte, 0 or 1.
    Bool,
}

impl ElementType {
    /// Bytes of an element.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 | Self::Bool => 1,
            Self::F16 | Self::Bf16 | Self::I16 => 2,
            Self::F32 | Self::I32 => 4,
            Self::F64 | Self::I64 => 8,
        }
    }

    /// Short name, as in `f32`.
    pub fn name(self) -> &'static str {
        match self {
            Self::F16 => "f16",
            Self::Bf16 => "bf16",
            Self::F32 => "f32",
            Self::F64 => "f64",
            Self::I8 => "i8",
            Self::I16 => "i16",
            Self::I32 => "i32",
            Self::I64 => "i64",
            Self::U8 => "u8",
            Self::Bool => "bool",
        }
    }

    /// Whether it is a floating point type.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F16 | Self::Bf16 | Self::F32 | Self::F64)
    }

    /// Converts `out.len()` elements; `bytes` holds at least as many.
    pub(crate) fn decode(self, bytes: &[u8], out: &mut [f32]) {
        match self {
            Self::F32 => each(bytes, out, f32::from_le_bytes),
            Self::F16 => each(bytes, out, |b| f16::from_le_bytes(b).to_f32()),
            Self::Bf16 => each(bytes, out, |b| bf16::from_le_bytes(b).to_f32()),
            Self::F64 => each(bytes, out, |b| f64::from_le_bytes(b) as f32),
            Self::I8 => each(bytes, out, |b: [u8; 1]| f32::from(i8::from_le_bytes(b))),
            Self::I16 => each(bytes, out, |b| f32::from(i16::from_le_bytes(b))),
            Self::I32 => each(bytes, out, |b| i32::from_le_bytes(b) as f32),
            Self::I64 => each(bytes, out, |b| i64::from_le_bytes(b) as f32),
            Self::U8 => each(bytes, out, |b: [u8; 1]| f32::from(b[0])),
            Self::Bool => each(bytes, out, |b: [u8; 1]| f32::from(u8::from(b[0] != 0))),
        }
    }

    /// Whether weights are written in it.
    pub(crate) fn is_written(self) -> bool {
        matches!(self, Self::F32 | Self::Bf16 | Self::F16)
    }

    /// Appends `values` in this type, rounded to the nearest, ties to even.
    ///
    /// # Errors
    /// The first value that is finite and would not be so in this type; any value for a type that is not written.
    pub(crate) fn encode(self, values: &[f32], out: &mut Vec<u8>) -> Result<(), f32> {
        let whole =
            |value: f32, is_finite: bool| if is_finite || !value.is_finite() { Ok(()) } else { Err(value) };
        for &value in values {
            match self {
                Self::F32 => out.extend(value.to_le_bytes()),
                Self::Bf16 => {
                    let stored = bf16::from_f32(value);
                    whole(value, stored.is_finite())?;
                    out.extend(stored.to_le_bytes());
                }
                Self::F16 => {
                    let stored = f16::from_f32(value);
                    whole(value, stored.is_finite())?;
                    out.extend(stored.to_le_bytes());
                }
                _ => return Err(value),
            }
        }
        Ok(())
    }
}

fn each<const N: usize>(bytes: &[u8], out: &mut [f32], convert: impl Fn([u8; N]) -> f32) {
    let (chunks, _) = bytes.as_chunks::<N>();
    for (value, chunk) in out.iter_mut().zip(chunks) {
        *value = convert(*chunk);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(kind: ElementType, bytes: &[u8]) -> Vec<f32> {
        let mut out = vec![0.0; bytes.len() / kind.size()];
        kind.decode(bytes, &mut out);
        out
    }

    #[test]
    fn halves_are_exact() {
        let cases: [(u16, f32); 8] = [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 5.960_464_5e-8),
            (0x8000, -0.0),
            (0x0400, 6.103_515_6e-5),
            (0x7c00, f32::INFINITY),
            (0x3555, 0.333_251_95),
        ];
        for (bits, expected) in cases {
            let found = decoded(ElementType::F16, &bits.to_le_bytes())[0];
            assert_eq!(found.to_bits(), expected.to_bits(), "{bits:#06x}");
        }
        assert!(decoded(ElementType::F16, &0x7e00u16.to_le_bytes())[0].is_nan());
    }

    #[test]
    fn brain_floats_round_to_even_and_come_back() {
        let cases = [
            (1.0f32, 1.0f32),
            (1.0 + 1.0 / 256.0, 1.0),
            (1.0 + 3.0 / 256.0, 1.0 + 4.0 / 256.0),
            (-3.5, -3.5),
            (f32::INFINITY, f32::INFINITY),
        ];
        for (value, expected) in cases {
            let mut bytes = Vec::new();
            ElementType::Bf16.encode(&[value], &mut bytes).unwrap();
            assert_eq!(decoded(ElementType::Bf16, &bytes), [expected]);
        }
        let mut bytes = Vec::new();
        ElementType::Bf16.encode(&[f32::NAN], &mut bytes).unwrap();
        assert!(decoded(ElementType::Bf16, &bytes)[0].is_nan());
    }

    #[test]
    fn halves_round_to_even_and_nothing_overflows_in_silence() {
        let cases = [(1.0f32, 1.0f32), (1.0 + 1.0 / 2048.0, 1.0), (1.0 + 3.0 / 2048.0, 1.0 + 4.0 / 2048.0)];
        for (value, expected) in cases {
            let mut bytes = Vec::new();
            ElementType::F16.encode(&[value], &mut bytes).unwrap();
            assert_eq!(decoded(ElementType::F16, &bytes), [expected]);
        }
        assert_eq!(ElementType::F16.encode(&[1.0, 65_520.0], &mut Vec::new()), Err(65_520.0));
        assert_eq!(ElementType::Bf16.encode(&[f32::MAX], &mut Vec::new()), Err(f32::MAX));
        assert_eq!(ElementType::F16.encode(&[f32::NEG_INFINITY], &mut Vec::new()), Ok(()));
    }

    #[test]
    fn integers_and_doubles_become_floats() {
        assert_eq!(decoded(ElementType::I64, &(-7i64).to_le_bytes()), [-7.0]);
        assert_eq!(decoded(ElementType::F64, &0.1f64.to_le_bytes()), [0.1]);
        assert_eq!(decoded(ElementType::Bool, &[0, 1, 2]), [0.0, 1.0, 1.0]);
        assert_eq!(decoded(ElementType::I8, &[0xff]), [-1.0]);
    }
}
