//! `reconstruct --method mast3r` and `mast3r-stereo`: what a network says of the pictures.

use super::inputs::Pictures;
use crate::args::reconstruct::Reconstruct;
use crate::commands::network::{self, builtin};
use crate::exit::refuse;
use crate::ui::Ui;
use selenograph_network::Checkpoint;
use selenograph_predict::{About, Density, Passes, PredictOptions};
use selenograph_reconstruct::evidence::FocalKnowledge;
use selenograph_reconstruct::learned::{LearnedInput, PointsFrom, PoseFrom};
use selenograph_reconstruct::pipeline::Method;
use serde::Serialize;

/// What was decided, for the record.
#[derive(Serialize)]
pub struct Record {
    network: About,
    run: PredictOptions,
}

/// Everything that is decided before the pictures are looked at.
pub struct Choice {
    run: PredictOptions,
    /// Which of its points are taken; `None` takes the matches only.
    points: Option<PointsFrom>,
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
        let density = match args.learned.points_from {
            PointsFrom::Network => Density::Published,
            PointsFrom::Triangulated => Density::Dense,
        };
        let passes = if args.learned.symmetric { Passes::Symmetric } else { Passes::Forward };
        Ok(Self {
            run: PredictOptions { density, passes, ..network::options(&args.network)? },
            points: takes_points.then_some(args.learned.points_from),
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
        if self.points == Some(PointsFrom::Network) && builtin::is(&checkpoint) {
            ui.note(
                "warning: the built-in network is for matches, its own points are no terrain: take `--points-from triangulated`, \
                 or `--method mast3r-stereo`",
            );
        }
        Ok(checkpoint)
    }

    /// Asks the network; what was done to the pictures is added to their notes.
    ///
    /// # Errors
    /// Weights that make no network; a picture below one patch.
    pub fn ask(
        self,
        checkpoint: &Checkpoint,
        pictures: &mut Pictures,
        ui: &Ui,
    ) -> anyhow::Result<(LearnedInput, Record)> {
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
        Ok((said.input, Record { network: predictor.about().clone(), run: self.run }))
    }

    /// Whether the network's points are to tell the focal lengths.
    fn focal_knowledge(&self, pictures: &Pictures) -> FocalKnowledge {
        if pictures.camera_known || self.points.is_none() {
            FocalKnowledge::Known
        } else {
            FocalKnowledge::Guessed
        }
    }
}
