//! A stream of video, recognised by its first bytes.

use super::{jpeg_stream, y4m};
use crate::Error;
use selenograph_raster::codec::{Picture, jpeg};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// The streams that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StreamFormat {
    /// YUV4MPEG2, uncompressed; only the luma is read.
    Y4m,
    /// JPEG pictures one after the other.
    Mjpeg,
}

/// Frames of a stream, one at a time.
///
/// The iterator ends after the stream's last whole frame; a frame that cannot be decoded is an error in its place and the next one
/// follows, a stream that ends inside a frame is one last error ([`Error::Truncated`]).
pub struct FrameStream<R> {
    source: BufReader<R>,
    origin: PathBuf,
    kind: Kind,
    frame_idx: usize,
    ended: bool,
}

enum Kind {
    Y4m(y4m::Header),
    Mjpeg,
}

impl<R: Read> FrameStream<R> {
    /// Reads the beginning of a stream; `origin` names it in errors.
    ///
    /// # Errors
    /// [`Error::Format`] if it is no stream that is read here; [`Error::Io`].
    pub fn open(source: R, origin: &Path) -> Result<Self, Error> {
        let mut source = BufReader::with_capacity(1 << 16, source);
        let start = source.fill_buf().map_err(Error::io("read", origin))?;
        let found = match start {
            [] => Some("nothing".to_owned()),
            _ if start.starts_with(&y4m::MAGIC[..start.len().min(y4m::MAGIC.len())]) => None,
            [0xff, 0xd8, ..] => None,
            _ => Some("something else".to_owned()),
        };
        if let Some(found) = found {
            let expected = "a YUV4MPEG2 stream or JPEG pictures one after the other".to_owned();
            return Err(Error::Format { path: origin.to_owned(), expected, found });
        }
        let kind =
            if start[0] == 0xff { Kind::Mjpeg } else { Kind::Y4m(y4m::Header::read(&mut source, origin)?) };
        Ok(Self { source, origin: origin.to_owned(), kind, frame_idx: 0, ended: false })
    }

    /// What kind of stream it is.
    pub fn format(&self) -> StreamFormat {
        match self.kind {
            Kind::Y4m(_) => StreamFormat::Y4m,
            Kind::Mjpeg => StreamFormat::Mjpeg,
        }
    }

    /// The next frame; those that are not `wanted` are passed over without decoding them.
    fn read_frame(&mut self, wanted: bool) -> Result<Option<Option<Picture>>, Error> {
        match &self.kind {
            Kind::Y4m(header) => header.read_frame(&mut self.source, &self.origin, self.frame_idx, wanted),
            Kind::Mjpeg => {
                let bytes = jpeg_stream::read_picture(&mut self.source, &self.origin, self.frame_idx)?;
                let Some(bytes) = bytes else { return Ok(None) };
                if !wanted {
                    return Ok(Some(None));
                }
                Ok(Some(Some(jpeg::decode(&bytes, &self.origin)?)))
            }
        }
    }

