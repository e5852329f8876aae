//! One scan of a JPEG, block by block.

use super::bits::{Bits, Table};
use super::entropy::CUT;
use super::frame::Frame;
use super::reach::Reach;

/// One scan: which components and, in progressive pictures, which coefficients and bits of them.
pub(super) struct Scan {
    /// Component and its tables (DC, AC).
    pub parts: Vec<(usize, usize, usize)>,
    pub first: usize,
    pub last: usize,
    /// Whether earlier scans had the upper bits.
    refines: bool,
    pub low: u8,
}

/// What one component's codes mean in a scan.
pub(super) struct Codes<'a> {
    pub dc: Option<&'a Table>,
    pub ac: Option<&'a Table>,
    pub reach: &'a Reach,
}

impl Scan {
    pub fn parse(body: &[u8], frame: &Frame) -> Result<Self, String> {
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

    pub fn progressive_block(
        &self,
        bits: &mut Bits,
        codes: &Codes,
        level: &mut i64,
        seen: &mut u64,
        end_run: &mut u32,
    ) -> Result<(), String> {
        match (self.first, self.refines) {
            (0, false) => {
                *level += bits.value(codes.dc)?;
                codes.reach.check_level(*level, self.low)
            }
            (0, true) => bits.take(1).map(drop),
            (_, false) => self.first_bits(bits, codes, seen, end_run),
            (_, true) => self.further_bits(bits, codes.ac, seen, end_run),
        }
    }

    fn first_bits(
        &self,
        bits: &mut Bits,
        codes: &Codes,
        seen: &mut u64,
        end_run: &mut u32,
    ) -> Result<(), String> {
        if *end_run > 0 {
            *end_run -= 1;
            return Ok(());
        }
        let mut k = self.first;
        while k <= self.last {
            let code = bits.symbol(codes.ac)?;
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
                    codes.reach.check(k, bits.signed(size)?, self.low)?;
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

pub(super) fn sequential_block(bits: &mut Bits, codes: &Codes, level: &mut i64) -> Result<(), String> {
    *level += bits.value(codes.dc)?;
    codes.reach.check_level(*level, 0)?;
    let mut k = 1;
    while k < 64 {
        let code = bits.symbol(codes.ac)?;
        let (run, size) = (usize::from(code >> 4), u32::from(code & 15));
        match (run, size) {
            (15, 0) => k += 16,
            (_, 0) => break,
            _ => {
                k += run;
                if k > 63 {
                    return Err("a run past the end of its block".to_owned());
                }
                codes.reach.check(k, bits.signed(size)?, 0)?;
                k += 1;
            }
        }
    }
    Ok(())
}
