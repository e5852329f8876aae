//! A window of a view as a camera of its own would see it: turned about its centre so that the principal point stays in the
//! middle of the picture.

use super::view::{Fidelity, UndevelopedView};
use super::warp;
use crate::correspondence::{MatchPool, Sighted};
use crate::rng::Stream;
use crate::sample::ViewTruth;
use selenograph_geometry::{Camera, Matrix3, Point3, Rigid3, Rotation3, Vector2, Vector3};
use selenograph_raster::resample::pillow::{self, Filter};
use serde::{Deserialize, Serialize};

/// Windows tried in each view.
const NUM_TRIALS: usize = 4;
/// The least by which the picture exceeds the windows cut from it, as a share of it.
const MIN_SPARE_SHARE: f64 = 0.1;
/// Pictures reduced by more than this are smoothed before they are sampled (`Fidelity::Exact`).
const MAX_REDUCTION: f64 = 1.25;

/// Which windows of the two views are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Windows {
    /// The middle, as large as fits.
    #[default]
    Middle,
    /// Of several drawn in each view, the two that share the most matches (`aug_crop = 'auto'`).
    Matched,
}

/// A camera turned about its centre, and the way of pixels back into the picture it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Turn {
    /// The camera of the new picture.
    pub camera: Camera,
    /// The old camera's axes from the new one's.
    pub old_from_new: Matrix3<f64>,
    /// Continuous pixels of the old picture from those of the new one, as they are sampled.
    pub source_from_target: Matrix3<f64>,
    fidelity: Fidelity,
}

impl Turn {
    /// Onto a window `[left, top, right, bottom]` of the old picture, rounded to whole pixels, which becomes a picture of
    /// `target` pixels. The corner of the window that is farthest from the old principal point stays where it was.
    ///
    /// With [`Fidelity::Published`] both principal points are those of the first pixel's centre while pixels are sampled from
    /// their corners: half a pixel off, as the reference does it.
    ///
    /// # Errors
    /// [`crate::Error::Geometry`] for an empty window or target.
    ///
    /// # Source
    /// The training data of Leroy, Cabon, Revaud 2024, "Grounding Image Matching in 3D with MASt3R".
    pub fn onto(
        camera: &Camera,
        window: [f64; 4],
        target: [usize; 2],
        fidelity: Fidelity,
    ) -> Result<Self, crate::Error> {
        let convention = fidelity.convention();
        let k = camera.k(convention);
        let window = window.map(f64::round_ties_even);
        let size = Vector2::new(window[2] - window[0], window[3] - window[1]);
        let focal = Vector2::new(k[(0, 0)], k[(1, 1)]);
        let (mut old, mut new) = (Vector2::zeros(), Vector2::zeros());
        for axis in 0..2 {
            let middle = k[(axis, 2)];
            let [low, high] = [window[axis], window[axis + 2]];
            let (corner, corner_there) =
                if (low - middle).abs() > (high - middle).abs() { (low, 0.0) } else { (high, size[axis]) };
            old[axis] = (corner - middle) / focal[axis];
            new[axis] = (corner_there - size[axis] / 2.0) / focal[axis];
        }
        let zoom = (target[0] as f64 / size.x).min(target[1] as f64 / size.y);
        let mut k_new = Matrix3::from_diagonal(&Vector3::new(focal.x * zoom, focal.y * zoom, 1.0));
        (k_new[(0, 2)], k_new[(1, 2)]) = (target[0] as f64 / 2.0, target[1] as f64 / 2.0);
        Self::new(&k, &k_new, tilt(&old) * tilt(&new).inverse(), target, fidelity)
    }

    fn new(
        k_old: &Matrix3<f64>,
        k_new: &Matrix3<f64>,
        rotation: Rotation3<f64>,
        target: [usize; 2],
        fidelity: Fidelity,
    ) -> Result<Self, crate::Error> {
        let camera = Camera::from_k(target[0], target[1], k_new, fidelity.convention())?;
        let (fx, fy, cx, cy) = (k_new[(0, 0)], k_new[(1, 1)], k_new[(0, 2)], k_new[(1, 2)]);
        let inverse = Matrix3::new(1.0 / fx, 0.0, -cx / fx, 0.0, 1.0 / fy, -cy / fy, 0.0, 0.0, 1.0);
        let old_from_new = *rotation.matrix();
        Ok(Self { camera, old_from_new, source_from_target: k_old * old_from_new * inverse, fidelity })
    }

