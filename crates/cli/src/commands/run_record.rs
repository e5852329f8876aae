//! `run.toml` of commands that read files and write a folder: what was run, on what, with which settings.

use anyhow::Context;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What is written.
#[derive(Serialize)]
pub struct RunRecord<'a, S: Serialize> {
    program: &'static str,
    version: &'static str,
    command: &'static str,
    started: String,
    threads: usize,
    /// Files that were read, with their BLAKE3.
    inputs: BTreeMap<String, String>,
    settings: &'a S,
}

impl<'a, S: Serialize> RunRecord<'a, S> {
    /// Of a command that began at `started`.
    pub fn new(
        command: &'static str,
        started: String,
        inputs: BTreeMap<String, String>,
        settings: &'a S,
    ) -> Self {
        Self {
            program: "selenograph",
            version: env!("CARGO_PKG_VERSION"),
            command,
            started,
            threads: rayon::current_num_threads(),
            inputs,
            settings,
        }
    }

    /// The file's text.
    ///
    /// # Errors
    /// If a setting cannot be written as TOML.
    pub fn to_toml(&self) -> anyhow::Result<String> {
        Ok(toml::to_string(self)?)
    }
}

/// Checksums of files, by the path that they were named with.
///
/// # Errors
/// A file that cannot be read.
pub fn checksums(files: &[PathBuf]) -> anyhow::Result<BTreeMap<String, String>> {
    files
        .iter()
        .map(|path| {
            let mut hasher = blake3::Hasher::new();
            let file =
                std::fs::File::open(path).with_context(|| format!("cannot read `{}`", path.display()))?;
            hasher.update_reader(file).with_context(|| format!("cannot read `{}`", path.display()))?;
            Ok((path.display().to_string(), hasher.finalize().to_hex().to_string()))
        })
        .collect()
}
