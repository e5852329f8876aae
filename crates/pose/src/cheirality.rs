//! Which of the motions has the points in front of both cameras.

use crate::decompose::Motion;
use selenograph_geometry::Vector3;

/// True where the point nearest to both rays lies in front of both cameras.
///
/// Minimises `‖λ R a + t − μ b‖`; the signs of `λ` and `μ` follow without a division.
pub fn in_front(motion: &Motion, a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    let p = motion.rotation * a;
    let t = &motion.translation;
    let (pp, bb, pb) = (p.norm_squared(), b.norm_squared(), p.dot(b));
    let (pt, bt) = (p.dot(t), b.dot(t));
    pb * bt - pt * bb > 0.0 && pp * bt - pb * pt > 0.0
}

/// The motion that has most of the matches in front, and how many those are.
pub fn most_in_front(
    motions: &[Motion; 4],
    matches: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>,
) -> (Motion, usize) {
    let mut votes = [0_usize; 4];
    for (a, b) in matches {
        for (vote, motion) in votes.iter_mut().zip(motions) {
            *vote += usize::from(in_front(motion, &a, &b));
        }
    }
    let mut best = 0;
    for k in 1..4 {
        if votes[k] > votes[best] {
            best = k;
        }
    }
    (motions[best], votes[best])
}
