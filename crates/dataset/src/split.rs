//! Training and validation parts that share no ground.
//!
//! The map is cut into square cells, at least as large as the largest footprint; a cell belongs to one part, and a
//! pair to the part of all the cells that its two footprints touch. A pair that touches both parts is left out of
//! both, and listed.

use crate::Error;
use crate::pair::ViewName;
use crate::rng::rng;
use crate::stored::{self, OpenPair, RawView, ReadOptions};
use selenograph_geometry::{Body, Point3, Pole, Projection, pixel};
use selenograph_render::{Hit, Tracer, Viewpoint};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A part of a dataset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// For training.
    Train,
    /// For validation.
    Val,
}

impl Part {
    /// `train` or `val`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
        }
    }
}

/// How to split.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SplitOptions {
    /// Share of the pairs to validate on, in (0, 1).
    pub val_share: f64,
    /// Decides which cells.
    pub seed: u64,
    /// Side of a cell, metres on the map; the largest footprint where it is absent or smaller.
    pub cell_m: Option<f64>,
}

impl Default for SplitOptions {
    fn default() -> Self {
        Self { val_share: 0.2, seed: 0, cell_m: None }
    }
}

/// The rectangle on the map that holds all the ground of a pair, both views together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Number of the pair.
    pub pair_id: u64,
    /// West, south, east, north, metres.
    pub bounds_m: [f64; 4],
}

impl Footprint {
    fn side_m(&self) -> f64 {
        let [west, south, east, north] = self.bounds_m;
        (east - west).max(north - south)
    }
}

/// Who belongs where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// The options it was made with.
    pub options: SplitOptions,
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Pairs to train on.
    pub train: Vec<u64>,
    /// Pairs to validate on.
    pub val: Vec<u64>,
    /// Pairs left out, because their ground lies in both parts.
    pub left_out: Vec<u64>,
}

impl Split {
    /// The part of a pair, `None` where it was left out.
    pub fn part_of(&self, pair_id: u64) -> Option<Part> {
        if self.val.binary_search(&pair_id).is_ok() {
            Some(Part::Val)
        } else {
            self.train.binary_search(&pair_id).is_ok().then_some(Part::Train)
        }
    }
}

/// Grid offsets and cell orders tried; the one that leaves out the fewest pairs is taken.
const NUM_CANDIDATES: u64 = 256;

/// Splits footprints. A function of its arguments only.
///
/// # Errors
/// [`Error::Value`] if the share is not inside (0, 1).
pub fn split(footprints: &[Footprint], options: &SplitOptions) -> Result<Split, Error> {
    if !(options.val_share > 0.0 && options.val_share < 1.0) {
        return Err(Error::Value {
            key: "val_share".to_owned(),
            expected: "a share between 0 and 1".to_owned(),
            found: options.val_share.to_string(),
        });
    }
    let largest = footprints.iter().map(Footprint::side_m).fold(1.0, f64::max);
    let cell_m = options.cell_m.unwrap_or(0.0).max(largest);
    let best = (0..NUM_CANDIDATES)
        .map(|idx| candidate(footprints, cell_m, options, idx))
        .min_by(|a, b| cost(a, options).total_cmp(&cost(b, options)));
    let mut split = best.unwrap_or_else(|| candidate(footprints, cell_m, options, 0));
    for list in [&mut split.train, &mut split.val, &mut split.left_out] {
        list.sort_unstable();
    }
    Ok(split)
}

/// Share of pairs left out, plus how far the validation share is off, which weighs four times as much: a part that is
/// nearly empty leaves out nearly nothing.
fn cost(split: &Split, options: &SplitOptions) -> f64 {
    let kept = (split.train.len() + split.val.len()) as f64;
    let total = kept + split.left_out.len() as f64;
    split.left_out.len() as f64 / total.max(1.0)
        + 4.0 * (split.val.len() as f64 / kept.max(1.0) - options.val_share).abs()
}

/// The cells of a grid: its offset and side, metres.
struct Cells {
    offset_m: [f64; 2],
    side_m: f64,
}

impl Cells {
    fn at(&self, x: f64, y: f64) -> (i64, i64) {
        let cell = |value: f64, offset: f64| ((value - offset) / self.side_m).floor() as i64;
        (cell(x, self.offset_m[0]), cell(y, self.offset_m[1]))
    }

    /// The cell of the footprint's middle.
    fn home(&self, footprint: &Footprint) -> (i64, i64) {
        let [west, south, east, north] = footprint.bounds_m;
        self.at((west + east) / 2.0, (south + north) / 2.0)
    }

