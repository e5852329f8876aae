//! Whether a JPEG is whole: every coded block is walked through, without making a picture of it.
//!
//! Decoders fill up what is cut off or cannot be decoded with grey, in silence. Here each block must be there, each code must
//! be one of the tables', no restart may be missing, nothing may be left over, and no coefficient may be larger than samples allow.
//! What is changed into another picture that keeps to all this cannot be told, by nobody: JPEG has no checksum.
//!
//! # Source
//! ITU-T T.81: Huffman coding of sequential (F.2) and progressive pictures (G.2).

use super::bits::{Bits, Table};
use super::frame::Frame;
use super::reach::Reach;
use super::scan::{Codes, Scan, sequential_block};

const START_OF_SCAN: u8 = 0xDA;
const END_OF_IMAGE: u8 = 0xD9;
pub(super) const TOO_MANY: &str = "more coded samples than the picture has";
pub(super) const CUT: &str = "the file ends before the picture does";

/// What tables and frame there are so far.
struct State {
    frame: Option<Frame>,
    dc: [Option<Table>; 4],
    ac: [Option<Table>; 4],
    reach: [Reach; 4],
    restart_interval: usize,
}

/// Makes sure that every block of the picture can be decoded.
///
/// Pictures of a kind that no decoder here reads (arithmetic, lossless, height told later) are left to its refusal.
pub(super) fn check(bytes: &[u8]) -> Result<(), String> {
    let mut state = State {
        frame: None,
        dc: [const { None }; 4],
        ac: [const { None }; 4],
        reach: [Reach::ANY; 4],
        restart_interval: 0,
    };
    let mut at = 2;
    loop {
        let marker = next_marker(bytes, &mut at).ok_or(CUT)?;
        if marker == END_OF_IMAGE {
            return state.frame.as_ref().map_or(Ok(()), Frame::complete);
        }
        let length =
            bytes.get(at..at + 2).map(|b| usize::from(u16::from_be_bytes([b[0], b[1]]))).ok_or(CUT)?;
        let body = bytes.get(at + 2..at + length.max(2)).ok_or(CUT)?;
        at += length.max(2);
        match marker {
            0xC0..=0xC2 => match Frame::parse(body, marker == 0xC2)? {
                Some(frame) => state.frame = Some(frame),
                None => return Ok(()),
            },
            0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF => return Ok(()),
            0xC4 => state.read_tables(body)?,
            0xDB => Reach::read_all(&mut state.reach, body)?,
            0xDD => state.restart_interval = body.iter().fold(0, |sum, byte| sum << 8 | usize::from(*byte)),
            START_OF_SCAN => {
                let mut bits = Bits::new(bytes, at);
                state.walk(body, &mut bits)?;
                at = bits.end()?;
                if let Some([0xFF, 0xD0..=0xD7, next, ..]) = bytes.get(at..)
                    && (*next != 0xFF || bytes.get(at + 3) == Some(&0))
                {
                    return Err(TOO_MANY.to_owned());
                }
            }
            _ => {}
        }
    }
}

/// The marker after `at`, which is moved behind it; fill bytes and what is no marker are passed over.
fn next_marker(bytes: &[u8], at: &mut usize) -> Option<u8> {
    loop {
        *at += bytes.get(*at..)?.iter().position(|byte| *byte == 0xFF)? + 1;
        match *bytes.get(*at)? {
            0 | 0x01 | 0xD0..=0xD8 => *at += 1,
            0xFF => {}
            marker => {
                *at += 1;
                return Some(marker);
            }
        }
    }
}

impl State {
    fn read_tables(&mut self, mut body: &[u8]) -> Result<(), String> {
        while let [place, rest @ ..] = body {
            let (counts, rest) = rest.split_at_checked(16).ok_or(CUT)?;
            let num_codes = counts.iter().map(|count| usize::from(*count)).sum();
            let (symbols, rest) = rest.split_at_checked(num_codes).ok_or(CUT)?;
            let table = Table::new(counts, symbols).ok_or("a table of codes that cannot be")?;
            let tables = if place >> 4 == 0 { &mut self.dc } else { &mut self.ac };
            *tables.get_mut(usize::from(place & 15)).ok_or("a fifth table of codes")? = Some(table);
            body = rest;
        }
        Ok(())
    }

    /// Walks through a scan, from its header's body on.
    fn walk(&mut self, body: &[u8], bits: &mut Bits) -> Result<(), String> {
        let frame = self.frame.as_mut().ok_or("a scan before its frame")?;
        let scan = Scan::parse(body, frame)?;
        for (idx, ..) in &scan.parts {
            let component = &mut frame.components[*idx];
            component.bits_left[scan.first..=scan.last].fill(Some(scan.low));
            component.level = 0;
        }
        // A scan of one component holds its own blocks only; one of several whole units of all.
        let [across, down] = match scan.parts.as_slice() {
            [(idx, ..)] => frame.blocks(*idx),
            _ => frame.mcus(),
        };
        let mut end_run = 0;
        for unit in 0..across * down {
            if self.restart_interval > 0 && unit > 0 && unit % self.restart_interval == 0 {
                ended(end_run)?;
                bits.restart((unit / self.restart_interval - 1) % 8)?;
                frame.components.iter_mut().for_each(|component| component.level = 0);
            }
            let (x, y) = (unit % across, unit / across);
            for (idx, dc, ac) in &scan.parts {
                let component = &mut frame.components[*idx];
                let codes = Codes {
                    dc: self.dc[*dc].as_ref(),
                    ac: self.ac[*ac].as_ref(),
                    reach: if frame.bits == 8 { &self.reach[component.steps] } else { &Reach::ANY },
                };
                let [wide, high] =
                    if scan.parts.len() == 1 { [1, 1] } else { [component.across, component.down] };
                for block in 0..wide * high {
                    let place = (y * high + block / wide) * component.stride + x * wide + block % wide;
                    if frame.progressive {
                        let seen = component.nonzero.get_mut(place).ok_or("a block outside the picture")?;
                        let level = &mut component.level;
                        scan.progressive_block(bits, &codes, level, seen, &mut end_run)?;
                    } else {
                        sequential_block(bits, &codes, &mut component.level)?;
                    }
                }
            }
        }
        ended(end_run)
    }
}

/// A run of blocks that are at their end ends with the blocks there are.
fn ended(end_run: u32) -> Result<(), String> {
    if end_run == 0 { Ok(()) } else { Err(TOO_MANY.to_owned()) }
}
