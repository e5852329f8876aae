//! Pictures and arrays in files: each format encodes to bytes and decodes from bytes.
//!
//! Writing bytes to a file, whole or not at all, is the caller's job; `read` is only a convenience that names the
//! file in its errors.

mod decoded;
pub mod exr;
pub mod jpeg;
pub mod npz;
pub mod pgm;
pub mod picture;
pub mod png;

pub use decoded::Picture;
