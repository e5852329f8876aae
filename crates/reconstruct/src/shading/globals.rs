//! What is unknown for a picture as a whole: gain, offset, phase function, Sun, pose.

use super::picture::Placed;
use selenograph_geometry::{Matrix3, Rotation3, Vector3};

/// An unknown of whole pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Global {
    /// Logarithm of a picture's gain.
    Gain(usize),
    /// Grey level of a picture at no light, in its lit mean.
    Offset(usize),
    /// Coefficient of a power of the phase angle, of all pictures.
    Phase(usize),
    /// Angle of a picture's Sun about one of two axes across it.
    Sun(usize, usize),
    /// Turn of a camera about one of its axes.
    Turn(usize, usize),
    /// Move of a camera along one of its two axes across the baseline to the first, as a share of the baseline; the third is
    /// along it.
    Move(usize, usize),
}

impl Global {
    /// Whether it belongs to a picture.
    pub(super) fn is_of(self, picture: usize) -> bool {
        match self {
            Self::Gain(k) | Self::Offset(k) | Self::Sun(k, _) | Self::Turn(k, _) | Self::Move(k, _) => {
                k == picture
            }
            Self::Phase(_) => true,
        }
    }
}

impl Global {
    /// Whether it is of a picture's pose.
    pub(super) fn is_of_pose(self, picture: usize) -> bool {
        matches!(self, Self::Turn(k, _) | Self::Move(k, _) if k == picture)
    }
}

/// A global unknown with what is known of it: its deviation from the prior value, and how sure that is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Free {
    pub(super) global: Global,
    /// Standard deviation of the prior; infinite without one.
    pub(super) sigma: f64,
    pub(super) deviation: f64,
}

/// A picture's own state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shot {
    /// Grey level of the ground whose radiance factor is 1, in the picture's lit mean.
    pub(super) gain: f32,
    /// Grey level at no light, in the picture's lit mean.
    pub(super) offset: f32,
    pub(super) placed: Placed,
}

/// Phase angle at which the phase polynomial is 1, radians.
pub(super) const PHASE_MIDDLE: f32 = 1.2;
/// Powers of the phase polynomial.
pub(super) const PHASE_POWERS: usize = 2;

/// Largest step of a log gain, and of an angle, in one iteration.
const MAX_LOG_GAIN: f64 = 0.3;
const MAX_ANGLE: f64 = 0.05;

/// The state of all pictures.
#[derive(Debug, Clone)]
pub(super) struct Globals {
    pub(super) shots: Vec<Shot>,
    pub(super) phase: [f32; PHASE_POWERS],
    pub(super) free: Vec<Free>,
}

/// Two axes across a direction.
pub(super) fn across(direction: [f32; 3]) -> [[f32; 3]; 2] {
    let d = Vector3::from(direction.map(f64::from));
    let helper = if d.z.abs() < 0.9 * d.norm() { Vector3::z() } else { Vector3::x() };
    let first = d.cross(&helper).normalize();
    let second = d.normalize().cross(&first);
    [first, second].map(|axis| std::array::from_fn(|i| axis[i] as f32))
}

impl Shot {
    /// Axes of a move in the camera's axes, each as long as the baseline to the first camera: two across it and one along.
    pub(super) fn moves(&self, first_eye: [f32; 3]) -> [[f32; 3]; 3] {
        let r = self.placed.rotation;
        let d: [f32; 3] = std::array::from_fn(|i| self.placed.eye[i] - first_eye[i]);
        let baseline: [f32; 3] = std::array::from_fn(|i| r[i][0] * d[0] + r[i][1] * d[1] + r[i][2] * d[2]);
        let length = baseline.iter().map(|c| c * c).sum::<f32>().sqrt();
        let [one, two] = across(baseline);
        [one.map(|c| c * length), two.map(|c| c * length), baseline]
    }

    fn turn_and_move(&mut self, turn: Vector3<f64>, shift: Vector3<f64>) {
        let turned = Rotation3::new(turn).into_inner();
        let rotation = turned * Matrix3::from_fn(|i, j| f64::from(self.placed.rotation[i][j]));
        let before = Vector3::from(self.placed.translation.map(f64::from));
        let translation = turned * before + shift;
        let eye = -(rotation.transpose() * translation);
        self.placed.rotation = std::array::from_fn(|i| std::array::from_fn(|j| rotation[(i, j)] as f32));
        self.placed.translation = std::array::from_fn(|i| translation[i] as f32);
        self.placed.eye = std::array::from_fn(|i| eye[i] as f32);
    }

    /// Brings the camera back to a distance from the first: across the baseline is a tangent, along it nothing is known.
    fn keep_baseline(&mut self, first_eye: [f32; 3], length: f32) {
        let d: [f32; 3] = std::array::from_fn(|i| self.placed.eye[i] - first_eye[i]);
        let factor = length / d.iter().map(|c| c * c).sum::<f32>().sqrt();
        if !factor.is_finite() {
            return;
        }
        self.placed.eye = std::array::from_fn(|i| first_eye[i] + factor * d[i]);
        let (r, eye) = (self.placed.rotation, self.placed.eye);
        self.placed.translation =
            std::array::from_fn(|i| -(r[i][0] * eye[0] + r[i][1] * eye[1] + r[i][2] * eye[2]));
    }

    fn tilt_sun(&mut self, angles: [f64; 2]) {
        let [one, two] = across(self.placed.sun);
        let mut sun = Vector3::from(self.placed.sun.map(f64::from));
        for (angle, axis) in angles.into_iter().zip([one, two]) {
            sun += Vector3::from(axis.map(f64::from)) * angle.clamp(-MAX_ANGLE, MAX_ANGLE);
        }
        let sun = sun.normalize();
        self.placed.sun = std::array::from_fn(|i| sun[i] as f32);
    }
}

impl Globals {
    /// The state after a step.
    #[must_use]
    pub(super) fn stepped(&self, step: &[f64]) -> Self {
        let mut next = self.clone();
        for (free, step) in next.free.iter_mut().zip(step) {
            free.deviation += step;
        }
        let first_eye = self.shots.first().map_or([0.0; 3], |shot| shot.placed.eye);
        for (k, shot) in next.shots.iter_mut().enumerate() {
            let mut sun = [0.0; 2];
            let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
            let moves = shot.moves(first_eye);
            let mut moved = false;
            for (free, &step) in self.free.iter().zip(step) {
                match free.global {
                    Global::Gain(of) if of == k => {
                        shot.gain *= step.clamp(-MAX_LOG_GAIN, MAX_LOG_GAIN).exp() as f32;
                    }
                    Global::Offset(of) if of == k => shot.offset += step as f32,
                    Global::Sun(of, axis) if of == k => sun[axis] += step,
                    Global::Turn(of, axis) if of == k => (turn[axis], moved) = (step, true),
                    Global::Move(of, axis) if of == k => {
                        shift += Vector3::from(moves[axis].map(f64::from)) * step;
                        moved = true;
                    }
                    _ => {}
                }
            }
            if sun != [0.0; 2] {
                shot.tilt_sun(sun);
            }
            if moved {
                let baseline = Vector3::from(moves[2].map(f64::from)).norm() as f32;
                shot.turn_and_move(turn, shift);
                if k == 1 {
                    shot.keep_baseline(first_eye, baseline);
                }
            }
        }
        for (free, &step) in self.free.iter().zip(step) {
            if let Global::Phase(power) = free.global {
                next.phase[power] += step as f32;
            }
        }
        next
    }
}
