//! Terrain folders: written whole or not at all, opened without reading them, damage told.
#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "a test may panic and tell"
)]

use selenograph_files::{Existing, FolderDraft};
use selenograph_geometry::{Body, Projection, proj_string::Crs};
use selenograph_raster::georef::Affine;
use selenograph_terrain::store::{Source, TERRAIN, TerrainWriter, describe, verify};
use selenograph_terrain::{Error, Grid, Layer, Terrain};
use std::fs;
use std::path::Path;

const COLS: usize = 150;
const ROWS: usize = 97;

fn grid() -> Grid {
    let body = Body::moon();
    let crs = Crs { projection: Projection::south_polar(body.radius_m), body };
    Grid::new(crs, COLS, ROWS, Affine::north_up(1234.5, -777.25, 20.0, 20.0)).unwrap()
}

fn heights() -> Vec<f32> {
    let mut heights: Vec<f32> = (0..COLS * ROWS).map(|n| ((n * 7919) % 4001) as f32 * 0.25 - 300.0).collect();
    heights[5000] = f32::NAN;
    heights
}

fn source() -> Source {
    Source { name: "test".into(), blake3: None, details: serde_json::Value::Null }
}

fn write(target: &Path, existing: Existing) -> Result<(), Error> {
    let mut writer = TerrainWriter::create(FolderDraft::claim(target, &TERRAIN, existing)?, Body::moon());
    let mut layer = writer.begin_layer(&grid(), false)?;
    for band in heights().chunks(COLS * 10) {
        layer.push_rows(band)?;
    }
    writer.finish_layer(layer, source(), None, None)?;
    writer.finish().map(|_| ())
}

fn begin(target: &Path) -> TerrainWriter {
    TerrainWriter::create(FolderDraft::claim(target, &TERRAIN, Existing::Refuse).unwrap(), Body::moon())
}

fn names(dir: &Path) -> Vec<String> {
    fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn what_is_opened_is_what_was_written() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("deeper/terrain");
    write(&target, Existing::Refuse).unwrap();
    assert_eq!(names(&dir.path().join("deeper")), ["terrain"]);
    let terrain = Terrain::open(&target).unwrap();
    verify(&target).unwrap();
    let memory = Layer::from_heights(grid(), heights()).unwrap();
    let layer = &terrain.layers[0];
    assert_eq!(layer.grid, memory.grid);
    assert_eq!(layer.height_range, memory.height_range);
    let bits = |v: &[f32]| v.iter().map(|h| h.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(layer.nodes()), bits(memory.nodes()));
    assert_eq!((*layer.pyramid.max).as_ref(), (*memory.pyramid.max).as_ref());
    assert_eq!((*layer.pyramid.min).as_ref(), (*memory.pyramid.min).as_ref());
    assert_eq!(describe(&target).unwrap().layers[0].num_absent, 1);
}

#[test]
fn an_existing_target_is_replaced_only_when_told_and_only_if_it_is_a_terrain() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("terrain");
    write(&target, Existing::Refuse).unwrap();
    assert!(matches!(
        write(&target, Existing::Refuse),
        Err(Error::Files(selenograph_files::Error::Exists { .. }))
    ));
    write(&target, Existing::Replace).unwrap();
    verify(&target).unwrap();
    let other = dir.path().join("photographs");
    fs::create_dir(&other).unwrap();
    write(&other, Existing::Refuse).unwrap();
    let precious = dir.path().join("precious");
    fs::create_dir(&precious).unwrap();
    fs::write(precious.join("thesis.tex"), "x").unwrap();
    assert!(matches!(
        write(&precious, Existing::Replace),
        Err(Error::Files(selenograph_files::Error::OtherKind { .. }))
    ));
    assert_eq!(names(&precious), ["thesis.tex"]);
    // In a terrain it is not ours either.
    fs::write(target.join("thesis.tex"), "x").unwrap();
    let refused = write(&target, Existing::Replace);
    assert!(matches!(refused, Err(Error::Files(selenograph_files::Error::Foreign { .. }))));
}

#[test]
fn a_writer_that_stops_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("terrain");
    let mut writer = begin(&target);
    let mut layer = writer.begin_layer(&grid(), false).unwrap();
    layer.push_rows(&heights()[..COLS * 20]).unwrap();
    // Rows are missing.
    assert!(matches!(writer.finish_layer(layer, source(), None, None), Err(Error::Corrupt { .. })));
    drop(writer);
    let mut writer = begin(&target);
    let mut layer = writer.begin_layer(&grid(), false).unwrap();
    layer.push_rows(&[f32::NAN; COLS * ROWS]).unwrap();
    let result = writer.finish_layer(layer, source(), None, None);
    assert!(matches!(result, Err(Error::AllAbsent { ref name, .. }) if name == "test"));
    drop(writer);
    assert!(names(dir.path()).is_empty());
}

#[test]
fn damage_is_told_with_the_file_and_the_part() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("terrain");
    write(&target, Existing::Refuse).unwrap();
    let (file, json) = (target.join("layer-0.bin"), target.join("terrain.json"));
    let (good, text) = (fs::read(&file).unwrap(), fs::read_to_string(&json).unwrap());
    let opened = || Terrain::open(&target).map(|_| ()).unwrap_err();

    fs::write(&file, &good[..good.len() - 4096]).unwrap();
    assert!(matches!(opened(), Error::Corrupt { what: "file size", .. }));
    fs::write(&file, &good[..20]).unwrap();
    assert!(matches!(opened(), Error::Corrupt { what: "first bytes", .. }));
    let mut flipped = good.clone();
    flipped[4096 + 4 * 777] ^= 1;
    fs::write(&file, &flipped).unwrap();
    assert!(Terrain::open(&target).is_ok());
    let told = verify(&target).unwrap_err();
    assert!(
        matches!(told, Error::Corrupt { what: "checksum", ref expected, .. } if expected.contains("heights"))
    );
    fs::write(&file, &good).unwrap();

    fs::write(&json, text.replace("\"cols\": 150", "\"cols\": 151")).unwrap();
    assert!(matches!(opened(), Error::Corrupt { what: "header", .. }));
    fs::write(&json, text.replace("\"version\": 1", "\"version\": 9")).unwrap();
    assert!(matches!(opened(), Error::Version { expected: 1, found: 9, .. }));
    fs::write(&json, &text[..text.len() / 2]).unwrap();
    assert!(matches!(opened(), Error::NotATerrain { .. }));
    fs::remove_file(&json).unwrap();
    assert!(matches!(opened(), Error::NotATerrain { .. }));
    assert!(matches!(Terrain::open(&dir.path().join("nowhere")), Err(Error::NotATerrain { .. })));
    fs::write(&json, &text).unwrap();
    fs::remove_file(&file).unwrap();
    assert!(matches!(opened(), Error::Io { .. }));
}
