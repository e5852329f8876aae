//! Contact sheets: the pictures, depth, slope and shadow of many pairs on a page, for looking.

use crate::Error;
use crate::font;
use crate::pair::Trajectory;
use crate::stored::{self, ReadOptions, StereoPair, StereoView, StoredPair};
use selenograph_geometry::{Point3, Vector3, pixel};
use selenograph_raster::codec::png;
use selenograph_raster::colormap::Colormap;
use selenograph_raster::{Raster, resample, statistics};
use std::path::{Path, PathBuf};

/// What a sheet looks like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SheetOptions {
    /// Side of a thumbnail, pixels.
    pub thumbnail_px: usize,
    /// Pairs under each other on a page.
    pub pairs_per_page: usize,
    /// At most this many pairs, evenly out of the folder.
    pub max_pairs: usize,
}

impl Default for SheetOptions {
    fn default() -> Self {
        Self { thumbnail_px: 144, pairs_per_page: 8, max_pairs: 64 }
    }
}

/// Slope at the hot end of its colours, degrees.
const MAX_SLOPE_DEG: f64 = 40.0;
const MARGIN_PX: usize = 4;
/// Width at which a sheet is looked at in a page or on a screen, pixels, and the least height of its letters there.
const SHOWN_PX: f64 = 1100.0;
const LETTER_PX: f64 = 9.0;
/// Height of the font's letters, pixels.
const FONT_PX: f64 = 7.0;
const PAPER: [u8; 3] = [24, 24, 28];
const INK: [u8; 3] = [230, 230, 230];

/// One pair with the text above it.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// What is written above.
    pub label: String,
    /// The pair.
    pub pair: StereoPair,
}

/// Writes the pages `sheet_000.png`, … into a folder that exists, from a dataset of ours or from triplets, and
/// returns their paths and what could not be shown.
///
/// # Errors
/// [`Error::Io`] and [`Error::Raster`] in writing, [`Error::Format`] if the folder has no pairs.
pub fn write(
    folder: &Path,
    out: &Path,
    options: &SheetOptions,
) -> Result<(Vec<PathBuf>, Vec<String>), Error> {
    let pairs = chosen(stored::find(folder, ReadOptions::default())?, options.max_pairs.max(1));
    if pairs.is_empty() {
        return Err(Error::Format {
            path: folder.to_owned(),
            expected: "pairs of a dataset or triplets".to_owned(),
            found: "neither".to_owned(),
        });
    }
    let (mut paths, mut skipped) = (Vec::new(), Vec::new());
    for group in pairs.chunks(options.pairs_per_page.max(1)) {
        let mut entries = Vec::new();
        for pair in group {
            match load(pair) {
                Ok(entry) => entries.push(entry),
                Err(error) => skipped.push(error.to_string()),
            }
        }
        if entries.is_empty() {
            continue;
        }
        let path = out.join(format!("sheet_{:03}.png", paths.len()));
        let bytes = png::encode_rgb8(&page(&entries, options.thumbnail_px))?;
        selenograph_files::write(&path, bytes)?;
        paths.push(path);
    }
    Ok((paths, skipped))
}

/// At most `count` of a list, evenly spaced.
fn chosen<T>(list: Vec<T>, count: usize) -> Vec<T> {
    let total = list.len();
    let keep = |idx: usize| total <= count || (idx * count) / total != ((idx + 1) * count) / total;
    list.into_iter().enumerate().filter(|(idx, _)| keep(*idx)).map(|(_, item)| item).collect()
}

fn load(stored: &StoredPair) -> Result<Entry, Error> {
    let open = stored.open()?;
    let pair = open.stereo()?;
    let label = match &open.record {
        Some(record) => format!(
            "{:06} {}  B/H {:.2}  rot {:.0}°  overlap {:.2}/{:.2}",
            record.pair_id,
            record.trajectory.map_or("", Trajectory::as_str),
            record.baseline_over_height,
            record.relative_rotation_deg,
            record.overlap.a_in_b,
            record.overlap.b_in_a
        ),
        None => format!("{}/{}", stored.place.name(), pair.views[0].name),
    };
    Ok(Entry { label, pair })
}

