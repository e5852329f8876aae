//! Nearest neighbours of bit strings.

use super::nearest::{Nearest, Neighbours};
use crate::dispatch::widest;
use crate::features::orb::Descriptor;
use rayon::prelude::*;

/// Descriptors of one piece of work.
const CHUNK: usize = 64;

/// More bits than a descriptor has.
const FAR: u32 = u32::MAX;

pub(super) fn neighbours(a: &[Descriptor], b: &[Descriptor]) -> Neighbours {
    let [of_a, of_b] = [(a, b), (b, a)].map(|(from, to)| {
        let chunks: Vec<Vec<Nearest>> = from
            .par_chunks(CHUNK)
            .map(|chunk| {
                let mut found = Vec::with_capacity(chunk.len());
                scan(chunk, to, &mut found);
                found
            })
            .collect();
        chunks.concat()
    });
    Neighbours { of_a, of_b: of_b.into_iter().map(|nearest| nearest.idx).collect() }
}

widest! {
    fn scan(from: &[Descriptor], to: &[Descriptor], found: &mut Vec<Nearest>) = scan_body
}

#[inline(always)]
fn scan_body(from: &[Descriptor], to: &[Descriptor], found: &mut Vec<Nearest>) {
    for x in from {
        let (mut best, mut second, mut idx) = (FAR, FAR, u32::MAX);
        for (j, y) in to.iter().enumerate() {
            let mut bits = 0;
            for k in 0..4 {
                bits += (x[k] ^ y[k]).count_ones();
            }
            if bits < best {
                (second, best, idx) = (best, bits, j as u32);
            } else if bits < second {
                second = bits;
            }
        }
        let ratio = if second == 0 { 1.0 } else { f64::from(best) / f64::from(second) };
        found.push(Nearest { idx, ratio });
    }
}
