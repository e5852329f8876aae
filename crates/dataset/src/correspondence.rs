//! Pixels of two views that see the same ground, and pixels that do not, for a network to tell apart.
//!
//! [`MatchRule::Reciprocal`] is the published one: a pixel's point is projected into the other view and rounded, and belongs
//! to that pixel if the way back ends where it began; ground that other ground hides is not left out.
//! [`MatchRule::Seen`] asks also that the other view really sees the ground, and takes its negatives where it does not.

use crate::Error;
use crate::covisibility::Sight;
use crate::plan::coverage::in_frame;
use crate::rng::Stream;
use crate::view_truth::ViewTruth;
use selenograph_geometry::{Cam, Camera, Matrix3, Point2, Rigid3, Vector3, pixel};
use serde::{Deserialize, Serialize};

/// Ground that lies this many pixels' ground beyond what the other view sees there is hidden from it: more than the steps of
/// a half float.
const HIDDEN_GSDS: f64 = 3.0;

/// Which pixels make a match.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MatchRule {
    /// There and back by rounding, as the published networks were trained.
    #[default]
    Reciprocal,
    /// That, and the ground is seen from both.
    Seen,
}

/// Matched pixels, `[x, y]`: three lists side by side, true matches first.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Matches {
    /// Pixels of A.
    pub a: Vec<[u32; 2]>,
    /// Pixels of B.
    pub b: Vec<[u32; 2]>,
    /// Whether the two see the same ground.
    pub valid: Vec<bool>,
}

/// A view's camera and truth. Lens distortion is left aside: views are rectified before they are learned from.
#[derive(Debug, Clone, Copy)]
pub struct Sighted<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Depth and pose.
    pub truth: &'a ViewTruth,
}

/// For every pixel of `from`, rows first, the pixel of `to` that its point falls on, as `x + y · width`: rounded half to even
/// and drawn to the nearest pixel of the frame. Nothing is asked of depth or visibility: a pixel without depth counts as the
/// camera's centre.
///
/// # Source
/// The training data of Leroy, Cabon, Revaud 2024, "Grounding Image Matching in 3D with MASt3R".
pub fn landings(from: Sighted<'_>, to: Sighted<'_>) -> Vec<u32> {
    let carrier = Carrier::new(from, to);
    let clip = |value: f64, side: usize| {
        // A point at the other camera's centre has no projection; the reference draws it to the first pixel too.
        (pixel::sample_position(value).round_ties_even().max(0.0) as usize).min(side - 1)
    };
    carrier
        .points()
        .map(|point| {
            let place = carrier.project(&point);
            (clip(place.x, to.camera.width) + clip(place.y, to.camera.height) * to.camera.width) as u32
        })
        .collect()
}

/// For every pixel of `from`, rows first, whether `to` sees its ground, judged by comparing depths: for stored pairs, of which
/// the terrain is not at hand. Where it is, `covisibility::correspondence` casts rays instead.
pub fn sights(from: Sighted<'_>, to: Sighted<'_>) -> Vec<Sight> {
    let carrier = Carrier::new(from, to);
    let sight = |(idx, point): (usize, Vector3<f64>)| {
        if !from.truth.is_valid(idx) {
            return Sight::Absent;
        }
        let place = carrier.project(&point);
        if point.z <= 0.0 || !in_frame(to.camera, Some(place)) {
            return Sight::Outside;
        }
        match to.truth.depth_z_at(to.camera, &place) {
            Some(seen_z) if point.z > seen_z + HIDDEN_GSDS * to.camera.gsd_m(point.z) => Sight::Hidden(place),
            Some(_) => Sight::Seen(place),
            None => Sight::Absent,
        }
    };
    carrier.points().enumerate().map(sight).collect()
}

/// The way of pixels from one view into another.
struct Carrier<'a> {
    from: Sighted<'a>,
    to: &'a Camera,
    /// Rays of homogeneous pixels, in the other camera's axes.
    to_ray_from_pixel: Matrix3<f64>,
    shift: Vector3<f64>,
}

impl<'a> Carrier<'a> {
    fn new(from: Sighted<'a>, to: Sighted<'a>) -> Self {
        // The world drops out first, so that its large coordinates cost no digits.
        let motion: Rigid3<Cam, Cam> = &to.truth.world_from_cam.inverse() * &from.truth.world_from_cam;
        let Camera { fx, fy, cx, cy, .. } = from.camera;
        let ray_from_pixel = Matrix3::new(1.0 / fx, 0.0, -cx / fx, 0.0, 1.0 / fy, -cy / fy, 0.0, 0.0, 1.0);
        Self {
            from,
            to: to.camera,
            to_ray_from_pixel: motion.rotation() * ray_from_pixel,
            shift: motion.origin().coords,
        }
    }

    /// Every pixel's point in the other camera's frame, rows first.
    fn points(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        let depth_z = &self.from.truth.depth_z;
        depth_z.rows().enumerate().flat_map(move |(y, row)| {
            row.iter().enumerate().map(move |(x, z)| {
                let z = if *z > 0.0 && z.is_finite() { f64::from(*z) } else { 0.0 };
                let pixel = Vector3::new(pixel::center_of(x), pixel::center_of(y), 1.0);
                self.to_ray_from_pixel * pixel * z + self.shift
            })
        })
    }

