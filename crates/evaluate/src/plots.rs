//! Plots of an evaluation: cumulative errors, errors against what may cause them, reliability of sigma.

use crate::pair_metrics::Region;
use crate::run::Line;
use crate::summary::classes::has_an_answer;
use crate::summary::{Frame, MethodLines, PoseAngle, Quantity};
use selenograph_report::chart::{cumulative, reliability};
use selenograph_report::color::series;
use selenograph_report::{Axis, Chart};

/// A plot with the name of its file and the words below it.
#[derive(Debug, Clone)]
pub struct Plot {
    /// Name of its file, without extension.
    pub id: String,
    /// What is to be seen.
    pub caption: String,
    /// The drawing.
    pub chart: Chart,
}

/// What an error is plotted against.
struct Cause {
    id: &'static str,
    label: &'static str,
    of: fn(&Line) -> Option<f64>,
}

const CAUSES: [Cause; 4] = [
    Cause {
        id: "altitude",
        label: "altitude over the ground (km)",
        of: |line| Some(line.item.altitude_m / 1e3),
    },
    Cause {
        id: "overlap",
        label: "share of A that B sees (%)",
        of: |line| Some(100.0 * line.item.overlap_share),
    },
    Cause { id: "light", label: "light of view A", of: |line| Some(line.item.light_a as f64) },
    Cause {
        id: "illumination",
        label: "angle between the Suns (°)",
        of: |line| line.item.illumination_difference_deg,
    },
];

/// Errors at and above this are at the end of the cumulative curves, degrees.
const CURVE_END_DEG: f64 = 30.0;
/// Exact answers would leave a logarithmic axis: they are drawn here, degrees.
const LEAST_ERROR_DEG: f64 = 1e-3;

/// Every plot that has something to show.
pub fn plots(methods: &[MethodLines]) -> Vec<Plot> {
    let mut plots = Vec::new();
    for (frame, id, name) in [
        (Frame::Full, "pose_cumulative", "full frames"),
        (Frame::ReferenceRows, "pose_cumulative_reference", "reference protocol"),
    ] {
        plots.push(pose_curves(methods, frame, id, name));
    }
    let point_error = Quantity::Region(Frame::Full, Region::Overlap, "point_error_rel");
    plots.extend(point_curves(methods, &point_error));
    let pose_error = |line: &Line| {
        let error = line.metrics.pose_error_deg();
        error.is_finite().then(|| error.max(LEAST_ERROR_DEG))
    };
    for cause in &CAUSES {
        let y = Axis::new("max(RRA, RTA) (°)").log();
        plots.extend(against(methods, cause, "pose", "pose error", y, pose_error));
        let y = Axis::new("point error over depth").log();
        plots.extend(against(methods, cause, "point", "point error", y, |line| point_error.of(line)));
        let y = Axis::new("slope correlation (GSD)");
        let slope = Quantity::Region(Frame::Full, Region::Overlap, "slope_corr_gsd");
        plots.extend(against(methods, cause, "slope", "slope correlation", y, |line| slope.of(line)));
    }
    plots.extend(reliability_curves(methods));
    plots
}

/// Lines with an answer of the methods that see pictures only, each with its place in the colours.
fn compared(methods: &[MethodLines]) -> impl Iterator<Item = (usize, &str, Vec<&Line>)> {
    let seeing = methods.iter().filter(|m| m.method.looks_at_pictures());
    seeing.enumerate().map(|(k, m)| {
        (k, m.method.as_str(), m.lines.iter().filter(|line| has_an_answer(&line.item)).collect())
    })
}

fn pose_curves(methods: &[MethodLines], frame: Frame, id: &str, name: &str) -> Plot {
    let mut curves = Vec::new();
    for (_, method, lines) in compared(methods) {
        for angle in [PoseAngle::Rra, PoseAngle::Rta] {
            let label = if angle == PoseAngle::Rra { "RRA" } else { "RTA" };
            let errors = lines.iter().map(|line| {
                let error = Quantity::MedianError(frame, angle).of(line);
                error.map_or(f64::INFINITY, |error| error.max(LEAST_ERROR_DEG))
            });
            curves.push((format!("{method} {label}"), errors.collect()));
        }
    }
    let x = Axis::new("error (°)").log().between(LEAST_ERROR_DEG, CURVE_END_DEG);
    Plot {
        id: id.into(),
        caption: format!(
            "Share of items with a pose error up to x, {name}; an item without a pose is never reached."
        ),
        chart: cumulative(&format!("Pose errors, {name}"), x, &curves),
    }
}

fn point_curves(methods: &[MethodLines], quantity: &Quantity) -> Option<Plot> {
    let curves: Vec<(String, Vec<f64>)> = methods
        .iter()
        .filter(|m| m.method.as_str() != "truth")
        .map(|m| {
            let answered = m.lines.iter().filter(|line| has_an_answer(&line.item));
            let errors: Vec<f64> = answered.filter_map(|line| quantity.of(line)).collect();
            (m.method.as_str().to_owned(), errors)
        })
        .filter(|(_, errors)| !errors.is_empty())
        .collect();
    let plot = Plot {
        id: "point_cumulative".into(),
        caption: "Share of items with a mean point error up to x, over the pixels that both views see; the plane is the lower anchor."
            .into(),
        chart: cumulative("Point errors", Axis::new("point error over depth").log(), &curves),
    };
    (!curves.is_empty()).then_some(plot)
}

/// One dot per item; `None` where the cause does not differ between items, or no method has the number.
fn against(
    methods: &[MethodLines],
    cause: &Cause,
    id: &str,
    name: &str,
    y: Axis,
    value: impl Fn(&Line) -> Option<f64>,
) -> Option<Plot> {
    let mut chart = Chart::new(format!("{name} against {}", cause.id), Axis::new(cause.label), y);
    let mut seen: Vec<f64> = Vec::new();
    for (k, method, lines) in compared(methods) {
        let points: Vec<[f64; 2]> =
            lines.iter().filter_map(|line| Some([(cause.of)(line)?, value(line)?])).collect();
        seen.extend(points.iter().map(|[x, _]| *x));
        if !points.is_empty() {
            chart = chart.dots(method, series(k), points);
        }
    }
    let (low, high) =
        seen.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    let plot = Plot {
        id: format!("{id}_{}", cause.id),
        caption: format!("One dot per item with an answer: {name} against {}.", cause.label),
        chart,
    };
    (high - low > 1e-9).then_some(plot)
}

/// Mean reliability of the sigmas of each method.
fn reliability_curves(methods: &[MethodLines]) -> Option<Plot> {
    let mut curves = Vec::new();
    for (_, method, lines) in compared(methods) {
        let found: Vec<_> =
            lines.iter().filter_map(|line| line.metrics.overlap.curves.reliability.as_ref()).collect();
        let Some(first) = found.first() else { continue };
        let points = first.expected.iter().enumerate().map(|(k, expected)| {
            let observed: Vec<f64> = found.iter().filter_map(|r| r.observed.get(k).copied()).collect();
            [*expected, observed.iter().sum::<f64>() / observed.len().max(1) as f64]
        });
        curves.push((method.to_owned(), points.collect::<Vec<_>>()));
    }
    let plot = Plot {
        id: "reliability".into(),
        caption: "Share of true errors inside the central interval that sigma promises, mean over items; on the diagonal sigma tells the truth, below it it is too small."
            .into(),
        chart: reliability(
            "Reliability of sigma",
            Axis::new("expected share").between(0.0, 1.0),
            Axis::new("observed share").between(0.0, 1.0),
            &curves,
        ),
    };
    (!curves.is_empty()).then_some(plot)
}
