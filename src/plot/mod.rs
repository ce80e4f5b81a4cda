//! Drawing without knowing what is drawn: plots as SVG, colour ramps, a canvas of pixels with a
//! tiny font.
//!
//! In: numbers and words, words already meant for people. Out: SVG text, RGB pixels. The same input
//! gives the same bytes.

mod canvas;
mod font;
mod ramp;
mod svg;

pub use canvas::Canvas;
pub use ramp::{Ramp, css};
pub use svg::{Axis, Plot, Shape, escape_markup, ticks};
