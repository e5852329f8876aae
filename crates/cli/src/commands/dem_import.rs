//! `dem import`: elevation models into a terrain that the renderer can trace.

use super::reading::options;
use crate::args::dem::Import;
use crate::exit::Outcome;
use crate::ui::Ui;
use selenograph_terrain::import::{ImportOptions, ImportSource, import};
use selenograph_terrain::store::TERRAIN;

/// Imports all files as one terrain.
///
/// # Errors
/// A file that cannot be read, files on different spheres, a target that cannot be written.
pub fn run(args: &Import, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = args.target.folder(&TERRAIN)?;
    let sources: Vec<ImportSource> = args
        .files
        .iter()
        .map(|path| ImportSource { path: path.clone(), options: options(&args.reading) })
        .collect();
    let bar = ui.bar(0, "rows");
    let description = import(&sources, draft, &ImportOptions::default(), &mut |progress| {
        bar.set_length(progress.num_rows as u64);
        bar.set_position(progress.rows_done as u64);
        bar.set_message(format!("{} of {}", progress.layer_idx + 1, progress.num_layers));
    })?;
    bar.finish_and_clear();
    if ui.json {
        ui.data_json(&description)?;
        return Ok(Outcome::Done);
    }
    for layer in &description.layers {
        ui.note(&format!(
            "{}: {} × {} nodes, {:.2} m cells, heights {:.1} .. {:.1} m",
            layer.source.name,
            layer.cols,
            layer.rows,
            layer.cell_m,
            layer.height_range_m[0],
            layer.height_range_m[1]
        ));
        if let Some(nest) = &layer.nest {
            ui.note(&format!(
                "  fitted onto the coarser surface; steps between the two were: 99 % below {:.1} m, largest {:.1} m",
                nest.step_p99_m, nest.step_max_m
            ));
        }
    }
    ui.note(&format!("terrain: {}", args.target.out.display()));
    Ok(Outcome::Done)
}
