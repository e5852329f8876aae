//! Both views' points as one coloured cloud, and the files it goes to.

pub mod glb;
pub mod las;
pub mod ply;

use crate::Error;
use crate::grid::GridFrame;
use crate::grid::lift::Lifted;
use crate::prediction::Fill;
use selenograph_geometry::proj_string;
use selenograph_raster::Raster;
use serde::{Deserialize, Serialize};

/// How points are coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Coloring {
    /// Grey, as in the pictures.
    #[default]
    Picture,
    /// View A red, view B green: where they agree, the two mix.
    Views,
}

/// What goes into a cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CloudOptions {
    /// How points are coloured.
    pub coloring: Coloring,
    /// Whether completed points are kept (they are marked).
    pub completed: bool,
    /// Points below this confidence are left out.
    pub min_confidence: f32,
}

impl Default for CloudOptions {
    fn default() -> Self {
        Self { coloring: Coloring::Picture, completed: false, min_confidence: 0.0 }
    }
}

/// One point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// x, y, height against [`Cloud::origin`].
    pub position: [f32; 3],
    /// Red, green, blue.
    pub color: [u8; 3],
    /// 0: view A, 1: view B.
    pub view: u8,
    /// 1: measured, 2: completed.
    pub fill: u8,
    /// In `[0, 1]`.
    pub confidence: f32,
    /// Standard deviation along the ray, the cloud's unit; NaN where the method has none.
    pub sigma: f32,
}

/// A cloud in the coordinates of a grid.
#[derive(Debug, Clone)]
pub struct Cloud {
    /// From where positions are counted: x, y, height.
    pub origin: [f64; 3],
    /// The points of view A, then those of view B, each row after row.
    pub points: Vec<CloudPoint>,
    /// Whether lengths are metres.
    pub metric: bool,
    /// The coordinates in words, for the files' headers.
    pub frame: String,
    /// Well-known text of the coordinate system, where there is one.
    pub wkt: Option<String>,
}

/// Gathers both views' points.
///
/// # Shapes and units
/// `pictures`: grey levels of view A and B in `[0, 1]`, of the pointmaps' size.
/// # Errors
/// [`Error::SizeMismatch`] if a picture is not of its pointmap's size; [`Error::TooFewPoints`] if nothing is left.
pub fn gather(
    lifted: &Lifted,
    frame: &GridFrame,
    pictures: [&Raster<f32>; 2],
    options: &CloudOptions,
) -> Result<Cloud, Error> {
    let mut points = Vec::with_capacity(lifted.views.iter().map(|v| v.points.data.len()).sum());
    for (view_idx, (view, picture)) in lifted.views.iter().zip(pictures).enumerate() {
        if (picture.width, picture.height) != (view.points.width, view.points.height) {
            return Err(Error::SizeMismatch {
                what: "picture of a view",
                expected: format!("{}×{}", view.points.width, view.points.height),
                found: format!("{}×{}", picture.width, picture.height),
            });
        }
        let sigma = view.sigma.as_ref();
        for (i, &position) in view.points.data.iter().enumerate() {
            let fill = view.fill.data[i];
            let confidence = view.confidence.data[i];
            let kept = match fill {
                Fill::Absent => false,
                Fill::Measured => true,
                Fill::Completed => options.completed,
            };
            if !kept || position[0].is_nan() || confidence < options.min_confidence {
                continue;
            }
            points.push(CloudPoint {
                position,
                color: color(options.coloring, view_idx, picture.data[i]),
                view: view_idx as u8,
                fill: if fill == Fill::Measured { 1 } else { 2 },
                confidence,
                sigma: sigma.map_or(f32::NAN, |s| s.data[i]),
            });
        }
    }
    if points.is_empty() {
        return Err(Error::TooFewPoints { what: "a cloud", needed: 1, found: 0 });
    }
    Ok(Cloud {
        origin: lifted.origin,
        points,
        metric: frame.is_metric(),
        frame: describe(frame),
        wkt: frame.crs().map(super::grid::wkt::wkt),
    })
}

fn color(coloring: Coloring, view_idx: usize, grey: f32) -> [u8; 3] {
    // A pixel without a grey level (masked) still has a point.
    let grey = if grey.is_nan() { 0.5 } else { grey.clamp(0.0, 1.0) };
    let level = (grey * 255.0).round() as u8;
    match (coloring, view_idx) {
        (Coloring::Picture, _) => [level; 3],
        // Half of full colour in the shadow, so that no point is black.
        (Coloring::Views, 0) => [128 + level / 2, 24, 24],
        (Coloring::Views, _) => [24, 128 + level / 2, 24],
    }
}

/// The coordinates of a grid in words.
pub fn describe(frame: &GridFrame) -> String {
    let unit =
        if frame.is_metric() { "metres" } else { "no scale source: baselines, or a network's own unit" };
    match frame {
        GridFrame::Map { crs, .. } => {
            let (radius, name) = (crs.body.radius_m, &crs.body.name);
            format!(
                "map x, map y, height above the {name}'s sphere of {radius} m; {}",
                proj_string::format(crs)
            )
        }
        GridFrame::Local { level: true, .. } => format!("local, z along the vertical; {unit}"),
        GridFrame::Local { .. } => {
            format!("local, x along the rows of picture A, z along the surface's mean normal; {unit}")
        }
    }
}

#[cfg(test)]
mod tests;
