//! One strip or tile: decompression and the predictors.

use crate::sample::ByteOrder;
use serde::Serialize;
use std::io::Read;

/// How strips and tiles are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    /// Not at all.
    None,
    /// LZW, most significant bit first.
    Lzw,
    /// LZW of before 1993: least significant bit first, codes longer one step later.
    OldLzw,
    /// zlib streams (codes 8 and 32946).
    Deflate,
    /// Run lengths (code 32773).
    PackBits,
}

/// What was done to the samples of a row before compression.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Predictor {
    /// Nothing.
    None,
    /// Differences of whole samples.
    Horizontal,
    /// Differences of the bytes of floats, most significant bytes first (Adobe's technical note 3).
    FloatingPoint,
}

/// The bytes of a chunk: exactly `size` of them, or what went wrong.
pub(crate) fn decompress(compression: Compression, packed: Vec<u8>, size: usize) -> Result<Vec<u8>, String> {
    match compression {
        Compression::None => {
            let mut bytes = packed;
            if bytes.len() < size {
                return Err(short(bytes.len(), size));
            }
            bytes.truncate(size);
            Ok(bytes)
        }
        Compression::Deflate => inflate(&packed, size),
        Compression::Lzw => {
            unpack_lzw(weezl::decode::Decoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8), &packed, size)
        }
        Compression::OldLzw => {
            unpack_lzw(weezl::decode::Decoder::new(weezl::BitOrder::Lsb, 8), &packed, size)
        }
        Compression::PackBits => unpack_bits(&packed, size).map_err(|found| short(found, size)),
    }
}

fn inflate(packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let mut bytes = vec![0; size];
    let mut decoder = flate2::read::ZlibDecoder::new(packed);
    decoder.read_exact(&mut bytes).map_err(|e| format!("deflate stream: {e}"))?;
    // The checksum stands behind the last byte, and is looked at only by who reads on.
    std::io::copy(&mut decoder.take(1), &mut std::io::sink()).map_err(|e| format!("deflate stream: {e}"))?;
    Ok(bytes)
}

fn unpack_lzw(mut decoder: weezl::decode::Decoder, packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let mut bytes = vec![0; size];
    let (mut read, mut written) = (0, 0);
    while written < size {
        let step = decoder.decode_bytes(&packed[read..], &mut bytes[written..]);
        read += step.consumed_in;
        written += step.consumed_out;
        let status = step.status.map_err(|e| format!("LZW stream: {e}"))?;
        if !matches!(status, weezl::LzwStatus::Ok) || (step.consumed_in == 0 && step.consumed_out == 0) {
            break;
        }
    }
    if written < size { Err(short(written, size)) } else { Ok(bytes) }
}

fn short(found: usize, size: usize) -> String {
    format!("{found} bytes after decompression, {size} expected")
}

/// Apple's run-length code; the number of bytes there were if they are too few.
fn unpack_bits(packed: &[u8], size: usize) -> Result<Vec<u8>, usize> {
    let mut bytes = Vec::with_capacity(size);
    let mut rest = packed;
    while bytes.len() < size {
        let Some((&head, tail)) = rest.split_first() else { return Err(bytes.len()) };
        rest = tail;
        match head {
            0..=127 => {
                let count = usize::from(head) + 1;
                let Some((run, tail)) = rest.split_at_checked(count) else { return Err(bytes.len()) };
                bytes.extend_from_slice(run);
                rest = tail;
            }
            128 => {}
            129..=255 => {
                let Some((&value, tail)) = rest.split_first() else { return Err(bytes.len()) };
                bytes.resize(bytes.len() + 257 - usize::from(head), value);
                rest = tail;
            }
        }
    }
    bytes.truncate(size);
    Ok(bytes)
}

/// Undoes a predictor in place, row by row of `row_bytes`, for interleaved samples of `size` bytes; returns the byte
/// order the samples have afterwards.
pub(crate) fn undo_predictor(
    predictor: Predictor,
    bytes: &mut [u8],
    row_bytes: usize,
    num_interleaved: usize,
    size: usize,
    order: ByteOrder,
) -> ByteOrder {
    match predictor {
        Predictor::None => order,
        Predictor::Horizontal => {
            for row in bytes.chunks_exact_mut(row_bytes) {
                sum_samples(row, num_interleaved, size, order);
            }
            order
        }
        Predictor::FloatingPoint => {
            let mut planes = vec![0; row_bytes];
            let num_samples = row_bytes / size;
            for row in bytes.chunks_exact_mut(row_bytes) {
                for i in num_interleaved..row_bytes {
                    row[i] = row[i].wrapping_add(row[i - num_interleaved]);
                }
                planes.copy_from_slice(row);
                for (i, sample) in row.chunks_exact_mut(size).enumerate() {
                    for (b, byte) in sample.iter_mut().enumerate() {
                        *byte = planes[b * num_samples + i];
                    }
                }
            }
            ByteOrder::Big
        }
    }
}

