//! A miniature of each layout of the paper's DEM table (LOLA, SLDEM2015, Kaguya, Chang'E-2, LROC NAC), and what PDS
//! labels can get wrong.
// Helpers of a test are tests too: a failure there is a panic with its place.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use proptest::prelude::*;
use selenograph_geometry::{Geodetic, Pole, Projection};
use selenograph_raster::dem::{ByteOrder, DemFormat, DemReader, HeightUnit, OpenOptions, SampleType};
use selenograph_raster::{Error, Raster};
use std::path::Path;
use support::{TinyTiff, Values, geo_keys, transform};

const R: f64 = 1_737_400.0;
const DEG_M: f64 = R * std::f64::consts::PI / 180.0;

fn open(path: &Path) -> Result<DemReader, Error> {
    DemReader::open(path, &OpenOptions::default())
}

fn heights(path: &Path) -> Raster<f32> {
    open(path).and_then(|mut dem| dem.read_all()).unwrap_or_else(|e| panic!("{e}"))
}

/// Latitude and east longitude (0..360) of continuous pixel coordinates, degrees.
fn place_deg(dem: &DemReader, column: f64, row: f64) -> [f64; 2] {
    let [x, y] = dem.info().map_from_pixel.apply(column, row);
    let place = dem.info().crs.projection.place_from_map(x, y).unwrap();
    [place.lat_rad.to_degrees(), place.lon_rad.to_degrees().rem_euclid(360.0)]
}

fn assert_place(dem: &DemReader, column: f64, row: f64, lat: f64, lon: f64) {
    let [a, b] = place_deg(dem, column, row);
    assert!((a - lat).abs() < 1e-6 && (b - lon).abs() < 1e-6, "{a} {b}, expected {lat} {lon}");
}

/// A PDS3 label; `map` and `image` are the keywords of the two objects.
fn label(head: &str, image: &str, map: &str) -> String {
    format!(
        "PDS_VERSION_ID = \"PDS3\"\r\n/* miniature */\r\n{head}\r\nTARGET_NAME = MOON\r\nOBJECT = IMAGE\r\n{image}\r\n\
         END_OBJECT = IMAGE\r\nOBJECT = IMAGE_MAP_PROJECTION\r\n{map}\r\nEND_OBJECT = IMAGE_MAP_PROJECTION\r\nEND\r\n"
    )
}

const AXES: &str = "A_AXIS_RADIUS = 1737.4 <KM>\r\nB_AXIS_RADIUS = 1737.4 <KM>\r\nC_AXIS_RADIUS = 1737.4 <KM>\r\n\
                    POSITIVE_LONGITUDE_DIRECTION = EAST";

/// `LDEM_875S_5M`: 8 × 8 instead of 30 336 × 30 336.
fn lola_map() -> String {
    format!(
        "MAP_PROJECTION_TYPE = \"POLAR STEREOGRAPHIC\"\r\nMAP_RESOLUTION = 6064.67 <PIX/DEG>\r\n{AXES}\r\n\
         CENTER_LATITUDE = -90.0 <DEG>\r\nCENTER_LONGITUDE = 0.0 <DEG>\r\nMAP_PROJECTION_ROTATION = 0.0\r\n\
         MAP_SCALE = 5 <METERS/PIXEL>\r\nMAXIMUM_LATITUDE = -87.5 <DEG>\r\nMINIMUM_LATITUDE = -90 <DEG>\r\n\
         LINE_PROJECTION_OFFSET = 3.5 <PIXEL>\r\nSAMPLE_PROJECTION_OFFSET = 3.5 <PIXEL>"
    )
}

