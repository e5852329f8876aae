//! The answer as a COLMAP model and as nerfstudio's `transforms.json`.

use super::inputs::Pictures;
use selenograph_reconstruct::pipeline::Reconstruction;
use selenograph_reconstruct::scene::{Scene, colmap, nerfstudio};
use selenograph_reconstruct::{Error, View};
use std::path::{Component, Path, PathBuf};

/// Folder of COLMAP's model below the target.
const COLMAP: &str = "colmap";
/// Folder of nerfstudio's file.
const NERFSTUDIO: &str = "nerfstudio";

/// Writes both, where there is a pose; `target` is where `folder` will lie.
///
/// # Errors
/// If a file cannot be written.
pub fn write(
    folder: &Path,
    target: &Path,
    pictures: &Pictures,
    found: &Reconstruction,
) -> anyhow::Result<()> {
    let Ok(pose) = &found.prediction.cam_b_from_cam_a else { return Ok(()) };
    let absolute = pictures.paths.each_ref().map(|path| parts(path));
    let shared = shared_folders([&absolute[0], &absolute[1]]);
    let names = absolute.each_ref().map(|parts| parts[shared..].join("/"));
    let views =
        [0, 1].map(|k| View { image: pictures.views[k].image.clone(), camera: found.cameras[k].clone() });
    let scale = &found.placement.cam_a_from_pred;
    let scene = Scene::of_pair(names, views.each_ref(), pose, scale, &found.matches);
    for (name, bytes) in colmap::files(&scene) {
        put(&folder.join(COLMAP).join(name), &bytes)?;
    }
    // From the file's folder up to what it shares with the pictures, and down to them.
    let from = parts(&target.join(NERFSTUDIO));
    let common = shared_folders([&from, &absolute[0]]).min(shared);
    let up = std::iter::repeat_n("..", from.len() - common).map(str::to_owned);
    let prefix: String =
        up.chain(absolute[0][common..shared].iter().cloned()).map(|part| part + "/").collect();
    put(&folder.join(NERFSTUDIO).join("transforms.json"), nerfstudio::transforms(&scene, &prefix)?.as_bytes())
}

fn put(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    }
    Ok(selenograph_files::write(path, bytes)?)
}

/// Folders and name of a path from the root on.
fn parts(path: &Path) -> Vec<String> {
    let whole = std::path::absolute(path).unwrap_or_else(|_| PathBuf::from(path));
    let mut parts: Vec<String> = Vec::new();
    for part in whole.components() {
        match part {
            Component::Normal(part) => parts.push(part.to_string_lossy().into_owned()),
            Component::ParentDir => {
                parts.pop();
            }
            Component::Prefix(_) | Component::RootDir | Component::CurDir => {}
        }
    }
    parts
}

/// How many folders two paths share from the root on; the last part is no folder.
fn shared_folders([a, b]: [&[String]; 2]) -> usize {
    let shared = a.iter().zip(b).take_while(|(a, b)| a == b).count();
    shared.min(a.len().saturating_sub(1)).min(b.len().saturating_sub(1))
}
