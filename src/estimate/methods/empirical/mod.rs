//! The empirical estimator: light of a dive by regions of the image ([`EmpiricalModel`]), from logs
//! without overlap or with a geometry that cannot be trusted. It determines no attenuation.

mod fit;
mod regions;

pub use fit::{EmpiricalFit, fit};
pub use regions::{RegionSample, Regions, rounded};
