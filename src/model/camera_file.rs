//! What a log shows of its camera, clock and mounts, in `model.json`.

use super::frame_gain::{is_one, one};
use serde::{Deserialize, Serialize};

use crate::image::Bands;
use crate::image::flat_field::FlatField;
use crate::image::response::ResponseTable;
use crate::stats;
use crate::vehicle::Camera;

/// The camera, as far as it differs from one with fixed gain, an even lens and the transfer curve
/// that its encoding implies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CameraFile {
    /// vignetting
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vignetting: Option<VignettingFile>,
    /// what the sensor adds to every pixel value, per band (share of full scale)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub black_level: Option<Vec<f64>>,
    /// transfer curve
    #[serde(skip_serializing_if = "Option::is_none")]
    pub response: Option<ResponseFile>,
    /// the law by which the camera sets its gain
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain_law: Option<GainLawFile>,
    /// gains of the frames, where they are uneven
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gains: Option<GainsFile>,
    /// residual of the solve without and with all this (log light)
    pub residual: [f64; 2],
}

/// Vignetting: `e^(v₁q + v₂q² + v₃q³)`, q the squared distance from the principal point in the
/// image plane, at focal length 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VignettingFile {
    /// v₁ to v₃
    pub coefficients: [f64; 3],
    /// light that is lost in the corner (share)
    pub corner_loss: f64,
}

impl VignettingFile {
    /// What the lens transmits at x, y of the image plane (share).
    pub fn transmission(&self, x: f64, y: f64) -> f64 {
        let q = x * x + y * y;
        self.coefficients.iter().rev().fold(0.0, |sum, v| (sum + v) * q).exp()
    }
}

/// A transfer curve.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResponseFile {
    /// `linear`, `gamma:G`, or `fitted`
    pub transfer: String,
    /// pixel value and linear light, both shares of full scale
    pub points: Vec<[f64; 2]>,
}

/// The law of a camera that sets its own gain: log gain of a frame = κ m + κ' c_Λ with brightness m
/// and colour c_Λ of its mean linear light, see [`Metered`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GainLawFile {
    /// κ: auto-exposure
    pub exposure: f64,
    /// κ': auto white balance
    pub white_balance: f64,
    /// log of the mean linear light over the log, per band
    pub log_level: Vec<f64>,
}

impl GainLawFile {
    /// Log gains of a frame by its mean linear light.
    pub fn log_gains(&self, mean_light: &Bands) -> Bands {
        let bands = self.log_level.len();
        let Metered { brightness, color } = Metered::of(mean_light, &self.log_level);
        let gain = |b: usize| self.exposure * brightness + self.white_balance * color[b];
        std::array::from_fn(|b| if b < bands { gain(b) } else { 0.0 })
    }
}

/// What a camera that sets its own gain answers of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Metered {
    /// m: log of its light, summed over the bands, over that of the log
    pub brightness: f64,
    /// c_Λ: log of its light in a band over that of the log, less the mean over the bands
    pub color: Bands,
}

impl Metered {
    /// From mean linear light per band, and the log of the log's.
    pub fn of(mean_light: &Bands, log_level: &[f64]) -> Self {
        let bands = log_level.len();
        let light = |b: usize| mean_light[b].max(1e-6);
        let sum = |of: &dyn Fn(usize) -> f64| (0..bands).map(of).sum::<f64>();
        let over = |b: usize| light(b).ln() - log_level[b];
        let mean = sum(&over) / bands.max(1) as f64;
        Self {
            brightness: (sum(&light) / sum(&|b| log_level[b].exp())).ln(),
            color: std::array::from_fn(|b| if b < bands { over(b) - mean } else { 0.0 }),
        }
    }
}

/// Uneven gains of frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GainsFile {
    /// standard deviation beside the law: shared by the bands, and each band's own (log light)
    pub std: [f64; 2],
    /// from the lowest to the highest gain of the sampled frames (stops)
    pub range_stops: f64,
}

/// Clock and mount that fit the log better than those given, and are used.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct GeometryFile {
    /// added to the camera's recorded stamps, instead of what the rig file says (s)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock_offset_s: Option<f64>,
    /// rotation body_from_dvl, as a quaternion x, y, z, w
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dvl_rotation_xyzw: Option<[f64; 4]>,
    /// the camera stands still, whatever the joints that it sits on do
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_camera_held: bool,
}

/// Tilts of seafloor planes that were assumed level.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TiltsFile {
    /// of frames without a tilt of their own: median about the camera's x and y axes (deg)
    pub median_deg: [f64; 2],
    /// of the frames that pass one used
    pub frames: Vec<TiltFile>,
    /// whether places of points in overlapping frames show them, not the light
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_measured: bool,
}

impl TiltFile {
    /// Whether it is that of the same frame.
    fn is_of(&self, other: &Self) -> bool {
        (self.input, self.stamp_ns) == (other.input, other.stamp_ns)
    }

    /// How far the plane is tilted (deg).
    pub fn size_deg(&self) -> f64 {
        self.tilt_deg[0].hypot(self.tilt_deg[1])
    }
}

/// To six decimals, as the file has it.
pub fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

impl TiltsFile {
    /// Those of frames over planes that had been changed by others before; frames that have none
    /// now keep what they had.
    #[must_use]
    pub fn after(mut self, before: &Self) -> Self {
        let sum = |a: [f64; 2], b: [f64; 2]| [rounded(a[0] + b[0]), rounded(a[1] + b[1])];
        for own in &mut self.frames {
            let of_before = before.frames.iter().find(|b| own.is_of(b));
            let (tilt, factor) =
                of_before.map_or((before.median_deg, 1.0), |b| (b.tilt_deg, b.altitude_factor));
            own.tilt_deg = sum(own.tilt_deg, tilt);
            own.altitude_factor = rounded(own.altitude_factor * factor);
        }
        let is_lost = |b: &&TiltFile| !self.frames.iter().any(|own| own.is_of(b));
        let kept: Vec<TiltFile> = before.frames.iter().filter(is_lost).cloned().collect();
        self.frames.extend(kept);
        self.median_deg = sum(self.median_deg, before.median_deg);
        self
    }

