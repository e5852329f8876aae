//! `weights info|convert|random`: checkpoints, looked at, converted, made up.

use super::network::builtin;
use crate::args::weights::{Convert, Heads, Info, Random, StoreAs};
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_files::FileKind;
use selenograph_network::checkpoint::{ConvertOptions, Fit, Format, HeadCounts, Storing};
use selenograph_network::layout::{Layout, Part};
use selenograph_network::{Checkpoint, NetworkConfig, Preset, random};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Names of a list that are printed; `--json` has all.
const LISTED: usize = 8;

#[derive(Serialize)]
struct Report<'a> {
    file: &'a Path,
    format: Format,
    file_bytes: u64,
    family: &'static str,
    license: Option<&'a str>,
    provenance: Option<&'a str>,
    model_string: Option<&'a str>,
    parameters: usize,
    tensors: usize,
    /// Values of each number format, tensors that share bytes counted each.
    values_by_type: BTreeMap<&'static str, usize>,
    complete: bool,
    config: &'a NetworkConfig,
    fit: &'a Fit,
    notes: &'a [String],
}

impl<'a> Report<'a> {
    fn new(checkpoint: &'a Checkpoint) -> Self {
        let mut values_by_type = BTreeMap::new();
        for tensor in checkpoint.names().filter_map(|name| checkpoint.tensor(name)) {
            *values_by_type.entry(tensor.element.name()).or_insert(0) += tensor.len();
        }
        Self {
            file: checkpoint.path(),
            format: checkpoint.format(),
            file_bytes: checkpoint.file_bytes(),
            family: checkpoint.family().name(),
            license: checkpoint.license(),
            provenance: checkpoint.provenance(),
            model_string: checkpoint.model_string(),
            parameters: checkpoint.layout().num_parameters(),
            tensors: checkpoint.names().count(),
            values_by_type,
            complete: checkpoint.fit().faults().is_none(),
            config: checkpoint.config(),
            fit: checkpoint.fit(),
            notes: checkpoint.notes(),
        }
    }
}

/// safetensors: the length of the header, 64 bits, and the header as JSON.
const fn checkpoint_of(command: &'static str) -> FileKind {
    FileKind { command, what: "a safetensors file", is_own: |head| head.get(8) == Some(&b'{') }
}

/// Tells what a checkpoint holds.
///
/// # Errors
/// A file that is no checkpoint, or one whose network cannot be known.
pub fn info(args: &Info, ui: &Ui) -> anyhow::Result<Outcome> {
    let checkpoint = open(&args.file, &args.heads)?;
    let report = Report::new(&checkpoint);
    if ui.json {
        ui.data_json(&report)?;
    } else {
        ui.data(text(&report).trim_end())?;
    }
    Ok(if report.complete { Outcome::Done } else { Outcome::Faulty })
}

/// Converts a checkpoint to safetensors.
///
/// # Errors
/// A file that is no checkpoint, tensors of other shapes, a target that cannot be written.
pub fn convert(args: &Convert, ui: &Ui) -> anyhow::Result<Outcome> {
    let checkpoint = open(&args.file, &args.heads)?;
    let target = args.target.file(&checkpoint_of("weights convert"))?;
    let storing = match args.store_as {
        StoreAs::Exact => Storing::Exact,
        StoreAs::F32 => Storing::F32,
        StoreAs::Bf16 => Storing::Bf16,
        StoreAs::F16 => Storing::F16,
    };
    if args.input_px == Some(0) {
        return Err(refuse("--input-px 0: no such picture", "512 is what most networks are given"));
    }
    let options = ConvertOptions {
        storing,
        license: args.license.clone(),
        provenance: args.origin.clone(),
        input_px: args.input_px,
    };
    let bar = ui.bar(checkpoint.layout().num_parameters() as u64, "parameters");
    checkpoint.convert(target.path(), &options, &mut |count| bar.inc(count as u64))?;
    bar.finish_and_clear();
    for sentence in checkpoint.notes() {
        ui.note(sentence);
    }
    if options.license.is_none() && checkpoint.license().is_none() {
        ui.note("the file states no licence: --license writes one into the result");
    }
    if let Some(faults) = checkpoint.fit().faults() {
        ui.note(&format!("incomplete: {faults}"));
    }
    ui.note(&format!("{}: {}", checkpoint.family().name(), args.target.out.display()));
    Ok(Outcome::Done)
}

