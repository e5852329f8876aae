//! The network as differentiable layers on `burn`: training, graphics cards, and a second opinion on the CPU engine.
#![forbid(unsafe_code)]
