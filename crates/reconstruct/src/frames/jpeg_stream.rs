//! JPEG pictures one after the other: where each ends is told by its markers, so that a thumbnail inside is no end.

use crate::Error;
use std::io::BufRead;
use std::path::Path;

/// A larger picture is refused: it would be no frame of a video.
const MAX_BYTES: usize = 1 << 28;
const START: u8 = 0xd8;
const END: u8 = 0xd9;
const SCAN: u8 = 0xda;

/// Bytes of a picture in the making.
struct Reader<'a, S> {
    source: &'a mut S,
    origin: &'a Path,
    bytes: Vec<u8>,
}

impl<S: BufRead> Reader<'_, S> {
    /// The next byte; `None` where the stream ends or the picture is too large.
    fn next(&mut self) -> Result<Option<u8>, Error> {
        let buffer = self.source.fill_buf().map_err(Error::io("read", self.origin))?;
        let Some(byte) = buffer.first().copied().filter(|_| self.bytes.len() < MAX_BYTES) else {
            return Ok(None);
        };
        self.source.consume(1);
        self.bytes.push(byte);
        Ok(Some(byte))
    }

    /// The code of the marker at hand: fill bytes (0xff) before it are passed.
    fn marker(&mut self) -> Result<Option<u8>, Error> {
        loop {
            match self.next()? {
                Some(0xff) => {}
                other => return Ok(other),
            }
        }
    }

    /// Entropy-coded data up to the next marker that is none of its own.
    fn scan(&mut self) -> Result<Option<u8>, Error> {
        loop {
            match self.next()? {
                None => return Ok(None),
                Some(0xff) => match self.marker()? {
                    // A stuffed zero, and restart markers, belong to the data.
                    Some(0x00 | 0xd0..=0xd7) => {}
                    other => return Ok(other),
                },
                Some(_) => {}
            }
        }
    }

    /// A segment: its length counts itself.
    fn segment(&mut self) -> Result<Option<()>, Error> {
        let (Some(high), Some(low)) = (self.next()?, self.next()?) else { return Ok(None) };
        for _ in 2..u16::from_be_bytes([high, low]).max(2) {
            if self.next()?.is_none() {
                return Ok(None);
            }
        }
        Ok(Some(()))
    }

    /// From the start marker to the end marker.
    fn picture(&mut self) -> Result<Option<()>, Error> {
        let mut code = self.marker()?;
        if code != Some(START) {
            return Ok(None);
        }
        code = match self.next()? {
            Some(0xff) => self.marker()?,
            _ => None,
        };
        loop {
            code = match code {
                None => return Ok(None),
                Some(END) => return Ok(Some(())),
                Some(marker) => {
                    if self.segment()?.is_none() {
                        return Ok(None);
                    }
                    if marker == SCAN {
                        self.scan()?
                    } else {
                        match self.next()? {
                            Some(0xff) => self.marker()?,
                            _ => None,
                        }
                    }
                }
            };
        }
    }
}

/// The bytes of the next picture; `None` at the end of the stream. What stands between pictures is passed.
pub(super) fn read_picture<S: BufRead>(
    source: &mut S,
    origin: &Path,
    frame_idx: usize,
) -> Result<Option<Vec<u8>>, Error> {
    loop {
        let buffer = source.fill_buf().map_err(Error::io("read", origin))?;
        match buffer.first() {
            None => return Ok(None),
            Some(0xff) => break,
            Some(_) => source.consume(1),
        }
    }
    let mut reader = Reader { source, origin, bytes: Vec::new() };
    match reader.picture()? {
        Some(()) => Ok(Some(reader.bytes)),
        None => Err(Error::Truncated { path: origin.to_owned(), num_whole: frame_idx }),
    }
}
