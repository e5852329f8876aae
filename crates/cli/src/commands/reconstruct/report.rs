//! `report.html` of a reconstruction.

mod maps;
mod residuals;
mod shading;

use super::inputs::Pictures;
use super::pose_file::PoseRecord;
use super::reference;
use super::shading::Record as ShadingRecord;
use crate::commands::figures::{HALF, name_of, shrunk};
use maps::{frame_words, hazard_table, hazards, terrain, what_would_tell};
use selenograph_geometry::Point3;
use selenograph_raster::colormap::Colormap;
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::Fill;
use selenograph_reconstruct::pipeline::Reconstruction;
use selenograph_reconstruct::products::{ProductOptions, Products};
use selenograph_report::chart::{Profile, profile};
use selenograph_report::color::{VIEW_1, VIEW_2};
use selenograph_report::figure::{ColorBar, Line, Panel, side_by_side};
use selenograph_report::number::{fixed, significant};
use selenograph_report::{Axis, Figure, Page, Picture, Point, PointView, Table};

/// Lines between the pictures: more hide them.
const MAX_LINES: usize = 300;
/// What the page is made of.
pub struct Contents<'a> {
    pub pictures: &'a Pictures,
    pub found: &'a Reconstruction,
    pub made: &'a Products,
    pub pose: Option<&'a PoseRecord>,
    pub reference: Option<&'a reference::Record>,
    pub shading: Option<&'a ShadingRecord>,
    pub options: &'a ProductOptions,
    pub run_toml: &'a str,
}

/// Everything on one page.
///
/// # Errors
/// Pictures that cannot be encoded.
pub fn page(contents: &Contents<'_>) -> anyhow::Result<String> {
    let Contents { pictures, found, made, pose, reference, shading, options, run_toml } = *contents;
    let names = pictures.paths.each_ref().map(|path| name_of(path));
    let mut page = Page::new(format!("Terrain from {} and {}", names[0], names[1]));
    page.lead(&pose.map_or_else(|| "There is no relative pose.".to_owned(), PoseRecord::sentence));
    for warning in &found.warnings {
        page.warning(&warning.to_string());
    }
    let unit = unit_of(found);
    page.key_numbers(key_numbers(made, pose, unit));
    page.section("Terrain").figures(&terrain(made, unit)?);
    page.figure(&central_profile(made, unit));
    if let Some(reference) = reference {
        page.section("Against the reference").paragraph(&residuals::sentence(reference));
        page.figure(&residuals::by_slope(reference)).table(&residuals::shares(reference)?);
    }
    if let (Some(used), Some([a, b])) = (found.shading.used(), shading.and_then(ShadingRecord::pictures)) {
        let section = shading::Section { used, records: [a, b], names: &names, found, made, options, unit };
        section.add_to(&mut page)?;
    }
    page.section("Points").points(&cloud(made, unit), "Every measured point");
    page.section("Hazards").figure(&hazards(made, unit)?).table(&hazard_table(made, unit)?);
    if let Some(text) = what_would_tell(made, unit) {
        page.paragraph(&text);
    }
    page.section("Pictures and matches");
    page.figure(&matches(pictures, found, [&names[0], &names[1]])?);
    page.section("Depth").figures(&depths(found)?);
    page.section("Pose, size and how this was made").table(&facts(found, made, pose)).list(&pictures.notes);
    if let Some(crs) = &made.summary.crs {
        page.listing("PROJ string of the maps", crs);
    }
    page.listing("run.toml", run_toml);
    Ok(page.finish())
}

/// How well the pose is known, how well the heights, and how much was measured.
fn key_numbers(made: &Products, pose: Option<&PoseRecord>, unit: &str) -> [(String, &'static str); 3] {
    let direction = pose.and_then(|pose| pose.direction_sigma_deg);
    let sigma = made.summary.sigma_median.filter(|sigma| sigma.is_finite());
    let unknown = || "not known".to_owned();
    [
        match (direction, pose) {
            (Some(sigma), _) => {
                (format!("± {}°", significant(sigma, 2)), "direction of the motion, one sigma")
            }
            (None, Some(_)) => (unknown(), "sigma of the motion: it was not estimated from matches"),
            (None, None) => ("none".to_owned(), "relative pose: the pictures do not tell one"),
        },
        match sigma {
            Some(sigma) => (
                format!("± {} {unit}", significant(sigma, 2)),
                "height of a cell, one sigma (median); the size's own error apart",
            ),
            None => (unknown(), "sigma of the heights: this method gives none"),
        },
        {
            let [a, b] = made.summary.measured;
            (
                format!("{} %", fixed(50.0 * (a + b), 0)),
                "of both pictures measured; the rest has no match or is completed",
            )
        },
    ]
}

/// What lengths are in.
fn unit_of(found: &Reconstruction) -> &'static str {
    match (found.placement.metric, &found.prediction.cam_b_from_cam_a) {
        (true, _) => "m",
        (false, Ok(_)) => "baselines",
        (false, Err(_)) => "units",
    }
}

