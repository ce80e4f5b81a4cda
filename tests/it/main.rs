//! All tests that need nothing but this repository, in one binary: the renderer is compiled once.
//! Tests that need dives, Python or a browser are in `tests/external`.
#![allow(clippy::unwrap_used)]

mod support;

mod architecture;
mod chunks;
mod cli;
mod clock_offsets;
mod conditions;
mod cruise;
mod damage;
mod docs;
mod examples;
mod field_faults;
mod foreign_bytes;
mod jpeg;
mod judge;
mod limits_of_signal;
mod messages;
mod mutants;
mod never_worse_than_raw;
mod products;
mod program;
mod recordings;
mod recovers_truth;
mod rendering;
mod self_calibration;
mod session;
mod several_cameras;
mod shards;
mod verify;
