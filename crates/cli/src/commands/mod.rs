//! What the commands do, one file each.

mod albedo;
pub mod clock;
mod completions;
mod config_show;
mod data_check;
mod data_export;
mod data_import;
mod data_sheet;
mod data_split;
mod dem_hillshade;
mod dem_import;
mod dem_info;
mod dem_synth;
mod demo;
mod doctor;
mod evaluate;
mod figures;
mod frames;
mod generate;
mod network;
mod plan;
mod planning;
mod presets;
mod reading;
mod reconstruct;
mod refine;
mod render;
mod run_record;
mod terrain_info;
#[cfg(feature = "train")]
mod train;
#[cfg(not(feature = "train"))]
#[path = "train_absent.rs"]
mod train;
mod weights;

use crate::args::Command;
use crate::args::campaign::ConfigCommand;
use crate::args::data::DataCommand;
use crate::args::dem::DemCommand;
use crate::args::weights::WeightsCommand;
use crate::exit::Outcome;
use crate::ui::Ui;
use selenograph_render::InstructionSet;

/// Runs a command.
///
/// # Errors
/// Whatever stops it; [`crate::exit`] turns it into a line, a hint and an exit code.
pub fn run(command: &Command, ui: &Ui) -> anyhow::Result<Outcome> {
    ui.detail(&format!(
        "selenograph {}; instruction set: {:?}; threads: {}\nsettings: {command:#?}",
        env!("CARGO_PKG_VERSION"),
        InstructionSet::best(),
        rayon::current_num_threads()
    ));
    ui.timed("total", || dispatch(command, ui))
}

fn dispatch(command: &Command, ui: &Ui) -> anyhow::Result<Outcome> {
    match command {
        Command::Demo(args) => demo::run(args, ui),
        Command::Dem(DemCommand::Info(args)) => dem_info::run(args, ui),
        Command::Dem(DemCommand::Hillshade(args)) => dem_hillshade::run(args, ui),
        Command::Dem(DemCommand::Import(args)) => dem_import::run(args, ui),
        Command::Dem(DemCommand::Synth(args)) => dem_synth::run(args, ui),
        Command::Render(args) => render::run(args, ui),
        Command::Plan(args) => plan::run(args, ui),
        Command::Generate(args) => generate::run(args, ui),
        Command::Data(DataCommand::Check(args)) => data_check::run(args, ui),
        Command::Data(DataCommand::Sheet(args)) => data_sheet::run(args, ui),
        Command::Data(DataCommand::Split(args)) => data_split::run(args, ui),
        Command::Data(DataCommand::Import(args)) => data_import::run(args, ui),
        Command::Data(DataCommand::Export(args)) => data_export::run(args, ui),
        Command::Evaluate(args) => evaluate::run(args, ui),
        Command::Reconstruct(args) => reconstruct::run(args, ui),
        Command::Refine(args) => refine::run(args, ui),
        Command::Frames(args) => frames::run(args, ui),
        Command::Weights(WeightsCommand::Info(args)) => weights::info(args, ui),
        Command::Weights(WeightsCommand::Convert(args)) => weights::convert(args, ui),
        Command::Weights(WeightsCommand::Random(args)) => weights::random(args, ui),
        Command::Train(command) => train::run(command, ui),
        Command::Presets(args) => presets::run(args, ui),
        Command::Config(ConfigCommand::Show(args)) => config_show::run(args, ui),
        Command::Doctor(args) => doctor::run(args, ui),
        Command::Completions(args) => completions::run(args, ui),
    }
}
