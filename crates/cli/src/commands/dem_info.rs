//! `dem info`: what a file is, where it lies, how high and how steep.

use super::reading::open;
use super::terrain_info;
use crate::args::dem::Info;
use crate::exit::Outcome;
use crate::ui::Ui;
use selenograph_geometry::{Projection, proj_string, units};
use selenograph_raster::dem::{DemInfo, DemReader};
use selenograph_raster::{Raster, gradient};
use serde::Serialize;
use std::path::Path;

/// Rows read at a time; the size of a cell is looked up once for each band, since on some maps it changes with latitude.
const BAND_ROWS: usize = 16;
/// Steps of the slope histogram per degree: quantiles are good to half a hundredth of a degree.
const BINS_PER_DEG: usize = 100;
/// Points along each side of the lattice on which the extent in latitude and longitude is looked up.
const EXTENT_LATTICE: usize = 33;

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    file: &'a DemInfo,
    projection: &'static str,
    extent_map: ExtentMap,
    #[serde(skip_serializing_if = "Option::is_none")]
    extent_deg: Option<ExtentDeg>,
    cell_m: Option<[f64; 2]>,
    height_m: Heights,
    absent_share: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    slope_deg: Option<Slopes>,
}

#[derive(Serialize)]
struct ExtentMap {
    x_min: f64,
    x_max: f64,
    y_min: f64,
    y_max: f64,
    unit: &'static str,
}

#[derive(Serialize)]
struct ExtentDeg {
    lat_min: f64,
    lat_max: f64,
    lon_min: f64,
    lon_max: f64,
}

#[derive(Serialize, Default)]
struct Heights {
    min: f64,
    mean: f64,
    max: f64,
}

#[derive(Serialize)]
struct Slopes {
    median: f64,
    p95: f64,
}

/// Reports on each file.
///
/// # Errors
/// The first file that cannot be read.
pub fn run(args: &Info, ui: &Ui) -> anyhow::Result<Outcome> {
    let mut reports = Vec::new();
    for path in &args.files {
        if path.is_dir() {
            let description = terrain_info::describe(path, args.verify, ui)?;
            if ui.json {
                reports.push(serde_json::to_value(&description)?);
            } else {
                ui.data(&terrain_info::text(path, &description))?;
            }
            continue;
        }
        let mut reader = open(path, &args.reading)?;
        let survey = Survey::of(&mut reader, ui)?;
        let info = reader.info();
        let report = report(info, &survey);
        if ui.json {
            reports.push(serde_json::to_value(&report)?);
        } else {
            ui.data(&text(path, &report))?;
        }
    }
    if ui.json {
        ui.data_json(&reports)?;
    }
    Ok(Outcome::Done)
}

/// One pass over all rows.
struct Survey {
    num_valid: u64,
    num_absent: u64,
    sum: f64,
    min: f32,
    max: f32,
    slopes: Vec<u64>,
}

impl Survey {
    fn of(reader: &mut DemReader, ui: &Ui) -> anyhow::Result<Self> {
        let (width, height) = (reader.info().width, reader.info().height);
        let mut survey = Self {
            num_valid: 0,
            num_absent: 0,
            sum: 0.0,
            min: f32::INFINITY,
            max: f32::NEG_INFINITY,
            slopes: vec![0; 90 * BINS_PER_DEG],
        };
        let bar = ui.bar(height as u64, "rows");
        // Two rows of the band before stay in front, so that slopes are found across the seam.
        let mut rows: Vec<f32> = Vec::new();
        let mut band = Vec::new();
        for first in (0..height).step_by(BAND_ROWS) {
            let count = BAND_ROWS.min(height - first);
            reader.read_rows(first, count, &mut band)?;
            survey.add_heights(&band);
            rows.drain(..rows.len().saturating_sub(2 * width));
            rows.extend_from_slice(&band);
            if let Some(cell_m) = cell_m(reader.info(), first as f64 + count as f64 / 2.0) {
                let raster = Raster::new(width, rows.len() / width, std::mem::take(&mut rows))?;
                survey.add_slopes(&gradient::horn(&raster, cell_m).slope_rad());
                rows = raster.data;
            }
            bar.inc(count as u64);
        }
        bar.finish_and_clear();
        Ok(survey)
    }

