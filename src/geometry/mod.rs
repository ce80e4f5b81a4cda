//! DVL pings → seafloor plane below a frame → light path through each pixel (paper §IV-A, Fig. 5).

mod light_path;
mod ping_store;
mod plane;
mod plane_fit;
mod seafloor;
mod terrain;
mod trajectory;

pub use light_path::{
    LampPath, LightPath, MIN_COS_INCIDENCE, SeafloorPoint, StrobeAngles, View, light_path,
};
pub use plane::{NoSeafloor, PlaneChange, SeafloorPlane, Support, tilt_rotation, turned};
pub use seafloor::SeafloorEstimator;
pub use terrain::Terrain;
