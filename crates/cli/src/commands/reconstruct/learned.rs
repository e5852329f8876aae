//! `reconstruct --method mast3r` and `mast3r-stereo`: what a network says of the pictures.

use super::inputs::Pictures;
use crate::args::reconstruct::{Method, PointsFrom, PoseFrom, Reconstruct};
use crate::commands::network::{self, builtin};
use crate::exit::refuse;
use crate::ui::Ui;
use selenograph_network::Checkpoint;
use selenograph_predict::{About, Density, Passes, PredictOptions};
use selenograph_reconstruct::learned::{self, LearnedOptions};
use selenograph_reconstruct::pipeline::{
    FocalKnowledge, Options, Reconstruction, Stage, reconstruct_learned, reconstruct_matched,
};
use selenograph_reconstruct::priors::Priors;
use serde::Serialize;

/// What was decided, for the record.
#[derive(Serialize)]
pub struct Record {
    network: About,
    run: PredictOptions,
    /// Absent where only its matches were taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    geometry: Option<LearnedOptions>,
}

/// Everything that is decided before the pictures are looked at.
pub struct Choice {
    run: PredictOptions,
    /// `None` takes the matches only.
    geometry: Option<LearnedOptions>,
}

impl Choice {
    /// As far as the command line says.
    ///
    /// # Errors
    /// A device that this build does not have; a choice among points that are not taken.
    pub fn new(args: &Reconstruct) -> anyhow::Result<Self> {
        let takes_points = args.method == Method::Mast3r;
        let is_usual = args.learned.points_from == PointsFrom::default()
            && args.learned.pose_from == PoseFrom::default();
        if !takes_points && !is_usual {
            return Err(refuse(
                "--points-from and --pose-from are for the method `mast3r`",
                "leave them out: `mast3r-stereo` takes the network's matches, and points from stereo",
            ));
        }
        let (points, density) = match args.learned.points_from {
            PointsFrom::Network => (learned::PointsFrom::Network, Density::Published),
            PointsFrom::Triangulated => (learned::PointsFrom::Triangulated, Density::Dense),
        };
        let pose = match args.learned.pose_from {
            PoseFrom::Matches => learned::PoseFrom::Matches,
            PoseFrom::Points => learned::PoseFrom::Points,
            PoseFrom::Nothing => learned::PoseFrom::Nothing,
        };
        let passes = if args.learned.symmetric { Passes::Symmetric } else { Passes::Forward };
        Ok(Self {
            run: PredictOptions { density, passes, ..network::options(&args.network)? },
            geometry: takes_points.then(|| LearnedOptions {
                pose,
                points,
                seed: args.seed,
                ..LearnedOptions::default()
            }),
        })
    }

    /// Says what the network will take.
    ///
    /// # Errors
    /// Weights that are no checkpoint; more memory than there is.
    pub fn open(&self, args: &Reconstruct, pictures: &Pictures, ui: &Ui) -> anyhow::Result<Checkpoint> {
        let focal = self.focal_knowledge(pictures);
        let task = network::Task { pictures: pictures.sizes(), focal, num_pairs: 1 };
        let checkpoint = network::open(&args.network, &self.run, &task, ui)?;
        let takes_its_points =
            self.geometry.as_ref().is_some_and(|g| g.points == learned::PointsFrom::Network);
        if takes_its_points && builtin::is(&checkpoint) {
            ui.note(
                "warning: the built-in network is for matches, its own points are no terrain: take `--points-from triangulated`, \
                 or `--method mast3r-stereo`",
            );
        }
        Ok(checkpoint)
    }

    /// Runs the network and places what it says, or what stereo makes of its matches (with `options`); what was done to the
    /// pictures is added to their notes.
    ///
    /// # Errors
    /// Weights that make no network; a picture below one patch; a pair that cannot tell.
    pub fn reconstruct(
        self,
        checkpoint: &Checkpoint,
        pictures: &mut Pictures,
        priors: &Priors,
        options: &Options,
        progress: &mut dyn FnMut(Stage),
        ui: &Ui,
    ) -> anyhow::Result<(Reconstruction, Record)> {
        let predictor = network::load(checkpoint, &self.run, ui)?;
        let focal = self.focal_knowledge(pictures);
        let said = network::with_steps(ui, |progress| predictor.predict(&pictures.views, focal, progress))?;
        for (path, notes) in pictures.paths.iter().zip(&said.notes) {
            for note in notes {
                let note = format!("`{}`: for the network {note}", path.display());
                ui.note(&format!("note: {note}"));
                pictures.notes.push(note);
            }
        }
        let [a, b] = &pictures.views;
        let found = match &self.geometry {
            Some(geometry) => reconstruct_learned(said.input, priors, geometry, progress)?,
            None => reconstruct_matched(a, b, &said.input.learned, priors, options, progress)?,
        };
        let record = Record { network: predictor.about().clone(), run: self.run, geometry: self.geometry };
        Ok((found, record))
    }

    /// Whether the network's points are to tell the focal lengths.
    fn focal_knowledge(&self, pictures: &Pictures) -> FocalKnowledge {
        if pictures.camera_known || self.geometry.is_none() {
            FocalKnowledge::Known
        } else {
            FocalKnowledge::Guessed
        }
    }
}
