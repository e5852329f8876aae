//! The maps of a reconstruction: terrain, hazards, and what would make more of them tellable.

use crate::commands::figures::{HALF, shrunk};
use selenograph_raster::Raster;
use selenograph_raster::colormap::{ABSENT, Colormap};
use selenograph_raster::statistics;
use selenograph_reconstruct::grid::GridFrame;
use selenograph_reconstruct::hazard::Hazard;
use selenograph_reconstruct::products::Products;
use selenograph_report::color::{PREDICTION, Rgb};
use selenograph_report::figure::{ColorBar, Panel};
use selenograph_report::number::{fixed, significant};
use selenograph_report::{Column, Figure, Picture, Table};

/// Slopes from here on have the brightest colour, degrees.
const STEEP_DEG: f64 = 40.0;
/// The stripes over what cannot be told, and their period and width, pixels.
const STRIPES: (Rgb, usize, usize) = ([110, 118, 132], 8, 2);
/// A sigma of the slope that leaves most ground tellable, degrees.
const TELLING_SIGMA_DEG: f64 = 2.0;

/// The grid's coordinates in words, without the PROJ string.
pub fn frame_words(made: &Products) -> &str {
    let frame = &made.summary.frame;
    frame.split_once("; +proj").map_or(frame.as_str(), |(words, _)| words)
}

/// Direction of north in the grid's raster, clockwise from up, at its middle; `None` where the place is not known.
fn north_rad(made: &Products) -> Option<f64> {
    let GridFrame::Map { crs, .. } = &made.dem.frame else { return None };
    let heights = &made.dem.heights;
    let [x, y] = made.dem.map_from_pixel.apply(0.5 * heights.width as f64, 0.5 * heights.height as f64);
    let mut place = crs.projection.place_from_map(x, y)?;
    // Some 2 m on the Moon: straight in any map, and far above rounding.
    place.lat_rad += 1e-6;
    let [x_north, y_north] = crs.projection.map_from_place(&place)?;
    Some((x_north - x).atan2(y_north - y))
}

/// A panel of a map: with scale and north.
pub fn as_map(panel: Panel, made: &Products, unit: &str) -> Panel {
    let length = made.dem.ground_cell()[0] * made.dem.heights.width as f64;
    panel.width(HALF).scale_bar(length, unit).north(north_rad(made))
}

pub fn terrain(made: &Products, unit: &str) -> anyhow::Result<Vec<Figure>> {
    let shade = Picture::exact(&shrunk(&Colormap::Grey.paint(&made.hillshade, 0.0, 1.0)))?;
    let (width, height) = (shade.width as f64, shade.height as f64);
    let middle = 0.5 * height;
    let shade =
        as_map(Panel::new(shade, "Hillshade"), made, unit).line([0.0, middle], [width, middle], PREDICTION);
    let map = |panel: Panel| as_map(panel, made, unit).key(ABSENT, "no data");
    let heights = &made.dem.heights;
    let sampled = heights.data.iter().step_by(7).map(|h| f64::from(*h));
    let [low, high] = statistics::quantiles(sampled, [0.002, 0.998]).unwrap_or([0.0, 1.0]);
    let bar = ColorBar { map: Colormap::Viridis, low, high, label: format!("height ({unit})") };
    let heights = map(Panel::of_values(&shrunk(heights), "Heights", bar)?);
    let slope_deg = made.slope_rad.map(|slope| slope.to_degrees());
    let bar = ColorBar { map: Colormap::Inferno, low: 0.0, high: STEEP_DEG, label: "slope (°)".into() };
    let slope = map(Panel::of_values(&shrunk(&slope_deg), "Slope", bar)?);
    let mut figures = vec![
        Figure::svg(shade.svg(), "Lit from the upper left; the line is that of the profile below."),
        Figure::svg(heights.svg(), frame_words(made)),
        Figure::svg(slope.svg(), "By Horn's 3×3 kernel on the grid."),
    ];
    let sampled = made.dem.sigma.data.iter().step_by(7).map(|s| f64::from(*s));
    if let Some([high]) = statistics::quantiles(sampled, [0.98]) {
        let bar = ColorBar { map: Colormap::Inferno, low: 0.0, high, label: format!("sigma ({unit})") };
        let sigma = map(Panel::of_values(&shrunk(&made.dem.sigma), "Sigma of the heights", bar)?);
        figures.push(Figure::svg(
            sigma.svg(),
            "What the matching itself can tell; an error of the size is not in it.",
        ));
    }
    Ok(figures)
}

/// The classes in colours: what cannot be told is striped, what was not seen is blank.
pub fn hazards(made: &Products, unit: &str) -> anyhow::Result<Figure> {
    let (stripe, period, thickness) = STRIPES;
    let classes = shrunk(&made.hazard.classes);
    let heights = shrunk(&made.dem.heights);
    let picture = Raster::from_fn(classes.width, classes.height, |x, y| {
        let class = classes[(x, y)];
        match class {
            Hazard::Unknown if !heights[(x, y)].is_finite() => ABSENT,
            Hazard::Unknown if (x + y) % period < thickness => stripe,
            _ => class.color(),
        }
    });
    let mut panel = as_map(Panel::new(Picture::exact(&picture)?, "Hazards"), made, unit);
    for class in Hazard::ALL {
        let meaning = match class {
            Hazard::Unknown => format!("{} (striped): within its sigma of a limit", class.words()),
            _ => class.words().to_owned(),
        };
        panel = panel.key(class.color(), &meaning);
    }
    panel = panel.key(ABSENT, "no data: no height was measured");
    Ok(Figure::svg(panel.svg(), "Slope and roughness over the lander's footprint, against the limits below."))
}

pub fn hazard_table(made: &Products, unit: &str) -> anyhow::Result<Table> {
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

/// What would make the ground tellable that cannot be told; `None` where there is none, or sigma took no part.
pub fn what_would_tell(made: &Products, unit: &str) -> Option<String> {
    let hazard = &made.summary.hazard;
    let sigma = made.summary.sigma_median.filter(|_| hazard.sigma_aware && hazard.unknown > 0.0)?;
    // As the hazard map has it: two heights at opposite ends of the footprint, and the residuals of its cells.
    let slope_sigma_deg = (std::f64::consts::SQRT_2 * sigma / hazard.footprint).atan().to_degrees();
    let num_cells = (hazard.footprint / made.dem.ground_cell()[0]).round().powi(2);
    let roughness_sigma = sigma / (num_cells - 3.0).max(1.0).sqrt();
    let enough = std::f64::consts::SQRT_2 * sigma / TELLING_SIGMA_DEG.to_radians().tan();
    let mut text = format!(
        "{} % of the ground cannot be told: a height sigma of {} {unit} over a footprint of {} {unit} is a sigma of about {}° in slope and {} {unit} in roughness, and ground nearer than that to a limit is not judged.",
        fixed(100.0 * hazard.unknown, 0),
        significant(sigma, 2),
        significant(hazard.footprint, 3),
        significant(slope_sigma_deg, 2),
        significant(roughness_sigma, 2)
    );
    if enough > hazard.footprint {
        text += &format!(
            " What would tell more: a larger footprint (from --footprint-m {} on the slope is known to {TELLING_SIGMA_DEG}°), or views further apart: with twice the baseline sigma is about half.",
            significant(enough, 2)
        );
    }
    Some(text)
}
