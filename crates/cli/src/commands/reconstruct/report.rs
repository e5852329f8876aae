//! `report.html` of a reconstruction.

use super::inputs::Pictures;
use super::pose_file::PoseRecord;
use selenograph_geometry::Point3;
use selenograph_raster::colormap::Colormap;
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::hazard::Hazard;
use selenograph_reconstruct::pipeline::Reconstruction;
use selenograph_reconstruct::products::Products;
use selenograph_report::chart::{Profile, profile};
use selenograph_report::color::{PREDICTION, Rgb, VIEW_1, VIEW_2};
use selenograph_report::figure::{ColorBar, Line, Panel, side_by_side};
use selenograph_report::number::{fixed, significant};
use selenograph_report::{Axis, Column, Figure, Page, Picture, Point, PointView, Table};

/// Lines between the pictures: more hide them.
const MAX_LINES: usize = 300;
/// Slopes from here on have the brightest colour, degrees.
const STEEP_DEG: f64 = 40.0;
/// Longest side of a map in the page, pixels: the files beside it have the full size.
const MAX_SIDE: usize = 1024;
/// Width of one of two figures in a row, CSS pixels.
const HALF: f64 = 400.0;

const CLASSES: [(Hazard, Rgb, &str); 5] = [
    (Hazard::Safe, [52, 152, 92], "safe"),
    (Hazard::Slope, [214, 96, 40], "too steep"),
    (Hazard::Roughness, [226, 178, 44], "too rough"),
    (Hazard::Both, [150, 32, 48], "too steep and too rough"),
    (Hazard::Unknown, [120, 120, 130], "cannot be told"),
];

/// Everything on one page.
///
/// # Errors
/// Pictures that cannot be encoded.
pub fn page(
    pictures: &Pictures,
    found: &Reconstruction,
    made: &Products,
    pose: Option<&PoseRecord>,
    run_toml: &str,
) -> anyhow::Result<String> {
    let names = pictures.paths.each_ref().map(|path| name_of(path));
    let mut page = Page::new(format!("Terrain from {} and {}", names[0], names[1]));
    page.lead(&pose.map_or_else(|| "There is no relative pose.".to_owned(), PoseRecord::sentence));
    for warning in &found.warnings {
        page.warning(&warning.to_string());
    }
    page.section("Pose and size").table(&facts(found, made, pose));
    page.section("Pictures and matches");
    page.figure(&matches(pictures, found, [&names[0], &names[1]])?);
    page.section("Depth").figures(&depths(found)?);
    let unit = unit_of(found);
    page.section("Terrain").figures(&terrain(made, unit)?);
    page.figure(&central_profile(made, unit));
    page.section("Hazards").figure(&hazards(made)?).table(&hazard_table(made, unit)?);
    page.section("Points").points(&cloud(made), "Every measured point; view 1 red, view 2 green");
    page.section("How this was made").list(&pictures.notes).listing("run.toml", run_toml);
    Ok(page.finish())
}

/// What lengths are in.
fn unit_of(found: &Reconstruction) -> &'static str {
    match (found.placement.metric, &found.prediction.cam_b_from_cam_a) {
        (true, _) => "m",
        (false, Ok(_)) => "baselines",
        (false, Err(_)) => "units",
    }
}

