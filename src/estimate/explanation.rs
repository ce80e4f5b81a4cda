//! One explanation of a log but for attenuation and beam pattern, and the samples it explains.

use super::backscatter::BackscatterFit;
use super::camera_fit::CameraFit;
use super::daylight::DaylightFit;
use super::mount_search::MountFit;
use super::samples::FrameSamples;
use super::strobe_search::StrobePlacement;
use super::{Dataset, FollowedSetting, Mounts, frame_gains};
use crate::image::Bands;
use crate::solver::Track;
use crate::vehicle::Lamps;

/// Samples and tracks, owned.
#[derive(Clone)]
pub struct Samples {
    pub frames: Vec<FrameSamples>,
    pub tracks: Vec<Track>,
}

impl Samples {
    pub fn data<'s>(
        &'s self,
        mounts: &Mounts,
        lamps: Lamps,
        camera: Option<&'s CameraFit>,
    ) -> Dataset<'s> {
        let data = Dataset::plain(&self.frames, &self.tracks, mounts.body_from_optical, lamps);
        Dataset { camera, ..data }
    }

    /// Divides by recorded settings.
    pub fn follow(&mut self, followed: &[FollowedSetting], settings: &[Vec<f64>]) {
        for setting in followed {
            self.remove_gains(&uniform(&setting.log_gains(&settings[setting.index])));
        }
    }

    pub fn remove_gains(&mut self, log_gains: &[Bands]) {
        frame_gains::remove_gains(&mut self.frames, &mut self.tracks, log_gains);
    }
}

/// One explanation of a log but for attenuation and beam pattern.
#[derive(Clone)]
pub struct Explanation {
    /// the samples without gains and faults of the camera
    pub raw: Samples,
    /// without backscatter and daylight too, where there is any
    pub direct: Option<Samples>,
    pub strobe: StrobePlacement,
    pub backscatter: Option<BackscatterFit>,
    pub daylight: Option<DaylightFit>,
    /// α with backscatter modelled, where the settings exclude it (1/m)
    pub unmodelled: Option<Bands>,
    pub camera: Option<CameraFit>,
    /// a strobe that is elsewhere, which explains nearly as well what is taken for other light
    pub rival: Option<Lamps>,
    /// clock and mount that explain the log better than any fault of the camera
    pub mounts: Option<MountFit>,
}

impl Explanation {
    pub fn new(raw: Samples, strobe: StrobePlacement, camera: Option<CameraFit>) -> Self {
        Self {
            raw,
            strobe,
            camera,
            direct: None,
            backscatter: None,
            daylight: None,
            unmodelled: None,
            rival: None,
            mounts: None,
        }
    }
}

/// The same gain in all bands.
pub fn uniform(log_gains: &[f64]) -> Vec<Bands> {
    log_gains.iter().map(|gain| [*gain; 3]).collect()
}
