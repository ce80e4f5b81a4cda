//! The subcommands, one file each: its arguments and the function that runs it.

pub mod compare;
pub mod completions;
pub mod config;
pub mod correct;
mod correct_log;
mod correct_many;
pub mod estimate;
pub mod export;
pub mod import;
pub mod init;
pub mod inspect;
mod inspect_text;
pub mod join;
pub mod layout;
pub mod man;
pub mod mosaic;
pub mod report;
mod rig_text;
pub mod table;
pub mod verify;
