//! `dem info` of a terrain folder: its layers, and on demand whether every byte is still what was written.

use crate::ui::Ui;
use selenograph_terrain::store::{self, Description, LayerDescription};
use std::path::Path;

/// Describes a terrain folder; reads all of it if `verify`.
///
/// # Errors
/// A folder that is no terrain, or one that is damaged.
pub fn describe(dir: &Path, verify: bool, ui: &Ui) -> anyhow::Result<Description> {
    let description = store::describe(dir)?;
    if verify {
        ui.timed("checksums", || store::verify(dir))?;
        ui.note("every checksum is right");
    }
    Ok(description)
}

/// What a person reads.
pub fn text(dir: &Path, description: &Description) -> String {
    let mut out = format!(
        "{}\n  terrain folder, format {}; {}, sphere of {} m, {} layers, finest first",
        dir.display(),
        description.version,
        description.body.name,
        description.body.radius_m,
        description.layers.len()
    );
    for layer in &description.layers {
        out.push_str(&layer_text(layer));
    }
    out
}

fn layer_text(layer: &LayerDescription) -> String {
    let [low, high] = layer.height_range_m;
    let [x0, y0] = layer.map_from_grid.apply(0.0, 0.0);
    let [x1, y1] = layer.map_from_grid.apply((layer.cols - 1) as f64, (layer.rows - 1) as f64);
    format!(
        "\n  {}\n    {}×{} nodes, {:.3} m, from {}\n    heights {low:.1} to {high:.1} m, {} absent\n    x {x0:.1} … {x1:.1}, y {y0:.1} … {y1:.1}\n    {}",
        layer.file, layer.cols, layer.rows, layer.cell_m, layer.source.name, layer.num_absent, layer.crs
    )
}