fn sum_samples(row: &mut [u8], num_interleaved: usize, size: usize, order: ByteOrder) {
    macro_rules! sum_as {
        ($number:ty) => {{
            let step = num_interleaved * size;
            for at in (step..row.len()).step_by(size) {
                let mut raw = [[0u8; size_of::<$number>()]; 2];
                raw[0].copy_from_slice(&row[at - step..at - step + size]);
                raw[1].copy_from_slice(&row[at..at + size]);
                let sum = match order {
                    ByteOrder::Little => <$number>::from_le_bytes(raw[0])
                        .wrapping_add(<$number>::from_le_bytes(raw[1]))
                        .to_le_bytes(),
                    ByteOrder::Big => <$number>::from_be_bytes(raw[0])
                        .wrapping_add(<$number>::from_be_bytes(raw[1]))
                        .to_be_bytes(),
                };
                row[at..at + size].copy_from_slice(&sum);
            }
        }};
    }
    match size {
        1 => sum_as!(u8),
        2 => sum_as!(u16),
        4 => sum_as!(u32),
        _ => sum_as!(u64),
    }
}

/// The floating-point predictor's forward form for one row of interleaved f32, most significant bytes first.
pub(crate) fn apply_float_predictor(row: &[f32], num_interleaved: usize, out: &mut Vec<u8>) {
    let start = out.len();
    let n = row.len();
    out.resize(start + 4 * n, 0);
    let bytes = &mut out[start..];
    for (i, value) in row.iter().enumerate() {
        for (b, byte) in value.to_be_bytes().into_iter().enumerate() {
            bytes[b * n + i] = byte;
        }
    }
    for i in (num_interleaved..bytes.len()).rev() {
        bytes[i] = bytes[i].wrapping_sub(bytes[i - num_interleaved]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn runs_are_unpacked() {
        // The example of Apple's technical note 1023.
        let packed =
            [0xFE, 0xAA, 0x02, 0x80, 0x00, 0x2A, 0xFD, 0xAA, 0x03, 0x80, 0x00, 0x2A, 0x22, 0xF7, 0xAA];
        let bytes = unpack_bits(&packed, 24).unwrap();
        assert_eq!(bytes[..6], [0xAA, 0xAA, 0xAA, 0x80, 0x00, 0x2A]);
        assert_eq!(bytes[14..], [0xAA; 10]);
        assert_eq!(unpack_bits(&packed, 25), Err(24));
    }

    #[test]
    fn lzw_of_both_bit_orders() {
        let bytes: Vec<u8> = (0..9000u32).map(|i| (i * i / 977) as u8).collect();
        let new =
            weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8).encode(&bytes).unwrap();
        assert_eq!(decompress(Compression::Lzw, new, bytes.len()).unwrap(), bytes);
        let old = weezl::encode::Encoder::new(weezl::BitOrder::Lsb, 8).encode(&bytes).unwrap();
        assert!(old[0] == 0 && old[1] & 1 == 1, "what tells old streams");
        assert_eq!(decompress(Compression::OldLzw, old, bytes.len()).unwrap(), bytes);
    }

    #[test]
    fn a_wrong_checksum_is_an_error() {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        std::io::Write::write_all(&mut encoder, &[7; 500]).unwrap();
        let packed = encoder.finish().unwrap();
        assert!(decompress(Compression::Deflate, packed.clone(), 500).is_ok());
        let last = packed.len() - 1;
        assert!(decompress(Compression::Deflate, packed[..last].to_vec(), 500).is_err());
        let changed = [&packed[..last], &[packed[last] ^ 1]].concat();
        assert!(decompress(Compression::Deflate, changed, 500).is_err());
    }

    proptest! {
        #[test]
        fn float_predictor_round_trips(
            pixels in prop::collection::vec(any::<[f32; 3]>(), 1..20),
            num_interleaved in prop::sample::select(vec![1usize, 3]),
        ) {
            let row = pixels.as_flattened();
            let mut bytes = Vec::new();
            apply_float_predictor(row, num_interleaved, &mut bytes);
            let n = bytes.len();
            undo_predictor(Predictor::FloatingPoint, &mut bytes, n, num_interleaved, 4, ByteOrder::Little);
            let back: Vec<u32> = bytes.chunks(4).map(|b| u32::from_be_bytes(b.try_into().unwrap())).collect();
            prop_assert_eq!(back, row.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
        }

        #[test]
        fn arbitrary_bytes_never_panic(packed in prop::collection::vec(any::<u8>(), 0..200), size in 0usize..300) {
            for compression in [Compression::None, Compression::Lzw, Compression::OldLzw, Compression::Deflate, Compression::PackBits] {
                if let Ok(bytes) = decompress(compression, packed.clone(), size) {
                    prop_assert_eq!(bytes.len(), size);
                }
            }
        }
    }
}
