use super::*;
use selenograph_raster::Raster;
use selenograph_raster::colormap::Colormap;

fn checked(svg: String) -> String {
    roxmltree::Document::parse(&svg).unwrap_or_else(|error| panic!("{error}: {svg}"));
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    svg
}

fn picture(width: usize, height: usize) -> Picture {
    Picture::exact(&Raster::filled(width, height, [10, 20, 30])).unwrap()
}

#[test]
fn pictures_hold_themselves() {
    assert!(picture(3, 2).data_uri().starts_with("data:image/png;base64,iVBORw0KGgo"));
    let photo = Picture::photo(&Raster::filled(8, 8, [7; 3])).unwrap();
    assert!(photo.data_uri().starts_with("data:image/jpeg;base64,/9j/"));
    assert!(Picture::exact(&Raster::filled(0, 2, [0; 3])).is_err());
    let html = Figure::picture(&photo, 8, "grey < white").html();
    assert!(html.contains("alt=\"grey &lt; white\"") && html.contains("<figcaption>"));
}

#[test]
fn lines_lead_from_picture_to_picture() {
    let line = |left, right| Line { left, right, color: [255, 0, 0] };
    let lines = [line([50.0, 25.0], [10.0, 10.0]), line([f64::NAN, 0.0], [0.0, 0.0])];
    let svg = checked(side_by_side(&picture(100, 50), &picture(20, 20), ["a", "b"], &lines, 100.0));
    // Left scale 2, right scale 5, the right picture begins at 200 + 12, both 20 below the top.
    assert!(svg.contains("M100.0 70.0L262.0 70.0"), "{svg}");
    assert_eq!(svg.matches("<path").count(), 1);
}

#[test]
fn panels_and_grids() {
    let values = Raster::from_fn(4, 3, |x, y| if x == y { f32::NAN } else { x as f32 });
    let bar = |low, high| ColorBar { map: Colormap::Viridis, low, high, label: "m".into() };
    let panel = Panel::of_values(&values, "depth <z>", bar(0.0, 3.0)).unwrap();
    let panel = panel.key([1, 2, 3], "safe").line([0.0, 1.5], [4.0, 1.5], [255; 3]);
    let svg = checked(panel.svg());
    assert!(svg.contains("depth &lt;z&gt;") && svg.contains(">safe<") && svg.contains(">3<"));
    let map = panel.scale_bar(8160.0, "m").north(Some(0.5));
    let svg = checked(map.svg());
    // 30 % of the width is 2.4 km: a bar of 2 km.
    assert!(svg.contains(">2 km</text>") && svg.contains("rotate(28.6)"), "{svg}");
    // A map of one value has a bar without a length; it must not stop the report.
    checked(Panel::of_values(&values, "t", bar(2.0, 2.0)).unwrap().svg());
    let mut grid = Grid::new(["truth", "sift"], 100.0);
    grid.row("nadir", vec![Some(picture(4, 4)), None]).row("none", vec![None, None]);
    assert_eq!(checked(grid.svg()).matches("no answer").count(), 3);
    // A row that begins in the second column, with its bar to the right of all.
    grid.row_from(1, "slope", vec![Some(picture(4, 4))], Some(bar(0.0, 40.0)));
    let svg = checked(grid.svg());
    assert!(svg.contains("<image x=\"126.0\"") && svg.contains(">40</text>"), "{svg}");
}
