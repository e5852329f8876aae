//! Files as they come from other people's programs: what is read right, and what is refused with the true reason.
// Helpers of a test are tests too: a failure there is a panic with its place.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use selenograph_raster::Error;
use selenograph_raster::codec::picture::{GreyUnit, PictureFile, read_picture};
use selenograph_raster::dem::{DemReader, OpenOptions};
use std::path::{Path, PathBuf};
use support::{OLD_LZW, SOUTH_KEYS, TinyTiff, Values, geo_keys, transform};
use tempfile::TempDir;

const R: f64 = 1_737_400.0;

fn folder() -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    (dir, path)
}

/// Heights, and the notes after all rows have been read.
fn read(path: &Path) -> Result<(Vec<f32>, Vec<String>), Error> {
    let mut dem = DemReader::open(path, &OpenOptions::default())?;
    let heights = dem.read_all()?.data;
    Ok((heights, dem.info().notes.clone()))
}

fn heights(path: &Path) -> Vec<f32> {
    read(path).unwrap_or_else(|e| panic!("{e}")).0
}

fn noted(path: &Path, words: &str) -> bool {
    read(path).unwrap().1.iter().any(|note| note.contains(words))
}

/// `NaN == NaN` here.
fn same(found: &[f32], expected: &[f32]) -> bool {
    found.len() == expected.len()
        && found.iter().zip(expected).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

/// A map of 2×2 heights.
fn map(heights: [f64; 4]) -> TinyTiff {
    TinyTiff::new("f32", 2, 2, |_, x, y| heights[2 * y + x])
}

fn with_keys(mut tiff: TinyTiff, keys: &[(u16, f64)]) -> TinyTiff {
    tiff.tags = geo_keys(keys);
    tiff.tags.extend(transform(1000.0, 2000.0, 5.0));
    tiff
}

const NAN: f32 = f32::NAN;

// TIFF: which pixels are there ------------------------------------------------------------------------------------------

/// A band that says where the first one is absent.
fn with_alpha(mut tiff: TinyTiff, planar: bool) -> TinyTiff {
    let (rows, columns) = (tiff.samples[0].len(), tiff.samples[0][0].len());
    tiff.samples.push(
        (0..rows)
            .map(|y| (0..columns).map(|x| if (x, y) == (0, 1) { 0.0 } else { 200.0 }).collect())
            .collect(),
    );
    tiff.tags.push((338, Values::Shorts(vec![2])));
    tiff.planar = planar;
    tiff
}

#[test]
fn transparent_samples_are_absent() {
    let (_dir, path) = folder();
    for planar in [false, true] {
        with_alpha(map([1.0, 2.0, 3.0, 4.0]), planar).write(&path);
        assert!(same(&heights(&path), &[1.0, 2.0, NAN, 4.0]));
        assert!(noted(&path, "alpha"));
        let mut grey = TinyTiff::new("u8", 2, 2, |_, x, y| [[10.0, 20.0], [30.0, 40.0]][y][x]);
        grey.tags.clear();
        with_alpha(grey, planar).write(&path);
        let found = read_picture(&path).unwrap();
        assert!(same(&found.grey.data, &[10.0 / 255.0, 20.0 / 255.0, NAN, 40.0 / 255.0]));
        assert!(
            found.notes.iter().any(|note| note.contains("1 pixels are absent by alpha")),
            "{:?}",
            found.notes
        );
    }
    // A second band of another meaning hides nothing.
    let mut other = with_alpha(map([1.0, 2.0, 3.0, 4.0]), false);
    other.tags.retain(|tag| tag.0 != 338);
    other.write(&path);
    assert!(same(&heights(&path), &[1.0, 2.0, 3.0, 4.0]));
}

/// A TIFF with a mask of one bit a pixel behind its image; rows of 10 pixels take two bytes.
fn with_inner_mask(image: &TinyTiff, rows: &[[u8; 2]], fill_order: u16) -> Vec<u8> {
    let mut bytes = image.encode();
    let data_at = bytes.len() as u32;
    let mask = rows.as_flattened().iter().map(|b| if fill_order == 2 { b.reverse_bits() } else { *b });
    bytes.extend(mask);
    let directory_at = (bytes.len() as u32).to_le_bytes();
    // The image's directory ends with the place of the next one, in front of the mask.
    let next = data_at as usize - 4;
    bytes[next..next + 4].copy_from_slice(&directory_at);
    let tags: [(u16, u32); 11] = [
        (254, 4),
        (256, 10),
        (257, rows.len() as u32),
        (258, 1),
        (259, 1),
        (262, 4),
        (266, fill_order.into()),
        (273, data_at),
        (277, 1),
        (278, rows.len() as u32),
        (279, 2 * rows.len() as u32),
    ];
    bytes.extend((tags.len() as u16).to_le_bytes());
    for (tag, value) in tags {
        bytes.extend([&tag.to_le_bytes()[..], &[4, 0, 1, 0, 0, 0], &value.to_le_bytes()].concat());
    }
    bytes.extend([0; 4]);
    bytes
}

#[test]
fn masks_in_the_file_and_beside_it() {
    let (dir, path) = folder();
    let image = TinyTiff::new("f32", 10, 2, |_, x, y| (1 + x + 10 * y) as f64);
    let mut expected: Vec<f32> = (1..=20).map(|v| v as f32).collect();
    (expected[0], expected[9], expected[12]) = (NAN, NAN, NAN);
    let mask = [[0b0111_1111, 0b1000_0000], [0b1101_1111, 0b1100_0000]];
    for fill_order in [1, 2] {
        std::fs::write(&path, with_inner_mask(&image, &mask, fill_order)).unwrap();
        assert!(same(&heights(&path), &expected), "{:?}", heights(&path));
        assert!(noted(&path, "a mask in the file"));
        let found = read_picture(&path).unwrap();
        assert!(same(&found.grey.data, &expected));
    }
    image.write(&path);
    let beside = dir.path().join("a.tif.msk");
    let mut bytes =
        TinyTiff::new("u8", 10, 2, |_, x, y| f64::from(u8::from(!expected[x + 10 * y].is_nan())) * 255.0);
    bytes.tags.clear();
    bytes.write(&beside);
    assert!(same(&heights(&path), &expected) && noted(&path, "a mask beside the file"));
    bytes.samples[0].pop();
    bytes.write(&beside);
    assert!(matches!(read(&path), Err(Error::Malformed { .. })));
}

#[test]
fn what_stands_in_gdals_file_beside() {
    let (dir, path) = folder();
    let beside = dir.path().join("a.tif.aux.xml");
    map([1.0, 2.0, -32_768.0, 4.0]).write(&path);
    let band = |inner: &str| {
        std::fs::write(
            &beside,
            format!("<PAMDataset><PAMRasterBand band=\"1\">{inner}</PAMRasterBand></PAMDataset>"),
        )
        .unwrap();
    };
    band("<NoDataValue>-3.27680000000000E+04</NoDataValue>");
    assert!(same(&heights(&path), &[1.0, 2.0, NAN, 4.0]) && noted(&path, "a.tif.aux.xml"));
    assert!(read_picture(&path).unwrap().grey.data[2].is_nan());
    band("<NoDataValue>4</NoDataValue><UnitType>km</UnitType><Scale>0.5</Scale><Offset>1</Offset>");
    let found = heights(&path);
    assert!(found[0] == 1500.0 && found[1] == 2000.0 && found[3].is_nan());
    std::fs::write(&beside, "not XML").unwrap();
    assert!(matches!(read(&path), Err(Error::Malformed { .. })));
    // A transform that could not be written into the file.
    let mut bare = map([1.0, 2.0, 3.0, 4.0]);
    bare.tags = geo_keys(SOUTH_KEYS);
    bare.write(&path);
    std::fs::write(&beside, "<PAMDataset><GeoTransform>10, 5, 0, 20, 0, -5</GeoTransform></PAMDataset>")
        .unwrap();
    let dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(dem.info().map_from_pixel.coefficients, [10.0, 5.0, 0.0, 20.0, 0.0, -5.0]);
}

#[test]
fn no_data_texts_of_other_writers() {
    let (_dir, path) = folder();
    for (text, expected) in
        [("-1.#IND", 9.0), ("none", 9.0), ("nan(0x7ff8000000000000)", 9.0), ("9", NAN), ("9,0", NAN)]
    {
        let mut tiff = map([9.0, 2.0, 3.0, 4.0]);
        tiff.tags.push((42113, Values::Text(text.into())));
        tiff.write(&path);
        assert!(same(&heights(&path), &[expected, 2.0, 3.0, 4.0]), "{text}");
    }
    let mut tiff = map([9.0, 2.0, 3.0, 4.0]);
    tiff.tags.push((42113, Values::Text("water".into())));
    tiff.write(&path);
    let error = read(&path).unwrap_err();
    assert!(
        matches!(error, Error::Unsupported { what: "no-data text", .. })
            && error.hint().unwrap().contains("--nodata")
    );
    let given = OpenOptions { nodata: Some(2.0), ..OpenOptions::default() };
    assert!(DemReader::open(&path, &given).unwrap().read_all().unwrap().data[1].is_nan());
}

#[test]
fn no_data_that_the_file_does_not_tell_is_noted() {
    let (_dir, path) = folder();
    for (stored, told) in [(-3.4e38, "-3.4e38"), (-32_767.0, "-32767"), (-9999.0, "-9999"), (1e20, "1e20")] {
        map([10.0, 20.0, stored, 30.0]).write(&path);
        assert!(noted(&path, told) && noted(&path, "--nodata"), "{:?}", read(&path).unwrap().1);
    }
    map([10.0, 20.0, -1234.0, 30.0]).write(&path);
    assert!(read(&path).unwrap().1.is_empty());
    map([10.0, 20.0, 1e20, 30.0]).write(&path);
    let dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
    assert!(matches!(dem.refuse_impossible(&heights(&path)), Err(Error::ImpossibleHeight { .. })));
}

// TIFF: numbers ---------------------------------------------------------------------------------------------------------

#[test]
fn units_of_heights_and_angles() {
    let (_dir, path) = folder();
    let kilometres = [SOUTH_KEYS, &[(4099, 9036.0)]].concat();
    with_keys(map([1.0, 2.0, 3.0, 4.0]), &kilometres).write(&path);
    assert_eq!(heights(&path), [1000.0, 2000.0, 3000.0, 4000.0]);
    for (unit, name) in [(9002.0, "foot"), (9999.0, "EPSG:9999")] {
        with_keys(map([1.0; 4]), &[SOUTH_KEYS, &[(4099, unit)]].concat()).write(&path);
        let error = read(&path).unwrap_err();
        assert!(
            error.to_string().contains(name) && error.hint().unwrap().contains("--height-unit"),
            "{error}"
        );
    }
    let geographic = |unit: f64, more: &[(u16, f64)]| {
        let keys = [&[(1024, 2.0), (2054, unit), (2057, R)], more].concat();
        let mut tiff = map([1.0; 4]);
        tiff.tags = geo_keys(&keys);
        tiff.tags.extend(transform(3.0, 27.0, 0.5));
        tiff
    };
    for (unit, factor) in
        [(9102.0, 1.0), (9122.0, 1.0), (9103.0, 1.0 / 60.0), (9101.0, 180.0 / std::f64::consts::PI)]
    {
        geographic(unit, &[]).write(&path);
        let dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
        let [x, y] = dem.info().map_from_pixel.apply(0.0, 0.0);
        assert!((x - 3.0 * factor).abs() < 1e-9 && (y - 27.0 * factor).abs() < 1e-9, "{unit}: {x} {y}");
    }
    geographic(9110.0, &[]).write(&path);
    assert!(matches!(read(&path), Err(Error::Unsupported { what: "angular unit", .. })));
    // 12° east of Greenwich is this file's zero.
    geographic(9102.0, &[(2061, 12.0)]).write(&path);
    let dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(dem.info().map_from_pixel.apply(0.0, 0.0), [15.0, 27.0]);
}

#[test]
fn another_meridian_turns_a_polar_map() {
    let (_dir, path) = folder();
    let centre = |keys: &[(u16, f64)]| {
        with_keys(map([1.0; 4]), keys).write(&path);
        let dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
        let [x, y] = dem.info().map_from_pixel.apply(1.0, 1.0);
        dem.info().crs.projection.place_from_map(x, y).unwrap().lon_rad.to_degrees()
    };
    let turned = centre(&[SOUTH_KEYS, &[(2061, 30.0)]].concat()) - centre(SOUTH_KEYS);
    assert!((turned - 30.0).abs() < 1e-9, "{turned}");
}

#[test]
fn radii_become_heights_and_that_is_said() {
    let (_dir, path) = folder();
    map([R, R + 100.0, R - 100.0, R + 50.0]).write(&path);
    assert_eq!(heights(&path), [0.0, 100.0, -100.0, 50.0]);
    assert!(noted(&path, "radii"));
    let options = OpenOptions { nodata: Some(R), ..OpenOptions::default() };
    let found = DemReader::open(&path, &options).unwrap().read_all().unwrap().data;
    assert!(same(&found, &[NAN, 100.0, -100.0, 50.0]));
}

#[test]
fn integers_of_32_bits_keep_their_levels() {
    let (_dir, path) = folder();
    for (stored, white) in [
        ([0.0, 1.0, 2000.0, 4000.0], 4095.0),
        ([0.0, 70_000.0, 2e6, 4e9], 4_294_967_295.0),
        ([1.0, 2.0, 3.0, 255.0], 255.0),
    ] {
        let mut tiff = TinyTiff::new("u32", 2, 2, |_, x, y| stored[2 * y + x]);
        tiff.tags.clear();
        tiff.write(&path);
        let found = read_picture(&path).unwrap();
        assert_eq!(found.unit, GreyUnit::White(white));
        let levels: Vec<f32> = stored.iter().map(|v| (v / white) as f32).collect();
        assert_eq!(found.grey.data, levels);
        assert!(found.notes.iter().any(|note| note.contains("32-bit")));
    }
}

// TIFF: layouts ---------------------------------------------------------------------------------------------------------

#[test]
fn bits_the_other_way_round() {
    let (_dir, path) = folder();
    for compression in [1, 5, 8, 32773] {
        let mut tiff = TinyTiff::new("u16", 9, 7, |_, x, y| (300 * x + y) as f64);
        (tiff.compression, tiff.chunk) = (compression, (0, 9));
        tiff.tags.push((266, Values::Shorts(vec![2])));
        let mut bytes = tiff.encode();
        // One strip stands between the header and the first table, that of the georeference.
        let first_table = bytes.windows(8).position(|w| w == 5f64.to_le_bytes()).unwrap();
        bytes[8..first_table].iter_mut().for_each(|byte| *byte = byte.reverse_bits());
        std::fs::write(&path, bytes).unwrap();
        let expected: Vec<f32> = (0..63).map(|i| (300 * (i % 9) + i / 9) as f32).collect();
        assert_eq!(heights(&path), expected, "{compression}");
    }
}

#[test]
fn lzw_of_before_1993_is_told_by_its_streams() {
    let (_dir, path) = folder();
    // 1200 codes: of 9, 10 and 11 bits.
    let expected: Vec<f32> = (0..1200).map(|i| ((i * i / 7) % 256) as f32).collect();
    for (compression, name) in [(OLD_LZW, "LZW of before 1993"), (5, "LZW")] {
        let mut tiff = TinyTiff::new("u8", 40, 30, |_, x, y| f64::from(expected[40 * y + x]));
        for chunk in [(0, 30), (16, 16)] {
            (tiff.compression, tiff.chunk) = (compression, chunk);
            tiff.write(&path);
            let storage = DemReader::open(&path, &OpenOptions::default()).unwrap().info().storage.clone();
            assert!(storage.split(", ").any(|part| part == name), "{storage}");
            assert_eq!(heights(&path), expected, "{storage}");
        }
    }
}

#[test]
fn tiles_under_the_tags_of_strips() {
    let (_dir, path) = folder();
    let mut tiff = TinyTiff::new("f32", 20, 20, |_, x, y| (x + 20 * y) as f64);
    tiff.chunk = (16, 16);
    let mut bytes = tiff.encode();
    // The numbers of the tags alone are changed: in a directory 273 and 279 would stand further up.
    for (tiles, strips) in [(324u16, 273u16), (325, 279)] {
        let at = bytes.windows(4).rposition(|w| w[..2] == tiles.to_le_bytes() && w[2..] == [4, 0]).unwrap();
        bytes[at..at + 2].copy_from_slice(&strips.to_le_bytes());
    }
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(heights(&path), (0..400).map(|v| v as f32).collect::<Vec<_>>());
    let storage = DemReader::open(&path, &OpenOptions::default()).unwrap().info().storage.clone();
    assert!(storage.contains("tiles 16×16 under the tags of strips"), "{storage}");
    // One size too few.
    let at = bytes.windows(4).rposition(|w| w[..2] == 279u16.to_le_bytes() && w[2..] == [4, 0]).unwrap();
    bytes[at + 4..at + 8].copy_from_slice(&3u32.to_le_bytes());
    std::fs::write(&path, bytes).unwrap();
    let error = DemReader::open(&path, &OpenOptions::default()).err().unwrap().to_string();
    assert!(error.contains("table of tiles under the tags of strips"), "{error}");
    assert!(error.contains("4 offsets and 3 sizes"), "{error}");
}

#[test]
fn what_is_not_read_is_called_by_its_name() {
    let (_dir, path) = folder();
    let error = |change: &dyn Fn(&mut TinyTiff)| {
        let mut tiff = map([1.0; 4]);
        change(&mut tiff);
        tiff.write(&path);
        read(&path).unwrap_err()
    };
    let jpeg = error(&|tiff| tiff.compression = 7);
    assert!(jpeg.to_string().contains("JPEG") && jpeg.hint().unwrap().contains("COMPRESS=DEFLATE"));
    // A complex sample: 64 bits of format 6.
    map([1.0; 4]).write(&path);
    let mut bytes = std::fs::read(&path).unwrap();
    for (tag, value) in [(258u16, 64u16), (339, 6)] {
        let at = bytes.windows(4).rposition(|w| w[..2] == tag.to_le_bytes() && w[2..] == [3, 0]).unwrap();
        bytes[at + 8..at + 10].copy_from_slice(&value.to_le_bytes());
    }
    std::fs::write(&path, bytes).unwrap();
    let complex = read(&path).unwrap_err();
    assert!(complex.to_string().contains("complex floats of 64 bits"), "{complex}");
    assert!(!complex.hint().unwrap().contains("DEFLATE"), "{:?}", complex.hint());
}

#[test]
fn sizes_that_no_file_of_this_length_holds_are_refused_before_memory_is_taken() {
    let (_dir, path) = folder();
    let mut tiff = map([1.0; 4]);
    tiff.compression = 8;
    let mut bytes = tiff.encode();
    for (tag, value) in [(256u16, 500_000_000u32), (257, 1), (278, 1)] {
        let at = bytes.windows(4).rposition(|w| w[..2] == tag.to_le_bytes() && w[2..] == [4, 0]).unwrap();
        bytes[at + 8..at + 12].copy_from_slice(&value.to_le_bytes());
    }
    std::fs::write(&path, &bytes).unwrap();
    assert!(matches!(read(&path), Err(Error::Malformed { .. })), "{:?}", read(&path));
    assert!(read_picture(&path).is_err());
    for (tag, value) in [(256u16, 16_000u32), (257, 16_000), (278, 16_000)] {
        let at = bytes.windows(4).rposition(|w| w[..2] == tag.to_le_bytes() && w[2..] == [4, 0]).unwrap();
        bytes[at + 8..at + 12].copy_from_slice(&value.to_le_bytes());
    }
    std::fs::write(&path, &bytes).unwrap();
    assert!(matches!(read_picture(&path), Err(Error::Malformed { .. })));
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let pipe = dir.path().join("pipe.png");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [pipe.as_path(), Path::new("/dev/zero")] {
        assert!(matches!(read_picture(path), Err(Error::Io { .. })));
        assert!(matches!(DemReader::open(path, &OpenOptions::default()).err(), Some(Error::Io { .. })));
    }
}

// PDS3 and ISIS ---------------------------------------------------------------------------------------------------------

/// A label of a 4×4 image of 16-bit samples, least significant byte first, and its image.
fn pds3(dir: &Path, before: &str, image: &str, map: &str, samples: &[i16; 16]) -> PathBuf {
    let text = format!(
        "PDS_VERSION_ID = PDS3\r\n^IMAGE = \"A.IMG\"\r\n{before}OBJECT = IMAGE\r\n LINES = 4\r\n LINE_SAMPLES = 4\r\n \
         SAMPLE_TYPE = LSB_INTEGER\r\n SAMPLE_BITS = 16\r\n{image}END_OBJECT = IMAGE\r\n{map}END\r\n"
    );
    let path = dir.join("a.lbl");
    std::fs::write(&path, text).unwrap();
    std::fs::write(dir.join("a.img"), samples.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())
        .unwrap();
    path
}

const COUNTED: [i16; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

fn polar(centre_latitude: &str, offset: &str) -> String {
    format!(
        "OBJECT = IMAGE_MAP_PROJECTION\r\n MAP_PROJECTION_TYPE = \"POLAR STEREOGRAPHIC\"\r\n A_AXIS_RADIUS = 1737.4 <km>\r\n \
         CENTER_LATITUDE = {centre_latitude} <deg>\r\n CENTER_LONGITUDE = 0 <deg>\r\n MAP_SCALE = 2 <m/pixel>\r\n \
         LINE_PROJECTION_OFFSET = {offset} <pixel>\r\n SAMPLE_PROJECTION_OFFSET = {offset} <pixel>\r\n\
         END_OBJECT = IMAGE_MAP_PROJECTION\r\n"
    )
}

#[test]
fn lists_of_no_data_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let mut samples = [100; 16];
    (samples[3], samples[7], samples[9]) = (-20_000, -21_000, -9999);
    let image = " INVALID_TYPE = (\"SATURATION\", \"MINUS\")\r\n INVALID_VALUE = (-20000, -21000)\r\n \
                 MISSING_CONSTANT = (\"N/A\", -9999)\r\n";
    let path = pds3(dir.path(), "", image, &polar("-90", "1.5"), &samples);
    let found = heights(&path);
    let absent: Vec<usize> = (0..16).filter(|i| found[*i].is_nan()).collect();
    assert_eq!(absent, [3, 7, 9]);
    assert!(read(&path).unwrap().1.is_empty(), "an origin in the very middle needs no word");
}

#[test]
fn factors_of_each_band() {
    let dir = tempfile::tempdir().unwrap();
    let image = " BANDS = 2\r\n BAND_STORAGE_TYPE = SAMPLE_INTERLEAVED\r\n SCALING_FACTOR = (0.5, 2.0)\r\n OFFSET = (1.0, 10.0)\r\n";
    let path = pds3(dir.path(), "", image, &polar("-90", "1.5"), &COUNTED);
    std::fs::write(dir.path().join("a.img"), [3, 0].repeat(32)).unwrap();
    for (band, expected) in [(1, 2.5), (2, 16.0)] {
        let options = OpenOptions { band: Some(band), ..OpenOptions::default() };
        assert_eq!(DemReader::open(&path, &options).unwrap().read_all().unwrap().data[0], expected);
    }
    let three = image.replace("(0.5, 2.0)", "(0.5, 2.0, 3.0)");
    pds3(dir.path(), "", &three, &polar("-90", "1.5"), &COUNTED);
    std::fs::write(dir.path().join("a.img"), [3, 0].repeat(32)).unwrap();
    assert!(matches!(read(&path), Err(Error::Malformed { .. })));
}

#[test]
fn a_centre_that_is_not_the_pole_is_the_latitude_of_true_scale() {
    let dir = tempfile::tempdir().unwrap();
    let path = pds3(dir.path(), "", "", &polar("-69.3", "1.5"), &COUNTED);
    let dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
    let south =
        selenograph_geometry::proj_string::parse("+proj=stere +lat_0=-90 +lat_ts=-69.3 +R=1737400").unwrap();
    assert_eq!(dem.info().crs.projection, south.projection);
    // Nothing tells whether 7 counts from an edge or a centre.
    let path = pds3(dir.path(), "", "", &polar("-69.3", "7"), &COUNTED);
    assert!(noted(&path, "first pixel's centre") && noted(&path, "does not tell"));
}

#[test]
fn display_directions_turn_a_picture_and_refuse_a_map() {
    let dir = tempfile::tempdir().unwrap();
    let rows = |found: &PictureFile| -> Vec<i32> {
        found.grey.data.iter().map(|level| (level * 32_767.0).round() as i32).collect()
    };
    for (lines, samples, expected) in
        [("UP", "RIGHT", [12, 13, 14, 15]), ("DOWN", "LEFT", [3, 2, 1, 0]), ("RIGHT", "UP", [3, 7, 11, 15])]
    {
        let image = format!(" LINE_DISPLAY_DIRECTION = {lines}\r\n SAMPLE_DISPLAY_DIRECTION = {samples}\r\n");
        let path = pds3(dir.path(), "", &image, &polar("-90", "1.5"), &COUNTED);
        let found = read_picture(&path).unwrap();
        assert_eq!(rows(&found)[..4], expected);
        assert!(found.notes.iter().any(|note| note.contains("turned")));
        assert!(matches!(read(&path), Err(Error::Unsupported { .. })));
    }
}

#[test]
fn labels_of_isis_and_of_other_objects_are_not_called_damaged() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.lbl");
    std::fs::write(dir.path().join("a.cub"), (0..15u8).map(|i| i + 10).collect::<Vec<u8>>()).unwrap();
    let label = "Object = IsisCube\n  Object = Core\n    ^Core = a.cub\n    StartByte = 1\n    Format = BandSequential\n    \
                 Group = Dimensions\n      Samples = 5\n      Lines = 3\n      Bands = 1\n    End_Group\n    Group = Pixels\n      \
                 Type = UnsignedByte\n      ByteOrder = Lsb\n      Base = 0.0\n      Multiplier = 1.0\n    End_Group\n  End_Object\n\
                 Group = Archive\n    Source = \"PDS_VERSION_ID\"\n  End_Group\nEnd_Object\nEnd\n";
    std::fs::write(&path, label).unwrap();
    assert_eq!(read_picture(&path).unwrap().grey.data[1], 11.0 / 255.0);
    for file in [path.clone(), dir.path().join("a.cub")] {
        let error = read(&file).unwrap_err();
        assert!(
            matches!(error, Error::UnknownFormat { .. }) && error.to_string().contains("ISIS"),
            "{error}"
        );
    }
    std::fs::write(
        &path,
        "PDS_VERSION_ID = PDS3\r\n^TABLE = \"A.TAB\"\r\nOBJECT = TABLE\r\nROWS = 3\r\nEND_OBJECT\r\nEND\r\n",
    )
    .unwrap();
    let error = read_picture(&path).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }) && error.to_string().contains("TABLE"), "{error}");
}
