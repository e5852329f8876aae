//! Whether a JPEG is whole: every coded block is walked through, without making a picture of it.
//!
//! Decoders fill up what is cut off or cannot be decoded with grey, in silence. Here each block must be there, each code must
//! be one of the tables', no restart may be missing, and nothing may be left over.
//!
//! # Source
//! ITU-T T.81: Huffman coding of sequential (F.2) and progressive pictures (G.2).

use super::bits::{Bits, Table};

const START_OF_SCAN: u8 = 0xDA;
const END_OF_IMAGE: u8 = 0xD9;
const CUT: &str = "the file ends before the picture does";

/// One component of the frame.
struct Component {
    id: u8,
    across: usize,
    down: usize,
    /// For each block the coefficients that are not 0 so far: bit k stands for coefficient k.
    nonzero: Vec<u64>,
    /// For each coefficient the bits still to come; `None` before its first scan.
    bits_left: [Option<u8>; 64],
    /// Blocks in a row of `nonzero`.
    stride: usize,
}

/// The frame that the scans fill.
struct Frame {
    progressive: bool,
    width: usize,
    height: usize,
    components: Vec<Component>,
}

/// What tables and frame there are so far.
#[derive(Default)]
struct State {
    frame: Option<Frame>,
    dc: [Option<Table>; 4],
    ac: [Option<Table>; 4],
    restart_interval: usize,
}

/// One scan: which components and, in progressive pictures, which coefficients and bits of them.
struct Scan {
    /// Component and its tables (DC, AC).
    parts: Vec<(usize, usize, usize)>,
    first: usize,
    last: usize,
    /// Whether earlier scans had the upper bits.
    refines: bool,
    low: u8,
}