/// One page: the column names, wrapped to their columns, then for each pair the two lines of its label and a row of thumbnails. The
/// letters are as large as the page at its usual width needs; a page is never narrower than its labels.
pub fn page(entries: &[Entry], thumbnail_px: usize) -> Raster<[u8; 3]> {
    let rows: Vec<Vec<(String, Raster<[u8; 3]>)>> =
        entries.iter().map(|entry| thumbnails(&entry.pair, thumbnail_px)).collect();
    let num_columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = MARGIN_PX + num_columns * (thumbnail_px + MARGIN_PX);
    let zoom = (LETTER_PX / FONT_PX * width as f64 / SHOWN_PX).ceil().max(1.0) as usize;
    let line_px = zoom * font::LINE_PX;
    let labels: Vec<[String; 2]> =
        entries.iter().map(|entry| [entry.label.clone(), ranges_of(entry)]).collect();
    let longest = labels.iter().flatten().map(|line| line.chars().count()).max().unwrap_or(0);
    let width = width.max(2 * MARGIN_PX + longest * zoom * font::ADVANCE_PX);
    let num_letters = (thumbnail_px / (zoom * font::ADVANCE_PX)).max(1);
    let heads: Vec<Vec<String>> = rows
        .first()
        .map_or_else(Vec::new, |row| row.iter().map(|(name, _)| wrapped(name, num_letters)).collect());
    let head_px = heads.iter().map(Vec::len).max().unwrap_or(0) * line_px + 2 * MARGIN_PX;
    let row_px = thumbnail_px + 2 * line_px + 2 * MARGIN_PX;
    let mut page = Raster::filled(width, head_px + rows.len() * row_px + MARGIN_PX, PAPER);
    let left = |column: usize| MARGIN_PX + column * (thumbnail_px + MARGIN_PX);
    for (column, head) in heads.iter().enumerate() {
        for (k, line) in head.iter().enumerate() {
            font::write(&mut page, [left(column), MARGIN_PX / 2 + k * line_px], line, zoom, INK);
        }
    }
    for (row_idx, (label, row)) in labels.iter().zip(&rows).enumerate() {
        let top = head_px + row_idx * row_px;
        for (k, line) in label.iter().enumerate() {
            font::write(&mut page, [MARGIN_PX, top + k * line_px], line, zoom, INK);
        }
        for (column, (_, picture)) in row.iter().enumerate() {
            paste(&mut page, picture, left(column), top + 2 * line_px + MARGIN_PX);
        }
    }
    page
}

/// The lines of a name where they fit, else a line for each of its words, the ends of long words left out.
fn wrapped(name: &str, num_letters: usize) -> Vec<String> {
    let fits = |line: &str| line.chars().count() <= num_letters;
    if name.lines().all(fits) {
        return name.lines().map(str::to_owned).collect();
    }
    name.split_whitespace().map(|word| word.chars().take(num_letters).collect()).collect()
}

/// How far the ground is, and how fine it is seen.
fn ranges_of(entry: &Entry) -> String {
    let range = |view: &StereoView| {
        let depths = view.depth_z.data.iter().map(|&z| f64::from(z));
        statistics::summary(depths).map_or("no depth".to_owned(), |range_of_z| {
            format!(
                "{:.1}-{:.1} km {:.1} m/px",
                range_of_z.min / 1e3,
                range_of_z.max / 1e3,
                view.camera.gsd_m(range_of_z.mean)
            )
        })
    };
    let [a, b] = &entry.pair.views;
    format!("A {}   B {}", range(a), range(b))
}

fn paste(page: &mut Raster<[u8; 3]>, picture: &Raster<[u8; 3]>, left: usize, top: usize) {
    for (y, row) in picture.rows().enumerate() {
        page.row_mut(top + y)[left..left + picture.width].copy_from_slice(row);
    }
}

