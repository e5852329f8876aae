use super::*;
use crate::Affine;
use crate::codec::picture::read_picture;
use crate::dem::{DemFormat, DemReader, OpenOptions};
use selenograph_geometry::proj_string;

fn south(step_m: f64) -> CogPlace {
    let crs = proj_string::parse("IAU_2015:30135").unwrap();
    CogPlace::Map { crs, map_from_pixel: Affine::north_up(-1000.0, 2000.0, step_m, step_m) }
}

fn local() -> CogPlace {
    let local_from_pixel = Affine::north_up(-10.0, 20.0, 0.5, 0.5);
    CogPlace::Local { name: "local | grid".into(), metric: true, local_from_pixel }
}

fn heights(width: usize, height: usize) -> Raster<f32> {
    Raster::from_fn(width, height, |x, y| if (x + y) % 7 == 0 { f32::NAN } else { (x * 10 + y) as f32 })
}

fn same(a: &Raster<f32>, b: &Raster<f32>) -> bool {
    let equal = |(a, b): (&f32, &f32)| a == b || (a.is_nan() && b.is_nan());
    (a.width, a.height) == (b.width, b.height) && a.data.iter().zip(&b.data).all(equal)
}

/// The file with only the directory of overview `idx` (0: the first reduced one) as its first.
fn overview(path: &Path, idx: usize) -> PathBuf {
    let mut bytes = std::fs::read(path).unwrap();
    let number =
        |at: usize, size: usize| bytes[at..at + size].iter().rev().fold(0, |v, b| v << 8 | usize::from(*b));
    let mut place = number(4, 4);
    for _ in 0..=idx {
        place = number(place + 2 + 12 * number(place, 2), 4);
    }
    assert!(place > 0, "no such overview");
    bytes[4..8].copy_from_slice(&(place as u32).to_le_bytes());
    let out = path.with_extension(format!("{idx}.tif"));
    std::fs::write(&out, bytes).unwrap();
    out
}

#[test]
fn reads_back_and_leaves_no_temporary_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let raster = heights(75, 41);
    for limit in [MAX_CLASSIC_BYTES, 0] {
        let options = CogOptions { tile_side: 16, ..CogOptions::float("height", "m") };
        let mut writer = CogWriter::create(&path, 75, 41, &south(5.0), options).unwrap();
        for rows in raster.data.chunks(75 * 6) {
            writer.write_rows(rows).unwrap();
        }
        writer.finish_within(limit).unwrap();
        let mut dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
        let info = dem.info().clone();
        assert_eq!(info.format == DemFormat::BigTiff, limit == 0);
        assert_eq!((info.num_overviews, info.band_name.as_deref()), (3, Some("height")));
        let CogPlace::Map { crs, map_from_pixel } = south(5.0) else { panic!() };
        assert_eq!((info.crs.projection, info.map_from_pixel), (crs.projection, map_from_pixel));
        assert!(same(&dem.read_all().unwrap(), &raster));
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

#[test]
fn overviews_average_what_is_there() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let raster = heights(37, 21);
    let options = CogOptions { tile_side: 16, ..CogOptions::float("height", "m") };
    write(&path, &raster, &local(), options).unwrap();
    let halved = |from: &Raster<f32>| {
        Raster::from_fn(from.width.div_ceil(2), from.height.div_ceil(2), |x, y| {
            let cells = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| from.get(2 * x + i, 2 * y + j));
            let there: Vec<f64> =
                cells.into_iter().flatten().filter(|v| !v.is_nan()).map(|v| f64::from(*v)).collect();
            (there.iter().sum::<f64>() / there.len() as f64) as f32
        })
    };
    let first = halved(&raster);
    assert!(same(&read_picture(&overview(&path, 0)).unwrap().grey, &first));
    assert!(same(&read_picture(&overview(&path, 1)).unwrap().grey, &halved(&first)));
}

#[test]
fn classes_keep_their_numbers_in_overviews() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let mut classes = Raster::filled(32, 2, 1u8);
    classes.row_mut(0)[..6].copy_from_slice(&[3, 1, 2, 9, 9, 9]);
    classes.row_mut(1)[..6].copy_from_slice(&[1, 3, 2, 2, 9, 9]);
    for (overviews, expected) in [(ByteOverviews::Mode, [3.0, 2.0]), (ByteOverviews::Largest, [3.0, 2.0])] {
        let options = CogOptions { tile_side: 16, ..CogOptions::classes("hazard", 9, overviews, vec![]) };
        write_classes(&path, &classes, &local(), options).unwrap();
        let full = read_picture(&path).unwrap();
        assert_eq!((full.bits, full.grey[(0, 0)] * 255.0), (8, 3.0));
        assert!(full.grey[(3, 0)].is_nan());
        let reduced = read_picture(&overview(&path, 0)).unwrap().grey.map(|v| v * 255.0);
        assert_eq!([reduced[(0, 0)], reduced[(1, 0)]], expected);
        assert!(reduced[(2, 0)].is_nan());
    }
}