#[test]
fn lola_polar_int16_half_metres() {
    let dir = tempfile::tempdir().unwrap();
    let image = "LINES = 8\r\nLINE_SAMPLES = 8\r\nSAMPLE_TYPE = LSB_INTEGER\r\nSAMPLE_BITS = 16\r\nUNIT = METER\r\n\
                 SCALING_FACTOR = 0.5\r\nOFFSET = 1737400.";
    let text = label("RECORD_BYTES = 16\r\n^IMAGE = \"LDEM_875S_5M.IMG\"", image, &lola_map());
    // The label's name and the image's differ in case, as they do on many archives.
    let (lbl, img) = (dir.path().join("ldem_875s_5m.lbl"), dir.path().join("ldem_875s_5m.img"));
    std::fs::write(&lbl, text).unwrap();
    let samples: Vec<u8> = (0..64i16).flat_map(|i| (i * 100 - 3000).to_le_bytes()).collect();
    std::fs::write(&img, samples).unwrap();
    for path in [&lbl, &img] {
        let dem = open(path).unwrap();
        let info = dem.info();
        assert_eq!(info.format, DemFormat::Pds3);
        assert_eq!(info.crs.projection, Projection::south_polar(R));
        assert_eq!(info.map_from_pixel.coefficients, [-20.0, 5.0, 0.0, 20.0, 0.0, -5.0]);
        assert_eq!(place_deg(&dem, 4.0, 4.0)[0], -90.0, "the pole is the corner of the four middle pixels");
        let heights = heights(path);
        assert_eq!(heights.data[..3], [-1500.0, -1450.0, -1400.0]);
    }
}

#[test]
fn lola_polar_float_kilometres() {
    let dir = tempfile::tempdir().unwrap();
    let image = "LINES = 8\r\nLINE_SAMPLES = 8\r\nSAMPLE_TYPE = PC_REAL\r\nSAMPLE_BITS = 32\r\nUNIT = KILOMETER\r\n\
                 SCALING_FACTOR = 1\r\nOFFSET = 1737.4";
    let text = label("RECORD_BYTES = 32\r\n^IMAGE = \"LDEM_875S_5M_FLOAT.IMG\"", image, &lola_map());
    let lbl = dir.path().join("LDEM_875S_5M_FLOAT.LBL");
    let img = dir.path().join("LDEM_875S_5M_FLOAT.IMG");
    std::fs::write(&lbl, &text).unwrap();
    let samples: Vec<u8> = (0..64).flat_map(|i| (i as f32 * 0.25 - 4.0).to_le_bytes()).collect();
    std::fs::write(&img, &samples).unwrap();
    assert_eq!(heights(&img).data[..3], [-4000.0, -3750.0, -3500.0]);
    // Without a unit the offset, the radius in kilometres, tells it.
    std::fs::write(&lbl, text.replace("UNIT = KILOMETER\r\n", "")).unwrap();
    assert_eq!(heights(&lbl).data[1], -3750.0);
    let options = OpenOptions { height_unit: Some(HeightUnit::Kilometre), ..OpenOptions::default() };
    std::fs::write(&lbl, text.replace("KILOMETER", "FATHOM")).unwrap();
    assert!(matches!(open(&lbl).err(), Some(Error::Unsupported { what: "height unit", .. })));
    assert!(DemReader::open(&lbl, &options).is_ok());
}

