//! Everything that is said of an evaluation in numbers: the tables, and one JSON of all means.

use super::{Breakdown, Frame, MethodLines, Quantity, estimate_of};
use crate::Error;
use crate::bootstrap::Estimate;
use crate::dataset_source::Source;
use crate::pair_metrics::{Region, Scope, definitions};
use crate::run::Completed;
use crate::summary::classes::has_an_answer;
use crate::table::{Table, specs};
use serde_json::{Map, Value, json};
use std::path::Path;

/// The tables of an evaluation.
#[derive(Debug, Clone)]
pub struct Results {
    /// The paper's two, each in its own and in an honest form, by trajectory; depth, sigma, hazards.
    pub main: Vec<Table>,
    /// Key numbers by light, altitude, overlap and illumination, where items differ in it.
    pub by_class: Vec<Table>,
    /// Items that have no right answer but "cannot say"; `None` where there are none.
    pub hard: Option<Table>,
}

impl Results {
    /// Computes every table that has numbers.
    pub fn new(methods: &[MethodLines]) -> Self {
        let main = [
            specs::pose(),
            specs::pose_paper(),
            specs::terrain(Region::Overlap),
            specs::terrain(Region::Full),
            specs::terrain_paper(),
            specs::depth_and_sigma(),
            specs::hazards(),
        ];
        let main = main.map(|spec| Table::build(spec, Breakdown::Trajectory, methods));
        let answered = |methods: &[MethodLines]| -> Vec<crate::run::Line> {
            let lines = methods.first().map(|m| m.lines.clone()).unwrap_or_default();
            lines.into_iter().filter(|line| has_an_answer(&line.item)).collect()
        };
        let first = answered(methods);
        let splits = Breakdown::SPLITS.into_iter().filter(|split| *split != Breakdown::Trajectory);
        let by_class = splits
            .filter(|split| split.split(&first).len() > 1)
            .map(|split| Table::build(specs::breakdown(split.as_str()), split, methods))
            .collect();
        Self {
            main: main.into_iter().filter(|table| !table.is_empty()).collect(),
            by_class,
            hard: Table::of_hard_cases(methods),
        }
    }

    /// All tables.
    pub fn all(&self) -> impl Iterator<Item = &Table> {
        self.main.iter().chain(&self.by_class).chain(&self.hard)
    }

    /// Writes every table as text, Markdown, LaTeX and CSV into a folder.
    ///
    /// # Errors
    /// [`Error::Io`] if that is refused.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        std::fs::create_dir_all(folder).map_err(Error::io("make", folder))?;
        for table in self.all() {
            for (extension, text) in [
                ("txt", table.text()),
                ("md", table.markdown()),
                ("tex", table.latex()),
                ("csv", table.csv()),
            ] {
                let path = folder.join(format!("{}.{extension}", table.spec.id));
                selenograph_files::write(&path, text)?;
            }
        }
        Ok(())
    }
}

/// Every mean of every method and trajectory, with what was left out: `summary.json`.
pub fn summary_json(source: &Source, completed: &Completed, methods: &[MethodLines]) -> Value {
    let name = source.root.file_name().map(|name| name.to_string_lossy().into_owned());
    let of_methods: Map<String, Value> = methods
        .iter()
        .map(|method| {
            let mut classes: Map<String, Value> = Breakdown::Trajectory
                .split(&method.lines)
                .into_iter()
                .map(|(class, lines)| (class, means(&lines)))
                .collect();
            let answered: Vec<_> = method.lines.iter().filter(|line| has_an_answer(&line.item)).collect();
            classes.insert("all".into(), means(&answered));
            let value = json!({
                "settings": method.settings,
                "by_trajectory": classes,
            });
            (method.method.as_str().to_owned(), value)
        })
        .collect();
    let used: Vec<Value> = definitions()
        .map(|d| json!({ "key": d.key, "unit": d.unit, "better": d.better, "text": d.text }))
        .collect();
    json!({
        "dataset": name,
        "num_items": completed.num_items,
        "num_resumed": completed.num_resumed,
        "half_pixel": source.pixels.told,
        "skipped": completed.skipped,
        "methods": of_methods,
        "definitions": used,
    })
}

/// Every quantity of some lines: shares and areas of the pose, and the mean of every key.
fn means(lines: &[&crate::run::Line]) -> Value {
    let geometries: std::collections::BTreeSet<&str> =
        lines.iter().map(|line| line.item.pair.as_str()).collect();
    let of = |quantity: Quantity| estimate_of(lines.iter().copied(), &quantity);
    let mut full = Map::new();
    for table in [specs::pose(), specs::pose_paper()] {
        let shares: Map<String, Value> = table
            .columns
            .iter()
            .filter_map(|column| Some((column.head.clone(), estimate_json(of(column.quantity)?))))
            .collect();
        full.insert(table.id, Value::Object(shares));
    }
    for (name, frame) in [("full_frame", Frame::Full), ("reference_frame", Frame::ReferenceRows)] {
        let numbers = |scope: Scope, make: &dyn Fn(&'static str) -> Quantity| -> Map<String, Value> {
            definitions()
                .filter(|d| d.scope == scope)
                .filter_map(|d| Some((d.key.to_owned(), estimate_json(of(make(d.key))?))))
                .collect()
        };
        let mut keys = numbers(Scope::Pair, &|key| Quantity::Pair(frame, key));
        for (region_name, region) in [("overlap", Region::Overlap), ("full", Region::Full)] {
            let region = numbers(Scope::Region, &|key| Quantity::Region(frame, region, key));
            keys.insert(region_name.into(), Value::Object(region));
        }
        full.insert(name.into(), Value::Object(keys));
    }
    json!({ "num_items": lines.len(), "num_geometries": geometries.len(), "numbers": full })
}

fn estimate_json(estimate: Estimate) -> Value {
    json!({ "value": estimate.value, "interval": estimate.interval, "num_items": estimate.num_items })
}
