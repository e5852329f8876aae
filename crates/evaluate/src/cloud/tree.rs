//! Exact nearest neighbours: a balanced k-d tree over points that may coincide.

use rayon::join;
use selenograph_geometry::Point3;

/// Points per leaf, at most.
const LEAF: usize = 16;
/// Below this many points a branch is not worth another thread.
const PARALLEL: usize = 32_768;

/// A point with its number in the cloud.
#[derive(Debug, Clone, Copy)]
struct Item {
    at: [f64; 3],
    idx: u32,
}

/// Where a branch is cut.
#[derive(Debug, Clone, Copy, Default)]
struct Cut {
    axis: u8,
    at: f64,
}

/// The box around the points of a branch or a leaf.
#[derive(Debug, Clone, Copy)]
struct Extent {
    low: [f64; 3],
    high: [f64; 3],
}

impl Extent {
    const EMPTY: Self = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    fn around(items: &[Item]) -> Self {
        items.iter().fold(Self::EMPTY, |mut extent, item| {
            for axis in 0..3 {
                extent.low[axis] = extent.low[axis].min(item.at[axis]);
                extent.high[axis] = extent.high[axis].max(item.at[axis]);
            }
            extent
        })
    }

    fn longest_axis(&self) -> usize {
        let side = |axis: usize| self.high[axis] - self.low[axis];
        (1..3).fold(0, |longest, axis| if side(axis) > side(longest) { axis } else { longest })
    }

    /// Squared distance to the box.
    #[inline]
    fn squared_from(&self, to: [f64; 3]) -> f64 {
        (0..3)
            .map(|axis| (self.low[axis] - to[axis]).max(to[axis] - self.high[axis]).max(0.0))
            .map(|off| off * off)
            .sum()
    }
}

/// A k-d tree. Cut in the middle of the order along the longest side, so that points on one coordinate do no harm.
#[derive(Debug, Clone)]
pub struct Tree {
    items: Vec<Item>,
    /// Branches before their children, left before right; all leaves lie on one level.
    cuts: Vec<Cut>,
    /// In the same order; apart from the cuts, which most searches need alone.
    extents: Vec<Extent>,
    levels: u32,
}

/// A neighbour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// Its number in the cloud.
    pub idx: usize,
    /// Squared distance.
    pub squared: f64,
}

impl Tree {
    /// From the points of a cloud, all finite and fewer than 2³².
    pub fn new(points: &[Point3<f64>]) -> Self {
        let mut items: Vec<Item> =
            points.iter().enumerate().map(|(idx, p)| Item { at: [p.x, p.y, p.z], idx: idx as u32 }).collect();
        let levels = items.len().div_ceil(LEAF).max(1).next_power_of_two().trailing_zeros();
        let num_nodes = (2 << levels) - 1;
        let (mut cuts, mut extents) = (vec![Cut::default(); num_nodes], vec![Extent::EMPTY; num_nodes]);
        build(&mut items, &mut cuts, &mut extents);
        Self { items, cuts, extents, levels }
    }

    /// Squared distance to the nearest point, or `bound` if none is nearer than that.
    pub fn nearest_squared(&self, to: &Point3<f64>, bound: f64) -> f64 {
        let mut best = bound;
        let mut show = |_: &Item, squared| {
            best = squared;
            squared
        };
        self.visit(to, &mut show, bound);
        best
    }

    /// The `count` nearest points, in no order; equal distances at the end are settled by the order of the tree.
    pub fn nearest(&self, to: &Point3<f64>, count: usize, found: &mut Vec<Neighbour>) {
        found.clear();
        if count == 0 {
            return;
        }
        let mut farthest = 0;
        self.visit(
            to,
            &mut |item, squared| {
                let neighbour = Neighbour { idx: item.idx as usize, squared };
                if found.len() < count {
                    found.push(neighbour);
                    if found.len() < count {
                        return f64::INFINITY;
                    }
                } else if squared < found[farthest].squared {
                    found[farthest] = neighbour;
                } else {
                    return found[farthest].squared;
                }
                for (idx, candidate) in found.iter().enumerate() {
                    if candidate.squared > found[farthest].squared {
                        farthest = idx;
                    }
                }
                found[farthest].squared
            },
            f64::INFINITY,
        );
    }

