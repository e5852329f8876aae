//! The demo's own pages: the story, and what it is about: the terrain and the dataset.

use anyhow::Context;
use selenograph_dataset::pair::{PairRecord, Trajectory};
use selenograph_dataset::stored::{self, ReadOptions};
use selenograph_evaluate::summary::{Overview, overview_table};
use selenograph_raster::codec::{Picture as Raw, png};
use selenograph_raster::colormap::{ABSENT, Colormap};
use selenograph_raster::dem::{DemReader, OpenOptions};
use selenograph_raster::{Raster, gradient, resample, statistics};
use selenograph_reconstruct::products::{ProductSummary, SUMMARY_NAME};
use selenograph_report::figure::{ColorBar, Panel};
use selenograph_report::number::{fixed, significant};
use selenograph_report::{Column, Figure, Page, Picture, Table};
use std::path::{Path, PathBuf};

/// Longest side of a map in a page, pixels.
const MAP_PX: usize = 800;
/// Width of one of two figures in a row, CSS pixels.
const HALF: f64 = 480.0;
/// Lamp of the hillshades: from the upper left, low as the Sun at the pole, degrees.
const LAMP_DEG: [f64; 2] = [315.0, 30.0];
/// Slopes from here on have the brightest colour, degrees.
const STEEP_DEG: f64 = 40.0;

/// Writes `report.html`, `terrain.html` and `dataset.html`.
///
/// # Errors
/// Products of the steps that cannot be read, a target that cannot be written.
pub fn write(folder: &Path, overview: &[Overview]) -> anyhow::Result<()> {
    let moon = Map::read(&folder.join("moon.tif"))?;
    let pairs = records(folder)?;
    for (name, page) in [
        ("terrain.html", terrain_page(&moon)?),
        ("dataset.html", dataset_page(folder, &pairs)?),
        ("report.html", front_page(folder, &moon, &pairs, overview)?),
    ] {
        selenograph_files::write(&folder.join(name), page)?;
    }
    Ok(())
}

/// Heights that fit into a page.
struct Map {
    heights: Raster<f32>,
    /// Side of a sample, metres.
    cell_m: f64,
    /// Side of a cell of the file, metres.
    file_cell_m: f64,
    /// Length of a row, metres.
    length_m: f64,
}

impl Map {
    fn read(path: &Path) -> anyhow::Result<Self> {
        let mut reader = DemReader::open(path, &OpenOptions::default())?;
        let [step, _] = reader.info().map_from_pixel.steps();
        let heights = reader.read_all()?;
        let factor = heights.width.max(heights.height).div_ceil(MAP_PX).max(1);
        let file_cell_m = step.abs();
        Ok(Self {
            length_m: file_cell_m * heights.width as f64,
            heights: resample::block_mean(&heights, factor),
            cell_m: file_cell_m * factor as f64,
            file_cell_m,
        })
    }

    fn gradient(&self) -> gradient::Gradient {
        gradient::horn(&self.heights, [self.cell_m; 2])
    }

    fn length_km(&self) -> String {
        format!("{} km", fixed(self.length_m / 1e3, 0))
    }

    fn ends_m(&self) -> [f64; 2] {
        let heights = self.heights.data.iter().map(|h| f64::from(*h));
        statistics::quantiles(heights, [0.0, 1.0]).unwrap_or([0.0, 1.0])
    }

    fn hillshade(&self, title: &str, caption: &str) -> anyhow::Result<Figure> {
        let [azimuth, elevation] = LAMP_DEG.map(f64::to_radians);
        let shade = Colormap::Grey.paint(&self.gradient().hillshade(azimuth, elevation), 0.0, 1.0);
        let panel = Panel::new(Picture::photo(&shade)?, title).width(HALF).scale_bar(self.length_m, "m");
        Ok(Figure::svg(panel.svg(), caption))
    }

    fn colored(&self, values: &Raster<f32>, title: &str, bar: ColorBar) -> anyhow::Result<Figure> {
        let panel = Panel::of_values(values, title, bar)?.width(HALF).scale_bar(self.length_m, "m");
        let has_gaps = values.data.iter().any(|value| !value.is_finite());
        let panel = if has_gaps { panel.key(ABSENT, "no data") } else { panel };
        Ok(Figure::svg(panel.svg(), ""))
    }

