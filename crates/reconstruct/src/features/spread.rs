//! Choosing the best points of every region before the second best of any.

/// Positions in `points` (x, y, response) to keep: at most `keep`, taken in turns from the cells of a grid.
///
/// Half of them are the strongest of the whole picture; the other half is taken in rounds, the best of each cell first, so that
/// a bright crater rim does not use up what the plain beside it needs. Ordered by falling response.
pub(super) fn spread(
    points: &[(f32, f32, f32)],
    size: [usize; 2],
    cells_across: usize,
    keep: usize,
) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    // Ties are broken by position in the list, which does not depend on the threads.
    order.sort_unstable_by(|&i, &j| points[j].2.total_cmp(&points[i].2).then(i.cmp(&j)));
    if points.len() <= keep || cells_across == 0 {
        order.truncate(keep);
        return order;
    }
    let side = (size[0].max(size[1]) as f32 / cells_across as f32).max(1.0);
    let columns = (size[0] as f32 / side).ceil() as usize + 1;
    let rows = (size[1] as f32 / side).ceil() as usize + 1;
    let mut taken = vec![0u32; columns * rows];
    let strongest = keep / 2;
    let mut rounds: Vec<(u32, usize)> = order
        .iter()
        .enumerate()
        .map(|(rank, &i)| {
            let (x, y, _) = points[i];
            let cell = ((y / side) as usize).min(rows - 1) * columns + ((x / side) as usize).min(columns - 1);
            let round = taken[cell];
            taken[cell] += 1;
            (if rank < strongest { 0 } else { round + 1 }, rank)
        })
        .collect();
    rounds.sort_unstable();
    rounds.truncate(keep);
    rounds.sort_unstable_by_key(|&(_, rank)| rank);
    rounds.into_iter().map(|(_, rank)| order[rank]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weak_points_of_empty_regions_beat_the_crowd() {
        let mut points: Vec<_> =
            (0..100u16).map(|i| (f32::from(i) * 0.1, 5.0, 10.0 + f32::from(i))).collect();
        points.push((90.0, 90.0, 1.0));
        let kept = spread(&points, [100, 100], 8, 10);
        assert_eq!(kept.len(), 10);
        assert_eq!(kept[0], 99);
        assert!(kept.contains(&100));
        assert_eq!(spread(&points, [100, 100], 8, 500).len(), 101);
    }
}
