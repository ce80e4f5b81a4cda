#![doc = include_str!("../README.md")]

// The rooms in the order the data walks; ARCHITECTURE.md has the table and a test keeps it.
pub mod cores;
pub mod error;
pub mod spaces;
pub mod units;

pub mod image;

pub mod draw;

pub mod config;

pub mod vehicle;

pub mod geometry;
pub mod messages;

pub mod model;

pub mod correct;
pub mod estimate;

pub mod layout;
pub mod recording;
pub mod report;

pub mod pipeline;

pub mod look;

pub mod cli;
