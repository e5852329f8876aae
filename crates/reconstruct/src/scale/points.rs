//! Scale and place by known points: pixels of picture A whose places are known.
//!
//! The pointmap of view A is read at each pixel (bilinear), and the similarity of least squares that carries these points to the
//! known places is taken; three points that are not on a line are enough, from five on blunders are left out.

use super::{Placement, ScaleSource, World};
use crate::Error;
use crate::prediction::{Fill, Prediction};
use selenograph_geometry::{Body, BodyFixed, CamA, Enu, Frame, Geodetic, Point3, PredA, Rigid3, Sim3, pixel};
use selenograph_pose::similarity;
use std::path::Path;

/// A pixel of picture A and its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownPoint {
    /// Column and row, measured from the picture's corner.
    pub pixel: [f64; 2],
    /// Metres, in the body's frame or in a level local frame.
    pub place: Point3<f64>,
}

/// Known points and the frame of their places.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownPoints {
    /// The points.
    pub points: Vec<KnownPoint>,
    /// The body; `None` for a level local frame (x, y horizontal, z up).
    pub body: Option<Body>,
}

/// How well a prediction fits known points.
#[derive(Debug, Clone)]
pub struct PointsFit {
    /// Scale and place.
    pub placement: Placement,
    /// Distance of each point from its place, metres; NaN where the pointmap has none.
    pub residuals_m: Vec<f64>,
    /// Root mean square of the residuals that count, metres.
    pub residual_rms_m: f64,
    /// Share of the points found that count.
    pub inlier_share: f64,
}

/// From this many points on a blunder can be told from the rest: three fix a similarity, two must agree with it.
const MIN_ROBUST: usize = 5;

impl KnownPoints {
    /// Reads a CSV with a header: `u_px,v_px` and either `x_m,y_m,z_m` or `latitude_deg,longitude_deg,height_m` (on the
    /// Moon where no body is given); other columns are left aside, lines that begin with `#` too.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] for missing columns or cells that are no numbers.
    pub fn read_csv(path: &Path, body: Option<&Body>) -> Result<Self, Error> {
        let text = selenograph_files::regular::read_to_string(path).map_err(Error::io("read", path))?;
        Self::parse_csv(&text, body, path)
    }

    fn parse_csv(text: &str, body: Option<&Body>, path: &Path) -> Result<Self, Error> {
        let format = |expected: &str, found: String| Error::Format {
            path: path.to_owned(),
            expected: expected.to_owned(),
            found,
        };
        let mut lines = text
            .lines()
            .enumerate()
            .filter(|(_, l)| !l.trim().is_empty() && !l.trim_start().starts_with('#'));
        let header = lines.next().map(|(_, line)| line).unwrap_or_default();
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        let columns = |wanted: [&str; 3]| -> Option<[usize; 3]> {
            let [x, y, z] = wanted.map(|name| names.iter().position(|n| *n == name));
            Some([x?, y?, z?])
        };
        let cartesian = columns(["x_m", "y_m", "z_m"]);
        let geographic = columns(["latitude_deg", "longitude_deg", "height_m"]);
        let moon = Body::moon();
        let body = body.or_else(|| (cartesian.is_none() && geographic.is_some()).then_some(&moon));
        let geographic = geographic.zip(body);
        let pixels = columns(["u_px", "v_px", "u_px"]);
        let (Some([u, v, _]), true) = (pixels, cartesian.is_some() || geographic.is_some()) else {
            let expected = "columns u_px, v_px and x_m, y_m, z_m (or latitude_deg, longitude_deg, height_m)";
            return Err(format(expected, format!("`{header}`")));
        };
        let mut points = Vec::new();
        for (line_idx, line) in lines {
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let number = |column: usize| -> Result<f64, Error> {
                let cell = cells.get(column).copied().unwrap_or_default();
                let parsed = cell.parse::<f64>().ok().filter(|v| v.is_finite());
                parsed.ok_or_else(|| {
                    format(
                        "numbers",
                        format!("`{cell}` in line {}, column `{}`", line_idx + 1, names[column]),
                    )
                })
            };
            let place = match (cartesian, geographic) {
                (Some([x, y, z]), _) => Point3::new(number(x)?, number(y)?, number(z)?),
                (None, Some(([lat, lon, height], body))) => {
                    body.point(&Geodetic::from_deg(number(lat)?, number(lon)?, number(height)?))
                }
                (None, None) => continue,
            };
            points.push(KnownPoint { pixel: [number(u)?, number(v)?], place });
        }
        Ok(Self { points, body: body.cloned() })
    }
}

