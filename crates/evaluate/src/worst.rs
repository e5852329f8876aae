//! The items that went worst, and those without an answer.

use crate::run::Line;
use crate::summary::MethodLines;
use crate::summary::classes::has_an_answer;

/// How many are shown.
const NUM_WORST: usize = 10;

/// An item that went badly.
#[derive(Debug, Clone, Copy)]
pub struct Worst<'a> {
    /// The line.
    pub line: &'a Line,
    /// By which it is ranked: point error over depth for methods with points, the larger pose error otherwise (degrees).
    pub error: f64,
    /// Whether `error` is a point error.
    pub is_of_points: bool,
}

/// The worst items of a method, worst first, at most one light of each pair: the same ground under another light shows nothing
/// new.
pub fn worst(method: &MethodLines) -> Vec<Worst<'_>> {
    let point_error = |line: &Line| line.metrics.overlap.numbers.point_error_rel;
    let is_of_points = method.lines.iter().any(|line| point_error(line).is_some());
    let mut ranked: Vec<Worst<'_>> = method
        .lines
        .iter()
        .filter(|line| has_an_answer(&line.item))
        .map(|line| {
            let error = if is_of_points {
                point_error(line).unwrap_or(f64::INFINITY)
            } else {
                line.metrics.pose_error_deg()
            };
            Worst { line, error, is_of_points }
        })
        .collect();
    ranked.sort_by(|a, b| b.error.total_cmp(&a.error));
    let mut seen: Vec<&str> = Vec::new();
    ranked.retain(|worst| {
        let is_new = !seen.contains(&worst.line.item.pair.as_str());
        seen.push(&worst.line.item.pair);
        is_new
    });
    ranked.truncate(NUM_WORST);
    ranked
}

/// Items for which a method gives no pose, each with its reason.
pub fn failures(method: &MethodLines) -> Vec<String> {
    let failed = method.lines.iter().filter(|line| line.metrics.pose_failed);
    failed
        .map(|line| {
            let reason = line.cannot_say.as_deref().unwrap_or("a pose without a direction");
            format!("{}: {reason}", item_name(line))
        })
        .collect()
}

/// `pair, light 0` or `pair, lights 0 and 2`.
pub fn item_name(line: &Line) -> String {
    let item = &line.item;
    if item.light_a == item.light_b {
        format!("{}, light {}", item.pair, item.light_a)
    } else {
        format!("{}, lights {} and {}", item.pair, item.light_a, item.light_b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::Method;
    use crate::run::lines::tests::line;
    use selenograph_reconstruct::pipeline::Method as Pictures;

    #[test]
    fn the_worst_light_of_each_pair_comes_first() {
        let lines = vec![
            line("sift", "a", 0, Some(0.1), 0.1),
            line("sift", "a", 1, None, 0.3),
            line("sift", "b", 0, Some(0.1), 0.2),
        ];
        let method = MethodLines { method: Method::Pictures(Pictures::Sift), settings: String::new(), lines };
        let found: Vec<(&str, u64)> =
            worst(&method).iter().map(|w| (w.line.item.pair.as_str(), w.line.item.light_a)).collect();
        assert_eq!(found, [("a", 1), ("b", 0)]);
        assert_eq!(failures(&method).len(), 1);
    }
}
