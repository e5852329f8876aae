//! The Sun that lit one picture of a pair, ours or the paper's, by where the picture lies.

use super::own;
use super::place::{Files, Place};
use super::triplets::{self, LIGHTS_PER_PAIR};
use super::view::rigid;
use crate::Error;
use crate::pair::{CameraRecord, PAIR_NAME, PairRecord, ViewName, camera_name, image_name};
use crate::photometric::{self, Settings, SiteRule};
use selenograph_geometry::Vector3;
use std::path::{Path, PathBuf};

/// Standard deviation of the Suns of the authors' scripts, radians (0.2°): how far the Suns fitted to the public samples lie from them.
const SCRIPTS_SIGMA_RAD: f64 = 0.2 * std::f64::consts::PI / 180.0;

/// The Sun of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureSun {
    /// Unit vector towards it in the axes of the picture's camera.
    pub direction_in_cam: Vector3<f64>,
    /// Standard deviation, radians; 0 for pictures that were rendered with it.
    pub sigma_rad: f64,
    /// What tells it, for people.
    pub from: String,
    /// The files that tell it.
    pub files: Vec<PathBuf>,
}

/// The Sun of a picture that lies in a pair folder of ours or in a folder of the paper's triplets; `None` for any other picture.
///
/// Of ours, `pair.json` and the camera's record tell it; they and the picture must be of one pair by their checksums. Triplets hold no
/// Sun: for folders of nadir and oblique pairs the authors' scripts have one a light, in the sky of the pair's site, which follows from
/// the poses of both views.
///
/// # Errors
/// [`Error::Io`] and [`Error::Format`] for records that are missing, broken or know no Sun; [`Error::Changed`] for a picture or
/// camera of another pair.
pub fn sun_of_picture(path: &Path) -> Result<Option<PictureSun>, Error> {
    let Some(file) = path.file_name().and_then(|name| name.to_str()) else { return Ok(None) };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let place = Place::folder(folder);
    if let Some((view, light_idx)) = own_name(file)
        && place.has(PAIR_NAME)
    {
        return of_own(&place, file, view, light_idx).map(Some);
    }
    let number = Path::new(file).file_stem().and_then(|stem| stem.to_str()).and_then(triplets::number_of);
    match number {
        Some(number) if Path::new(file).extension().is_some_and(|end| end.eq_ignore_ascii_case("jpg")) => {
            of_triplet(&place, folder, number)
        }
        _ => Ok(None),
    }
}

/// View and light in a name such as `a.l0.png`.
fn own_name(file: &str) -> Option<(ViewName, usize)> {
    let (_, rest) = file.split_once(".l")?;
    let light_idx: usize = rest.strip_suffix(".png")?.parse().ok()?;
    let view = ViewName::BOTH.into_iter().find(|view| image_name(*view, light_idx) == file)?;
    Some((view, light_idx))
}

fn of_own(place: &Place, file: &str, view: ViewName, light_idx: usize) -> Result<PictureSun, Error> {
    let files = Files { place, sums: None, verify: true };
    let record: PairRecord = files.json(PAIR_NAME)?;
    let unknown = |found: &str| {
        Error::unexpected(&place.path(PAIR_NAME), format!("the Sun of light {light_idx}"), found.to_owned())
    };
    let listed = |file: &str| {
        let lacks = || Error::unexpected(&place.path(PAIR_NAME), format!("`{file}` among its files"), "none");
        record.files.get(file).map(|_| ()).ok_or_else(lacks)
    };
    let camera_file = camera_name(view);
    listed(file)?;
    listed(&camera_file)?;
    let files = Files { sums: Some(&record.files), ..files };
    files.read(file)?;
    let camera: CameraRecord = files.json(&camera_file)?;
    let sun = record.suns.get(light_idx).ok_or_else(|| unknown("fewer lights"))?;
    let sun = sun.ok_or_else(|| unknown("null: whoever imported the pair did not know it"))?;
    if camera.world != record.body.frame {
        let (expected, path) =
            (format!("the world `{}` of pair.json", record.body.frame), place.path(&camera_file));
        return Err(Error::unexpected(&path, expected, camera.world));
    }
    Ok(PictureSun {
        direction_in_cam: rigid(&own::world_from_cam(&camera))?
            .inverse()
            .vector(&Vector3::from(sun.direction)),
        sigma_rad: 0.0,
        from: format!("light {light_idx} of `{}`", place.path(PAIR_NAME).display()),
        files: vec![place.path(PAIR_NAME), place.path(&camera_file)],
    })
}