    fn colored_heights(&self) -> anyhow::Result<Figure> {
        let [low, high] = self.ends_m();
        let bar = ColorBar { map: Colormap::Viridis, low, high, label: "height (m)".into() };
        self.colored(&self.heights, "Heights", bar)
    }
}

/// The pairs, each with its folder.
fn records(folder: &Path) -> anyhow::Result<Vec<(PathBuf, PairRecord)>> {
    let pairs = stored::own(&folder.join("dataset"), ReadOptions::default())?;
    let opened = pairs.iter().map(|pair| -> anyhow::Result<_> {
        let record = pair.open()?.record.context("a pair of a dataset has a record")?;
        Ok((pair.place.path(""), record))
    });
    opened.collect()
}

fn picture(path: &Path) -> anyhow::Result<Picture> {
    let raster = match png::read(path)? {
        Raw::Rgb8(raster) => raster,
        Raw::Grey8(raster) => raster.map(|v| [*v; 3]),
        Raw::Grey16(raster) => raster.map(|v| [(v >> 8) as u8; 3]),
    };
    Ok(Picture::photo(&raster)?)
}

/// The story: a Moon, pictures of it, terrain from two of them, and how good it is.
fn front_page(
    folder: &Path,
    moon: &Map,
    pairs: &[(PathBuf, PairRecord)],
    overview: &[Overview],
) -> anyhow::Result<String> {
    let (place, first) = pairs.first().context("the dataset holds no pair")?;
    let found = Found::read(&folder.join("reconstruction"))?;
    let mut page = Page::new("A synthetic Moon, and what two pictures of it tell");
    page.lead("Two pictures from a camera that moved: how far did it move, and what is the ground like? Here the truth is known.");
    page.key_numbers(key_numbers(moon, pairs, &found, overview));
    page.section("1. A Moon is made").paragraph(&format!(
        "{} of ground round the pole with craters of all sizes, a height every {} m.",
        moon.length_km(),
        moon.file_cell_m
    ));
    page.figure(&moon.hillshade("The ground, lit from the upper left", "")?);
    page.links([("terrain.html", "more of the terrain: heights, slopes, numbers")]);
    page.section("2. A camera takes two pictures of it").paragraph(&format!(
        "The first pair: the camera moved by {} m; the Sun stands low. Every pixel's true distance is kept with them.",
        fixed(first.baseline_m, 0)
    ));
    let views = ["a", "b"].map(|view| picture(&place.join(format!("{view}.l0.png"))));
    let [a, b] = views;
    page.figures(&[
        Figure::picture(&a?, HALF as usize, "The first picture."),
        Figure::picture(&b?, HALF as usize, "The second picture."),
    ]);
    page.links([("dataset.html", "all pairs under all lights, with their truth")]);
    page.section("3. The pictures alone tell the terrain").paragraph(&format!(
        "Of the pictures, the lens and the distance moved, nothing else: {} matches give the motion, and then a height for {} % of the pixels.",
        found.num_matches,
        fixed(50.0 * (found.products.measured[0] + found.products.measured[1]), 0)
    ));
    let terrain = Map::read(&folder.join("reconstruction/dem.tif"))?;
    page.figures(&[terrain.hillshade("The ground as found", "Grey: no data.")?, terrain.colored_heights()?]);
    page.links([(
        "reconstruction/report.html",
        "all of it: pose, heights and their sigma, slopes, hazards, points to turn",
    )]);
    page.section("4. How good is it?").paragraph(
        "Every pair under every light against its truth; the truth itself and a plane show what the best and the dullest answer score.",
    );
    let (table, sentences) = overview_table(overview)?;
    page.table(&table).list(sentences);
    page.links([("evaluation/report.html", "the evaluation: worst pairs, plots, every table")]);
    Ok(page.finish())
}

/// What the reconstruction says of itself.
struct Found {
    products: ProductSummary,
    direction_sigma_deg: Option<f64>,
    num_matches: u64,
}

impl Found {
    fn read(folder: &Path) -> anyhow::Result<Self> {
        let text = |name: &str| {
            let path = folder.join(name);
            std::fs::read_to_string(&path).map_err(selenograph_files::Error::io("read", &path))
        };
        let record: serde_json::Value = serde_json::from_str(&text("reconstruction.json")?)?;
        let pose = &record["pose"];
        Ok(Self {
            products: serde_json::from_str(&text(SUMMARY_NAME)?)?,
            direction_sigma_deg: pose["direction_sigma_deg"].as_f64(),
            num_matches: pose["inliers"][0].as_u64().unwrap_or(0),
        })
    }
}

