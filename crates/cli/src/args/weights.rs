//! `selenograph weights …`.

use super::Target;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// What to do with a network's weights.
#[derive(Debug, Subcommand)]
pub enum WeightsCommand {
    /// What a checkpoint holds: network, parameters, licence, and what does not fit
    #[command(after_help = "Example:\n  selenograph weights info checkpoint.pth --json")]
    Info(Info),
    /// A checkpoint of the MASt3R family into safetensors, with its configuration, licence and origin inside
    #[command(after_help = "Example:\n  selenograph weights convert checkpoint.pth --out mast3r.safetensors")]
    Convert(Convert),
    /// A network of random weights: right in form, without knowledge
    #[command(after_help = "Example:\n  selenograph weights random --preset tiny --out random.safetensors")]
    Random(Random),
}

/// What a checkpoint may leave open.
#[derive(Debug, Args)]
#[command(next_help_heading = "Reading")]
pub struct Heads {
    /// Attention heads of the encoder, where the file does not tell [default: one for 64 channels]
    #[arg(long, value_name = "N")]
    pub encoder_heads: Option<usize>,
    /// Attention heads of the decoders, where the file does not tell [default: one for 64 channels]
    #[arg(long, value_name = "N")]
    pub decoder_heads: Option<usize>,
}

/// `weights info`.
#[derive(Debug, Args)]
pub struct Info {
    /// PyTorch's .pth or safetensors; nothing in it is run. `builtin` is the network that comes with the program
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// How to read it.
    #[command(flatten)]
    pub heads: Heads,
}

/// `weights convert`.
#[derive(Debug, Args)]
pub struct Convert {
    /// PyTorch's .pth or safetensors; nothing in it is run
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// How to read it.
    #[command(flatten)]
    pub heads: Heads,
    /// What to store weights in
    #[arg(long, value_enum, default_value_t = StoreAs::Exact)]
    pub store_as: StoreAs,
    /// Licence of the weights [default: what the file states]
    #[arg(long, value_name = "TEXT")]
    pub license: Option<String>,
    /// Where the weights come from [default: this file's name, and what it says]
    #[arg(long, value_name = "TEXT")]
    pub origin: Option<String>,
    /// Longest side of the pictures that the network shall be given [default: what the file says]
    #[arg(long, value_name = "PX")]
    pub input_px: Option<usize>,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

/// Number formats of stored weights.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum StoreAs {
    /// bf16 stays, everything else becomes f32
    Exact,
    /// f32
    F32,
    /// bf16: half the size, 8 bits of precision
    Bf16,
    /// f16: half the size, 11 bits of precision, nothing above 65504
    F16,
}

/// `weights random`.
#[derive(Debug, Args)]
pub struct Random {
    /// mast3r-vitl (the published network, 2.8 GB), base, small or tiny; hybrid (with a convolutional stem)
    #[arg(long, value_name = "NAME")]
    pub preset: String,
    /// Another seed, other weights
    #[arg(long, value_name = "N", default_value_t = 1, env = "SELENOGRAPH_SEED", hide_env_values = true)]
    pub seed: u64,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}