    /// All cells that a footprint touches.
    fn touched(&self, footprint: &Footprint) -> Vec<(i64, i64)> {
        let [west, south, east, north] = footprint.bounds_m;
        let (first, last) = (self.at(west, south), self.at(east, north));
        (first.0..=last.0).flat_map(|column| (first.1..=last.1).map(move |row| (column, row))).collect()
    }
}

fn candidate(footprints: &[Footprint], cell_m: f64, options: &SplitOptions, idx: u64) -> Split {
    let mut random = rng(options.seed, "split", idx, "cells");
    let cells =
        Cells { offset_m: [random.uniform(0.0, cell_m), random.uniform(0.0, cell_m)], side_m: cell_m };
    // Half of the candidates take the cells beyond a line: on a small map, one straight border touches fewest pairs.
    let sweep = (idx % 2 == 1).then(|| random.uniform(0.0, std::f64::consts::TAU).sin_cos());
    let mut pairs_by_home: BTreeMap<(i64, i64), usize> = BTreeMap::new();
    for footprint in footprints {
        *pairs_by_home.entry(cells.home(footprint)).or_default() += 1;
    }
    let mut order: Vec<(f64, (i64, i64))> = pairs_by_home
        .keys()
        .map(|&(column, row)| {
            let key =
                sweep.map_or_else(|| random.unit(), |(sin, cos)| column as f64 * cos + row as f64 * sin);
            (key, (column, row))
        })
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // Pairs at a border are left out, and a small part has more border: it has to start larger than it shall end.
    let surplus = random.uniform(1.0, 2.5);
    let wanted = (options.val_share * surplus * footprints.len() as f64).round() as usize;
    let mut val_cells = BTreeSet::new();
    let mut num_val = 0;
    for (_, cell) in order {
        if num_val >= wanted {
            break;
        }
        num_val += pairs_by_home[&cell];
        val_cells.insert(cell);
    }
    let mut split = Split { options: options.clone(), cell_m, train: vec![], val: vec![], left_out: vec![] };
    for footprint in footprints {
        let touched = cells.touched(footprint);
        let list = match touched.iter().filter(|cell| val_cells.contains(cell)).count() {
            0 => &mut split.train,
            n if n == touched.len() => &mut split.val,
            _ => &mut split.left_out,
        };
        list.push(footprint.pair_id);
    }
    split
}

/// Every this many pixels across and down, and the border, are looked at for a footprint.
const FOOTPRINT_STEP: usize = 16;

/// The footprints of a dataset's pairs on one map: polar stereographic of the hemisphere of the first pair's site, or
/// equirectangular where that lies within 60° of the equator.
///
/// # Errors
/// Those of reading the pairs' records and depths.
pub fn footprints(dataset: &Path) -> Result<Vec<Footprint>, Error> {
    let mut map = None;
    let mut found = Vec::new();
    for stored in stored::own(dataset, ReadOptions::default())? {
        let pair = stored.open()?;
        let map = match map {
            Some(map) => map,
            None => *map.insert(map_of(&pair)?),
        };
        let mut bounds = Bounds::default();
        for view in ViewName::BOTH {
            bounds.add_view(&pair.raw_view(view)?, &map)?;
        }
        found.extend(bounds.footprint(stored.pair_id));
    }
    Ok(found)
}

/// A map near a pair's ground.
pub(crate) fn map_of(pair: &OpenPair<'_>) -> Result<Projection, Error> {
    if let Some(record) = &pair.record {
        return Ok(map_for(&record.body, record.site.latitude_deg));
    }
    // Triplets do not name their body.
    let body = Body::moon();
    let position = pair.raw_view(ViewName::A)?.world_from_cam.fixed_view::<3, 1>(0, 3).into_owned();
    Ok(map_for(&body, body.place(&position.into()).lat_rad.to_degrees()))
}

/// The rectangle round points on a map.
pub(crate) struct Bounds([f64; 4]);

impl Default for Bounds {
    fn default() -> Self {
        Self([f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY])
    }
}

impl Bounds {
    fn add(&mut self, point: &Point3<f64>, map: &Projection) {
        let [west, south, east, north] = self.0;
        if let Some([e, n]) = map.map_from_point(point) {
            self.0 = [west.min(e), south.min(n), east.max(e), north.max(n)];
        }
    }

    /// The ground that a view's stored depth shows.
    pub(crate) fn add_view(&mut self, raw: &RawView, map: &Projection) -> Result<(), Error> {
        let (camera, world_from_cam) = (raw.camera()?, raw.world_from_cam()?);
        for (x, y) in looked_at(camera.width, camera.height) {
            let depth_z = f64::from(raw.depth_z[(x, y)]);
            let center = [pixel::center_of(x), pixel::center_of(y)].into();
            if let Some(point) = camera.unproject(&center, depth_z).filter(|_| depth_z.is_finite()) {
                self.add(&world_from_cam.point(&point), map);
            }
        }
        Ok(())
    }