    /// The next frame with its index; frames that `wants` refuses are counted and passed over. `None` at the end.
    pub fn next_wanted(
        &mut self,
        mut wants: impl FnMut(usize) -> bool,
    ) -> Option<(usize, Result<Picture, Error>)> {
        while !self.ended {
            let frame_idx = self.frame_idx;
            let frame = self.read_frame(wants(frame_idx));
            self.frame_idx += 1;
            match frame {
                Ok(None) => self.ended = true,
                Ok(Some(None)) => {}
                Ok(Some(Some(picture))) => return Some((frame_idx, Ok(picture))),
                Err(error) => {
                    // After a picture that cannot be decoded the stream goes on; after its end or a fault of the system it does not.
                    self.ended = !matches!(error, Error::Raster(_));
                    return Some((frame_idx, Err(error)));
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_raster::Raster;

    fn frames(bytes: &[u8]) -> Vec<(usize, Result<Picture, Error>)> {
        let mut stream = FrameStream::open(bytes, Path::new("stdin")).unwrap();
        std::iter::from_fn(|| stream.next_wanted(|_| true)).collect()
    }

    fn y4m(colour: &str, frame: &[u8], count: usize) -> Vec<u8> {
        let mut bytes = format!("YUV4MPEG2 W3 H2 F25:1 Ip A1:1 {colour}\n").into_bytes();
        for _ in 0..count {
            bytes.extend_from_slice(b"FRAME\n");
            bytes.extend_from_slice(frame);
        }
        bytes
    }

    #[test]
    fn luma_of_y4m_in_every_layout() {
        // Chroma of odd sides is rounded up: 2×1 samples each for 4:2:0.
        for (colour, chroma) in
            [("C420jpeg", 4), ("", 4), ("C422", 8), ("C444", 12), ("Cmono", 0), ("C411", 4)]
        {
            let mut frame = vec![1u8, 2, 3, 4, 5, 6];
            frame.extend(vec![128; chroma]);
            let found = frames(&y4m(colour, &frame, 2));
            assert_eq!(found.len(), 2, "{colour}");
            for (_, picture) in found {
                let expected = Raster { width: 3, height: 2, data: vec![1, 2, 3, 4, 5, 6] };
                assert_eq!(picture.unwrap(), Picture::Grey8(expected), "{colour}");
            }
        }
        let deep: Vec<u8> = [1u16, 1023, 0, 512, 5, 6].iter().flat_map(|v| v.to_le_bytes()).collect();
        let Ok(Picture::Grey16(raster)) = &frames(&y4m("Cmono10", &deep, 1))[0].1 else {
            panic!("not 16 bit")
        };
        assert_eq!(raster.data[..4], [64, 65_472, 0, 32_768]);
    }

    #[test]
    fn a_stream_that_stops_inside_a_frame_says_so_after_the_whole_ones() {
        let whole = y4m("Cmono", &[7; 6], 3);
        for cut in [1, 5, 6, 7, 11] {
            let found = frames(&whole[..whole.len() - cut]);
            assert_eq!(found.len(), 3, "{cut}");
            let (frame_idx, last) = &found[2];
            assert_eq!(*frame_idx, 2);
            assert!(matches!(last, Err(Error::Truncated { num_whole: 2, .. })), "{last:?}");
        }
    }

    #[test]
    fn jpeg_pictures_follow_each_other_and_a_broken_one_is_passed() {
        let picture = |grey: u8| jpeg::encode_grey_as_rgb(&Raster::filled(16, 8, grey), 90).unwrap();
        let mut bytes = picture(40);
        // Whole by its markers, but what is inside is nothing: the tables are missing.
        bytes.extend_from_slice(&[0xff, 0xd8, 0xff, 0xda, 0, 2, 1, 2, 3, 0xff, 0xd9]);
        bytes.extend(picture(200));
        let found = frames(&bytes);
        assert_eq!(found.len(), 3);
        assert!(found[0].1.is_ok() && matches!(found[1].1, Err(Error::Raster(_))) && found[2].1.is_ok());
        let found = frames(&bytes[..bytes.len() - 30]);
        assert!(matches!(found[2].1, Err(Error::Truncated { num_whole: 2, .. })));
    }

    #[test]
    fn unwanted_frames_are_counted_and_passed() {
        let bytes = y4m("Cmono", &[7; 6], 5);
        let mut stream = FrameStream::open(&bytes[..], Path::new("stdin")).unwrap();
        assert_eq!(stream.format(), StreamFormat::Y4m);
        let indices: Vec<usize> =
            std::iter::from_fn(|| stream.next_wanted(|idx| idx % 3 == 0)).map(|(idx, _)| idx).collect();
        assert_eq!(indices, [0, 3]);
    }

    #[test]
    fn what_is_no_stream_is_refused() {
        for bytes in [&b""[..], b"hello", b"YUV4MPEG2 W0 H2\n", b"YUV4MPEG2 H2\n", b"YUV4MPEG2 W2 H2 C999\n"]
        {
            let error = FrameStream::open(bytes, Path::new("stdin")).err();
            assert!(matches!(error, Some(Error::Format { .. })), "{bytes:?}: {error:?}");
        }
    }
}
