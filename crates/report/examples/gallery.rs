//! Everything a report can hold, on one page, for looking: `cargo run -p selenograph-report --example gallery > gallery.html`.
#![allow(clippy::print_stdout, reason = "the page is the output")]

use selenograph_raster::Raster;
use selenograph_raster::colormap::Colormap;
use selenograph_report::chart::{Profile, cumulative, profile, reliability};
use selenograph_report::color::{VIEW_1, VIEW_2};
use selenograph_report::figure::{ColorBar, Grid, Line, Panel, side_by_side};
use selenograph_report::{Axis, Cell, Chart, Column, Error, Figure, Page, Picture, Point, PointView, Table};

const SIDE: usize = 256;

/// A bowl with a ridge.
fn height(x: f64, y: f64) -> f64 {
    let from_centre = ((x - 0.4).powi(2) + (y - 0.5).powi(2)).sqrt();
    200.0 * (8.0 * from_centre).cos() * (-3.0 * from_centre).exp() + 40.0 * (12.0 * x).sin()
}

fn heights() -> Raster<f32> {
    let share = |k: usize| k as f64 / SIDE as f64;
    Raster::from_fn(SIDE, SIDE, |x, y| if x + y < 40 { f32::NAN } else { height(share(x), share(y)) as f32 })
}

fn charts() -> Vec<Figure> {
    let xs: Vec<f64> = (0..200).map(|k| f64::from(k) / 20.0).collect();
    let errors = |scale: f64| (1..60).map(|k| scale * f64::from(k * k)).collect::<Vec<f64>>();
    let mut some_failed = errors(0.002);
    some_failed.extend([f64::INFINITY; 12]);
    let truth: Vec<f64> = xs.iter().map(|x| height(x / 10.0, 0.5)).collect();
    let near: Vec<f64> = truth
        .iter()
        .enumerate()
        .map(|(k, t)| if k == 90 { f64::NAN } else { t + 6.0 * (k as f64).sin() })
        .collect();
    let sigma = vec![12.0; xs.len()];
    let completed: Vec<bool> = (0..xs.len()).map(|k| (120..160).contains(&k)).collect();
    let shown = Profile {
        distance: &xs,
        truth: Some(&truth),
        prediction: &near,
        sigma: Some(&sigma),
        completed: Some(&completed),
    };
    let names = ["nadir", "oblique", "dynamic"].map(str::to_owned);
    let groups = [("orb".to_owned(), vec![0.2, 0.5, 0.4]), ("sift".to_owned(), vec![0.1, 0.3, 0.15])];
    let curves = [("orb".to_owned(), some_failed), ("sift".to_owned(), errors(0.0005))];
    let scatter =
        (1..80).map(|k| [f64::from(k) * 100.0, 0.001 * (1.0 + (f64::from(k) * 7.1).sin().abs() * 20.0)]);
    [
        cumulative("Rotation error", Axis::new("error (°)").between(0.0, 5.0), &curves),
        Chart::new("Error against altitude", Axis::new("altitude (m)"), Axis::new("point error").log()).dots(
            "pairs",
            [0, 114, 178],
            scatter.collect(),
        ),
        Chart::grouped_bars("Error by trajectory", &names, Axis::new("error (°)"), &groups).intervals(
            "",
            [40, 40, 40],
            vec![[-0.2, 0.15, 0.25], [0.2, 0.05, 0.12]],
        ),
        reliability(
            "Calibration",
            Axis::new("expected (m)"),
            Axis::new("found (m)"),
            &[("stereo".into(), vec![[1.0, 1.3], [2.0, 2.2], [4.0, 3.7], [8.0, 6.9]])],
        ),
        profile("Central profile", Axis::new("distance (m)"), Axis::new("height (m)"), &shown),
    ]
    .iter()
    .map(|chart| Figure::svg(chart.svg(), "A chart."))
    .collect()
}

fn main() -> Result<(), Error> {
    let mut page = Page::new("Everything a report can hold");
    page.lead("One of each, with made-up numbers.");
    page.section("Words").paragraph("A paragraph with <markup> & quotes.").warning("metric: false");
    page.list(["first", "second"]).listing("run.toml", "seed = 1\nname = \"x\"\n");
    let mut table = Table::new(
        "Methods",
        [
            Column::text("method"),
            Column::number("RRA (°) ↓")
                .defined("angle of the rotation that leads from the estimated to the true rotation"),
            Column::number("coverage ↑").defined("share of co-visible pixels with an answer"),
        ],
    );
    table.row([Cell::from("orb"), "0.412".into(), "n/a".into()])?;
    table.row([
        Cell::from("sift"),
        Cell::from("0.021").best_if(true).with_small("0.018–0.025"),
        "0.93".into(),
    ])?;
    page.section("Tables")
        .table(&table)
        .table(&Table::of_facts("Pose", [("baseline", "812.4 m"), ("sigma", "0.002°")]));
    page.section("Charts").figures(&charts());

    let heights = heights();
    let bar = ColorBar { map: Colormap::Viridis, low: -150.0, high: 200.0, label: "height (m)".into() };
    let panel =
        Panel::of_values(&heights, "Heights", bar)?.line([0.0, 128.0], [256.0, 128.0], [255, 255, 255]);
    let grey =
        heights.map(|h| if h.is_finite() { [(128.0 + h / 2.0).clamp(0.0, 255.0) as u8; 3] } else { [0; 3] });
    let photo = Picture::photo(&grey)?;
    let lines: Vec<Line> = (0..20)
        .map(|k| {
            let at = [30.0 + 10.0 * f64::from(k), 40.0 + 9.0 * f64::from(k * 7 % 20)];
            let color = if k % 6 == 0 { VIEW_1 } else { VIEW_2 };
            Line { left: at, right: [at[0] - 12.0, at[1] + 4.0], color }
        })
        .collect();
    let mut grid = Grid::new(["truth", "stereo", "sift"], 180.0);
    grid.row("depth", vec![Some(photo.clone()), Some(photo.clone()), None]);
    page.section("Pictures").figures(&[
        Figure::svg(panel.svg(), "Values in colours."),
        Figure::svg(
            Panel::new(photo.clone(), "Keys").key(VIEW_2, "safe").key(VIEW_1, "too steep").svg(),
            "With keys.",
        ),
    ]);
    page.figure(&Figure::svg(side_by_side(&photo, &photo, ["view a", "view b"], &lines, 300.0), "Matches."));
    page.figure(&Figure::svg(grid.svg(), "Methods side by side."));
    page.figure(&Figure::picture(&photo, 200, "A photograph."));
    let points: Vec<Point> = (0..600 * 600)
        .map(|k| {
            let (x, y) = (f64::from(k % 600) / 600.0, f64::from(k / 600) / 600.0);
            let h = height(x, y);
            let grey = (128.0 + h / 2.0) as u8;
            Point {
                position: [1000.0 * x as f32, -1000.0 * y as f32, h as f32],
                grey,
                view: 1 + u8::from(x > 0.5),
            }
        })
        .collect();
    page.section("Points").points(&PointView::new(&points, [0.0, 0.0, 1.0]), "A bowl");
    println!("{}", page.finish());
    Ok(())
}
