//! GeoTIFF: every layout, its georeference, the writer, and files that are wrong.
// Helpers of a test are tests too: a failure there is a panic with its place.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use proptest::prelude::*;
use selenograph_geometry::proj_string;
use selenograph_raster::dem::geotiff::Compression;
use selenograph_raster::dem::{
    DemFormat, DemReader, GeoTiffLayout, GeoTiffWriter, OpenOptions, PixelIs, WriteOptions,
};
use selenograph_raster::{Affine, Error};
use std::path::Path;
use support::{Order, SOUTH_KEYS, TinyTiff, Values, geo_keys, transform};

const WIDTH: usize = 37;
const HEIGHT: usize = 21;

fn value(band: usize, x: usize, y: usize) -> f64 {
    ((x * 7 + y * 13 + band * 31 + x * y) % 101) as f64
}

fn open(path: &Path) -> Result<DemReader, Error> {
    DemReader::open(path, &OpenOptions::default())
}

/// The error of opening, or of reading everything.
fn error_of(path: &Path, options: &OpenOptions) -> Error {
    DemReader::open(path, options).and_then(|mut dem| dem.read_all()).expect_err("an error")
}

#[test]
fn every_type_compression_predictor_and_layout() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let mut tried = 0;
    for kind in ["u8", "i8", "u16", "i16", "u32", "i32", "f32", "f64"] {
        for (compression, predictor) in
            [(1, 1), (5, 1), (5, 2), (8, 2), (32946, 1), (32773, 1), (8, 3), (5, 3)]
        {
            if predictor == 3 && !kind.starts_with('f') {
                continue;
            }
            for chunk in [(0, 1), (0, 4), (0, 999), (16, 16), (48, 32)] {
                for planar in [false, true] {
                    let mut tiff = TinyTiff::new(kind, WIDTH, HEIGHT, value);
                    for band in 1..3 {
                        let rows =
                            (0..HEIGHT).map(|y| (0..WIDTH).map(|x| value(band, x, y)).collect()).collect();
                        tiff.samples.push(rows);
                    }
                    (tiff.compression, tiff.predictor, tiff.chunk, tiff.planar) =
                        (compression, predictor, chunk, planar);
                    tiff.order = if tried % 2 == 0 { Order::Little } else { Order::Big };
                    tiff.big = tried % 3 == 0;
                    tiff.write(&path);
                    let band = 1 + tried % 3;
                    let options = OpenOptions { band: Some(band), ..OpenOptions::default() };
                    let mut dem = DemReader::open(&path, &options).unwrap();
                    assert_eq!(dem.info().format == DemFormat::BigTiff, tiff.big);
                    let heights = dem.read_all().unwrap();
                    for (i, h) in heights.data.iter().enumerate() {
                        let expected = value(band - 1, i % WIDTH, i / WIDTH) as f32;
                        assert_eq!(*h, expected, "{kind} {compression}/{predictor} {chunk:?} sample {i}");
                    }
                    tried += 1;
                }
            }
        }
    }
    assert_eq!(tried, (6 * 6 + 2 * 8) * 5 * 2);
}

#[test]
fn rows_in_any_order_and_number() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    for (compression, chunk) in [(1, (0, 1000)), (8, (0, 70)), (8, (16, 16)), (1, (0, 150))] {
        let mut tiff = TinyTiff::new("i16", 9, 301, value);
        (tiff.compression, tiff.chunk) = (compression, chunk);
        tiff.write(&path);
        let mut dem = open(&path).unwrap();
        let mut rows = Vec::new();
        for (first, count) in [(290, 11), (0, 301), (64, 1), (63, 3), (100, 150), (300, 1), (5, 0)] {
            dem.read_rows(first, count, &mut rows).unwrap();
            assert_eq!(rows.len(), 9 * count);
            for (i, h) in rows.iter().enumerate() {
                assert_eq!(*h, value(0, i % 9, first + i / 9) as f32);
            }
        }
        assert!(matches!(dem.read_rows(300, 2, &mut rows), Err(Error::Rows { .. })));
        assert!(matches!(dem.read_rows(usize::MAX, 2, &mut rows), Err(Error::Rows { .. })));
    }
}

