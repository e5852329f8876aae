//! What the user can do about an error.

use crate::exit::{Refusal, io_kind};
use crate::target;
use std::io::ErrorKind;

/// The hint for an error, from the first cause that has one.
pub fn hint(error: &anyhow::Error) -> Option<String> {
    let from_cause = error.chain().find_map(|cause| {
        if let Some(refusal) = cause.downcast_ref::<Refusal>() {
            return Some(refusal.hint.clone());
        }
        if let Some(error) = cause.downcast_ref::<selenograph_files::Error>() {
            return files(error);
        }
        if let Some(error) = cause.downcast_ref::<selenograph_raster::Error>() {
            return raster(error);
        }
        if let Some(error) = cause.downcast_ref::<selenograph_terrain::Error>() {
            return terrain(error);
        }
        if let Some(error) = cause.downcast_ref::<selenograph_render::Error>() {
            return render(error);
        }
        if let Some(error) = cause.downcast_ref::<selenograph_dataset::Error>() {
            return dataset(error);
        }
        if let Some(error) = cause.downcast_ref::<selenograph_reconstruct::Error>() {
            return reconstruct(error);
        }
        if let Some(error) = cause.downcast_ref::<selenograph_predict::Error>() {
            return predict(error);
        }
        if let Some(error) = cause.downcast_ref::<selenograph_network::Error>() {
            return network(error);
        }
        if let Some(error) = cause.downcast_ref::<selenograph_evaluate::Error>() {
            return evaluate(error);
        }
        #[cfg(feature = "train")]
        if let Some(error) = cause.downcast_ref::<selenograph_train::Error>() {
            return train(error);
        }
        #[cfg(feature = "train")]
        if let Some(error) = cause.downcast_ref::<selenograph_model::Error>() {
            return error.hint().map(str::to_owned);
        }
        cause.downcast_ref::<selenograph_geometry::Error>().and_then(geometry)
    });
    from_cause.or_else(|| io(io_kind(error)?))
}

fn some(text: &str) -> Option<String> {
    Some(text.to_owned())
}

fn files(error: &selenograph_files::Error) -> Option<String> {
    use selenograph_files::Error;
    match error {
        Error::Full { .. } => Some(no_room()),
        Error::Io { source, .. } => io(source.kind()),
        _ => error.hint().map(str::to_owned),
    }
}

/// What is kept is said only where something is.
fn no_room() -> String {
    let kept = target::kept().map_or_else(String::new, |kept| format!(": {kept}"));
    format!("free some space and run the same command again{kept}")
}

fn geometry(error: &selenograph_geometry::Error) -> Option<String> {
    use selenograph_geometry::Error;
    match error {
        Error::Camera { .. } => some(
            "a camera has a field of view between 0 and 180 degrees and K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels",
        ),
        Error::UnknownProjection { .. } | Error::ProjectionParameter { .. } => some(
            "known are polar stereographic, equirectangular, geographic and orthographic maps of a sphere, for example `+proj=stere +lat_0=-90 +R=1737400`",
        ),
        Error::OtherSphere { radius_m, beside_radius_m, .. } => {
            let more_m = radius_m - beside_radius_m;
            Some(format!(
                "bring the first onto the sphere of the other: `gdalwarp -t_srs \"+proj=… +R={beside_radius_m}\" in.tif warped.tif` moves the map, `gdal_calc.py -A warped.tif --calc=\"A+({more_m})\" --outfile=out.tif` its heights (metres), which count from the sphere"
            ))
        }
        Error::Time { .. } => some(
            "times are UTC in ISO 8601: `1971-07-31T14:12:05.5`, or with the day of the year `1971-212T14:12:05.5`",
        ),
        Error::TimeOutside { .. } => some(
            "give the Sun itself: `--sun-a` and `--sun-b`, as AZ,EL or as a vector X,Y,Z in the camera's axes",
        ),
        _ => None,
    }
}

fn raster(error: &selenograph_raster::Error) -> Option<String> {
    use selenograph_raster::Error;
    match error {
        Error::Files(error) => files(error),
        Error::Io { source, .. } => io(source.kind()),
        Error::Malformed { .. } => some("the file is damaged: fetch or write it again"),
        Error::UnknownFormat { .. } => {
            some("is it the right file? `gdal_translate in out.tif` turns most other formats into GeoTIFF")
        }
        _ => error.hint().map(str::to_owned),
    }
}

fn terrain(error: &selenograph_terrain::Error) -> Option<String> {
    use selenograph_terrain::Error;
    match error {
        Error::Raster(error) => raster(error),
        Error::Geometry(error) => geometry(error),
        Error::Files(error) => files(error),
        Error::Io { source, .. } => io(source.kind()),
        _ => error.hint().map(str::to_owned),
    }
}

