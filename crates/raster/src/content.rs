//! What a file is, from its first bytes: names tell nothing.

use crate::Error;
use selenograph_files::regular;
use std::io::Read as _;
use std::path::Path;

/// Bytes that tell the format of a file.
const SNIFF_BYTES: u64 = 4096;

/// What a file looks like.
pub(crate) enum Content {
    Png,
    Jpeg,
    Pgm,
    Tiff,
    Pds3,
    Xml,
    /// A cube of ISIS 3 or its detached label.
    Isis,
    /// Something with a name of its own that is not read here.
    Named(&'static str),
    /// Nothing known: the samples of a label beside it, or anything.
    Unknown(String),
}

impl Content {
    /// The name for people.
    pub(crate) fn name(&self) -> String {
        match self {
            Self::Png => "a PNG picture",
            Self::Jpeg => "a JPEG picture",
            Self::Pgm => "a PGM picture",
            Self::Tiff => "a TIFF file",
            Self::Pds3 => "a PDS3 label",
            Self::Xml => "an XML file",
            Self::Isis => "an ISIS cube or its label",
            Self::Named(name) => name,
            Self::Unknown(bytes) => bytes,
        }
        .to_owned()
    }

    /// Whether a label beside the file may say what it is.
    pub(crate) fn is_raw(&self) -> bool {
        matches!(self, Self::Named(_) | Self::Unknown(_))
    }
}

/// Looks at the first bytes of a regular file.
///
/// # Errors
/// [`Error::Io`].
pub(crate) fn content_of(path: &Path) -> Result<Content, Error> {
    let mut head = Vec::new();
    let (file, _) = regular::open(path).map_err(Error::io("open", path))?;
    file.take(SNIFF_BYTES).read_to_end(&mut head).map_err(Error::io("read", path))?;
    Ok(match head.as_slice() {
        [] => Content::Named("an empty file"),
        [0x89, b'P', b'N', b'G', ..] => Content::Png,
        [0xFF, 0xD8, 0xFF, ..] => Content::Jpeg,
        [b'P', b'2' | b'5', blank, ..] if blank.is_ascii_whitespace() => Content::Pgm,
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Content::Tiff,
        [b'P', b'1' | b'4', blank, ..] if blank.is_ascii_whitespace() => Content::Named("a PBM picture"),
        [b'P', b'3' | b'6', blank, ..] if blank.is_ascii_whitespace() => Content::Named("a PPM picture"),
        [b'G', b'I', b'F', b'8', ..] => Content::Named("a GIF picture"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Content::Named("a WebP picture"),
        [0, 0, 0, 12, b'j', b'P', ..] => Content::Named("a JPEG 2000 picture"),
        [0x76, 0x2F, 0x31, 0x01, ..] => Content::Named("an OpenEXR picture"),
        [0x89, b'H', b'D', b'F', ..] => Content::Named("an HDF5 file"),
        [b'%', b'P', b'D', b'F', ..] => Content::Named("a PDF document"),
        _ => content_of_text(&head),
    })
}

fn content_of_text(head: &[u8]) -> Content {
    let text = String::from_utf8_lossy(head);
    let start = text.trim_start_matches('\u{feff}').trim_start();
    if start.starts_with('<') {
        Content::Xml
    } else if is_isis_label(start) {
        Content::Isis
    } else if text.contains("PDS_VERSION_ID") {
        Content::Pds3
    } else if start.starts_with("LBLSIZE=") {
        Content::Named("a VICAR picture")
    } else if start.starts_with("SIMPLE  =") {
        Content::Named("a FITS file")
    } else if start.starts_with("CCSD3ZF") && text.contains("^QUBE") {
        Content::Named("a cube of ISIS 2")
    } else {
        let bytes: Vec<String> = head.iter().take(4).map(|b| format!("{b:02x}")).collect();
        Content::Unknown(format!("bytes {}", bytes.join(" ")))
    }
}

/// Whether a text is the beginning of a cube's label: its first statement is `Object = IsisCube`, behind comments.
fn is_isis_label(text: &str) -> bool {
    let mut rest = text;
    loop {
        rest = rest.trim_start();
        rest = match (rest.strip_prefix("/*"), rest.strip_prefix('#')) {
            (Some(comment), _) => comment.split_once("*/").map_or("", |(_, after)| after),
            (_, Some(comment)) => comment.split_once('\n').map_or("", |(_, after)| after),
            _ => break,
        };
    }
    let Some((key, value)) = rest.split_once('=') else { return false };
    let value = value.trim_start().as_bytes();
    key.trim().eq_ignore_ascii_case("object")
        && value.get(..8).is_some_and(|name| name.eq_ignore_ascii_case(b"isiscube"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn isis_labels_are_told_from_those_of_pds3() {
        for text in ["Object = IsisCube\n", "# made by hand\n/* a */ OBJECT=ISISCUBE\r\n Object = Core"] {
            assert!(matches!(content_of_text(text.as_bytes()), Content::Isis), "{text}");
        }
        // A cube that was made from a PDS3 product quotes its label.
        let quoting = b"Object = IsisCube\n Group = Archive\n  A = \"PDS_VERSION_ID = PDS3\"";
        assert!(matches!(content_of_text(quoting), Content::Isis));
        assert!(matches!(content_of_text(b"PDS_VERSION_ID = PDS3\r\nOBJECT = IMAGE"), Content::Pds3));
        let qube = b"CCSD3ZF0000100000001NJPL3IF0PDS200000001 = SFDU_LABEL\r\n^QUBE = 3";
        assert!(matches!(content_of_text(qube), Content::Named("a cube of ISIS 2")));
    }
}
