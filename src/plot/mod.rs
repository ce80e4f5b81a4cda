//! Plots as SVG, colour maps, and a raster canvas with a bitmap font. Output is deterministic.

mod canvas;
mod font;
mod ramp;
mod svg;

pub use canvas::Canvas;
pub use ramp::Ramp;
pub use svg::{Axis, Plot, Shape, escape_markup, ticks};
