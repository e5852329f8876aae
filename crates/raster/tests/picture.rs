//! Pictures of every format through the one front, what is said of them, and what is refused.
#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "a test fails by panicking, and says whether it ran"
)]

mod support;

use proptest::prelude::*;
use selenograph_raster::codec::picture::{GreyUnit, PictureFile, PictureFormat, read_picture};
use selenograph_raster::codec::{jpeg, png};
use selenograph_raster::{Error, Raster};
use std::path::{Path, PathBuf};
use support::{Order, TinyTiff, Values};

/// A file of these bytes in a folder that lives as long as the first value.
fn file(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (dir, path)
}

fn picture(name: &str, bytes: &[u8]) -> Result<PictureFile, Error> {
    let (_dir, path) = file(name, bytes);
    read_picture(&path)
}

fn hex(text: &str) -> Vec<u8> {
    let digit = |i: usize| u8::from_str_radix(&text[i..i + 2], 16).unwrap();
    (0..text.len()).step_by(2).map(digit).collect()
}

fn levels(picture: &PictureFile) -> Vec<f32> {
    picture.grey.data.clone()
}

#[test]
fn png_of_eight_and_sixteen_bits_whatever_the_name_says() {
    let bytes = png::encode_grey8(&Raster { width: 2, height: 1, data: vec![0, 255] }).unwrap();
    let found = picture("a.jpg", &bytes).unwrap();
    assert_eq!((found.format, found.bits, found.was_colour), (PictureFormat::Png, 8, false));
    assert_eq!(found.unit, GreyUnit::White(255.0));
    assert_eq!(levels(&found), [0.0, 1.0]);
    let bytes = png::encode_grey16(&Raster { width: 2, height: 1, data: vec![13_107, 65_535] }).unwrap();
    let found = picture("a.png", &bytes).unwrap();
    assert_eq!((found.bits, levels(&found)), (16, vec![0.2, 1.0]));
}

#[test]
fn colour_becomes_luma_and_is_said() {
    let raster = Raster { width: 4, height: 1, data: vec![[255; 3], [255, 0, 0], [0, 255, 0], [0, 0, 255]] };
    let found = picture("a", &png::encode_rgb8(&raster).unwrap()).unwrap();
    assert!(found.was_colour && found.notes.iter().any(|note| note.contains("BT.601")));
    assert_eq!(levels(&found), [1.0, 0.299, 0.587, 0.114]);
}

/// Written by Pillow: `Image.new("1", (3, 2))` and a palette of three colours.
#[test]
fn one_bit_and_palette_pictures_are_widened() {
    let bits = "89504e470d0a1a0a0000000d4948445200000003000000020100000000b50f5bb70000000c49444154789c634860520\
                0000148008332485d580000000049454e44ae426082";
    let found = picture("a", &hex(bits)).unwrap();
    assert_eq!((found.bits, levels(&found)), (1, vec![0.0, 1.0, 1.0, 1.0, 0.0, 0.0]));
    let palette = "89504e470d0a1a0a0000000d49484452000000020000000202030000000fd8e5b700000009504c54450a141effffff000\
                   00029f8d1ad0000000c49444154789c63106098000000c400a1165cba960000000049454e44ae426082";
    let found = picture("a", &hex(palette)).unwrap();
    assert!(found.was_colour, "{:?}", found.notes);
    let dark = 0.299 * 10.0 / 255.0 + 0.587 * 20.0 / 255.0 + 0.114 * 30.0 / 255.0;
    for (level, expected) in levels(&found).into_iter().zip([dark, 1.0, 0.0, 1.0]) {
        assert!((level - expected).abs() < 1e-6);
    }
}

fn image_bytes(image: &image::DynamicImage) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn transparent_pixels_are_absent() {
    let rgba = image::RgbaImage::from_raw(2, 1, vec![255, 255, 255, 0, 255, 255, 255, 9]).unwrap();
    let found = picture("a", &image_bytes(&rgba.into())).unwrap();
    assert!(levels(&found)[0].is_nan() && levels(&found)[1] == 1.0);
    let clear = image::GrayAlphaImage::from_raw(1, 1, vec![7, 0]).unwrap();
    assert!(matches!(picture("a", &image_bytes(&clear.into())), Err(Error::AllNodata { .. })));
    let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(1, 1, vec![65_535u16; 3]).unwrap();
    let found = picture("a", &image_bytes(&deep.into())).unwrap();
    assert_eq!((found.bits, levels(&found)), (16, vec![1.0]));
}