/// A tile of SLDEM2015: simple cylindrical, 512 pixels per degree there, 2 here.
#[test]
fn sldem_tile_float_and_int16() {
    let dir = tempfile::tempdir().unwrap();
    let map = format!(
        "MAP_PROJECTION_TYPE = \"SIMPLE CYLINDRICAL\"\r\nMAP_RESOLUTION = 2 <PIX/DEG>\r\n{AXES}\r\n\
         CENTER_LATITUDE = 0 <DEG>\r\nCENTER_LONGITUDE = 0 <DEG>\r\nMAP_PROJECTION_ROTATION = 0\r\n\
         MAP_SCALE = 15.16 <KM/PIX>\r\nMAXIMUM_LATITUDE = 30 <DEG>\r\nMINIMUM_LATITUDE = 27 <DEG>\r\n\
         WESTERNMOST_LONGITUDE = 225 <DEG>\r\nEASTERNMOST_LONGITUDE = 229 <DEG>\r\n\
         LINE_PROJECTION_OFFSET = 59.5 <PIX>\r\nSAMPLE_PROJECTION_OFFSET = -450.5 <PIX>"
    );
    for (kind, scaling, sample) in [
        ("PC_REAL\r\nSAMPLE_BITS = 32\r\nUNIT = KILOMETER", "SCALING_FACTOR = 1\r\nOFFSET = 1737.4", true),
        (
            "LSB_INTEGER\r\nSAMPLE_BITS = 16\r\nUNIT = METER",
            "SCALING_FACTOR = 0.5\r\nOFFSET = 1737400",
            false,
        ),
    ] {
        let image = format!("LINES = 6\r\nLINE_SAMPLES = 8\r\nSAMPLE_TYPE = {kind}\r\n{scaling}");
        let lbl = dir.path().join("SLDEM.LBL");
        std::fs::write(&lbl, label("^IMAGE = \"SLDEM.IMG\"", &image, &map)).unwrap();
        let bytes: Vec<u8> = if sample {
            (0..48).flat_map(|i| (i as f32 / 8.0).to_le_bytes()).collect()
        } else {
            (0..48i16).flat_map(|i| (i * 250).to_le_bytes()).collect()
        };
        std::fs::write(dir.path().join("SLDEM.IMG"), bytes).unwrap();
        assert_eq!(heights(&lbl).data[47], 47.0 * 125.0);
        let dem = open(&lbl).unwrap();
        assert_place(&dem, 0.0, 0.0, 30.0, 225.0);
        assert_place(&dem, 7.5, 5.5, 27.25, 228.75);
        assert!(dem.info().notes.is_empty(), "{:?}", dem.info().notes);
        // The tile's places lead back into it, although its central meridian is half a turn away.
        let [x, y] =
            dem.info().crs.projection.map_from_place(&Geodetic::from_deg(27.25, 228.75, 0.0)).unwrap();
        let [c, r] = dem.info().map_from_pixel.inverse().unwrap().apply(x, y);
        assert!((c - 7.5).abs() < 1e-9 && (r - 5.5).abs() < 1e-9);
    }
}

/// Kaguya TC: an attached label, position in bytes, big-endian or little-endian int16, 3° tile (here 4 pixels per
/// degree), offsets counted from the tile's corner.
#[test]
fn kaguya_tile_with_attached_label() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("DTM_MAP_01_N66E270N63E273SC.img");
    let map = format!(
        "MAP_PROJECTION_TYPE = \"SIMPLE CYLINDRICAL\"\r\nMAP_RESOLUTION = 4 <PIXEL/DEG>\r\n{AXES}\r\n\
         CENTER_LATITUDE = 0.0 <DEG>\r\nCENTER_LONGITUDE = 0.0 <DEG>\r\nMAP_SCALE = 7580.837606 <M/PIXEL>\r\n\
         MAXIMUM_LATITUDE = 66.0 <DEG>\r\nMINIMUM_LATITUDE = 63.0 <DEG>\r\nWESTERNMOST_LONGITUDE = 270.0 <DEG>\r\n\
         EASTERNMOST_LONGITUDE = 273.0 <DEG>\r\nLINE_PROJECTION_OFFSET = 264.0 <PIXEL>\r\n\
         SAMPLE_PROJECTION_OFFSET = -1080.0 <PIXEL>"
    );
    for order in ["MSB", "LSB"] {
        let image = format!(
            "LINES = 12\r\nLINE_SAMPLES = 12\r\nSAMPLE_TYPE = {order}_INTEGER\r\nSAMPLE_BITS = 16\r\n\
             UNIT = METER\r\nSCALING_FACTOR = 1\r\nOFFSET = 0\r\nDUMMY_DATA = -9999"
        );
        let mut bytes = label("RECORD_BYTES = 24\r\n^IMAGE = 2401 <BYTES>", &image, &map).into_bytes();
        assert!(bytes.len() < 2400);
        bytes.resize(2400, b' ');
        for i in 0..144i16 {
            let v = if i == 5 { -9999 } else { i - 2000 };
            bytes.extend(if order == "MSB" { v.to_be_bytes() } else { v.to_le_bytes() });
        }
        std::fs::write(&path, &bytes).unwrap();
        let dem = open(&path).unwrap();
        assert_eq!(dem.info().byte_order, if order == "MSB" { ByteOrder::Big } else { ByteOrder::Little });
        assert_eq!(dem.info().notes.len(), 2, "the bounds decided: {:?}", dem.info().notes);
        assert_place(&dem, 0.0, 0.0, 66.0, 270.0);
        assert_place(&dem, 12.0, 12.0, 63.0, 273.0);
        let heights = heights(&path);
        assert!(heights.data[5].is_nan());
        assert_eq!(heights.data[143], -1857.0);
    }
}