    /// Those of several logs, in their order.
    pub fn of_logs(logs: impl Iterator<Item = Option<Self>>) -> Option<Self> {
        let mut all = Self { is_measured: true, ..Self::default() };
        for (input, log) in logs.enumerate() {
            let frames = log.into_iter().flat_map(|log| log.frames);
            all.frames.extend(frames.map(|frame| TiltFile { input, ..frame }));
        }
        let of_axis = |axis: usize| all.frames.iter().map(|f| f.tilt_deg[axis]).collect::<Vec<_>>();
        all.median_deg = [0, 1].map(|axis| stats::median(&of_axis(axis)));
        (!all.frames.is_empty()).then_some(all)
    }
}

/// The tilt of one frame's seafloor plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TiltFile {
    /// its time as the camera stamped it, without any clock offset (ns)
    pub stamp_ns: i64,
    /// index of its log in `inputs`
    #[serde(default)]
    pub input: usize,
    /// about the camera's x and y axes, around the range instrument (deg)
    pub tilt_deg: [f64; 2],
    /// factor of the camera's altitude over the tilted plane
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub altitude_factor: f64,
}

impl CameraFile {
    /// The vignetting as a flat field for a camera's images.
    pub fn lens(&self, camera: &Camera) -> Option<FlatField> {
        let vignetting = self.vignetting.as_ref()?;
        Some(FlatField::from_fn(camera.width, camera.height, |u, v| {
            camera.image_plane(u, v).map_or(1.0, |(x, y)| vignetting.transmission(x, y))
        }))
    }

    /// The black level per band.
    pub fn dark(&self) -> Option<Bands> {
        let level = self.black_level.as_ref().filter(|level| !level.is_empty())?;
        Some(std::array::from_fn(|b| level[b.min(level.len() - 1)]))
    }

    /// The transfer curve.
    ///
    /// # Errors
    /// A sentence: it is no curve.
    pub fn response_table(&self) -> Result<Option<ResponseTable>, String> {
        self.response.as_ref().map(|r| ResponseTable::new(r.points.clone())).transpose()
    }

    /// In one line, for people.
    pub fn summary(&self) -> String {
        let mut parts = Vec::new();
        if let Some(law) = &self.gain_law {
            let strong = |kappa: f64| kappa < -0.2;
            match (strong(law.exposure), strong(law.white_balance)) {
                (true, true) => parts.push("auto-exposure and auto white balance".to_string()),
                (false, true) => parts.push("auto white balance".to_string()),
                _ => parts.push("auto-exposure".to_string()),
            }
        }
        if let Some(gains) = &self.gains {
            let what = if self.gain_law.is_some() { "over" } else { "uneven gain over" };
            parts.push(format!("{what} {:.1} stops", gains.range_stops));
        }
        if let Some(vignetting) = &self.vignetting {
            parts.push(format!("vignetting {:.0} % at the corner", 100.0 * vignetting.corner_loss));
        }
        if let Some(level) = &self.black_level {
            let mean = level.iter().sum::<f64>() / level.len().max(1) as f64;
            parts.push(format!("black level {:.2} % of full scale", 100.0 * mean));
        }
        if let Some(response) = &self.response {
            let curve = if response.transfer == "fitted" { "fitted" } else { &response.transfer };
            parts.push(format!("transfer curve {curve}"));
        }
        parts.join(", ").replace(", over ", " over ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilts(input: usize, stamp_ns: i64, tilt_deg: [f64; 2], altitude_factor: f64) -> TiltsFile {
        let frames = vec![TiltFile { stamp_ns, input, tilt_deg, altitude_factor }];
        TiltsFile { median_deg: tilt_deg, frames, is_measured: true }
    }

    #[test]
    fn tilts_over_planes_that_were_tilted_add_up() {
        let before = tilts(0, 7, [2.0, -1.0], 1.01);
        let of_same = tilts(0, 7, [0.5, 0.25], 0.99).after(&before);
        assert_eq!(of_same.frames[0].tilt_deg, [2.5, -0.75]);
        assert_eq!(of_same.frames[0].altitude_factor, 0.9999);
        // Another frame had the median.
        let of_other = tilts(1, 7, [0.5, 0.25], 0.99).after(&before);
        assert_eq!(of_other.frames[0].tilt_deg, [2.5, -0.75]);
        assert_eq!(of_other.frames[0].altitude_factor, 0.99);
        assert_eq!(of_other.median_deg, [2.5, -0.75]);
        // A frame that was not sampled again has its own still.
        assert_eq!(of_other.frames[1..], before.frames);
    }

    #[test]
    fn tilts_of_several_logs_are_numbered_by_log() {
        let log = |tilt_deg: [f64; 2]| Some(tilts(0, 7, tilt_deg, 1.0));
        let logs = [log([2.0, -1.0]), None, log([1.0, 0.0]), log([0.0, -3.0])];
        let all = TiltsFile::of_logs(logs.into_iter()).expect("tilts");
        assert_eq!(all.frames.iter().map(|f| f.input).collect::<Vec<_>>(), [0, 2, 3]);
        assert_eq!(all.median_deg, [1.0, -1.0]);
        assert_eq!(TiltsFile::of_logs([None, None].into_iter()), None);
    }
}
