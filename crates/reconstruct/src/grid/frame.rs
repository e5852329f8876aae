//! In which coordinates a surface is gridded: a map of the body, or a local frame.

use super::plane;
use crate::Error;
use crate::prediction::{Fill, Prediction};
use crate::scale::{Placement, World};
use selenograph_geometry::proj_string::Crs;
use selenograph_geometry::{
    Body, BodyFixed, Enu, Geodetic, Matrix3, Point3, Pole, PredA, Projection, Rigid3, Rotation3, Sim3,
    Vector3,
};

/// Poleward of this latitude maps are polar stereographic (the split of the IAU's own maps), radians.
const POLAR_LAT_RAD: f64 = 60.0 * std::f64::consts::PI / 180.0;
/// Centres of local maps are rounded to this, degrees (some 300 m on the Moon), so that neighbouring results often share
/// a map.
const CENTER_STEP_DEG: f64 = 0.01;

/// Coordinates of a grid: x to the right of the raster, y upwards in it, height out of it.
#[derive(Debug, Clone)]
pub enum GridFrame {
    /// A map of a body; x and y are map metres, height is above the body's sphere.
    Map {
        /// Body and projection.
        crs: Crs,
        /// From the prediction to the body.
        body_from_pred: Sim3<BodyFixed, PredA>,
    },
    /// A Cartesian frame near the scene.
    Local {
        /// From the prediction to it.
        local_from_pred: Sim3<Enu, PredA>,
        /// Whether its unit is the metre; else it is the baseline.
        metric: bool,
        /// Whether its Z is the local vertical; else it is the normal of the plane through the surface.
        level: bool,
    },
}

impl GridFrame {
    /// The frame for a placed prediction: a map where the place on a body is known (polar stereographic poleward of
    /// 60°, else orthographic about the scene), the level frame where the vertical is known, else the plane through
    /// the surface with x along the picture's rows and height towards camera A.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] and [`Error::Undetermined`] if there is no surface to lay a frame through.
    pub fn of(prediction: &Prediction, placement: &Placement) -> Result<Self, Error> {
        let points = sampled_points(prediction);
        if points.is_empty() {
            return Err(Error::TooFewPoints { what: "a grid", needed: 3, found: 0 });
        }
        if let (Some(body_from_pred), World::Body { body, .. }) =
            (placement.body_from_pred(), &placement.world)
        {
            let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
            let crs = map_about(body, &body_from_pred.point(&Point3::from(middle)));
            return Ok(Self::Map { crs, body_from_pred });
        }
        let scale = placement.cam_a_from_pred.scale();
        let metric = placement.metric;
        if let (World::Level(level_from_cam_a), true) = (&placement.world, metric) {
            let local_from_pred = Sim3::new(scale, level_from_cam_a.relabel())?;
            return Ok(Self::Local { local_from_pred, metric, level: true });
        }
        let up = placement.world.up_in_cam_a();
        let plane = match up {
            Some(normal) => plane::Plane { normal, ..plane::fit(&points, &Vector3::zeros())? },
            None => plane::fit(&points, &Vector3::zeros())?,
        };
        let local_from_pred = Sim3::new(scale, local_from_plane(&plane, scale))?;
        Ok(Self::Local { local_from_pred, metric, level: up.is_some() })
    }

    /// A point of the prediction as x, y and height; `None` where the map does not reach.
    #[inline]
    pub fn point(&self, point_in_pred: &Point3<f64>) -> Option<[f64; 3]> {
        match self {
            Self::Map { crs, body_from_pred } => {
                let in_body = body_from_pred.point(point_in_pred);
                let [x, y] = crs.projection.map_from_point(&in_body)?;
                Some([x, y, crs.body.height_m(&in_body)])
            }
            Self::Local { local_from_pred, .. } => {
                let p = local_from_pred.point(point_in_pred);
                Some([p.x, p.y, p.z])
            }
        }
    }