#[test]
fn jpeg_whole_and_cut_off() {
    let grey = Raster::from_fn(64, 48, |x, y| (2 * x + y) as u8);
    let bytes = jpeg::encode_grey_as_rgb(&grey, 95).unwrap();
    let found = picture("a", &bytes).unwrap();
    assert!(found.was_colour && found.format == PictureFormat::Jpeg);
    // Quality 95 keeps levels to a few steps.
    let worst = levels(&found).into_iter().zip(&grey.data).map(|(a, b)| (a * 255.0 - f32::from(*b)).abs());
    assert!(worst.fold(0.0, f32::max) < 4.0);
    for end in [3, 40, 200, bytes.len() / 2, bytes.len() - 2] {
        let error = picture("a", &bytes[..end]).unwrap_err();
        assert!(!error.to_string().contains('\n'), "{error}");
    }
}

#[test]
fn pgm_with_its_own_white() {
    let found = picture("a", b"P5 2 1 4095\n\x0f\xff\x00\x00").unwrap();
    assert_eq!((found.unit, found.bits, levels(&found)), (GreyUnit::White(4095.0), 16, vec![1.0, 0.0]));
    let error = picture("a", b"P2 2 1 100\n 7 101").unwrap_err().to_string();
    assert!(error.contains("101"), "{error}");
    assert!(picture("a", b"P5 4000000000 4000000000 255\n\x00").is_err());
}

#[test]
fn tiff_integers_floats_and_colour() {
    for (kind, order, compression, predictor, chunk, white) in [
        ("u8", Order::Little, 5, 2, (0, 2), Some(255.0)),
        ("u16", Order::Big, 8, 2, (16, 16), Some(65_535.0)),
        ("f32", Order::Little, 8, 3, (16, 16), None),
    ] {
        let mut tiff = TinyTiff::new(kind, 19, 7, |_, x, y| (3 * x + y) as f64);
        tiff.tags = Vec::new();
        (tiff.order, tiff.compression, tiff.predictor, tiff.chunk) = (order, compression, predictor, chunk);
        let found = picture("a", &tiff.encode()).unwrap();
        assert_eq!(found.unit, white.map_or(GreyUnit::AsStored, GreyUnit::White));
        let expected = Raster::from_fn(19, 7, |x, y| ((3 * x + y) as f64 / white.unwrap_or(1.0)) as f32);
        assert_eq!(found.grey, expected, "{kind}");
    }
    let mut colour = TinyTiff::new("u8", 4, 4, |_, _, _| 255.0);
    colour.tags = vec![(262, Values::Shorts(vec![2]))];
    colour.samples = vec![colour.samples[0].clone(), vec![vec![0.0; 4]; 4], vec![vec![0.0; 4]; 4]];
    let found = picture("a", &colour.encode()).unwrap();
    assert!(found.was_colour && levels(&found).iter().all(|level| (level - 0.299).abs() < 1e-6));
    let mut inverted = TinyTiff::new("u8", 4, 4, |_, _, _| 255.0);
    inverted.tags = vec![(262, Values::Shorts(vec![0]))];
    assert!(levels(&picture("a", &inverted.encode()).unwrap()).iter().all(|level| *level == 0.0));
    inverted.tags = vec![(262, Values::Shorts(vec![3]))];
    assert!(picture("a", &inverted.encode()).unwrap_err().to_string().contains("palette"));
    let nodata = TinyTiff { tags: vec![(42113, Values::Text("3".into()))], ..colour };
    assert!(picture("a", &nodata.encode()).is_ok());
}

