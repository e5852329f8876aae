//! Can our reflectance and Sun reproduce the given pictures of a dataset from its own depth?
//!
//! The surface comes from the depth (smoothed within its half-float steps), the Sun from the campaign's convention in
//! the east-north-up frame of the pair's site, the light from our law with attached shadows; one number per picture
//! is fitted, its gain. A wrong Sun azimuth, a mirrored frame, another law or a cosine too many show at once; a shift
//! of half a pixel does not.

pub mod dequantise;
pub mod fit;
pub mod report;
mod settings;
pub mod surface;

pub use report::{ImageFit, Report, Skipped};
pub use settings::{Limits, Settings};

use crate::Error;
use crate::pair::{Trajectory, ViewName};
pub use crate::plan::SunAngles;
use crate::stored::triplets::{read_picture, trajectory_of};
use crate::stored::{self, ReadOptions, StoredPair, Triplet, TripletPair, grey8};
use fit::Agreement;
use selenograph_geometry::{Body, BodyFixed, Cam, Geodetic, Matrix2, Point3, Rigid3, Vector2, Vector3};
use selenograph_raster::Raster;
use selenograph_raster::codec::png;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use surface::ViewSurface;

/// Where a pair's site is, for the Sun's angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SiteRule {
    /// Straight below the first camera (nadir pairs).
    BelowFirstCamera,
    /// Where the two optical axes pass each other (oblique pairs).
    AxesCrossing,
}

impl SiteRule {
    /// The rule of a trajectory. Dynamic pairs have none: their cameras look past the site.
    pub fn of_trajectory(trajectory: Trajectory) -> Option<Self> {
        match trajectory {
            Trajectory::Nadir => Some(Self::BelowFirstCamera),
            Trajectory::Oblique => Some(Self::AxesCrossing),
            _ => None,
        }
    }
}

/// A pair with its surfaces worked out: lighting it is cheap.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Number of the pair in its folder.
    pub pair_id: u64,
    /// The site of the Sun's angles.
    pub site: Geodetic,
    /// What A and B see.
    pub surfaces: [ViewSurface; 2],
    /// The pictures.
    pub pictures: Vec<ScenePicture>,
}

/// A given picture of a [`Scene`].
#[derive(Debug, Clone)]
pub struct ScenePicture {
    /// Its file.
    pub path: PathBuf,
    /// Number of its light.
    pub light_idx: usize,
    /// 0 for A, 1 for B.
    pub view_idx: usize,
    /// Grey levels.
    pub levels: Raster<u8>,
}

/// Gets a picture, its rendering, and how well they agree.
pub type Look<'a> = dyn FnMut(&ScenePicture, &Raster<f64>, &ImageFit) -> Result<(), Error> + 'a;

impl Scene {
    /// Reads a pair's depth, cameras and pictures. Depth and camera may come from any light; what else is missing is
    /// noted in `skipped`.
    ///
    /// # Errors
    /// [`Error`] for files that are broken, and if a view has no depth or no camera under any light.
    pub fn read(
        stored: &StoredPair,
        pair: &TripletPair,
        rule: SiteRule,
        settings: &Settings,
        skipped: &mut Vec<Skipped>,
    ) -> Result<Self, Error> {
        let open = stored.open()?;
        let [a, b] = ViewName::BOTH.map(|view| ViewSurface::new(&open.raw_view(view)?));
        let surfaces = [a?, b?];
        let site = site(rule, &surfaces.each_ref().map(|s| s.world_from_cam), &settings.body)?;
        let mut pictures = Vec::new();
        for (&light_idx, views) in &pair.lights {
            for (view, triplet) in ViewName::BOTH.into_iter().zip(views) {
                let Some(Triplet { jpg: Some(jpg), .. }) = triplet else {
                    let path = PathBuf::from(format!("{}.jpg", pair.stem(light_idx, view)));
                    skipped.push(Skipped { path, reason: "the picture is missing".into() });
                    continue;
                };
                let facets = &surfaces[view as usize].facets;
                let picture = read_picture(&stored.place, jpg, (facets.width, facets.height))?;
                pictures.push(ScenePicture {
                    path: stored.place.path(jpg),
                    light_idx: light_idx as usize,
                    view_idx: view as usize,
                    levels: grey8(&picture),
                });
            }
        }
        Ok(Self { pair_id: pair.pair_id, site, surfaces, pictures })
    }