#[test]
fn area_point_and_matrix() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let mut tiff = TinyTiff::new("f32", 4, 4, value);
    tiff.write(&path);
    assert_eq!(open(&path).unwrap().info().map_from_pixel.apply(0.0, 0.0), [1000.0, 2000.0]);

    tiff.tags = geo_keys(&[SOUTH_KEYS, &[(1025, 2.0)]].concat());
    tiff.tags.extend(transform(1000.0, 2000.0, 5.0));
    tiff.write(&path);
    let dem = open(&path).unwrap();
    assert_eq!(dem.info().pixel_is, PixelIs::Point);
    assert_eq!(dem.info().map_from_pixel.apply(0.5, 0.5), [1000.0, 2000.0]);

    let mut matrix = vec![0.0; 16];
    (matrix[0], matrix[1], matrix[3]) = (3.0, 4.0, 100.0);
    (matrix[4], matrix[5], matrix[7]) = (4.0, -3.0, 200.0);
    // Kilometres as the unit of the map.
    tiff.tags = geo_keys(&[SOUTH_KEYS, &[(3076, 9036.0)]].concat());
    tiff.tags.push((34264, Values::Doubles(matrix)));
    tiff.write(&path);
    assert_eq!(open(&path).unwrap().info().map_from_pixel.apply(1.0, 2.0), [111_000.0, 198_000.0]);
}

#[test]
fn scale_offset_unit_and_nodata() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let mut tiff = TinyTiff::new("i16", 3, 1, |_, x, _| [-32768.0, 100.0, -7.0][x]);
    tiff.tags.push((42113, Values::Text("-32768".into())));
    let xml = r#"<GDALMetadata><Item name="SCALE" sample="0" role="scale">0.0005</Item>
        <Item name="OFFSET" sample="0" role="offset">1737.4</Item>
        <Item name="UNITTYPE" sample="0" role="unittype">km</Item></GDALMetadata>"#;
    tiff.tags.push((42112, Values::Text(xml.into())));
    tiff.write(&path);
    let heights = open(&path).unwrap().read_all().unwrap();
    assert!(heights.data[0].is_nan());
    assert_eq!(heights.data[1..], [50.0, -3.5]);
    // The options overrule the file.
    let options = OpenOptions { nodata: Some(-7.0), ..OpenOptions::default() };
    let heights = DemReader::open(&path, &options).unwrap().read_all().unwrap();
    assert!(heights.data[2].is_nan() && !heights.data[0].is_nan());
}

/// A global map counted from 0° with the central meridian 0°: the longitude range follows the raster.
#[test]
fn longitudes_from_zero_to_360() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let turn = std::f64::consts::TAU * 1_737_400.0;
    let mut tiff = TinyTiff::new("i16", 36, 18, value);
    tiff.tags = geo_keys(&[(1024, 1.0), (3075, 17.0), (3078, 0.0), (3088, 0.0), (2057, 1_737_400.0)]);
    tiff.tags.extend(transform(0.0, turn / 4.0, turn / 36.0));
    tiff.write(&path);
    let check = |path: &Path, from_deg: fn(f64, f64) -> [f64; 2]| {
        let dem = open(path).unwrap();
        let map_from_pixel = dem.info().map_from_pixel;
        for (column, lon) in [(0.5, 5.0), (27.5, 275.0), (35.5, 355.0)] {
            let place = selenograph_geometry::Geodetic::from_deg(30.0, lon, 0.0);
            let [x, y] = dem.info().crs.projection.map_from_place(&place).unwrap();
            let [ex, ey] = from_deg(lon, 30.0);
            let [c, r] = map_from_pixel.inverse().unwrap().apply(x, y);
            assert!((c - column).abs() < 1e-9 && (r - 6.0).abs() < 1e-9, "{lon}: {c} {r}");
            assert!((x - ex).abs() < 1e-6 && (y - ey).abs() < 1e-6);
        }
    };
    check(&path, |lon, lat| [lon.to_radians() * 1_737_400.0, lat.to_radians() * 1_737_400.0]);
    tiff.tags = geo_keys(&[(1024, 2.0), (2057, 1_737_400.0)]);
    tiff.tags.extend(transform(0.0, 90.0, 10.0));
    tiff.write(&path);
    check(&path, |lon, lat| [lon, lat]);
}

/// The size of LOLA's 87.5° S product as one strip (a file with holes: nothing of it is stored): it is read in pieces.
#[test]
fn one_strip_for_the_whole_image_is_read_in_pieces() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let side = 30_336u32;
    let mut tiff = TinyTiff::new("f32", 20, 20, value);
    tiff.chunk = (0, 20);
    let mut bytes = tiff.encode();
    let start = bytes.len() as u32;
    for (tag, new) in [(256u16, side), (257, side), (278, side), (273, start), (279, side * side * 4)] {
        let entry = bytes.windows(4).rposition(|w| w[..2] == tag.to_le_bytes() && w[2..] == [4, 0]).unwrap();
        bytes[entry + 8..entry + 12].copy_from_slice(&new.to_le_bytes());
    }
    std::fs::write(&path, &bytes).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len(u64::from(start) + 4 * u64::from(side) * u64::from(side)).unwrap();
    let mut dem = open(&path).unwrap();
    let mut rows = Vec::new();
    dem.read_rows(side as usize - 2, 2, &mut rows).unwrap();
    assert!(rows.len() == 2 * side as usize && rows.iter().all(|h| *h == 0.0));
}

