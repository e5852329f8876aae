//! A view made as small as it may be to cover a size, and its middle cut out.

use super::view::{Fidelity, UndevelopedView};
use super::warp;
use crate::Error;
use crate::sample::ViewTruth;
use selenograph_geometry::{Camera, Matrix3, Vector3, pixel};
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
pub fn cover(
    view: UndevelopedView,
    target: [usize; 2],
    fidelity: Fidelity,
) -> Result<UndevelopedView, Error> {
    let size = [view.camera.width, view.camera.height];
    let ratio = |side: usize| target[side] as f64 / size[side] as f64;
    let scale = ratio(0).max(ratio(1)) + SCALE_MARGIN;
    let [width, height] = size.map(|side| (side as f64 * scale) as usize);
    if [width, height] == size {
        return Ok(view);
    }
    let filter = if scale < 1.0 { Filter::Lanczos } else { Filter::Bicubic };
    let camera = match fidelity {
        Fidelity::Exact => pixel::resize(&view.camera, width, height)?,
        Fidelity::Published => {
            // The picture is taken to be scaled by `scale` and centred in the whole pixels that it got.
            let middle =
                |value: f64, old: usize, new: usize| value * scale - 0.5 * (old as f64 * scale - new as f64);
            Camera {
                width,
                height,
                fx: view.camera.fx * scale,
                fy: view.camera.fy * scale,
                cx: middle(view.camera.cx, size[0], width),
                cy: middle(view.camera.cy, size[1], height),
                ..view.camera.clone()
            }
        }
    };
    let levels = match fidelity {
        Fidelity::Exact => pillow::resize_float(&view.levels, width, height, filter).map(|v| v.max(0.0)),
        Fidelity::Published => {
            let bytes = view.levels.map(|value| [value.round() as u8]);
            pillow::resize(&bytes, width, height, filter).map(|[value]| f32::from(*value))
        }
    };
    let steps = Vector3::new(size[0] as f64 / width as f64, size[1] as f64 / height as f64, 1.0);
    let truth = &view.truth;
    let truth = ViewTruth {
        depth_z: match fidelity {
            Fidelity::Published => Raster::from_fn(width, height, |x, y| {
                truth.depth_z[((x as f64 * steps.x) as usize, (y as f64 * steps.y) as usize)]
            }),
            Fidelity::Exact => {
                let back = Matrix3::from_diagonal(&steps);
                warp::depth_z(&view.camera, truth, &back, &Vector3::z(), [width, height], fidelity)
            }
        },
        world_from_cam: truth.world_from_cam,
    };
    Ok(UndevelopedView { levels, camera, truth })
}

/// The middle of a view.
///
/// # Errors
/// [`Error::Geometry`] if the view is smaller.
pub fn middle(view: &UndevelopedView, [width, height]: [usize; 2]) -> Result<UndevelopedView, Error> {
    let origin =
        |side: usize, kept: usize| (0.5 * side.saturating_sub(kept) as f64).round_ties_even() as usize;
    let (left, top) = (origin(view.camera.width, width), origin(view.camera.height, height));
    let camera = pixel::crop(&view.camera, left, top, width, height)?;
    let cut = |raster: &Raster<f32>| Raster::from_fn(width, height, |x, y| raster[(x + left, y + top)]);
    Ok(UndevelopedView {
        levels: cut(&view.levels),
        camera,
        truth: ViewTruth { depth_z: cut(&view.truth.depth_z), world_from_cam: view.truth.world_from_cam },
    })
}