#[test]
fn classes_have_colours_in_every_level_and_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let class = |number, name: &str, color| CogClass { number, name: name.to_owned(), color };
    let classes = vec![class(0, "no data", [1, 2, 3]), class(3, "steep & rough", [255, 128, 0])];
    let options = CogOptions {
        tile_side: 16,
        ..CogOptions::classes("hazard", 0, ByteOverviews::Largest, classes.clone())
    };
    write_classes(&path, &Raster::filled(40, 3, 3u8), &local(), options.clone()).unwrap();
    for file in [path.clone(), overview(&path, 0), overview(&path, 1)] {
        let error = read_picture(&file).unwrap_err();
        assert!(error.to_string().contains("palette"), "{error}");
        let bytes = std::fs::read(&file).unwrap();
        // 768 shorts, reds first.
        let table: Vec<u8> = color_map(&classes).iter().flat_map(|value| value.to_le_bytes()).collect();
        assert_eq!(table.len(), 2 * 768);
        assert_eq!(table[..8], [1, 1, 0, 0, 0, 0, 255, 255]);
        assert_eq!(table[512..520], [2, 2, 0, 0, 0, 0, 128, 128]);
        assert!(bytes.windows(table.len()).any(|window| window == table));
    }
    let text = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
    assert!(text.contains("<Item name=\"CLASS_3\" sample=\"0\">steep &amp;amp; rough</Item>"), "{text}");
    let names = category_names(&classes);
    let found: Vec<&str> = names
        .lines()
        .filter_map(|line| line.trim().strip_prefix("<Category>")?.strip_suffix("</Category>"))
        .collect();
    assert_eq!(found, ["no data", "", "", "steep &amp; rough"]);
    // The numbers themselves are read as before.
    let heights = DemReader::open(&path, &OpenOptions::default()).err();
    assert!(heights.is_some_and(|error| !error.to_string().contains("palette")), "it has no place on a body");
    let floats = CogOptions { classes, ..CogOptions::float("height", "m") };
    assert!(matches!(CogWriter::create(&path, 5, 5, &local(), floats), Err(Error::Encode { .. })));
}

#[test]
fn several_bands_and_a_number_for_absent() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let (height, sigma) = (heights(20, 18), heights(20, 18).map(|v| v * 0.5));
    let pixels: Vec<f32> = height.data.iter().zip(&sigma.data).flat_map(|(a, b)| [*a, *b]).collect();
    let options = CogOptions {
        tile_side: 16,
        samples: CogSamples::Float32 { nodata: Some(-32_768.0) },
        bands: vec![CogBand::new("height", "m"), CogBand::new("sigma & more", "m")],
        classes: vec![],
    };
    let mut writer = CogWriter::create(&path, 20, 18, &south(2.0), options).unwrap();
    writer.write_rows(&pixels).unwrap();
    writer.finish().unwrap();
    for (band, expected) in [(1, &height), (2, &sigma)] {
        let options = OpenOptions { band: Some(band), ..OpenOptions::default() };
        let mut dem = DemReader::open(&path, &options).unwrap();
        assert_eq!(dem.info().nodata, [-32_768.0]);
        let names = ["height", "sigma & more"];
        assert_eq!(dem.info().band_name.as_deref(), Some(names[band - 1]));
        assert!(same(&dem.read_all().unwrap(), expected));
    }
}

#[test]
fn what_cannot_be_written_is_refused_and_cleaned_up() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let float = || CogOptions::float("height", "m");
    assert!(CogWriter::create(&path, 0, 5, &local(), float()).is_err());
    assert!(CogWriter::create(&path, 5, 5, &local(), CogOptions { tile_side: 20, ..float() }).is_err());
    assert!(CogWriter::create(&path, 5, 5, &local(), CogOptions { bands: vec![], ..float() }).is_err());
    let mut writer = CogWriter::create(&path, 5, 5, &local(), float()).unwrap();
    assert!(writer.write_rows(&[0.0; 7]).is_err() && writer.write_rows(&[0.0; 30]).is_err());
    writer.write_rows(&[0.0; 10]).unwrap();
    assert!(writer.finish().is_err());
    let bytes = CogOptions::classes("hazard", 0, ByteOverviews::Mode, vec![]);
    for sample in [256.0, -1.0, 0.5, f32::INFINITY] {
        let mut writer = CogWriter::create(&path, 1, 1, &local(), bytes.clone()).unwrap();
        assert!(writer.write_rows(&[sample]).is_err());
    }
    assert!(CogWriter::create(&dir.path().join("no/a.tif"), 5, 5, &local(), float()).is_err());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}
