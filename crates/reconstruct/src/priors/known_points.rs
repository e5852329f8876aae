//! The size and the place of a prediction from points of picture A whose place is known.

use crate::Error;
use crate::prediction::{PredictedView, Prediction};
use crate::scale::{Placement, ScaleKind, World};
use selenograph_geometry::{
    Body, BodyFixed, Enu, Frame, Geodetic, Point2, Point3, PredA, Rigid3, Sim3, Vector3, pixel,
};

/// Where a known point lies.
#[derive(Debug, Clone, PartialEq)]
pub enum KnownPlace {
    /// On a body: latitude, longitude, height.
    Body(Body, Geodetic),
    /// In a Cartesian frame of the user, metres, Z up.
    Local(Point3<f64>),
}

/// A point of picture A whose place is known.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownPoint {
    /// Where it is in picture A, pixels from the corner.
    pub pixel: Point2<f64>,
    /// Where it is in the world.
    pub place: KnownPlace,
}

/// A similarity has seven parameters.
const MIN_POINTS: usize = 3;
const WHAT: &str = "scale from known points";

/// Size and place by a least-squares similarity through all points (every point counts: nothing is thrown out in silence).
pub(super) fn place(
    prediction: &Prediction,
    points: &[KnownPoint],
    world: &World,
) -> Result<Placement, Error> {
    let Some([a, _]) = &prediction.views else {
        return Err(Error::TooFewPoints { what: WHAT, needed: MIN_POINTS, found: 0 });
    };
    let seen: Vec<(Point3<f64>, &KnownPlace)> =
        points.iter().filter_map(|point| Some((predicted(a, &point.pixel)?, &point.place))).collect();
    if seen.len() < MIN_POINTS {
        return Err(Error::TooFewPoints { what: WHAT, needed: MIN_POINTS, found: seen.len() });
    }
    let bodies = seen.iter().filter(|(_, place)| matches!(place, KnownPlace::Body(..))).count();
    let from: Vec<Point3<f64>> = seen.iter().map(|(p, _)| *p).collect();
    let to: Vec<Point3<f64>> = seen
        .iter()
        .map(|(_, place)| match place {
            KnownPlace::Body(body, place) => body.point(place),
            KnownPlace::Local(point) => *point,
        })
        .collect();
    match seen.first() {
        Some((_, KnownPlace::Body(body, _))) if bodies == seen.len() => {
            let (body_from_pred, sigma) = similarity::<BodyFixed>(&from, &to)?;
            Placement::from_body(body.clone(), &body_from_pred, sigma, ScaleKind::Points)
        }
        _ if bodies == 0 => {
            let (local_from_pred, scale_sigma) = similarity::<Enu>(&from, &to)?;
            let world = match world {
                // A place on a body says more than the user's frame.
                World::Body { .. } => world.clone(),
                _ => World::Level(local_from_pred.rigid().relabel()),
            };
            Ok(Placement {
                cam_a_from_pred: Sim3::new(local_from_pred.scale(), Rigid3::identity())?,
                metric: true,
                scale_sigma,
                source: ScaleKind::Points,
                world,
            })
        }
        _ => Err(Error::Undetermined {
            what: WHAT,
            why: "points of a body and of a local frame are mixed".into(),
        }),
    }
}

/// The predicted point at a pixel: bilinear over the pixels that are there, the nearest one where not all are.
fn predicted(view: &PredictedView, at: &Point2<f64>) -> Option<Point3<f64>> {
    let (x, y) = (pixel::sample_position(at.x), pixel::sample_position(at.y));
    let (column, row) = (x.floor(), y.floor());
    let (fx, fy) = (x - column, y - row);
    let point = |dx: i64, dy: i64| -> Option<Vector3<f64>> {
        let (x, y) = (usize::try_from(column as i64 + dx).ok()?, usize::try_from(row as i64 + dy).ok()?);
        let point = view.points.get(x, y)?;
        point.iter().all(|v| v.is_finite()).then(|| Vector3::from(point.map(f64::from)))
    };
    let corners =
        [(0, 0, (1.0 - fx) * (1.0 - fy)), (1, 0, fx * (1.0 - fy)), (0, 1, (1.0 - fx) * fy), (1, 1, fx * fy)];
    let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
    for (dx, dy, share) in corners {
        if let Some(point) = point(dx, dy).filter(|_| share > 0.0) {
            sum += share * point;
            weight += share;
        }
    }
    // The nearest pixel has at least a quarter of the weight.
    (weight >= 0.25).then(|| Point3::from(sum / weight))
}

/// The least-squares similarity, and the relative sigma of its scale from the residuals where there are more than three points.
///
/// # Source
/// Umeyama 1991, "Least-squares estimation of transformation parameters between two point patterns", IEEE TPAMI 13(4).
fn similarity<To: Frame>(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
) -> Result<(Sim3<To, PredA>, Option<f64>), Error> {
    let n = from.len() as f64;
    let mean = |points: &[Point3<f64>]| points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let (from_mean, to_mean) = (mean(from), mean(to));
    let (mut cross, mut spread) = (nalgebra::Matrix3::zeros(), 0.0);
    for (p, q) in from.iter().zip(to) {
        let (p, q) = (p.coords - from_mean, q.coords - to_mean);
        cross += q * p.transpose();
        spread += p.norm_squared();
    }
    let svd = cross.svd(true, true);
    let undetermined = || Error::Undetermined { what: WHAT, why: "the points lie on a line".into() };
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(undetermined()) };
    let sizes = svd.singular_values;
    if !(sizes[1] > 1e-9 * sizes[0]) {
        return Err(undetermined());
    }
    let sign = if (u * v_t).determinant() < 0.0 { -1.0 } else { 1.0 };
    let flip = nalgebra::Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
    let rotation = u * flip * v_t;
    let scale = (sizes[0] + sizes[1] + sign * sizes[2]) / spread;
    let origin = Point3::from(to_mean - scale * (rotation * from_mean));
    let found = Sim3::new(scale, Rigid3::from_matrix(&rotation, origin)?)?;
    let squares: f64 = from.iter().zip(to).map(|(p, q)| (found.point(p) - q).norm_squared()).sum();
    // 3n observations, seven parameters; Var(scale) = variance / Σ |p|².
    let free = 3.0 * n - 7.0;
    let sigma = (squares / free / spread).sqrt() / scale;
    Ok((found, (from.len() > MIN_POINTS).then_some(sigma)))
}