/// Chang'E-2: an int16 GeoTIFF of the whole Moon or a tile, equirectangular with a user-defined sphere.
#[test]
fn change_2_geotiff() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("CE2_GRAS_DEM_50m.tif");
    let mut tiff =
        TinyTiff::new("i16", 12, 6, |_, x, y| if x + y == 0 { -32768.0 } else { (100 * x + y) as f64 });
    tiff.compression = 5;
    tiff.tags = geo_keys(&[
        (1024, 1.0),
        (1025, 1.0),
        (2048, 32767.0),
        (2057, R),
        (2058, R),
        (3072, 32767.0),
        (3075, 17.0),
        (3076, 9001.0),
        (3078, 45.0),
        (3088, 180.0),
        (3089, 0.0),
        (3082, 0.0),
        (3083, 0.0),
    ]);
    tiff.tags.extend(transform(-6.0 * 2000.0, 40.0 * DEG_M, 2000.0));
    tiff.tags.push((42113, Values::Text("-32768".into())));
    tiff.write(&path);
    let dem = open(&path).unwrap();
    assert_eq!(dem.info().sample_type, SampleType::I16);
    assert_place(&dem, 6.0, 0.0, 40.0, 180.0);
    let heights = heights(&path);
    assert!(heights.data[0].is_nan());
    assert_eq!(heights[(11, 5)], 1105.0);
}

/// LROC NAC: float32 GeoTIFF, equirectangular about its own latitude or polar, with ISIS's NULL as no-data.
#[test]
fn nac_geotiff() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("NAC_DTM_APOLLO15.TIF");
    let null = f64::from(f32::from_bits(0xFF7F_FFFB));
    let mut tiff =
        TinyTiff::new("f32", 9, 7, |_, x, y| if x == 0 { null } else { -1900.0 + y as f64 + x as f64 / 8.0 });
    tiff.tags =
        geo_keys(&[(1024, 1.0), (3075, 17.0), (3078, 26.0), (3088, 3.6), (3089, 0.0), (2057, R), (2058, R)]);
    tiff.tags.extend(transform(0.0, 26.0 * DEG_M, 2.0));
    tiff.tags.push((42113, Values::Text("-3.4028226550889045e+38".into())));
    tiff.write(&path);
    let dem = open(&path).unwrap();
    assert_place(&dem, 0.0, 0.0, 26.0, 3.6);
    let equirectangular = heights(&path);
    assert!(equirectangular.data[0].is_nan());
    assert_eq!(equirectangular[(8, 6)], -1893.0);
    tiff.tags.retain(|t| t.0 >= 40000);
    tiff.tags.extend(geo_keys(&[
        (1024, 1.0),
        (3075, 15.0),
        (3081, 90.0),
        (3095, 180.0),
        (2057, R),
        (2058, R),
    ]));
    tiff.tags.extend(transform(0.0, 100.0, 2.0));
    tiff.write(&path);
    let dem = open(&path).unwrap();
    let projection = dem.info().crs.projection;
    assert!(matches!(projection, Projection::PolarStereographic { pole: Pole::North, .. }));
    // With longitude 180° downwards, the y axis is longitude 0.
    assert!(place_deg(&dem, 0.0, 0.0)[1] < 1e-9);
}

