//! The samples of a log with what is known of its geometry, at one stage of the estimation.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use super::backscatter::BackscatterFit;
use super::camera_fit::CameraFit;
use super::daylight::DaylightFit;
use super::drift::DriftFit;
use super::samples::FrameSamples;
use crate::config::EstimateConfig;
use crate::coordinates::{Body, Optical, Transform};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{BeamGrid, BeamPattern, ImagingModel, SpreadingModel};
use crate::solver::terms::geometry::PlaneTrack;
use crate::solver::{Independence, Observation, Sample, Setup, Track};
use crate::stats;
use crate::vehicle::Lamps;

/// Frames nearer than this share their pings (s).
const PINGS_SHARED_S: f64 = 2.5;

/// Samples and geometry.
#[derive(Clone, Copy)]
pub struct Dataset<'s> {
    /// samples of the frames
    pub frames: &'s [FrameSamples],
    /// seafloor points seen more than once
    pub tracks: &'s [Track],
    /// the camera's mount
    pub body_from_optical: Transform<Body, Optical>,
    /// the strobe's mount
    pub lamps: Lamps,
    /// whether the strobe's position is not measured: estimated from these samples, or a guess
    pub strobe_is_free: bool,
    /// position of the range instrument (m) and standard deviations of the tilts (rad), where
    /// planes are assumed level: those of `FreeTilts`
    pub tilts: Option<(Vector3<f64>, [f64; 2])>,
    /// backscatter that has been removed from the samples
    pub backscatter: Option<&'s BackscatterFit>,
    /// daylight that has been removed from the samples
    pub daylight: Option<&'s DaylightFit>,
    /// daylight's share, where it is in the samples and an unknown of the solves
    pub daylight_share: Option<Bands>,
    /// the tracks before either was; `None` where nothing was removed
    pub raw_tracks: Option<&'s [Track]>,
    /// what of the camera has been removed from the samples and stays unknown in the solves
    pub camera: Option<&'s CameraFit>,
    /// nodes of α in time
    pub drift: Option<&'s DriftFit>,
    /// α with backscatter modelled, where it is present and the settings exclude it (1/m)
    pub unmodelled_backscatter: Option<Bands>,
}

impl<'s> Dataset<'s> {
    /// Samples without backscatter, daylight or drift, the strobe where it is measured to be.
    pub fn plain(
        frames: &'s [FrameSamples],
        tracks: &'s [Track],
        body_from_optical: Transform<Body, Optical>,
        lamps: Lamps,
    ) -> Self {
        Self {
            frames,
            tracks,
            body_from_optical,
            lamps,
            strobe_is_free: false,
            tilts: None,
            backscatter: None,
            daylight: None,
            daylight_share: None,
            raw_tracks: None,
            camera: None,
            drift: None,
            unmodelled_backscatter: None,
        }
    }

    /// A sample's ray: x/z, y/z in the image plane, and ℓ_s (m).
    pub fn ray(&self, sample: &Sample) -> (f64, f64, f64) {
        let hit = (self.body_from_optical.inverse() * sample.hit).vector();
        (hit.x / hit.z, hit.y / hit.z, sample.seafloor_to_camera_m)
    }

    /// The tracks before backscatter and daylight were removed.
    pub fn raw_tracks(&self) -> &'s [Track] {
        self.raw_tracks.unwrap_or(self.tracks)
    }

    /// The planes of the frames, with those shortly before and after.
    pub fn plane_tracks(&self) -> Vec<PlaneTrack> {
        let plane = |f: &FrameSamples| PlaneTrack {
            plane: (f.normal, f.distance_m),
            around: f.planes_around,
        };
        self.frames.iter().map(plane).collect()
    }

    /// Moments with pings of their own: frames nearer than `PINGS_SHARED_S` share their errors.
    pub fn moments(&self) -> usize {
        let moment = |f: &FrameSamples| (f.stamp.0 as f64 * 1e-9 / PINGS_SHARED_S) as i64;
        self.frames.iter().map(moment).collect::<BTreeSet<_>>().len()
    }

    /// The joint solve with attenuation and beam pattern as its only unknowns.
    pub fn setup<'c>(&self, grid: BeamGrid, config: &'c EstimateConfig) -> Setup<'c>
    where
        's: 'c,
    {
        let frames = self.frames.len();
        let independence = Independence { frames, moments: self.moments() };
        let camera = self.camera.map(CameraFit::unknowns);
        let daylight = self.daylight_share;
        Setup { camera, daylight, ..Setup::new(independence, self.bands(), grid, config) }
    }

    /// A model with the settings' spreading.
    pub fn model_by(
        &self,
        attenuation_per_m: Bands,
        beam_pattern: BeamPattern,
        config: &EstimateConfig,
    ) -> ImagingModel {
        let spreading = SpreadingModel::of(config.spreading);
        self.model(attenuation_per_m, spreading, beam_pattern, config)
    }

    /// A model of these samples' bands and backscatter.
    pub fn model(
        &self,
        attenuation_per_m: Bands,
        spreading: SpreadingModel,
        beam_pattern: BeamPattern,
        config: &EstimateConfig,
    ) -> ImagingModel {
        ImagingModel {
            bands: self.bands(),
            attenuation_per_m,
            over_time: Default::default(),
            spreading,
            incidence: config.incidence,
            beam_pattern,
            backscatter: self.backscatter.map(|fit| fit.backscatter),
            daylight: self.daylight.map(|fit| fit.daylight),
            residual: None,
            empirical: None,
        }
    }

    /// The light path of an observation.
    pub fn path(&self, o: &Observation) -> Option<LightPath> {
        o.sample.path(self.lamps)
    }

    /// 1 or 3.
    pub fn bands(&self) -> usize {
        self.frames.iter().map(|f| f.bands).max().unwrap_or(1)
    }

    /// Highest over lowest camera altitude (95 % and 5 % quantiles).
    pub fn altitude_spread(&self) -> f64 {
        let altitudes: Vec<f64> = self.frames.iter().map(|f| f.camera_altitude_m).collect();
        stats::quantile(&altitudes, 0.95) / stats::quantile(&altitudes, 0.05)
    }

    /// Whether the altitude varies enough for attenuation to be identified.
    pub fn altitude_varies(&self, config: &EstimateConfig) -> bool {
        self.altitude_spread() >= config.least_altitude_spread
    }

    /// Whether geometry and backscatter can be estimated at all: enough tracks, enough altitudes.
    pub fn is_informative(&self, config: &EstimateConfig) -> bool {
        self.altitude_varies(config) && self.tracks.len() >= config.least_pairs
    }
}

#[cfg(test)]
impl FrameSamples {
    /// Frame number `frame`, one every 3 s, of three bands and without samples.
    pub fn of_level_seafloor(frame: usize, camera_altitude_m: f64) -> Self {
        let normal = crate::coordinates::Direction::from_vector(nalgebra::Vector3::z());
        let normal = normal.expect("a direction");
        Self {
            log: 0,
            frame,
            stamp: crate::units::Stamp(3_000_000_000 * frame as i64),
            normal,
            camera_altitude_m,
            bands: 3,
            keypoints: Vec::new(),
            places: Vec::new(),
            samples: Vec::new(),
            grid: Vec::new(),
            dark: Vec::new(),
            mean_light: [0.1; 3],
            mean_reading: [0.1; 3],
            eight_bit: false,
            max_value: u16::MAX,
            is_srgb: false,
            distance_m: camera_altitude_m,
            is_level_assumed: false,
            is_tilt_measured: false,
            has_attitude: true,
            planes_around: None,
        }
    }
}
