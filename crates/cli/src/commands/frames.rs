//! `frames`: squares of an image sequence, cut at regular intervals, and the pairs that they make.

use super::run_record::write_record;
use crate::args::frames::Frames;
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use anyhow::Context;
use indicatif::ProgressBar;
use selenograph_files::{FolderKind, record, regular};
use selenograph_geometry::{Camera, Distortion, PixelConvention};
use selenograph_raster::codec::picture::{GreyUnit, PictureFile, read_picture};
use selenograph_raster::codec::{Picture, png};
use selenograph_reconstruct::Error;
use selenograph_reconstruct::camera_file::{self, PictureSize};
use selenograph_reconstruct::exif;
use selenograph_reconstruct::frames::{FrameStream, Pairing, Window};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Folder of the pictures below the target.
const PICTURES: &str = "pictures";

static FRAMES: FolderKind = FolderKind {
    command: "frames",
    what: "a folder of frames",
    is_own: |folder| record::is_of(folder, FRAMES.command),
    names: &["run.toml", "pairs.csv", "camera.toml", "pictures/#.png"],
    parts: &[],
};

/// What was made.
#[derive(Serialize)]
struct Summary {
    num_frames: usize,
    num_pairs: usize,
    skipped: Vec<String>,
}

/// Pictures on their way into a folder.
struct Work<'a> {
    folder: &'a Path,
    pairing: Pairing,
    window: Window,
    camera_path: Option<&'a Path>,
    /// The camera of the window, known from the first frame on.
    camera: Option<Camera>,
    /// Where each written frame came from.
    written: BTreeMap<usize, String>,
    skipped: Vec<String>,
    /// What EXIF says of frames that are shown turned.
    turned: Vec<String>,
    bar: ProgressBar,
}

/// Cuts, writes, and lists the pairs.
///
/// # Errors
/// A source that cannot be read or is no sequence, frames of which not one pair can be made, a target that cannot be written.
pub fn run(args: &Frames, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = args.target.folder(&FRAMES)?;
    let pictures = draft.path().join(PICTURES);
    std::fs::create_dir(&pictures)
        .with_context(|| format!("cannot make the folder `{}`", pictures.display()))?;
    let window = Window { width: args.size, height: args.size, left_top: args.at };
    let mut work = Work {
        folder: draft.path(),
        pairing: Pairing::new(args.every, args.gap.unwrap_or(args.every))?,
        window,
        camera_path: args.camera.as_deref(),
        camera: None,
        written: BTreeMap::new(),
        skipped: Vec::new(),
        turned: Vec::new(),
        bar: ui.bar(0, "frames"),
    };
    if args.source.is_dir() {
        work.folder_of_pictures(&args.source)?;
    } else if args.source == Path::new("-") {
        work.stream(std::io::stdin().lock(), Path::new("stdin"))?;
    } else {
        let (file, _) = regular::open(&args.source).map_err(|error| match error.kind() {
            ErrorKind::InvalidInput => refuse(
                format!("cannot open `{}`: {error}", args.source.display()),
                "a stream comes in on standard input: `selenograph frames - … < PIPE`",
            ),
            _ => Error::io("open", &args.source)(error).into(),
        })?;
        work.stream(file, &args.source)?;
    }
    work.bar.finish_and_clear();
    if let Some(first) = work.turned.first() {
        ui.note(&format!("{first} (so in {} of the frames)", work.turned.len()));
    }
    let summary = work.finish(args)?;
    draft.commit()?;
    if ui.json {
        ui.data_json(&summary)?;
    }
    let out = args.target.out.display();
    ui.note(&format!("{} pairs of {} frames: {out}/pairs.csv", summary.num_pairs, summary.num_frames));
    Ok(if summary.skipped.is_empty() { Outcome::Done } else { Outcome::Skipped(summary.skipped) })
}