    /// Renders one of the pictures with a Sun and a law given as `shade(mu0, mu, cos_phase)`.
    pub fn render(
        &self,
        picture: &ScenePicture,
        sun: SunAngles,
        settings: &Settings,
        shade: impl Fn(f64, f64, f64) -> f64 + Sync,
    ) -> Raster<f64> {
        let (azimuth, elevation) = (sun.azimuth_deg.to_radians(), sun.elevation_deg.to_radians());
        let to_sun = settings.body.direction(&self.site, azimuth, elevation);
        fit::render(&self.surfaces[picture.view_idx], &to_sun, settings.psf_sigma_px, shade)
    }

    /// Compares every picture that has a Sun in the settings; `look` gets each with its rendering.
    ///
    /// # Errors
    /// Those of `look`.
    pub fn fit(
        &self,
        settings: &Settings,
        skipped: &mut Vec<Skipped>,
        look: &mut Look<'_>,
    ) -> Result<Vec<ImageFit>, Error> {
        let mut fits = Vec::new();
        for picture in &self.pictures {
            let mut skip =
                |reason: &str| skipped.push(Skipped { path: picture.path.clone(), reason: reason.into() });
            let Some(&sun) = settings.suns.get(picture.light_idx) else {
                skip("the settings have no Sun for its light");
                continue;
            };
            let rendered = self.render(picture, sun, settings, |mu0, mu, cos_phase| {
                settings.brdf.radiance_factor(mu0, mu, cos_phase, 1.0)
            });
            let Some(Agreement { pearson, rmse_levels, gain, num_pixels }) =
                fit::compare(&rendered, &picture.levels)
            else {
                skip("the picture or its rendering is uniform");
                continue;
            };
            let fit = ImageFit {
                image: picture.path.clone(),
                pair_id: self.pair_id,
                light_idx: picture.light_idx,
                view_idx: picture.view_idx,
                sun,
                pearson,
                rmse_levels,
                gain,
                num_pixels,
            };
            look(picture, &rendered, &fit)?;
            fits.push(fit);
        }
        Ok(fits)
    }
}

/// The place whose east, north and up the Sun's angles are measured in.
pub fn site(rule: SiteRule, poses: &[Rigid3<BodyFixed, Cam>; 2], body: &Body) -> Result<Geodetic, Error> {
    let point = match rule {
        SiteRule::BelowFirstCamera => poses[0].origin(),
        SiteRule::AxesCrossing => {
            let [a, b] = poses.each_ref().map(Rigid3::origin);
            let [u, v] = poses.each_ref().map(|pose| pose.vector(&Vector3::z()));
            // Least |a + s u − b − t v|.
            let normal = Matrix2::new(u.dot(&u), -u.dot(&v), -u.dot(&v), v.dot(&v));
            let right = Vector2::new(u.dot(&(b - a)), -v.dot(&(b - a)));
            let st = normal.lu().solve(&right).ok_or(Error::Geometry(
                selenograph_geometry::Error::Degenerate { what: "the optical axes of the two cameras" },
            ))?;
            let (on_a, on_b) = (a + u * st.x, b + v * st.y);
            Point3::from((on_a.coords + on_b.coords) / 2.0)
        }
    };
    Ok(Geodetic { height_m: 0.0, ..body.place(&point) })
}