fn key_numbers(
    moon: &Map,
    pairs: &[(PathBuf, PairRecord)],
    found: &Found,
    overview: &[Overview],
) -> Vec<(String, &'static str)> {
    let num_pictures: usize = pairs.iter().map(|(_, record)| 2 * record.suns.len()).sum();
    let mut numbers = vec![
        (moon.length_km(), "of synthetic Moon, on a side"),
        (num_pictures.to_string(), "pictures of it, with exact truth"),
    ];
    numbers.extend(found.direction_sigma_deg.map(|sigma| {
        (format!("± {}°", significant(sigma, 2)), "direction of the camera's motion, one sigma")
    }));
    numbers.extend(
        found.products.sigma_median.map(|sigma| {
            (format!("± {} m", significant(sigma, 2)), "height of the ground, one sigma (median)")
        }),
    );
    let stereo = overview.iter().find(|row| row.name() == "stereo");
    numbers.extend(stereo.and_then(Overview::point_error_percent).map(|[error, _]| {
        (format!("{} %", significant(error, 2)), "of the distance: mean error of a point, all pairs")
    }));
    numbers
}

/// The terrain that was rendered.
fn terrain_page(moon: &Map) -> anyhow::Result<String> {
    let slopes_deg = moon.gradient().slope_rad().map(|slope| slope.to_degrees());
    let median = statistics::quantiles(slopes_deg.data.iter().map(|s| f64::from(*s)), [0.5, 0.95]);
    let [low, high] = moon.ends_m();
    let mut page = Page::new("The synthetic Moon of the demo");
    page.lead(
        "Craters of all sizes on rolling ground round the south pole; the same seed gives the same Moon.",
    );
    page.key_numbers([
        (moon.length_km(), "on a side"),
        (format!("{} m", fixed(high - low, 0)), "from the lowest to the highest place"),
        (
            median.map_or_else(|| "not known".into(), |[median, _]| format!("{}°", fixed(median, 1))),
            "median slope",
        ),
    ]);
    let bar = ColorBar { map: Colormap::Inferno, low: 0.0, high: STEEP_DEG, label: "slope (°)".into() };
    page.section("Maps").figures(&[
        moon.hillshade("Hillshade", "Lit from the upper left, 30° above the horizon.")?,
        moon.colored_heights()?,
        moon.colored(&slopes_deg, "Slope", bar)?,
    ]);
    page.paragraph(&format!(
        "Shown in cells of {} m; the files have {} m.",
        fixed(moon.cell_m, 0),
        moon.file_cell_m
    ));
    page.section("Files").links([
        ("moon.tif", "the heights, GeoTIFF"),
        ("terrain/", "the same as tiles for rendering"),
        ("report.html", "back to the story"),
    ]);
    Ok(page.finish())
}

/// The pairs, and the contact sheets.
fn dataset_page(folder: &Path, pairs: &[(PathBuf, PairRecord)]) -> anyhow::Result<String> {
    let mut page = Page::new("The stereo pairs of the demo");
    page.lead("Each pair under several lights, with the true pose, depth, slope and shadow of every pixel.");
    let columns = [Column::text("pair"), Column::text("trajectory")].into_iter();
    let numbers = ["baseline (m)", "B/H", "rotation (°)", "A seen by B (%)", "lights"].map(Column::number);
    let mut table = Table::new("", columns.chain(numbers));
    for (_, record) in pairs {
        table.row([
            format!("{:06}", record.pair_id),
            record.trajectory.map_or("", Trajectory::as_str).to_owned(),
            fixed(record.baseline_m, 0),
            significant(record.baseline_over_height, 2),
            significant(record.relative_rotation_deg, 3),
            fixed(100.0 * record.overlap.a_seen_by_b, 0),
            record.suns.len().to_string(),
        ])?;
    }
    page.section("Pairs").table(&table);
    page.section("Pictures").paragraph(
        "Each row is a pair: view A and B under each light, their depth (near dark, far bright), slope, and which lights reach the ground (white: all).",
    );
    for number in 0.. {
        let path = folder.join(format!("sheets/sheet_{number:03}.png"));
        if !path.is_file() {
            break;
        }
        let sheet = picture(&path)?;
        page.figure(&Figure::picture(&sheet, sheet.width, ""));
    }
    page.section("Files").links([("dataset/", "pictures and truth"), ("report.html", "back to the story")]);
    Ok(page.finish())
}