fn of_triplet(place: &Place, folder: &Path, number: u64) -> Result<Option<PictureSun>, Error> {
    let Ok(whole) = folder.canonicalize() else { return Ok(None) };
    let scene = whole.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let (pair_id, light) = (number / (2 * LIGHTS_PER_PAIR), number / 2 % LIGHTS_PER_PAIR);
    let pair = triplets::scan(folder)?.into_iter().find(|pair| pair.pair_id == pair_id);
    let Some(pair) = pair
        .filter(|pair| pair.triplets(ViewName::A).chain(pair.triplets(ViewName::B)).any(|t| t.npz.is_some()))
    else {
        return Ok(None);
    };
    let rule = triplets::trajectory_of(scene).and_then(SiteRule::of_trajectory).ok_or_else(|| {
        let expected = "a folder of nadir or oblique pairs: of those the Suns are known, in the sky of a site that the poses tell";
        Error::unexpected(folder, expected, format!("`{scene}`"))
    })?;
    let settings = Settings::default();
    let Some(angles) = settings.suns.get(light as usize) else { return Ok(None) };
    let cameras = [ViewName::A, ViewName::B].map(|view| {
        let npz = pair.triplets(view).find_map(|triplet| triplet.npz.as_deref());
        let (path, expected) = (place.path(&pair.stem(light, view)), "an .npz under at least one light");
        npz.ok_or(Error::NoTruth { path, expected })
    });
    let [a, b] = cameras;
    let (a, b) = (a?, b?);
    let poses = [triplets::read_pose(place, a)?, triplets::read_pose(place, b)?];
    let site = photometric::site(rule, &poses, &settings.body)?;
    let own = &poses[(number % 2) as usize];
    Ok(Some(PictureSun {
        direction_in_cam: own.inverse().vector(&angles.direction(&settings.body, &site)),
        sigma_rad: SCRIPTS_SIGMA_RAD,
        from: format!("light {light} of the authors' scripts, for `{scene}`"),
        files: [a, b].map(|npz| place.path(npz)).to_vec(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::synthetic::{oblique_pair, write_own_pair};
    use crate::export::stereolunar::{ExportOptions, export_dataset};
    use crate::import::{ImportOptions, import_dataset};
    use crate::pair::{ImportedSuns, pair_folder, read_json};

    fn sun(path: &Path) -> PictureSun {
        sun_of_picture(path).unwrap().unwrap()
    }

    #[test]
    fn a_pair_folder_tells_the_suns_of_its_pictures() {
        let root = tempfile::tempdir().unwrap();
        let folder = write_own_pair(root.path(), 0, &oblique_pair(16));
        let record: PairRecord = read_json(&folder.join(PAIR_NAME)).unwrap();
        for view in ViewName::BOTH {
            let camera: CameraRecord = read_json(&folder.join(camera_name(view))).unwrap();
            let found = sun(&folder.join(image_name(view, 1)));
            let in_world = camera.world_from_cam().vector(&found.direction_in_cam);
            assert!((in_world - Vector3::from(record.suns[1].unwrap().direction)).norm() < 1e-12);
            assert!(
                found.from.starts_with("light 1 of `") && found.from.ends_with("pair.json`"),
                "{}",
                found.from
            );
        }
        // Not pictures of a pair: a mask, a name that is none, no record beside it.
        for name in ["a.l0.lit.png", "a.lx.png", "c.l0.png", "a.png"] {
            assert_eq!(sun_of_picture(&folder.join(name)).unwrap(), None, "{name}");
        }
        assert_eq!(sun_of_picture(Path::new("a.l0.png")).unwrap(), None);
    }

    #[test]
    fn a_picture_or_camera_of_another_pair_is_told() {
        let root = tempfile::tempdir().unwrap();
        let folder = write_own_pair(root.path(), 0, &oblique_pair(16));
        let [a, b] = [image_name(ViewName::A, 0), image_name(ViewName::B, 0)].map(|name| folder.join(name));
        std::fs::copy(folder.join("a.l0.lit.png"), &a).unwrap();
        assert!(matches!(sun_of_picture(&a), Err(Error::Changed { path, .. }) if path == a));
        let camera = folder.join(camera_name(ViewName::B));
        std::fs::copy(folder.join(camera_name(ViewName::A)), &camera).unwrap();
        assert!(matches!(sun_of_picture(&b), Err(Error::Changed { path, .. }) if path == camera));
        let unlisted = folder.join("a.l7.png");
        std::fs::copy(&b, &unlisted).unwrap();
        let error = sun_of_picture(&unlisted).unwrap_err().to_string();
        assert!(error.ends_with("expected `a.l7.png` among its files, found none"), "{error}");
        std::fs::write(folder.join(PAIR_NAME), "{}").unwrap();
        assert!(matches!(sun_of_picture(&b), Err(Error::Format { .. })));
    }

    /// Triplets `oblique/im_…` of one pair, and the same imported with the scripts' Suns and without.
    #[test]
    fn triplets_have_the_suns_that_an_import_gives_them() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        write_own_pair(&at("own"), 0, &oblique_pair(32));
        export_dataset(&at("own"), &at("triplets"), None, &ExportOptions::default(), |_, _| ()).unwrap();
        for (name, suns) in [("with", ImportedSuns::Scripts), ("without", ImportedSuns::Unknown)] {
            let options = ImportOptions { suns, ..ImportOptions::default() };
            import_dataset(&at("triplets"), &at(name), &options, &|_, _| ()).unwrap();
        }
        for (number, view, light) in [(0, ViewName::A, 0), (3, ViewName::B, 1)] {
            let found = sun(&at("triplets/oblique").join(format!("im_{number:05}.jpg")));
            let imported = sun(&pair_folder(&at("with"), 0).join(image_name(view, light)));
            let apart = found.direction_in_cam.angle(&imported.direction_in_cam);
            assert!(apart < 1e-5, "{apart}");
            assert_eq!(found.from, format!("light {light} of the authors' scripts, for `oblique`"));
            let unknown = sun_of_picture(&pair_folder(&at("without"), 0).join(image_name(view, light)));
            let error = unknown.unwrap_err().to_string();
            assert!(error.contains("expected the Sun of light") && error.contains("found null"), "{error}");
        }
        std::fs::rename(at("triplets/oblique"), at("triplets/dynamic")).unwrap();
        let error = sun_of_picture(&at("triplets/dynamic/im_00000.jpg")).unwrap_err().to_string();
        assert!(
            error.contains("expected a folder of nadir or oblique pairs") && error.ends_with("`dynamic`"),
            "{error}"
        );
        // Numbered pictures of others, without cameras.
        std::fs::create_dir(at("holiday")).unwrap();
        std::fs::write(at("holiday/im_00000.jpg"), b"").unwrap();
        assert_eq!(sun_of_picture(&at("holiday/im_00000.jpg")).unwrap(), None);
    }
}
