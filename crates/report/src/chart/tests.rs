use super::axis::linear_ticks;
use super::*;

/// The drawing must be well-formed XML and free of numbers that no browser reads.
fn checked(chart: &Chart) -> String {
    let svg = chart.svg();
    let document = roxmltree::Document::parse(&svg).unwrap_or_else(|error| panic!("{error}: {svg}"));
    assert_eq!(document.root_element().tag_name().name(), "svg");
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    svg
}

#[test]
fn ticks_are_round_and_inside() {
    let labels = |low, high| linear_ticks([low, high], 6).into_iter().map(|t| t.1).collect::<Vec<_>>();
    assert_eq!(labels(0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
    assert_eq!(labels(-30.0, 70.0), ["−20", "0", "20", "40", "60"]);
    assert_eq!(labels(0.0, 0.003), ["0.0000", "0.0005", "0.0010", "0.0015", "0.0020", "0.0025", "0.0030"]);
    assert!(linear_ticks([1.0, 1.0], 6).is_empty());
}

#[test]
fn axes_begin_at_zero_where_data_are_near_it_and_survive_no_data() {
    let axis = Axis::new("x");
    assert_eq!(axis.ends([1.0, 10.0].into_iter())[0], 0.0);
    assert!(axis.ends([8.0, 10.0].into_iter())[0] > 7.0);
    assert_eq!(axis.ends([f64::NAN].into_iter()), [0.0, 1.0]);
    let log = Axis::new("x").log();
    assert_eq!(log.share(-1.0, log.ends([0.0, 5.0, 0.5].into_iter())), None);
    let [low, high] = log.ends([0.0, 5.0, 0.5].into_iter());
    assert!(low > 0.4 && high < 6.0);
}

#[test]
fn every_mark_is_drawn() {
    let points = vec![[0.0, 1.0], [1.0, f64::NAN], [2.0, 3.0], [3.0, 2.0]];
    let chart = Chart::new("a < b", Axis::new("x (m)"), Axis::new("y (°)"))
        .line("line", [1, 2, 3], points.clone())
        .dashed("dashed", [1, 2, 3], points.clone())
        .dots("dots", [1, 2, 3], points)
        .bars("bars", [1, 2, 3], vec![[0.0, 1.0], [1.0, -2.0]])
        .intervals("", [0, 0, 0], vec![[0.0, 0.5, 1.5]])
        .band("band", [9, 9, 9], vec![[0.0, 0.0, 1.0], [3.0, 1.0, 2.0]]);
    let svg = checked(&chart);
    assert!(svg.contains("a &lt; b") && svg.contains("stroke-dasharray"));
    assert_eq!(svg.matches("<circle").count(), 3 + 1, "three dots and one in the legend");
    assert_eq!(svg.matches("<polygon").count(), 1);
    // The line is broken at the absent point: two moves.
    let line = svg.lines().find(|l| l.contains("stroke-width=\"1.8\"")).unwrap();
    assert_eq!(line.matches('M').count(), 2);
}

#[test]
fn empty_and_absurd_data_still_make_a_drawing() {
    checked(&Chart::new("", Axis::new(""), Axis::new("")));
    checked(&Chart::new("t", Axis::new("x").log(), Axis::new("y").log()).line(
        "l",
        [0; 3],
        vec![[0.0, -1.0], [1e-300, 1e300]],
    ));
    checked(&Chart::grouped_bars("t", &[], Axis::new("y"), &[]));
}

#[test]
fn kinds() {
    let errors = vec![0.1, f64::INFINITY, 0.3, f64::NAN];
    let chart = cumulative("c", Axis::new("°").between(0.0, 1.0), &[("m".into(), errors)]);
    // Two of four cases have an answer: the curve ends at one half.
    assert_eq!(chart.series[0].points.last(), Some(&[1.0, 0.5]));
    checked(&chart);
    checked(&reliability("r", Axis::new("x"), Axis::new("y"), &[("m".into(), vec![[0.1, 0.2], [1.0, 0.9]])]));
    let distance = [0.0, 1.0, 2.0, 3.0, 4.0];
    let values = [1.0, 2.0, f64::NAN, 2.0, 1.0];
    let sigma = [0.1; 5];
    let completed = [false, false, false, true, true];
    let both = Profile {
        distance: &distance,
        truth: Some(&values),
        prediction: &values,
        sigma: Some(&sigma),
        completed: Some(&completed),
    };
    let svg = checked(&profile("p", Axis::new("m"), Axis::new("m"), &both));
    assert_eq!(svg.matches("<polygon").count(), 2, "a gap makes two bands");
    assert!(svg.contains(">completed<") && svg.contains("stroke-dasharray"));
    let names = ["nadir".to_owned(), "oblique".to_owned()];
    let groups = [("a".to_owned(), vec![1.0, 2.0]), ("b".to_owned(), vec![2.0, f64::NAN])];
    let svg = checked(&Chart::grouped_bars("g", &names, Axis::new("y"), &groups));
    assert!(svg.contains(">oblique<"));
}
