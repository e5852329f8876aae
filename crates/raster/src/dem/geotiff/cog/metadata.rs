//! What GIS programs show of a raster beside its numbers: names, units, colours.

use super::options::{CogBand, CogClass};

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Names and units of the bands, and the names of the first one's classes, as GDAL's metadata tag.
/// GDAL takes marks off twice, as XML and as texts of its own.
pub(super) fn metadata_xml(bands: &[CogBand], classes: &[CogClass]) -> String {
    let item = |name: &str, idx: usize, role: &str, text: &str| {
        format!("<Item name=\"{name}\" sample=\"{idx}\"{role}>{}</Item>", escaped(&escaped(text)))
    };
    let mut xml = "<GDALMetadata>".to_owned();
    for (idx, band) in bands.iter().enumerate() {
        xml += &item("DESCRIPTION", idx, " role=\"description\"", &band.name);
        if !band.unit.is_empty() {
            xml += &item("UNITTYPE", idx, " role=\"unittype\"", &band.unit);
        }
    }
    for class in classes {
        xml += &item(&format!("CLASS_{}", class.number), 0, "", &class.name);
    }
    xml + "</GDALMetadata>"
}

/// TIFF's table of colours for bytes: all reds, greens and blues in 16 bits; numbers without a class are black.
pub(super) fn color_map(classes: &[CogClass]) -> Vec<u16> {
    let mut table = vec![0; 3 * 256];
    for class in classes {
        for (channel, value) in class.color.into_iter().enumerate() {
            table[256 * channel + usize::from(class.number)] = u16::from(value) * 257;
        }
    }
    table
}

/// The names of the first band's classes as the text of GDAL's file beside a raster (`NAME.tif.aux.xml`): a GeoTIFF itself
/// has no place in which GDAL, and QGIS with it, looks for names of categories.
pub fn category_names(classes: &[CogClass]) -> String {
    let last = classes.iter().map(|class| class.number).max().unwrap_or(0);
    let name =
        |number: u8| classes.iter().find(|class| class.number == number).map_or("", |class| &class.name);
    let names: String =
        (0..=last).map(|number| format!("      <Category>{}</Category>\n", escaped(name(number)))).collect();
    format!(
        "<PAMDataset>\n  <PAMRasterBand band=\"1\">\n    <CategoryNames>\n{names}    </CategoryNames>\n  </PAMRasterBand>\n</PAMDataset>\n"
    )
}