/// LROC NAC: PDS3 with an attached label, PC_REAL, special pixels in hexadecimal, position in records.
#[test]
fn nac_pds3() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("NAC_DTM_APOLLO15_E261N0036.IMG");
    let map = format!(
        "MAP_PROJECTION_TYPE = EQUIRECTANGULAR\r\n{AXES}\r\nPROJECTION_LATITUDE_TYPE = PLANETOCENTRIC\r\n\
         CENTER_LATITUDE = 26.0 <DEG>\r\nCENTER_LONGITUDE = 3.0 <DEG>\r\nMAP_PROJECTION_ROTATION = 0.0 <DEG>\r\n\
         MAP_SCALE = 2.0 <METERS/PIXEL>\r\nMAP_RESOLUTION = 15161.7 <PIXELS/DEGREE>\r\n\
         LINE_PROJECTION_OFFSET = 394203.5 <PIXEL>\r\nSAMPLE_PROJECTION_OFFSET = -8000.5 <PIXEL>"
    );
    let image = "LINES = 4\r\nLINE_SAMPLES = 5\r\nSAMPLE_TYPE = PC_REAL\r\nSAMPLE_BITS = 32\r\nUNIT = METERS\r\n\
                 MISSING_CONSTANT = 16#FF7FFFFB#\r\nCORE_LOW_REPR_SATURATION = 16#FF7FFFFC#";
    let mut bytes =
        label("RECORD_BYTES = 20\r\nLABEL_RECORDS = 100\r\n^IMAGE = 101", image, &map).into_bytes();
    bytes.resize(2000, b' ');
    for i in 0..20u32 {
        bytes.extend(if i == 7 { 0xFF7F_FFFBu32.to_le_bytes() } else { (-1900.0 - i as f32).to_le_bytes() });
    }
    std::fs::write(&path, &bytes).unwrap();
    let heights = heights(&path);
    assert!(heights.data[7].is_nan());
    assert_eq!(heights.data[19], -1919.0);
    let dem = open(&path).unwrap();
    let lat = 394_204.0 * 2.0 / DEG_M;
    let lon = 3.0 + 8000.0 * 2.0 / (DEG_M * 26f64.to_radians().cos());
    assert_place(&dem, 0.0, 0.0, lat, lon);
    assert!((dem.info().nodata[0] - -3.402_822_655_088_904_5e38).abs() < 1e24);
    // Cut short by one byte.
    std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    assert!(matches!(open(&path).err(), Some(Error::Truncated { expected: 2080, found: 2079, .. })));
}

