//! Which picture of a list is meant: names in COLMAP's lists are paths below a folder that the list does not name.

use crate::Error;
use std::path::{Component, Path};

/// The pictures whose names fit the path of the wanted one best.
pub(super) struct Candidates<T> {
    /// Folders and name, the name first.
    wanted: Vec<String>,
    /// Parts that fit, counted from the file name; and whether that is all of the name in the list.
    best: (usize, bool),
    found: Vec<(String, T)>,
    /// Names that were offered.
    num_offered: usize,
}

/// The one that is meant.
pub(super) struct Chosen<T> {
    pub what: T,
    /// That only a part of its name fits.
    pub note: Option<String>,
}

impl<T> Candidates<T> {
    pub fn new(picture: &Path) -> Self {
        // Where there is no current folder, the parts that were given must do.
        let whole = std::path::absolute(picture).unwrap_or_else(|_| picture.to_owned());
        let parts = whole.components().filter_map(|part| match part {
            Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
            _ => None,
        });
        let mut wanted: Vec<String> = parts.collect();
        wanted.reverse();
        Self { wanted, best: (0, false), found: Vec::new(), num_offered: 0 }
    }

    pub fn offer(&mut self, name: &str, what: T) {
        self.num_offered += 1;
        let parts: Vec<&str> =
            name.rsplit(['/', '\\']).filter(|part| !part.is_empty() && *part != ".").collect();
        let fitting = parts.iter().zip(&self.wanted).take_while(|(a, b)| **a == b.as_str()).count();
        let fit = (fitting, fitting == parts.len());
        if fitting == 0 || fit < self.best {
            return;
        }
        if fit > self.best {
            self.best = fit;
            self.found.clear();
        }
        self.found.push((name.to_owned(), what));
    }

    /// The one that fits best.
    ///
    /// # Errors
    /// [`Error::Format`] if none fits, or several do equally well.
    pub fn only(mut self, list: &Path) -> Result<Chosen<T>, Error> {
        let name = self.wanted.first().map_or("", String::as_str);
        let bad = |expected: String, found: String| Error::Format { path: list.to_owned(), expected, found };
        match (self.found.pop(), self.found.last()) {
            (None, _) => Err(bad(format!("a picture `{name}`"), format!("{} others", self.num_offered))),
            (Some((second, _)), Some((first, _))) => {
                let found = format!("`{first}` and `{second}`, which fit its path equally well");
                Err(bad(format!("one picture `{name}`"), found))
            }
            (Some((found, what)), None) => {
                let note = (!self.best.1)
                    .then(|| format!("taken as the picture `{found}`, the only one of that name"));
                Ok(Chosen { what, note })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(picture: &str, names: &[&str]) -> Result<(usize, bool), String> {
        let mut candidates = Candidates::new(Path::new(picture));
        for (idx, name) in names.iter().enumerate() {
            candidates.offer(name, idx);
        }
        let found = candidates.only(Path::new("images.txt")).map_err(|e| e.to_string())?;
        Ok((found.what, found.note.is_some()))
    }

    #[test]
    fn the_longest_match_of_the_path_decides() {
        let rig = ["left/1.png", "right/1.png", "1.png"];
        assert_eq!(chosen("/data/right/1.png", &rig), Ok((1, false)));
        assert_eq!(chosen("/data/1.png", &rig), Ok((2, false)));
        assert_eq!(chosen("/data/right/1.png", &["up/right/1.png", "left/1.png"]), Ok((0, true)));
        assert_eq!(chosen("a b.png", &["x/a b.png"]), Ok((0, true)));
        let two = chosen("/data/1.png", &rig[..2]).unwrap_err();
        assert!(
            two.contains("left/1.png") && two.contains("right/1.png") && two.contains("images.txt"),
            "{two}"
        );
        assert!(chosen("2.png", &rig).unwrap_err().contains("3 others"));
        assert!(chosen("1.png", &["1.png", "1.png"]).is_err());
    }
}
