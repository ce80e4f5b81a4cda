//! DVL pings → the seafloor's plane below a frame → the way of light through each pixel (paper
//! §IV-A, Fig. 5).

mod light_path;
mod ping_log;
mod relief;
mod seafloor;

pub use light_path::{Leg, LightPath, Sighted, StrobeAngles, View, light_path};
pub use relief::Relief;
pub use seafloor::{NoSeafloor, Pings, SeafloorPlane, Support};