const PDS4: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1" xmlns:cart="http://pds.nasa.gov/pds4/cart/v1">
 <Observation_Area><Discipline_Area><cart:Cartography><cart:Spatial_Reference_Information>
  <cart:Horizontal_Coordinate_System_Definition><cart:Planar>
   <cart:Map_Projection><cart:map_projection_name>Polar Stereographic</cart:map_projection_name>
    <cart:Polar_Stereographic>
     <cart:longitude_of_central_meridian unit="deg">0</cart:longitude_of_central_meridian>
     <cart:latitude_of_projection_origin unit="deg">-90</cart:latitude_of_projection_origin>
    </cart:Polar_Stereographic></cart:Map_Projection>
   <cart:Planar_Coordinate_Information><cart:Coordinate_Representation>
    <cart:pixel_resolution_x unit="m/pixel">20</cart:pixel_resolution_x>
    <cart:pixel_resolution_y unit="m/pixel">20</cart:pixel_resolution_y>
   </cart:Coordinate_Representation></cart:Planar_Coordinate_Information>
   <cart:Geo_Transformation><cart:upperleft_corner_x unit="km">-0.06</cart:upperleft_corner_x>
    <cart:upperleft_corner_y unit="m">40</cart:upperleft_corner_y></cart:Geo_Transformation>
  </cart:Planar><cart:Geodetic_Model><cart:a_axis_radius unit="km">1737.4</cart:a_axis_radius>
   <cart:c_axis_radius unit="km">1737.4</cart:c_axis_radius>
   <cart:longitude_direction>Positive East</cart:longitude_direction></cart:Geodetic_Model>
  </cart:Horizontal_Coordinate_System_Definition></cart:Spatial_Reference_Information></cart:Cartography>
 </Discipline_Area></Observation_Area>
 <File_Area_Observational><File><file_name>ldem.img</file_name></File>
  <Array_2D_Image><offset unit="byte">4</offset><axes>2</axes>
   <axis_index_order>Last Index Fastest</axis_index_order>
   <Element_Array><data_type>SignedMSB2</data_type><unit>m</unit><scaling_factor>0.5</scaling_factor>
    <value_offset>1737400</value_offset></Element_Array>
   <Axis_Array><axis_name>Line</axis_name><elements>4</elements><sequence_number>1</sequence_number></Axis_Array>
   <Axis_Array><axis_name>Sample</axis_name><elements>6</elements><sequence_number>2</sequence_number></Axis_Array>
   <Special_Constants><missing_constant>-32768</missing_constant></Special_Constants>
  </Array_2D_Image></File_Area_Observational>
</Product_Observational>"#;

#[test]
fn pds4_label_and_raster() {
    let dir = tempfile::tempdir().unwrap();
    let (xml, img) = (dir.path().join("ldem.xml"), dir.path().join("LDEM.IMG"));
    std::fs::write(&xml, PDS4).unwrap();
    let samples = (0..24i16).flat_map(|i| if i == 3 { i16::MIN } else { 10 * i }.to_be_bytes());
    let bytes: Vec<u8> = [0u8; 4].into_iter().chain(samples).collect();
    std::fs::write(&img, &bytes).unwrap();
    for path in [&xml, &img] {
        let dem = open(path).unwrap();
        assert_eq!(dem.info().format, DemFormat::Pds4);
        assert_eq!(dem.info().crs.projection, Projection::south_polar(R));
        assert_eq!(dem.info().map_from_pixel.coefficients, [-60.0, 20.0, 0.0, 40.0, 0.0, -20.0]);
        let heights = heights(path);
        assert!(heights.data[3].is_nan());
        assert_eq!(heights[(5, 3)], 115.0);
    }
    let broken = |from: &str, to: &str| {
        std::fs::write(&xml, PDS4.replace(from, to)).unwrap();
        open(&xml).err().unwrap_or_else(|| panic!("{from} → {to} was accepted"))
    };
    assert!(matches!(broken("Polar Stereographic", "Sinusoidal"), Error::UnknownProjection { .. }));
    assert!(matches!(broken("<cart:upperleft_corner_y", "<cart:nothing"), Error::Malformed { .. }));
    assert!(matches!(broken("upperleft_corner_y", "nothing"), Error::NoGeoreference { .. }));
    assert!(matches!(broken("ldem.img", "other.img"), Error::MissingFile { .. }));
    assert!(matches!(broken("SignedMSB2", "ComplexLSB8"), Error::Unsupported { .. }));
    assert!(matches!(broken("<elements>4<", "<elements>5<"), Error::Truncated { .. }));
    assert!(matches!(broken("Array_2D_Image", "Table_Character"), Error::Malformed { .. }));
    assert!(matches!(
        broken("<cart:c_axis_radius unit=\"km\">1737.4", "<cart:c_axis_radius unit=\"km\">1735"),
        Error::CoordinateSystem { .. }
    ));
}

