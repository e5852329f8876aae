//! Files that stand beside each other and name each other.

use std::path::{Path, PathBuf};

/// The label of a raw image: the same name with another ending, of any case.
pub(crate) fn label_beside(path: &Path) -> Option<PathBuf> {
    let stem = path.file_stem()?.to_str()?;
    let label = ["lbl", "xml"].iter().find_map(|ending| find_beside(path, &format!("{stem}.{ending}")))?;
    (label != path).then_some(label)
}

/// The file of that name in the folder of `path`, whatever its case; the same case is preferred.
pub(crate) fn find_beside(path: &Path, name: &str) -> Option<PathBuf> {
    // Labels made on other systems may name folders; archives are rarely unpacked with them.
    let name = name.rsplit(['/', '\\']).next().filter(|name| !name.is_empty())?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let exact = folder.join(name);
    if exact.is_file() {
        return Some(exact);
    }
    let mut matches: Vec<PathBuf> = std::fs::read_dir(folder)
        .ok()?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|p| p.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.eq_ignore_ascii_case(name)))
        .filter(|p| p.is_file())
        .collect();
    matches.sort();
    matches.into_iter().next()
}
