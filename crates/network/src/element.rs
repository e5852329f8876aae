//! The numbers of a stored tensor: their types, and how they become f32.

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
            Self::F16 => each(bytes, out, |b| f16_to_f32(u16::from_le_bytes(b))),
            Self::Bf16 => each(bytes, out, |b| f32::from_bits(u32::from(u16::from_le_bytes(b)) << 16)),
            Self::F64 => each(bytes, out, |b| f64::from_le_bytes(b) as f32),
            Self::I8 => each(bytes, out, |b: [u8; 1]| f32::from(i8::from_le_bytes(b))),
            Self::I16 => each(bytes, out, |b| f32::from(i16::from_le_bytes(b))),
            Self::I32 => each(bytes, out, |b| i32::from_le_bytes(b) as f32),
            Self::I64 => each(bytes, out, |b| i64::from_le_bytes(b) as f32),
            Self::U8 => each(bytes, out, |b: [u8; 1]| f32::from(b[0])),
            Self::Bool => each(bytes, out, |b: [u8; 1]| f32::from(u8::from(b[0] != 0))),
        }
    }

    /// Appends `values` in this type; `None` if it is not one that weights are written in.
    pub(crate) fn encode(self, values: &[f32], out: &mut Vec<u8>) -> Option<()> {
        match self {
            Self::F32 => out.extend(values.iter().flat_map(|value| value.to_le_bytes())),
            Self::Bf16 => out.extend(values.iter().flat_map(|value| f32_to_bf16(*value).to_le_bytes())),
            _ => return None,
        }
        Some(())
    }
}

fn each<const N: usize>(bytes: &[u8], out: &mut [f32], convert: impl Fn([u8; N]) -> f32) {
    let (chunks, _) = bytes.as_chunks::<N>();
    for (value, chunk) in out.iter_mut().zip(chunks) {
        *value = convert(*chunk);
    }
}

/// Every binary16 is a binary32, so nothing is rounded.
fn f16_to_f32(bits: u16) -> f32 {
    let sign = u32::from(bits & 0x8000) << 16;
    let exponent = u32::from(bits >> 10 & 0x1f);
    let fraction = u32::from(bits & 0x3ff);
    let magnitude = match exponent {
        // Subnormal: a fraction of 2⁻²⁴, exact as an f32.
        0 => return f32::from_bits((fraction as f32 * (1.0 / 16_777_216.0)).to_bits() | sign),
        31 => 0x7f80_0000 | fraction << 13,
        _ => (exponent + 112) << 23 | fraction << 13,
    };
    f32::from_bits(sign | magnitude)
}

/// Rounds to the nearest, ties to even; NaN stays NaN.
fn f32_to_bf16(value: f32) -> u16 {
    let bits = value.to_bits();
    if value.is_nan() {
        return (bits >> 16) as u16 | 0x40;
    }
    ((bits + 0x7fff + (bits >> 16 & 1)) >> 16) as u16
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
            (f32::MAX, f32::INFINITY),
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
    fn integers_and_doubles_become_floats() {
        assert_eq!(decoded(ElementType::I64, &(-7i64).to_le_bytes()), [-7.0]);
        assert_eq!(decoded(ElementType::F64, &0.1f64.to_le_bytes()), [0.1]);
        assert_eq!(decoded(ElementType::Bool, &[0, 1, 2]), [0.0, 1.0, 1.0]);
        assert_eq!(decoded(ElementType::I8, &[0xff]), [-1.0]);
    }
}
