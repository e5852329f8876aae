//! From training pairs to arrays, and to a device.

use super::{Matches, PairImages, Targets, ViewTarget};
use crate::Error;
use burn_tensor::{Bool, Device, Int, Tensor, TensorData};
use selenograph_dataset::pair::ViewName;
use selenograph_dataset::rng::Stream;
use selenograph_dataset::sample::{Provenance, TrainingPair};
use selenograph_geometry::{Cam, Point2, Rigid3, Vector3, pixel};

/// Sine of the angle between ray and baseline below which a pixel has no epipolar plane.
const SMALLEST_SINE: f64 = 1e-3;

/// What is made of the pairs beyond points and matches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AssemblySettings {
    /// Matches compared with each other at most; where there are more, they are put in random order.
    pub match_block: usize,
    /// Make the normals of the epipolar planes.
    pub epipolar: bool,
}

/// Pairs as arrays, made in any thread. Each pair is seen twice, as (A, B) and as (B, A): items `2p` and `2p + 1` of the
/// truth, which has 2P.
#[derive(Debug, Clone, Default)]
pub struct HostBatch {
    /// Number of pairs, P.
    pub num_pairs: usize,
    /// The pictures.
    pub images: PairImages,
    points: [Vec<f32>; 2],
    valid: [Vec<bool>; 2],
    sky: [Vec<bool>; 2],
    metric: Vec<bool>,
    pixels: [Vec<i32>; 2],
    matched: Vec<bool>,
    up: Vec<f32>,
    epipolar_normals: Option<[Vec<f32>; 2]>,
    /// Where each pair comes from.
    pub provenance: Vec<Provenance>,
}

const VIEWS: [ViewName; 2] = [ViewName::A, ViewName::B];

/// A pair seen both ways: the view whose frame holds, the place of a view, and the view that stands there.
const BOTH_WAYS: [(usize, usize, usize); 4] = [(0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 0)];

impl HostBatch {
    /// Brings pairs of one size (up to the exchange of rows and columns) together. `stream` orders the matches where
    /// they must be cut into blocks.
    ///
    /// # Errors
    /// [`Error::Batch`] for no pair, pairs of several sizes, or numbers of matches that differ or do not fill blocks.
    pub fn assemble(
        pairs: &[TrainingPair],
        settings: &AssemblySettings,
        stream: &mut Stream,
    ) -> Result<Self, Error> {
        let first = pairs.first().ok_or(Error::Batch {
            what: "number of pairs",
            expected: "one or more".into(),
            found: "none".into(),
        })?;
        let stored = |pair: &TrainingPair, view: usize| {
            let camera = &pair.views[view].camera;
            [camera.height.min(camera.width), camera.height.max(camera.width)]
        };
        let size = stored(first, 0);
        let mut batch = Self {
            num_pairs: pairs.len(),
            images: PairImages { size, ..PairImages::default() },
            epipolar_normals: settings.epipolar.then(Default::default),
            ..Self::default()
        };
        let num_matches = pairs.iter().map(|pair| pair.matches.valid.len()).max().unwrap_or(0);
        if num_matches > settings.match_block && num_matches % settings.match_block != 0 {
            return Err(Error::Batch {
                what: "number of matches",
                expected: format!("a multiple of the block of {}", settings.match_block),
                found: num_matches.to_string(),
            });
        }
        for pair in pairs {
            if let Some(found) =
                [0, 1].map(|view| stored(pair, view)).into_iter().find(|other| *other != size)
            {
                return Err(Error::Batch {
                    what: "size of a picture",
                    expected: format!("{} × {}, as the first", size[1], size[0]),
                    found: format!("{} × {}", found[1], found[0]),
                });
            }
            batch.push(pair, num_matches, settings, stream)?;
        }
        Ok(batch)
    }