/// Numbers in words; what an answer does not have is left out.
fn facts(found: &Reconstruction, made: &Products, pose: Option<&PoseRecord>) -> Table {
    let summary = &made.summary;
    let unit = format!(" {}", unit_of(found));
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let mut facts = vec![("metric", summary.metric.to_string()), ("size from", summary.scale_source.clone())];
    facts.extend(pose.into_iter().flat_map(pose_facts));
    facts.push((
        "one sigma of the size",
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
        frame_words(made)
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
        ("one sigma of the rotation", sigma(pose.rotation_sigma_deg)),
        ("one sigma of the direction of motion", sigma(pose.direction_sigma_deg)),
        ("baseline", format!("{}{unit}", significant(pose.baseline, 6))),
        ("residual of what agrees", format!("{:.3} px", pose.residual_px)),
        ("matches that one plane explains as well", plane_share),
    ]
}

/// Grey levels stretched between their darkest and brightest thousandth.
fn photo(image: &Raster<f32>) -> anyhow::Result<Picture> {
    let levels = image.data.iter().step_by((image.data.len() / 100_000).max(1)).map(|v| f64::from(*v));
    let [low, high] = statistics::quantiles(levels, [0.001, 0.999]).unwrap_or([0.0, 1.0]);
    Ok(Picture::photo(&shrunk(&Colormap::Grey.paint(image, low, high)))?)
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
        Ok(_) => "blue agree with the pose, orange do not",
        Err(_) => "no pose says which are right",
    };
    let (shown, all) = (lines.len(), found.matches.len());
    let caption = format!("{shown} of {all} matches; {judged}. Grey levels are stretched for looking.");
    let drawing = side_by_side(&photo_a, &photo_b, names, &lines, 520.0);
    Ok(Figure::with_lines_on_demand(drawing, &caption, "lines between matches"))
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

fn central_profile(made: &Products, unit: &str) -> Figure {
    let (heights, sigma) = (&made.dem.heights, &made.dem.sigma);
    let row = heights.height / 2;
    let distance: Vec<f64> = (0..heights.width).map(|x| x as f64 * made.dem.cell).collect();
    let values = |raster: &Raster<f32>| raster.row(row).iter().map(|v| f64::from(*v)).collect::<Vec<f64>>();
    let (prediction, sigma) = (values(heights), values(sigma));
    let fill = made.dem.fill.row(row).iter();
    let completed: Vec<bool> = fill.map(|fill| *fill == Fill::Completed).collect();
    let has_sigma = sigma.iter().any(|s| s.is_finite());
    let shown = Profile {
        distance: &distance,
        truth: None,
        prediction: &prediction,
        sigma: has_sigma.then_some(sigma.as_slice()),
        completed: Some(&completed),
    };
    let axes = [Axis::new(format!("distance ({unit})")), Axis::new(format!("height ({unit})"))];
    let [x, y] = axes;
    Figure::svg(
        profile("Central profile", x, y, &shown).size(1000.0, 300.0).svg(),
        "The middle row of the grid, from left to right.",
    )
}

/// In the colours of the pictures.
fn cloud(made: &Products, unit: &str) -> PointView {
    let points: Vec<Point> = made
        .cloud
        .points
        .iter()
        .map(|point| Point { position: point.position, grey: point.color[0], view: point.view + 1 })
        .collect();
    let axes = ["map x", "map y", "height"];
    let axes = if made.summary.crs.is_some() { axes } else { ["x", "y", "height"] };
    PointView::new(&points, [0.0, 0.0, 1.0]).described(unit, made.cloud.origin[2], axes)
}