/// Scale and place of a prediction from known points.
///
/// # Errors
/// [`Error::TooFewPoints`] if fewer than three points lie on the pointmap; [`Error::Undetermined`] if they lie on a line.
pub fn fit(prediction: &Prediction, known: &KnownPoints) -> Result<PointsFit, Error> {
    match &known.body {
        Some(body) => {
            let (found, residuals_m) = similarity_of::<BodyFixed>(prediction, known)?;
            let sigma = scale_sigma(&found, &residuals_m, known);
            let placement = Placement::from_body(body.clone(), &found.to_from, sigma, ScaleSource::Points)?;
            Ok(PointsFit::new(placement, residuals_m, &found))
        }
        None => {
            let (found, residuals_m) = similarity_of::<Enu>(prediction, known)?;
            let level_from_cam_a: Rigid3<Enu, CamA> = found.to_from.rigid().relabel();
            let placement = Placement {
                cam_a_from_pred: Sim3::new(found.to_from.scale(), Rigid3::identity())?,
                metric: true,
                scale_sigma: scale_sigma(&found, &residuals_m, known),
                source: Some(ScaleSource::Points),
                world: World::Level(level_from_cam_a),
            };
            Ok(PointsFit::new(placement, residuals_m, &found))
        }
    }
}

impl PointsFit {
    fn new<To: Frame>(
        placement: Placement,
        residuals_m: Vec<f64>,
        found: &similarity::Aligned<To, PredA>,
    ) -> Self {
        Self { placement, residuals_m, residual_rms_m: found.residual_rms, inlier_share: found.inlier_share }
    }
}

fn similarity_of<To: Frame>(
    prediction: &Prediction,
    known: &KnownPoints,
) -> Result<(similarity::Aligned<To, PredA>, Vec<f64>), Error> {
    let nowhere = Point3::new(f64::NAN, f64::NAN, f64::NAN);
    let predicted: Vec<Point3<f64>> =
        known.points.iter().map(|point| point_at(prediction, point.pixel).unwrap_or(nowhere)).collect();
    let places: Vec<Point3<f64>> = known.points.iter().map(|point| point.place).collect();
    let num_found = predicted.iter().filter(|p| p.x.is_finite()).count();
    let found = if num_found < MIN_ROBUST {
        similarity::trimmed::<To, PredA>(&predicted, &places, 0)
    } else {
        similarity::estimate(&predicted, &places, &similarity::SimilarityOptions::default())
    };
    let found = found.map_err(|e| match e {
        similarity::CannotAlign::TooFewPairs { found } => {
            Error::TooFewPoints { what: "scale from known points", needed: 3, found }
        }
        other => Error::Undetermined { what: "scale from known points", why: other.to_string() },
    })?;
    let residuals =
        predicted.iter().zip(&places).map(|(p, q)| similarity::distance(&found.to_from, p, q)).collect();
    Ok((found, residuals))
}

/// Error of a scale from least squares: the residual over the extent and the root of the number of points.
fn scale_sigma<To: Frame>(
    found: &similarity::Aligned<To, PredA>,
    residuals_m: &[f64],
    known: &KnownPoints,
) -> Option<f64> {
    let kept: Vec<&KnownPoint> = known
        .points
        .iter()
        .zip(residuals_m)
        .filter(|(_, r)| **r <= found.threshold)
        .map(|(p, _)| p)
        .collect();
    let count = kept.len() as f64;
    // Seven numbers are spent on the similarity; three coordinates come from each point.
    let spare = 3.0 * count - 7.0;
    if spare <= 0.0 {
        return None;
    }
    let middle = kept.iter().map(|p| p.place.coords).sum::<selenograph_geometry::Vector3<f64>>() / count;
    let squares: f64 = kept.iter().map(|p| (p.place.coords - middle).norm_squared()).sum();
    let variance = found.residual_rms.powi(2) * count / spare;
    Some((variance / squares).sqrt())
}

