//! `transform.json`: what leads from the prediction into the grid's world.

use crate::Error;
use crate::grid::{Dem, GridFrame};
use crate::transform_file::Alignment;
use selenograph_geometry::Sim3;

/// From the prediction to the body, or to the local frame of the grid.
pub(super) fn transform(dem: &Dem) -> Result<String, Error> {
    let alignment = match &dem.frame {
        GridFrame::Map { crs, body_from_pred } => {
            Alignment { world: crs.body.frame.clone(), world_from_pred: *body_from_pred, metric: true }
        }
        GridFrame::Local { local_from_pred, metric, .. } => Alignment {
            world: "local".to_owned(),
            world_from_pred: Sim3::new(local_from_pred.scale(), local_from_pred.rigid().relabel())?,
            metric: *metric,
        },
    };
    alignment.to_json()
}
