//! DVL pings → the seafloor's plane below a frame → the way of light through each pixel (paper
//! §IV-A, Fig. 5).

mod light_path;
mod ping_store;
mod seafloor;
mod terrain;

pub use light_path::{
    LampPath, LightPath, MIN_COS_INCIDENCE, SeafloorPoint, StrobeAngles, View, light_path,
};
pub use seafloor::{NoSeafloor, SeafloorEstimator, SeafloorPlane, Support};
pub use terrain::Terrain;
