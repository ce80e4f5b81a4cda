//! What the tests share: a renderer written apart from the estimator, and a judge.
#![allow(dead_code, clippy::unwrap_used)]

pub mod colour;
pub mod dice;
pub mod edited;
pub mod evenness;
pub mod foreign_bytes;
pub mod judge;
pub mod render;
pub mod replay;
pub mod same_point;
pub mod transcode;

/// An error with this text where the condition does not hold.
pub fn ensure(holds: bool, sentence: impl Into<String>) -> Result<(), libtest_mimic::Failed> {
    if holds { Ok(()) } else { Err(libtest_mimic::Failed::from(sentence.into())) }
}