    /// Continuous pixel of a point, also of one behind the camera; NaN at its centre.
    fn project(&self, point: &Vector3<f64>) -> Point2<f64> {
        let Camera { fx, fy, cx, cy, .. } = self.to;
        Point2::new(fx * (point.x / point.z) + cx, fy * (point.y / point.z) + cy)
    }
}

/// All matches of a pair, and the pixels to take negatives from; positions are `x + y · width`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MatchPool {
    /// Pixels of A and B that see the same ground, in order of A's.
    pub positives: Vec<[u32; 2]>,
    /// Pixels of A, and of B, that are in no match.
    pub negatives: [Vec<u32>; 2],
    /// More of them, taken when the first run out: seen by the other view, but by no pixel of it alone.
    spare: [Vec<u32>; 2],
    widths: [usize; 2],
}

impl MatchPool {
    /// Those of the published rule.
    pub fn reciprocal(a: Sighted<'_>, b: Sighted<'_>) -> Self {
        Self::new(
            [&landings(a, b), &landings(b, a)],
            [a.camera.width, b.camera.width],
            |_, _| true,
            |_, _| false,
        )
    }

    /// Those whose ground is seen from both views.
    pub fn seen(a: Sighted<'_>, b: Sighted<'_>, a_in_b: &[Sight], b_in_a: &[Sight]) -> Self {
        let seen = |sight: &Sight| matches!(sight, Sight::Seen(_));
        Self::new(
            [&landings(a, b), &landings(b, a)],
            [a.camera.width, b.camera.width],
            |in_a, in_b| seen(&a_in_b[in_a]) && seen(&b_in_a[in_b]),
            |view_idx, idx| seen(&[a_in_b, b_in_a][view_idx][idx]),
        )
    }

    /// `matched` decides on a reciprocal pair of pixels, `spared` which unmatched pixels of a view are negatives in need only.
    fn new(
        [a_to_b, b_to_a]: [&[u32]; 2],
        widths: [usize; 2],
        matched: impl Fn(usize, usize) -> bool,
        spared: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let mut pool = Self { widths, ..Self::default() };
        let mut taken = [vec![false; a_to_b.len()], vec![false; b_to_a.len()]];
        for (in_a, &in_b) in a_to_b.iter().enumerate() {
            if b_to_a[in_b as usize] as usize == in_a && matched(in_a, in_b as usize) {
                pool.positives.push([in_a as u32, in_b]);
                (taken[0][in_a], taken[1][in_b as usize]) = (true, true);
            }
        }
        for (view_idx, taken) in taken.iter().enumerate() {
            for idx in (0..taken.len()).filter(|idx| !taken[*idx]) {
                let list = if spared(view_idx, idx) { &mut pool.spare } else { &mut pool.negatives };
                list[view_idx].push(idx as u32);
            }
        }
        pool
    }

    /// Draws `count` matches, of which the share `negative_share` (or what it takes to fill up) is false: pixels of A and of B
    /// drawn independently from those that are in no match.
    ///
    /// # Errors
    /// [`Error::Value`] if the pictures have fewer pixels than that.
    pub fn sample(
        mut self,
        count: usize,
        negative_share: f64,
        stream: &mut Stream,
    ) -> Result<Matches, Error> {
        let available = |view: usize| self.negatives[view].len() + self.spare[view].len();
        let available = available(0).min(available(1));
        let wanted = (count as f64 * (1.0 - negative_share)) as usize;
        let num_negative = (count - self.positives.len().min(wanted)).min(available);
        let num_positive = count - num_negative;
        if num_positive > self.positives.len() {
            return Err(Error::Value {
                key: "matches.count".into(),
                expected: format!("at most {}, the pixels of a view", available + self.positives.len()),
                found: count.to_string(),
            });
        }
        if num_positive < self.positives.len() {
            draw(&mut self.positives, num_positive, stream);
        }
        for (list, spare) in self.negatives.iter_mut().zip(&mut self.spare) {
            let missing = num_negative.saturating_sub(list.len());
            draw(spare, missing, stream);
            draw(list, num_negative - missing, stream);
            list.append(spare);
        }
        let place = |view: usize, idx: u32| {
            let width = self.widths[view] as u32;
            [idx % width, idx / width]
        };
        let all = |view: usize| {
            let positives = self.positives.iter().map(move |pair| pair[view]);
            positives.chain(self.negatives[view].iter().copied()).map(move |idx| place(view, idx)).collect()
        };
        Ok(Matches { a: all(0), b: all(1), valid: (0..count).map(|n| n < num_positive).collect() })
    }
}

/// Keeps `count` of a list, in random order.
fn draw<T>(list: &mut Vec<T>, count: usize, stream: &mut Stream) {
    for n in 0..count {
        let other = n + stream.index(list.len() - n);
        list.swap(n, other);
    }
    list.truncate(count);
}

#[cfg(test)]
mod tests;