/// Pictures A and B under each light, then depth, slope and, where known, which lights reach the ground.
fn thumbnails(pair: &StereoPair, side: usize) -> Vec<(String, Raster<[u8; 3]>)> {
    let [a, b] = &pair.views;
    let both = || [(a, "A"), (b, "B")];
    let mut row = Vec::new();
    for light_idx in 0..a.images.len().min(b.images.len()) {
        for (view, letter) in both() {
            let levels = view.images[light_idx].map(|&level| f32::from(level));
            let small = fitted(&levels, side);
            row.push((format!("{letter}\nlight {light_idx}"), Colormap::Grey.paint(&small, 0.0, 255.0)));
        }
    }
    for (view, letter) in both() {
        // Each view by itself: beside a far one, a near one would be a single colour.
        let depths = view.depth_z.data.iter().map(|&z| f64::from(z));
        let [near, far] = statistics::quantiles(depths, [0.005, 0.995]).unwrap_or([0.0, 1.0]);
        let small = fitted(&view.depth_z, side);
        row.push((format!("{letter}\ndepth"), Colormap::Viridis.paint(&small, near, far)));
    }
    for (view, letter) in both() {
        let slope = view.slope_rad.clone().unwrap_or_else(|| slope_from_depth(view));
        let small = fitted(&slope, side);
        let painted = Colormap::Inferno.paint(&small, 0.0, MAX_SLOPE_DEG.to_radians());
        row.push((format!("{letter} slope\n0-{MAX_SLOPE_DEG:.0}°"), painted));
    }
    for (view, letter) in both().into_iter().filter(|(view, _)| !view.lit.is_empty()) {
        row.push((format!("{letter} lit\nby 012"), lights_as_rgb(view, side)));
    }
    row
}

/// Scaled to fit into a square, its shape kept.
fn fitted(raster: &Raster<f32>, side: usize) -> Raster<f32> {
    let longer = raster.width.max(raster.height).max(1);
    let scaled = |pixels: usize| (pixels * side / longer).max(1);
    resample::area_mean(raster, scaled(raster.width), scaled(raster.height))
}

/// The masks of the first three lights as red, green and blue: white ground is lit by all, black by none. A single
/// light gives grey.
fn lights_as_rgb(view: &StereoView, side: usize) -> Raster<[u8; 3]> {
    let masks: Vec<Raster<f32>> = view
        .lit
        .iter()
        .take(3)
        .map(|mask| fitted(&mask.map(|&lit| f32::from(u8::from(lit > 0))), side))
        .collect();
    let first = &masks[0];
    Raster::from_fn(first.width, first.height, |x, y| {
        std::array::from_fn(|channel| {
            let mask = masks.get(channel).unwrap_or(if masks.len() == 1 { first } else { &masks[1] });
            (mask[(x, y)] * 255.0).round() as u8
        })
    })
}