    /// The point of the prediction at x, y and height; `None` off the map.
    #[inline]
    pub fn point_in_pred(&self, [x, y, height]: [f64; 3]) -> Option<Point3<f64>> {
        match self {
            Self::Map { crs, body_from_pred } => {
                let place = crs.projection.place_from_map(x, y)?;
                let in_body = crs.body.point(&Geodetic { height_m: height, ..place });
                Some(body_from_pred.inverse().point(&in_body))
            }
            Self::Local { local_from_pred, .. } => {
                Some(local_from_pred.inverse().point(&Point3::new(x, y, height)))
            }
        }
    }

    /// Length of a unit of the prediction here.
    pub fn scale(&self) -> f64 {
        match self {
            Self::Map { body_from_pred, .. } => body_from_pred.scale(),
            Self::Local { local_from_pred, .. } => local_from_pred.scale(),
        }
    }

    /// Whether lengths are metres.
    pub fn is_metric(&self) -> bool {
        match self {
            Self::Map { .. } => true,
            Self::Local { metric, .. } => *metric,
        }
    }

    /// The coordinate system, where there is one.
    pub fn crs(&self) -> Option<&Crs> {
        match self {
            Self::Map { crs, .. } => Some(crs),
            Self::Local { .. } => None,
        }
    }

    /// Ground lengths per unit of x and of y at a place of the grid (a map stretches).
    pub fn ground_per_unit(&self, x: f64, y: f64) -> [f64; 2] {
        match self {
            Self::Map { crs, .. } => {
                crs.projection.ground_m_per_unit(x, y, crs.body.radius_m).unwrap_or([1.0, 1.0])
            }
            Self::Local { .. } => [1.0, 1.0],
        }
    }
}

/// The map for a scene around a body-fixed point.
pub fn map_about(body: &Body, point: &Point3<f64>) -> Crs {
    let place = body.place(point);
    let radius_m = body.radius_m;
    let projection = if place.lat_rad.abs() >= POLAR_LAT_RAD {
        Projection::polar(if place.lat_rad > 0.0 { Pole::North } else { Pole::South }, radius_m)
    } else {
        let rounded =
            |rad: f64| ((rad.to_degrees() / CENTER_STEP_DEG).round() * CENTER_STEP_DEG).to_radians();
        Projection::Orthographic {
            lat0_rad: rounded(place.lat_rad),
            lon0_rad: rounded(place.lon_rad),
            false_easting_m: 0.0,
            false_northing_m: 0.0,
            radius_m,
        }
    };
    Crs { body: body.clone(), projection }
}

/// A frame in the plane: x along the picture's rows, z along the normal, the plane's middle as origin.
fn local_from_plane(plane: &plane::Plane, scale: f64) -> Rigid3<Enu, PredA> {
    let z = plane.normal;
    let along = |axis: Vector3<f64>| (axis - z * z.dot(&axis)).try_normalize(1e-6);
    // A camera that looks along the plane's x axis still has an image column to go by.
    let x = along(Vector3::x()).or_else(|| along(-Vector3::y())).unwrap_or_else(Vector3::x);
    let cam_from_local = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let turn = Rotation3::from_matrix_unchecked(cam_from_local.transpose());
    Rigid3::new(turn, Point3::from(-(turn * (plane.center * scale))))
}

/// Measured points of both views (all points where none is measured), thinned to some ten thousand.
pub(crate) fn sampled_points(prediction: &Prediction) -> Vec<Vector3<f64>> {
    let Some(views) = &prediction.views else { return Vec::new() };
    let any_measured = views.iter().any(|v| v.fill.data.contains(&Fill::Measured));
    let wanted = if any_measured { Fill::Measured } else { Fill::Completed };
    let mut points = Vec::new();
    for view in views {
        let step = ((view.points.data.len() as f64 / 16_384.0).sqrt().ceil() as usize).max(1);
        for y in (0..view.points.height).step_by(step) {
            for x in (0..view.points.width).step_by(step) {
                let p = Vector3::from(view.points[(x, y)].map(f64::from));
                if view.fill[(x, y)] == wanted && p.norm_squared().is_finite() {
                    points.push(p);
                }
            }
        }
    }
    points
}
