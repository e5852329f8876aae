//! Shading as a part of `reconstruct`: whether it takes part, and the record of what it did.

use super::suns::Suns;
use crate::args::reconstruct::Reconstruct;
use crate::commands::figures::rms;
use crate::exit::refuse;
use crate::ui::Ui;
use selenograph_geometry::Vector3;
use selenograph_reconstruct::pipeline::{Method, Options, Reconstruction, ShadingOutcome, ShadingUse};
use selenograph_reconstruct::priors::Priors;
use selenograph_reconstruct::shading::{Compared, Explained, Shaded};
use serde::Serialize;

/// What the command line asks for.
///
/// # Errors
/// Shading with a method that has no dense surface, or a method of shading without it.
pub fn asked(args: &Reconstruct) -> anyhow::Result<ShadingUse> {
    match (args.method, args.shading) {
        (Method::Fused, ShadingUse::Off) => Err(refuse(
            "--shading off with --method fused, which is stereo and shading",
            "leave one of them out: --method stereo --shading off is stereo alone",
        )),
        (Method::Fused, _) => Ok(ShadingUse::On),
        (Method::Stereo | Method::Mast3rStereo, asked) => Ok(asked),
        (method, ShadingUse::On) => Err(refuse(
            format!(
                "--shading on is for the methods `stereo` and `mast3r-stereo`, not `{}`",
                method.as_str()
            ),
            "leave out --method, or --shading",
        )),
        (_, ShadingUse::Auto | ShadingUse::Off) => Ok(ShadingUse::Off),
    }
}

/// Why shading takes no part although it might; what is said of the Suns either way.
///
/// # Errors
/// A Sun that nothing tells, where it is needed.
pub fn settle(
    args: &Reconstruct,
    asked: ShadingUse,
    suns: &mut Suns,
    ui: &Ui,
) -> anyhow::Result<Option<String>> {
    let why_not = match (asked, suns.missing()) {
        (ShadingUse::On, _) => {
            let option = if args.method == Method::Fused { "--method fused" } else { "--shading on" };
            suns.notes.iter().for_each(|note| ui.note(&format!("note: {note}")));
            suns.both(option)?;
            None
        }
        (ShadingUse::Auto, Some(missing)) => {
            suns.without_files();
            ui.note(&format!(
                "note: stereo alone: with shading it would be sharper, and {missing}; --sun-a and --sun-b tell the Suns, or --time-a and --time-b with \
                 --world-from-cam-a"
            ));
            suns.notes.iter().for_each(|note| ui.note(&format!("note: {note}")));
            return Ok(Some(missing));
        }
        _ => {
            suns.notes.iter().for_each(|note| ui.note(&format!("note: {note}")));
            None
        }
    };
    if asked != ShadingUse::Off {
        suns.sentences().for_each(|sentence| ui.note(&sentence));
    }
    Ok(why_not)
}

/// What shading did: a part of `reconstruction.json` and of `run.toml`.
#[derive(Debug, Clone, Serialize)]
pub struct Record {
    /// `auto` or `on`.
    asked: &'static str,
    /// Whether the answer is its surface.
    used: bool,
    /// Why it is not.
    #[serde(skip_serializing_if = "Option::is_none")]
    why_not: Option<String>,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    surface: Option<SurfaceRecord>,
}

/// The surface and how it explains the pictures.
#[derive(Debug, Clone, Serialize)]
struct SurfaceRecord {
    /// Side of its cells, metres or baselines.
    cell: f64,
    /// Columns and rows.
    size: [usize; 2],
    picture_a: PictureRecord,
    picture_b: PictureRecord,
}

/// How the surface explains one picture.
#[derive(Debug, Clone, Serialize)]
pub struct PictureRecord {
    /// Of the picture with the model's, over the cells that both pictures show.
    pub correlation: f64,
    /// Root mean square of picture less model, in the picture's lit mean.
    pub residual_rms: f64,
    /// Grey level of ground of radiance factor 1.
    pub gain: f64,
    /// Grey level at no light.
    pub offset: f64,
    /// Share of the picture's pixels that are lit and not saturated.
    pub lit_share: f64,
    /// Unit vector to the Sun in the axes of camera A, after the fit.
    pub sun: [f64; 3],
    /// Above the horizon of the ground that the first camera looks at, degrees; absent where nothing tells what is up.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun_elevation_deg: Option<f64>,
    /// From the Sun that was given, degrees.
    pub sun_turned_deg: f64,
    /// Standard deviation of the Sun that was given, degrees.
    pub sun_given_sigma_deg: f64,
}

impl Record {
    /// `None` where nobody asked.
    pub fn new(
        asked: ShadingUse,
        why_not: Option<String>,
        found: &Reconstruction,
        priors: &Priors,
    ) -> Option<Self> {
        let record = |why_not, surface: Option<SurfaceRecord>| Self {
            asked: asked.as_str(),
            used: surface.is_some(),
            why_not,
            surface,
        };
        match (&found.shading, asked) {
            (_, ShadingUse::Off) => None,
            (ShadingOutcome::NotAsked, _) => Some(record(why_not, None)),
            (ShadingOutcome::LeftOut(why), _) => Some(record(Some(why.to_string()), None)),
            (ShadingOutcome::Used(used), _) => Some(record(None, surface(&used.shaded, found, priors))),
        }
    }

    /// How each picture is explained, where the answer is the surface.
    pub fn pictures(&self) -> Option<[&PictureRecord; 2]> {
        self.surface.as_ref().map(|surface| [&surface.picture_a, &surface.picture_b])
    }
}

fn surface(shaded: &Shaded, found: &Reconstruction, priors: &Priors) -> Option<SurfaceRecord> {
    let picture =
        |k: usize| Some(of_picture(k, shaded.pictures.get(k)?, shaded.compared.get(k)?, found, priors));
    Some(SurfaceRecord {
        cell: shaded.patch.cell * found.placement.cam_a_from_pred.scale(),
        size: [shaded.patch.width, shaded.patch.height],
        picture_a: picture(0)?,
        picture_b: picture(1)?,
    })
}

fn of_picture(
    k: usize,
    explained: &Explained,
    compared: &Compared,
    found: &Reconstruction,
    priors: &Priors,
) -> PictureRecord {
    let pose = found.prediction.cam_b_from_cam_a.as_ref().ok();
    let given: Option<Vector3<f64>> = match (priors.suns[k], k, pose) {
        (Some(sun), 1, Some(pose)) => Some(sun.in_cam_a(&pose.inverse())),
        (Some(sun), ..) => Some(sun.direction),
        (None, ..) => None,
    };
    PictureRecord {
        correlation: explained.correlation,
        residual_rms: rms(compared.residual().data.iter().map(|r| f64::from(*r))),
        gain: explained.gain,
        offset: explained.offset,
        lit_share: explained.lit_share,
        sun: explained.sun.into(),
        sun_elevation_deg: priors.world.elevation_rad(&explained.sun).map(f64::to_degrees),
        sun_turned_deg: given.map_or(0.0, |given| given.angle(&explained.sun).to_degrees()),
        sun_given_sigma_deg: priors.suns[k].map_or(0.0, |sun| sun.sigma_rad.to_degrees()),
    }
}

/// The same with a network's matches in place of features.
pub fn by_network(options: &Options, asked: ShadingUse) -> Options {
    Options { method: Method::Mast3rStereo, shading_use: asked, ..options.clone() }
}