    fn push(
        &mut self,
        pair: &TrainingPair,
        num_matches: usize,
        settings: &AssemblySettings,
        stream: &mut Stream,
    ) -> Result<(), Error> {
        for view in 0..2 {
            let order = StorageOrder::of(pair, view);
            self.images.portrait.push(order.portrait);
            let rgb = &pair.views[view].rgb.data;
            for channel in [0, 1, 2] {
                let of = |idx: usize| f32::from(rgb[idx][channel]) / 127.5 - 1.0;
                self.images.values.extend(order.indices().map(of));
            }
        }
        for (first, slot, view) in BOTH_WAYS {
            self.push_truth(pair, first, slot, view);
            if let Some(normals) = &mut self.epipolar_normals {
                let planes = epipolar_normals(pair, first, view);
                let order = StorageOrder::of(pair, view).indices();
                normals[slot].extend(order.flat_map(|idx| planes[idx]));
            }
        }
        for first in [0, 1] {
            self.metric.push(pair.is_metric);
            self.up.extend(up_in(pair, first));
        }
        self.push_matches(pair, num_matches, settings, stream)?;
        self.provenance.push(pair.provenance.clone());
        Ok(())
    }

    /// Points of `view` in the frame of `first`.
    fn push_truth(&mut self, pair: &TrainingPair, first: usize, slot: usize, view: usize) {
        let order = StorageOrder::of(pair, view);
        let truth = &pair.views[view].truth;
        let points = pair.points(VIEWS[view], VIEWS[first]);
        let finite = |point: [f32; 3]| if point[0].is_finite() { point } else { [0.0; 3] };
        self.points[slot].extend(order.indices().flat_map(|idx| finite(points[idx])));
        self.valid[slot].extend(order.indices().map(|idx| points[idx][0].is_finite()));
        self.sky[slot].extend(order.indices().map(|idx| truth.is_sky(idx)));
    }

    fn push_matches(
        &mut self,
        pair: &TrainingPair,
        num_matches: usize,
        settings: &AssemblySettings,
        stream: &mut Stream,
    ) -> Result<(), Error> {
        let matches = &pair.matches;
        // A pair without truth has none: its places are filled with pixels that count for nothing.
        let len = matches.valid.len();
        if len != 0 && len != num_matches {
            return Err(Error::Batch {
                what: "number of matches",
                expected: format!("{num_matches}, as in other pairs"),
                found: len.to_string(),
            });
        }
        let mut order: Vec<usize> = (0..num_matches).collect();
        if num_matches > settings.match_block {
            for n in 0..num_matches {
                order.swap(n, n + stream.index(num_matches - n));
            }
        }
        for (_, slot, view) in BOTH_WAYS {
            let storage = StorageOrder::of(pair, view);
            let pixels = [&matches.a, &matches.b][view];
            let position = |n: &usize| pixels.get(*n).map_or(0, |pixel| storage.position(*pixel));
            self.pixels[slot].extend(order.iter().map(position));
        }
        for _ in VIEWS {
            self.matched.extend(order.iter().map(|n| matches.valid.get(*n).copied().unwrap_or(false)));
        }
        Ok(())
    }

    /// Puts the truth on a device.
    pub fn targets(&self, device: &Device) -> Targets {
        let [h, w] = self.images.size;
        let b = 2 * self.num_pairs;
        let floats = |values: &[f32], shape: [usize; 4]| {
            Tensor::<4>::from_data(TensorData::new(values.to_vec(), shape), device)
        };
        let booleans = |values: &[bool]| {
            Tensor::<3, Bool>::from_data(TensorData::new(values.to_vec(), [b, h, w]), device)
        };
        let n = self.matched.len() / b.max(1);
        let integers =
            |values: &[i32]| Tensor::<2, Int>::from_data(TensorData::new(values.to_vec(), [b, n]), device);
        Targets {
            views: [0, 1].map(|view| ViewTarget {
                points: floats(&self.points[view], [b, h, w, 3]),
                valid: booleans(&self.valid[view]),
                sky: booleans(&self.sky[view]),
            }),
            metric: Tensor::from_data(TensorData::new(self.metric.clone(), [b]), device),
            matches: (n > 0).then(|| Matches {
                pixels: [0, 1].map(|view| integers(&self.pixels[view])),
                valid: Tensor::from_data(TensorData::new(self.matched.clone(), [b, n]), device),
            }),
            up: Tensor::from_data(TensorData::new(self.up.clone(), [b, 3]), device),
            epipolar_normals: self
                .epipolar_normals
                .as_ref()
                .map(|normals| [0, 1].map(|view| floats(&normals[view], [b, h, w, 3]))),
        }
    }

