//! DVL pings → the seafloor's plane below a frame → the way of light through each pixel (paper §IV-A, Fig. 5).

mod light_path;
mod seafloor;

pub use light_path::{LightPath, StrobeAngles, View, light_path};
pub use seafloor::{NoSeafloor, Pings, SeafloorPlane, Support};
