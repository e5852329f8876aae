//! The reference's tensors, and training pairs made of its truth.

#[path = "../../../network/testdata/golden_file.rs"]
#[allow(dead_code, reason = "every crate takes what it needs")]
mod golden_file;

pub use golden_file::{Golden, relative_error, root, stated, training_cases, with_extension, with_tensors};

use burn_tensor::{Device, Tensor, TensorData};
use selenograph_dataset::correspondence::Matches;
use selenograph_dataset::sample::{Provenance, TrainingPair, TrainingView, ViewTruth};
use selenograph_geometry::{Camera, Matrix3, Point3, Rigid3, pixel::PixelConvention};
use selenograph_raster::Raster;
use selenograph_train::batch::ViewOutput;

impl Golden {
    pub fn scalar(&self, name: &str) -> f32 {
        self.values(name)[0]
    }

    pub fn tensor<const D: usize>(&self, name: &str, device: &Device) -> Tensor<D> {
        let (shape, values) = &self.0[name];
        Tensor::from_data(TensorData::new(values.clone(), shape.clone()), device)
    }

    /// Both views' outputs as stored under `pred.*_1` and `pred.*_2`, with their gradients kept.
    pub fn output(&self, device: &Device) -> [ViewOutput; 2] {
        [1, 2].map(|view| ViewOutput {
            points: self.tensor(&format!("pred.pts3d_{view}"), device).require_grad(),
            confidence: self.tensor(&format!("pred.conf_{view}"), device).require_grad(),
            descriptors: self.tensor(&format!("pred.desc_{view}"), device).require_grad(),
            descriptor_confidence: self.tensor(&format!("pred.desc_conf_{view}"), device).require_grad(),
        })
    }

    /// The pairs as our loader gives them: upright. `metric` holds a flag per pair.
    pub fn pairs(&self, metric: &Golden) -> Vec<TrainingPair> {
        let count = self.0["gt1.true_shape"].0[0];
        (0..count)
            .map(|item| TrainingPair {
                views: [self.view(1, item), self.view(2, item)],
                matches: self.matches(item),
                is_metric: metric.item("gt1.is_metric_scale", item)[0] != 0.0,
                provenance: Provenance::default(),
            })
            .collect()
    }

    fn is_portrait(&self, view: usize, item: usize) -> bool {
        let shape = self.item(&format!("gt{view}.true_shape"), item);
        shape[0] > shape[1]
    }

    fn view(&self, view: usize, item: usize) -> TrainingView {
        let get = |name: &str| self.item(&format!("gt{view}.{name}"), item);
        let shape: Vec<usize> = get("true_shape").iter().map(|side| *side as usize).collect();
        let (height, width) = (shape[0], shape[1]);
        let portrait = self.is_portrait(view, item);
        let stored = |x: usize, y: usize| if portrait { x * height + y } else { y * width + x };
        let depth_z = Raster::from_fn(width, height, |x, y| match get("depthmap")[stored(x, y)] {
            sky if sky < 0.0 => f32::INFINITY,
            0.0 => f32::NAN,
            depth_z => depth_z,
        });
        let len = width * height;
        let rgb = Raster::from_fn(width, height, |x, y| {
            [0, 1, 2].map(|channel| ((get("img")[channel * len + stored(x, y)] + 1.0) * 127.5).round() as u8)
        });
        let k = get("camera_intrinsics");
        let row = |row: usize| [0, 1, 2].map(|column| f64::from(k[3 * row + column]));
        let rows = if portrait { [row(1), row(0), row(2)] } else { [row(0), row(1), row(2)] };
        let k = Matrix3::from_row_iterator(rows.into_iter().flatten());
        let pose = get("camera_pose");
        let rotation = Matrix3::from_fn(|row, column| f64::from(pose[4 * row + column]));
        let origin = Point3::from([3, 7, 11].map(|at: usize| f64::from(pose[at])));
        TrainingView {
            rgb,
            camera: Camera::from_k(width, height, &k, PixelConvention::Center).unwrap(),
            truth: ViewTruth { depth_z, world_from_cam: Rigid3::from_matrix(&rotation, origin).unwrap() },
        }
    }

    fn matches(&self, item: usize) -> Matches {
        let [a, b] = [1, 2].map(|view| {
            let corres = self.item(&format!("gt{view}.corres"), item).as_chunks::<2>().0;
            let upright = |[x, y]: [f32; 2]| if self.is_portrait(view, item) { [y, x] } else { [x, y] };
            corres.iter().map(|stored| upright(*stored).map(|value| value as u32)).collect()
        });
        let valid = self.item("gt1.valid_corres", item).iter().map(|flag| *flag != 0.0).collect();
        Matches { a, b, valid }
    }
}

/// The values of a tensor.
pub fn values<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.to_data_as::<f32>().try_to_vec().unwrap()
}
