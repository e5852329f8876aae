//! A checkpoint of the field into a file of ours: safetensors with the configuration, licence and provenance in its header.

use super::{Checkpoint, key};
use crate::element::ElementType;
use crate::layout::TensorSpec;
use crate::safetensors::{Entry, Writer};
use crate::{Error, NetworkConfig};
use std::collections::BTreeMap;
use std::path::Path;

/// What weights are stored in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Storing {
    /// bf16 stays bf16, everything else becomes f32, so that nothing is rounded.
    #[default]
    Exact,
    /// f32.
    F32,
    /// bf16, rounded to the nearest: half the size.
    Bf16,
    /// f16, rounded to the nearest: half the size, for weights within ±65504.
    F16,
}

/// How to convert.
#[derive(Debug, Clone, Default)]
pub struct ConvertOptions {
    /// What to store the weights in.
    pub storing: Storing,
    /// The weights' licence, where the file does not state it or states it wrongly.
    pub license: Option<String>,
    /// Where the weights come from, in place of the file's name and what it says.
    pub provenance: Option<String>,
    /// Longest side of pictures that the network shall be given, in place of what the file says.
    pub input_px: Option<usize>,
}

impl Checkpoint {
    /// Writes the network's tensors, each once, to a safetensors file. What the network does not have is left out, what
    /// the file does not have stays absent. `progress` is told after each tensor how many values it had.
    ///
    /// # Errors
    /// [`Error::Misfit`] for tensors of another shape or there twice; [`Error::Io`].
    pub fn convert(
        &self,
        target: &Path,
        options: &ConvertOptions,
        progress: &mut dyn FnMut(usize),
    ) -> Result<(), Error> {
        if !self.fit.wrong_shape.is_empty() || !self.fit.duplicated.is_empty() {
            self.check_complete()?;
        }
        let present: Vec<&TensorSpec> =
            self.layout.owned().filter(|spec| self.tensor(&spec.name).is_some()).collect();
        let entries = present.iter().map(|spec| self.entry(spec, options.storing)).collect();
        let mut metadata = header(&self.config, options.license.as_deref().or(self.license()));
        let provenance = options.provenance.clone().unwrap_or_else(|| self.describe_origin());
        metadata.insert(key::PROVENANCE.into(), provenance);
        if let Some(side) = options.input_px.or(self.input_px()) {
            metadata.insert(key::INPUT_PX.into(), side.to_string());
        }
        if let Some(model) = self.model_string() {
            metadata.insert(key::MODEL_STRING.into(), model.to_owned());
        }
        let mut writer = Writer::create(target, entries, &metadata)?;
        let mut values = Vec::new();
        for spec in present {
            self.read_into(&spec.name, &mut values)?;
            writer.write(&values)?;
            progress(values.len());
        }
        writer.finish()
    }

    fn entry(&self, spec: &TensorSpec, storing: Storing) -> Entry {
        let is_bf16 = self.tensor(&spec.name).is_some_and(|tensor| tensor.element == ElementType::Bf16);
        let element = match storing {
            Storing::Bf16 => ElementType::Bf16,
            Storing::F16 => ElementType::F16,
            Storing::Exact if is_bf16 => ElementType::Bf16,
            Storing::Exact | Storing::F32 => ElementType::F32,
        };
        Entry { name: spec.name.clone(), element, shape: spec.shape.clone() }
    }

    fn describe_origin(&self) -> String {
        let name = self.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let mut origin = format!("converted from {name} ({} bytes)", self.file_bytes());
        for sentence in self.provenance().into_iter().chain(self.notes.iter().map(String::as_str)) {
            origin.push_str("; ");
            origin.push_str(sentence);
        }
        origin
    }
}

/// The texts that every file of ours has.
pub fn header(config: &NetworkConfig, license: Option<&str>) -> BTreeMap<String, String> {
    let config = serde_json::to_string(config).unwrap_or_default();
    let mut metadata =
        BTreeMap::from([(key::CONFIG.to_owned(), config), ("format".to_owned(), "pt".to_owned())]);
    if let Some(license) = license {
        metadata.insert(key::LICENSE.into(), license.to_owned());
    }
    metadata
}
