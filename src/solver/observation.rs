//! What the solver is given: seafloor points, each seen by several frames.

use serde::{Deserialize, Serialize};

use crate::coordinates::{Body, Direction, Point};
use crate::geometry::{LightPath, light_path};
use crate::vehicle::Lamps;

/// Linear light of one seafloor point in one frame. It does not depend on where the strobe is: the
/// light path is derived on demand.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Sample {
    /// the point, in body space at the frame's time (m)
    pub hit: Point<Body>,
    /// ℓ_s (m)
    pub seafloor_to_camera_m: f64,
    /// normal of the seafloor there
    pub normal: Direction<Body>,
    /// log c_Λ per band
    pub log_color: [f32; 3],
}

impl Sample {
    /// The light path for given lamps; `None` where no lamp reaches the point.
    pub fn path(&self, lamps: Lamps) -> Option<LightPath> {
        light_path(self.hit, self.seafloor_to_camera_m, self.normal, lamps)
    }
}

/// One view of a track.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Observation {
    /// index of the frame among the frames of pass one
    pub frame: u32,
    /// position and light, pooled over the track's footprint
    pub sample: Sample,
}

/// One seafloor point and all its observations, two or more.
pub type Track = Vec<Observation>;

/// The light path of an observation for given lamps.
pub type PathFor<'f> = dyn Fn(&Observation, Lamps) -> Option<LightPath> + Sync + 'f;

/// The light path over the seafloor as estimated.
pub fn sample_path(o: &Observation, lamps: Lamps) -> Option<LightPath> {
    o.sample.path(lamps)
}

/// Every n-th track, so that no more than `max` observations remain.
pub fn thinned(tracks: &[Track], max: usize) -> Vec<Track> {
    let observations: usize = tracks.iter().map(Vec::len).sum();
    tracks.iter().step_by(observations.div_ceil(max).max(1)).cloned().collect()
}