#[test]
fn pds3_attached_and_detached() {
    let image = "OBJECT = IMAGE\r\nLINES = 2\r\nLINE_SAMPLES = 3\r\nSAMPLE_BITS = 16\r\n\
                 SAMPLE_TYPE = MSB_UNSIGNED_INTEGER\r\nSAMPLE_BIT_MASK = 2#0000111111111111#\r\nEND_OBJECT = IMAGE\r\nEND\r\n";
    let samples: Vec<u8> = [0u16, 4095, 819, 1, 2, 3].iter().flat_map(|v| v.to_be_bytes()).collect();
    let attached = format!("PDS_VERSION_ID = PDS3\r\n^IMAGE = 401 <BYTES>\r\n{image}");
    let mut bytes = attached.into_bytes();
    bytes.resize(400, b' ');
    bytes.extend(&samples);
    let found = picture("a.img", &bytes).unwrap();
    assert_eq!((found.format, found.bits, found.unit), (PictureFormat::Pds3, 16, GreyUnit::White(4095.0)));
    assert_eq!(levels(&found)[..3], [0.0, 1.0, 0.2]);
    assert!(matches!(picture("a.img", &bytes[..409]), Err(Error::Truncated { .. })));

    let (dir, path) = file("b.img", &samples);
    let detached = format!("PDS_VERSION_ID = PDS3\r\n^IMAGE = \"B.IMG\"\r\n{image}");
    std::fs::write(dir.path().join("b.lbl"), &detached).unwrap();
    assert_eq!(read_picture(&path).unwrap().grey, found.grey);
    assert_eq!(read_picture(&dir.path().join("b.lbl")).unwrap().data_path, path);
    let radiance = detached.replace("LINES = 2", "SCALING_FACTOR = 0.5\r\nOFFSET = 1.0\r\nLINES = 2");
    std::fs::write(dir.path().join("b.lbl"), radiance).unwrap();
    let found = read_picture(&path).unwrap();
    assert_eq!((found.unit, levels(&found)[3]), (GreyUnit::AsStored, 1.5));
    std::fs::remove_file(&path).unwrap();
    assert!(matches!(read_picture(&dir.path().join("b.lbl")), Err(Error::MissingFile { .. })));
}

#[test]
fn pds4_labels_need_no_map() {
    let (dir, path) = file("a.raw", &[9, 0, 51, 255, 102, 153, 204]);
    let xml = "<?xml version=\"1.0\"?><Product_Observational><File_Area_Observational><File><file_name>a.raw</file_name>\
               </File><Array_2D_Image><offset unit=\"byte\">1</offset><axes>2</axes><Element_Array>\
               <data_type>UnsignedByte</data_type></Element_Array><Axis_Array><axis_name>Line</axis_name>\
               <elements>2</elements><sequence_number>1</sequence_number></Axis_Array><Axis_Array>\
               <axis_name>Sample</axis_name><elements>3</elements><sequence_number>2</sequence_number></Axis_Array>\
               </Array_2D_Image></File_Area_Observational></Product_Observational>";
    std::fs::write(dir.path().join("a.xml"), xml).unwrap();
    let found = read_picture(&dir.path().join("a.xml")).unwrap();
    assert_eq!((found.format, found.data_path.clone()), (PictureFormat::Pds4, path.clone()));
    assert_eq!(levels(&found), [0.0, 0.2, 1.0, 0.4, 0.6, 0.8]);
    assert_eq!(read_picture(&path).unwrap().grey, found.grey);
    std::fs::write(dir.path().join("a.xml"), "<svg></svg>").unwrap();
    assert!(read_picture(&dir.path().join("a.xml")).is_err());
}

/// A cube of 5×3 samples, numbered from 10: `layout` is the label's lines on how they lie.
fn cube(layout: &str, kind: &str, order: &str, scale: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = format!(
        "Object = IsisCube\n  Object = Core\n    StartByte = 2049\n    {layout}\n    Group = Dimensions\n      Samples = 5\n\
         Lines   = 3\n      Bands   = 1\n    End_Group\n    Group = Pixels\n      Type = {kind}\n      ByteOrder = {order}\n\
         {scale}\n    End_Group\n  End_Object\n  Group = Kernels\n    Instrument = $apollo15/metric_v2-\n      ti\n\
         End_Group\nEnd_Object\nEnd\n"
    )
    .into_bytes();
    bytes.resize(2048, 0);
    bytes.extend(data);
    bytes
}