    /// `None` for a pair that sees no ground: it has nothing to share.
    pub(crate) fn footprint(&self, pair_id: u64) -> Option<Footprint> {
        self.0[0].is_finite().then_some(Footprint { pair_id, bounds_m: self.0 })
    }
}

/// Pixels that tell a footprint: every few, and the border.
fn looked_at(width: usize, height: usize) -> impl Iterator<Item = (usize, usize)> {
    let taken = |idx: usize, count: usize| idx.is_multiple_of(FOOTPRINT_STEP) || idx + 1 == count;
    let rows = (0..height).filter(move |y| taken(*y, height));
    rows.flat_map(move |y| (0..width).filter(move |x| taken(*x, width)).map(move |x| (x, y)))
}

/// The ground that two views see of a terrain.
pub(crate) fn footprint_of_views(
    tracer: &Tracer<'_>,
    views: &[Viewpoint; 2],
    map: &Projection,
    pair_id: u64,
) -> Option<Footprint> {
    let mut bounds = Bounds::default();
    for view in views {
        for (x, y) in looked_at(view.camera.width, view.camera.height) {
            let ray = view.direction(x, y);
            let hit = ray.map(|ray| tracer.first_hit(view.origin(), ray, 0.0, f64::INFINITY));
            if let Some(Hit::Surface(hit)) = hit {
                bounds.add(&hit.point, map);
            }
        }
    }
    bounds.footprint(pair_id)
}

/// Whether two footprints on one map overlap.
pub(crate) fn share_ground(a: &Footprint, b: &Footprint) -> bool {
    (0..2).all(|i| a.bounds_m[i] < b.bounds_m[i + 2] && b.bounds_m[i] < a.bounds_m[i + 2])
}

/// The map on which footprints near a latitude are told.
pub(crate) fn map_for(body: &Body, latitude_deg: f64) -> Projection {
    if latitude_deg < -60.0 {
        Projection::polar(Pole::South, body.radius_m)
    } else if latitude_deg > 60.0 {
        Projection::polar(Pole::North, body.radius_m)
    } else {
        Projection::Equirectangular {
            lat_ts_rad: 0.0,
            lat0_rad: 0.0,
            lon0_rad: 0.0,
            false_easting_m: 0.0,
            false_northing_m: 0.0,
            radius_m: body.radius_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `count` footprints of 2-6 km spread over 150 km.
    fn scattered(count: u64) -> Vec<Footprint> {
        let mut random = rng(7, "test", 0, "footprints");
        (0..count)
            .map(|pair_id| {
                let (x, y) = (random.uniform(-75e3, 75e3), random.uniform(-75e3, 75e3));
                let half = random.uniform(1e3, 3e3);
                Footprint { pair_id, bounds_m: [x - half, y - half, x + half, y + half] }
            })
            .collect()
    }

    #[test]
    fn no_ground_is_in_both_parts() {
        let footprints = scattered(400);
        let split = split(&footprints, &SplitOptions::default()).unwrap();
        assert_eq!(split.train.len() + split.val.len() + split.left_out.len(), 400);
        let share = split.val.len() as f64 / (split.train.len() + split.val.len()) as f64;
        assert!((share - 0.2).abs() < 0.05, "{share}");
        assert!(split.left_out.len() < 100, "{}", split.left_out.len());
        for a in &split.train {
            for b in &split.val {
                assert!(!share_ground(&footprints[*a as usize], &footprints[*b as usize]), "{a} {b}");
            }
        }
        assert_eq!(split.part_of(split.val[0]), Some(Part::Val));
        assert_eq!(split.part_of(split.left_out[0]), None);
    }

    #[test]
    fn a_seed_gives_one_split_and_another_seed_another() {
        let footprints = scattered(100);
        let with = |seed| split(&footprints, &SplitOptions { seed, ..SplitOptions::default() }).unwrap();
        assert_eq!(with(1), with(1));
        assert_ne!(with(1).val, with(2).val);
    }

    #[test]
    fn cells_are_at_least_as_large_as_the_largest_footprint() {
        let mut footprints = scattered(10);
        footprints[3].bounds_m = [0.0, 0.0, 40e3, 10e3];
        let options = SplitOptions { cell_m: Some(5e3), ..SplitOptions::default() };
        assert_eq!(split(&footprints, &options).unwrap().cell_m, 40e3);
        assert!(split(&footprints, &SplitOptions { val_share: 1.0, ..options }).is_err());
        assert!(split(&[], &SplitOptions::default()).unwrap().train.is_empty());
    }
}
