//! Pairs out, in the formats of others.

pub mod stereolunar;
