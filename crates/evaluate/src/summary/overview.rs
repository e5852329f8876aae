//! What an evaluation says in a row and a sentence a method: which is how good, and where it fails.

use super::classes::has_an_answer;
use super::{Breakdown, Frame, MethodLines, PoseAngle, Quantity, estimate_of};
use crate::Error;
use crate::pair_metrics::Region;
use crate::run::{Completed, Line};
use crate::worst::{item_name, worst};
use selenograph_report::{Cell, Column, Table, number};

const HEADS: [&str; 8] =
    ["method", "found", "RRA (°)", "RTA (°)", "point error (%)", "plane's (%)", "slope corr.", "s per item"];
/// What the columns are.
const LEGEND: &str = "found: items with a pose; RRA, RTA: median errors of rotation and direction; point error: mean distance from the \
                      truth over the distance, where both views see, beside that of a plane; slope corr.: Pearson, per ground pixel";

/// A method in one row and one sentence.
#[derive(Debug, Clone, PartialEq)]
pub struct Overview {
    name: &'static str,
    looks_at_pictures: bool,
    num_found: usize,
    rta_deg: Option<f64>,
    /// Percent of the distance; of the method, and of a plane on the same items.
    point_error: Option<[f64; 2]>,
    cells: [String; HEADS.len()],
    sentence: String,
}

/// Every method, in the order of the tables.
pub fn overview(methods: &[MethodLines], completed: &Completed) -> Vec<Overview> {
    let seconds = completed.seconds_per_item.iter().copied().chain(std::iter::repeat(None));
    methods.iter().zip(seconds).map(|(method, seconds)| Overview::new(method, seconds)).collect()
}

impl Overview {
    /// The method.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Mean distance of its points from the truth, and of a plane's, percent of the distance; `None` for a method without points.
    pub fn point_error_percent(&self) -> Option<[f64; 2]> {
        self.point_error
    }

    fn new(method: &MethodLines, seconds: Option<f64>) -> Self {
        let lines: Vec<&Line> = method.lines.iter().filter(|line| has_an_answer(&line.item)).collect();
        let num_found = lines.iter().filter(|line| !line.metrics.pose_failed).count();
        let value = |quantity: Quantity| Some(estimate_of(lines.iter().copied(), &quantity)?.value);
        let region = |key| value(Quantity::Region(Frame::Full, Region::Overlap, key));
        let pose = |angle| value(Quantity::MedianError(Frame::Full, angle));
        let [point_error, plane] =
            ["point_error_rel", "point_error_plane_rel"].map(|key| region(key).map(|share| 100.0 * share));
        let shown = |value: Option<f64>| value.map_or("–".into(), |value| number::significant(value, 3));
        let cells = [
            method.method.as_str().into(),
            format!("{num_found} of {}", lines.len()),
            shown(pose(PoseAngle::Rra)),
            shown(pose(PoseAngle::Rta)),
            shown(point_error),
            shown(point_error.and(plane)),
            shown(region("slope_corr_gsd")),
            shown(seconds),
        ];
        Self {
            name: method.method.as_str(),
            looks_at_pictures: method.method.looks_at_pictures(),
            num_found,
            rta_deg: pose(PoseAngle::Rta),
            point_error: point_error.zip(plane).map(|(of_method, of_plane)| [of_method, of_plane]),
            cells,
            sentence: sentence(method, &lines, num_found),
        }
    }
}

/// Where a method fails, and its worst item.
fn sentence(method: &MethodLines, lines: &[&Line], num_found: usize) -> String {
    let name = method.method.as_str();
    if !method.method.looks_at_pictures() {
        return format!("{name}: {}.", method.settings);
    }
    let classes = Breakdown::Trajectory.split(lines.iter().copied());
    let failing = classes.iter().filter_map(|(class, lines)| {
        let failed = lines.iter().filter(|line| line.metrics.pose_failed).count();
        (failed > 0).then(|| format!("{failed} of {} {class}", lines.len()))
    });
    let failing: Vec<String> = failing.collect();
    let found = match failing.is_empty() {
        true if lines.is_empty() => "no item with an answer".into(),
        true => "a pose for every item".into(),
        false => format!("no pose for {}", failing.join(", ")),
    };
    let worst = worst(method).first().filter(|_| num_found > 0).map(|worst| {
        let how = match (worst.is_of_points, worst.error.is_finite()) {
            (_, false) => "no answer".into(),
            (true, _) => format!("point error {} %", number::significant(100.0 * worst.error, 3)),
            (false, _) => format!("pose off by {}°", number::significant(worst.error, 3)),
        };
        format!("; worst: {} ({how})", item_name(worst.line))
    });
    format!("{name}: {found}{}.", worst.unwrap_or_default())
}

