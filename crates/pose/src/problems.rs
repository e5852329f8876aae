//! Random problems with their truth, which every solver is run through.

use crate::absolute::Sighting;
use crate::decompose::Motion;
use crate::random::Random;
use crate::relative::Match;
use selenograph_geometry::{
    Cam, CamA, CamB, Enu, Matrix3, Point2, Point3, PredA, Rigid3, Rotation3, Sim3, Vector3,
};

/// The kinds of two-view scenes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SceneKind {
    /// Points in a deep box, a motion of any direction, rotation up to 30°.
    General,
    /// All points on one tilted plane.
    Planar,
    /// Two views from above over nearly flat ground: distance 1, baseline 0.15, its relief making a parallax of the given root mean
    /// square (on the plane `z = 1`), small tilts and any roll.
    Nadir {
        /// Root mean square of the parallax of the relief.
        relief_parallax: f64,
    },
    /// The second view from the same place, turned.
    PureRotation,
    /// The same view twice.
    Identical,
}

/// Matches of two views, and the truth.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The matches; scores are all 1.
    pub matches: Vec<Match>,
    /// The points, in A.
    pub points_in_a: Vec<Point3<f64>>,
    /// The true motion; its translation has its true length.
    pub truth: Rigid3<CamB, CamA>,
    random: Random,
}

/// Half the field of view on the plane `z = 1`: 45°.
pub(crate) const HALF_FIELD: f64 = 0.414_213_562_373_095_03;

impl Scene {
    /// A scene without noise or outliers; every point is seen by both views.
    pub fn new(kind: &SceneKind, num: usize, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let (truth, tilt) = motion_of(kind, &mut random);
        let mut scene =
            Self { matches: Vec::with_capacity(num), points_in_a: Vec::with_capacity(num), truth, random };
        // A scene of which the views share too little is drawn again with another motion.
        let mut tries = 0;
        let (mut truth, mut tilt) = (truth, tilt);
        while scene.matches.len() < num {
            tries += 1;
            if tries % (20 * num.max(50)) == 0 {
                (truth, tilt) = motion_of(kind, &mut scene.random);
                (scene.truth, tries) = (truth, 0);
                scene.matches.clear();
                scene.points_in_a.clear();
            }
            let direction = Vector3::new(
                scene.random.between(-HALF_FIELD, HALF_FIELD),
                scene.random.between(-HALF_FIELD, HALF_FIELD),
                1.0,
            );
            let depth_z = depth_of(kind, &direction, &tilt, &mut scene.random);
            let x_in_a = Point3::from(direction * depth_z);
            let x_in_b = truth.point(&x_in_a);
            let b = Point2::new(x_in_b.x / x_in_b.z, x_in_b.y / x_in_b.z);
            if x_in_b.z > 0.05 && b.coords.amax() < 1.2 * HALF_FIELD {
                scene.points_in_a.push(x_in_a);
                scene.matches.push(Match { a: Point2::new(direction.x, direction.y), b, score: 1.0 });
            }
        }
        scene
    }

    /// Adds normal noise of one sigma to every coordinate.
    #[must_use]
    pub fn with_noise(mut self, sigma: f64) -> Self {
        for m in &mut self.matches {
            for v in m.a.coords.iter_mut().chain(m.b.coords.iter_mut()) {
                *v += sigma * self.random.normal();
            }
        }
        self
    }

    /// Rounds every coordinate to a grid: what whole pixels do.
    #[must_use]
    pub fn with_rounding(mut self, step: f64) -> Self {
        for m in &mut self.matches {
            for v in m.a.coords.iter_mut().chain(m.b.coords.iter_mut()) {
                *v = (*v / step).round() * step;
            }
        }
        self
    }

    /// Replaces a share of the matches by unrelated points of B.
    #[must_use]
    pub fn with_outliers(mut self, share: f64) -> Self {
        let num = (share * self.matches.len() as f64).round() as usize;
        let chosen = self.random.permutation(self.matches.len());
        for &i in &chosen[..num] {
            self.matches[i].b = Point2::new(
                self.random.between(-HALF_FIELD, HALF_FIELD),
                self.random.between(-HALF_FIELD, HALF_FIELD),
            );
        }
        self
    }

    /// The true motion with a translation of length 1.
    pub fn motion(&self) -> Motion {
        Motion { rotation: self.truth.rotation(), translation: self.truth.origin().coords.normalize() }
    }

    /// Angle between a found rotation and the true one, radians.
    pub fn rotation_error_rad(&self, found: &Rigid3<CamB, CamA>) -> f64 {
        angle_of(&(found.rotation() * self.truth.rotation().transpose()))
    }

    /// Angle between a found direction of motion and the true one, radians; its sign counts.
    pub fn direction_error_rad(&self, found: &Rigid3<CamB, CamA>) -> f64 {
        let (f, t) = (found.origin().coords, self.truth.origin().coords);
        f.cross(&t).norm().atan2(f.dot(&t))
    }
}

/// Angle of a rotation matrix, accurate for small ones.
pub fn angle_of(rotation: &Matrix3<f64>) -> f64 {
    let twice_sine = Vector3::new(
        rotation[(2, 1)] - rotation[(1, 2)],
        rotation[(0, 2)] - rotation[(2, 0)],
        rotation[(1, 0)] - rotation[(0, 1)],
    );
    twice_sine.norm().atan2(rotation.trace() - 1.0)
}