    /// For each item the first `count` pixels of its second view, in stored order, that are in no match: further candidates
    /// for a test. Fewer where an item has fewer.
    pub fn padding(&self, count: usize, device: &Device) -> Option<Tensor<2, Int>> {
        let num_pixels: usize = self.images.size.iter().product();
        let b = 2 * self.num_pairs;
        let n = self.matched.len() / b.max(1);
        let items: Vec<Vec<i32>> = (0..b)
            .map(|item| {
                let mut taken = vec![false; num_pixels];
                for pixel in &self.pixels[1][item * n..(item + 1) * n] {
                    taken[*pixel as usize] = true;
                }
                (0..num_pixels).filter(|idx| !taken[*idx]).take(count).map(|idx| idx as i32).collect()
            })
            .collect();
        let len = items.iter().map(Vec::len).min().filter(|len| *len > 0)?;
        let values: Vec<i32> = items.iter().flat_map(|item| &item[..len]).copied().collect();
        Some(Tensor::from_data(TensorData::new(values, [b, len]), device))
    }

    /// Names, shapes and values of what the network was given, for a file.
    pub fn arrays(&self) -> Vec<(&'static str, Vec<usize>, &[f32])> {
        let [h, w] = self.images.size;
        let b = 2 * self.num_pairs;
        let [points_a, points_b] = &self.points;
        vec![
            ("images", vec![b, 3, h, w], &self.images.values),
            ("points_a", vec![b, h, w, 3], points_a),
            ("points_b", vec![b, h, w, 3], points_b),
        ]
    }
}

/// Order in which the pixels of a picture are stored: rows first, columns first for portrait format.
#[derive(Clone, Copy)]
struct StorageOrder {
    width: usize,
    height: usize,
    portrait: bool,
}

impl StorageOrder {
    fn of(pair: &TrainingPair, view: usize) -> Self {
        let camera = &pair.views[view].camera;
        Self { width: camera.width, height: camera.height, portrait: camera.height > camera.width }
    }

    /// Position in the picture, rows first, of each stored pixel.
    fn indices(self) -> impl Iterator<Item = usize> {
        let (outer, inner) =
            if self.portrait { (self.width, self.height) } else { (self.height, self.width) };
        (0..outer).flat_map(move |outer| {
            (0..inner).map(move |inner| {
                if self.portrait { inner * self.width + outer } else { outer * self.width + inner }
            })
        })
    }

    /// Stored position of a pixel.
    fn position(self, [x, y]: [u32; 2]) -> i32 {
        let (x, y) = (x as usize, y as usize);
        (if self.portrait { x * self.height + y } else { y * self.width + x }) as i32
    }
}

/// The local vertical at the ground that view `first` sees, in its camera's frame; zero where no depth is known.
fn up_in(pair: &TrainingPair, first: usize) -> [f32; 3] {
    let (points, truth) = (pair.points(VIEWS[first], VIEWS[first]), &pair.views[first].truth);
    let known = || points.iter().filter(|point| point[0].is_finite());
    let count = known().count();
    if count == 0 {
        return [0.0; 3];
    }
    let sum: Vector3<f64> = known().map(|point| Vector3::from(point.map(f64::from))).sum();
    let ground = truth.world_from_cam.point(&(sum / count as f64).into());
    let up = truth.world_from_cam.inverse().vector(&ground.coords.normalize());
    up.map(|value| value as f32).into()
}

/// Unit normals, in the frame of `first`, of the planes through the rays of `view` and both cameras, rows first; zero
/// where the ray runs along the baseline.
fn epipolar_normals(pair: &TrainingPair, first: usize, view: usize) -> Vec<[f32; 3]> {
    let [frame, own, other] = [first, view, 1 - first].map(|idx| &pair.views[idx].truth);
    let frame_from_own: Rigid3<Cam, Cam> = &frame.world_from_cam.inverse() * &own.world_from_cam;
    let frame_from_other: Rigid3<Cam, Cam> = &frame.world_from_cam.inverse() * &other.world_from_cam;
    let baseline = frame_from_other.origin().coords;
    let camera = &pair.views[view].camera;
    let normal = |idx: usize| {
        let center = Point2::new(pixel::center_of(idx % camera.width), pixel::center_of(idx / camera.width));
        let ray = frame_from_own.vector(&camera.ray_z1(&center)?);
        let across = baseline.cross(&ray);
        let exists = across.norm() > SMALLEST_SINE * baseline.norm() * ray.norm();
        exists.then(|| across.normalize().map(|value| value as f32).into())
    };
    (0..camera.width * camera.height).map(|idx| normal(idx).unwrap_or_default()).collect()
}