/// Makes sure that every block of the picture can be decoded.
///
/// Pictures of a kind that no decoder here reads (arithmetic, lossless, height told later) are left to its refusal.
pub(super) fn check(bytes: &[u8]) -> Result<(), String> {
    let mut state = State::default();
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
            0xDD => state.restart_interval = body.iter().fold(0, |sum, byte| sum << 8 | usize::from(*byte)),
            START_OF_SCAN => {
                let mut bits = Bits::new(bytes, at);
                state.walk(body, &mut bits)?;
                at = bits.end()?;
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

impl Frame {
    /// `None` where the height comes later.
    fn parse(body: &[u8], progressive: bool) -> Result<Option<Self>, String> {
        let [_, h1, h0, w1, w0, count, rest @ ..] = body else { return Err(CUT.to_owned()) };
        let side = |high: u8, low: u8| usize::from(u16::from_be_bytes([high, low]));
        let (width, height) = (side(*w1, *w0), side(*h1, *h0));
        let described = rest.chunks_exact(3).take(usize::from(*count));
        let factors: Vec<(u8, usize, usize)> =
            described.map(|c| (c[0], usize::from(c[1] >> 4), usize::from(c[1] & 15))).collect();
        if factors.len() != usize::from(*count)
            || factors.iter().any(|f| !(1..=4).contains(&f.1) || !(1..=4).contains(&f.2))
        {
            return Err("a frame whose components cannot be".to_owned());
        }
        let mut frame = Self { progressive, width, height, components: Vec::new() };
        frame.components = factors
            .into_iter()
            .map(|(id, across, down)| Component {
                id,
                across,
                down,
                nonzero: Vec::new(),
                bits_left: [None; 64],
                stride: 0,
            })
            .collect();
        let [mcus_across, mcus_down] = frame.mcus();
        for component in &mut frame.components {
            component.stride = mcus_across * component.across;
            if progressive {
                component.nonzero = vec![0; component.stride * mcus_down * component.down];
            }
        }
        Ok((width > 0 && height > 0 && *count > 0).then_some(frame))
    }

    fn largest(&self) -> [usize; 2] {
        let most = |of: fn(&Component) -> usize| self.components.iter().map(of).max().unwrap_or(1);
        [most(|c| c.across), most(|c| c.down)]
    }

    /// Units of a scan of several components, across and down.
    fn mcus(&self) -> [usize; 2] {
        let [across, down] = self.largest();
        [self.width.div_ceil(8 * across), self.height.div_ceil(8 * down)]
    }

    /// Blocks of one component that hold samples, across and down.
    fn blocks(&self, idx: usize) -> [usize; 2] {
        let ([across, down], component) = (self.largest(), &self.components[idx]);
        let blocks = |side: usize, own: usize, most: usize| (side * own).div_ceil(most).div_ceil(8);
        [blocks(self.width, component.across, across), blocks(self.height, component.down, down)]
    }

    /// Every bit of every coefficient: the standard lets an encoder leave some out, but whole files that do are unheard of,
    /// and those that end between two scans are not.
    fn complete(&self) -> Result<(), String> {
        match self.components.iter().position(|c| c.bits_left.iter().any(|bits| *bits != Some(0))) {
            Some(idx) => Err(format!("scans of component {} are missing", idx + 1)),
            None => Ok(()),
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
            frame.components[*idx].bits_left[scan.first..=scan.last].fill(Some(scan.low));
        }
        // A scan of one component holds its own blocks only; one of several whole units of all.
        let [across, down] = match scan.parts.as_slice() {
            [(idx, ..)] => frame.blocks(*idx),
            _ => frame.mcus(),
        };
        let mut end_run = 0;
        for unit in 0..across * down {
            if self.restart_interval > 0 && unit > 0 && unit % self.restart_interval == 0 {
                bits.restart((unit / self.restart_interval - 1) % 8)?;
                end_run = 0;
            }
            let (x, y) = (unit % across, unit / across);
            for (idx, dc, ac) in &scan.parts {
                let component = &mut frame.components[*idx];
                let (dc, ac) = (self.dc[*dc].as_ref(), self.ac[*ac].as_ref());
                let [wide, high] =
                    if scan.parts.len() == 1 { [1, 1] } else { [component.across, component.down] };
                for block in 0..wide * high {
                    let place = (y * high + block / wide) * component.stride + x * wide + block % wide;
                    if frame.progressive {
                        let seen = component.nonzero.get_mut(place).ok_or("a block outside the picture")?;
                        scan.progressive_block(bits, dc, ac, seen, &mut end_run)?;
                    } else {
                        sequential_block(bits, dc, ac)?;
                    }
                }
            }
        }
        Ok(())
    }
}

impl Scan {
    fn parse(body: &[u8], frame: &Frame) -> Result<Self, String> {
        let count = usize::from(*body.first().ok_or(CUT)?);
        let (parts, rest) = body[1..].split_at_checked(2 * count).ok_or(CUT)?;
        let [first, last, bits] = rest.first_chunk::<3>().ok_or(CUT)?;
        let place = |part: &[u8]| {
            let idx = frame.components.iter().position(|c| c.id == part[0])?;
            let (dc, ac) = (usize::from(part[1] >> 4), usize::from(part[1] & 15));
            (dc < 4 && ac < 4).then_some((idx, dc, ac))
        };
        let parts: Option<Vec<_>> = parts.chunks_exact(2).map(place).collect();
        let parts = parts
            .filter(|parts| !parts.is_empty())
            .ok_or("a scan of components that are not in the frame")?;
        let (first, last) =
            if frame.progressive { (usize::from(*first), usize::from(*last)) } else { (0, 63) };
        if first > last
            || last > 63
            || (frame.progressive && first > 0 && parts.len() > 1)
            || (frame.progressive && first == 0 && last > 0)
        {
            return Err(format!("a scan of coefficients {first} to {last}"));
        }
        let low = if frame.progressive { bits & 15 } else { 0 };
        Ok(Self { parts, first, last, refines: frame.progressive && bits >> 4 > 0, low })
    }

    fn progressive_block(
        &self,
        bits: &mut Bits,
        dc: Option<&Table>,
        ac: Option<&Table>,
        seen: &mut u64,
        end_run: &mut u32,
    ) -> Result<(), String> {
        match (self.first, self.refines) {
            (0, false) => bits.skip_value(dc),
            (0, true) => bits.take(1).map(drop),
            (_, false) => self.first_bits(bits, ac, seen, end_run),
            (_, true) => self.further_bits(bits, ac, seen, end_run),
        }
    }

    fn first_bits(
        &self,
        bits: &mut Bits,
        ac: Option<&Table>,
        seen: &mut u64,
        end_run: &mut u32,
    ) -> Result<(), String> {
        if *end_run > 0 {
            *end_run -= 1;
            return Ok(());
        }
        let mut k = self.first;
        while k <= self.last {
            let code = bits.symbol(ac)?;
            let (run, size) = (usize::from(code >> 4), u32::from(code & 15));
            match (run, size) {
                (15, 0) => k += 16,
                (_, 0) => {
                    *end_run = (1 << run) - 1 + bits.take(run as u32)?;
                    break;
                }
                _ => {
                    k += run;
                    if k > self.last {
                        return Err("a run past the end of its block".to_owned());
                    }
                    bits.take(size)?;
                    *seen |= 1 << k;
                    k += 1;
                }
            }
        }
        Ok(())
    }

    fn further_bits(
        &self,
        bits: &mut Bits,
        ac: Option<&Table>,
        seen: &mut u64,
        end_run: &mut u32,
    ) -> Result<(), String> {
        let mut k = self.first;
        while *end_run == 0 && k <= self.last {
            let code = bits.symbol(ac)?;
            let (mut run, size) = (usize::from(code >> 4), code & 15);
            match size {
                0 if run < 15 => {
                    *end_run = (1 << run) + bits.take(run as u32)?;
                    break;
                }
                0 => {}
                1 => drop(bits.take(1)?),
                _ => return Err("a code that a refining scan has not".to_owned()),
            }
            // One bit for each coefficient that is not 0 already; the run counts those that are.
            while k <= self.last {
                if *seen >> k & 1 == 1 {
                    bits.take(1)?;
                } else if run == 0 {
                    break;
                } else {
                    run -= 1;
                }
                k += 1;
            }
            if size == 1 {
                if k > self.last {
                    return Err("a run past the end of its block".to_owned());
                }
                *seen |= 1 << k;
            }
            k += 1;
        }
        if *end_run > 0 {
            let rest = (k..=self.last).filter(|k| *seen >> k & 1 == 1).count();
            for _ in 0..rest {
                bits.take(1)?;
            }
            *end_run -= 1;
        }
        Ok(())
    }
}

fn sequential_block(bits: &mut Bits, dc: Option<&Table>, ac: Option<&Table>) -> Result<(), String> {
    bits.skip_value(dc)?;
    let mut k = 1;
    while k < 64 {
        let code = bits.symbol(ac)?;
        let (run, size) = (usize::from(code >> 4), u32::from(code & 15));
        match (run, size) {
            (15, 0) => k += 16,
            (_, 0) => break,
            _ => {
                k += run + 1;
                if k > 64 {
                    return Err("a run past the end of its block".to_owned());
                }
                bits.take(size)?;
            }
        }
    }
    Ok(())
}
