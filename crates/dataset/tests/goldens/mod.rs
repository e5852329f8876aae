//! Reading the reference's numbers.

use safetensors::{Dtype, SafeTensors};
use selenograph_dataset::sample::ViewTruth;
use selenograph_geometry::{BodyFixed, Cam, Camera, Matrix3, PixelConvention, Point3, Rigid3};
use selenograph_raster::Raster;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A file or folder of the shared data, announced as the house wants it.
pub fn shared(name: &str, inside: &str) -> Option<PathBuf> {
    let shared = std::env::var_os("SELENOGRAPH_SHARED").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")),
        PathBuf::from,
    );
    let path = shared.join(inside);
    if !path.exists() {
        println!("SKIP shared-data: no {inside}");
        return None;
    }
    println!("RAN shared-data: {name}");
    Some(path)
}

/// A file of the goldens.
pub fn open(name: &str, file: &str) -> Option<Golden> {
    let bytes = std::fs::read(shared(name, &format!("golden/{file}"))?).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap().tensors();
    let read = |view: safetensors::tensor::TensorView<'_>| {
        (view.shape().to_vec(), numbers(view.dtype(), view.data()))
    };
    Some(Golden(tensors.into_iter().map(|(name, view)| (name, read(view))).collect()))
}

fn numbers(dtype: Dtype, bytes: &[u8]) -> Vec<f64> {
    match dtype {
        Dtype::F32 => bytes.as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect(),
        Dtype::I32 => bytes.as_chunks::<4>().0.iter().map(|b| f64::from(i32::from_le_bytes(*b))).collect(),
        Dtype::U8 => bytes.iter().map(|b| f64::from(*b)).collect(),
        other => panic!("no golden holds {other:?}"),
    }
}

/// Tensors by name: shape and values.
pub struct Golden(BTreeMap<String, (Vec<usize>, Vec<f64>)>);

impl Golden {
    pub fn get(&self, name: &str) -> &[f64] {
        &self.0[name].1
    }

    pub fn matrix(&self, name: &str) -> Matrix3<f64> {
        Matrix3::from_row_slice(self.get(name))
    }

    pub fn raster(&self, name: &str) -> Raster<f32> {
        let (shape, values) = &self.0[name];
        Raster::new(shape[1], shape[0], values.iter().map(|v| *v as f32).collect()).unwrap()
    }

    /// One of the three channels of a picture.
    pub fn channel(&self, name: &str, channel: usize) -> Raster<f32> {
        let (shape, values) = &self.0[name];
        let data = values.iter().skip(channel).step_by(3).map(|v| *v as f32).collect();
        Raster::new(shape[1], shape[0], data).unwrap()
    }

    pub fn camera(&self, k: &str, width: usize, height: usize) -> Camera {
        Camera::from_k(width, height, &self.matrix(k), PixelConvention::Center).unwrap()
    }

    pub fn pose(&self, name: &str) -> Rigid3<BodyFixed, Cam> {
        let rows = self.get(name);
        let rotation = Matrix3::from_fn(|i, j| rows[4 * i + j]);
        Rigid3::from_matrix(&rotation, Point3::new(rows[3], rows[7], rows[11])).unwrap()
    }

    /// Depth, of which 0 is absent, and pose.
    pub fn truth(&self, depth_z: &str, pose: &str) -> ViewTruth {
        let depth_z = self.raster(depth_z).map(|z| if *z > 0.0 { *z } else { f32::NAN });
        ViewTruth { depth_z, world_from_cam: self.pose(pose) }
    }
}
