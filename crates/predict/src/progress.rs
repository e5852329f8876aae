//! How far the work is.

/// A part of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Reading and packing weights.
    Load,
    /// Blocks of the encoder.
    Encode,
    /// Blocks of the decoders.
    Decode,
    /// Heads.
    Heads,
    /// Matching.
    Match,
}

impl Step {
    /// In words.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Load => "load weights",
            Self::Encode => "encode",
            Self::Decode => "decode",
            Self::Heads => "points and descriptors",
            Self::Match => "match",
        }
    }
}

/// How far a part of the work is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// The part.
    pub step: Step,
    /// Pieces of it that are done.
    pub done: usize,
    /// All of its pieces.
    pub of: usize,
}

/// Who is told of progress.
pub(crate) type Report<'a> = &'a mut dyn FnMut(Progress);
