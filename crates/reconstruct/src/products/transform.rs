//! `transform.json`: what leads from `pointmaps.npz` into the grid's world.

use crate::Error;
use crate::grid::{Dem, GridFrame};
use crate::transform_file::Alignment;
use selenograph_geometry::Sim3;

/// From the written points to the body, or to the local frame of the grid.
///
/// The points are written in the axes of camera A and in the world's unit ([`super::arrays`]), so the scale is in them already.
pub(super) fn transform(dem: &Dem) -> Result<String, Error> {
    let alignment = match &dem.frame {
        GridFrame::Map { crs, body_from_pred } => {
            let world_from_pred = Sim3::new(1.0, *body_from_pred.rigid())?;
            Alignment { world: crs.body.frame.clone(), world_from_pred, metric: true }
        }
        GridFrame::Local { local_from_pred, metric, .. } => Alignment {
            world: "local".to_owned(),
            world_from_pred: Sim3::new(1.0, local_from_pred.rigid().relabel())?,
            metric: *metric,
        },
    };
    alignment.to_json()
}
