//! What a camera has written into its own picture: the focal length and how the picture is meant to be turned (EXIF, in JPEG,
//! TIFF, PNG and WebP).
//!
//! # Source
//! CIPA DC-008 (EXIF 2.32): a focal length "in 35 mm film" has the same angle over the diagonal as on a frame of 36 × 24 mm.

use crate::Error;
use exif::{Field, In, Tag, Value};
use selenograph_geometry::Camera;
use std::path::Path;

/// Diagonal of a frame of 36 × 24 mm, millimetres.
const DIAGONAL_35MM: f64 = 43.266_615_305_567_875;
/// TIFF is read whole for its tags; a longer one has none from a camera.
const LONGEST_TIFF: u64 = 256 << 20;

/// What is told of a picture; numbers as they are stored.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Exif {
    /// Focal length in 35 mm film, millimetres (whole ones).
    pub focal_35mm: Option<f64>,
    /// Focal length, millimetres.
    pub focal_mm: Option<f64>,
    /// Pixels per millimetre across and down on the sensor.
    pub density_per_mm: Option<[f64; 2]>,
    /// Columns and rows of the picture when it was taken.
    pub size: Option<[usize; 2]>,
    /// 1 to 8; 1 is upright.
    pub orientation: u32,
}

/// A focal length and how it follows from what is told.
#[derive(Debug, Clone, PartialEq)]
pub struct ToldFocal {
    /// Across and down, pixels.
    pub focal_px: [f64; 2],
    /// How, in words.
    pub how: String,
}

/// What EXIF tells of a picture; `None` where the file holds none that can be read.
///
/// # Errors
/// [`Error::Io`] if the file cannot be opened.
pub fn read(path: &Path) -> Result<Option<Exif>, Error> {
    let (file, length) = selenograph_files::regular::open(path).map_err(Error::io("read", path))?;
    let mut reader = std::io::BufReader::new(file);
    let is_tiff = |start: &[u8]| start.starts_with(b"II") || start.starts_with(b"MM");
    let start = std::io::BufRead::fill_buf(&mut reader).map_err(Error::io("read", path))?;
    if is_tiff(start) && length > LONGEST_TIFF {
        return Ok(None);
    }
    let Ok(found) = exif::Reader::new().read_from_container(&mut reader) else { return Ok(None) };
    let field = |tag: Tag| found.get_field(tag, In::PRIMARY);
    let positive = |tag: Tag| field(tag).and_then(number).filter(|v| *v > 0.0 && v.is_finite());
    let per_mm = match field(Tag::FocalPlaneResolutionUnit).and_then(number).map(|unit| unit as u32) {
        Some(3) => 0.1,
        Some(4) => 1.0,
        _ => 1.0 / 25.4,
    };
    let pair = |x: Tag, y: Tag| Some([positive(x)?, positive(y)?]);
    Ok(Some(Exif {
        focal_35mm: positive(Tag::FocalLengthIn35mmFilm),
        focal_mm: positive(Tag::FocalLength),
        density_per_mm: pair(Tag::FocalPlaneXResolution, Tag::FocalPlaneYResolution)
            .map(|density| density.map(|per_unit| per_unit * per_mm)),
        size: pair(Tag::PixelXDimension, Tag::PixelYDimension).map(|size| size.map(|side| side as usize)),
        orientation: field(Tag::Orientation).and_then(|field| field.value.get_uint(0)).unwrap_or(1),
    }))
}

fn number(field: &Field) -> Option<f64> {
    match &field.value {
        Value::Rational(values) => values.first().map(exif::Rational::to_f64),
        value => value.get_uint(0).map(f64::from),
    }
}

impl Exif {
    /// The focal length of a picture of that size, as stored; `None` where nothing is told, or the picture is a part of the one
    /// that was taken.
    pub fn focal(&self, width: usize, height: usize) -> Option<ToldFocal> {
        let taken = self.size.unwrap_or([width, height]);
        if !is_whole(taken, [width, height]) {
            return None;
        }
        let diagonal_px = (width as f64).hypot(height as f64);
        if let Some(mm) = self.focal_35mm {
            let focal_px = mm / DIAGONAL_35MM * diagonal_px;
            let how = format!(
                "{mm} mm (35 mm equivalent, over the diagonal), which its rounding leaves open by ±{:.1} %",
                50.0 / mm
            );
            return Some(ToldFocal { focal_px: [focal_px; 2], how });
        }
        let (mm, density) = (self.focal_mm?, self.density_per_mm?);
        let resized = [width as f64 / taken[0] as f64, height as f64 / taken[1] as f64];
        let focal_px = [0, 1].map(|axis| mm * density[axis] * resized[axis]);
        Some(ToldFocal { focal_px, how: format!("{mm} mm and the sensor's {:.2} px/mm", density[0]) })
    }

    /// What must be known of how the picture is turned; nothing for an upright one. Pictures are taken as they are stored, so that
    /// pixels are those of the sensor, of its calibration and of other programs' matches.
    pub fn turned(&self) -> Option<String> {
        let how = match self.orientation {
            3 => "by 180°",
            6 => "by 90° clockwise",
            8 => "by 90° anticlockwise",
            2 | 4 | 5 | 7 => "mirrored",
            _ => return None,
        };
        Some(format!(
            "EXIF (orientation {}) has it shown turned {how}: it is taken as stored, and its camera must be that of the stored pixels",
            self.orientation
        ))
    }

    /// Whether the stored rows show the world in a mirror: no motion of a camera explains such a picture.
    pub fn is_mirrored(&self) -> bool {
        matches!(self.orientation, 2 | 4 | 5 | 7)
    }
}

