//! Losses, optimiser, schedule and the training run.
#![forbid(unsafe_code)]
