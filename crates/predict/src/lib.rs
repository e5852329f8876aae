//! A checkpoint and two views into a `Prediction`: input rules, executor, matching, pose.
#![forbid(unsafe_code)]
