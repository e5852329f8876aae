//! Which pair of which source comes when: a pure function of the seed.
//!
//! An epoch holds a fixed number of pairs of each source, in proportion to the weights, in random order. Each source is gone
//! through in passes of its own: no pair comes again before all others have come.

use crate::Error;
use crate::rng::{Stream, rng};

/// One pair to be fetched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draw {
    /// Which source.
    pub source_idx: usize,
    /// How often the source has been gone through before.
    pub pass: u64,
    /// Which of its pairs.
    pub item_idx: u64,
}

/// The order of all epochs.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    seed: u64,
    /// Pairs in each source.
    counts: Vec<u64>,
    /// Pairs of each source in an epoch.
    shares: Vec<u64>,
}

impl Order {
    /// For sources of `counts` pairs and the weights given; `pairs_per_epoch` is by default the number of all pairs.
    ///
    /// # Errors
    /// [`Error::Value`] for an empty source, a weight that is none, or an epoch that leaves a source without a pair.
    pub fn new(
        counts: Vec<u64>,
        weights: &[f64],
        pairs_per_epoch: Option<u64>,
        seed: u64,
    ) -> Result<Self, Error> {
        let refuse = |key: &str, expected: &str, found: String| {
            Err(Error::Value { key: key.into(), expected: expected.into(), found })
        };
        if counts.is_empty() || counts.contains(&0) {
            return refuse("sources", "at least one, each with a pair", format!("{counts:?} pairs"));
        }
        let sum: f64 = weights.iter().sum();
        if weights.len() != counts.len() || !weights.iter().all(|w| *w > 0.0) || !sum.is_finite() {
            return refuse("weight", "a positive number for each source", format!("{weights:?}"));
        }
        let epoch = pairs_per_epoch.unwrap_or_else(|| counts.iter().sum());
        let exact = |n: usize| epoch as f64 * weights[n] / sum;
        let mut shares: Vec<u64> = (0..counts.len()).map(|n| exact(n) as u64).collect();
        // What rounding down has left goes to those that lost most by it.
        let mut by_loss: Vec<usize> = (0..counts.len()).collect();
        by_loss.sort_by(|a, b| (exact(*b).fract()).total_cmp(&exact(*a).fract()).then(a.cmp(b)));
        let left = epoch - shares.iter().sum::<u64>();
        for n in by_loss.into_iter().cycle().take(left as usize) {
            shares[n] += 1;
        }
        if shares.contains(&0) {
            return refuse("pairs_per_epoch", "enough for a pair of every source", epoch.to_string());
        }
        Ok(Self { seed, counts, shares })
    }

    /// Pairs in an epoch.
    pub fn pairs_per_epoch(&self) -> u64 {
        self.shares.iter().sum()
    }

    /// Pairs of each source in an epoch.
    pub fn shares(&self) -> &[u64] {
        &self.shares
    }

    /// The pairs of an epoch, in order.
    pub fn epoch(&self, epoch: u64) -> Vec<Draw> {
        let mut draws = Vec::with_capacity(self.pairs_per_epoch() as usize);
        for (source_idx, (&count, &share)) in self.counts.iter().zip(&self.shares).enumerate() {
            let mut known: Option<(u64, Vec<u32>)> = None;
            for k in epoch * share..(epoch + 1) * share {
                let (pass, nth) = (k / count, (k % count) as usize);
                let order = match known.take() {
                    Some((of, order)) if of == pass => order,
                    _ => self.pass(source_idx, pass),
                };
                draws.push(Draw { source_idx, pass, item_idx: u64::from(order[nth]) });
                known = Some((pass, order));
            }
        }
        shuffle(&mut draws, &mut rng(self.seed, "epoch", epoch, "order"));
        draws
    }

    /// The order of one pass through a source.
    fn pass(&self, source_idx: usize, pass: u64) -> Vec<u32> {
        let mut order: Vec<u32> = (0..self.counts[source_idx] as u32).collect();
        shuffle(&mut order, &mut rng(self.seed, "source", source_idx as u64, &format!("pass {pass}")));
        order
    }

    /// The pair that takes the place of one that cannot be used.
    pub fn substitute(&self, draw: &Draw, position: u64, attempt: u64) -> Draw {
        let mut stream = rng(self.seed, "sample", position, &format!("substitute {attempt}"));
        let item_idx = stream.index(self.counts[draw.source_idx] as usize) as u64;
        Draw { item_idx, ..*draw }
    }
}

fn shuffle<T>(list: &mut [T], stream: &mut Stream) {
    for n in (1..list.len()).rev() {
        list.swap(n, stream.index(n + 1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn epochs_are_exact_and_passes_complete() {
        let order = Order::new(vec![10, 4], &[1.0, 2.0], Some(9), 7).unwrap();
        assert_eq!(order.shares(), [3, 6]);
        let draws: Vec<Draw> = (0..20).flat_map(|epoch| order.epoch(epoch)).collect();
        assert_eq!(draws.len(), 180);
        for epoch in draws.chunks(9) {
            assert_eq!(epoch.iter().filter(|d| d.source_idx == 0).count(), 3);
        }
        for (source_idx, count) in [(0, 10), (1, 4)] {
            let of = |pass| {
                let mut items: Vec<u64> = draws
                    .iter()
                    .filter(|d| d.source_idx == source_idx && d.pass == pass)
                    .map(|d| d.item_idx)
                    .collect();
                items.sort_unstable();
                items
            };
            for pass in 0..5 {
                assert_eq!(of(pass), (0..count).collect::<Vec<_>>());
            }
        }
        assert_eq!(order.epoch(3), order.epoch(3));
        assert_ne!(order.epoch(3), order.epoch(6));
        assert_ne!(order.epoch(0), Order::new(vec![10, 4], &[1.0, 2.0], Some(9), 8).unwrap().epoch(0));
    }

    #[test]
    fn impossible_mixtures_are_refused() {
        assert!(Order::new(vec![], &[], None, 0).is_err());
        assert!(Order::new(vec![3, 0], &[1.0, 1.0], None, 0).is_err());
        assert!(Order::new(vec![3], &[0.0], None, 0).is_err());
        assert!(Order::new(vec![3, 3], &[1.0, f64::NAN], None, 0).is_err());
        assert!(Order::new(vec![3, 3], &[1.0, 1000.0], Some(5), 0).is_err());
        assert_eq!(Order::new(vec![3, 5], &[1.0, 1.0], None, 0).unwrap().pairs_per_epoch(), 8);
    }
}
