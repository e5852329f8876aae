//! What `torch.save` writes: a zip archive with a pickle of the tensors' descriptions and an entry for each storage.

use super::Contents;
use super::tensors::{Source, StoredTensor};
use crate::Error;
use crate::pickle::{self, Fault, Object, Objects, Tensor};
use crate::zip::{self, ReadAt, Span};
use std::collections::BTreeMap;
use std::path::Path;

/// Longest pickle that is read; that of a full training checkpoint takes about 1.5 MB.
const MAX_PICKLE: u64 = 16 << 20;
/// Longest name of a tensor.
const MAX_NAME: usize = 256;
/// Keys under which training programs keep the tensors.
const NESTED: [&str; 2] = ["model", "state_dict"];
/// What training programs keep beside them.
const IGNORED: [&str; 2] = ["optimizer", "scaler"];
/// What `torch.nn.DataParallel` puts before each name.
const PARALLEL: &str = "module.";
const ALLOWED: &str = "tensors, numbers, texts, collections of them and argparse.Namespace are read";

pub(super) fn read(source: &Source, path: &Path) -> Result<Contents, Error> {
    let entries = zip::entries(source, path)?;
    let archive = Archive::new(source, path, &entries)?;
    let objects = archive.objects()?;
    let root = objects.root();
    let (state, nested) = state_dict(&objects, root).ok_or_else(|| Error::NotACheckpoint {
        path: path.to_owned(),
        expected: "a dictionary of tensors, or one under `model`",
        found: "a pickle of something else".into(),
    })?;
    let mut contents = Contents::default();
    for (name, object) in objects.items(state) {
        let Object::Tensor(tensor) = object else { continue };
        if name.len() > MAX_NAME {
            return Err(Error::malformed(
                path,
                "a tensor's name",
                "256 bytes at most",
                name.len().to_string(),
            ));
        }
        let stored = archive.stored(name, tensor)?;
        if contents.tensors.insert(name.to_owned(), stored).is_some() {
            contents.twice.push(name.to_owned());
        }
    }
    if let Some(args) = objects.value(root, "args")
        && let Some(Object::Text(model)) = objects.value(args, "model")
    {
        contents.model_string = Some(model.clone());
    }
    if nested {
        contents.notes.extend(left_aside(&objects, root));
    }
    strip_parallel(&mut contents);
    Ok(contents)
}

fn state_dict<'a>(objects: &'a Objects, root: &'a Object) -> Option<(&'a Object, bool)> {
    let holds_tensors =
        |object: &Object| objects.items(object).any(|(_, value)| matches!(value, Object::Tensor(_)));
    let nested =
        NESTED.iter().filter_map(|name| objects.value(root, name)).find(|state| holds_tensors(state));
    nested.map(|state| (state, true)).or_else(|| holds_tensors(root).then_some((root, false)))
}

fn left_aside(objects: &Objects, root: &Object) -> Vec<String> {
    let mut notes = Vec::new();
    for name in IGNORED {
        if objects.value(root, name).is_some_and(|value| *value != Object::None) {
            notes.push(format!("`{name}` of a training run: not read"));
        }
    }
    if let Some(Object::Int(epoch)) = objects.value(root, "epoch") {
        notes.push(format!("of a training run, epoch {epoch}"));
    }
    notes
}

fn strip_parallel(contents: &mut Contents) {
    if !contents.tensors.is_empty() && contents.tensors.keys().all(|name| name.starts_with(PARALLEL)) {
        let tensors = std::mem::take(&mut contents.tensors);
        let strip = |(name, tensor): (String, StoredTensor)| (name[PARALLEL.len()..].to_owned(), tensor);
        contents.tensors = tensors.into_iter().map(strip).collect();
        contents.notes.push("`module.` before each name: left out".into());
    }
}

struct Archive<'a> {
    source: &'a Source,
    path: &'a Path,
    entries: &'a BTreeMap<String, Span>,
    /// Folder of the entries inside the archive, with its slash.
    folder: &'a str,
}

impl<'a> Archive<'a> {
    fn new(source: &'a Source, path: &'a Path, entries: &'a BTreeMap<String, Span>) -> Result<Self, Error> {
        let mut pickles = entries.keys().filter_map(|name| name.strip_suffix("data.pkl"));
        let folder = pickles.find(|folder| folder.ends_with('/') && folder.matches('/').count() == 1);
        let folder = folder.ok_or_else(|| Error::NotACheckpoint {
            path: path.to_owned(),
            expected: "an archive with NAME/data.pkl",
            found: "a zip archive of something else".into(),
        })?;
        let archive = Self { source, path, entries, folder };
        if let Some(order) = archive.entry("byteorder") {
            let order = archive.bytes(order, 16)?;
            if order != b"little" {
                let found = String::from_utf8_lossy(&order).escape_default().to_string();
                return Err(Error::malformed(path, "byte order", "little", found));
            }
        }
        Ok(archive)
    }

    fn entry(&self, name: &str) -> Option<Span> {
        self.entries.get(&format!("{}{name}", self.folder)).copied()
    }

    fn bytes(&self, span: Span, limit: u64) -> Result<Vec<u8>, Error> {
        if span.len > limit {
            return Err(Error::Refused {
                path: self.path.to_owned(),
                what: "one of its descriptions takes",
                found: format!("{} bytes", span.len),
                allowed: "pickles up to 16 MiB are read",
            });
        }
        let mut bytes = vec![0; span.len as usize];
        self.source.read_at(span.start, &mut bytes).map_err(Error::io("read", self.path))?;
        Ok(bytes)
    }

    fn objects(&self) -> Result<Objects, Error> {
        let bytes = match self.entry("data.pkl") {
            Some(span) => self.bytes(span, MAX_PICKLE)?,
            None => Vec::new(),
        };
        pickle::load(&bytes).map_err(|fault| match fault {
            Fault::Cut => Error::Truncated {
                path: self.path.to_owned(),
                what: "its pickle".into(),
                expected: bytes.len() as u64 + 1,
                found: bytes.len() as u64,
            },
            Fault::Refused { what, found } => {
                Error::Refused { path: self.path.to_owned(), what, found, allowed: ALLOWED }
            }
            Fault::Wrong { expected, found } => Error::malformed(self.path, "pickle", expected, found),
        })
    }

    fn stored(&self, name: &str, tensor: &Tensor) -> Result<StoredTensor, Error> {
        let storage = &tensor.storage;
        let what = || format!("tensor `{name}`");
        let entry = self.entry(&format!("data/{}", storage.key)).ok_or_else(|| {
            let key = storage.key.escape_default();
            Error::malformed(self.path, what(), format!("its storage `data/{key}`"), "none")
        })?;
        let expected = storage.len.checked_mul(storage.kind.size() as u64);
        if expected != Some(entry.len) {
            let expected = format!("a storage of {} {}", storage.len, storage.kind.name());
            return Err(Error::malformed(self.path, what(), expected, format!("{} bytes", entry.len)));
        }
        Ok(StoredTensor::view(
            storage.kind,
            tensor.shape.clone(),
            entry,
            tensor.offset,
            tensor.strides.clone(),
        ))
    }
}