    /// The same, then rolled about the new optical axis, and zoomed in as far as it takes to see nothing beyond the old picture.
    ///
    /// # Errors
    /// [`crate::Error::Geometry`] for a zoom that no camera has.
    pub fn rolled(&self, old: &Camera, roll_rad: f64) -> Result<Self, crate::Error> {
        let convention = self.fidelity.convention();
        let (k_old, k) = (old.k(convention), self.camera.k(convention));
        let rotation = Rotation3::from_matrix_unchecked(self.old_from_new)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), roll_rad);
        let zoomed = |zoom: f64| {
            let mut k_new = k;
            (k_new[(0, 0)], k_new[(1, 1)]) = (k[(0, 0)] * zoom, k[(1, 1)] * zoom);
            Self::new(&k_old, &k_new, rotation, [self.camera.width, self.camera.height], self.fidelity)
        };
        let (mut low, mut high) = (1.0, 1.0);
        while !zoomed(high)?.sees_only(old) && high < 16.0 {
            (low, high) = (high, high * 2.0);
        }
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            if zoomed(middle)?.sees_only(old) { high = middle } else { low = middle }
        }
        zoomed(high)
    }

    /// Whether all of the new picture lies in the old one.
    fn sees_only(&self, old: &Camera) -> bool {
        let (width, height) = (self.camera.width as f64, self.camera.height as f64);
        [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)].iter().all(|(x, y)| {
            let at = warp::through(&self.source_from_target, *x, *y);
            (0.0..=old.width as f64).contains(&at.x) && (0.0..=old.height as f64).contains(&at.y)
        })
    }

    /// The view that the turned camera has.
    pub fn apply(&self, view: &UndevelopedView) -> UndevelopedView {
        let target = [self.camera.width, self.camera.height];
        let (smooth, scale) = self.smoothed(view);
        let turned = Rigid3::new(Rotation3::from_matrix_unchecked(self.old_from_new), Point3::origin());
        let truth = ViewTruth {
            depth_z: warp::depth_z(
                &view.camera,
                &view.truth,
                &self.source_from_target,
                &self.old_from_new.column(2).into_owned(),
                target,
                self.fidelity,
            ),
            world_from_cam: &view.truth.world_from_cam * &turned,
        };
        let levels = warp::picture(
            smooth.as_ref().unwrap_or(&view.levels),
            &(scale * self.source_from_target),
            target,
            self.fidelity,
        );
        UndevelopedView { levels, camera: self.camera.clone(), truth }
    }

    /// The picture at the size at which the window has about as many pixels as the target, if it has many more, and its pixels
    /// from the old ones.
    fn smoothed(&self, view: &UndevelopedView) -> (Option<selenograph_raster::Raster<f32>>, Matrix3<f64>) {
        let reduction = (view.camera.fx / self.camera.fx).min(view.camera.fy / self.camera.fy);
        if self.fidelity == Fidelity::Published || reduction <= MAX_REDUCTION {
            return (None, Matrix3::identity());
        }
        let (old, side) = (&view.levels, |side: usize| (side as f64 / reduction).round());
        let (width, height) = (side(old.width).max(1.0), side(old.height).max(1.0));
        let smooth = pillow::resize_float(old, width as usize, height as usize, Filter::Lanczos);
        let scale = Vector3::new(width / old.width as f64, height / old.height as f64, 1.0);
        (Some(smooth), Matrix3::from_diagonal(&scale))
    }
}

/// The rotation that takes the optical axis to the direction `(p, 1)`, about an axis across both.
fn tilt(p: &Vector2<f64>) -> Rotation3<f64> {
    let about = Vector3::new(-p.y, p.x, 0.0);
    match selenograph_geometry::Unit::try_new(about, 0.0) {
        Some(axis) => Rotation3::from_axis_angle(&axis, p.norm().atan()),
        None => Rotation3::identity(),
    }
}

/// Windows of a view, drawn as the published training draws them: one scale for all of them, then a place for each.
fn trials(size: [usize; 2], target: [usize; 2], stream: &mut Stream) -> [[f64; 4]; NUM_TRIALS] {
    let [width, height] = size.map(|side| side as f64);
    let shortest = size[0].min(size[1]);
    let needed = target[0].min(target[1]);
    let spare = (shortest as f64 * MIN_SPARE_SHARE)
        .max((shortest * shortest.saturating_sub(needed) / needed.max(1)) as f64);
    let fit = (width / target[0] as f64).min(height / target[1] as f64);
    let window = target.map(|side| side as f64 * fit);
    let scale = stream.uniform(0.0, (spare / shortest as f64).ln_1p()).exp();
    let room = [(width * scale).floor() - window[0], (height * scale).floor() - window[1]];
    std::array::from_fn(|_| {
        let left = stream.unit() * room[0];
        let top = stream.unit() * room[1];
        [left, top, left + window[0], top + window[1]].map(|edge| edge / scale)
    })
}

/// The two windows with the most matches between them, of several drawn in each view; the first two where there are none.
pub fn choose(views: [&UndevelopedView; 2], target: [usize; 2], stream: &mut Stream) -> [[f64; 4]; 2] {
    let windows = views.map(|view| trials([view.camera.width, view.camera.height], target, stream));
    let [a, b] = views.map(UndevelopedView::sighted);
    let pool = MatchPool::reciprocal(a, b);
    let mut counts = [[0usize; NUM_TRIALS]; NUM_TRIALS];
    for pair in &pool.positives {
        let held = |view: usize, view_sighted: Sighted<'_>| {
            let width = view_sighted.camera.width as u32;
            let (x, y) = (f64::from(pair[view] % width), f64::from(pair[view] / width));
            windows[view]
                .map(|[left, top, right, bottom]| (left..right).contains(&x) && (top..bottom).contains(&y))
        };
        let (in_a, in_b) = (held(0, a), held(1, b));
        for i in (0..NUM_TRIALS).filter(|i| in_a[*i]) {
            for j in (0..NUM_TRIALS).filter(|j| in_b[*j]) {
                counts[i][j] += 1;
            }
        }
    }
    let mut best = (0, 0);
    for i in 0..NUM_TRIALS {
        for j in 0..NUM_TRIALS {
            if counts[i][j] > counts[best.0][best.1] {
                best = (i, j);
            }
        }
    }
    [windows[0][best.0], windows[1][best.1]]
}
