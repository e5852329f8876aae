//! LAS 1.4, point format 7 (RGB), with confidence and sigma as extra bytes.
//!
//! Coordinates are whole multiples of a scale about the cloud's origin, so that no f32 or f64 rounding depends on how far
//! away the map's zero is. The format's words for where a point comes from are used: the point source is 1 for view A and 2
//! for view B, a completed point carries the flag "synthetic". The date of creation is left 0: a library has no clock.
//!
//! # Source
//! ASPRS 2019, "LAS Specification 1.4 - R15", tables 3 (header), 16 (point format 7), 24 (extra bytes), and §2.4
//! (coordinate system as well-known text).

use super::{Cloud, CloudPoint};

const HEADER_BYTES: usize = 375;
const VLR_HEADER_BYTES: usize = 54;
/// Format 7 and two extra floats.
const POINT_BYTES: usize = 36 + 8;
/// Bytes of one description of an extra field.
const EXTRA_BYTES: usize = 192;
/// Coordinates are stored as 32-bit integers: the scale leaves them this far from their limit.
const LARGEST_COORDINATE: f64 = 2e9;

/// The file's bytes.
pub fn encode(cloud: &Cloud) -> Vec<u8> {
    let (low, high) = bounds(&cloud.points);
    let scale = scale_for(&low, &high);
    let mut records = vec![(
        "LASF_Spec",
        4u16,
        "confidence and sigma",
        [extra_field("confidence", "in 0..1"), extra_field("sigma", "along the ray; nan: not known")]
            .concat(),
    )];
    if let Some(wkt) = &cloud.wkt {
        let text = [wkt.as_bytes(), b"\0"].concat();
        records.push(("LASF_Projection", 2112, "coordinate system", text));
    }
    let vlr_bytes: usize = records.iter().map(|(.., data)| VLR_HEADER_BYTES + data.len()).sum();
    let offset = HEADER_BYTES + vlr_bytes;
    let mut bytes = Vec::with_capacity(offset + POINT_BYTES * cloud.points.len());
    bytes.extend(header(cloud, records.len() as u32, offset as u32, scale, &low, &high));
    for (user, id, description, data) in &records {
        bytes.extend([0; 2]);
        bytes.extend(fixed::<16>(user));
        bytes.extend(id.to_le_bytes());
        bytes.extend((data.len() as u16).to_le_bytes());
        bytes.extend(fixed::<32>(description));
        bytes.extend(data);
    }
    for point in &cloud.points {
        bytes.extend_from_slice(&record(point, scale));
    }
    bytes
}

/// Extent of the positions, against the origin.
fn bounds(points: &[CloudPoint]) -> ([f64; 3], [f64; 3]) {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point.position[axis]);
            high[axis] = high[axis].max(point.position[axis]);
        }
    }
    (low.map(f64::from), high.map(f64::from))
}

/// A millimetre where the extent allows it, coarser or finer by powers of ten: about a millionth of the extent or less.
fn scale_for(low: &[f64; 3], high: &[f64; 3]) -> f64 {
    let reach = low.iter().chain(high).map(|v| v.abs()).fold(f64::MIN_POSITIVE, f64::max);
    let finest = reach / LARGEST_COORDINATE;
    let wanted = (reach * 1e-7).clamp(finest, f64::INFINITY);
    10f64.powf(wanted.log10().ceil().min(-3.0)).max(10f64.powf(finest.log10().ceil()))
}

fn header(
    cloud: &Cloud,
    num_records: u32,
    offset: u32,
    scale: f64,
    low: &[f64; 3],
    high: &[f64; 3],
) -> Vec<u8> {
    let count = cloud.points.len() as u64;
    let mut bytes = b"LASF".to_vec();
    bytes.extend([0; 2]);
    // Bit 4: the coordinate system is well-known text (point formats from 6 on know no other).
    bytes.extend((1u16 << 4).to_le_bytes());
    bytes.extend([0; 16]);
    bytes.extend([1, 4]);
    bytes.extend(fixed::<32>("stereo"));
    bytes.extend(fixed::<32>("selenograph"));
    bytes.extend([0; 4]);
    bytes.extend((HEADER_BYTES as u16).to_le_bytes());
    bytes.extend(offset.to_le_bytes());
    bytes.extend(num_records.to_le_bytes());
    bytes.push(7);
    bytes.extend((POINT_BYTES as u16).to_le_bytes());
    // Counts of the older versions: 0 for the newer point formats.
    bytes.extend([0; 24]);
    bytes.extend([scale; 3].iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend(cloud.origin.iter().flat_map(|v| v.to_le_bytes()));
    for axis in 0..3 {
        for bound in [high[axis], low[axis]] {
            let stored = (bound / scale).round() * scale + cloud.origin[axis];
            bytes.extend(stored.to_le_bytes());
        }
    }
    // No waveforms, no extended records.
    bytes.extend([0; 8 + 8 + 4]);
    bytes.extend(count.to_le_bytes());
    bytes.extend(count.to_le_bytes());
    bytes.extend([0; 14 * 8]);
    bytes
}

#[inline]
fn record(point: &CloudPoint, scale: f64) -> [u8; POINT_BYTES] {
    let mut bytes = [0; POINT_BYTES];
    for (axis, value) in point.position.iter().enumerate() {
        let whole = (f64::from(*value) / scale).round() as i32;
        bytes[4 * axis..4 * axis + 4].copy_from_slice(&whole.to_le_bytes());
    }
    let widened = point.color.map(|level| u16::from(level) * 257);
    bytes[12..14].copy_from_slice(&widened[1].to_le_bytes());
    // The first of one return; "synthetic" where completed; class 2 is ground.
    bytes[14] = 0x11;
    bytes[15] = u8::from(point.fill == 2);
    bytes[16] = 2;
    bytes[17] = point.view;
    bytes[20..22].copy_from_slice(&(u16::from(point.view) + 1).to_le_bytes());
    for (i, level) in widened.iter().enumerate() {
        bytes[30 + 2 * i..32 + 2 * i].copy_from_slice(&level.to_le_bytes());
    }
    bytes[36..40].copy_from_slice(&point.confidence.to_le_bytes());
    bytes[40..44].copy_from_slice(&point.sigma.to_le_bytes());
    bytes
}

/// Description of an extra f32 field.
fn extra_field(name: &str, description: &str) -> Vec<u8> {
    let mut bytes = vec![0; 2];
    // Type 9: float. No options: no-data, range and scale are not used.
    bytes.extend([9, 0]);
    bytes.extend(fixed::<32>(name));
    bytes.resize(EXTRA_BYTES - 32, 0);
    bytes.extend(fixed::<32>(description));
    bytes
}

/// Text in a field of `N` bytes, cut off or filled up with zeros.
fn fixed<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    let n = text.len().min(N);
    bytes[..n].copy_from_slice(&text.as_bytes()[..n]);
    bytes
}