/// Slope of the ground that a depth shows: the normal by central differences of its points, against the vertical.
fn slope_from_depth(view: &StereoView) -> Raster<f32> {
    let (width, height) = (view.depth_z.width, view.depth_z.height);
    let point = |x: usize, y: usize| -> Option<Point3<f64>> {
        let depth_z = f64::from(view.depth_z[(x, y)]);
        let center = [pixel::center_of(x), pixel::center_of(y)].into();
        view.camera.unproject(&center, depth_z).filter(|_| depth_z.is_finite())
    };
    let slope = |x: usize, y: usize| -> Option<f32> {
        let inside = (1..width.saturating_sub(1)).contains(&x) && (1..height.saturating_sub(1)).contains(&y);
        if !inside {
            return None;
        }
        let across: Vector3<f64> = point(x + 1, y)? - point(x - 1, y)?;
        let down = point(x, y + 1)? - point(x, y - 1)?;
        let normal = view.world_from_cam.vector(&down.cross(&across));
        let vertical = view.world_from_cam.point(&point(x, y)?).coords;
        let angle = normal.angle(&vertical);
        Some(angle.min(std::f64::consts::PI - angle) as f32)
    };
    Raster::from_fn(width, height, |x, y| slope(x, y).unwrap_or(f32::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::synthetic::oblique_pair;
    use selenograph_raster::colormap::ABSENT;

    fn entry() -> Entry {
        let views = oblique_pair(48).map(|view| StereoView {
            name: "im_00000".to_owned(),
            camera: view.camera.clone(),
            world_from_cam: view.world_from_cam,
            depth_z: view.depth_z.clone(),
            images: vec![Raster::from_fn(48, 48, |x, _| (5 * x) as u8); 2],
            slope_rad: None,
            lit: vec![Raster::filled(48, 48, 1); 2],
        });
        Entry { label: "test".to_owned(), pair: StereoPair { pair_id: 0, views } }
    }

    #[test]
    fn a_page_has_every_column_and_row() {
        let page = page(&[entry(), entry()], 32);
        // Two lights, depth, slope and lit of two views: ten columns.
        assert_eq!(page.width, 4 + 10 * 36);
        // Lines of eight pixels: two over each row, and four over all, as `by 012` is wider than its column.
        assert_eq!(page.height, 40 + 2 * (32 + 16 + 8) + 4);
        assert!(page.data.iter().filter(|p| **p == INK).count() > 200);
    }

    #[test]
    fn names_stay_in_their_columns_and_labels_on_the_page() {
        assert_eq!(wrapped("A\nlight 0", 7), ["A", "light 0"]);
        assert_eq!(wrapped("A slope\n0-40°", 6), ["A", "slope", "0-40°"]);
        assert_eq!(wrapped("A\ndepth", 3), ["A", "dep"]);
        let long = Entry { label: "a long name of a pair ".repeat(20), ..entry() };
        let num_letters = long.label.chars().count();
        assert_eq!(page(&[long], 16).width, 2 * 4 + num_letters * font::ADVANCE_PX);
    }

    #[test]
    fn letters_are_legible_where_the_page_is_shrunk_to_a_screen() {
        let page = page(&[entry()], 400);
        // 4044 pixels wide, shown at 1100: letters of 5 × 7 pixels are 9 high there, and the names fit above their thumbnails.
        assert_eq!(page.height, 400 + 4 * (5 * 8) + 4 * 4 + 4);
        assert!("A slope".len() * 5 * font::ADVANCE_PX < 400);
    }

    #[test]
    fn slopes_of_the_wavy_ground_are_its_own() {
        let entry = entry();
        let slope = slope_from_depth(&entry.pair.views[0]);
        let [median, most] =
            statistics::quantiles(slope.data.iter().map(|&s| f64::from(s)), [0.5, 0.999]).unwrap();
        // Amplitude 400 m, wavelength 9 km: steepest near atan(2π·400/9000·1.7) ≈ 25°.
        assert!(median.to_degrees() > 3.0 && most.to_degrees() < 40.0, "{median} {most}");
        assert!(slope.data[0].is_nan());
        let absent = Colormap::Inferno.paint(&slope, 0.0, 1.0);
        assert_eq!(absent.data[0], ABSENT);
    }

    #[test]
    fn a_selection_is_even() {
        assert_eq!(chosen((0..10).collect(), 3), [3, 6, 9]);
        assert_eq!(chosen((0..3).collect(), 10), [0, 1, 2]);
    }

    #[test]
    fn pages_are_written_from_triplets() {
        let (source, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        for number in 0..3 {
            let options = crate::export::stereolunar::ExportOptions::default();
            crate::export::stereolunar::write_pair(source.path(), number, &entry().pair, &options).unwrap();
        }
        let options = SheetOptions { thumbnail_px: 24, pairs_per_page: 2, max_pairs: 9 };
        let (paths, skipped) = write(source.path(), out.path(), &options).unwrap();
        assert_eq!((paths.len(), skipped.len()), (2, 0));
        assert!(png::read(&paths[1]).is_ok());
        assert!(write(out.path(), out.path(), &options).is_err());
    }
}