#[test]
fn sparse_tiles_are_absent() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let mut tiff = TinyTiff::new("f32", 32, 16, value);
    tiff.chunk = (16, 16);
    let mut bytes = tiff.encode();
    // Second entry of tag 325 (byte counts) and 324 (offsets), which lie before the directory.
    for tag in [324u16, 325] {
        let entry = bytes.windows(4).rposition(|w| w[..2] == tag.to_le_bytes() && w[2..] == [4, 0]).unwrap();
        let at = u32::from_le_bytes(bytes[entry + 8..entry + 12].try_into().unwrap()) as usize;
        bytes[at + 4..at + 8].fill(0);
    }
    std::fs::write(&path, bytes).unwrap();
    let mut dem = open(&path).unwrap();
    assert!(dem.info().notes[0].contains("1 of 2"), "{:?}", dem.info().notes);
    let heights = dem.read_all().unwrap();
    assert_eq!(heights[(3, 3)], value(0, 3, 3) as f32);
    assert!(heights[(20, 3)].is_nan());
}

#[test]
fn what_is_written_is_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("out.tif");
    let heights: Vec<f32> =
        (0..50 * 40).map(|i| if i % 97 == 0 { f32::NAN } else { ((i * i) as f32).sin() * 3000.0 }).collect();
    for text in [
        "+proj=stere +lat_0=-90 +R=1737400",
        "+proj=stere +lat_0=90 +lat_ts=71 +lon_0=30 +R=3396190",
        "+proj=eqc +lat_ts=20 +lat_0=3 +lon_0=40 +x_0=5 +R=1737400",
        "+proj=ortho +lat_0=20 +lon_0=40 +R=1737400",
        "+proj=longlat +R=1737400",
    ] {
        let crs = proj_string::parse(text).unwrap();
        for layout in [GeoTiffLayout::Tiles { side: 16 }, GeoTiffLayout::Strips { rows: 7 }] {
            for compression in [Compression::None, Compression::Deflate] {
                let affine = Affine::new([
                    100.0,
                    0.1,
                    if compression == Compression::None { 0.0 } else { 0.01 },
                    20.0,
                    0.0,
                    -0.1,
                ]);
                let options = WriteOptions { layout, compression, nodata: None };
                let mut writer = GeoTiffWriter::create(&path, 50, 40, &crs, &affine, options).unwrap();
                for rows in heights.chunks(50 * 9) {
                    writer.write_rows(rows).unwrap();
                }
                assert!(writer.write_rows(&heights[..50]).is_err(), "one row too many");
                writer.finish().unwrap();
                let mut dem = open(&path).unwrap();
                assert_eq!(dem.info().map_from_pixel, affine);
                let (a, b) = (&dem.info().crs, &crs);
                let place = selenograph_geometry::Geodetic::from_deg(17.0, 41.0, 0.0);
                let (x, y) = (a.projection.map_from_place(&place), b.projection.map_from_place(&place));
                assert!(x.zip(y).is_none_or(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]) < 1e-6), "{text}");
                assert_eq!(a.body, b.body);
                let back = dem.read_all().unwrap();
                assert!(
                    back.data
                        .iter()
                        .zip(&heights)
                        .all(|(p, q)| p.to_bits() == q.to_bits() || p.is_nan() && q.is_nan())
                );
            }
        }
    }
}

#[test]
fn nothing_half_written_remains() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("out.tif");
    let crs = proj_string::parse("IAU_2015:30135").unwrap();
    let affine = Affine::north_up(0.0, 0.0, 5.0, 5.0);
    let create = |options| GeoTiffWriter::create(&path, 20, 20, &crs, &affine, options);
    let mut writer = create(WriteOptions::default()).unwrap();
    writer.write_rows(&[0.0; 60]).unwrap();
    assert!(matches!(writer.finish(), Err(Error::SizeMismatch { .. })));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    let odd = WriteOptions { layout: GeoTiffLayout::Tiles { side: 20 }, ..WriteOptions::default() };
    assert!(create(odd).is_err());
}

