//! PDS4 labels as other people's programs write them: how pictures are turned, how maps are laid out.
// Helpers of a test are tests too: a failure there is a panic with its place.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use selenograph_raster::Error;
use selenograph_raster::codec::picture::read_picture;
use selenograph_raster::dem::{DemReader, OpenOptions};
use std::path::{Path, PathBuf};

/// Heights, and the notes after all rows have been read.
fn read(path: &Path) -> Result<(Vec<f32>, Vec<String>), Error> {
    let mut dem = DemReader::open(path, &OpenOptions::default())?;
    let heights = dem.read_all()?.data;
    Ok((heights, dem.info().notes.clone()))
}

fn noted(path: &Path, words: &str) -> bool {
    read(path).unwrap().1.iter().any(|note| note.contains(words))
}

/// A label of 4 lines of 4 bytes (or columns first), with display settings and a map.
fn pds4(dir: &Path, swapped: bool, display: [&str; 4], cells: &str, latitude: f64) -> PathBuf {
    let [across_axis, across, down_axis, down] = display;
    let settings = if across.is_empty() {
        String::new()
    } else {
        format!(
            "<disp:Display_Settings><disp:Display_Direction><disp:horizontal_display_axis>{across_axis}</disp:horizontal_display_axis>\
             <disp:horizontal_display_direction>{across}</disp:horizontal_display_direction>\
             <disp:vertical_display_axis>{down_axis}</disp:vertical_display_axis>\
             <disp:vertical_display_direction>{down}</disp:vertical_display_direction></disp:Display_Direction></disp:Display_Settings>"
        )
    };
    let axis = |name: &str, number: u8| {
        format!(
            "<Axis_Array><axis_name>{name}</axis_name><elements>4</elements><sequence_number>{number}</sequence_number></Axis_Array>"
        )
    };
    let axes =
        if swapped { axis("Sample", 1) + &axis("Line", 2) } else { axis("Line", 1) + &axis("Sample", 2) };
    let text = format!(
        "<Product xmlns:disp=\"d\" xmlns:cart=\"c\">{settings}<cart:Map_Projection><cart:map_projection_name>Polar Stereographic\
         </cart:map_projection_name><cart:longitude_of_central_meridian>0</cart:longitude_of_central_meridian>\
         <cart:latitude_of_projection_origin>{latitude}</cart:latitude_of_projection_origin></cart:Map_Projection>{cells}\
         <cart:upperleft_corner_x unit=\"m\">1000</cart:upperleft_corner_x><cart:upperleft_corner_y unit=\"m\">2000\
         </cart:upperleft_corner_y><cart:a_axis_radius unit=\"km\">1737.4</cart:a_axis_radius><File><file_name>a.img</file_name></File>\
         <Array_2D_Image><offset>0</offset><Element_Array><data_type>UnsignedByte</data_type></Element_Array>{axes}\
         </Array_2D_Image></Product>"
    );
    let path = dir.join("a.xml");
    std::fs::write(&path, text).unwrap();
    std::fs::write(dir.join("a.img"), (0..16).collect::<Vec<u8>>()).unwrap();
    path
}

const CELLS: &str = "<cart:pixel_resolution_x unit=\"m/pixel\">2</cart:pixel_resolution_x>\
                     <cart:pixel_resolution_y unit=\"m/pixel\">2</cart:pixel_resolution_y>";

#[test]
fn pictures_and_maps_are_turned_as_they_are_shown() {
    let dir = tempfile::tempdir().unwrap();
    let levels = |path: &Path| -> Vec<f32> {
        read_picture(path).unwrap().grey.data.iter().map(|level| (level * 255.0).round()).collect()
    };
    for (across, down, expected) in [
        ("Left to Right", "Top to Bottom", [0.0, 1.0, 2.0, 3.0]),
        ("Left to Right", "Bottom to Top", [12.0, 13.0, 14.0, 15.0]),
        ("Right to Left", "Top to Bottom", [3.0, 2.0, 1.0, 0.0]),
    ] {
        let path = pds4(dir.path(), false, ["Sample", across, "Line", down], CELLS, -90.0);
        assert_eq!(levels(&path)[..4], expected, "{across}, {down}");
        let mut dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
        let mut row = Vec::new();
        dem.read_rows(0, 1, &mut row).unwrap();
        assert_eq!(row, expected, "{across}, {down}");
        assert_eq!(dem.info().map_from_pixel.coefficients, [1000.0, 2.0, 0.0, 2000.0, 0.0, -2.0]);
    }
    // Columns stored one after the other, without settings and with such that turn them.
    let path = pds4(dir.path(), true, [""; 4], CELLS, -90.0);
    assert_eq!(levels(&path)[..4], [0.0, 4.0, 8.0, 12.0]);
    assert!(matches!(read(&path), Err(Error::Unsupported { what: "axis order of a map", .. })));
    let path = pds4(dir.path(), true, ["Sample", "Right to Left", "Line", "Bottom to Top"], CELLS, -90.0);
    assert_eq!(levels(&path)[..4], [15.0, 11.0, 7.0, 3.0]);
    // Lines shown as columns.
    let path = pds4(dir.path(), false, ["Line", "Left to Right", "Sample", "Top to Bottom"], CELLS, -90.0);
    assert_eq!(levels(&path)[..4], [0.0, 4.0, 8.0, 12.0]);
}

#[test]
fn cells_in_degrees_and_latitudes_of_true_scale() {
    let dir = tempfile::tempdir().unwrap();
    let lroc = "<cart:pixel_resolution_x unit=\"deg/pixel\">6.6e-05</cart:pixel_resolution_x>\
                <cart:pixel_resolution_y unit=\"deg/pixel\">6.6e-05</cart:pixel_resolution_y>\
                <cart:pixel_scale_x unit=\"m/pixel\">2</cart:pixel_scale_x><cart:pixel_scale_y unit=\"m/pixel\">2</cart:pixel_scale_y>";
    let path = pds4(dir.path(), false, [""; 4], lroc, -69.3);
    let dem = DemReader::open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(dem.info().map_from_pixel.coefficients, [1000.0, 2.0, 0.0, 2000.0, 0.0, -2.0]);
    let south =
        selenograph_geometry::proj_string::parse("+proj=stere +lat_0=-90 +lat_ts=-69.3 +R=1737400").unwrap();
    assert_eq!(dem.info().crs.projection, south.projection);
    assert!(noted(&path, "pixel_scale_x is the size of a cell"));
}
