//! GDAL's metadata tag: scale, offset, unit and name of a band.

use crate::Error;
use crate::dem::info::HeightUnit;
use crate::tiff::sidecar::Sidecar;
use std::path::Path;

/// What the tag says about one band.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct GdalMetadata {
    pub(super) scale: f64,
    pub(super) offset: f64,
    pub(super) unit: Option<String>,
    pub(super) band_name: Option<String>,
}

impl GdalMetadata {
    /// From the XML of the tag; what cannot be read is not there (the tag is a comment to any other program).
    pub(super) fn parse(xml: &str, band_idx: usize) -> Self {
        let mut found = Self { scale: 1.0, offset: 0.0, unit: None, band_name: None };
        let Ok(document) = roxmltree::Document::parse(xml.trim()) else { return found };
        for item in document.descendants().filter(|node| node.has_tag_name("Item")) {
            let sample = item.attribute("sample").and_then(|text| text.parse().ok());
            if sample != Some(band_idx) {
                continue;
            }
            let text = item.text().unwrap_or("").trim();
            let number = || text.parse::<f64>().ok().filter(|v| v.is_finite());
            match item.attribute("role") {
                Some("scale") => found.scale = number().filter(|v| *v != 0.0).unwrap_or(1.0),
                Some("offset") => found.offset = number().unwrap_or(0.0),
                Some("unittype") => found.unit = Some(text.to_owned()).filter(|unit| !unit.is_empty()),
                // GDAL marks its texts before XML does.
                Some("description") => {
                    let name = text.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
                    found.band_name = Some(name);
                }
                _ => {}
            }
        }
        found
    }

    /// The same with what stands in the file beside, which GDAL believes first.
    pub(super) fn overridden(mut self, sidecar: Option<&Sidecar>) -> Self {
        if let Some(beside) = sidecar {
            self.scale = beside.scale.unwrap_or(self.scale);
            self.offset = beside.offset.unwrap_or(self.offset);
            self.unit = beside.unit.clone().or(self.unit);
            self.band_name = beside.band_name.clone().or(self.band_name);
        }
        self
    }
}

/// The unit of a band.
pub(super) fn height_unit(path: &Path, text: &str) -> Result<HeightUnit, Error> {
    HeightUnit::parse(text).ok_or_else(|| Error::Unsupported {
        path: path.to_owned(),
        what: "height unit",
        found: text.to_owned(),
        supported: "metres and kilometres",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_of_the_band_are_found() {
        let xml = r#"<GDALMetadata>
            <Item name="OFFSET" sample="0" role="offset">1737400</Item>
            <Item name="SCALE" sample="0" role="scale">0.5</Item>
            <Item name="UNITTYPE" sample="1" role="unittype">km</Item>
            <Item name="DESCRIPTION" sample="1" role="description">height</Item>
            <Item name="SOURCE">LOLA</Item></GDALMetadata>"#;
        let first = GdalMetadata::parse(xml, 0);
        assert_eq!((first.scale, first.offset, first.unit), (0.5, 1_737_400.0, None));
        let second = GdalMetadata::parse(xml, 1);
        assert_eq!((second.scale, second.offset), (1.0, 0.0));
        assert_eq!(second.band_name.as_deref(), Some("height"));
        let path = Path::new("x");
        assert_eq!(height_unit(path, second.unit.as_deref().unwrap()).unwrap(), HeightUnit::Kilometre);
        assert!(height_unit(path, "US survey foot").is_err());
        assert_eq!(GdalMetadata::parse("<broken", 0).scale, 1.0);
    }
}
