//! Pairs of a made-up hilly ground, exact to the last digit, and networks that can learn them.

use burn_tensor::Device;
use selenograph_dataset::correspondence::{MatchPool, Sighted};
use selenograph_dataset::rng::rng;
use selenograph_dataset::sample::{Provenance, TrainingPair, TrainingView, ViewTruth};
use selenograph_geometry::{Camera, Matrix3, Point2, Point3, Rigid3, pixel};
use selenograph_model::{Model, SavedActivations};
use selenograph_network::config::{ConfidenceMode, DepthMode, NetworkConfig, Transformer};
use selenograph_network::layout::Layout;
use selenograph_network::{Checkpoint, random};
use selenograph_raster::Raster;
use selenograph_train::batch::{AssemblySettings, HostBatch};
use selenograph_train::run::BatchSource;
use selenograph_train::{Error, Frozen, ModelNetwork};
use std::path::Path;

/// Radius of the made-up body, metres: the ground lies round its pole.
const RADIUS_M: f64 = 1000.0;
/// Iterations of the ray's cut with the ground; each gains a digit.
const ITERATIONS: usize = 40;

fn height(x: f64, y: f64, seed: f64) -> f64 {
    3.0 * (0.09 * x + seed).sin() * (0.07 * y - seed).cos() + 1.2 * (0.23 * x - 0.31 * y + 2.0 * seed).sin()
}

/// A look straight down from 100 m with pixels of 1.6 m, `offset` metres beside the middle.
fn view(side: usize, offset: [f64; 2], seed: f64) -> TrainingView {
    let camera = Camera::from_fov(side, side, 2.0 * (0.8 * side as f64 / 100.0).atan()).unwrap();
    let origin = Point3::new(offset[0], offset[1], RADIUS_M + 100.0);
    let world_from_cam =
        Rigid3::from_matrix(&Matrix3::from_diagonal(&[1.0, -1.0, -1.0].into()), origin).unwrap();
    let ground = |x: usize, y: usize| {
        let ray = camera.ray_z1(&Point2::new(pixel::center_of(x), pixel::center_of(y))).unwrap();
        let at = |depth_z: f64| (offset[0] + ray.x * depth_z, offset[1] - ray.y * depth_z);
        let mut depth_z = 100.0;
        for _ in 0..ITERATIONS {
            let (east, north) = at(depth_z);
            depth_z = 100.0 - height(east, north, seed);
        }
        (at(depth_z), depth_z)
    };
    let shade = |x: usize, y: usize| {
        let ((east, north), _) = ground(x, y);
        let slope = height(east + 0.5, north, seed) - height(east - 0.5, north, seed);
        let texture = 20.0 * (0.9 * east + 0.4 * north).sin() * (0.8 * north - 0.5 * east).cos();
        [(128.0 + 160.0 * slope + texture).clamp(0.0, 255.0) as u8; 3]
    };
    TrainingView {
        rgb: Raster::from_fn(side, side, shade),
        truth: ViewTruth {
            depth_z: Raster::from_fn(side, side, |x, y| ground(x, y).1 as f32),
            world_from_cam,
        },
        camera,
    }
}

/// Pair number `id`.
pub fn pair(side: usize, id: u64, num_matches: usize) -> TrainingPair {
    let mut stream = rng(5, "pair", id, "scene");
    let seed = stream.uniform(0.0, 6.0);
    let step = [stream.uniform(6.0, 16.0), stream.uniform(-8.0, 8.0)];
    let views = [view(side, [0.0, 0.0], seed), view(side, step, seed)];
    let sighted = |view: usize| Sighted { camera: &views[view].camera, truth: &views[view].truth };
    let pool = MatchPool::reciprocal(sighted(0), sighted(1));
    let matches = pool.sample(num_matches, 0.5, &mut stream).unwrap();
    let provenance = Provenance { source: "scene".into(), pair_id: id, ..Provenance::default() };
    TrainingPair { views, matches, is_metric: false, provenance }
}

/// A network of some 100 000 parameters.
pub fn config() -> NetworkConfig {
    let transformer = |dim, num_blocks| Transformer { dim, num_blocks, num_heads: 4, mlp_dim: 4 * dim };
    NetworkConfig {
        patch_px: 16,
        encoder: transformer(64, 2),
        decoder: transformer(48, 4),
        rope_base: 100.0,
        stem_dims: None,
        dpt_dims: [8, 12, 16, 24],
        dpt_fusion_dim: 16,
        dpt_last_dim: 8,
        descriptor_dim: Some(8),
        depth_mode: DepthMode::Exp,
        confidence: ConfidenceMode::Exp { min: 1.0, max: f64::INFINITY },
        descriptor_confidence: Some(ConfidenceMode::Exp { min: 0.0, max: f64::INFINITY }),
    }
}

/// That network with random weights.
pub fn fresh_network(frozen: Frozen) -> ModelNetwork {
    random_network(&config(), frozen)
}

/// A network of these dimensions with random weights.
pub fn random_network(config: &NetworkConfig, frozen: Frozen) -> ModelNetwork {
    let layout = Layout::new(config).unwrap();
    let mut random = |name: &str| {
        let spec = layout.get(name).unwrap();
        Ok((spec.shape.clone(), random::values(spec, 3)))
    };
    let model = Model::new(config, &Device::flex(), &mut random).unwrap();
    ModelNetwork::new(model, frozen, SavedActivations::Everything, None, "a test")
}

/// That network with the weights of a file.
pub fn read_network(path: &Path, frozen: Frozen) -> ModelNetwork {
    let checkpoint = Checkpoint::open(path).unwrap();
    assert_eq!(*checkpoint.config(), config());
    let mut read = |name: &str| Ok(checkpoint.read_with_shape(name)?);
    let model = Model::new(&config(), &Device::flex(), &mut read).unwrap();
    ModelNetwork::new(model, frozen, SavedActivations::Everything, None, "a test")
}

/// `num_pairs` pairs over and over, in batches of `batch`.
pub struct Scenes {
    batches: Vec<HostBatch>,
    next: usize,
}

impl Scenes {
    pub fn new(side: usize, num_pairs: u64, batch: usize, first: u64) -> Self {
        let settings = AssemblySettings { match_block: 8192, epipolar: false };
        let pairs: Vec<_> = (0..num_pairs).map(|id| pair(side, id, side * 4)).collect();
        let assemble = |pairs: &[TrainingPair]| {
            HostBatch::assemble(pairs, &settings, &mut rng(0, "test", 0, "matches")).unwrap()
        };
        Self { batches: pairs.chunks(batch).map(assemble).collect(), next: first as usize }
    }

    pub fn batches(&self) -> &[HostBatch] {
        &self.batches
    }
}

impl BatchSource for Scenes {
    fn batches_per_epoch(&self) -> u64 {
        self.batches.len() as u64
    }

    fn next_batch(&mut self) -> Result<HostBatch, Error> {
        self.next += 1;
        Ok(self.batches[(self.next - 1) % self.batches.len()].clone())
    }
}