impl Work<'_> {
    /// Every frame of a stream, one in memory at a time.
    fn stream(&mut self, source: impl Read, origin: &Path) -> anyhow::Result<()> {
        let mut stream = FrameStream::open(source, origin).map_err(|error| match &error {
            Error::Format { .. } => refuse(
                error.to_string(),
                format!(
                    "`ffmpeg -i {} -vf format=gray -f yuv4mpegpipe - | selenograph frames - …` hands the frames of a video over",
                    origin.display()
                ),
            ),
            _ => error.into(),
        })?;
        let (bar, pairing) = (self.bar.clone(), self.pairing);
        let mut next = || {
            stream.next_wanted(|frame_idx| {
                bar.set_position(frame_idx as u64 + 1);
                pairing.wants(frame_idx)
            })
        };
        while let Some((frame_idx, frame)) = next() {
            match frame {
                Ok(picture) => self.keep(frame_idx, &picture, &format!("frame {frame_idx}"))?,
                Err(error @ Error::Io { .. }) => return Err(error.into()),
                Err(error) => self.skipped.push(format!("frame {frame_idx}: {error}")),
            }
        }
        Ok(())
    }

    /// Every picture of a folder, in the order of their names with numbers counted as numbers.
    fn folder_of_pictures(&mut self, folder: &Path) -> anyhow::Result<()> {
        let mut names: Vec<String> = Vec::new();
        for entry in std::fs::read_dir(folder).map_err(Error::io("read", folder))? {
            let entry = entry.map_err(Error::io("read", folder))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            if entry.path().is_file() && !name.starts_with('.') {
                names.push(name);
            }
        }
        names.sort_by_cached_key(|name| natural_order(name));
        self.bar.set_length(names.len() as u64);
        let pairing = self.pairing;
        for (frame_idx, name) in names.iter().enumerate().filter(|(idx, _)| pairing.wants(*idx)) {
            self.bar.set_position(frame_idx as u64 + 1);
            match read_picture(&folder.join(name)) {
                Ok(file) => {
                    // The crops are PNG without tags: what is not said here is lost.
                    let tags = exif::read(&file.data_path)?.unwrap_or_default();
                    if tags.is_mirrored() {
                        self.skipped.push(format!(
                            "{name}: it is stored mirrored (EXIF orientation {})",
                            tags.orientation
                        ));
                        continue;
                    }
                    if let Some(turned) = tags.turned() {
                        self.turned.push(format!("`{name}`: {turned}"));
                    }
                    match levels(&file) {
                        Some(picture) => self.keep(frame_idx, &picture, name)?,
                        None => {
                            self.skipped.push(format!("{name}: its levels have no white to be written with"));
                        }
                    }
                }
                Err(error) => self.skipped.push(format!("{name}: {error}")),
            }
        }
        Ok(())
    }

    /// Cuts and writes one frame; one that the window does not fit is skipped.
    fn keep(&mut self, frame_idx: usize, frame: &Picture, source: &str) -> anyhow::Result<()> {
        let cut = match self.window.cut(frame) {
            Ok(cut) => cut,
            Err(error) => {
                self.skipped.push(format!("{source}: {error}"));
                return Ok(());
            }
        };
        if let (Some(path), None) = (self.camera_path, &self.camera) {
            let (width, height) = frame.size();
            let whole = camera_file::read(path, &PictureSize::new(width, height))?.camera;
            self.camera = Some(self.window.camera(&whole)?);
        }
        let bytes = match &cut {
            Picture::Grey16(raster) => png::encode_grey16(raster)?,
            Picture::Grey8(raster) => png::encode_grey8(raster)?,
            Picture::Rgb8(raster) => png::encode_rgb8(raster)?,
        };
        let path = self.picture(frame_idx);
        selenograph_files::write(&path, bytes)?;
        self.written.insert(frame_idx, source.to_owned());
        Ok(())
    }

    fn picture(&self, frame_idx: usize) -> PathBuf {
        self.folder.join(PICTURES).join(file_name(frame_idx))
    }

    /// Lists the pairs, and takes away the frames that found no partner.
    fn finish(&mut self, args: &Frames) -> anyhow::Result<Summary> {
        let pairs = self.pairing.pairs(&self.written.keys().copied().collect());
        if pairs.is_empty() {
            let why = match self.skipped.first() {
                Some(first) => format!("; the first of {} skipped: {first}", self.skipped.len()),
                None => String::new(),
            };
            return Err(refuse(
                format!(
                    "no pair can be made of `{}`: {} usable frames{why}",
                    args.source.display(),
                    self.written.len()
                ),
                "a smaller --every or --gap, or a smaller --size, may help",
            ));
        }
        let alone: Vec<usize> = self
            .written
            .keys()
            .copied()
            .filter(|idx| !pairs.iter().flatten().any(|used| used == idx))
            .collect();
        for frame_idx in alone {
            std::fs::remove_file(self.picture(frame_idx))?;
            self.written.remove(&frame_idx);
        }
        let mut table = String::from("pair_id,a,b,frame_a,frame_b,source_a,source_b\n");
        for (pair_id, [a, b]) in pairs.iter().enumerate() {
            let source = |idx: &usize| quoted(self.written.get(idx).map_or("", String::as_str));
            table += &format!(
                "{pair_id},{PICTURES}/{},{PICTURES}/{},{a},{b},{},{}\n",
                file_name(*a),
                file_name(*b),
                source(a),
                source(b)
            );
        }
        selenograph_files::write(&self.folder.join("pairs.csv"), table)?;
        if let Some(camera) = &self.camera {
            let text = toml::to_string(&CameraKeys::from(camera))?;
            selenograph_files::write(&self.folder.join("camera.toml"), text)?;
        }
        let settings = Settings { source: &args.source, pairing: self.pairing, window: self.window };
        let summary = Summary {
            num_frames: self.written.len(),
            num_pairs: pairs.len(),
            skipped: std::mem::take(&mut self.skipped),
        };
        let read: Vec<PathBuf> = args.camera.iter().cloned().collect();
        write_record(self.folder, FRAMES.command, &read, &settings, Some(&summary))?;
        Ok(summary)
    }
}