/// A direction, uniform on the sphere.
pub fn direction(random: &mut Random) -> Vector3<f64> {
    Vector3::new(random.normal(), random.normal(), random.normal()).normalize()
}

/// A rotation about a random axis by at most an angle.
pub fn rotation(random: &mut Random, max_angle_rad: f64) -> Rotation3<f64> {
    let angle = random.between(-max_angle_rad, max_angle_rad);
    Rotation3::new(direction(random) * angle)
}

fn motion_of(kind: &SceneKind, random: &mut Random) -> (Rigid3<CamB, CamA>, Vector3<f64>) {
    let tilt = Vector3::new(random.between(-0.6, 0.6), random.between(-0.6, 0.6), 1.0).normalize();
    let turn = rotation(random, 0.5);
    let shift = Point3::from(direction(random) * random.between(0.3, 1.0));
    let motion = match kind {
        SceneKind::General | SceneKind::Planar => Rigid3::new(turn, shift),
        SceneKind::PureRotation => Rigid3::new(rotation(random, 0.3), Point3::origin()),
        SceneKind::Identical => Rigid3::identity(),
        SceneKind::Nadir { .. } => {
            let roll =
                Rotation3::new(Vector3::z() * random.between(-std::f64::consts::PI, std::f64::consts::PI));
            let small = rotation(random, 0.05);
            let heading = random.between(0.0, std::f64::consts::TAU);
            let shift = Vector3::new(heading.cos(), heading.sin(), 0.2 * random.between(-1.0, 1.0)) * 0.15;
            Rigid3::new(small * roll, Point3::from(roll * shift))
        }
    };
    let tilt =
        if matches!(kind, SceneKind::Nadir { .. }) { (tilt + Vector3::z() * 8.0).normalize() } else { tilt };
    (motion, tilt)
}

fn depth_of(kind: &SceneKind, direction: &Vector3<f64>, tilt: &Vector3<f64>, random: &mut Random) -> f64 {
    match kind {
        SceneKind::Planar => 2.0 / tilt.dot(direction),
        // A change of depth dz at distance 1 moves the image by baseline · dz.
        SceneKind::Nadir { relief_parallax } => {
            1.0 / tilt.dot(direction) + random.normal() * relief_parallax / 0.15
        }
        _ => random.between(1.0, 4.0),
    }
}

/// Points that a camera sees, and its true pose.
#[derive(Debug, Clone)]
pub struct Resection {
    /// The points and their images.
    pub sightings: Vec<Sighting>,
    /// The truth.
    pub truth: Rigid3<Cam, Enu>,
}

impl Resection {
    /// Points at 1 to 4 before a camera anywhere within 5 of the origin, with noise on the images and a share of unrelated images.
    pub fn new(num: usize, noise: f64, outliers: f64, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let turn = rotation(&mut random, std::f64::consts::PI);
        let truth = Rigid3::new(turn, Point3::from(direction(&mut random) * random.between(0.0, 5.0)));
        let world_from_cam = truth.inverse();
        let num_outliers = (outliers * num as f64).round() as usize;
        let mut place =
            || Point2::new(random.between(-HALF_FIELD, HALF_FIELD), random.between(-HALF_FIELD, HALF_FIELD));
        let images: Vec<[Point2<f64>; 2]> = (0..num).map(|_| [place(), place()]).collect();
        let sightings = images
            .iter()
            .enumerate()
            .map(|(i, [image, other])| {
                let depth_z = random.between(1.0, 4.0);
                let world = world_from_cam.point(&Point3::new(image.x * depth_z, image.y * depth_z, depth_z));
                let seen = if i < num_outliers { *other } else { *image };
                let image = Point2::new(seen.x + noise * random.normal(), seen.y + noise * random.normal());
                Sighting { world, image }
            })
            .collect();
        Self { sightings, truth }
    }
}

/// Two clouds that correspond point by point, and the true similarity.
#[derive(Debug, Clone)]
pub struct Clouds {
    /// Points of the source.
    pub from: Vec<Point3<f64>>,
    /// Points of the target.
    pub to: Vec<Point3<f64>>,
    /// The truth.
    pub truth: Sim3<Enu, PredA>,
}

impl Clouds {
    /// A rough surface of unit size, scaled by 3 to 30, with normal noise in the target (units of the target) and a share of target points
    /// displaced by up to the size of the scene.
    pub fn new(num: usize, noise: f64, outliers: f64, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let scale = random.between(3.0, 30.0);
        let turn = rotation(&mut random, std::f64::consts::PI);
        let rigid = Rigid3::new(turn, Point3::from(direction(&mut random) * 100.0));
        let plain = Sim3::from_rigid(rigid);
        let truth = Sim3::new(scale, rigid).unwrap_or(plain);
        let mut clouds = Self { from: Vec::with_capacity(num), to: Vec::with_capacity(num), truth };
        for _ in 0..num {
            let (x, y) = (random.between(-0.5, 0.5), random.between(-0.5, 0.5));
            let p = Point3::new(x, y, 1.0 + 0.05 * random.normal());
            let jump = if random.unit() < outliers {
                direction(&mut random) * random.between(0.1, 1.0) * scale
            } else {
                Vector3::zeros()
            };
            let spread = Vector3::new(random.normal(), random.normal(), random.normal()) * noise;
            clouds.from.push(p);
            clouds.to.push(truth.point(&p) + jump + spread);
        }
        clouds
    }
}
