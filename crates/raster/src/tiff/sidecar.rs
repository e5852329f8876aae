//! GDAL's `.aux.xml` beside a file: what could not be written into it.

use crate::Error;
use selenograph_files::regular;
use std::path::{Path, PathBuf};

/// Such files are a few kilobytes; histograms make some longer.
const MAX_BYTES: u64 = 64 << 20;

/// What the file beside says about one band.
#[derive(Debug, Default, Clone, PartialEq)]
pub(crate) struct Sidecar {
    pub(crate) path: PathBuf,
    pub(crate) nodata: Option<String>,
    pub(crate) scale: Option<f64>,
    pub(crate) offset: Option<f64>,
    pub(crate) unit: Option<String>,
    pub(crate) band_name: Option<String>,
    /// Corner-based, in GDAL's order.
    pub(crate) transform: Option<[f64; 6]>,
    /// Whether a coordinate system stands there (as well-known text, which is not read).
    pub(crate) has_system: bool,
}

/// The file of that name with another ending behind it: `a.tif` → `a.tif.msk`.
pub(crate) fn beside(path: &Path, ending: &str) -> Option<PathBuf> {
    let mut name = path.file_name()?.to_owned();
    name.push(ending);
    let beside = path.with_file_name(name);
    beside.exists().then_some(beside)
}

/// Reads `<path>.aux.xml`; `None` if there is none.
///
/// # Errors
/// [`Error::Io`]; [`Error::Malformed`] for XML that is broken.
pub(crate) fn read(path: &Path, band_idx: usize) -> Result<Option<Sidecar>, Error> {
    let Some(path) = beside(path, ".aux.xml") else { return Ok(None) };
    let bytes = regular::read(&path, MAX_BYTES).map_err(Error::io("read", &path))?;
    let text = String::from_utf8_lossy(&bytes);
    let document =
        roxmltree::Document::parse(text.trim_start_matches('\u{feff}')).map_err(|e| Error::Malformed {
            path: path.clone(),
            what: "GDAL's metadata".to_owned(),
            expected: "well-formed XML".to_owned(),
            found: e.to_string(),
        })?;
    let mut found = Sidecar { path: path.clone(), ..Sidecar::default() };
    for node in document.root_element().children() {
        let text = node.text().unwrap_or("").trim();
        match node.tag_name().name() {
            "SRS" => found.has_system = !text.is_empty(),
            "GeoTransform" => {
                let numbers: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
                found.transform = numbers.and_then(|v| v.try_into().ok());
            }
            "PAMRasterBand" if node.attribute("band").and_then(|b| b.parse().ok()) == Some(band_idx + 1) => {
                found.take_band(node);
            }
            _ => {}
        }
    }
    Ok(Some(found))
}

impl Sidecar {
    fn take_band(&mut self, band: roxmltree::Node) {
        for node in band.children() {
            let text = node.text().unwrap_or("").trim();
            let number = || text.parse::<f64>().ok().filter(|v| v.is_finite());
            match node.tag_name().name() {
                "NoDataValue" => self.nodata = Some(text.to_owned()),
                "Scale" => self.scale = number().filter(|v| *v != 0.0),
                "Offset" => self.offset = number(),
                "UnitType" => self.unit = Some(text.to_owned()).filter(|unit| !unit.is_empty()),
                "Description" => self.band_name = Some(text.to_owned()),
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_gdal_puts_beside_a_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        assert_eq!(read(&path, 0).unwrap(), None);
        let xml = "<PAMDataset><SRS>PROJCS[]</SRS><GeoTransform> 1.0e+02, 5, 0, 200, 0,-5</GeoTransform>\
            <PAMRasterBand band=\"1\"><NoDataValue>-1</NoDataValue></PAMRasterBand>\
            <PAMRasterBand band=\"2\"><NoDataValue>-32768</NoDataValue><Offset>3</Offset><Scale>0.5</Scale>\
            <UnitType>km</UnitType></PAMRasterBand></PAMDataset>";
        std::fs::write(dir.path().join("a.tif.aux.xml"), xml).unwrap();
        let second = read(&path, 1).unwrap().unwrap();
        assert_eq!(second.nodata.as_deref(), Some("-32768"));
        assert_eq!((second.scale, second.offset, second.unit.as_deref()), (Some(0.5), Some(3.0), Some("km")));
        assert_eq!((second.transform, second.has_system), (Some([100.0, 5.0, 0.0, 200.0, 0.0, -5.0]), true));
        std::fs::write(dir.path().join("a.tif.aux.xml"), "<PAMDataset>").unwrap();
        assert!(matches!(read(&path, 1), Err(Error::Malformed { .. })));
    }
}