    fn add_heights(&mut self, heights: &[f32]) {
        for &height in heights {
            if height.is_finite() {
                self.num_valid += 1;
                self.sum += f64::from(height);
                self.min = self.min.min(height);
                self.max = self.max.max(height);
            } else {
                self.num_absent += 1;
            }
        }
    }

    fn add_slopes(&mut self, slopes: &Raster<f32>) {
        for slope in slopes.data.iter().filter(|slope| slope.is_finite()) {
            let bin = (slope.to_degrees() * BINS_PER_DEG as f32) as usize;
            self.slopes[bin.min(90 * BINS_PER_DEG - 1)] += 1;
        }
    }

    fn slope_quantile_deg(&self, fraction: f64) -> Option<f64> {
        let total: u64 = self.slopes.iter().sum();
        let wanted = (total as f64 * fraction) as u64;
        let mut below = 0;
        let bin = self.slopes.iter().position(|count| {
            below += count;
            below > wanted
        })?;
        Some((bin as f64 + 0.5) / BINS_PER_DEG as f64)
    }
}

/// Metres on the ground per pixel across and down at a row; `None` off the map.
fn cell_m(info: &DemInfo, row: f64) -> Option<[f64; 2]> {
    let [x, y] = info.map_from_pixel.apply(info.width as f64 / 2.0, row);
    let ground = info.crs.projection.ground_m_per_unit(x, y, info.crs.body.radius_m)?;
    let [step_x, step_y] = info.map_from_pixel.steps();
    Some([step_x * ground[0], step_y * ground[1]])
}

fn report<'a>(info: &'a DemInfo, survey: &Survey) -> Report<'a> {
    let total = survey.num_valid + survey.num_absent;
    let height_m = if survey.num_valid == 0 {
        Heights::default()
    } else {
        let mean = survey.sum / survey.num_valid as f64;
        Heights { min: survey.min.into(), mean, max: survey.max.into() }
    };
    let slope = |fraction| survey.slope_quantile_deg(fraction);
    Report {
        file: info,
        projection: info.crs.projection.name(),
        extent_map: extent_map(info),
        extent_deg: extent_deg(info),
        cell_m: cell_m(info, info.height as f64 / 2.0),
        height_m,
        absent_share: survey.num_absent as f64 / total.max(1) as f64,
        slope_deg: slope(0.5).zip(slope(0.95)).map(|(median, p95)| Slopes { median, p95 }),
    }
}

fn corners(info: &DemInfo) -> [[f64; 2]; 4] {
    let (w, h) = (info.width as f64, info.height as f64);
    [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h]].map(|[c, r]| info.map_from_pixel.apply(c, r))
}

fn extent_map(info: &DemInfo) -> ExtentMap {
    let corners = corners(info);
    let fold = |axis: usize, pick: fn(f64, f64) -> f64| {
        corners.iter().map(|corner| corner[axis]).reduce(pick).unwrap_or(f64::NAN)
    };
    let degrees = matches!(info.crs.projection, Projection::Geographic { .. });
    ExtentMap {
        x_min: fold(0, f64::min),
        x_max: fold(0, f64::max),
        y_min: fold(1, f64::min),
        y_max: fold(1, f64::max),
        unit: if degrees { "deg" } else { "m" },
    }
}

/// Latitudes and longitudes covered, from a lattice over the map; longitudes as the arc that leaves the largest gap out.
fn extent_deg(info: &DemInfo) -> Option<ExtentDeg> {
    let (w, h) = (info.width as f64, info.height as f64);
    let step = 1.0 / (EXTENT_LATTICE - 1) as f64;
    let (mut lats, mut lons) = (Vec::new(), Vec::new());
    for i in 0..EXTENT_LATTICE {
        for j in 0..EXTENT_LATTICE {
            let [x, y] = info.map_from_pixel.apply(w * i as f64 * step, h * j as f64 * step);
            if let Some(place) = info.crs.projection.place_from_map(x, y) {
                lats.push(place.lat_rad.to_degrees());
                lons.push(units::wrap_360_deg(place.lon_rad.to_degrees()));
            }
        }
    }
    if lats.is_empty() {
        return None;
    }
    let inverse = info.map_from_pixel.inverse().ok()?;
    for (pole_lat, sign) in [(90.0, 1.0), (-90.0, -1.0)] {
        let pole = selenograph_geometry::Point3::new(0.0, 0.0, sign);
        let inside = info.crs.projection.map_from_point(&pole).is_some_and(|[x, y]| {
            let [c, r] = inverse.apply(x, y);
            (0.0..=w).contains(&c) && (0.0..=h).contains(&r)
        });
        if inside {
            lats.push(pole_lat);
        }
    }
    let (lon_min, lon_max) = arc(lons);
    Some(ExtentDeg {
        lat_min: lats.iter().copied().fold(f64::INFINITY, f64::min),
        lat_max: lats.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        lon_min,
        lon_max,
    })
}

