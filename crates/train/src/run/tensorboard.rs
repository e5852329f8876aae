//! Event files as TensorBoard reads them.
//!
//! # Source
//! TensorFlow, "TFRecord" (length, masked CRC-32C of it, data, masked CRC-32C of them) and `event.proto`: `wall_time` = 1
//! (double), `step` = 2 (int64), `file_version` = 3 (string), `summary` = 5, whose values (1) hold `tag` = 1 and
//! `simple_value` = 2 (float). CRC-32C: RFC 3720, appendix B.4.

use crate::Error;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What TensorBoard asks for in the first record.
const VERSION: &str = "brain.Event:2";

/// Writes scalars to an event file.
#[derive(Debug)]
pub(crate) struct EventWriter {
    path: PathBuf,
    file: File,
}

impl EventWriter {
    /// Begins a file in `folder`; `now` is the time since 1970.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(folder: &Path, now: Duration) -> Result<Self, Error> {
        std::fs::create_dir_all(folder).map_err(Error::io("write", folder))?;
        let name = format!("events.out.tfevents.{:010}.{:09}.selenograph", now.as_secs(), now.subsec_nanos());
        let path = folder.join(name);
        let file = File::create(&path).map_err(Error::io("write", &path))?;
        let mut writer = Self { path, file };
        writer.record(&event(now, 0, &field(3, VERSION.as_bytes())))?;
        Ok(writer)
    }

    /// Adds the values of a step.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn scalars(
        &mut self,
        now: Duration,
        step: u64,
        values: &[(String, f64)],
    ) -> Result<(), Error> {
        let mut summary = Vec::new();
        for (tag, value) in values {
            let mut entry = field(1, tag.as_bytes());
            entry.push(tag_of(2, 5));
            entry.extend((*value as f32).to_le_bytes());
            summary.extend(field(1, &entry));
        }
        self.record(&event(now, step, &field(5, &summary)))
    }

    fn record(&mut self, data: &[u8]) -> Result<(), Error> {
        let len = (data.len() as u64).to_le_bytes();
        let mut record = len.to_vec();
        record.extend(masked_crc(&len).to_le_bytes());
        record.extend(data);
        record.extend(masked_crc(data).to_le_bytes());
        self.file.write_all(&record).map_err(Error::io("write", &self.path))
    }
}

fn event(now: Duration, step: u64, what: &[u8]) -> Vec<u8> {
    let mut bytes = vec![tag_of(1, 1)];
    bytes.extend(now.as_secs_f64().to_le_bytes());
    bytes.push(tag_of(2, 0));
    bytes.extend(varint(step));
    bytes.extend(what);
    bytes
}

fn tag_of(number: u8, wire: u8) -> u8 {
    number << 3 | wire
}

/// A field that holds bytes.
fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
    let mut field = vec![tag_of(number, 2)];
    field.extend(varint(bytes.len() as u64));
    field.extend(bytes);
    field
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

/// CRC-32C, bit by bit: a step writes a kilobyte.
fn crc32c(bytes: &[u8]) -> u32 {
    const POLYNOMIAL: u32 = 0x82f6_3b78;
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| crc >> 1 ^ (POLYNOMIAL & (crc & 1).wrapping_neg()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 3720, appendix B.4, and the check value of the CRC catalogue.
    #[test]
    fn the_checksum_is_the_standard_s() {
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    /// Splits a file into its records, checking both sums.
    fn records(bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut rest = bytes;
        let mut records = Vec::new();
        while !rest.is_empty() {
            let len = u64::from_le_bytes(rest[..8].try_into().unwrap()) as usize;
            assert_eq!(rest[8..12], masked_crc(&rest[..8]).to_le_bytes());
            let data = &rest[12..12 + len];
            assert_eq!(rest[12 + len..16 + len], masked_crc(data).to_le_bytes());
            records.push(data.to_vec());
            rest = &rest[16 + len..];
        }
        records
    }

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let now = Duration::from_millis(1_500);
        let mut writer = EventWriter::create(folder.path(), now).unwrap();
        writer.scalars(now, 300, &[("loss".into(), 0.25), ("lr".into(), 3e-5)]).unwrap();
        let records = records(&std::fs::read(&writer.path).unwrap());
        assert_eq!(records.len(), 2);
        assert_eq!(&records[0][records[0].len() - VERSION.len()..], VERSION.as_bytes());
        let event = &records[1];
        assert_eq!((event[0], &event[1..9]), (0x09, &1.5f64.to_le_bytes()[..]));
        // Step 300 in two groups of seven bits.
        assert_eq!(event[9..12], [0x10, 0xac, 0x02]);
        let loss = [&[0x0a, 11, 0x0a, 4][..], b"loss", &[0x15], &0.25f32.to_le_bytes()].concat();
        assert_eq!(event[12], 0x2a);
        assert_eq!(event[14..14 + loss.len()], loss);
        assert!(event.ends_with(&3e-5f32.to_le_bytes()));
    }
}
