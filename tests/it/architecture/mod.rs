//! The order of the code: imports between modules point down and have no cycles, files and
//! functions stay short, and ARCHITECTURE.md agrees with the code.
mod cycles;
mod layers;
mod limits;
mod source;
