//! Where the files of a pair lie. Every byte of a pair is read here: what holds pairs in another way than in folders is told
//! apart here and nowhere else.

use crate::Error;
use crate::pair::parse_json;
use selenograph_files::regular;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The place of a pair's files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    folder: PathBuf,
}

impl Place {
    /// A folder.
    pub fn folder(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// The folder's own name.
    pub fn name(&self) -> String {
        self.folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }

    /// What a file here is called in messages.
    pub fn path(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// The place itself, in messages.
    pub fn root(&self) -> &Path {
        &self.folder
    }

    /// Whether a file is here.
    pub fn has(&self, file: &str) -> bool {
        self.path(file).is_file()
    }

    /// Bytes in a file; 0 where it is not here.
    pub fn size(&self, file: &str) -> u64 {
        std::fs::metadata(self.path(file)).map_or(0, |metadata| metadata.len())
    }

    /// A whole file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn read(&self, file: &str) -> Result<Vec<u8>, Error> {
        let path = self.path(file);
        regular::read(&path, regular::ANY_LENGTH).map_err(Error::io("read", &path))
    }
}

/// The folders in a folder, by name.
pub(super) fn folders(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = std::fs::read_dir(folder).map_err(Error::io("read", folder))?;
    let paths: Result<Vec<_>, _> = entries.map(|entry| Ok(entry?.path())).collect();
    let mut found = paths.map_err(Error::io("read", folder))?;
    found.retain(|path| path.is_dir());
    found.sort();
    Ok(found)
}

/// The files of a pair whose record is known.
pub(crate) struct Files<'a> {
    pub place: &'a Place,
    /// Checksums by name, where there is a record: BLAKE3, hex.
    pub sums: Option<&'a BTreeMap<String, String>>,
    /// Whether what is read is compared with them.
    pub verify: bool,
}

impl Files<'_> {
    /// A whole file; one that no record names is never another.
    pub fn read(&self, file: &str) -> Result<Vec<u8>, Error> {
        let bytes = self.place.read(file)?;
        let told = self.sums.and_then(|sums| sums.get(file)).filter(|_| self.verify);
        if told.is_none_or(|sum| blake3::hash(&bytes).to_hex().as_str() == sum) {
            return Ok(bytes);
        }
        Err(Error::Changed { path: self.place.path(file), num_bytes: bytes.len() })
    }

    /// A JSON record.
    pub fn json<T: DeserializeOwned>(&self, file: &str) -> Result<T, Error> {
        parse_json(&self.read(file)?, &self.place.path(file))
    }
}
