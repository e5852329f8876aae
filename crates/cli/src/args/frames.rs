//! `selenograph frames`.

use super::Target;
use clap::Args;
use std::path::PathBuf;

/// An image sequence into pairs.
#[derive(Debug, Args)]
pub struct Frames {
    /// Folder of pictures (by name), a Y4M or MJPEG file, or - for such a stream on stdin
    #[arg(value_name = "SOURCE")]
    pub source: PathBuf,
    /// A pair begins every N frames
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = positive)]
    pub every: usize,
    /// Frames from the first view of a pair to its second [default: that of --every]
    #[arg(long, value_name = "N", value_parser = positive)]
    pub gap: Option<usize>,
    /// Side of the square that is cut out of each frame, pixels
    #[arg(long, value_name = "PX", default_value_t = 512, value_parser = positive)]
    pub size: usize,
    /// First column and row of that square [default: the middle of the frame]
    #[arg(long, value_name = "X,Y", value_parser = corner)]
    pub at: Option<[usize; 2]>,
    /// Camera of the whole frame; that of the square is written beside the pictures
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Where to write.
    #[command(flatten)]
    pub target: Target,
}

fn positive(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|number| *number > 0).ok_or_else(|| "a whole number above 0".to_owned())
}

fn corner(text: &str) -> Result<[usize; 2], String> {
    let numbers: Vec<usize> =
        text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>().unwrap_or_default();
    numbers.try_into().map_err(|_| "column and row as two whole numbers, for example 128,64".to_owned())
}
