//! The import of a polar cap as large as LOLA's 5 m product: made, imported, opened, measured, removed.
//!
//! `cargo run --release -p selenograph-terrain --example import_cap -- FOLDER [SIZE] [BASE.tif]`: works in a new folder
//! under FOLDER, which needs 4 bytes a node for the GeoTIFF and 5.4 for the terrain (8.6 GB for 30 336²).
#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::print_stdout, reason = "a measuring program answers on stdout")]

use selenograph_geometry::Body;
use selenograph_raster::dem::geotiff::Compression;
use selenograph_raster::dem::{DemReader, GeoTiffLayout, OpenOptions, WriteOptions};
use selenograph_terrain::import::{ImportOptions, ImportSource, import};
use selenograph_terrain::synth::{BaseSurface, Synth, SynthSettings, south_polar_grid};
use selenograph_terrain::{Error, Grid, Terrain};
use std::path::{Path, PathBuf};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: import_cap FOLDER [SIZE] [BASE.tif]")?);
    let size: usize = arguments.next().map_or(Ok(30_336), |text| text.parse())?;
    let base = arguments.next().map(PathBuf::from);
    let work = tempfile::tempdir_in(&folder)?;
    let (tiff, target) = (work.path().join("cap.tif"), work.path().join("terrain"));

    let grid = south_polar_grid(Body::moon(), size, 5.0)?;
    let base = base.map(|path| base_surface(&path, &grid)).transpose()?;
    let synth = Synth::new(grid, &SynthSettings::default(), base)?;
    // Uncompressed, as a worst case for the bytes to be read.
    let options = WriteOptions {
        layout: GeoTiffLayout::Tiles { side: 256 },
        compression: Compression::None,
        nodata: None,
    };
    let start = Instant::now();
    synth.write_geotiff(&tiff, options, &mut |_, _| {})?;
    let dem_bytes = 4 * (size as u64).pow(2);
    println!("synthesis: {:.1} s, peak memory so far {} kB", start.elapsed().as_secs_f64(), peak_memory_kb());

    let start = Instant::now();
    let source = ImportSource { path: tiff, options: OpenOptions::default() };
    let description = import(
        &[source],
        selenograph_files::FolderDraft::beside(&target)?,
        &ImportOptions::default(),
        &mut |_| {},
    )?;
    println!("import: {:.1} s, peak memory so far {} kB", start.elapsed().as_secs_f64(), peak_memory_kb());
    let bytes: u64 = description.layers.iter().map(|layer| layer.bytes).sum();
    println!("bytes: {bytes}, {:.4} of the model's {dem_bytes}", bytes as f64 / dem_bytes as f64);

    let start = Instant::now();
    let terrain = Terrain::open(&target)?;
    println!("opening: {:.6} s, heights {:?} m", start.elapsed().as_secs_f64(), terrain.height_range());
    Ok(())
}

fn base_surface(path: &Path, target: &Grid) -> Result<BaseSurface, Error> {
    let mut reader = DemReader::open(path, &OpenOptions::default())?;
    let info = reader.info();
    let grid = Grid::new(info.crs.clone(), info.width, info.height, info.map_from_pixel.grid_from_pixel())?;
    BaseSurface::read(grid, target, |first, count, out| Ok(reader.read_rows(first, count, out)?))
}

/// Largest resident size of this process, kilobytes, as Linux counts it.
fn peak_memory_kb() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.map_or("unknown".into(), |text| text.trim().trim_end_matches(" kB").to_owned())
}
