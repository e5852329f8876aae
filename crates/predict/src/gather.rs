//! Heads' outputs as the arrays that `reconstruct::learned` takes.

use crate::encoded::EncodedView;
use crate::{Error, Passes, PredictOptions, grid, matches};
use selenograph_engine::HeadOutput;
use selenograph_engine::focal::focal_of_pointmap;
use selenograph_geometry::{Camera, pixel};
use selenograph_network::NetworkConfig;
use selenograph_network::input::InputTransform;
use selenograph_reconstruct::evidence::{FocalKnowledge, FocalSource};
use selenograph_reconstruct::learned::Learned;
use selenograph_reconstruct::learned::LearnedInput;
use selenograph_reconstruct::matching::Grain;

/// Focal lengths that are believed, in widths of the picture: fields of view of 103° to 7°.
const FOCAL_WIDTHS: std::ops::RangeInclusive<f64> = 0.4..=8.0;

/// A view as far as its pixels are concerned.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'a> {
    pub camera: &'a Camera,
    pub transform: &'a InputTransform,
}

impl<'a> Seen<'a> {
    pub fn of(view: &'a EncodedView) -> Self {
        Self { camera: &view.camera, transform: &view.transform }
    }
}

/// What the heads say, without padding: A and B in the frame of A; B and A in the frame of B, where the pair was decoded both ways.
#[derive(Clone, Copy)]
pub(crate) struct Outputs<'a> {
    pub forward: &'a [HeadOutput; 2],
    pub backward: Option<&'a [HeadOutput; 2]>,
}

/// Points and matches on the pictures' grids, and the cameras that are believed.
pub(crate) fn gather(
    outputs: Outputs<'_>,
    views: [Seen<'_>; 2],
    focal: FocalKnowledge,
    config: &NetworkConfig,
    options: &PredictOptions,
) -> Result<LearnedInput, Error> {
    let Outputs { forward, backward } = outputs;
    let (cameras, focal) = match (backward, focal) {
        (Some(backward), FocalKnowledge::Guessed) => implied_cameras(views, [&forward[0], &backward[0]]),
        (_, known) => assumed(views, known),
    };
    let transforms = views.map(|view| view.transform);
    let (matches, dense_matches) = if forward[0].descriptor_dim == 0 {
        (Vec::new(), None)
    } else {
        let backward = backward.filter(|_| options.passes == Passes::Symmetric);
        let found = matches::find(forward, backward, transforms, options)?;
        (found.published, found.dense)
    };
    let maps = [0, 1].map(|k| grid::pointmap(&forward[k], transforms[k], config.confidence));
    let grain = grain(views, config.patch_px);
    let learned = Learned { pointmaps: Some(maps), matches, dense_matches, grain };
    Ok(LearnedInput { learned, cameras, focal })
}

/// What is said of pictures of which one shows nothing.
pub(crate) fn nothing(views: [Seen<'_>; 2], focal: FocalKnowledge, patch_px: usize) -> LearnedInput {
    let grain = grain(views, patch_px);
    let learned = Learned { pointmaps: None, matches: Vec::new(), dense_matches: Some(Vec::new()), grain };
    let (cameras, focal) = assumed(views, focal);
    LearnedInput { learned, cameras, focal }
}

/// A pixel of the inputs in pixels of the pictures, the geometric mean of both; and a patch of A.
fn grain([a, b]: [Seen<'_>; 2], patch_px: usize) -> Grain {
    let [a, b] = [a, b].map(|view| pixel_side(view.transform));
    Grain::of_pixels((a * b).sqrt(), a * patch_px as f64)
}

/// Side of a pixel of the input in pixels of the picture.
fn pixel_side(transform: &InputTransform) -> f64 {
    transform.source[0] as f64 / transform.resized[0] as f64
}

/// The cameras as they came.
fn assumed(views: [Seen<'_>; 2], focal: FocalKnowledge) -> ([Camera; 2], FocalSource) {
    let cameras = views.map(|view| view.camera.clone());
    let source = match focal {
        FocalKnowledge::Known => FocalSource::Known,
        FocalKnowledge::Guessed => {
            FocalSource::Assumed { focal_px: cameras[0].fx, fov_deg: cameras[0].fov_x_rad().to_degrees() }
        }
    };
    (cameras, source)
}

/// Cameras with the focal lengths that each view's points in its own frame imply; the guessed ones if those are none.
fn implied_cameras(views: [Seen<'_>; 2], own: [&HeadOutput; 2]) -> ([Camera; 2], FocalSource) {
    let [focal_a, focal_b] = [0, 1].map(|k| {
        let Seen { camera, transform } = views[k];
        let principal = transform.input_from_source(camera.cx, camera.cy).map(pixel::sample_position);
        focal_of_pointmap(&own[k].points, own[k].width_px, principal)
            .map(|focal| focal * pixel_side(transform))
            .filter(|focal| FOCAL_WIDTHS.contains(&(focal / camera.width.max(camera.height) as f64)))
    });
    let (Some(focal_a), Some(focal_b)) = (focal_a, focal_b) else {
        return assumed(views, FocalKnowledge::Guessed);
    };
    let [a, b] = views.map(|view| view.camera);
    // Nothing says that two pictures of one size have two cameras.
    let focal_px = if (a.width, a.height) == (b.width, b.height) {
        [(focal_a * focal_b).sqrt(); 2]
    } else {
        [focal_a, focal_b]
    };
    let with = |camera: &Camera, focal_px: f64| Camera { fx: focal_px, fy: focal_px, ..camera.clone() };
    ([with(a, focal_px[0]), with(b, focal_px[1])], FocalSource::Pointmaps { focal_px })
}

#[cfg(test)]
mod tests;
