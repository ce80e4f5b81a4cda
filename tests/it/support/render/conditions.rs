//! Conditions of real recordings that an ideal camera over an ideal seafloor does not have, each of
//! them off by default. The log does not record them, except where a field says so.

use super::{Bands, V3, gaussian, hash, lobes};
use nalgebra::{UnitQuaternion, Vector3};

/// Diffuse attenuation of daylight [1/m], and the depth of the water at the world's origin [m].
const DAYLIGHT_ATTENUATION_PER_M: [f64; 3] = [0.35, 0.07, 0.05];
pub const WATER_DEPTH_M: f64 = 7.0;
/// Path of the light of the uniform field through water [m].
const FIELD_PATH_M: f64 = 2.0;
/// The exposure at the lowest altitude [us]; it grows up to `MAX_EXPOSURE` times, the gain after.
const EXPOSURE_US: f64 = 2000.0;
const MAX_EXPOSURE: f64 = 4.0;
/// The settings' range over the range of altitudes.
const SETTINGS_RANGE: f64 = 8.0;

/// Camera response of 8-bit images.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Response {
    #[default]
    Srgb,
    Gamma22,
    Linear,
    /// a contrast curve over sRGB: C + 0.096 sin(2 pi (C - 0.5))
    Contrast,
}

impl Response {
    /// Coded value of linear light, both 0..1.
    pub fn encode(self, light: f64) -> f64 {
        let srgb = || {
            if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
        };
        match self {
            Self::Srgb => srgb(),
            Self::Gamma22 => light.powf(1.0 / 2.2),
            Self::Linear => light,
            Self::Contrast => {
                let coded = srgb();
                (coded + 0.096 * (std::f64::consts::TAU * (coded - 0.5)).sin()).clamp(0.0, 1.0)
            }
        }
    }
}

/// A lamp beside the strobe whose beam pattern, position and orientation are its own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SecondLamp {
    #[default]
    None,
    /// absent from the transforms
    Unlisted,
    /// among the transforms
    Listed,
}

/// How exposure and gain are recorded. Both follow the altitude over a range of 8: exposure rises
/// first, then gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SettingsMessage {
    /// flir_camera_msgs/msg/ImageMetaData on /camera/meta: microseconds and decibels
    ImageMetaData,
    /// std_msgs/msg/Float64 on /camera/exposure_time [s] and /camera/gain (a factor)
    Float64,
    /// std_msgs/msg/Float64 on /camera/exposure_ev: both in one, in stops
    Stops,
}

/// What differs from the ideal. Shares and deviations are fractions.
#[derive(Clone, Debug, Default)]
pub struct Conditions {
    /// of the log of each frame's mean brightness, made good by the exposure of the frame
    pub auto_exposure: f64,
    /// of each frame's colour cast (log of a band's mean over that of all bands), made good by a
    /// gain per band
    pub auto_white_balance: f64,
    /// standard deviation of the strobe's energy over the frames
    pub strobe_flicker: f64,
    /// the strobe's energy in every other frame; 0 where it does not fire
    pub every_other_energy: Option<f64>,
    /// added by the sensor to every pixel value, as a share of full scale
    pub black_level: f64,
    /// 12-bit values are truncated, not rounded
    pub has_truncating_adc: bool,
    /// the lens attenuates by this power of the cosine of the angle off its axis
    pub vignetting_exponent: f64,
    pub response: Response,
    /// the strobe's position in the transforms minus its true one, in base
    pub strobe_mount_error_m: [f64; 3],
    /// amplitude by which a servo pitches camera and lamps together about `SERVO_IN_BASE`; on /tf
    pub servo_deg: f64,
    /// the attitude sensor sits on the servo
    pub imu_on_servo: bool,
    /// the servo holds the camera alone
    pub lamps_stay: bool,
    /// by how much the stamps of images are late
    pub stamp_delay_s: f64,
    pub second_lamp: SecondLamp,
    /// downwelling daylight on the seafloor over the direct light of the strobe, means over dive
    /// and bands, both as the camera receives them. Its own backscatter is not rendered.
    pub daylight: f64,
    /// uniform backscatter A (1 - exp(-alpha ls)) (Eq. 6) over direct light, means over dive and
    /// bands.
    pub uniform_backscatter: f64,
    /// depth of the base on /depth, std_msgs/msg/Float64
    pub has_depth_sensor: bool,
    /// recorded, and following the altitude
    pub settings: Option<SettingsMessage>,
}

/// What camera and strobe did to one frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameGain {
    /// the share of light that the exposure lets in
    pub exposure: f64,
    /// after the exposure, per band
    pub amplification: Bands,
    pub strobe_energy: f64,
}

/// The recorded settings of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    pub exposure_us: u32,
    pub gain_db: f32,
}

