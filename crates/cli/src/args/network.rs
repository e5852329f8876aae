//! What runs a network and how pictures become its input: for every command that has one.

use super::weights::Heads;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// The network of the methods `mast3r` and `mast3r-stereo`.
#[derive(Debug, Args)]
#[command(next_help_heading = "Network (methods mast3r and mast3r-stereo)")]
pub struct NetworkChoice {
    /// Its weights: a checkpoint of the MASt3R or DUSt3R family, .pth or safetensors [default: `builtin`, a small network for
    /// matches that comes with the program]
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
    /// What runs it: cpu; cuda:N, wgpu:N and burn-cpu where they were built in (`selenograph doctor`)
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    pub device: String,
    /// How a picture becomes its input
    #[arg(long, value_enum, default_value_t = InputRule::Whole)]
    pub input: InputRule,
    /// Larger pictures are made smaller, to this longest side [default: what the weights' file asks for, else 512]
    #[arg(long, value_name = "PX")]
    pub max_side: Option<usize>,
    /// Most memory that the network may take, such as 3GB or 800MB [default: what is free]
    #[arg(long, value_name = "AMOUNT", value_parser = crate::bytes::parse)]
    pub max_memory: Option<u64>,
    /// Say how much time and memory the network would take, and stop
    #[arg(long)]
    pub dry_run: bool,
    /// How to read the weights.
    #[command(flatten)]
    pub heads: Heads,
}

impl Default for NetworkChoice {
    fn default() -> Self {
        Self {
            weights: None,
            device: "cpu".into(),
            input: InputRule::Whole,
            max_side: None,
            max_memory: None,
            dry_run: false,
            heads: Heads { encoder_heads: None, decoder_heads: None },
        }
    }
}

/// How a picture becomes an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InputRule {
    /// All of it; sides are padded to multiples of the patch
    Whole,
    /// As the published networks have it: sides cropped to multiples of the patch, a square to 4:3
    Published,
}
