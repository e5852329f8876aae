//! All pairs of a dataset as one scene: pictures, cameras, and points of the truth.

use crate::args::data::{Export, ExportFormat};
use crate::commands::run_record::{NO_OUTCOME, write_record};
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_dataset::pair::PairRecord;
use selenograph_dataset::stored::{self, ReadOptions, StereoPair, StereoView, StoredPair};
use selenograph_files::{FolderKind, record};
use selenograph_geometry::{BodyFixed, Enu, Point2, Point3, PredA, Rigid3, Sim3, pixel};
use selenograph_raster::codec::png;
use selenograph_reconstruct::Error;
use selenograph_reconstruct::scene::{Scene, ScenePoint, SceneView, colmap, nerfstudio};
use selenograph_reconstruct::transform_file::Alignment;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Points of the truth per pair, roughly.
const POINTS_PER_PAIR: f64 = 500.0;
/// A point is hidden in B where the truth there is nearer than it by more than this share of its z-depth.
const HIDDEN_SHARE: f64 = 0.01;

static SCENE: FolderKind = FolderKind {
    command: "data export",
    what: "a scene that was exported",
    is_own: |folder| record::is_of(folder, SCENE.command),
    names: &[
        "run.toml",
        "transform.json",
        "transforms.json",
        "images/*.png",
        "sparse/0/*.bin",
        "sparse/0/*.txt",
    ],
    parts: &[],
};

/// For the record.
#[derive(Serialize)]
struct Settings<'a> {
    dataset: &'a Path,
    format: ExportFormat,
}

/// What was written.
#[derive(Debug, Default, Serialize)]
struct Summary {
    num_pairs: usize,
    num_images: usize,
    num_points: usize,
}

/// Exports.
///
/// # Errors
/// A dataset without pairs, and what cannot be read or written.
pub fn run(args: &Export, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = args.target.folder(&SCENE)?;
    let pairs = stored::own(&args.dataset, ReadOptions::default())?;
    let Some(first) = pairs.first() else {
        return Err(refuse(
            format!("`{}` is no dataset with complete pairs", args.dataset.display()),
            "pass the folder that `generate` wrote",
        ));
    };
    // Distances from the centre of a body would leave nothing of a metre in the 32 bits that other programs compute with.
    let record = record_of(first)?;
    let body_from_world = record.body.body_from_enu(&record.site.place());
    let images = make_folder(draft.path(), "images")?;
    let mut scene = Scene::default();
    let bar = ui.bar(pairs.len() as u64, "pairs");
    for stored in &pairs {
        check_body(&record, &record_of(stored)?)?;
        add(&mut scene, &stored.open()?.stereo()?, &body_from_world, &images)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    if args.format == ExportFormat::Colmap {
        let model = make_folder(draft.path(), "sparse/0")?;
        for (name, bytes) in colmap::files(&scene) {
            selenograph_files::write(&model.join(name), bytes)?;
        }
    } else {
        let text = nerfstudio::transforms(&scene, "images/")?;
        selenograph_files::write(&draft.path().join("transforms.json"), text)?;
    }
    let alignment = Alignment {
        world: record.body.frame.clone(),
        world_from_pred: Sim3::new(1.0, body_from_world.relabel::<BodyFixed, PredA>())?,
        metric: true,
    };
    selenograph_files::write(&draft.path().join("transform.json"), alignment.to_json()?)?;
    let settings = Settings { dataset: &args.dataset, format: args.format };
    write_record(draft.path(), SCENE.command, &[], &settings, NO_OUTCOME)?;
    draft.commit()?;
    let summary =
        Summary { num_pairs: pairs.len(), num_images: scene.views.len(), num_points: scene.points.len() };
    if ui.json {
        ui.data_json(&summary)?;
    } else {
        let Summary { num_pairs, num_images, num_points } = summary;
        let out = args.target.out.display();
        ui.note(&format!("{num_pairs} pairs, {num_images} images, {num_points} points: {out}"));
    }
    Ok(Outcome::Done)
}

fn make_folder(root: &Path, name: &str) -> anyhow::Result<PathBuf> {
    let folder = root.join(name);
    std::fs::create_dir_all(&folder).map_err(Error::io("create", &folder))?;
    Ok(folder)
}

fn record_of(stored: &StoredPair) -> anyhow::Result<PairRecord> {
    let record = stored.open()?.record;
    record.ok_or_else(|| {
        refuse(format!("pair {} has no record", stored.name), "import the triplets first (`data import`)")
    })
}

fn check_body(first: &PairRecord, other: &PairRecord) -> anyhow::Result<()> {
    if first.body == other.body {
        return Ok(());
    }
    Err(refuse(
        format!(
            "pairs {} and {} are on different bodies: they are not one scene",
            first.pair_id, other.pair_id
        ),
        "export them from datasets of their own",
    ))
}

/// Pictures of a pair under every light, and points that both views show.
fn add(
    scene: &mut Scene,
    pair: &StereoPair,
    body_from_world: &Rigid3<BodyFixed, Enu>,
    images: &Path,
) -> anyhow::Result<()> {
    let mut added: [Vec<usize>; 2] = Default::default();
    let world_from_body = body_from_world.inverse();
    for ((view, letter), added) in pair.views.iter().zip(["a", "b"]).zip(&mut added) {
        for (light_idx, picture) in view.images.iter().enumerate() {
            let name = format!("{:06}_{letter}_l{light_idx}.png", pair.pair_id);
            let path = images.join(&name);
            selenograph_files::write(&path, png::encode_grey8(picture)?)?;
            added.push(scene.views.len());
            let world_from_cam = (&world_from_body * &view.world_from_cam).relabel();
            scene.views.push(SceneView { name, camera: view.camera.clone(), world_from_cam });
        }
    }
    let [a, b] = &pair.views;
    let Some(picture) = a.images.first() else { return Ok(()) };
    let (width, height) = (a.depth_z.width, a.depth_z.height);
    let step = (((width * height) as f64 / POINTS_PER_PAIR).sqrt() as usize).max(1);
    for y in (step / 2..height).step_by(step) {
        for x in (step / 2..width).step_by(step) {
            let at = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let depth_z = f64::from(a.depth_z[(x, y)]);
            let Some(x_in_a) = a.camera.unproject(&at, depth_z).filter(|_| depth_z.is_finite()) else {
                continue;
            };
            let in_body = a.world_from_cam.point(&x_in_a);
            let Some(in_b) = seen_in(b, &b.world_from_cam.inverse().point(&in_body)) else { continue };
            let track = added
                .iter()
                .zip([at, in_b])
                .flat_map(|(views, at)| views.iter().map(move |view| (*view, at)));
            scene.points.push(ScenePoint {
                place: world_from_body.point(&in_body),
                grey: picture[(x, y)],
                error_px: 0.0,
                track: track.collect(),
            });
        }
    }
    Ok(())
}

/// Where a view shows a point of its own axes; `None` outside and behind other ground.
fn seen_in(view: &StereoView, x_in_cam: &Point3<f64>) -> Option<Point2<f64>> {
    let at = view.camera.project(x_in_cam)?;
    let index = |v: f64, size: usize| usize::try_from(pixel::index_of(v)).ok().filter(|index| *index < size);
    let depth_z = &view.depth_z;
    let there = depth_z[(index(at.x, depth_z.width)?, index(at.y, depth_z.height)?)];
    (f64::from(there) > (1.0 - HIDDEN_SHARE) * x_in_cam.z).then_some(at)
}
