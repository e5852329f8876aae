//! The paper's figures of an item: methods side by side, depth in viridis, slope in heat, hillshaded pointmaps, clouds in orange
//! and blue, a profile with the truth in blue and the prediction in orange, and their difference below it; completed ground is striped.

mod cloud;
mod maps;

use crate::Error;
use crate::aligned::{AlignedPair, Answers};
use crate::dataset_source::{LoadedPair, Source};
use crate::method::network::{Network, Session};
use crate::method::{Item, Lighting, Method};
use crate::pair_metrics::{self, PreparedTruth, Region};
use maps::Maps;
use selenograph_raster::codec::png;
use selenograph_raster::colormap::Colormap;
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::{Fill, pipeline};
use selenograph_report::chart::{Profile, profile, residual};
use selenograph_report::figure::{ColorBar, Grid};
use selenograph_report::{Axis, Figure, Picture};
use std::path::Path;

/// Width of a picture in the grid, CSS pixels.
const CELL_PX: f64 = 240.0;

/// One method's answer to an item, ready to be drawn.
struct Drawn {
    name: &'static str,
    maps: Maps,
    cloud: Option<Raster<[u8; 3]>>,
    /// Where view A's ground was measured and where completed; absent for the truth.
    fill: Option<Raster<Fill>>,
}

/// The figures of one item.
#[derive(Debug)]
pub struct ItemFigures {
    /// What the item is, for the caption.
    pub name: String,
    /// Views, truth and every method with points: depth, slope, hillshade, clouds.
    pub grid: String,
    /// The central profile of each method with points, and below it how far it is off.
    pub profiles: Vec<(&'static str, [String; 2])>,
    /// Every picture of the grid, by name, for files.
    pictures: Vec<(String, Raster<[u8; 3]>)>,
}

impl ItemFigures {
    /// Runs the methods on an item once more and draws what they say; pose-only methods have nothing to draw.
    ///
    /// # Errors
    /// Those of reading the pair, of a method, and of encoding pictures.
    pub fn draw(
        source: &Source,
        methods: &[Method],
        network: Option<&Network>,
        options: &pipeline::Options,
        pair_name: &str,
        lights: [u64; 2],
    ) -> Result<Option<Self>, Error> {
        let Some(entry) = source.entries.iter().find(|entry| entry.name == pair_name) else {
            return Ok(None);
        };
        let pair = LoadedPair::read(entry, &source.pixels)?;
        let Some(views) = pair.views(lights) else { return Ok(None) };
        let settings = pair_metrics::Settings::default();
        let prepared = PreparedTruth::new(&pair.truth, &settings)?;
        let session = network.map(Session::new);
        let mut drawn = vec![Drawn::of_truth(&prepared)];
        for method in methods.iter().filter(|method| **method != Method::Truth) {
            let lighting = Lighting::of(&pair, lights);
            let item = Item {
                views: &views,
                lights,
                lighting,
                options,
                truth: prepared.truth(),
                network: session.as_ref(),
            };
            let answer = method.answer(&item)?;
            if let Some(Ok(aligned)) = prepared.align(&answer.prediction, Region::Overlap)? {
                let answers = Answers::of_prediction(&answer.prediction, prepared.truth())?;
                let fill = answers.map(|[a, _]| a.fill);
                drawn.push(Drawn { fill, ..Drawn::of_answer(method.as_str(), &aligned, &prepared) });
            }
        }
        let grey = views.map(|view| maps::grey(&view.image));
        assemble(format!("{pair_name}, lights {} and {}", lights[0], lights[1]), &drawn, grey).map(Some)
    }

    /// Writes the figures as files: `grid.svg`, `profile_<method>.svg`, and every picture as PNG.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Raster`] if that is refused.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        std::fs::create_dir_all(folder).map_err(Error::io("make", folder))?;
        let write = |name: &str, bytes: &[u8]| selenograph_files::write(&folder.join(name), bytes);
        write("grid.svg", self.grid.as_bytes())?;
        for (method, [profile, residual]) in &self.profiles {
            write(&format!("profile_{method}.svg"), profile.as_bytes())?;
            write(&format!("residual_{method}.svg"), residual.as_bytes())?;
        }
        for (name, picture) in &self.pictures {
            write(&format!("{name}.png"), &png::encode_rgb8(picture)?)?;
        }
        Ok(())
    }

    /// For a page.
    pub fn page(&self) -> Vec<Figure> {
        let grid = Figure::svg(
            self.grid.clone(),
            &format!(
                "{}. Hillshade of the points under a lamp at the upper left; the cloud has view A in orange, view B in blue. Striped: completed, not measured; grey: no answer.",
                self.name
            ),
        );
        let profiles = self.profiles.iter().map(|(method, svgs)| {
            Figure::svg(
                svgs.concat(),
                &format!("Central row of view A, {method}: world Z, truth in blue, prediction in orange, dashed where it is completed; below it their difference."),
            )
        });
        std::iter::once(grid).chain(profiles).collect()
    }
}

