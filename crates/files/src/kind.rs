//! How a command knows its own work again: only that is replaced.

use crate::Error;
use crate::error::FOLDER_OF_OTHERS;
use crate::names::is_own_name;
use crate::record::{self, RUN_NAME};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes of a file that are looked at.
const HEAD: u64 = 512;

/// A kind of file.
#[derive(Debug, Clone, Copy)]
pub struct FileKind {
    /// Who writes it: the words after `selenograph`.
    pub command: &'static str,
    /// What it is, with its article: `a PNG picture`.
    pub what: &'static str,
    /// Whether a file that begins with these bytes (up to 512) is one.
    pub is_own: fn(&[u8]) -> bool,
}

impl FileKind {
    /// A GeoTIFF, by its first bytes.
    pub const fn tiff(command: &'static str) -> Self {
        const BEGIN: [&[u8]; 4] = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];
        Self {
            command,
            what: "a TIFF file",
            is_own: |head| BEGIN.iter().any(|begin| head.starts_with(begin)),
        }
    }

    /// A PNG picture, by its first bytes.
    pub const fn png(command: &'static str) -> Self {
        Self { command, what: "a PNG picture", is_own: |head| head.starts_with(b"\x89PNG\r\n\x1a\n") }
    }

    /// Fails unless what is there may be replaced. An empty file holds nothing that could be lost.
    pub(crate) fn check(&self, path: &Path) -> Result<(), Error> {
        let other = |found| Err(Error::OtherKind { path: path.to_owned(), expected: self.what, found });
        match std::fs::metadata(path) {
            Ok(found) if found.is_file() => {}
            Ok(found) if found.is_dir() => return other("a folder"),
            Ok(_) => return other("no file"),
            Err(_) => return other("a link to nothing"),
        }
        let mut head = Vec::new();
        let read = File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
        read.map_err(Error::io("read", path))?;
        if head.is_empty() || (self.is_own)(&head) { Ok(()) } else { other("another file") }
    }
}

/// A kind of folder.
#[derive(Debug, Clone, Copy)]
pub struct FolderKind {
    /// Who writes it: the words after `selenograph`.
    pub command: &'static str,
    /// What it is, with its article: `a reconstruction`.
    pub what: &'static str,
    /// Whether a folder is one, by the record in it.
    pub is_own: fn(&Path) -> bool,
    /// Every file that the command may write, below the folder: `#` stands for digits, `*` for anything within a name.
    pub names: &'static [&'static str],
    /// Folders in it that are of a kind of their own.
    pub parts: &'static [(&'static str, &'static FolderKind)],
}

impl FolderKind {
    /// Fails unless the folder is of this command's making.
    pub(crate) fn check(&self, folder: &Path) -> Result<(), Error> {
        let other = |found| Err(Error::OtherKind { path: folder.to_owned(), expected: self.what, found });
        match std::fs::metadata(folder) {
            Ok(found) if found.is_dir() => {}
            Ok(_) => return other("no folder"),
            Err(_) => return other("a link to nothing"),
        }
        if (self.is_own)(folder) { Ok(()) } else { other(FOLDER_OF_OTHERS) }
    }

    /// Fails if there is anything else in it, too.
    pub(crate) fn check_replaceable(&self, folder: &Path) -> Result<(), Error> {
        self.check(folder)?;
        match self.foreign(folder)? {
            None => Ok(()),
            Some(foreign) => Err(Error::Foreign { path: folder.to_owned(), expected: self.what, foreign }),
        }
    }

    /// The first file, in the order of names, that is not of this command's making: it has a name that no file of the command
    /// has, or one that the folder's record, where it names its files, does not name.
    fn foreign(&self, folder: &Path) -> Result<Option<PathBuf>, Error> {
        let named = record::read(&folder.join(RUN_NAME)).ok().and_then(|record| record.files);
        self.foreign_below(folder, Path::new(""), named.as_ref())
    }

    fn foreign_below(
        &self,
        folder: &Path,
        below: &Path,
        named: Option<&BTreeSet<String>>,
    ) -> Result<Option<PathBuf>, Error> {
        let path = folder.join(below);
        let entries = std::fs::read_dir(&path).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let mut entries = entries.map_err(Error::io("read", &path))?;
        entries.sort_by_key(std::fs::DirEntry::file_name);
        for entry in entries {
            let name = below.join(entry.file_name());
            if is_own_name(&entry.file_name().to_string_lossy()) {
                continue;
            }
            let is_folder = entry.file_type().map_err(Error::io("read", &path))?.is_dir();
            let part = self.parts.iter().find(|(part, _)| is_folder && Path::new(part) == name);
            let found = match (is_folder, part) {
                (_, Some((_, kind))) => kind.foreign(&folder.join(&name))?.map(|foreign| name.join(foreign)),
                (true, None) => self.foreign_below(folder, &name, named)?,
                (false, None) => (!self.owns(&name.to_string_lossy(), named)).then_some(name),
            };
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    fn owns(&self, name: &str, named: Option<&BTreeSet<String>>) -> bool {
        self.names.iter().any(|pattern| matches(pattern.as_bytes(), name.as_bytes()))
            && (name == RUN_NAME || named.is_none_or(|named| named.contains(name)))
    }
}

fn matches(pattern: &[u8], name: &[u8]) -> bool {
    let run = |is_in: fn(&u8) -> bool| name.iter().take_while(|byte| is_in(byte)).count();
    let some_of = |longest: usize, rest: &[u8]| (1..=longest).any(|len| matches(rest, &name[len..]));
    match pattern.split_first() {
        None => name.is_empty(),
        Some((b'#', rest)) => some_of(run(u8::is_ascii_digit), rest),
        Some((b'*', rest)) => some_of(run(|byte| *byte != b'/'), rest),
        Some((byte, rest)) => name.first() == Some(byte) && matches(rest, &name[1..]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_of_whole_names() {
        let is = |pattern: &str, name: &str| matches(pattern.as_bytes(), name.as_bytes());
        assert!(is("pictures/#.png", "pictures/000120.png") && is("a.l#.lit.png", "a.l12.lit.png"));
        assert!(!is("pictures/#.png", "pictures/mine.png") && !is("pictures/#.png", "pictures/1.png.old"));
        assert!(is("tables/*.csv", "tables/by_light.csv") && !is("*.csv", "tables/by_light.csv"));
        assert!(!is("*.csv", ".csv") && !is("", "x") && is("run.toml", "run.toml"));
    }
}