fn render(error: &selenograph_render::Error) -> Option<String> {
    use selenograph_render::Error;
    match error {
        Error::CameraBelowGround { .. } => {
            some("raise the camera: --altitude-m is over the ground at the place looked at")
        }
        Error::Setting { .. } => some("`selenograph render --help` tells what each setting may be"),
        _ => None,
    }
}

fn dataset(error: &selenograph_dataset::Error) -> Option<String> {
    use selenograph_dataset::Error;
    match error {
        Error::Raster(error) => raster(error),
        Error::Geometry(error) => geometry(error),
        Error::Files(error) => files(error),
        Error::Io { source, .. } => io(source.kind()),
        Error::Changed { .. } => some(
            "take the file from a copy, or make the pair again; what evaluates, trains and exports takes --no-verify",
        ),
        Error::Campaign { nearest: Some(nearest), .. } => Some(format!("did you mean `{nearest}`?")),
        Error::Value { key, .. } if key.starts_with("loader.") => {
            some("`selenograph train run … --dry-run` prints every key with its value")
        }
        Error::Value { .. } | Error::Campaign { .. } => {
            some("`selenograph config show` prints every key with its value and where it came from")
        }
        Error::Format { .. } => some("check the path; docs/formats.md tells what each file and folder holds"),
        Error::Contradiction { .. } => some("leave one of the two out"),
        Error::UnknownPreset { .. } => some("`selenograph presets` lists them"),
        Error::OtherCampaign { .. } => some("pass another --out, or --force to start this one anew"),
        Error::Unusable { .. } => some(
            "`selenograph data check` says what is wrong with a dataset; `train run --skip-faulty` learns without such pairs",
        ),
        _ => None,
    }
}

fn reconstruct(error: &selenograph_reconstruct::Error) -> Option<String> {
    use selenograph_reconstruct::Error;
    match error {
        Error::Raster(error) => raster(error),
        Error::Geometry(error) => geometry(error),
        Error::Files(error) => files(error),
        Error::Io { source, .. } => io(source.kind()),
        Error::Format { .. } => some("docs/formats.md tells what each file holds"),
        Error::Value { .. } => some("`selenograph reconstruct --help` tells what each setting may be"),
        Error::Undetermined { .. } => error.hint().map(str::to_owned).or_else(|| {
            some("`selenograph reconstruct --help` lists what may be known of the pictures; give it, or leave out what asks for it")
        }),
        _ => error.hint().map(str::to_owned),
    }
}

fn network(error: &selenograph_network::Error) -> Option<String> {
    use selenograph_network::Error;
    match error {
        Error::Geometry(error) => geometry(error),
        Error::Files(error) => files(error),
        Error::Io { source, .. } => io(source.kind()),
        _ => error.hint().map(str::to_owned),
    }
}

fn predict(error: &selenograph_predict::Error) -> Option<String> {
    use selenograph_predict::Error;
    match error {
        Error::Network(error) => network(error),
        _ => error.hint().map(str::to_owned),
    }
}

fn evaluate(error: &selenograph_evaluate::Error) -> Option<String> {
    use selenograph_evaluate::Error;
    match error {
        Error::Dataset(error) => dataset(error),
        Error::Raster(error) => raster(error),
        Error::Geometry(error) => geometry(error),
        Error::Predict(error) => predict(error),
        Error::Reconstruct(error) => reconstruct(error),
        Error::Files(error) => files(error),
        Error::Io { source, .. } => io(source.kind()),
        _ => error.hint(),
    }
}

#[cfg(feature = "train")]
fn train(error: &selenograph_train::Error) -> Option<String> {
    use selenograph_train::Error;
    error.hint().map(str::to_owned).or_else(|| match error {
        Error::Network(error) => network(error),
        Error::Dataset(error) => dataset(error),
        Error::Files(error) => files(error),
        Error::Io { source, .. } => io(source.kind()),
        _ => None,
    })
}

fn io(kind: ErrorKind) -> Option<String> {
    match kind {
        ErrorKind::NotFound => some("check the path; relative paths start at the current folder"),
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem | ErrorKind::AlreadyExists => {
            some("choose a folder that you may write to with --out")
        }
        ErrorKind::InvalidInput | ErrorKind::FileTooLarge => {
            some("is it the right path? What a pipe or a device gives can be written into a file first")
        }
        ErrorKind::NotADirectory => some("a folder is expected here, not a file"),
        ErrorKind::IsADirectory => some("a file is expected here, not a folder"),
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Some(no_room()),
        _ => None,
    }
}