#[test]
fn isis_cubes_in_lines_and_tiles() {
    let number = |x: usize, y: usize| (10 + x + 5 * y) as f32;
    let expected = Raster::from_fn(5, 3, |x, y| if (x, y) == (1, 1) { f32::NAN } else { number(x, y) });
    let same = |found: &Raster<f32>, expected: &Raster<f32>| {
        found.data.iter().zip(&expected.data).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
    };
    // ISIS's null is the bit pattern FF7FFFFB.
    let stored =
        |x: usize, y: usize| if (x, y) == (1, 1) { f32::from_bits(0xFF7F_FFFB) } else { number(x, y) };
    let lines: Vec<u8> = (0..15).flat_map(|i| stored(i % 5, i / 5).to_be_bytes()).collect();
    let found = picture("a", &cube("Format = BandSequential", "Real", "Msb", "Base = 0.0", &lines)).unwrap();
    assert_eq!((found.format, found.unit, found.bits), (PictureFormat::Isis, GreyUnit::AsStored, 32));
    assert!(same(&found.grey, &expected));

    // Tiles of 2×2: three across, two down, those at the edges padded.
    let mut tiles = Vec::new();
    for (tile_y, tile_x, y, x) in (0..24).map(|i| (i / 12, i / 4 % 3, i / 2 % 2, i % 2)) {
        let (x, y) = (2 * tile_x + x, 2 * tile_y + y);
        let inside = x < 5 && y < 3;
        tiles.push(match (x, y) {
            (1, 1) => -32_768i16,
            _ if inside => 2 * number(x, y) as i16 - 6,
            _ => 999,
        });
    }
    let data: Vec<u8> = tiles.iter().flat_map(|v| v.to_le_bytes()).collect();
    let layout = "Format = Tile\n TileSamples = 2\n TileLines = 2";
    let scale = "Base = 3.0\n Multiplier = 0.5";
    let bytes = cube(layout, "SignedWord", "Lsb", scale, &data);
    let found = picture("a", &bytes).unwrap();
    assert!(same(&found.grey, &expected) && found.unit == GreyUnit::AsStored, "{:?}", found.grey);
    assert!(matches!(picture("a", &bytes[..bytes.len() - 1]), Err(Error::Truncated { .. })));

    let plain: Vec<u8> = (0..15).map(|i| if i == 6 { 0 } else { 17 * (i % 15) }).collect();
    let found = picture("a", &cube("Format = BandSequential", "UnsignedByte", "Lsb", "", &plain)).unwrap();
    assert!(found.grey[(1, 1)].is_nan() && found.grey[(0, 0)].is_nan());
    assert_eq!((found.unit, found.grey[(3, 0)]), (GreyUnit::White(255.0), 0.2));
    for (layout, kind) in
        [("Format = Zigzag", "Real"), ("Format = BandSequential", "Complex"), ("A = 1", "Real")]
    {
        assert!(picture("a", &cube(layout, kind, "Lsb", "", &data)).is_err());
    }
}

#[test]
fn what_is_no_picture_is_called_by_its_name() {
    for (bytes, name) in [
        (&b""[..], "an empty file"),
        (b"GIF89a\x01\x00", "GIF"),
        (b"P6 1 1 255\n\x00\x00\x00", "PPM"),
        (b"\x76\x2f\x31\x01....", "OpenEXR"),
        (b"just some text", "bytes 6a 75 73 74"),
    ] {
        let error = picture("a.png", bytes).unwrap_err();
        assert!(matches!(error, Error::UnknownFormat { .. }), "{error}");
        assert!(error.to_string().contains(name) && !error.to_string().contains('\n'), "{error}");
    }
    let dir = tempfile::tempdir().unwrap();
    assert!(matches!(read_picture(&dir.path().join("none.png")), Err(Error::Io { .. })));
    assert!(matches!(read_picture(dir.path()), Err(Error::Io { .. })));
    let absurd = cube("Format = BandSequential", "Real", "Lsb", "", &[]);
    let absurd = String::from_utf8(absurd).unwrap().replace("Samples = 5", "Samples = 500000");
    let absurd = absurd.replace("Lines   = 3", "Lines = 500000");
    assert!(picture("a", absurd.as_bytes()).unwrap_err().to_string().contains("500000×500000"));
}