impl Settings {
    /// `height`: 0 at the lowest altitude, 1 at the highest.
    pub fn at(height: f64) -> Self {
        let total = SETTINGS_RANGE.powf(height);
        let exposure = total.min(MAX_EXPOSURE);
        Self {
            exposure_us: (EXPOSURE_US * exposure).round() as u32,
            gain_db: (20.0 * (total / exposure).log10()) as f32,
        }
    }
    pub fn exposure(self) -> f64 {
        f64::from(self.exposure_us) / EXPOSURE_US
    }
    pub fn gain(self) -> f64 {
        10.0_f64.powf(f64::from(self.gain_db) / 20.0)
    }
    pub fn stops(self) -> f64 {
        (self.exposure() * self.gain()).log2()
    }
}

impl Conditions {
    /// The strobe's energy in each frame, 1 in the mean of those with full energy.
    pub fn strobe_energy(&self, seed: u64, frame: usize) -> f64 {
        if let Some(energy) = self.every_other_energy.filter(|_| frame % 2 == 1) {
            return energy;
        }
        let draw = gaussian(hash(seed, 0xf11c, frame as i64));
        (1.0 + self.strobe_flicker * draw).max(0.0)
    }
    /// What the lens lets through along the ray (x, y, 1).
    pub fn lens(&self, [x, y]: [f64; 2]) -> f64 {
        (1.0 + x * x + y * y).powf(-0.5 * self.vignetting_exponent)
    }
    pub fn has_automatics(&self) -> bool {
        self.auto_exposure > 0.0 || self.auto_white_balance > 0.0
    }
    /// What the automatics make of each frame's mean light: exposure relative to the dive's
    /// geometric mean, and gains per band.
    pub fn automatic_gains(&self, means: &[Bands]) -> Vec<(f64, Bands)> {
        let log_brightness = |mean: &Bands| mean.mean().ln();
        let level = means.iter().map(log_brightness).sum::<f64>() / means.len() as f64;
        let gains = |mean: &Bands| {
            let exposure = (-self.auto_exposure * (log_brightness(mean) - level)).exp();
            if self.auto_white_balance == 0.0 {
                return (exposure, Bands::repeat(1.0));
            }
            let log = mean.map(f64::ln);
            let cast = log.map(|band| band - log.mean());
            (exposure, cast.map(|band| (-self.auto_white_balance * band).exp()))
        };
        means.iter().map(gains).collect()
    }
}

/// Radiance of white seafloor under daylight, through the path `ls` to the camera, for white light
/// of irradiance 1 at the surface. `z`: the seafloor's height in the world; `up`: the vertical
/// component of its normal.
pub fn daylight(z: f64, up: f64, attenuation: &Bands, ls: f64) -> Bands {
    let down = Bands::from(DAYLIGHT_ATTENUATION_PER_M) * (WATER_DEPTH_M - z);
    (down + attenuation * ls).map(|optical_depth| up.max(0.0) * (-optical_depth).exp())
}

/// Backscatter of a uniform field along a path to the camera, A (1 - exp(-alpha ls)) with A =
/// field / alpha (Eq. 5 with a constant field); its white light has come through some water.
pub fn uniform_backscatter(attenuation: &Bands, ls: f64) -> Bands {
    attenuation.map(|alpha| (-alpha * FIELD_PATH_M).exp() * (1.0 - (-alpha * ls).exp()) / alpha)
}

// The second lamp: on the port bow, tilted back and inward; narrower, and weaker than the strobe.
pub const LAMP_IN_BASE: [f64; 3] = [0.62, 0.42, -0.05];
const LAMP_TURN_DEG: (f64, f64) = (-4.0, 4.0);
const LAMP_POWER: f64 = 0.6;
const LAMP_WIDTH_DEG: (f64, f64) = (19.0, 15.0);

/// Rotation from the optical axes of a camera that looks straight down.
pub fn lamp_turn() -> UnitQuaternion<f64> {
    let about = |axis, deg: f64| UnitQuaternion::from_axis_angle(&axis, deg.to_radians());
    about(Vector3::x_axis(), LAMP_TURN_DEG.0) * about(Vector3::y_axis(), LAMP_TURN_DEG.1)
}

/// Which beam pattern a lamp has.
#[derive(Clone, Copy, Debug)]
pub enum Pattern {
    Strobe,
    Lamp,
}

impl Pattern {
    /// Radiant intensity towards `d`, a direction of any length in the lamp's optical frame.
    pub fn intensity(self, d: &V3) -> f64 {
        if d.z <= 0.0 {
            return 0.0;
        }
        let (theta, phi) = (d.y.atan2(d.z), d.x.atan2(d.z));
        match self {
            Self::Strobe => lobes(theta, phi) / super::LOBES_PEAK,
            Self::Lamp => {
                let (a, b) =
                    (theta / LAMP_WIDTH_DEG.0.to_radians(), phi / LAMP_WIDTH_DEG.1.to_radians());
                // Flat inside, steep at its edge: the reflector of a floodlight.
                LAMP_POWER * (-(a * a + b * b).powi(2)).exp()
            }
        }
    }
}
