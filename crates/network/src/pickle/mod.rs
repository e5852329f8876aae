//! A reader of pickles that executes nothing: it knows the opcodes of protocol 2 that checkpoints are made of and a
//! closed list of the classes that they name; the rest is refused by name.
//!
//! Objects lie in an arena and refer to each other by number, so that cycles neither leak nor recurse, and there are
//! never more of them than bytes in the pickle.
//!
//! # Source
//! The Python standard library's `pickletools`, which documents each opcode.

mod machine;
mod objects;

pub use machine::load;
pub(crate) use objects::{Object, Objects, Tensor};

/// Why a pickle cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Fault {
    /// It ends in the middle.
    Cut,
    /// It asks for something that is done for no file.
    Refused {
        /// For example `its pickle names`.
        what: &'static str,
        /// What it asks for.
        found: String,
    },
    /// It is not what a pickling program writes.
    Wrong {
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
}

impl Fault {
    fn wrong(expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Wrong { expected: expected.into(), found: found.into() }
    }

    fn refused(what: &'static str, found: impl Into<String>) -> Self {
        Self::Refused { what, found: found.into() }
    }
}

#[cfg(test)]
mod tests;