impl ToldFocal {
    /// The camera of a picture with its principal point in the middle.
    ///
    /// # Errors
    /// [`Error::Geometry`] for a focal length that is none.
    pub fn camera(&self, width: usize, height: usize) -> Result<Camera, Error> {
        let [fx, fy] = self.focal_px;
        // Over the width for the checks, then as it is.
        let fov_rad = 2.0 * (width as f64 / (2.0 * fx)).atan();
        Ok(Camera { fx, fy, ..Camera::from_fov(width, height, fov_rad)? })
    }
}

/// Whether one size is the other one, resized as a whole or turned; sides are rounded.
fn is_whole(taken: [usize; 2], found: [usize; 2]) -> bool {
    let ratio = |[width, height]: [usize; 2]| width as f64 / height as f64;
    (ratio(taken) / ratio(found) - 1.0).abs() < 0.01
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A TIFF of the given 16-bit and rational tags in its EXIF part, and the orientation.
    fn tiff(orientation: u16, shorts: &[(u16, u32)], rationals: &[(u16, [u32; 2])]) -> Vec<u8> {
        let mut bytes = b"II*\0\x08\0\0\0".to_vec();
        let entry = |tag: u16, kind: u16, value: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &1u32.to_le_bytes(), &value.to_le_bytes()].concat()
        };
        bytes.extend(2u16.to_le_bytes());
        bytes.extend(entry(274, 3, orientation.into()));
        bytes.extend(entry(34665, 4, 38));
        bytes.extend(0u32.to_le_bytes());
        let num = shorts.len() + rationals.len();
        bytes.extend((num as u16).to_le_bytes());
        let values_at = 38 + 2 + 12 * num as u32 + 4;
        let mut entries: Vec<(u16, Vec<u8>)> =
            shorts.iter().map(|&(tag, value)| (tag, entry(tag, 4, value))).collect();
        for (k, &(tag, _)) in rationals.iter().enumerate() {
            entries.push((tag, entry(tag, 5, values_at + 8 * k as u32)));
        }
        entries.sort();
        bytes.extend(entries.into_iter().flat_map(|(_, entry)| entry));
        bytes.extend(0u32.to_le_bytes());
        bytes.extend(rationals.iter().flat_map(|(_, value)| value.iter().flat_map(|v| v.to_le_bytes())));
        bytes
    }

    fn read_bytes(bytes: &[u8]) -> Option<Exif> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("picture");
        std::fs::write(&path, bytes).unwrap();
        read(&path).unwrap()
    }

    /// The same tags inside a JPEG.
    fn jpeg(tags: &[u8]) -> Vec<u8> {
        let mut bytes = b"\xff\xd8\xff\xe1".to_vec();
        bytes.extend((tags.len() as u16 + 8).to_be_bytes());
        bytes.extend(b"Exif\0\0");
        bytes.extend(tags);
        bytes.extend(b"\xff\xd9");
        bytes
    }

    #[test]
    fn the_focal_length_of_35_mm_film_is_over_the_diagonal() {
        let tags = tiff(1, &[(41989, 36), (40962, 6000), (40963, 4000)], &[(37386, [24, 1])]);
        for bytes in [tags.clone(), jpeg(&tags)] {
            let exif = read_bytes(&bytes).unwrap();
            // On a frame of 3:2 the diagonal is the width over 36 mm.
            let told = exif.focal(3000, 2000).unwrap();
            assert!((told.focal_px[0] - 3000.0).abs() < 1e-9 && told.how.contains("36 mm"), "{told:?}");
            assert!((told.camera(3000, 2000).unwrap().cy - 1000.0).abs() < 1e-12);
            // A crop has another field of view.
            assert_eq!(exif.focal(2000, 2000), None);
            assert_eq!(exif.turned(), None);
        }
        let square = Exif { size: None, ..read_bytes(&tags).unwrap() }.focal(1000, 1000).unwrap();
        assert!((square.focal_px[0] - 36.0 * 1_414.213_562 / 43.266_615).abs() < 1e-3);
    }

    #[test]
    fn without_it_the_sensor_tells() {
        // 24 mm, 3000 px per inch of 25.4 mm, halved.
        let density = [(37386, [24, 1]), (41486, [3000, 1]), (41487, [3000, 1])];
        let exif = read_bytes(&tiff(6, &[(40962, 2000), (40963, 1000), (41488, 2)], &density)).unwrap();
        let told = exif.focal(1000, 500).unwrap();
        assert!((told.focal_px[0] - 24.0 * 3000.0 / 25.4 / 2.0).abs() < 1e-9, "{told:?}");
        assert!(exif.turned().unwrap().contains("90° clockwise") && !exif.is_mirrored());
        assert!(Exif { orientation: 2, ..exif }.is_mirrored());
        let silent = tiff(1, &[(41989, 0)], &[(37386, [24, 1])]);
        assert_eq!(read_bytes(&silent).unwrap().focal(10, 10), None);
        let nothing = tiff(1, &[], &[(37386, [24, 0])]);
        assert_eq!(read_bytes(&nothing).unwrap().focal_mm, None);
    }

    #[test]
    fn a_picture_without_it_has_none() {
        for bytes in
            [&b"\x89PNG\r\n\x1a\n"[..], b"P5\n1 1\n255\n\0", b"", b"\xff\xd8\xff\xe1\0\x10Exif\0\0II*\0\xff"]
        {
            assert_eq!(read_bytes(bytes), None);
        }
    }
}