/// Renders every picture of a folder of triplets (or of the folders directly inside it) and compares; with `pictures`, an
/// existing folder, each is written there beside its rendering. Folders whose site cannot be told from their name, and
/// pairs without depth or camera, are skipped; `progress` hears of each pair, done and in all.
///
/// # Errors
/// [`Error::Format`] if there are no triplets, [`Error`] for files that are broken or cannot be written.
pub fn check(
    root: &Path,
    settings: &Settings,
    pictures: Option<&Path>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Report, Error> {
    let (mut images, mut skipped) = (Vec::new(), Vec::new());
    let found = stored::find(root, ReadOptions::with_convention(settings.k_convention))?;
    let triplets: Vec<_> = found.iter().filter_map(|stored| Some((stored, stored.triplets()?))).collect();
    if triplets.is_empty() {
        let expected = "triplets `im_NNNNN.jpg/.exr/.npz` here or in folders below";
        return Err(Error::unexpected(root, expected, "none"));
    }
    let mut jobs = Vec::new();
    for pairs in triplets.chunk_by(|(a, _), (b, _)| a.place == b.place) {
        let place = &pairs[0].0.place;
        match trajectory_of(&place.name()).and_then(SiteRule::of_trajectory) {
            Some(rule) => jobs.extend(pairs.iter().map(|(stored, pair)| (*stored, *pair, rule))),
            None => {
                let reason = "the site is known for folders named `nadir…` and `oblique…` (or `pitch…`) only";
                skipped.push(Skipped { path: place.root().to_owned(), reason: reason.into() });
            }
        }
    }
    for (done, (stored, pair, rule)) in jobs.iter().enumerate() {
        if has_geometry(stored, pair, &mut skipped) {
            let scene = Scene::read(stored, pair, *rule, settings, &mut skipped)?;
            let mut look = |picture: &ScenePicture, rendered: &Raster<f64>, fit: &ImageFit| match pictures {
                Some(out) => write_beside(out, picture, rendered, fit.gain),
                None => Ok(()),
            };
            images.extend(scene.fit(settings, &mut skipped, &mut look)?);
        }
        progress(done + 1, jobs.len());
    }
    Ok(Report::new(images, skipped, settings))
}

/// Whether both views have depth and a camera under at least one light; what has not is noted.
fn has_geometry(stored: &StoredPair, pair: &TripletPair, skipped: &mut Vec<Skipped>) -> bool {
    let mut whole = true;
    for view in ViewName::BOTH {
        let has = |of: fn(&Triplet) -> bool| pair.triplets(view).any(of);
        let missing = [("exr", has(|t| t.exr.is_some())), ("npz", has(|t| t.npz.is_some()))]
            .map(|(e, is)| (!is).then_some(e));
        for extension in missing.into_iter().flatten() {
            skipped.push(Skipped {
                path: stored.place.path(&format!("{}.{extension}", pair.stem(0, view))),
                reason: "the file is missing under every light: its pair is left out".into(),
            });
            whole = false;
        }
    }
    whole
}

/// Writes `<scene>_<image>.png`.
fn write_beside(out: &Path, picture: &ScenePicture, rendered: &Raster<f64>, gain: f64) -> Result<(), Error> {
    let part =
        |name: Option<&std::ffi::OsStr>| name.map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let scene = part(picture.path.parent().and_then(Path::file_name));
    let path = out.join(format!("{scene}_{}.png", part(picture.path.file_stem())));
    let bytes = png::encode_grey8(&side_by_side(&picture.levels, rendered, gain))?;
    Ok(selenograph_files::write(&path, bytes)?)
}

/// A given picture, its rendering and their difference (doubled, about mid-grey) side by side, for looking.
pub fn side_by_side(levels: &Raster<u8>, rendered: &Raster<f64>, gain: f64) -> Raster<u8> {
    let (width, height) = (levels.width, levels.height);
    Raster::from_fn(3 * width, height, |x, y| {
        let at = (x % width, y);
        let (given, ours) = (f64::from(levels[at]), gain * rendered[at]);
        // A cast from NaN gives 0: holes are black.
        match x / width {
            0 => given as u8,
            1 => ours as u8,
            _ => (128.0 + 2.0 * (ours - given)) as u8,
        }
    })
}

#[cfg(test)]
mod cast_shadow;
#[cfg(test)]
mod tests;