    /// Shows every point that may be nearer than the bound, which each showing may lower.
    #[inline]
    fn visit(&self, to: &Point3<f64>, show: &mut impl FnMut(&Item, f64) -> f64, bound: f64) {
        let to = [to.x, to.y, to.z];
        let mut bound = bound;
        // Node, its level, its first item and number of items, and how far it is off along each axis.
        let mut stack = [(0usize, 0u32, 0usize, 0usize, [0.0f64; 3]); 40];
        stack[0] = (0, 0, 0, self.items.len(), [0.0; 3]);
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (mut node, mut level, mut first, mut count, off) = stack[top];
            // The cuts settle most of it from what is at hand. A point far above a surface, which is cut across only, has all
            // of it beside itself by the cuts: its box tells.
            if off[0] * off[0] + off[1] * off[1] + off[2] * off[2] >= bound
                || self.extents[node].squared_from(to) >= bound
            {
                continue;
            }
            while level < self.levels {
                let cut = self.cuts[node];
                let axis = usize::from(cut.axis);
                let side = to[axis] - cut.at;
                let half = count / 2;
                let mut far_off = off;
                far_off[axis] = side;
                let left = (node + 1, first, half);
                let right = (node + (1 << (self.levels - level)), first + half, count - half);
                let (near, far) = if side < 0.0 { (left, right) } else { (right, left) };
                level += 1;
                stack[top] = (far.0, level, far.1, far.2, far_off);
                top += 1;
                (node, first, count) = near;
            }
            for item in &self.items[first..first + count] {
                let (dx, dy, dz) = (item.at[0] - to[0], item.at[1] - to[1], item.at[2] - to[2]);
                let squared = dx * dx + dy * dy + dz * dz;
                if squared < bound {
                    bound = show(item, squared).min(bound);
                }
            }
        }
    }
}

/// Sorts items into their leaves; there are as many cuts as extents, one less than a power of two.
fn build(items: &mut [Item], cuts: &mut [Cut], extents: &mut [Extent]) {
    let (Some((cut, cuts)), Some((extent, extents))) = (cuts.split_first_mut(), extents.split_first_mut())
    else {
        return;
    };
    *extent = Extent::around(items);
    if cuts.is_empty() {
        return;
    }
    let axis = extent.longest_axis();
    let half = items.len() / 2;
    if !items.is_empty() {
        let middle = items.select_nth_unstable_by(half, |a, b| a.at[axis].total_cmp(&b.at[axis])).1;
        *cut = Cut { axis: axis as u8, at: middle.at[axis] };
    }
    let num_items = items.len();
    let (left, right) = items.split_at_mut(half);
    let (left_cuts, right_cuts) = cuts.split_at_mut(cuts.len() / 2);
    let (left_extents, right_extents) = extents.split_at_mut(extents.len() / 2);
    if num_items > PARALLEL {
        join(|| build(left, left_cuts, left_extents), || build(right, right_cuts, right_extents));
    } else {
        build(left, left_cuts, left_extents);
        build(right, right_cuts, right_extents);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(count: usize, step: f64) -> Vec<Point3<f64>> {
        // A step rounds coordinates, so that many points share them or coincide.
        let round = |v: f64| if step > 0.0 { (v / step).round() * step } else { v };
        (0..count)
            .map(|i| {
                let t = i as f64;
                let wave = |a: f64, b: f64| ((t * a + b).sin() * 43_758.545_3).fract();
                Point3::new(round(wave(0.37, 1.0)), round(wave(0.71, 2.0)), round(0.2 * wave(1.3, 3.0)))
            })
            .collect()
    }

    fn brute(points: &[Point3<f64>], to: &Point3<f64>) -> Vec<f64> {
        let mut all: Vec<f64> = points.iter().map(|p| (p - to).norm_squared()).collect();
        all.sort_unstable_by(f64::total_cmp);
        all
    }

    #[test]
    fn neighbours_are_those_of_a_full_search() {
        for (count, step) in [(1, 0.0), (15, 0.0), (17, 0.1), (1000, 0.0), (1000, 0.25), (500, 10.0)] {
            let points = cloud(count, step);
            let tree = Tree::new(&points);
            assert_eq!(tree.items.len(), count);
            let mut found = Vec::new();
            for to in cloud(60, 0.0).iter().map(|p| p + selenograph_geometry::Vector3::new(0.01, -0.3, 0.1)) {
                let expected = brute(&points, &to);
                assert_eq!(tree.nearest_squared(&to, f64::INFINITY), expected[0]);
                assert_eq!(tree.nearest_squared(&to, 0.5 * expected[0]), 0.5 * expected[0]);
                for wanted in [1, 7, 30] {
                    tree.nearest(&to, wanted, &mut found);
                    let mut squared: Vec<f64> = found.iter().map(|n| n.squared).collect();
                    squared.sort_unstable_by(f64::total_cmp);
                    assert_eq!(squared, expected[..wanted.min(count)], "{count} {step} {wanted}");
                    assert!(found.iter().all(|n| (points[n.idx] - to).norm_squared() == n.squared));
                }
            }
        }
    }

    #[test]
    fn an_empty_cloud_has_no_neighbours() {
        let tree = Tree::new(&[]);
        let mut found = Vec::new();
        tree.nearest(&Point3::origin(), 3, &mut found);
        assert!(tree.items.is_empty() && found.is_empty());
        assert_eq!(tree.nearest_squared(&Point3::origin(), f64::INFINITY), f64::INFINITY);
    }
}