#[test]
fn what_is_wrong_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let base = TinyTiff::new("f32", 20, 20, value);
    let error = |tiff: &TinyTiff| {
        tiff.write(&path);
        error_of(&path, &OpenOptions::default())
    };
    let without = |tag: u16| {
        let mut tiff = base.clone();
        tiff.tags.retain(|t| t.0 != tag);
        tiff
    };
    assert!(matches!(error(&without(33550)), Error::NoGeoreference { .. }));
    let no_keys = error(&without(34735));
    assert!(matches!(no_keys, Error::NoGeoreference { .. }) && no_keys.hint().unwrap().contains("--crs"));
    // With --crs the missing keys do not matter.
    let given = OpenOptions { crs: Some("IAU_2015:30135".into()), ..OpenOptions::default() };
    assert!(DemReader::open(&path, &given).is_ok());
    let nonsense = OpenOptions { crs: Some("+proj=merc".into()), ..OpenOptions::default() };
    assert!(matches!(error_of(&path, &nonsense), Error::CoordinateSystem { .. }));

    let mut tiff = base.clone();
    tiff.tags = geo_keys(&[(1024, 1.0), (3075, 24.0), (2057, 1_737_400.0)]);
    tiff.tags.extend(transform(0.0, 0.0, 5.0));
    let unknown = error(&tiff);
    assert!(matches!(&unknown, Error::UnknownProjection { name, .. } if name == "Sinusoidal"), "{unknown}");

    tiff = base.clone();
    tiff.compression = 50000;
    assert!(error(&tiff).to_string().contains("ZSTD"));
    tiff.compression = 8;
    tiff.write(&path);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[40..60].fill(0xFF);
    std::fs::write(&path, bytes).unwrap();
    assert!(matches!(error_of(&path, &OpenOptions::default()), Error::Malformed { .. }));

    tiff = TinyTiff::new("f32", 20, 20, |_, _, _| f64::NAN);
    assert!(matches!(error(&tiff), Error::AllNodata { num_samples: 400, .. }));
    base.write(&path);
    let band = OpenOptions { band: Some(2), ..OpenOptions::default() };
    assert!(matches!(error_of(&path, &band), Error::Band { num_bands: 1, found: 2, .. }));
    let zero = OpenOptions { band: Some(0), ..OpenOptions::default() };
    assert!(matches!(error_of(&path, &zero), Error::Band { .. }));
    for content in [&b""[..], b"not a DEM", b"\x89PNG\r\n\x1a\n", b"II*\0"] {
        std::fs::write(&path, content).unwrap();
        let e = error_of(&path, &OpenOptions::default());
        assert!(matches!(e, Error::UnknownFormat { .. } | Error::Truncated { .. }), "{e}");
    }
    assert!(matches!(error_of(&dir.path().join("none.tif"), &given), Error::Io { action: "open", .. }));
}

#[test]
fn overviews_are_counted_and_a_broken_mask_is_not_ignored() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let image = TinyTiff::new("u8", 20, 20, value).encode();
    let second = |kind: u64, side: u64| {
        // A directory without samples behind the image: subfile type and width are what is looked at.
        let mut bytes = image.clone();
        let at = (bytes.len() as u32).to_le_bytes();
        let next = bytes.len() - 4;
        bytes[next..].copy_from_slice(&at);
        bytes.extend([2, 0]);
        for (tag, value) in [(254u16, kind), (256, side)] {
            bytes.extend(
                [&tag.to_le_bytes()[..], &[4, 0, 1, 0, 0, 0], &(value as u32).to_le_bytes()].concat(),
            );
        }
        bytes.extend([0; 4]);
        bytes
    };
    std::fs::write(&path, second(1, 10)).unwrap();
    assert_eq!(open(&path).unwrap().info().num_overviews, 1);
    // A mask of the image's width that has no height of its own.
    std::fs::write(&path, second(4, 20)).unwrap();
    assert!(matches!(open(&path).err(), Some(Error::Malformed { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Cut and damaged files give an error or heights, never a panic or a huge allocation.
    #[test]
    fn damaged_files_never_panic(
        variant in 0usize..6,
        cut in prop::option::of(0.0f64..1.0),
        damage in prop::collection::vec((0.0f64..1.0, any::<u8>()), 0..12),
    ) {
        let mut tiff = TinyTiff::new(if variant % 2 == 0 { "f32" } else { "i16" }, 20, 20, value);
        tiff.big = variant >= 3;
        tiff.compression = [1, 8, 5, 32773, 8, 1][variant];
        tiff.predictor = [1, 2, 3, 1, 3, 1][variant];
        tiff.chunk = [(0, 3), (16, 16), (0, 20), (16, 16), (0, 5), (16, 16)][variant];
        let mut bytes = tiff.encode();
        let len = bytes.len();
        for (at, byte) in damage {
            // Most of the structure is in the directory at the end.
            bytes[len - 1 - ((at * at * (len - 1) as f64) as usize)] = byte;
        }
        bytes.truncate(cut.map_or(len, |share| (share * len as f64) as usize));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        std::fs::write(&path, bytes).unwrap();
        if let Ok(mut dem) = open(&path) && dem.info().width * dem.info().height < 1 << 24 {
            let _ = dem.read_all();
        }
    }
}
