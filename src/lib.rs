#![doc = include_str!("../README.md")]

// The modules in the order of the data flow. ARCHITECTURE.md has the table of layers, which a test
// checks.
pub mod coordinates;
pub mod diagnostics;
pub mod error;
pub mod parallel;
pub mod stats;
pub mod toml_file;
pub mod units;

pub mod image;

pub mod plot;

pub mod config;

pub mod vehicle;

pub mod geometry;
pub mod messages;

pub mod model;

pub mod solver;

pub mod correct;
pub mod estimate;

pub mod recording;
pub mod report;
pub mod viewers;

pub mod session;

pub mod run;

pub mod products;

#[cfg(feature = "cli")]
pub mod cli;