#[test]
fn what_is_wrong_with_a_pds3_label_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let image = "LINES = 2\r\nLINE_SAMPLES = 8\r\nSAMPLE_TYPE = MSB_INTEGER\r\nSAMPLE_BITS = 16";
    let text = label("^IMAGE = \"A.IMG\"", image, &lola_map());
    let lbl = dir.path().join("A.LBL");
    let broken = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        std::fs::write(&lbl, text.replace(from, to)).unwrap();
        DemReader::open(&lbl, &OpenOptions::default()).and_then(|mut dem| dem.read_all()).err()
    };
    let missing = broken("TARGET", "TARGET").unwrap();
    assert!(matches!(&missing, Error::MissingFile { target, .. } if target == "A.IMG"), "{missing}");
    std::fs::write(dir.path().join("a.img"), [0, 1].repeat(16)).unwrap();
    assert!(broken("TARGET", "TARGET").is_none());
    assert!(matches!(broken("POLAR STEREOGRAPHIC", "SINUSOIDAL"), Some(Error::UnknownProjection { .. })));
    assert!(matches!(broken("IMAGE_MAP_PROJECTION", "OTHER"), Some(Error::NoGeoreference { .. })));
    assert!(matches!(broken("MAP_SCALE = 5", "MAP_SCALE = 6"), Some(Error::Malformed { .. })));
    assert!(matches!(broken("END\r\n", ""), Some(Error::Malformed { .. })));
    assert!(matches!(
        broken("LINES = 2", "LINES = 3"),
        Some(Error::Truncated { expected: 48, found: 32, .. })
    ));
    assert!(matches!(broken("LINES = 2", "LINES = two"), Some(Error::Malformed { .. })));
    assert!(matches!(broken("MSB_INTEGER", "VAX_REAL"), Some(Error::Unsupported { .. })));
    assert!(matches!(broken("EAST", "WEST"), Some(Error::Unsupported { .. })));
    assert!(matches!(
        broken("C_AXIS_RADIUS = 1737.4", "C_AXIS_RADIUS = 1735.0"),
        Some(Error::CoordinateSystem { .. })
    ));
    assert!(matches!(broken("ROTATION = 0.0", "ROTATION = 90.0"), Some(Error::Unsupported { .. })));
    assert!(matches!(
        broken("SAMPLE_BITS = 16", "SAMPLE_BITS = 16\r\nMISSING_CONSTANT = 1"),
        Some(Error::AllNodata { num_samples: 16, .. })
    ));
    let e = broken("MAP_PROJECTION_TYPE", "MAP_PROJECTION_KIND").unwrap();
    assert!(matches!(e, Error::NoGeoreference { .. }), "{e}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn damaged_labels_never_panic(
        xml in any::<bool>(),
        cut in prop::option::of(0.0f64..1.0),
        damage in prop::collection::vec((0.0f64..1.0, any::<u8>()), 0..10),
    ) {
        let image = "LINES = 2\r\nLINE_SAMPLES = 8\r\nSAMPLE_TYPE = MSB_INTEGER\r\nSAMPLE_BITS = 16\r\nBANDS = 1";
        let text = if xml { PDS4.to_owned() } else { label("^IMAGE = (\"A.IMG\", 1 <BYTES>)", image, &lola_map()) };
        let mut bytes = text.into_bytes();
        let len = bytes.len();
        for (at, byte) in damage {
            bytes[(at * len as f64) as usize] = byte;
        }
        bytes.truncate(cut.map_or(len, |share| (share * len as f64) as usize));
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a.img"), [0, 1].repeat(100)).unwrap();
        std::fs::write(dir.path().join("ldem.img"), [0, 1].repeat(100)).unwrap();
        let path = dir.path().join("x.lbl");
        std::fs::write(&path, bytes).unwrap();
        if let Ok(mut dem) = open(&path) {
            let _ = dem.read_all();
        }
    }
}
