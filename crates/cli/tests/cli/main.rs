//! The binary from outside: what it prints, what it answers, and what it leaves behind.

mod bad_campaign;
mod bad_input;
mod campaign;
mod dem;
mod help;
mod program;
mod tiff;