/// Which is best, of several that see pictures only: first at the ground, and at the pose by how many they find and then how well.
fn verdict(rows: &[Overview]) -> Option<String> {
    let compared: Vec<&Overview> = rows.iter().filter(|row| row.looks_at_pictures).collect();
    if compared.len() < 2 {
        return None;
    }
    let ground = compared.iter().filter_map(|row| Some((row, row.point_error?)));
    let ground = ground.min_by(|(_, a), (_, b)| a[0].total_cmp(&b[0])).map(|(row, [error, plane])| {
        let [error, plane] = [error, plane].map(|percent| number::significant(percent, 3));
        format!("best ground: {} (point error {error} %, a plane's {plane} %)", row.name)
    });
    let most = compared.iter().map(|row| row.num_found).max().filter(|most| *most > 0);
    let of_most = compared.iter().filter(|row| Some(row.num_found) == most);
    let pose = of_most.filter_map(|row| Some((row, row.rta_deg?)));
    let pose = pose.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(row, rta)| {
        format!("best pose: {} ({}, median RTA {}°)", row.name, row.cells[1], number::significant(rta, 3))
    });
    let parts: Vec<String> = [ground, pose].into_iter().flatten().collect();
    (!parts.is_empty()).then(|| format!("{}.", parts.join("; ")))
}

/// For a terminal: a line a method, which is best, then a sentence for each that sees pictures.
pub fn overview_text(rows: &[Overview]) -> String {
    let heads = HEADS.map(str::to_owned);
    let grid: Vec<&[String; HEADS.len()]> =
        std::iter::once(&heads).chain(rows.iter().map(|r| &r.cells)).collect();
    let width = |k: usize| grid.iter().map(|cells| cells[k].chars().count()).max().unwrap_or(0);
    let widths: [usize; HEADS.len()] = std::array::from_fn(width);
    let mut out = String::new();
    for cells in &grid {
        let padded = cells.iter().zip(widths).enumerate().map(|(k, (text, width))| match k {
            0 => format!("{text:<width$}"),
            _ => format!("{text:>width$}"),
        });
        out += padded.collect::<Vec<_>>().join("  ").trim_end();
        out += "\n";
    }
    let sentences = rows.iter().filter(|row| row.looks_at_pictures).map(|row| row.sentence.clone());
    for sentence in verdict(rows).into_iter().chain(sentences) {
        out += &format!("{sentence}\n");
    }
    out
}

/// For a page: the table, and the sentences.
///
/// # Errors
/// [`Error::Report`] if the table cannot be put together, which no row made here causes.
pub fn overview_table(rows: &[Overview]) -> Result<(Table, Vec<String>), Error> {
    let columns = HEADS.iter().enumerate().map(|(k, head)| match k {
        0 => Column::text(*head),
        _ => Column::number(*head),
    });
    let mut table = Table::new("", columns);
    for row in rows {
        table.row(row.cells.clone().map(Cell::from))?;
    }
    let sentences = rows.iter().map(|row| row.sentence.clone());
    Ok((table, verdict(rows).into_iter().chain(sentences).chain([LEGEND.to_owned() + "."]).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::Method;
    use crate::run::lines::tests::line;
    use selenograph_reconstruct::pipeline::Method as Pictures;

    #[test]
    fn a_row_and_a_sentence_tell_how_good_and_where_it_fails() {
        let mut lines = vec![line("sift", "a", 0, Some(0.5), 0.01), line("sift", "b", 0, None, 0.2)];
        lines[1].item.trajectory = Some(selenograph_dataset::pair::Trajectory::Dynamic);
        let settings = String::new();
        let method = Method::Pictures(Pictures::Sift);
        let methods = [MethodLines { method, settings, lines }];
        let completed = Completed { seconds_per_item: vec![Some(1.5)], ..Completed::default() };
        let text = overview_text(&overview(&methods, &completed));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3, "{text}");
        let cells: Vec<&str> = lines[1].split_whitespace().collect();
        assert_eq!(cells, ["sift", "1", "of", "2", "0.500", "0.500", "10.5", "–", "–", "1.50"]);
        assert_eq!(lines[2], "sift: no pose for 1 of 1 dynamic; worst: b, light 0 (point error 20.0 %).");
    }

    #[test]
    fn of_several_the_best_is_named_and_anchors_are_not_compared() {
        let of = |method: Method, errors: [Option<f64>; 2], point: f64| {
            let mut lines = vec![
                line(method.as_str(), "a", 0, errors[0], point),
                line(method.as_str(), "b", 0, errors[1], point),
            ];
            for line in &mut lines {
                line.metrics.overlap.numbers.point_error_plane_rel = Some(0.05);
            }
            MethodLines { method, settings: String::new(), lines }
        };
        let methods = [
            of(Method::Pictures(Pictures::Orb), [Some(0.1), None], 0.03),
            of(Method::Pictures(Pictures::Sift), [Some(0.5), Some(0.5)], 0.02),
            of(Method::Truth, [Some(0.0), Some(0.0)], 0.0),
        ];
        let rows = overview(&methods, &Completed::default());
        let said = "best ground: sift (point error 2.00 %, a plane's 5.00 %); best pose: sift (2 of 2, median RTA 0.500°).";
        assert_eq!(verdict(&rows).unwrap(), said);
        assert_eq!(verdict(&rows[1..]), None);
        let text = overview_text(&rows);
        assert!(text.contains(said) && !text.contains("truth: "), "{text}");
    }
}