fn name_of(path: &std::path::Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// Numbers in words; what an answer does not have is left out.
fn facts(found: &Reconstruction, made: &Products, pose: Option<&PoseRecord>) -> Table {
    let summary = &made.summary;
    let unit = format!(" {}", unit_of(found));
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let mut facts = vec![("metric", summary.metric.to_string()), ("size from", summary.scale_source.clone())];
    facts.extend(pose.into_iter().flat_map(pose_facts));
    facts.push((
        "sigma of the size",
        summary
            .scale_sigma
            .map_or_else(|| "not known".into(), |s| format!("{} %", significant(100.0 * s, 2))),
    ));
    let counts = &found.counts;
    if counts.features != [0, 0] {
        facts.push(("features", format!("{} and {}", counts.features[0], counts.features[1])));
        let numbers = format!("{}, {}, {}", counts.matches, counts.refined, counts.inliers);
        facts.push(("matches, aligned, agreeing", numbers));
    } else if counts.matches > 0 {
        facts.push(("matches, agreeing", format!("{}, {}", counts.matches, counts.inliers)));
    }
    let focal = found.cameras.each_ref().map(|camera| format!("{:.2}", camera.fx));
    let cells = format!(
        "{}×{} cells of {}{unit}; {}",
        summary.grid_size[0],
        summary.grid_size[1],
        significant(summary.cell, 4),
        summary.frame
    );
    let [low, high] = summary.height_range.map(|h| fixed(h, 2));
    let sigma =
        summary.sigma_median.map_or_else(|| "not known".into(), |s| format!("{}{unit}", significant(s, 3)));
    facts.extend([
        ("focal lengths", format!("{} px and {} px", focal[0], focal[1])),
        ("measured pixels", format!("{} and {}", percent(summary.measured[0]), percent(summary.measured[1]))),
        (
            "completed pixels",
            format!("{} and {}", percent(summary.completed[0]), percent(summary.completed[1])),
        ),
        ("grid", cells),
        ("heights", format!("{low} to {high}{unit}")),
        ("median sigma of the heights", sigma),
    ]);
    Table::of_facts("", facts)
}

fn pose_facts(pose: &PoseRecord) -> Vec<(&'static str, String)> {
    let unit = if pose.metric { " m" } else { " baselines" };
    let sigma = |value: Option<f64>| value.map_or_else(|| "not known".into(), |v| format!("{v:.4}°"));
    let plane_share =
        pose.plane_share.map_or_else(|| "not known".into(), |share| format!("{:.1} %", 100.0 * share));
    vec![
        ("relative pose", pose.source.to_owned()),
        ("rotation between the views", format!("{:.4}°", pose.rotation_deg)),
        ("its sigma", sigma(pose.rotation_sigma_deg)),
        ("sigma of the direction of motion", sigma(pose.direction_sigma_deg)),
        ("baseline", format!("{}{unit}", significant(pose.baseline, 6))),
        ("residual of what agrees", format!("{:.3} px", pose.residual_px)),
        ("share of it on one plane", plane_share),
    ]
}

/// Grey levels stretched between their darkest and brightest thousandth.
fn photo(image: &Raster<f32>) -> anyhow::Result<Picture> {
    let levels = image.data.iter().step_by((image.data.len() / 100_000).max(1)).map(|v| f64::from(*v));
    let [low, high] = statistics::quantiles(levels, [0.001, 0.999]).unwrap_or([0.0, 1.0]);
    Ok(Picture::photo(&shrunk(&Colormap::Grey.paint(image, low, high)))?)
}

/// Every so many pixels of a picture that is too large for a page.
fn shrunk<T: Copy>(raster: &Raster<T>) -> Raster<T> {
    let step = raster.width.max(raster.height).div_ceil(MAX_SIDE).max(1);
    Raster::from_fn(raster.width.div_ceil(step), raster.height.div_ceil(step), |x, y| {
        raster[(x * step, y * step)]
    })
}

fn matches(pictures: &Pictures, found: &Reconstruction, names: [&str; 2]) -> anyhow::Result<Figure> {
    let [a, b] = &pictures.views;
    let (photo_a, photo_b) = (photo(&a.image)?, photo(&b.image)?);
    let scales = [photo_a.width as f64 / a.image.width as f64, photo_b.width as f64 / b.image.width as f64];
    let step = found.matches.len().div_ceil(MAX_LINES).max(1);
    let lines: Vec<Line> = found
        .matches
        .iter()
        .step_by(step)
        .map(|m| Line {
            left: [m.a.x * scales[0], m.a.y * scales[0]],
            right: [m.b.x * scales[1], m.b.y * scales[1]],
            color: if m.inlier { VIEW_2 } else { VIEW_1 },
        })
        .collect();
    let judged = match found.prediction.cam_b_from_cam_a {
        Ok(_) => "green agree with the pose, red do not",
        Err(_) => "no pose says which are right",
    };
    let (shown, all) = (lines.len(), found.matches.len());
    let caption = format!("{shown} of {all} matches; {judged}. Grey levels are stretched for looking.");
    Ok(Figure::svg(side_by_side(&photo_a, &photo_b, names, &lines, 520.0), &caption))
}

/// The z-depth of each view in viridis, on one scale.
fn depths(found: &Reconstruction) -> anyhow::Result<Vec<Figure>> {
    let Some(views) = &found.prediction.views else { return Ok(Vec::new()) };
    let scale = found.placement.cam_a_from_pred.scale();
    let unit = unit_of(found);
    let motion = found.prediction.cam_b_from_cam_a.as_ref().ok();
    let mut figures = Vec::new();
    for (k, (view, name)) in views.iter().zip(["a", "b"]).enumerate() {
        let depth_z = view.points.map(|point| {
            let x_in_a = Point3::from(point.map(f64::from));
            let z = match motion.filter(|_| k == 1) {
                Some(motion) => motion.point(&x_in_a).z,
                None => x_in_a.z,
            };
            (z * scale) as f32
        });
        let sampled = depth_z.data.iter().step_by(7).map(|z| f64::from(*z));
        let [low, high] = statistics::quantiles(sampled, [0.002, 0.998]).unwrap_or([0.0, 1.0]);
        let bar = ColorBar { map: Colormap::Viridis, low, high, label: format!("z-depth ({unit})") };
        let panel = Panel::of_values(&shrunk(&depth_z), format!("View {name}"), bar)?.width(HALF);
        figures.push(Figure::svg(panel.svg(), "Grey: no point."));
    }
    Ok(figures)
}

fn terrain(made: &Products, unit: &str) -> anyhow::Result<Vec<Figure>> {
    let shade = Picture::exact(&shrunk(&Colormap::Grey.paint(&made.hillshade, 0.0, 1.0)))?;
    let (width, height) = (shade.width as f64, shade.height as f64);
    let middle = 0.5 * height;
    let shade = Panel::new(shade, "Hillshade").width(HALF).line([0.0, middle], [width, middle], PREDICTION);
    let heights = &made.dem.heights;
    let sampled = heights.data.iter().step_by(7).map(|h| f64::from(*h));
    let [low, high] = statistics::quantiles(sampled, [0.002, 0.998]).unwrap_or([0.0, 1.0]);
    let bar = ColorBar { map: Colormap::Viridis, low, high, label: format!("height ({unit})") };
    let heights = Panel::of_values(&shrunk(heights), "Heights", bar)?.width(HALF);
    let slope_deg = made.slope_rad.map(|slope| slope.to_degrees());
    let bar = ColorBar { map: Colormap::Inferno, low: 0.0, high: STEEP_DEG, label: "slope (°)".into() };
    let slope = Panel::of_values(&shrunk(&slope_deg), "Slope", bar)?.width(HALF);
    let mut figures = vec![
        Figure::svg(shade.svg(), "Lit from the upper left; the line is that of the profile below."),
        Figure::svg(heights.svg(), &made.summary.frame),
        Figure::svg(slope.svg(), "By Horn's 3×3 kernel on the grid."),
    ];
    let sampled = made.dem.sigma.data.iter().step_by(7).map(|s| f64::from(*s));
    if let Some([high]) = statistics::quantiles(sampled, [0.98]) {
        let bar = ColorBar { map: Colormap::Inferno, low: 0.0, high, label: format!("sigma ({unit})") };
        let sigma = Panel::of_values(&shrunk(&made.dem.sigma), "Sigma of the heights", bar)?.width(HALF);
        figures.push(Figure::svg(
            sigma.svg(),
            "What the matching itself can tell; an error of the size is not in it.",
        ));
    }
    Ok(figures)
}

fn central_profile(made: &Products, unit: &str) -> Figure {
    let (heights, sigma) = (&made.dem.heights, &made.dem.sigma);
    let row = heights.height / 2;
    let distance: Vec<f64> = (0..heights.width).map(|x| x as f64 * made.dem.cell).collect();
    let values = |raster: &Raster<f32>| raster.row(row).iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
    let (prediction, sigma) = (values(heights), values(sigma));
    let has_sigma = sigma.iter().any(|s| s.is_finite());
    let shown = Profile {
        distance: &distance,
        truth: None,
        prediction: &prediction,
        sigma: has_sigma.then_some(sigma.as_slice()),
    };
    let axes = [Axis::new(format!("distance ({unit})")), Axis::new(format!("height ({unit})"))];
    let [x, y] = axes;
    Figure::svg(
        profile("Central profile", x, y, &shown).size(1000.0, 300.0).svg(),
        "The middle row of the grid, from left to right.",
    )
}

fn hazards(made: &Products) -> anyhow::Result<Figure> {
    let color =
        |class: &Hazard| CLASSES.iter().find(|(c, ..)| c == class).map_or([0; 3], |(_, color, _)| *color);
    let mut panel =
        Panel::new(Picture::exact(&shrunk(&made.hazard.classes.map(color)))?, "Hazards").width(HALF);
    for (_, color, meaning) in CLASSES {
        panel = panel.key(color, meaning);
    }
    Ok(Figure::svg(panel.svg(), "Slope and roughness over the lander's footprint, against the limits below."))
}

fn hazard_table(made: &Products, unit: &str) -> anyhow::Result<Table> {
    let hazard = &made.summary.hazard;
    let columns =
        [Column::text("limit"), Column::number("value"), Column::text("class"), Column::number("share (%)")];
    let mut table = Table::new("", columns);
    let percent = |share: f64| fixed(100.0 * share, 1);
    table.row([
        "slope".to_owned(),
        format!("{}°", significant(hazard.max_slope_deg, 3)),
        "safe".into(),
        percent(hazard.safe),
    ])?;
    table.row([
        "roughness".to_owned(),
        format!("{} {unit}", significant(hazard.max_roughness, 3)),
        "too steep".into(),
        percent(hazard.slope + hazard.both),
    ])?;
    table.row([
        "footprint".to_owned(),
        format!("{} {unit}", significant(hazard.footprint, 3)),
        "too rough".into(),
        percent(hazard.roughness + hazard.both),
    ])?;
    let judged = if hazard.sigma_aware { "by value and sigma" } else { "by value alone" };
    table.row(["judged".to_owned(), judged.to_owned(), "cannot be told".into(), percent(hazard.unknown)])?;
    Ok(table)
}

fn cloud(made: &Products) -> PointView {
    let points: Vec<Point> = made
        .cloud
        .points
        .iter()
        .map(|point| Point { position: point.position, grey: point.color[0], view: point.view + 1 })
        .collect();
    PointView::new(&points, [0.0, 0.0, 1.0])
}
