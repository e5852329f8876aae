//! Checkpoints: which tensors a file holds, which network they make, and their values, read when asked for.
//!
//! Nothing in a file is executed. Reading keeps one tensor in memory at a time; a file is never mapped, so that one that
//! is cut while it is read is an error and not a crash.

mod convert;
mod deduce;
mod fit;
mod pytorch;
mod tensor_file;
mod tensors;

pub use convert::{ConvertOptions, Storing, header};
pub use deduce::HeadCounts;
pub use fit::{Expected, Fit, Found, Mismatch, PartFit};
pub use tensor_file::TensorFile;
pub use tensors::StoredTensor;

use crate::layout::{DECODER_1, DECODER_2, Layout, Purpose};
use crate::model_string::{Family, ModelString};
use crate::safetensors;
use crate::zip::ReadAt;
use crate::{Error, NetworkConfig};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tensors::Source;

/// Keys of a safetensors header that are ours.
pub mod key {
    /// The network's dimensions, JSON.
    pub(crate) const CONFIG: &str = "config";
    /// Longest side of the pictures that it was trained on, pixels.
    pub const INPUT_PX: &str = "input_px";
    /// Under which licence the weights are.
    pub(crate) const LICENSE: &str = "license";
    /// Where they come from.
    pub const PROVENANCE: &str = "provenance";
    /// The reference's description of the network.
    pub(crate) const MODEL_STRING: &str = "model_string";
}

/// Kinds of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Written by `torch.save`, version 1.6 or later.
    Pytorch,
    /// Safetensors.
    Safetensors,
}

/// What a file holds, before it is compared with a network.
#[derive(Debug, Default)]
struct Contents {
    tensors: BTreeMap<String, StoredTensor>,
    twice: Vec<String>,
    model_string: Option<String>,
    metadata: BTreeMap<String, String>,
    notes: Vec<String>,
}

/// A checkpoint that was opened: names, shapes, configuration. Values are read by [`Checkpoint::read`].
#[derive(Debug)]
pub struct Checkpoint {
    path: PathBuf,
    source: Source,
    format: Format,
    tensors: BTreeMap<String, StoredTensor>,
    /// Name in the network → name in the file, where they differ.
    renamed: BTreeMap<String, String>,
    family: Family,
    config: NetworkConfig,
    layout: Layout,
    fit: Fit,
    model_string: Option<String>,
    metadata: BTreeMap<String, String>,
    notes: Vec<String>,
}