/// The predicted point at a place of picture A; `None` where one of its neighbours is absent.
fn point_at(prediction: &Prediction, [u, v]: [f64; 2]) -> Option<Point3<f64>> {
    let [view, _] = prediction.views.as_ref()?;
    let (column, row) = (pixel::sample_position(u), pixel::sample_position(v));
    let (width, height) = (view.points.width as f64, view.points.height as f64);
    if !(column >= 0.0 && row >= 0.0 && column <= width - 1.0 && row <= height - 1.0) {
        return None;
    }
    let (x0, y0) = (column.floor(), row.floor());
    let mut sum = selenograph_geometry::Vector3::zeros();
    for (dx, wx) in [(0.0, 1.0 - (column - x0)), (1.0, column - x0)] {
        for (dy, wy) in [(0.0, 1.0 - (row - y0)), (1.0, row - y0)] {
            if wx * wy > 0.0 {
                let at = ((x0 + dx) as usize, (y0 + dy) as usize);
                if view.fill[at] == Fill::Absent {
                    return None;
                }
                sum += selenograph_geometry::Vector3::from(view.points[at].map(f64::from)) * (wx * wy);
            }
        }
    }
    sum.norm_squared().is_finite().then(|| Point3::from(sum))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prediction::PredictedView;
    use selenograph_geometry::Rotation3;
    use selenograph_pose::relative::CannotSay;
    use selenograph_raster::Raster;

    /// A curved surface on 20×16 pixels.
    fn prediction() -> Prediction {
        let points = Raster::from_fn(20, 16, |x, y| {
            let (x, y) = (pixel::center_of(x) as f32, pixel::center_of(y) as f32);
            [x - 10.0, y - 8.0, 30.0 + 0.01 * x * y]
        });
        let view = PredictedView {
            confidence: points.map(|_| 1.0),
            sigma: None,
            fill: points.map(|_| Fill::Measured),
            points,
        };
        let none = CannotSay::TooFewMatches { found: 0, needed: 5 };
        Prediction { cam_b_from_cam_a: Err(none.into()), views: Some([view.clone(), view]) }
    }

    fn truth() -> Sim3<BodyFixed, PredA> {
        let turn = Rotation3::from_euler_angles(0.3, -0.8, 2.0);
        Sim3::new(120.0, Rigid3::new(turn, Point3::new(1.0e6, -1.2e6, 8.0e5))).unwrap()
    }

    fn known(pixels: &[[f64; 2]]) -> KnownPoints {
        // The surface is bilinear in the pixels, so reading between them is exact.
        let place = |[u, v]: [f64; 2]| truth().point(&Point3::new(u - 10.0, v - 8.0, 30.0 + 0.01 * u * v));
        let points = pixels.iter().map(|&pixel| KnownPoint { pixel, place: place(pixel) }).collect();
        KnownPoints { points, body: Some(Body::moon()) }
    }

    const PIXELS: [[f64; 2]; 6] =
        [[1.0, 1.5], [18.2, 2.0], [9.7, 14.0], [3.0, 12.0], [15.0, 8.5], [10.0, 5.0]];
    /// f32 pointmaps of tens of units at 120 m a unit.
    const TOLERANCE_M: f64 = 2e-3;

    #[test]
    fn known_points_give_scale_and_place() {
        let fit = fit(&prediction(), &known(&PIXELS)).unwrap();
        let found = fit.placement.body_from_pred().unwrap();
        let x = Point3::new(5.0, 2.0, 33.0);
        assert!((found.point(&x) - truth().point(&x)).norm() < TOLERANCE_M);
        assert!(fit.residuals_m.iter().all(|r| *r < TOLERANCE_M));
        assert!(fit.placement.scale_sigma.unwrap() < 1e-5);
    }

    #[test]
    fn a_blunder_is_left_out_and_shown() {
        let mut known = known(&PIXELS);
        known.points[2].place.x += 900.0;
        let fit = fit(&prediction(), &known).unwrap();
        assert!(fit.residuals_m[2] > 300.0, "{:?}", fit.residuals_m);
        assert!(fit.inlier_share < 1.0);
    }

    #[test]
    fn a_local_frame_needs_no_body() {
        let mut known = known(&PIXELS);
        known.body = None;
        let fit = fit(&prediction(), &known).unwrap();
        assert!(matches!(fit.placement.world, World::Level(_)));
        assert!((fit.placement.cam_a_from_pred.scale() / 120.0 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn too_few_points_and_points_on_a_line_are_errors() {
        let few = fit(&prediction(), &known(&[[1.0, 1.0], [5.0, 5.0], [40.0, 2.0]]));
        assert!(matches!(few, Err(Error::TooFewPoints { found: 2, .. })));
        let line: Vec<[f64; 2]> = (0..5).map(|i| [2.0 + 3.0 * f64::from(i), 0.5]).collect();
        assert!(fit(&prediction(), &known(&line)).is_err());
    }

    #[test]
    fn tables_are_read_by_their_column_names() {
        let path = Path::new("points.csv");
        let text = "# surveyed\nname,v_px,u_px,latitude_deg,longitude_deg,height_m\nrock,2,1,-89,10,5\n\n";
        let body = Body::moon();
        let known = KnownPoints::parse_csv(text, Some(&body), path).unwrap();
        assert_eq!(known.points[0].pixel, [1.0, 2.0]);
        assert!((body.place(&known.points[0].place).height_m - 5.0).abs() < 1e-6);
        // A latitude without a body is one of the Moon.
        assert_eq!(KnownPoints::parse_csv(text, None, path).unwrap(), known);
        let local = KnownPoints::parse_csv("u_px,v_px,x_m,y_m,z_m\n1,2,3,4,5\n", None, path).unwrap();
        assert_eq!(local.points[0].place, Point3::new(3.0, 4.0, 5.0));
        for broken in [
            "",
            "u_px,v_px\n1,2\n",
            "u_px,v_px,x_m,y_m,z_m\n1,2,3,4\n",
            "u_px,v_px,x_m,y_m,z_m\n1,2,3,4,nan\n",
        ] {
            assert!(
                matches!(KnownPoints::parse_csv(broken, None, path), Err(Error::Format { .. })),
                "{broken}"
            );
        }
    }
}