/// Makes up a network.
///
/// # Errors
/// An unknown preset, a target that cannot be written.
pub fn random(args: &Random, ui: &Ui) -> anyhow::Result<Outcome> {
    let config = Preset::from_name(&args.preset)?.config();
    let num_parameters = Layout::new(&config)?.num_parameters();
    let target = args.target.file(&checkpoint_of("weights random"))?;
    let bar = ui.bar(num_parameters as u64, "parameters");
    random::write(&config, args.seed, target.path(), &mut |count| bar.inc(count as u64))?;
    bar.finish_and_clear();
    let grouped = grouped(num_parameters);
    ui.note(&format!("{grouped} parameters, seed {}: {}", args.seed, args.target.out.display()));
    Ok(Outcome::Done)
}

fn open(file: &Path, heads: &Heads) -> anyhow::Result<Checkpoint> {
    let heads = HeadCounts { encoder: heads.encoder_heads, decoder: heads.decoder_heads };
    builtin::open(Some(file), heads)
}

fn text(report: &Report) -> String {
    let config = report.config;
    let mut out = String::new();
    let mut line = |key: &str, value: String| {
        // A `String` takes every write.
        let _ = writeln!(out, "{key:<16}{value}");
    };
    let format = match report.format {
        Format::Pytorch => "PyTorch",
        Format::Safetensors => "safetensors",
    };
    let types: Vec<String> =
        report.values_by_type.iter().map(|(name, count)| format!("{} {name}", grouped(*count))).collect();
    line(
        "file",
        format!("{} ({format}, {} bytes)", report.file.display(), grouped(report.file_bytes as usize)),
    );
    line(
        "network",
        format!("{}, {}", report.family, if report.complete { "complete" } else { "incomplete" }),
    );
    line("licence", report.license.unwrap_or("not stated in the file: ask where it comes from").into());
    if let Some(provenance) = report.provenance {
        line("origin", provenance.into());
    }
    line("parameters", grouped(report.parameters));
    line("tensors", format!("{}: {}", report.tensors, types.join(", ")));
    for (name, size) in [("encoder", config.encoder), ("decoders", config.decoder)] {
        line(name, format!("{} channels, {} blocks, {} heads", size.dim, size.num_blocks, size.num_heads));
    }
    let [a, b, c, d] = config.dpt_dims;
    line("point heads", format!("{a}, {b}, {c}, {d} channels, fused in {}", config.dpt_fusion_dim));
    line("descriptors", config.descriptor_dim.map_or("none".into(), |dim| format!("{dim} channels")));
    for (part, fit) in &report.fit.parts {
        let share = if fit.found == fit.needed {
            String::new()
        } else {
            format!(" (of {} needed)", grouped(fit.needed))
        };
        line(&format!("  {}", part_name(*part)), format!("{:>11}{share}", grouped(fit.found)));
    }
    let fit = report.fit;
    let shape = |name: &str, shape: &[usize]| format!("{name} {shape:?}");
    let needed = fit.missing.iter().filter(|m| m.needed).map(|m| shape(&m.name, &m.shape)).collect();
    let unread = fit.missing.iter().filter(|m| !m.needed).map(|m| shape(&m.name, &m.shape)).collect();
    let wrong =
        fit.wrong_shape.iter().map(|w| format!("{} {:?}, expected {:?}", w.name, w.found, w.expected));
    let extra = fit.extra.iter().map(|found| shape(&found.name, &found.shape)).collect();
    list(&mut out, "missing", needed);
    list(&mut out, "missing, unread", unread);
    list(&mut out, "wrong shape", wrong.collect());
    list(&mut out, "duplicated", fit.duplicated.clone());
    list(&mut out, "left over", extra);
    list(&mut out, "note", report.notes.to_vec());
    out
}

fn list(out: &mut String, key: &str, items: Vec<String>) {
    let more = items.len().saturating_sub(LISTED);
    for item in &items[..items.len() - more] {
        let _ = writeln!(out, "{key:<16}{item}");
    }
    if more > 0 {
        let _ = writeln!(out, "{key:<16}and {more} more (--json has all)");
    }
}

fn part_name(part: Part) -> &'static str {
    match part {
        Part::MaskToken => "mask token",
        Part::Stem => "stem",
        Part::PatchEmbed => "patches",
        Part::Encoder => "encoder",
        Part::EncoderNorm => "encoder norm",
        Part::DecoderEmbed => "to decoder",
        Part::Decoder1 => "decoder a",
        Part::Decoder2 => "decoder b",
        Part::DecoderNorm => "decoder norm",
        Part::Head1Points => "points a",
        Part::Head1Descriptors => "descriptors a",
        Part::Head2Points => "points b",
        Part::Head2Descriptors => "descriptors b",
    }
}

/// Digits in groups of three.
fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (idx, digit) in digits.chars().enumerate() {
        if idx > 0 && (digits.len() - idx).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}
