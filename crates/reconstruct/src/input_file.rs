//! What a user's file must be before it is read as text.

use crate::Error;
use selenograph_files::regular;
use std::path::Path;

/// The text of a regular file of at most 256 MiB, without a byte order mark.
///
/// # Errors
/// [`Error::Io`] for what is no regular file or longer; [`Error::Format`] for what is no text.
pub(crate) fn read_text(path: &Path) -> Result<String, Error> {
    text_of(path, &regular::read(path, regular::MAX_TEXT_BYTES).map_err(Error::io("read", path))?)
}

/// Bytes as text, without a byte order mark. A letter of an older encoding in a comment is no reason to refuse a file.
///
/// # Errors
/// [`Error::Format`] for bytes that no text has.
pub(crate) fn text_of(path: &Path, bytes: &[u8]) -> Result<String, Error> {
    let is_control = |byte: &u8| *byte < b' ' && !matches!(byte, b'\t' | b'\n' | b'\r' | 0x0c);
    if let Some(at) = bytes.iter().position(is_control) {
        return Err(Error::Format {
            path: path.to_owned(),
            expected: "text (UTF-8)".to_owned(),
            found: format!("byte 0x{:02x} at {at}, which no text has", bytes[at]),
        });
    }
    let text = String::from_utf8_lossy(bytes);
    Ok(text.strip_prefix('\u{feff}').unwrap_or(&text).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_file_or_no_text_is_refused_in_a_true_line() {
        let dir = tempfile::tempdir().unwrap();
        let refused = |path: &Path| read_text(path).unwrap_err().to_string();
        assert!(refused(dir.path()).contains("a folder"));
        let path = dir.path().join("x");
        std::fs::write(&path, b"a\0b").unwrap();
        assert!(refused(&path).contains("0x00 at 1"), "{}", refused(&path));
        std::fs::write(&path, "\u{feff}a").unwrap();
        assert_eq!(read_text(&path).unwrap(), "a");
    }
}
