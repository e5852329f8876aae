//! Tensors in a file, and the file.

use crate::Error;
use crate::element::ElementType;
use crate::zip::{ReadAt, Span};
use selenograph_files::regular;
use std::fs::File;
use std::io::ErrorKind;
use std::path::Path;

/// Bytes read and converted at a time.
const CHUNK_BYTES: usize = 1 << 18;

/// A file, or one that came with the program, that is read at any place, by any number of threads.
#[derive(Debug)]
pub(super) struct Source {
    kind: Kind,
    len: u64,
}

#[derive(Debug)]
enum Kind {
    #[cfg(unix)]
    File(File),
    #[cfg(not(unix))]
    File(std::sync::Mutex<File>),
    Bytes(&'static [u8]),
}

impl Source {
    pub fn open(path: &Path) -> Result<Self, Error> {
        let (file, len) = regular::open(path).map_err(|error| match error.kind() {
            ErrorKind::InvalidInput => {
                Error::NotACheckpoint { path: path.to_owned(), expected: "a file", found: error.to_string() }
            }
            _ => Error::io("open", path)(error),
        })?;
        #[cfg(not(unix))]
        let file = std::sync::Mutex::new(file);
        Ok(Self { kind: Kind::File(file), len })
    }

    pub fn bytes(bytes: &'static [u8]) -> Self {
        Self { kind: Kind::Bytes(bytes), len: bytes.len() as u64 }
    }
}

impl ReadAt for Source {
    fn len(&self) -> u64 {
        self.len
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> std::io::Result<()> {
        match &self.kind {
            #[cfg(unix)]
            Kind::File(file) => std::os::unix::fs::FileExt::read_exact_at(file, buffer, offset),
            #[cfg(not(unix))]
            Kind::File(file) => {
                use std::io::{Read, Seek, SeekFrom};
                let mut file = file.lock().map_err(|_| std::io::Error::other("another reader failed"))?;
                file.seek(SeekFrom::Start(offset))?;
                file.read_exact(buffer)
            }
            Kind::Bytes(bytes) => {
                let start = usize::try_from(offset).ok();
                let found = start.and_then(|start| bytes.get(start..start.checked_add(buffer.len())?));
                buffer.copy_from_slice(found.ok_or(ErrorKind::UnexpectedEof)?);
                Ok(())
            }
        }
    }
}

/// A tensor in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredTensor {
    /// Type of its elements.
    pub element: ElementType,
    /// Sizes, the slowest first.
    pub shape: Vec<usize>,
    /// Bytes of its first element to the last, for a contiguous one; of its whole storage otherwise.
    span: Span,
    /// First element in the span and elements from one to the next along each side; `None` if contiguous.
    strided: Option<(u64, Vec<u64>)>,
}

impl StoredTensor {
    pub(super) fn contiguous(element: ElementType, shape: Vec<usize>, span: Span) -> Self {
        Self { element, shape, span, strided: None }
    }

    /// A view of a storage; its extent has been checked against it.
    pub(super) fn view(
        element: ElementType,
        shape: Vec<usize>,
        storage: Span,
        offset: u64,
        strides: Vec<u64>,
    ) -> Self {
        let size = element.size() as u64;
        let len = shape.iter().product::<usize>() as u64;
        if is_row_major(&shape, &strides) || len == 0 {
            let start = if len == 0 { storage.start } else { storage.start + offset * size };
            let span = Span { start, len: len * size };
            return Self { element, shape, span, strided: None };
        }
        Self { element, shape, span: storage, strided: Some((offset, strides)) }
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether both are the same bytes of the file.
    pub(super) fn shares_bytes(&self, other: &Self) -> bool {
        self.span == other.span && self.strided == other.strided
    }

    pub(super) fn read_into(&self, source: &Source, path: &Path, values: &mut Vec<f32>) -> Result<(), Error> {
        values.clear();
        values.resize(self.len(), 0.0);
        match &self.strided {
            None => self.read_run(source, path, self.span.start, values),
            Some((offset, strides)) => self.gather(source, path, *offset, strides, values),
        }
    }

    fn read_run(&self, source: &Source, path: &Path, start: u64, values: &mut [f32]) -> Result<(), Error> {
        let size = self.element.size();
        let mut buffer = vec![0; CHUNK_BYTES.min(values.len() * size)];
        let mut at = start;
        for chunk in values.chunks_mut(CHUNK_BYTES / size) {
            let bytes = &mut buffer[..chunk.len() * size];
            source.read_at(at, bytes).map_err(Error::io("read", path))?;
            self.element.decode(bytes, chunk);
            at += bytes.len() as u64;
        }
        Ok(())
    }

    /// Reads the whole storage, which a tensor that is stored transposed covers.
    fn gather(
        &self,
        source: &Source,
        path: &Path,
        offset: u64,
        strides: &[u64],
        values: &mut [f32],
    ) -> Result<(), Error> {
        let mut storage = vec![0.0; (self.span.len / self.element.size() as u64) as usize];
        self.read_run(source, path, self.span.start, &mut storage)?;
        let mut index = vec![0usize; self.shape.len()];
        let mut at = offset as usize;
        for value in values {
            *value = storage[at];
            for side in (0..index.len()).rev() {
                index[side] += 1;
                at += strides[side] as usize;
                if index[side] < self.shape[side] {
                    break;
                }
                at -= strides[side] as usize * index[side];
                index[side] = 0;
            }
        }
        Ok(())
    }
}

fn is_row_major(shape: &[usize], strides: &[u64]) -> bool {
    let mut expected = 1;
    for (size, stride) in shape.iter().zip(strides).rev() {
        if *size != 1 && *stride != expected {
            return false;
        }
        expected *= *size as u64;
    }
    true
}