/// One small whole file of each format.
fn samples() -> Vec<Vec<u8>> {
    let grey = Raster::from_fn(9, 7, |x, y| (x * y) as u8);
    let label = b"PDS_VERSION_ID = PDS3\n^IMAGE = 181 <BYTES>\nOBJECT = IMAGE\nLINES = 2\nLINE_SAMPLES = 2\n\
                  SAMPLE_BITS = 8\nSAMPLE_TYPE = UNSIGNED_INTEGER\nEND_OBJECT\nEND\n";
    let mut pds3 = label.to_vec();
    pds3.resize(184, 1);
    vec![
        png::encode_grey8(&grey).unwrap(),
        jpeg::encode_grey_as_rgb(&grey, 90).unwrap(),
        TinyTiff::new("u16", 9, 7, |_, x, y| (x + y) as f64).encode(),
        b"P5 3 2 255\n\x00\x0a\x20\x09\xc8\xff".to_vec(),
        pds3,
        cube("Format = Tile\nTileSamples = 4\nTileLines = 2", "UnsignedByte", "Lsb", "", &[7; 32]),
    ]
}

#[test]
fn truncations_are_errors() {
    for bytes in samples() {
        assert!(picture("a", &bytes).is_ok());
        let step = (bytes.len() / 60).max(1);
        for end in (0..bytes.len() - 13).step_by(step) {
            assert!(picture("a", &bytes[..end]).is_err(), "{:?} cut at {end}", &bytes[..4]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn damaged_files_never_panic(which in 0usize..6, damage in prop::collection::vec((any::<u16>(), any::<u8>()), 1..6)) {
        let mut bytes = samples().swap_remove(which);
        for (at, value) in damage {
            let at = usize::from(at) % bytes.len();
            bytes[at] = value;
        }
        let _ = picture("a", &bytes);
    }

    #[test]
    fn arbitrary_bytes_never_panic(head in 0usize..8, bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let heads: [&[u8]; 8] = [
            b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"II*\0\x08\0\0\0", b"P5 ", b"PDS_VERSION_ID = PDS3\n",
            b"<Array_2D_Image>", b"Object = IsisCube\nObject = Core\n",
        ];
        let _ = picture("a", &[heads[head], &bytes].concat());
    }
}

fn shared(test: &str, folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        // A relative path counts from the workspace's root.
        |root| Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(root),
    );
    let folder = root.join("data").join(folder);
    if folder.is_dir() {
        eprintln!("RAN shared-data: {test}");
        return Some(folder);
    }
    eprintln!("SKIP shared-data: {test}: no folder {}", folder.display());
    None
}

/// The format of pictures with such an ending; `None` for other files.
fn format_by_ending(path: &Path) -> Option<PictureFormat> {
    match path.extension()?.to_str()? {
        "cub" => Some(PictureFormat::Isis),
        "png" => Some(PictureFormat::Png),
        "pgm" => Some(PictureFormat::Pgm),
        "jpg" => Some(PictureFormat::Jpeg),
        "img" => Some(PictureFormat::Pds3),
        _ => None,
    }
}

/// Every picture that is there, whatever it is called.
#[test]
fn shared_real_pictures() {
    let Some(root) = shared("shared_real_pictures", "") else { return };
    let mut folders = vec![root];
    let mut num_of_format = std::collections::BTreeMap::new();
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                // Images of elevation models have their own tests.
                folders.extend((!path.ends_with("dem")).then_some(path));
                continue;
            }
            let Some(format) = format_by_ending(&path) else { continue };
            let found = read_picture(&path).unwrap_or_else(|e| panic!("{e}"));
            let name = path.display();
            assert_eq!(found.format, format, "{name}");
            let grey = &found.grey;
            assert_eq!(grey.data.len(), grey.width * grey.height, "{name}");
            let valid: Vec<f32> = grey.data.iter().copied().filter(|level| level.is_finite()).collect();
            assert!(valid.len() * 100 > grey.data.len() * 95, "{name}: {} valid", valid.len());
            let is_white = format != PictureFormat::Isis;
            assert_eq!(matches!(found.unit, GreyUnit::White(255.0)), is_white, "{name}: {:?}", found.unit);
            if is_white {
                assert!(valid.iter().all(|level| (0.0..=1.0).contains(level)), "{name}");
            }
            *num_of_format.entry(format!("{format:?}")).or_insert(0) += 1;
        }
    }
    eprintln!("{num_of_format:?}");
    if num_of_format.is_empty() {
        eprintln!("SKIP shared-data: shared_real_pictures: no picture in any folder");
    }
}