impl Drawn {
    fn of_truth(prepared: &PreparedTruth) -> Self {
        let points = prepared.points_in_cam_a();
        let aligned = AlignedPair { alignment: None, points_in_cam_a: points.clone() };
        Self::of_answer("truth", &aligned, prepared)
    }

    fn of_answer(name: &'static str, aligned: &AlignedPair, prepared: &PreparedTruth) -> Self {
        let world_from_cam_a = prepared.truth().world_from_cam_a();
        Self {
            name,
            maps: Maps::new(aligned, prepared.truth()),
            cloud: cloud::picture(&aligned.points_in_cam_a, &world_from_cam_a),
            fill: None,
        }
    }

    fn striped(&self, picture: Raster<[u8; 3]>) -> Raster<[u8; 3]> {
        match &self.fill {
            Some(fill) => maps::striped(&picture, fill),
            None => picture,
        }
    }

    /// Where the central row was completed.
    fn completed_in_profile(&self) -> Option<Vec<bool>> {
        let fill = self.fill.as_ref().filter(|fill| fill.height > 0)?;
        Some(fill.row(fill.height / 2).iter().map(|fill| *fill == Fill::Completed).collect())
    }
}

/// Half as large, for pages of many pictures; small pictures stay.
fn halved(picture: &Raster<[u8; 3]>) -> Raster<[u8; 3]> {
    if picture.width.min(picture.height) < 2 * CELL_PX as usize {
        return picture.clone();
    }
    Raster::from_fn(picture.width / 2, picture.height / 2, |x, y| {
        std::array::from_fn(|channel| {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)];
            let sum: u32 =
                four.iter().map(|(dx, dy)| u32::from(picture[(2 * x + dx, 2 * y + dy)][channel])).sum();
            ((sum + 2) / 4) as u8
        })
    })
}

fn assemble(
    name: String,
    drawn: &[Drawn],
    [grey_a, grey_b]: [Raster<[u8; 3]>; 2],
) -> Result<ItemFigures, Error> {
    let mut grid = Grid::new(std::iter::once("view").chain(drawn.iter().map(|d| d.name)), CELL_PX);
    let mut pictures = vec![("view_a".to_owned(), grey_a), ("view_b".to_owned(), grey_b)];
    // The truth sets the scale of every method's colours.
    let range = drawn.first().map_or([0.0, 1.0], |truth| truth.maps.depth_range_m());
    let bar = |map, [low, high]: [f64; 2], label: &str| ColorBar { map, low, high, label: label.into() };
    let bars = [
        Some(bar(Colormap::Viridis, range.map(|z| z / 1e3), "z-depth (km)")),
        Some(bar(Colormap::Inferno, [0.0, maps::MAX_SLOPE_DEG], "slope (°)")),
        None,
        None,
    ];
    for ((k, title), bar) in ["depth", "slope", "hillshade", "cloud"].into_iter().enumerate().zip(bars) {
        let mut cells = Vec::new();
        // Below the two views the first column is blank.
        if k < 2 {
            cells.push(Some(Picture::photo(&halved(&pictures[k].1))?));
        }
        let first = 1 - cells.len();
        for one in drawn {
            let picture = match k {
                0 => Some(one.striped(one.maps.depth_picture(range))),
                1 => Some(one.striped(one.maps.slope_picture())),
                2 => Some(one.striped(one.maps.hillshade_picture())),
                _ => one.cloud.clone(),
            };
            cells.push(picture.as_ref().map(|picture| Picture::exact(&halved(picture))).transpose()?);
            pictures.extend(picture.map(|picture| (format!("{title}_{}", one.name), picture)));
        }
        grid.row_from(first, title, cells, bar);
    }
    let truth = drawn.first().map(|d| d.maps.profile_m()).unwrap_or_default();
    // One offset for both curves: a biased prediction shows its bias.
    let mean = statistics::summary(truth.iter().copied()).map_or(0.0, |summary| summary.mean);
    let over_mean = |profile: Vec<f64>| profile.into_iter().map(|z| z - mean).collect::<Vec<_>>();
    let truth = over_mean(truth);
    let columns: Vec<f64> = (0..truth.len()).map(|x| x as f64).collect();
    let profiles = drawn.iter().skip(1).map(|d| {
        let prediction = over_mean(d.maps.profile_m());
        let completed = d.completed_in_profile();
        let shown = Profile {
            distance: &columns,
            truth: Some(&truth),
            prediction: &prediction,
            completed: completed.as_deref(),
            ..Profile::default()
        };
        let (x, title) = (|| Axis::new("column (px)"), format!("Central row, {}", d.name));
        let chart = profile(&title, x(), Axis::new("world Z over the true mean (m)"), &shown);
        let off = residual(x(), Axis::new("off (m)"), &shown);
        (d.name, [chart.svg(), off.map(|chart| chart.svg()).unwrap_or_default()])
    });
    Ok(ItemFigures { name, grid: grid.svg(), profiles: profiles.collect(), pictures })
}
