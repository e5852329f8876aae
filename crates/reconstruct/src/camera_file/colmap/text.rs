//! COLMAP's lists as text.

use super::{CameraRow, Image, Unexpected, checked, model_named};
use crate::{Error, input_file};
use selenograph_files::regular;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Longest line of a list of images, bytes: two hundred thousand points.
const LONGEST_LINE: u64 = 1 << 24;

/// Whether the first line that is no comment reads `1 PINHOLE 512 …`.
pub(in crate::camera_file) fn is_camera_list(text: &str) -> bool {
    lines(text).next().is_some_and(|line| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let is_name = |word: &str| {
            let rest = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
            word.starts_with(|c: char| c.is_ascii_uppercase()) && word.chars().all(rest)
        };
        words.len() >= 5 && words[0].parse::<u64>().is_ok() && is_name(words[1])
    })
}

fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'))
}

/// The cameras of a list.
pub(super) fn cameras(text: &str) -> Result<Vec<CameraRow>, Unexpected> {
    lines(text).map(camera).collect()
}

fn camera(line: &str) -> Result<CameraRow, Unexpected> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [id, name, width, height, params @ ..] = words.as_slice() else {
        return Err(("a line `id MODEL width height parameters`".to_owned(), format!("`{line}`")));
    };
    let model = model_named(name)?;
    let size =
        |word: &str| word.parse::<usize>().map_err(|_| ("a size in pixels".to_owned(), format!("`{word}`")));
    let number = |word: &&str| word.parse::<f64>().map_err(|_| ("a number".to_owned(), format!("`{word}`")));
    let id = id.parse().map_err(|_| ("a camera's number".to_owned(), format!("`{id}`")))?;
    let params = checked(model, params.iter().map(number).collect::<Result<_, _>>()?)?;
    Ok(CameraRow { id, model, width: size(width)?, height: size(height)?, params })
}

/// Tells of every picture of a list: two lines each, of which the second, its points, may be empty.
pub(super) fn images(path: &Path, each: &mut dyn FnMut(&str, Image)) -> Result<(), Error> {
    let (list, _) = regular::open(path).map_err(Error::io("read", path))?;
    let mut reader = BufReader::new(list);
    let bad = |expected: &str, found: &str| {
        let found: String = found.chars().take(80).collect();
        Error::Format { path: path.to_owned(), expected: expected.to_owned(), found: format!("`{found}`") }
    };
    while let Some(line) = next_line(&mut reader, path)? {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let expected = "`id qw qx qy qz tx ty tz camera name`";
        let (name, image) = image(line).ok_or_else(|| bad(expected, line))?;
        each(name, image);
        if let Some(points) = next_line(&mut reader, path)?
            && !points.split_whitespace().all(|word| word.parse::<f64>().is_ok())
        {
            return Err(bad(&format!("the points of `{name}`, or an empty line,"), points.trim()));
        }
    }
    Ok(())
}

fn next_line(reader: &mut impl BufRead, path: &Path) -> Result<Option<String>, Error> {
    let mut bytes = Vec::new();
    let read = reader.take(LONGEST_LINE).read_until(b'\n', &mut bytes).map_err(Error::io("read", path))?;
    if read as u64 == LONGEST_LINE {
        let expected = format!("lines of at most {} MiB", LONGEST_LINE >> 20);
        return Err(Error::Format { path: path.to_owned(), expected, found: "a longer one".to_owned() });
    }
    if read == 0 { Ok(None) } else { input_file::text_of(path, &bytes).map(Some) }
}

/// Name and pose; a name may hold spaces.
fn image(line: &str) -> Option<(&str, Image)> {
    let mut rest = line;
    let mut word = || {
        let trimmed = rest.trim_start();
        let (word, after) = trimmed.split_once(char::is_whitespace)?;
        rest = after;
        Some(word)
    };
    word()?.parse::<u64>().ok()?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = word()?.parse().ok()?;
    }
    let camera_id = word()?.parse().ok()?;
    let [w, x, y, z, tx, ty, tz] = numbers;
    let name = rest.trim();
    (!name.is_empty()).then_some((name, Image { wxyz: [w, x, y, z], translation: [tx, ty, tz], camera_id }))
}
