use super::*;
use crate::method::Method;
use crate::run::lines::tests::line;
use selenograph_reconstruct::pipeline::Method as Pictures;

/// Two methods on three geometries under two lights; the first fails once.
fn methods() -> Vec<MethodLines> {
    let lines = |name: &str, scale: f64| {
        let mut lines = Vec::new();
        for (k, pair) in ["p1", "p2", "p3"].iter().enumerate() {
            for light in 0..2 {
                let error = scale * (1.0 + k as f64 + 0.1 * light as f64);
                let pose = if scale > 1.0 && k == 2 && light == 1 { None } else { Some(error) };
                let mut line = line(name, pair, light, pose, 1e-3 * error);
                if k == 2 {
                    line.item.trajectory = Some(selenograph_dataset::pair::Trajectory::Oblique);
                }
                line.metrics.overlap.numbers.slope_corr_gsd = Some(0.8);
                line.metrics.overlap.numbers.slope_corr_gsd_ceiling = Some(0.95);
                lines.push(line);
            }
        }
        lines
    };
    vec![
        MethodLines {
            method: Method::Pictures(Pictures::Orb),
            settings: String::new(),
            lines: lines("orb", 1.5),
        },
        MethodLines {
            method: Method::Pictures(Pictures::Sift),
            settings: String::new(),
            lines: lines("sift", 0.5),
        },
    ]
}

#[test]
fn classes_methods_anchors_and_all_together() {
    let table = Table::build(specs::breakdown("trajectory"), Breakdown::Trajectory, &methods());
    let rows: Vec<(&str, &str, usize, usize)> = table
        .rows
        .iter()
        .map(|row| (row.class.as_str(), row.name.as_str(), row.num_items, row.num_geometries))
        .collect();
    assert_eq!(
        rows,
        [
            ("nadir", "orb", 4, 2),
            ("nadir", "sift", 4, 2),
            ("nadir", "floor / ceiling", 4, 2),
            ("oblique", "orb", 2, 1),
            ("oblique", "sift", 2, 1),
            ("oblique", "floor / ceiling", 2, 1),
            ("all", "orb", 6, 3),
            ("all", "sift", 6, 3),
            ("all", "floor / ceiling", 6, 3),
        ]
    );
    // Failed: one of six. RRA below 2°: a third of ORB's (1.5, 1.65), all of SIFT's.
    let value = |row: usize, column: usize| table.rows[row].cells[column].unwrap().estimate.value;
    assert!((value(6, 0) - 100.0 / 6.0).abs() < 1e-9);
    assert!((value(6, 1) - 100.0 / 3.0).abs() < 1e-9 && (value(7, 1) - 100.0).abs() < 1e-9);
    // One geometry has no interval.
    assert!(table.rows[4].cells[0].unwrap().estimate.interval.is_none());
    assert!(table.rows[7].cells[0].unwrap().estimate.interval.is_some());
}

#[test]
fn best_and_reduction_are_of_methods_that_see_pictures() {
    let mut rows: Vec<Row> = [(RowKind::Anchor, 0.0), (RowKind::Method, 4.0), (RowKind::Method, 1.0)]
        .into_iter()
        .map(|(kind, value)| {
            let estimate = Estimate { value, interval: None, num_items: 1, num_geometries: 1 };
            let cell = Some(Cell { estimate, is_best: false, reduction_pct: None });
            let mut spec_cells = vec![None; specs::terrain_paper().columns.len()];
            spec_cells[2] = cell;
            let (class, name) = ("all".to_owned(), "m".to_owned());
            Row { class, name, kind, num_items: 1, num_geometries: 1, cells: spec_cells }
        })
        .collect();
    let spec = specs::terrain_paper();
    mark_best(&spec, &mut rows);
    tell_reductions(&spec, &mut rows);
    let cell = |row: usize| rows[row].cells[2].unwrap();
    assert_eq!([cell(0).is_best, cell(1).is_best, cell(2).is_best], [false, false, true]);
    assert_eq!(
        [cell(0).reduction_pct, cell(1).reduction_pct, cell(2).reduction_pct],
        [None, None, Some(75.0)]
    );
}

#[test]
fn a_reduction_that_leaves_something_is_never_all() {
    let told = |pct: f64| {
        let estimate = Estimate { value: 1.0, interval: None, num_items: 1, num_geometries: 1 };
        render::reduction(&Cell { estimate, is_best: false, reduction_pct: Some(pct) }).unwrap()
    };
    // 0.696 → 0.0025.
    assert_eq!(told(100.0 * (1.0 - 0.0025 / 0.696)), "−99.6 %");
    assert_eq!(
        [told(99.9991), told(75.2), told(-20.0), told(100.0)],
        ["−99.9991 %", "−75 %", "+20 %", "−100 %"]
    );
}

/// The forms of one small table, as they were looked at and found right.
#[test]
fn forms_are_as_they_were() {
    let mut spec = specs::breakdown("trajectory");
    spec.columns
        .retain(|column| ["failed", "point error", "slope corr. GSD"].contains(&column.head.as_str()));
    // The definitions of the keys are not this module's.
    for (k, column) in spec.columns.iter_mut().enumerate() {
        column.definition = format!("what column {k} means");
    }
    let table = Table::build(spec, Breakdown::All, &methods());
    let forms =
        [("txt", table.text()), ("md", table.markdown()), ("tex", table.latex()), ("csv", table.csv())];
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/tables");
    for (extension, form) in forms {
        let path = folder.join(format!("small.{extension}"));
        let expected = std::fs::read_to_string(&path).unwrap_or_default();
        assert_eq!(form, expected, "{}: put the new form there if it is meant", path.display());
    }
}

#[test]
fn published_rows_stand_in_their_class_only() {
    let table = Table::build(specs::terrain_paper(), Breakdown::Trajectory, &methods());
    let published: Vec<(&str, &str)> = table
        .rows
        .iter()
        .filter(|row| row.kind == RowKind::Published)
        .map(|row| (row.class.as_str(), row.name.as_str()))
        .collect();
    assert_eq!(published.len(), 4);
    assert_eq!(published[0], ("nadir", "paper: MASt3R"));
    let heads: Vec<&str> = table.spec.columns.iter().map(|column| column.head.as_str()).collect();
    // Every published number has its column.
    assert!(crate::paper::TERRAIN.iter().flat_map(|row| row.values).all(|(head, _)| heads.contains(head)));
}