/// Settings for the record.
#[derive(Serialize)]
struct Settings<'a> {
    source: &'a Path,
    pairing: Pairing,
    window: Window,
}

/// A camera in the keys of a camera file.
#[derive(Serialize)]
struct CameraKeys {
    format: &'static str,
    version: u32,
    width_px: usize,
    height_px: usize,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    pixel_convention: PixelConvention,
    distortion: Distortion,
}

impl From<&Camera> for CameraKeys {
    fn from(camera: &Camera) -> Self {
        Self {
            format: "selenograph.camera",
            version: 1,
            width_px: camera.width,
            height_px: camera.height,
            fx_px: camera.fx,
            fy_px: camera.fy,
            cx_px: camera.cx,
            cy_px: camera.cy,
            pixel_convention: PixelConvention::Corner,
            distortion: camera.distortion,
        }
    }
}

fn file_name(frame_idx: usize) -> String {
    format!("{frame_idx:06}.png")
}

/// Names by their words, and numbers in them by their value: `frame_9` comes before `frame_10`.
fn natural_order(name: &str) -> Vec<(String, u64)> {
    let mut parts: Vec<(String, u64)> = vec![Default::default()];
    let mut in_number = false;
    for character in name.chars() {
        let digit = character.to_digit(10);
        if digit.is_none() && in_number {
            parts.push(Default::default());
        }
        in_number = digit.is_some();
        if let Some((word, number)) = parts.last_mut() {
            match digit {
                Some(digit) => *number = number.saturating_mul(10).saturating_add(u64::from(digit)),
                None => word.push(character),
            }
        }
    }
    parts
}

/// Stored levels again, 8 or 16 bits; `None` where a level of 1 is not white. What the file leaves open is black.
fn levels(file: &PictureFile) -> Option<Picture> {
    let GreyUnit::White(white) = file.unit else { return None };
    // Integers of more than 16 bits keep their order and their white.
    let white = white.min(f64::from(u16::MAX));
    let stored = |level: &f32| (f64::from(*level) * white).round();
    // A NaN becomes 0 in the conversion.
    Some(if white <= 255.0 {
        Picture::Grey8(file.grey.map(|level| stored(level) as u8))
    } else {
        Picture::Grey16(file.grey.map(|level| stored(level) as u16))
    })
}

/// A field of a table: quoted where it must be.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = ["b2", "a10.png", "a9.png", "a9b1.png"];
        names.sort_by_cached_key(|name| natural_order(name));
        assert_eq!(names, ["a9.png", "a9b1.png", "a10.png", "b2"]);
        assert_eq!(quoted("a,\"b\""), "\"a,\"\"b\"\"\"");
    }
}
