//! A finer model's raw rows on disk, between the pass that looks at them and the pass that fits them.

use crate::Error;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Raw node rows kept on disk between the two passes.
pub(super) struct Scratch {
    path: PathBuf,
    file: File,
    cols: usize,
}

impl Scratch {
    pub fn create(folder: &Path, cols: usize) -> Result<Self, Error> {
        let path = folder.join("nest.scratch");
        let mut open = File::options();
        let file = open.read(true).write(true).create(true).truncate(true).open(&path);
        Ok(Self { file: file.map_err(Error::io("create", &path))?, path, cols })
    }

    pub fn push(&mut self, nodes: &[f32]) -> Result<(), Error> {
        let bytes: Vec<u8> = nodes.iter().flat_map(|v| v.to_le_bytes()).collect();
        Ok(self.file.write_all(&bytes).map_err(selenograph_files::Error::io("write", &self.path))?)
    }

    pub fn read(&mut self, first_row: usize, num_rows: usize) -> Result<Vec<f32>, Error> {
        let mut bytes = vec![0u8; 4 * num_rows * self.cols];
        let offset = 4 * (first_row as u64) * (self.cols as u64);
        self.file
            .seek(SeekFrom::Start(offset))
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(Error::io("read", &self.path))?;
        Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    pub fn remove(self) -> Result<(), Error> {
        std::fs::remove_file(&self.path).map_err(Error::io("remove", &self.path))
    }
}