/// The shortest arc that holds all longitudes: it begins after the widest gap.
fn arc(mut lons: Vec<f64>) -> (f64, f64) {
    lons.sort_by(f64::total_cmp);
    let (Some(&first), Some(&last)) = (lons.first(), lons.last()) else { return (0.0, 360.0) };
    let around = first + 360.0 - last;
    let widest =
        lons.windows(2).map(|pair| (pair[1] - pair[0], pair[1], pair[0])).max_by(|a, b| a.0.total_cmp(&b.0));
    match widest {
        // A lattice of 33 points round a circle leaves gaps of 11°: below twice that it is the whole circle.
        Some((gap, ..)) if gap.max(around) < 22.0 => (0.0, 360.0),
        Some((gap, start, end)) if gap > around => (start, end + 360.0),
        _ => (first, last),
    }
}

fn text(path: &Path, report: &Report<'_>) -> String {
    let info = report.file;
    let mut lines = vec![format!("{}", path.display())];
    let mut line = |name: &str, value: String| lines.push(format!("  {name:<12} {value}"));
    line("format", format!("{}, {}, {}", word(info.format), word(info.sample_type), info.storage));
    line(
        "size",
        format!("{} × {} pixels, band {} of {}", info.width, info.height, info.band, info.num_bands),
    );
    line("body", format!("{}, sphere of {} m", info.crs.body.name, info.crs.body.radius_m));
    line("map", format!("{}: {}", report.projection, proj_string::format(&info.crs)));
    let map = &report.extent_map;
    line(
        "extent",
        format!(
            "x {:.3} .. {:.3}, y {:.3} .. {:.3} {}",
            map.x_min, map.x_max, map.y_min, map.y_max, map.unit
        ),
    );
    if let Some(place) = &report.extent_deg {
        let (lat, lon) = ((place.lat_min, place.lat_max), (place.lon_min, place.lon_max));
        line(
            "place",
            format!("latitude {:.4} .. {:.4}°, east longitude {:.4} .. {:.4}°", lat.0, lat.1, lon.0, lon.1),
        );
    }
    if let Some([across, down]) = report.cell_m {
        line("cell", format!("{across:.3} × {down:.3} m on the ground in the middle"));
    }
    let h = &report.height_m;
    line("height", format!("{:.2} .. {:.2} m above the sphere, mean {:.2}", h.min, h.max, h.mean));
    line("absent", format!("{:.4} %", 100.0 * report.absent_share));
    if let Some(slope) = &report.slope_deg {
        line("slope", format!("median {:.2}°, 95 % below {:.2}°", slope.median, slope.p95));
    }
    if info.num_bands > 1 {
        lines.push(format!(
            "  {:<12} the file has {} bands: --band N reads another one",
            "note", info.num_bands
        ));
    }
    for note in &info.notes {
        lines.push(format!("  {:<12} {note}", "note"));
    }
    lines.join("\n")
}

/// The name that a closed set's member has in JSON.
fn word(member: impl Serialize) -> String {
    match serde_json::to_value(member) {
        Ok(serde_json::Value::String(name)) => name,
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::arc;

    #[test]
    fn the_arc_of_longitudes_passes_zero_where_it_must() {
        assert_eq!(arc(vec![350.0, 355.0, 5.0, 10.0]), (350.0, 370.0));
        assert_eq!(arc(vec![20.0, 30.0]), (20.0, 30.0));
        assert_eq!(arc((0..36).map(|k| f64::from(k) * 10.0).collect()), (0.0, 360.0));
    }
}
