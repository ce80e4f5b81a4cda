//! How far an estimate can be trusted.

pub mod cross_validation;
pub mod doubt;
pub mod error_budget;
pub mod identifiability;
