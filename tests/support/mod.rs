//! What the tests share: a renderer written apart from the estimator, and a judge.
#![allow(dead_code, clippy::unwrap_used)]

pub mod dice;
pub mod foreign_bytes;
pub mod judge;
pub mod render;
pub mod transcode;
