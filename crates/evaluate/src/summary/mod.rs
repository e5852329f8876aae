//! Lines of an evaluation become numbers: what is taken of a line, and which lines belong together.

pub(crate) mod classes;
mod overview;
mod page;
mod quantity;
mod results;

pub use overview::{Overview, overview, overview_table, overview_text};
pub use page::{Contents, page};
pub use results::{Results, summary_json};

pub(crate) use classes::Breakdown;
pub(crate) use quantity::{Failures, Frame, PoseAngle, Quantity};

use crate::bootstrap::{Estimate, estimate};
use crate::method::Method;
use crate::run::Line;

/// The lines of a method, in the order of the dataset.
#[derive(Debug, Clone)]
pub struct MethodLines {
    /// The method.
    pub method: Method,
    /// What it does, with which settings, in one line.
    pub settings: String,
    /// Its lines.
    pub lines: Vec<Line>,
}

/// A quantity over lines, with its interval over geometries; `None` where no line has it.
pub(crate) fn estimate_of<'a>(
    lines: impl IntoIterator<Item = &'a Line>,
    quantity: &Quantity,
) -> Option<Estimate> {
    let mut groups: std::collections::BTreeMap<&str, Vec<f64>> = std::collections::BTreeMap::new();
    for line in lines {
        if let Some(value) = quantity.of(line) {
            groups.entry(&line.item.pair).or_default().push(value);
        }
    }
    let groups: Vec<Vec<f64>> = groups.into_values().collect();
    estimate(&groups, quantity.statistic())
}
