//! The bits of a JPEG's scans, and its tables of codes.

use super::entropy::TOO_MANY;

const EARLY: &str = "the coded samples end before the picture does";

/// A table of Huffman codes: for the next 16 bits the length of the code and its symbol; length 0 where there is none.
pub(super) struct Table {
    codes: Vec<(u8, u8)>,
}

impl Table {
    /// From the number of codes of each length from 1 to 16 and their symbols (T.81, annex C).
    pub(super) fn new(counts: &[u8], symbols: &[u8]) -> Option<Self> {
        let mut codes = vec![(0, 0); 1 << 16];
        let (mut code, mut symbols) = (0usize, symbols.iter());
        for (length, count) in (1u8..).zip(counts) {
            for _ in 0..*count {
                let shift = 16 - u32::from(length);
                codes.get_mut(code << shift..(code + 1) << shift)?.fill((length, *symbols.next()?));
                code += 1;
            }
            code <<= 1;
        }
        Some(Self { codes })
    }
}

/// Reads bits of one scan up to the next marker; stuffed zeros are left out.
pub(super) struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Bits not yet taken, the next one uppermost.
    held: u64,
    count: u32,
}

impl<'a> Bits<'a> {
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at, held: 0, count: 0 }
    }

    fn fill(&mut self) {
        while self.count <= 56 {
            let Some(&byte) = self.bytes.get(self.at) else { return };
            match (byte, self.bytes.get(self.at + 1)) {
                (0xFF, Some(0)) => self.at += 2,
                (0xFF, _) => return,
                _ => self.at += 1,
            }
            self.held |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// The next `count` bits, at most 16.
    pub(super) fn take(&mut self, count: u32) -> Result<u32, String> {
        if self.count < count {
            self.fill();
            if self.count < count {
                return Err(EARLY.to_owned());
            }
        }
        let value = if count == 0 { 0 } else { (self.held >> (64 - count)) as u32 };
        self.held = self.held.checked_shl(count).unwrap_or(0);
        self.count -= count;
        Ok(value)
    }

    pub(super) fn symbol(&mut self, table: Option<&Table>) -> Result<u8, String> {
        let table = table.ok_or("a scan without its table of codes")?;
        if self.count < 16 {
            self.fill();
        }
        let (length, symbol) = table.codes[(self.held >> 48) as usize];
        match u32::from(length) {
            // Behind the last bit stand zeros, which may be a code or none.
            _ if self.count == 0 => Err(EARLY.to_owned()),
            0 if self.count < 16 => Err(EARLY.to_owned()),
            0 => Err("a code that is in no table".to_owned()),
            length => self.take(length).map(|_| symbol),
        }
    }

    /// A number behind the code of its size.
    pub(super) fn value(&mut self, table: Option<&Table>) -> Result<i64, String> {
        match self.symbol(table)? {
            size @ 0..=16 => self.signed(size.into()),
            _ => Err("a value of more than 16 bits".to_owned()),
        }
    }

    /// A number of a known size: those that begin with a 0 are negative (T.81, F.2.2.1).
    pub(super) fn signed(&mut self, size: u32) -> Result<i64, String> {
        let bits = i64::from(self.take(size)?);
        let is_negative = size > 0 && bits >> (size - 1) == 0;
        Ok(if is_negative { bits - (1 << size) + 1 } else { bits })
    }

    /// Takes the restart marker of a number from 0 to 7.
    pub(super) fn restart(&mut self, number: usize) -> Result<(), String> {
        self.at = self.end()?;
        while self.bytes.get(self.at..self.at + 2) == Some(&[0xFF, 0xFF]) {
            self.at += 1;
        }
        if self.bytes.get(self.at..self.at + 2) != Some(&[0xFF, 0xD0 + number as u8]) {
            return Err(format!("restart marker {number} is not where it belongs"));
        }
        self.at += 2;
        (self.held, self.count) = (0, 0);
        Ok(())
    }

    /// Where the marker behind the coded samples stands; only padding may be left before it.
    pub(super) fn end(&mut self) -> Result<usize, String> {
        // The last byte is filled up with ones; whole bytes left over are samples, unless some encoder padded with them.
        self.take(self.count % 8)?;
        loop {
            self.fill();
            match self.count {
                0 => return Ok(self.at),
                _ => match self.take(8)? {
                    0 | 0xFF => {}
                    _ => return Err(TOO_MANY.to_owned()),
                },
            }
        }
    }
}