impl Checkpoint {
    /// Opens a checkpoint whose file says how many heads its attention has, or where 64 channels a head fit.
    ///
    /// # Errors
    /// As [`Checkpoint::open_with`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        Self::open_with(path, HeadCounts::default())
    }

    /// Opens a checkpoint. Shapes do not tell numbers of heads; `heads` gives them where the file does not either.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::NotACheckpoint`], [`Error::Truncated`], [`Error::Malformed`]; [`Error::Refused`] for a
    /// pickle that would run code; [`Error::ModelString`]; [`Error::Unknown`] for numbers of heads; [`Error::Config`].
    pub fn open_with(path: &Path, heads: HeadCounts) -> Result<Self, Error> {
        Self::of_source(Source::open(path)?, path, heads)
    }

    /// A checkpoint that came with the program, under a name in place of a path.
    ///
    /// # Errors
    /// As [`Checkpoint::open`].
    pub fn of_bytes(name: &str, bytes: &'static [u8]) -> Result<Self, Error> {
        Self::of_source(Source::bytes(bytes), Path::new(name), HeadCounts::default())
    }

    fn of_source(source: Source, path: &Path, heads: HeadCounts) -> Result<Self, Error> {
        let (format, contents) = read_contents(&source, path)?;
        let Contents { tensors, twice, model_string, metadata, mut notes } = contents;
        let deduced = match metadata.get(key::CONFIG) {
            Some(text) => deduce::stored(text, path)?,
            None => {
                let model = model_string.as_deref().map(ModelString::parse).transpose()?;
                deduce::deduce(&tensors, model.as_ref(), heads, path)?
            }
        };
        notes.extend(deduced.notes);
        let layout = Layout::new(&deduced.config)?;
        let renamed = renames(&tensors, &layout, &mut notes);
        let fit = Fit::new(&layout, &tensors, &renamed, twice);
        Ok(Self {
            path: path.to_owned(),
            source,
            format,
            tensors,
            renamed,
            family: deduced.family,
            config: deduced.config,
            layout,
            fit,
            model_string,
            metadata,
            notes,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What kind of file it is.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Size of the file, bytes.
    pub fn file_bytes(&self) -> u64 {
        self.source.len()
    }

    /// The family that the tensors belong to.
    pub fn family(&self) -> Family {
        self.family
    }

    /// Dimensions of the network.
    pub fn config(&self) -> &NetworkConfig {
        &self.config
    }

    /// Names and shapes that the network needs.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// How the file's tensors and the network's agree.
    pub fn fit(&self) -> &Fit {
        &self.fit
    }

    /// The model string, where the file has one.
    pub fn model_string(&self) -> Option<&str> {
        self.model_string.as_deref()
    }

    /// The licence of the weights, where the file states it.
    pub fn license(&self) -> Option<&str> {
        self.metadata.get(key::LICENSE).map(String::as_str)
    }

    /// Longest side of the pictures that it was trained on, where its file states it.
    pub fn input_px(&self) -> Option<usize> {
        self.metadata.get(key::INPUT_PX)?.parse().ok().filter(|side| *side > 0)
    }

    /// Where the weights come from, where the file states it.
    pub fn provenance(&self) -> Option<&str> {
        self.metadata.get(key::PROVENANCE).map(String::as_str)
    }

    /// What was assumed, ignored or done to the file's tensors, a sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Names of the file's tensors, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// A tensor of the file by its name in the network, or by its own.
    pub fn tensor(&self, name: &str) -> Option<&StoredTensor> {
        self.tensors.get(self.renamed.get(name).map_or(name, String::as_str))
    }

    /// Values of a tensor, row-major, as f32.
    ///
    /// # Errors
    /// [`Error::MissingTensor`], [`Error::Io`].
    pub fn read(&self, name: &str) -> Result<Vec<f32>, Error> {
        let mut values = Vec::new();
        self.read_into(name, &mut values)?;
        Ok(values)
    }

    /// [`Checkpoint::read`] into a vector that keeps its memory; whatever it held is replaced.
    ///
    /// # Errors
    /// As [`Checkpoint::read`].
    pub(crate) fn read_into(&self, name: &str, values: &mut Vec<f32>) -> Result<(), Error> {
        let missing = || Error::MissingTensor { path: self.path.clone(), name: name.to_owned() };
        let tensor = self.tensor(name).ok_or_else(missing)?;
        tensor.read_into(&self.source, &self.path, values)
    }

    /// Shape and values of a tensor, as executors ask for them.
    ///
    /// # Errors
    /// As [`Checkpoint::read`].
    pub fn read_with_shape(&self, name: &str) -> Result<(Vec<usize>, Vec<f32>), Error> {
        let values = self.read(name)?;
        Ok((self.tensor(name).map(|tensor| tensor.shape.clone()).unwrap_or_default(), values))
    }

    /// Makes sure that every tensor that a forward pass reads is there, once, in its shape.
    ///
    /// # Errors
    /// [`Error::Misfit`] names the first of those that are not.
    pub fn check_complete(&self) -> Result<(), Error> {
        match self.fit.faults() {
            Some(what) => Err(Error::Misfit { path: self.path.clone(), what }),
            None => Ok(()),
        }
    }
}

/// Tells the kinds of files apart by their first bytes, and reads what they hold.
fn read_contents(source: &Source, path: &Path) -> Result<(Format, Contents), Error> {
    let not_one = |found: &str| Error::NotACheckpoint {
        path: path.to_owned(),
        expected: "PyTorch's zip format or safetensors",
        found: found.to_owned(),
    };
    if source.len() < 9 {
        return Err(not_one(if source.len() == 0 { "an empty file" } else { "a few bytes" }));
    }
    let mut head = [0; 9];
    source.read_at(0, &mut head).map_err(Error::io("read", path))?;
    match head {
        [b'P', b'K', 3 | 5, 4 | 6, ..] => Ok((Format::Pytorch, pytorch::read(source, path)?)),
        [.., b'{'] => Ok((Format::Safetensors, read_safetensors(source, path)?)),
        [0x80, 2..=5, ..] => Err(not_one("a bare pickle, as PyTorch wrote before version 1.6")),
        [b'v', b'e', b'r', b's', b'i', b'o', b'n', ..] => {
            Err(not_one("a text file that stands for a larger one (Git LFS)"))
        }
        _ => Err(not_one("other bytes")),
    }
}

fn read_safetensors(source: &Source, path: &Path) -> Result<Contents, Error> {
    let header = safetensors::read_header(source, path)?;
    let mut contents = Contents {
        model_string: header.metadata.get(key::MODEL_STRING).cloned(),
        metadata: header.metadata,
        ..Contents::default()
    };
    for (entry, span) in header.tensors {
        let name = entry.name;
        let tensor = StoredTensor::contiguous(entry.element, entry.shape, span);
        if contents.tensors.insert(name.clone(), tensor).is_some() {
            contents.twice.push(name);
        }
    }
    Ok(contents)
}

/// Names under which the network asks for tensors that the file calls otherwise.
fn renames(
    tensors: &BTreeMap<String, StoredTensor>,
    layout: &Layout,
    notes: &mut Vec<String>,
) -> BTreeMap<String, String> {
    let mut renamed = BTreeMap::new();
    // Each pair of names stands for one tensor: whichever the file has serves both.
    for spec in layout.specs() {
        if let Purpose::AliasOf(owner) = &spec.purpose {
            match (tensors.contains_key(owner), tensors.contains_key(&spec.name)) {
                (true, false) => drop(renamed.insert(spec.name.clone(), owner.clone())),
                (false, true) => drop(renamed.insert(owner.clone(), spec.name.clone())),
                _ => {}
            }
        }
    }
    let has = |prefix: &str| tensors.keys().any(|name| name.starts_with(prefix));
    if has(DECODER_1) && !has(DECODER_2) {
        for name in tensors.keys() {
            if let Some(rest) = name.strip_prefix(DECODER_1) {
                renamed.insert(format!("{DECODER_2}{rest}"), name.clone());
            }
        }
        notes.push("there is one decoder (`dec_blocks`): the second starts as its copy".into());
    }
    renamed
}
