//! A view made as small as it may be to cover a size, and its middle cut out.

use super::{Draft, Fidelity, warp};
use crate::Error;
use crate::sample::ViewTruth;
use nalgebra::{Matrix3, Vector3};
use selenograph_geometry::{Camera, pixel};
use selenograph_raster::Raster;
use selenograph_raster::resample::pillow::{self, Filter};

/// Added to the scale by the reference, so that rounding leaves no side one pixel short.
const SCALE_MARGIN: f64 = 1e-8;

/// A view in the smallest size that covers `target` pixels, with its proportions kept.
///
/// # Errors
/// [`Error::Geometry`] for an empty target.
///
/// # Source
/// For [`Fidelity::Published`], the training data of Leroy, Cabon, Revaud 2024, "Grounding Image Matching in 3D with MASt3R";
/// otherwise depth is interpolated, and the camera scaled as the pixels are.
pub fn cover(draft: Draft, target: [usize; 2], fidelity: Fidelity) -> Result<Draft, Error> {
    let size = [draft.camera.width, draft.camera.height];
    let ratio = |side: usize| target[side] as f64 / size[side] as f64;
    let scale = ratio(0).max(ratio(1)) + SCALE_MARGIN;
    let [width, height] = size.map(|side| (side as f64 * scale) as usize);
    if [width, height] == size {
        return Ok(draft);
    }
    let filter = if scale < 1.0 { Filter::Lanczos } else { Filter::Bicubic };
    let camera = match fidelity {
        Fidelity::Exact => pixel::resize(&draft.camera, width, height)?,
        Fidelity::Published => {
            // The picture is taken to be scaled by `scale` and centred in the whole pixels that it got.
            let middle =
                |value: f64, old: usize, new: usize| value * scale - 0.5 * (old as f64 * scale - new as f64);
            Camera {
                width,
                height,
                fx: draft.camera.fx * scale,
                fy: draft.camera.fy * scale,
                cx: middle(draft.camera.cx, size[0], width),
                cy: middle(draft.camera.cy, size[1], height),
                ..draft.camera.clone()
            }
        }
    };
    let levels = match fidelity {
        Fidelity::Exact => pillow::resize_float(&draft.levels, width, height, filter).map(|v| v.max(0.0)),
        Fidelity::Published => {
            let bytes = draft.levels.map(|value| [value.round() as u8]);
            pillow::resize(&bytes, width, height, filter).map(|[value]| f32::from(*value))
        }
    };
    let steps = Vector3::new(size[0] as f64 / width as f64, size[1] as f64 / height as f64, 1.0);
    let truth = draft.truth.as_ref().map(|truth| ViewTruth {
        depth_z: match fidelity {
            Fidelity::Published => Raster::from_fn(width, height, |x, y| {
                truth.depth_z[((x as f64 * steps.x) as usize, (y as f64 * steps.y) as usize)]
            }),
            Fidelity::Exact => {
                let back = Matrix3::from_diagonal(&steps);
                warp::depth_z(&draft.camera, truth, &back, &Vector3::z(), [width, height], fidelity)
            }
        },
        world_from_cam: truth.world_from_cam,
    });
    Ok(Draft { levels, camera, truth })
}

/// The middle of a view.
///
/// # Errors
/// [`Error::Geometry`] if the view is smaller.
pub fn middle(draft: &Draft, [width, height]: [usize; 2]) -> Result<Draft, Error> {
    let origin =
        |side: usize, kept: usize| (0.5 * side.saturating_sub(kept) as f64).round_ties_even() as usize;
    let (left, top) = (origin(draft.camera.width, width), origin(draft.camera.height, height));
    let camera = pixel::crop(&draft.camera, left, top, width, height)?;
    let cut = |raster: &Raster<f32>| Raster::from_fn(width, height, |x, y| raster[(x + left, y + top)]);
    Ok(Draft {
        levels: cut(&draft.levels),
        camera,
        truth: draft
            .truth
            .as_ref()
            .map(|truth| ViewTruth { depth_z: cut(&truth.depth_z), world_from_cam: truth.world_from_cam }),
    })
}
