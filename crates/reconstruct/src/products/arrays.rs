//! `pointmaps.npz` and `matches.npz`.

use super::input::ProductInput;
use crate::Error;
use crate::matches_file::score;
use crate::prediction::PredictedView;
use selenograph_geometry::PixelConvention;
use selenograph_raster::codec::npz::{self, Array, Values};
use std::collections::BTreeMap;

/// Pointmaps, confidences, sigma, fill and camera matrices: in the axes of camera A, in metres or baselines.
pub(super) fn pointmaps(input: &ProductInput) -> Result<Vec<u8>, Error> {
    let views = input.prediction.views.as_ref();
    let views = views.ok_or(Error::TooFewPoints { what: "pointmaps", needed: 1, found: 0 })?;
    let scale = input.placement.cam_a_from_pred.scale() as f32;
    let mut arrays = BTreeMap::new();
    for (view, (name, given)) in views.iter().zip(["a", "b"].into_iter().zip(input.views)) {
        insert_view(&mut arrays, view, name, scale);
        let k = given.camera.k(PixelConvention::Corner);
        let rows = k.transpose().as_slice().to_vec();
        arrays.insert(format!("k_{name}"), Array::new(&[3, 3], Values::F64(rows)));
    }
    let metric = Values::U8(vec![u8::from(input.placement.metric)]);
    arrays.insert("metric".to_owned(), Array::new(&[1], metric));
    let convention = Values::Text(vec!["corner".to_owned()]);
    arrays.insert("k_pixel_convention".to_owned(), Array::new(&[1], convention));
    if let Ok(cam_b_from_cam_a) = &input.prediction.cam_b_from_cam_a {
        let mut rows = cam_b_from_cam_a.rows_3x4();
        for row in &mut rows {
            row[3] *= f64::from(scale);
        }
        let flat = rows.into_iter().flatten().collect();
        arrays.insert("cam_b_from_cam_a".to_owned(), Array::new(&[3, 4], Values::F64(flat)));
    }
    Ok(npz::encode(&arrays)?)
}

fn insert_view(arrays: &mut BTreeMap<String, Array>, view: &PredictedView, name: &str, scale: f32) {
    let (width, height) = (view.points.width, view.points.height);
    let mut insert = |what: &str, shape: &[usize], values: Values| {
        arrays.insert(format!("{what}_{name}"), Array::new(shape, values));
    };
    let points = view.points.data.iter().flat_map(|p| p.map(|v| v * scale)).collect();
    insert("pts3d", &[height, width, 3], Values::F32(points));
    insert("conf", &[height, width], Values::F32(view.confidence.data.clone()));
    if let Some(sigma) = &view.sigma {
        insert("sigma", &[height, width], Values::F32(sigma.data.iter().map(|s| s * scale).collect()));
    }
    let fill = view.fill.data.iter().map(|fill| *fill as u8).collect();
    insert("fill", &[height, width], Values::U8(fill));
}

/// Matches as pixels measured from the pictures' corners.
pub(super) fn matches(input: &ProductInput) -> Result<Vec<u8>, Error> {
    let matches = input.matches.unwrap_or_default();
    let n = matches.len();
    let pixels = |f: &dyn Fn(usize) -> [f64; 2]| Values::F64((0..n).flat_map(f).collect());
    let arrays = BTreeMap::from([
        ("pixels_a".to_owned(), Array::new(&[n, 2], pixels(&|i| matches[i].a.into()))),
        ("pixels_b".to_owned(), Array::new(&[n, 2], pixels(&|i| matches[i].b.into()))),
        ("score".to_owned(), Array::new(&[n], Values::F64(matches.iter().map(score).collect()))),
        (
            "inlier".to_owned(),
            Array::new(&[n], Values::U8(matches.iter().map(|m| u8::from(m.inlier)).collect())),
        ),
    ]);
    Ok(npz::encode(&arrays)?)
}
