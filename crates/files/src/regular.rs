//! The door for files that are read: regular ones, no longer than stated, whatever the name leads to.
//!
//! A pipe blocks whoever opens it and a device such as `/dev/zero` never ends, so both are refused before they are opened.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Texts that people write (campaigns, cameras, plans): longer ones are not theirs.
pub const MAX_TEXT_BYTES: u64 = 256 << 20;
/// For files whose length their own reader judges.
pub const ANY_LENGTH: u64 = u64::MAX;

/// Opens a regular file; with its length.
///
/// # Errors
/// What the system says; [`ErrorKind::InvalidInput`] for a folder, a pipe, a socket or a device.
pub fn open(path: &Path) -> Result<(File, u64)> {
    refuse_special(&std::fs::metadata(path)?)?;
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    refuse_special(&metadata)?;
    Ok((file, metadata.len()))
}

/// All bytes of a regular file of at most `max_bytes`.
///
/// # Errors
/// As [`open`]; [`ErrorKind::FileTooLarge`]; [`ErrorKind::OutOfMemory`] for one that this machine cannot hold.
pub fn read(path: &Path, max_bytes: u64) -> Result<Vec<u8>> {
    let (file, length) = open(path)?;
    if length > max_bytes {
        let what = format!("the file has {length} bytes; at most {max_bytes} are read of its kind");
        return Err(Error::new(ErrorKind::FileTooLarge, what));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(length).unwrap_or(usize::MAX))?;
    file.take(max_bytes).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a regular file of at most 256 MiB.
///
/// # Errors
/// As [`read`]; [`ErrorKind::InvalidData`] where it is no UTF-8.
pub fn read_to_string(path: &Path) -> Result<String> {
    String::from_utf8(read(path, MAX_TEXT_BYTES)?)
        .map_err(|e| Error::new(ErrorKind::InvalidData, format!("no UTF-8 text: {}", e.utf8_error())))
}

fn refuse_special(metadata: &std::fs::Metadata) -> Result<()> {
    let kind = metadata.file_type();
    if kind.is_file() {
        return Ok(());
    }
    let what = if kind.is_dir() { "a folder" } else { "a pipe, socket or device" };
    Err(Error::new(ErrorKind::InvalidInput, format!("{what}, not a regular file")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_a_stated_length_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        std::fs::write(&path, "four").unwrap();
        assert_eq!(read(&path, 4).unwrap(), b"four");
        assert_eq!(read(&path, 3).unwrap_err().kind(), ErrorKind::FileTooLarge);
        assert_eq!(open(dir.path()).unwrap_err().kind(), ErrorKind::InvalidInput);
        std::fs::write(&path, [0xFF, 0xFE]).unwrap();
        assert_eq!(read_to_string(&path).unwrap_err().kind(), ErrorKind::InvalidData);
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_refused_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let pipe = dir.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        for path in [pipe.as_path(), Path::new("/dev/zero")] {
            assert_eq!(read(path, 9).unwrap_err().kind(), ErrorKind::InvalidInput, "{}", path.display());
            assert!(matches!(crate::checksum::of_file(path), Err(crate::Error::Io { .. })));
            assert!(matches!(crate::record::read(path), Err(crate::Error::Io { .. })));
        }
    }
}
