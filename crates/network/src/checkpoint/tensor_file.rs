//! Any tensors in a safetensors file, such as the state of an optimiser.

use super::tensors::{Source, StoredTensor};
use crate::{Error, safetensors};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A safetensors file that need not be a network's; values are read by [`TensorFile::read`].
#[derive(Debug)]
pub struct TensorFile {
    path: PathBuf,
    source: Source,
    tensors: BTreeMap<String, StoredTensor>,
    metadata: BTreeMap<String, String>,
}

impl TensorFile {
    /// Opens a file.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::NotACheckpoint`], [`Error::Truncated`], [`Error::Malformed`], [`Error::Refused`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        let source = Source::open(path)?;
        let header = safetensors::read_header(&source, path)?;
        let stored = |(entry, span): (safetensors::Entry, _)| {
            (entry.name, StoredTensor::contiguous(entry.element, entry.shape, span))
        };
        let tensors = header.tensors.into_iter().map(stored).collect();
        Ok(Self { path: path.to_owned(), source, tensors, metadata: header.metadata })
    }

    /// Names and shapes, in order of the names.
    pub fn tensors(&self) -> impl Iterator<Item = (&str, &[usize])> {
        self.tensors.iter().map(|(name, tensor)| (name.as_str(), tensor.shape.as_slice()))
    }

    /// Texts of the header.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Values of a tensor.
    ///
    /// # Errors
    /// [`Error::MissingTensor`], [`Error::Io`].
    pub fn read(&self, name: &str) -> Result<Vec<f32>, Error> {
        let missing = || Error::MissingTensor { path: self.path.clone(), name: name.to_owned() };
        let tensor = self.tensors.get(name).ok_or_else(missing)?;
        let mut values = Vec::new();
        tensor.read_into(&self.source, &self.path, &mut values)?;
        Ok(values)
    }
}
