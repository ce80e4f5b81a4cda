//! A forward model of a dive: renders what the camera, DVL and IMU of an underwater robot would
//! have logged, with all that the estimator should recover known beforehand. Written from physics
//! alone and sharing no code with the estimator, so that a truth test never checks a formula
//! against itself. Per pixel and band
//!
//! ```text
//! c = gain * exposure
//!     * [ r(X) * BP(theta, phi) * cos(gamma) / la^p * exp(-alpha (la + ls)) + B(ray) ]
//! ```
//!
//! - `X` is where the pixel's ray meets the seafloor, a plane in the world, with ridges if set;
//!   `la` is the path length from strobe to `X`, `ls` from `X` to the camera, `gamma` the angle at
//!   `X` between seafloor normal and strobe (Kaeli & Singh Eq. 1, 4, 10). Light falls with `la^-p`,
//!   p = 2; there is no `1/ls^2`, as a pixel's footprint grows with it.
//! - `theta = atan2(y, z)`, `phi = atan2(x, z)` in the strobe's optical frame; `BP` is two Gaussian
//!   lobes in angle, asymmetric, peak 1.
//! - `B` is single scattering of the strobe's light on the ray (Jaffe 1990; Eq. 5 with the strobe
//!   as the field), of constant phase: `B = b * integral BP / l^2 * exp(-a_b (l + s)) ds`, `l` from
//!   strobe to the point `s` on the ray; one `b` for all bands (Eq. 2), and `a_b` a fixed multiple
//!   of alpha (they differ: Akkaynak & Treibitz 2018).
//! - `r` is value noise and pebbles, one function of the position for the whole dive, with nothing
//!   finer than about two pixels at the mean altitude; a pixel gets the mean of 2x2 samples, and
//!   its illumination is taken at its centre.
//! - The sensor adds shot and read noise, then quantises to 12 bits (the upper ones of 16, linear),
//!   or to 8 bits with the sRGB curve. A mono camera sees the green band.
//! - What real recordings have beyond that, from automatic exposure to daylight: [`Conditions`].
//!
//! Frames: world ENU, z up; base x forward, y left, z up; optical x right, y down, z forward; DVL x
//! forward, y right, z down. The camera looks straight down, image up is forward; pixel centres are
//! whole numbers. Images at 1 Hz, pings every 0.2013 s and so at varying phases, IMU at 20 Hz.
//! The same `Dive` gives the same bytes on any thread count.
#![allow(dead_code)]

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::path::Path;

#[path = "render/conditions.rs"]
pub mod conditions;

use conditions::{
    Conditions, FrameGain, LAMP_IN_BASE, Pattern, SecondLamp, Settings, SettingsMessage,
    WATER_DEPTH_M, daylight, lamp_turn, uniform_backscatter,
};

type V3 = Vector3<f64>;
type Rotation = UnitQuaternion<f64>;
type Pose = Isometry3<f64>;
type Bands = V3; // R G B

// The rig: metres in base. The strobe points ahead of straight down, and a little to starboard.
const CAMERA_IN_BASE: [f64; 3] = [0.34, -0.10, -0.12];
/// Its axis is that of pitch.
const SERVO_IN_BASE: [f64; 3] = [0.30, -0.10, 0.05];
const STROBE_IN_BASE: [f64; 3] = [-0.53, 0.09, -0.07];
const SECOND_STROBE_IN_BASE: [f64; 3] = [0.75, -0.32, -0.09];
const STROBE_TURN_DEG: (f64, f64) = (18.0, 4.0);
const DVL_IN_BASE: [f64; 3] = [-0.08, 0.15, -0.16]; // the altimeter too
// The motion: speed, period of the altitude, seconds and metres of the change of course.
const SPEED_M_PER_S: f64 = 0.3;
const SWING_PERIOD_S: f64 = 24.0;
const SERVO_PERIOD_S: f64 = 9.0;
const TURN: (f64, f64) = (6.0, 0.6);
// The sensors. Exposed such that the 99.8th percentile of direct light (brightest band, gain 1) is
// here, of full scale.
const EXPOSED_TO: f64 = 0.85;
const FULL_WELL_E: f64 = 15_000.0;
const READ_NOISE_E: f64 = 5.0;
const DEPTH_NOISE_M: f64 = 0.01;
const ATTITUDE_NOISE_RAD: f64 = 0.0005;
/// Backscatter's attenuation over the direct light's.
pub const BACKSCATTER_ATTENUATION_RATIO: f64 = 1.1;
const SCATTER_POINTS: usize = 24;
const COARSE_PX: usize = 8; // backscatter is computed at every n-th pixel, bilinear between
// Nanoseconds: the first frame's stamp, all else after it. The sensors run on for a second after
// the last frame.
const FIRST_FRAME_NS: i64 = 1_760_000_000_123_456_789;
const PING_NS: (i64, i64) = (-937_000_000, 201_300_000); // start, period
const IMU_NS: (i64, i64) = (-989_000_000, 50_000_000);
const DEPTH_NS: (i64, i64) = (-971_000_000, 100_000_000);

/// What the camera writes, on `/camera/image_raw`. The 16-bit ones are linear, 12 bits on top; the
/// others sRGB-coded.
#[derive(Clone, Debug)]
pub enum Sensor {
    Bayer16, // bayer_rggb16
    Rgb16,   // rgb16
    Mono16,  // mono16, of the green band
    Rgb8,    // rgb8
    // sensor_msgs/CompressedImage of this quality, on /camera/image_raw/compressed; 4:2:0 below 90
    Jpeg(u8),
    // the same, always 4:2:0
    Jpeg420(u8),
}

/// Which message is on `/dvl/data`, or what takes its place. Ranges are slant in all.
#[derive(Clone, Debug)]
pub enum DvlType {
    // marine_acoustic_msgs/msg/Dvl: 30 deg beams, vectors in the message, lost = NaN
    MarineAcoustic,
    // dvl_msgs/msg/DVL: 22.5 deg, no vectors, ids 0..3 at +135, -135, -45, +45 deg, lost = -1,
    // invalid
    WaterLinked,
    // no DVL: sensor_msgs/msg/Range of one narrow beam straight down, on /altimeter/range
    Altimeter,
}

/// A dive to render. Every field is a known truth or a known fault.
#[derive(Clone, Debug)]
pub struct Dive {
    pub seed: u64,
    pub frames: usize,
    pub frames_per_s: f64,
    pub width: usize,
    pub height: usize,
    pub focal_px: f64,
    pub distortion: [f64; 5],        // plumb_bob: k1, k2, p1, p2, k3
    pub attenuation_per_m: [f64; 3], // R G B, at mid-dive
    pub attenuation_drift: f64,      // linear change from first to last frame, as a fraction of it
    pub altitude_m: (f64, f64),      // range of the camera's altitude
    pub slope_deg: (f64, f64),       // slope of the seafloor along world x and y
    pub relief_m: f64,               // amplitude of ridges on that, most of them across the track
    pub tilt_deg: f64,               // amplitude of roll and of pitch
    pub lost_beams: f64,             // chance of each beam of each ping to be lost
    pub range_noise: f64,            // standard deviation of a range, as a fraction of it
    pub velocity_noise_m_per_s: f64, // of each axis of the DVL's velocity
    pub spreading_exponent: f64,     // p
    pub backscatter: f64,            // over direct light, means over dive and bands at gain 1
    // fraction of frames with gain 0.5 (at least one where above 0)
    pub half_power_frames: f64,
    // gains of 1 to 1/8 frame by frame, on /camera/gain: in decibels or as a factor
    pub gain_channel: Option<bool>,
    pub return_leg: bool, // turn at mid-dive and come back 0.6 m beside
    pub sensor: Sensor,
    pub dvl: DvlType,
    pub second_strobe: bool, // one more like the first, to starboard ahead
    pub with_imu: bool,
    pub with_strobe_mount: bool,
    // shot and read noise in the images, and noise of the IMU's attitude
    pub noise: bool,
    pub conditions: Conditions,
}

impl Default for Dive {
    fn default() -> Self {
        Self {
            seed: 1,
            frames: 24,
            frames_per_s: 1.0,
            width: 384,
            height: 288,
            focal_px: 460.0,
            distortion: [0.0; 5],
            attenuation_per_m: [0.45, 0.14, 0.10],
            attenuation_drift: 0.0,
            altitude_m: (1.5, 3.0),
            slope_deg: (2.0, 1.0),
            relief_m: 0.0,
            tilt_deg: 3.0,
            lost_beams: 0.04,
            range_noise: 0.005,
            velocity_noise_m_per_s: 0.003,
            spreading_exponent: 2.0,
            backscatter: 0.0,
            half_power_frames: 0.0,
            gain_channel: None,
            return_leg: false,
            sensor: Sensor::Bayer16,
            dvl: DvlType::MarineAcoustic,
            second_strobe: false,
            with_imu: true,
            with_strobe_mount: true,
            noise: true,
            conditions: Conditions::default(),
        }
    }
}

/// The true values behind a log.
pub struct Truth {
    pub attenuation_per_m: [f64; 3], // at mid-dive; each frame has its own
    pub strobe_position_in_base: [f64; 3],
    pub strobe_orientation_xyzw: [f64; 4],
    pub exposure: f64, // a pixel of full scale 1 is this times gain times radiance
    pub scattering: f64, // b, where the strobe's peak intensity is 1
    pub frames: Vec<FrameTruth>,
}

/// One frame's truth. The plane is `normal . X = distance`: its normal points away from the camera.
pub struct FrameTruth {
    pub stamp_ns: u64, // as in the log, late or not
    pub gain: f64,     // of a channel or a frame at half power
    // R G B, of the strobe's light: all that varies from frame to frame
    pub gains: [f64; 3],
    pub strobe_energy: f64, // in `gains`
    pub position: [f64; 3],
    pub orientation_xyzw: [f64; 4], // of the base in the world
    pub plane_normal_in_optical: [f64; 3],
    pub plane_distance_m: f64,
    pub reflectance: Vec<[f32; 3]>, // width * height, row major, noise-free, mean over the pixel
    pub attenuation_per_m: [f64; 3],
    pub backscatter_share: [f64; 3], // mean backscatter over mean direct light
    pub daylight_share: [f64; 3],    // the same of daylight
}

impl Truth {
    /// Log of the beam pattern, peak 0; angles in the strobe's optical frame.
    pub fn log_beam(&self, theta_rad: f64, phi_rad: f64) -> f64 {
        (lobes(theta_rad, phi_rad) / LOBES_PEAK).ln()
    }
}

impl Dive {
    /// Renders the dive into a zstd-chunked MCAP of profile ros2. Panics on any error.
    pub fn write(&self, path: &Path) -> Truth {
        let scene = Scene::new(self);
        let lighting = scene.expose();
        let render = |k: usize| scene.render(k, &lighting);
        let (frames, images): (Vec<FrameTruth>, Vec<Vec<u8>>) =
            (0..self.frames).into_par_iter().map(render).unzip();
        let mut messages = self.navigation();
        let compressed = ("/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage");
        let raw = ("/camera/image_raw", "sensor_msgs/msg/Image");
        let is_jpeg = matches!(self.sensor, Sensor::Jpeg(_) | Sensor::Jpeg420(_));
        let (topic, kind) = if is_jpeg { compressed } else { raw };
        for (k, image) in images.into_iter().enumerate() {
            let ns = self.frame_ns(k);
            messages.push((ns + 40_000_000, topic, kind, image));
            messages.push((
                ns + 41_000_000,
                "/camera/camera_info",
                "sensor_msgs/msg/CameraInfo",
                self.camera_info(ns),
            ));
        }
        write_log(path, messages);
        Truth {
            attenuation_per_m: self.attenuation_per_m,
            exposure: lighting.exposure,
            scattering: lighting.scattering,
            frames,
            strobe_position_in_base: STROBE_IN_BASE,
            strobe_orientation_xyzw: base_from_strobe().coords.into(),
        }
    }
    fn gain(&self, frame: usize) -> f64 {
        if self.gain_channel.is_some() {
            return 0.5_f64.powi((hash(self.seed, 0x6a19, frame as i64) % 4) as i32);
        }
        let order = |k: usize| hash(self.seed, 0x6a19, k as i64);
        let before = (0..self.frames).filter(|&k| order(k) < order(frame)).count() as f64;
        let halved = (self.half_power_frames * self.frames as f64).round();
        if self.half_power_frames > 0.0 && before < halved.max(1.0) { 0.5 } else { 1.0 }
    }
    /// Up, in the world. The seafloor passes through the world's origin.
    fn seafloor_normal(&self) -> V3 {
        V3::new(-self.slope_deg.0.to_radians().tan(), -self.slope_deg.1.to_radians().tan(), 1.0)
            .normalize()
    }
    fn frame_ns(&self, k: usize) -> i64 {
        ((k as f64 / self.frames_per_s + self.conditions.stamp_delay_s) * 1e9) as i64
    }
    /// The camera's altitude above the seafloor below it, `t` seconds after the first frame.
    fn altitude(&self, t: f64) -> f64 {
        let (low, high) = self.altitude_m;
        low + (high - low) * 0.5 * (1.0 - (TAU * t / SWING_PERIOD_S).cos())
    }
    /// The recorded settings of a frame.
    fn settings(&self, frame: usize) -> Settings {
        let (low, high) = self.altitude_m;
        let altitude = self.altitude(frame as f64 / self.frames_per_s);
        Settings::at((altitude - low) / (high - low).max(f64::MIN_POSITIVE))
    }
    /// The base in the world, `t` seconds after the first frame.
    fn pose(&self, t: f64) -> (V3, Rotation) {
        let wave = |period: f64, id: u64| (TAU * (t / period + unit(hash(self.seed, id, 0)))).sin();
        let end = (self.frames - 1) as f64 / self.frames_per_s;
        let turn = TURN.0.min(0.3 * end).max(1e-3);
        let out = if self.return_leg { 0.5 * (end - turn) } else { f64::MAX };
        let heading = PI * smooth(((t - out) / turn).clamp(0.0, 1.0));
        let x =
            SPEED_M_PER_S * (t.min(out) - (t - out - turn).max(0.0)) + 0.5 * TURN.1 * heading.sin();
        let y = 0.5 * TURN.1 * (1.0 - heading.cos()) + 0.08 * wave(23.0, 11);
        let (roll, pitch) = (
            self.tilt_deg.to_radians() * wave(7.3, 12),
            self.tilt_deg.to_radians() * wave(5.1, 13),
        );
        let height = self.altitude(t);
        let seafloor_m =
            x * self.slope_deg.0.to_radians().tan() + y * self.slope_deg.1.to_radians().tan();
        let attitude = Rotation::from_euler_angles(roll, pitch, heading + 0.14 * wave(40.0, 14));
        (V3::new(x, y, seafloor_m + height - CAMERA_IN_BASE[2]), attitude)
    }
}

// --- Mounts and the beam ---
/// Columns: the optical axes in base. Right is -y, image down is -x, the view is -z.
fn base_from_camera() -> Rotation {
    let axes = Matrix3::new(0.0, -1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}
/// A rotation about optical x tilts the view towards -y, forward; about optical y towards x,
/// starboard.
fn base_from_strobe() -> Rotation {
    let forward = Rotation::from_axis_angle(&V3::x_axis(), STROBE_TURN_DEG.0.to_radians());
    base_from_camera()
        * forward
        * Rotation::from_axis_angle(&V3::y_axis(), STROBE_TURN_DEG.1.to_radians())
}
/// The servo that holds camera and lamps, in base, `t` seconds after the first frame.
fn servo(amplitude_deg: f64, t: f64) -> Pose {
    let deg = amplitude_deg * (TAU * t / SERVO_PERIOD_S).sin();
    let turn = Rotation::from_axis_angle(&V3::y_axis(), deg.to_radians());
    Pose::from_parts(V3::from(SERVO_IN_BASE).into(), turn)
}
fn base_from_dvl() -> Rotation {
    Rotation::from_axis_angle(&V3::x_axis(), PI)
}
/// Its x axis, the beam's, is down.
fn base_from_altimeter() -> Rotation {
    Rotation::from_axis_angle(&V3::y_axis(), 0.5 * PI)
}
/// Two lobes in angle: a wide one, rotated and off the axis, and a weak one beside it.
fn lobes(theta: f64, phi: f64) -> f64 {
    let lobe = |theta0: f64, phi0: f64, along: f64, across: f64, turn: f64| {
        let (sin, cos) = turn.to_radians().sin_cos();
        let (t, p) = (theta - theta0.to_radians(), phi - phi0.to_radians());
        let (a, b) =
            ((cos * t + sin * p) / along.to_radians(), (cos * p - sin * t) / across.to_radians());
        (-0.5 * (a * a + b * b)).exp()
    };
    lobe(3.0, -4.0, 24.0, 32.0, 20.0) + 0.25 * lobe(-16.0, 17.0, 11.0, 13.0, 0.0)
}
const LOBES_PEAK: f64 = 1.025_256_340_262_812_8; // found by walking uphill

// --- The image ---
/// Height of the ridges and its slopes along world x and y, for an amplitude of 1.
fn ridges(x: f64, y: f64) -> (f64, f64, f64) {
    // share, wavelength, y per x of its direction, phase
    let waves = [(0.6, 3.4, 0.15, 0.4), (0.4, 5.7, -0.25, 2.1)];
    waves.iter().fold((0.0, 0.0, 0.0), |(h, dx, dy), &(share, length, lean, phase)| {
        let k = TAU / length;
        let (sin, cos) = (k * (x + lean * y) + phase).sin_cos();
        (h + share * sin, dx + share * k * cos, dy + share * k * lean * cos)
    })
}
/// How many times `ray` fits between `from` and the seafloor, both in the world; `flat`: the same
/// to the flat seafloor.
fn meet(from: &V3, ray: &V3, flat: f64, slope: (f64, f64), relief_m: f64) -> f64 {
    let mut t = flat;
    for _ in 0..30 {
        let at = from + ray * t;
        let (h, dx, dy) = ridges(at.x, at.y);
        let over = at.z - at.x * slope.0 - at.y * slope.1 - relief_m * h;
        let step =
            over / (ray.z - ray.x * (slope.0 + relief_m * dx) - ray.y * (slope.1 + relief_m * dy));
        t -= step;
        if step.abs() < 1e-9 {
            break;
        }
    }
    t
}

/// A strobe or another lamp.
struct Lamp {
    position: V3, // in the camera's optical frame
    from_optical: Matrix3<f64>,
    pattern: Pattern,
}

/// One frame's geometry, in its camera's optical frame, its strobe's energy and its attenuation.
struct View {
    pose: (V3, Rotation),
    camera_in_world: V3,
    world_from_optical: Matrix3<f64>,
    plane: (V3, f64), // normal . X = distance
    slope: (f64, f64),
    relief_m: f64,
    lamps: Vec<Lamp>,
    strobe_energy: f64,
    attenuation: Bands,
}

impl View {
    fn new(dive: &Dive, frame: usize) -> Self {
        let t = frame as f64 / dive.frames_per_s;
        let pose = dive.pose(t);
        let rest = Pose::from_parts(V3::from(CAMERA_IN_BASE).into(), base_from_camera());
        let mut mount = rest;
        if dive.conditions.servo_deg != 0.0 {
            let servo = |deg: f64| servo(deg, t);
            mount = servo(dive.conditions.servo_deg) * servo(0.0).inverse() * mount;
        }
        let (camera, optical) = (mount.translation.vector, mount.rotation);
        let camera_in_world = pose.0 + pose.1 * camera;
        let age = if dive.frames > 1 { frame as f64 / (dive.frames - 1) as f64 } else { 0.5 };
        Self {
            pose,
            camera_in_world,
            world_from_optical: (pose.1 * optical).to_rotation_matrix().into_inner(),
            plane: (
                -((pose.1 * optical).inverse() * dive.seafloor_normal()),
                dive.seafloor_normal().dot(&camera_in_world),
            ),
            slope: (dive.slope_deg.0.to_radians().tan(), dive.slope_deg.1.to_radians().tan()),
            relief_m: dive.relief_m,
            lamps: dive.lamps(if dive.conditions.lamps_stay { &mount } else { &rest }),
            strobe_energy: dive.conditions.strobe_energy(dive.seed, frame),
            attenuation: Bands::from(dive.attenuation_per_m)
                * (1.0 + dive.attenuation_drift * (age - 0.5)),
        }
    }
    /// Where the ray (x, y, 1) meets the seafloor, in the optical frame.
    fn seafloor_point(&self, ray: [f64; 2]) -> V3 {
        let ray = V3::new(ray[0], ray[1], 1.0);
        assert!(
            self.plane.0.dot(&ray) > 1e-3,
            "a ray misses the seafloor: less tilt, slope or field of view"
        );
        let flat = self.plane.1 / self.plane.0.dot(&ray);
        if self.relief_m == 0.0 {
            return ray * flat;
        }
        let world = self.world_from_optical * ray;
        ray * meet(&self.camera_in_world, &world, flat, self.slope, self.relief_m)
    }
    /// The seafloor's normal at `point`, away from the camera; both in the optical frame.
    fn normal(&self, point: &V3) -> V3 {
        if self.relief_m == 0.0 {
            return self.plane.0;
        }
        let [x, y] = self.world_xy(point);
        let (_, dx, dy) = ridges(x, y);
        let up =
            V3::new(-self.slope.0 - self.relief_m * dx, -self.slope.1 - self.relief_m * dy, 1.0)
                .normalize();
        -(self.world_from_optical.transpose() * up)
    }
    fn world_xy(&self, at: &V3) -> [f64; 2] {
        (self.camera_in_world + self.world_from_optical * at).xy().into()
    }
    /// The direct light from a white seafloor at `point`.
    fn direct(&self, point: &V3, exponent: f64) -> Bands {
        let of_lamp = |lamp: &Lamp| {
            let from_lamp = point - lamp.position;
            let (la, ls) = (from_lamp.norm(), point.norm());
            let cos_gamma = (self.normal(point).dot(&from_lamp) / la).max(0.0);
            let radiance = lamp.pattern.intensity(&(lamp.from_optical * from_lamp)) * cos_gamma
                / la.powf(exponent);
            self.attenuation.map(|alpha| radiance * (-alpha * (la + ls)).exp())
        };
        self.lamps.iter().map(of_lamp).sum::<Bands>() * self.strobe_energy
    }
    /// Single scattering on the path to `point`, for b = 1 (midpoint rule).
    fn scattered(&self, point: &V3) -> Bands {
        let mut sum = Bands::zeros();
        for i in 0..SCATTER_POINTS {
            let at = point * ((i as f64 + 0.5) / SCATTER_POINTS as f64);
            for lamp in &self.lamps {
                let from_lamp = at - lamp.position;
                let radiance = lamp.pattern.intensity(&(lamp.from_optical * from_lamp))
                    / from_lamp.norm_squared();
                let path = BACKSCATTER_ATTENUATION_RATIO * (from_lamp.norm() + at.norm());
                sum += self.attenuation.map(|alpha| radiance * (-alpha * path).exp());
            }
        }
        sum * point.norm() / SCATTER_POINTS as f64 * self.strobe_energy
    }
    /// White seafloor at `point` under daylight of irradiance 1 at the surface.
    fn daylight(&self, point: &V3) -> Bands {
        let z = (self.camera_in_world + self.world_from_optical * point).z;
        let up = -(self.world_from_optical * self.normal(point)).z;
        daylight(z, up, &self.attenuation, point.norm())
    }
}

/// Amounts of light and the camera's gains, for a whole dive.
struct Lighting {
    exposure: f64,
    scattering: f64,
    uniform_backscatter: f64,
    daylight: f64,
    gains: Vec<FrameGain>,
    glow: Vec<Vec<Bands>>, // as in `Parts`, by frame
}

/// One frame's light at the coarse pixels, of every source for an amount of 1; empty where there is
/// none.
struct Parts {
    direct: Vec<Bands>,
    glow: Vec<Bands>, // backscatter of the strobe
    uniform_backscatter: Vec<Bands>,
    daylight: Vec<Bands>,
}

/// All frames' geometry and what they share: the seafloor and the camera's rays.
struct Scene<'a> {
    dive: &'a Dive,
    views: Vec<View>,
    seafloor: Seafloor,
    // x, y of the ray (x, y, 1) through each pixel's centre, then through its four quarters
    rays: Vec<[[f64; 2]; 5]>,
    coarse: Vec<[f64; 2]>, // the same through every `COARSE_PX`th pixel
    coarse_width: usize,
}

impl<'a> Scene<'a> {
    fn new(dive: &'a Dive) -> Self {
        let (width, height) = (dive.width, dive.height);
        let views: Vec<View> = (0..dive.frames).map(|k| View::new(dive, k)).collect();
        let pixel = |i: usize| {
            let (u, v) = ((i % width) as f64, (i / width) as f64);
            [(0.0, 0.0), (-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)]
                .map(|q| dive.ray(u + q.0, v + q.1))
        };
        let (coarse_width, rows) =
            ((width - 1).div_ceil(COARSE_PX) + 1, (height - 1).div_ceil(COARSE_PX) + 1);
        let place = |i: usize| {
            ((COARSE_PX * (i % coarse_width)) as f64, (COARSE_PX * (i / coarse_width)) as f64)
        };
        let coarse: Vec<[f64; 2]> =
            (0..coarse_width * rows).map(|i| dive.ray(place(i).0, place(i).1)).collect();
        let footprint = 0.5 * (dive.altitude_m.0 + dive.altitude_m.1) / dive.focal_px;
        let seen = views
            .iter()
            .flat_map(|view| coarse.iter().map(|&ray| view.world_xy(&view.seafloor_point(ray))));
        let seafloor = Seafloor::new(dive.seed, footprint, seen);
        let rays = (0..width * height).into_par_iter().map(pixel).collect();
        Self { dive, views, seafloor, rays, coarse, coarse_width }
    }
    /// A frame's light at every eighth pixel.
    fn parts(&self, view: &View) -> Parts {
        let conditions = &self.dive.conditions;
        let points: Vec<V3> = self.coarse.iter().map(|&ray| view.seafloor_point(ray)).collect();
        let reflectance = |at: &V3| self.seafloor.at(view.world_xy(at));
        let white = |at: &V3| view.direct(at, self.dive.spreading_exponent);
        let where_any = |amount: f64, of: &dyn Fn(&V3) -> Bands| {
            points.iter().filter(|_| amount > 0.0).map(of).collect()
        };
        Parts {
            direct: points.iter().map(|at| white(at).component_mul(&reflectance(at))).collect(),
            glow: where_any(self.dive.backscatter, &|at| view.scattered(at)),
            uniform_backscatter: where_any(conditions.uniform_backscatter, &|at| {
                uniform_backscatter(&view.attenuation, at.norm())
            }),
            daylight: where_any(conditions.daylight, &|at| {
                view.daylight(at).component_mul(&reflectance(at))
            }),
        }
    }
    /// The dive's amounts of light, its one exposure and the gains of its frames.
    fn expose(&self) -> Lighting {
        let conditions = &self.dive.conditions;
        let parts: Vec<Parts> = self.views.par_iter().map(|view| self.parts(view)).collect();
        let sum = |of: &dyn Fn(&Parts) -> &Vec<Bands>| {
            parts.iter().flat_map(of).map(V3::sum).sum::<f64>()
        };
        let direct = sum(&|p| &p.direct);
        let amount = |share: f64, of: &dyn Fn(&Parts) -> &Vec<Bands>| {
            share * direct / sum(of).max(f64::MIN_POSITIVE)
        };
        let mut lighting = Lighting {
            exposure: 1.0,
            scattering: amount(self.dive.backscatter, &|p| &p.glow),
            uniform_backscatter: amount(conditions.uniform_backscatter, &|p| {
                &p.uniform_backscatter
            }),
            daylight: amount(conditions.daylight, &|p| &p.daylight),
            gains: Vec::new(),
            glow: Vec::new(),
        };
        lighting.gains = self.gains(&parts, &lighting);
        let seafloor = |(p, gain): (&Parts, &FrameGain)| {
            let gain = gain.amplification * gain.exposure;
            let lit = |i: usize| {
                let day = p.daylight.get(i).map_or(Bands::zeros(), |day| day * lighting.daylight);
                (p.direct[i] + day).component_mul(&gain).max()
            };
            (0..p.direct.len()).map(lit).collect::<Vec<f64>>()
        };
        let mut brightest: Vec<f64> =
            parts.iter().zip(&lighting.gains).flat_map(seafloor).collect();
        brightest.sort_by(f64::total_cmp);
        lighting.exposure = EXPOSED_TO / brightest[(0.998 * (brightest.len() - 1) as f64) as usize];
        lighting.glow = parts.into_iter().map(|p| p.glow).collect();
        lighting
    }
    /// What the automatics, the recorded settings and the strobe's energy make of each frame.
    fn gains(&self, parts: &[Parts], lighting: &Lighting) -> Vec<FrameGain> {
        let conditions = &self.dive.conditions;
        let automatic = if conditions.has_automatics() {
            let frames = self.views.par_iter().zip(parts);
            let means: Vec<Bands> =
                frames.map(|(view, parts)| self.mean_light(view, &parts.glow, lighting)).collect();
            conditions.automatic_gains(&means)
        } else {
            vec![(1.0, Bands::repeat(1.0)); self.views.len()]
        };
        let all = automatic.into_iter().enumerate().map(|(k, (exposure, amplification))| {
            let settings = conditions.settings.map(|_| self.dive.settings(k));
            FrameGain {
                exposure: exposure * settings.map_or(1.0, Settings::exposure),
                amplification: amplification * settings.map_or(1.0, Settings::gain),
                strobe_energy: self.views[k].strobe_energy,
            }
        });
        all.collect()
    }
    /// A frame's mean behind the lens at gain 1.
    fn mean_light(&self, view: &View, glow: &[Bands], lighting: &Lighting) -> Bands {
        let through_lens = |(i, rays): (usize, &[[f64; 2]; 5])| {
            let point = view.seafloor_point(rays[0]);
            let reflectance = self.seafloor.at(view.world_xy(&point));
            let scatter = self.between_nodes(glow, i) * lighting.scattering;
            let light = self.light(view, &point, &reflectance, lighting);
            (light.iter().sum::<Bands>() + scatter) * self.dive.conditions.lens(rays[0])
        };
        let sum: Bands = self.rays.iter().enumerate().map(through_lens).sum();
        sum / self.rays.len() as f64
    }
    /// Direct light of the strobe, daylight and uniform backscatter from `point`.
    fn light(
        &self,
        view: &View,
        point: &V3,
        reflectance: &Bands,
        lighting: &Lighting,
    ) -> [Bands; 3] {
        let direct = view.direct(point, self.dive.spreading_exponent).component_mul(reflectance);
        let (mut day, mut uniform) = (Bands::zeros(), Bands::zeros());
        if lighting.daylight > 0.0 {
            day = view.daylight(point).component_mul(reflectance) * lighting.daylight;
        }
        if lighting.uniform_backscatter > 0.0 {
            let path = uniform_backscatter(&view.attenuation, point.norm());
            uniform = path * lighting.uniform_backscatter;
        }
        [direct, day, uniform]
    }
    fn render(&self, k: usize, lighting: &Lighting) -> (FrameTruth, Vec<u8>) {
        let (view, gain, frame_gain) = (&self.views[k], self.dive.gain(k), &lighting.gains[k]);
        let (mut reflectance, mut signal) =
            (Vec::with_capacity(self.rays.len()), Vec::with_capacity(self.rays.len()));
        let mut sums = [Bands::zeros(); 3];
        for (i, rays) in self.rays.iter().enumerate() {
            let sample = |j: usize| self.seafloor.at(view.world_xy(&view.seafloor_point(rays[j])));
            let r = (sample(1) + sample(2) + sample(3) + sample(4)) * 0.25;
            let point = view.seafloor_point(rays[0]);
            let [direct, day, uniform] = self.light(view, &point, &r, lighting);
            let scatter = self.between_nodes(&lighting.glow[k], i) * lighting.scattering + uniform;
            sums.iter_mut().zip([direct, day, scatter]).for_each(|(sum, part)| *sum += part);
            let lens = self.dive.conditions.lens(rays[0]);
            let light = (direct + scatter + day) * gain * lighting.exposure * lens;
            signal.push(light * frame_gain.exposure);
            reflectance.push([r.x as f32, r.y as f32, r.z as f32]);
        }
        let settings = frame_gain.amplification * (gain * frame_gain.exposure);
        let truth = FrameTruth {
            stamp_ns: stamp(self.dive.frame_ns(k)),
            position: view.pose.0.into(),
            orientation_xyzw: view.pose.1.coords.into(),
            plane_normal_in_optical: view.plane.0.into(),
            plane_distance_m: view.plane.1,
            gain,
            gains: (settings * frame_gain.strobe_energy).into(),
            strobe_energy: frame_gain.strobe_energy,
            reflectance,
            attenuation_per_m: view.attenuation.into(),
            daylight_share: sums[1].component_div(&sums[0]).into(),
            backscatter_share: sums[2].component_div(&sums[0]).into(),
        };
        (truth, self.dive.image(k, &signal, &frame_gain.amplification))
    }
    /// Bilinear between the coarse pixels around pixel `i`.
    fn between_nodes(&self, nodes: &[Bands], i: usize) -> Bands {
        if nodes.is_empty() {
            return Bands::zeros();
        }
        let (u, v) = (i % self.dive.width, i / self.dive.width);
        let at = v / COARSE_PX * self.coarse_width + u / COARSE_PX;
        let part = |i: usize| (i % COARSE_PX) as f64 / COARSE_PX as f64;
        // On the last node there is no next one, and its weight is 0.
        let next =
            (if part(u) > 0.0 { 1 } else { 0 }, if part(v) > 0.0 { self.coarse_width } else { 0 });
        let row = |at: usize| nodes[at].lerp(&nodes[at + next.0], part(u));
        row(at).lerp(&row(at + next.1), part(v))
    }
}

// --- The seafloor ---
/// Linear reflectances: the first four are sediments, all are pebbles.
const PALETTE: [[f64; 3]; 10] = [
    // sand, mud, pale sand, algal film
    [0.33, 0.27, 0.19],
    [0.21, 0.20, 0.18],
    [0.44, 0.39, 0.31],
    [0.24, 0.25, 0.17],
    [0.09, 0.09, 0.10],
    [0.70, 0.68, 0.62],
    [0.43, 0.20, 0.22], // basalt, shell, coralline crust
    [0.55, 0.26, 0.09],
    [0.12, 0.23, 0.10],
    [0.18, 0.23, 0.30], // sponge, weed, slate
];
const REFLECTANCE: (f64, f64) = (0.05, 0.8);
/// The seafloor's colours in texels; bilinear between.
struct Seafloor {
    octaves: Vec<Layer>,
    pebbles: Vec<Layer>,
    // a pixel's size at the mean altitude, metres: the width of a pebble's edge, and two texels
    footprint: f64,
    corner: [f64; 2],
    across: usize,
    texels: Vec<[f32; 3]>,
}

impl Seafloor {
    /// `seen`: positions in the world whose bounding box contains all that is in view.
    fn new(seed: u64, footprint: f64, seen: impl Iterator<Item = [f64; 2]>) -> Self {
        let layer = |id: u64, cell: f64| {
            // each rotated by another angle, so that no two are aligned
            let (sin, cos) = (2.4 * id as f64).sin_cos();
            Layer { seed: hash(seed, id, 0x0f10), cell, sin: sin / cell, cos: cos / cell }
        };
        let layers = |id: u64, largest: f64, ratio: f64, least: f64| -> Vec<Layer> {
            let cells = (0..9).map(|k| largest * ratio.powi(k)).enumerate();
            cells
                .filter(|&(k, cell)| k < 4 || cell > least)
                .map(|(k, cell)| layer(id + k as u64, cell))
                .collect()
        };
        let (low, high) = seen.fold(([f64::MAX; 2], [f64::MIN; 2]), |(low, high), at| {
            ([low[0].min(at[0]), low[1].min(at[1])], [high[0].max(at[0]), high[1].max(at[1])])
        });
        let (texel, margin) = (0.5 * footprint, 8.0 * footprint);
        let corner = low.map(|edge| edge - margin);
        let [across, down] = [0, 1].map(|i| ((high[i] + margin - corner[i]) / texel) as usize + 2);
        let mut seafloor = Self {
            octaves: layers(100, 0.64, 0.5, 2.0 * footprint),
            pebbles: layers(200, 0.34, 0.66, 7.0 * footprint),
            footprint,
            corner,
            across,
            texels: Vec::new(),
        };
        let place = |i: usize| {
            (corner[0] + (i % across) as f64 * texel, corner[1] + (i / across) as f64 * texel)
        };
        seafloor.texels = (0..across * down)
            .into_par_iter()
            .map(|i| seafloor.paint(place(i).0, place(i).1))
            .collect();
        seafloor
    }
    fn at(&self, at: [f64; 2]) -> Bands {
        let [u, v] = [0, 1].map(|i| (at[i] - self.corner[i]) / (0.5 * self.footprint));
        let first = v as usize * self.across + u as usize;
        let texel = |i: usize| Bands::from(self.texels[i].map(f64::from));
        let row = |i: usize| texel(i).lerp(&texel(i + 1), u.fract());
        row(first).lerp(&row(first + self.across), v.fract())
    }
    fn paint(&self, x: f64, y: f64) -> [f32; 3] {
        let [a, b] = [0, 1].map(|i| (0.5 + self.octaves[i].noise(x, y)).clamp(0.0, 1.0));
        let [sand, mud, pale, film] = [0, 1, 2, 3].map(|kind| Bands::from(PALETTE[kind]));
        let mut colour = sand.lerp(&mud, a).lerp(&pale.lerp(&film, a), b);
        let wobble = self.octaves[self.octaves.len() / 2].noise(x, y);
        self.pebbles
            .iter()
            .for_each(|layer| layer.cover(x, y, wobble, self.footprint, &mut colour));
        let shade =
            (0.2 * self.octaves[2..].iter().map(|octave| octave.noise(x, y)).sum::<f64>()).exp();
        [0, 1, 2].map(|band| (colour[band] * shade).clamp(REFLECTANCE.0, REFLECTANCE.1) as f32)
    }
}

/// One lattice of noise, or of cells with at most one pebble each.
// cell in metres; sine and cosine of its angle, over `cell`
struct Layer {
    seed: u64,
    cell: f64,
    sin: f64,
    cos: f64,
}

impl Layer {
    /// The cell of (x, y), and the position in it, 0..1.
    fn locate(&self, x: f64, y: f64) -> (i64, i64, f64, f64) {
        let (u, v) = (self.cos * x + self.sin * y, self.cos * y - self.sin * x);
        // faster than f64::floor on old targets
        let floor = |x: f64| x as i64 - i64::from(x < (x as i64) as f64);
        (floor(u), floor(v), u - floor(u) as f64, v - floor(v) as f64)
    }
    /// Value noise, -1..1.
    fn noise(&self, x: f64, y: f64) -> f64 {
        let (iu, iv, u, v) = self.locate(x, y);
        let value = |du: i64, dv: i64| 2.0 * unit(hash(self.seed, (iu + du) as u64, iv + dv)) - 1.0;
        let between = |a: f64, b: f64, part: f64| a + smooth(part) * (b - a);
        between(between(value(0, 0), value(1, 0), u), between(value(0, 1), value(1, 1), u), v)
    }
    /// Lays this layer's pebble, if one is here, over `colour`. `edge`: width of its edge, metres.
    fn cover(&self, x: f64, y: f64, wobble: f64, edge: f64, colour: &mut Bands) {
        let (iu, iv, u, v) = self.locate(x, y);
        let dice = hash(self.seed, iu as u64, iv);
        // eight numbers of 0..1, a byte each
        let die = |n: u32| ((dice >> (8 * n)) & 255) as i32 as f64 / 255.0;
        let radius = 0.16 + 0.2 * die(1);
        let reach = radius * 1.25; // inside the cell, also where the outline wobbles outward
        let (du, dv) =
            (u - reach - (1.0 - 2.0 * reach) * die(2), v - reach - (1.0 - 2.0 * reach) * die(3));
        if die(0) > 0.5 || du * du + dv * dv > 1.1 * reach * reach {
            return;
        }
        let (sin, cos) = (PI * die(4)).sin_cos();
        let (p, q) = (cos * du + sin * dv, (cos * dv - sin * du) * (1.0 + 0.8 * die(5)));
        // One in four is a shard with corners.
        let out = if dice & 3 == 0 { 1.35 * p.abs().max(q.abs()) } else { (p * p + q * q).sqrt() };
        let opacity =
            ((radius * (1.0 + 0.22 * wobble) - out) * self.cell / edge + 0.5).clamp(0.0, 1.0);
        let dome = (0.75 + 0.5 * die(7)) * (1.0 - 0.35 * (out / radius).powi(2));
        *colour = colour.lerp(&(Bands::from(PALETTE[(die(6) * 9.99) as usize]) * dome), opacity);
    }
}

// --- Random numbers without a state: every draw is a hash of its purpose ---
/// SplitMix64's finaliser over a lattice point.
fn hash(seed: u64, a: u64, b: i64) -> u64 {
    let mut z = a
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add((b as u64).wrapping_mul(0xd1b5_4a32_d192_ed03));
    z = z.wrapping_add(seed);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
/// 0..1.
fn unit(hash: u64) -> f64 {
    (hash >> 11) as i64 as f64 / (1_u64 << 53) as f64
}
fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}
/// Standard normal (Box-Muller).
fn gaussian(hash: u64) -> f64 {
    let radius = ((hash >> 32) + 1) as f64 / 4_294_967_296.0;
    (-2.0 * radius.ln()).sqrt() * (TAU * (hash & 0xffff_ffff) as f64 / 4_294_967_296.0).cos()
}

// --- The messages: camera, DVL, IMU, mounts ---
type Messages = Vec<(i64, &'static str, &'static str, Vec<u8>)>; // log time, topic, type, data
fn stamp(ns: i64) -> u64 {
    (FIRST_FRAME_NS + ns) as u64
}
fn diagonal(value: f64) -> [f64; 9] {
    [value, 0.0, 0.0, 0.0, value, 0.0, 0.0, 0.0, value]
}

impl Dive {
    fn centre(&self) -> (f64, f64) {
        (0.5 * (self.width as f64 - 1.0), 0.5 * (self.height as f64 - 1.0))
    }
    /// The pixel's ray (x, y, 1): plumb_bob inverted by fixed-point iteration.
    fn ray(&self, u: f64, v: f64) -> [f64; 2] {
        let (xd, yd) =
            ((u - self.centre().0) / self.focal_px, (v - self.centre().1) / self.focal_px);
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (mut x, mut y) = (xd, yd);
        for _ in 0..200 {
            let (a, b, r2) = (x, y, x * x + y * y);
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            x = (xd - 2.0 * p1 * a * b - p2 * (r2 + 2.0 * a * a)) / radial;
            y = (yd - p1 * (r2 + 2.0 * b * b) - 2.0 * p2 * a * b) / radial;
            if (x - a).abs() + (y - b).abs() < 1e-13 {
                return [x, y];
            }
        }
        panic!("distortion {:?} cannot be undone at pixel ({u}, {v})", self.distortion);
    }
    /// Strobe, second strobe and second lamp in the optical frame of a camera with this mount.
    fn lamps(&self, mount: &Pose) -> Vec<Lamp> {
        let (camera, optical) = (mount.translation.vector, mount.rotation);
        let lamp = |at: [f64; 3], base_from_lamp: Rotation, pattern: Pattern| Lamp {
            position: optical.inverse() * (V3::from(at) - camera),
            from_optical: (base_from_lamp.inverse() * optical).to_rotation_matrix().into_inner(),
            pattern,
        };
        let mut lamps = vec![lamp(STROBE_IN_BASE, base_from_strobe(), Pattern::Strobe)];
        if self.second_strobe {
            lamps.push(lamp(SECOND_STROBE_IN_BASE, base_from_strobe(), Pattern::Strobe));
        }
        if self.conditions.second_lamp != SecondLamp::None {
            lamps.push(lamp(LAMP_IN_BASE, base_from_camera() * lamp_turn(), Pattern::Lamp));
        }
        lamps
    }
    /// The sensor: noise, amplification, quantisation and coding of a frame whose full scale is 1.
    fn image(&self, frame: usize, signal: &[Bands], amplification: &Bands) -> Vec<u8> {
        let conditions = &self.conditions;
        let noisy = |i: usize, band: usize| {
            let electrons = signal[i][band] * FULL_WELL_E;
            let sigma =
                if self.noise { (electrons + READ_NOISE_E * READ_NOISE_E).sqrt() } else { 0.0 };
            let draw = gaussian(hash(self.seed ^ 0x5e75_0000, (3 * i + band) as u64, frame as i64));
            (electrons + sigma * draw) / FULL_WELL_E * amplification[band] + conditions.black_level
        };
        let whole = |c: f64| if conditions.has_truncating_adc { c.floor() } else { c.round() };
        let twelve = |c: f64| ((whole(c * 4095.0).clamp(0.0, 4095.0) as u16) << 4).to_le_bytes();
        let coded = |c: f64| conditions.response.encode(c);
        let eight = |c: f64| (255.0 * coded(c.clamp(0.0, 1.0))).round() as u8;
        let rggb = |i: usize| i % self.width % 2 + i / self.width % 2;
        let one = 0..signal.len();
        let three = one.clone().flat_map(|i| [(i, 0), (i, 1), (i, 2)]);
        let (encoding, data): (&str, Vec<u8>) = match self.sensor {
            Sensor::Bayer16 => {
                ("bayer_rggb16", one.flat_map(|i| twelve(noisy(i, rggb(i)))).collect())
            }
            Sensor::Mono16 => ("mono16", one.flat_map(|i| twelve(noisy(i, 1))).collect()),
            Sensor::Rgb16 => {
                ("rgb16", three.flat_map(|(i, band)| twelve(noisy(i, band))).collect())
            }
            Sensor::Rgb8 | Sensor::Jpeg(_) | Sensor::Jpeg420(_) => {
                ("rgb8", three.map(|(i, band)| eight(noisy(i, band))).collect())
            }
        };
        let (width, height) = (self.width, self.height);
        let mut cdr = Cdr::headed(self.frame_ns(frame), "camera_optical_frame");
        if let Sensor::Jpeg(quality) | Sensor::Jpeg420(quality) = self.sensor {
            let mut jpeg = Vec::new();
            let mut encoder = jpeg_encoder::Encoder::new(&mut jpeg, quality);
            if matches!(self.sensor, Sensor::Jpeg420(_)) {
                encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_2_2);
            }
            encoder
                .encode(&data, width as u16, height as u16, jpeg_encoder::ColorType::Rgb)
                .expect("a JPEG");
            cdr.string("jpeg").bytes(&jpeg);
        } else {
            let step = data.len() / height;
            cdr.u32(height as u32)
                .u32(width as u32)
                .string(encoding)
                .u8(0)
                .u32(step as u32)
                .bytes(&data);
        }
        cdr.0
    }
    /// All but the images.
    fn navigation(&self) -> Messages {
        let end = self.frame_ns(self.frames);
        let times = |(start, step): (i64, i64)| (start..end).step_by(step as usize).enumerate();
        let mut messages =
            vec![(IMU_NS.0, "/tf_static", "tf2_msgs/msg/TFMessage", self.tf_static(IMU_NS.0))];
        let turns = times(IMU_NS).filter(|_| self.conditions.servo_deg != 0.0);
        messages.extend(turns.map(|(_, ns)| {
            (ns + 8_000_000, "/tf", "tf2_msgs/msg/TFMessage", self.tf_of_servo(ns))
        }));
        let imu = times(IMU_NS).filter(|_| self.with_imu);
        messages.extend(
            imu.map(|(n, ns)| (ns + 3_000_000, "/imu", "sensor_msgs/msg/Imu", self.imu(ns, n))),
        );
        let recorded =
            |gain: f64| if self.gain_channel == Some(true) { 20.0 * gain.log10() } else { gain };
        let setting = |k: usize| {
            let mut cdr = Cdr::new();
            cdr.f64(recorded(self.gain(k)));
            cdr.0
        };
        let frames = (0..self.frames).filter(|_| self.gain_channel.is_some());
        messages.extend(frames.map(|k| {
            (self.frame_ns(k) - 20_000_000, "/camera/gain", "std_msgs/msg/Float64", setting(k))
        }));
        messages.extend((0..self.frames).flat_map(|k| self.settings_messages(k)));
        let depths = times(DEPTH_NS).filter(|_| self.conditions.has_depth_sensor);
        messages.extend(
            depths.map(|(n, ns)| {
                (ns + 5_000_000, "/depth", "std_msgs/msg/Float64", self.depth(ns, n))
            }),
        );
        let mut altitude = -1.0;
        let (topic, dvl) = match self.dvl {
            DvlType::WaterLinked => ("/dvl/data", "dvl_msgs/msg/DVL"),
            DvlType::MarineAcoustic => ("/dvl/data", "marine_acoustic_msgs/msg/Dvl"),
            DvlType::Altimeter => ("/altimeter/range", "sensor_msgs/msg/Range"),
        };
        let mut ping = |(n, ns)| (ns + 60_000_000, topic, dvl, self.ping(ns, n, &mut altitude));
        messages.extend(times(PING_NS).map(&mut ping));
        messages
    }
    /// Exposure and gain of a frame, as they are recorded.
    fn settings_messages(&self, frame: usize) -> Messages {
        let (settings, ns) = (self.settings(frame), self.frame_ns(frame));
        let number = |topic: &'static str, value: f64| {
            let mut cdr = Cdr::new();
            cdr.f64(value);
            (ns - 20_000_000, topic, "std_msgs/msg/Float64", cdr.0)
        };
        match self.conditions.settings {
            None => Vec::new(),
            Some(SettingsMessage::ImageMetaData) => {
                let mut cdr = Cdr::headed(ns, "camera_optical_frame");
                cdr.u64(stamp(ns)).i16(128).u32(settings.exposure_us).u32(30_000);
                cdr.f32(settings.gain_db);
                vec![(ns + 42_000_000, "/camera/meta", "flir_camera_msgs/msg/ImageMetaData", cdr.0)]
            }
            Some(SettingsMessage::Float64) => vec![
                number("/camera/exposure_time", f64::from(settings.exposure_us) * 1e-6),
                number("/camera/gain", settings.gain()),
            ],
            Some(SettingsMessage::Stops) => vec![number("/camera/exposure_ev", settings.stops())],
        }
    }
    /// Depth of the base below the surface.
    fn depth(&self, ns: i64, n: usize) -> Vec<u8> {
        let noise = DEPTH_NOISE_M * gaussian(hash(self.seed, n as u64, 0xde97));
        let mut cdr = Cdr::new();
        cdr.f64(WATER_DEPTH_M - self.pose(ns as f64 * 1e-9).0.z + noise);
        cdr.0
    }
    /// The beams' unit vectors in the DVL's frame, in message order; the altimeter is the first.
    fn beams(&self) -> [V3; 4] {
        let (janus_deg, azimuths_deg) = match self.dvl {
            DvlType::MarineAcoustic => (30.0_f64, [45.0_f64, 135.0, -135.0, -45.0]),
            DvlType::WaterLinked => (22.5, [135.0, -135.0, -45.0, 45.0]),
            DvlType::Altimeter => (0.0, [0.0; 4]),
        };
        let (sin, cos) = janus_deg.to_radians().sin_cos();
        azimuths_deg
            .map(|deg| V3::new(sin * deg.to_radians().cos(), sin * deg.to_radians().sin(), cos))
    }
    /// `altitude` is the last good one: the Water Linked message repeats it where bottom lock is
    /// lost.
    fn ping(&self, ns: i64, n: usize, altitude: &mut f64) -> Vec<u8> {
        let t = ns as f64 * 1e-9;
        let place = |t: f64| {
            let (at, attitude) = self.pose(t);
            at + attitude * V3::from(DVL_IN_BASE)
        };
        let dvl_from_world = (self.pose(t).1 * base_from_dvl()).inverse();
        let fluke = V3::from_fn(|axis, _| {
            self.velocity_noise_m_per_s * gaussian(hash(self.seed, (3 * n + axis) as u64, 0x0e10))
        });
        let velocity = dvl_from_world * (place(t + 1e-3) - place(t - 1e-3)) / 2e-3 + fluke;
        let (up, height) =
            (dvl_from_world * self.seafloor_normal(), self.seafloor_normal().dot(&place(t)));
        let beams = self.beams();
        let ranges: [Option<f64>; 4] = std::array::from_fn(|i| {
            let key = (4 * n + i) as u64;
            let (lost, towards) =
                (unit(hash(self.seed, key, 0x105e)) < self.lost_beams, -up.dot(&beams[i]));
            let noise = self.range_noise * gaussian(hash(self.seed, key, 0x2a49));
            let range = || {
                let flat = height / towards;
                if self.relief_m == 0.0 {
                    return flat;
                }
                let slope =
                    (self.slope_deg.0.to_radians().tan(), self.slope_deg.1.to_radians().tan());
                meet(&place(t), &(dvl_from_world.inverse() * beams[i]), flat, slope, self.relief_m)
            };
            (!lost && towards > 0.1).then(|| range() * (1.0 + noise))
        });
        let good: Vec<f64> = ranges.iter().flatten().copied().collect();
        if !good.is_empty() {
            *altitude = beams[0].z * good.iter().sum::<f64>() / good.len() as f64;
        }
        let (any, bottom) = (u8::from(!good.is_empty()), u8::from(good.len() >= 3));
        let mut cdr = Cdr::headed(ns, self.range_mount().0);
        match self.dvl {
            DvlType::Altimeter => {
                // ultrasound; a narrow beam, 0.1 to 50 m; +inf is no return (REP 117)
                cdr.u8(0).f32(0.05).f32(0.1).f32(50.0);
                cdr.f32(ranges[0].unwrap_or(f64::INFINITY) as f32).f32(0.0);
            }
            DvlType::MarineAcoustic => {
                cdr.u8(1).u8(0).f64s(velocity.as_slice()).f64s(&diagonal(9e-6));
                cdr.f64(if any == 1 { *altitude } else { -1.0 });
                cdr.f64(velocity.y.atan2(velocity.x))
                    .f64(velocity.xy().norm())
                    .u8(good.len() as u8);
                cdr.f32(1500.0).u8(any).u8(bottom);
                beams.iter().for_each(|beam| {
                    cdr.f64s(beam.as_slice());
                });
                cdr.f64s(&ranges.map(|range| range.unwrap_or(f64::NAN)));
                cdr.f32s(
                    ranges.map(|range| {
                        range.map_or(-1.0, |range| (range * self.range_noise).powi(2))
                    }),
                );
                cdr.f32s(ranges.map(|range| if range.is_some() { 200.0 } else { 0.0 }));
                cdr.f32s(beams.map(|beam| -velocity.dot(&beam))).f32s([-1.0; 4]);
            }
            DvlType::WaterLinked => {
                cdr.f64(PING_NS.1 as f64 * 1e-6).f64s(velocity.as_slice()).f64(0.003);
                cdr.u32(9).f64s(&diagonal(9e-6)).f64(*altitude).u32(4);
                for (i, range) in ranges.iter().enumerate() {
                    cdr.i64(i as i64).f64(-velocity.dot(&beams[i])).f64(range.unwrap_or(-1.0));
                    cdr.f64(-32.0).f64(-90.0).u8(u8::from(range.is_some()));
                }
                let us = stamp(ns) as i64 / 1000;
                cdr.u8(bottom).i64(0).i64(us).i64(us + 5_000).string("json_v3");
            }
        }
        cdr.0
    }
    fn imu(&self, ns: i64, n: usize) -> Vec<u8> {
        let (t, dt) = (ns as f64 * 1e-9, 1e-3);
        let (before, now, after) = (self.pose(t - dt), self.pose(t), self.pose(t + dt));
        let force = now.1.inverse()
            * ((after.0 - 2.0 * now.0 + before.0) / (dt * dt) + V3::new(0.0, 0.0, 9.81));
        let rate = (before.1.inverse() * after.1).scaled_axis() / (2.0 * dt);
        let error =
            V3::from([0, 1, 2].map(|axis| gaussian(hash(self.seed, n as u64, 0x1300 + axis))));
        let sigma = if self.noise { ATTITUDE_NOISE_RAD } else { 0.0 };
        let on_servo = self.conditions.imu_on_servo;
        let deg = if on_servo { self.conditions.servo_deg } else { 0.0 };
        let sensor = now.1 * servo(deg, t).rotation;
        let attitude = (sensor * Rotation::from_scaled_axis(error * sigma)).coords;
        let mut cdr = Cdr::headed(ns, if on_servo { "servo_link" } else { "base_link" });
        cdr.f64s(attitude.as_slice()).f64s(&diagonal(ATTITUDE_NOISE_RAD.powi(2)));
        cdr.f64s(rate.as_slice())
            .f64s(&diagonal(1e-6))
            .f64s(force.as_slice())
            .f64s(&diagonal(4e-4));
        cdr.0
    }
    /// Frame, position and orientation of the DVL or the altimeter.
    fn range_mount(&self) -> (&'static str, [f64; 3], Rotation) {
        match self.dvl {
            DvlType::Altimeter => ("altimeter_link", DVL_IN_BASE, base_from_altimeter()),
            _ => ("dvl_link", DVL_IN_BASE, base_from_dvl()),
        }
    }
    fn tf_static(&self, ns: i64) -> Vec<u8> {
        let camera = ("camera_optical_frame", CAMERA_IN_BASE, base_from_camera());
        let mut mounts = vec![camera, self.range_mount()];
        let error = self.conditions.strobe_mount_error_m;
        let strobe = std::array::from_fn(|axis| STROBE_IN_BASE[axis] + error[axis]);
        if self.with_strobe_mount {
            mounts.push(("strobe_optical_frame", strobe, base_from_strobe()));
        }
        if self.with_strobe_mount && self.second_strobe {
            mounts.push(("second_strobe_optical_frame", SECOND_STROBE_IN_BASE, base_from_strobe()));
        }
        if self.with_strobe_mount && self.conditions.second_lamp == SecondLamp::Listed {
            let turn = base_from_camera() * lamp_turn();
            mounts.push(("lamp_optical_frame", LAMP_IN_BASE, turn));
        }
        let has_servo = self.conditions.servo_deg != 0.0;
        let mut cdr = Cdr::new();
        cdr.u32(mounts.len() as u32);
        for (child, at, turn) in mounts {
            let (mut parent, mut pose) = ("base_link", Pose::from_parts(V3::from(at).into(), turn));
            let is_camera = child == "camera_optical_frame";
            let turns =
                is_camera || child.ends_with("optical_frame") && !self.conditions.lamps_stay;
            if has_servo && turns {
                (parent, pose) = ("servo_link", servo(0.0, 0.0).inverse() * pose);
            }
            cdr.transform(ns, parent, child, &pose);
        }
        cdr.0
    }
    fn tf_of_servo(&self, ns: i64) -> Vec<u8> {
        let mut cdr = Cdr::new();
        cdr.u32(1);
        let pose = servo(self.conditions.servo_deg, ns as f64 * 1e-9);
        cdr.transform(ns, "base_link", "servo_link", &pose);
        cdr.0
    }
    fn camera_info(&self, ns: i64) -> Vec<u8> {
        let (f, (cx, cy)) = (self.focal_px, self.centre());
        let mut cdr = Cdr::headed(ns, "camera_optical_frame");
        cdr.u32(self.height as u32)
            .u32(self.width as u32)
            .string("plumb_bob")
            .u32(5)
            .f64s(&self.distortion);
        cdr.f64s(&[f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0]).f64s(&diagonal(1.0));
        cdr.f64s(&[f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
        cdr.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).u8(0); // no binning, no region of interest
        cdr.0
    }
}

// --- The file ---
/// Little-endian CDR: numbers align to their size, counted after the four bytes of encapsulation.
struct Cdr(Vec<u8>);

macro_rules! numbers {
    ($($kind:ident)*) => {
        $(fn $kind(&mut self, value: $kind) -> &mut Self {
            self.aligned(&value.to_le_bytes())
        })*
    };
}

impl Cdr {
    numbers!(u8 i16 u32 i64 u64 f32 f64);
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }
    fn headed(ns: i64, frame_id: &str) -> Self {
        let mut cdr = Self::new();
        cdr.header(ns, frame_id);
        cdr
    }
    fn aligned(&mut self, bytes: &[u8]) -> &mut Self {
        self.0.resize((self.0.len() - 4).next_multiple_of(bytes.len()) + 4, 0);
        self.0.extend_from_slice(bytes);
        self
    }
    fn f64s(&mut self, values: &[f64]) -> &mut Self {
        values.iter().fold(self, |cdr, &value| cdr.f64(value))
    }
    fn f32s(&mut self, values: [f64; 4]) -> &mut Self {
        values.iter().fold(self, |cdr, &value| cdr.f32(value as f32))
    }
    fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.u32(bytes.len() as u32).0.extend_from_slice(bytes);
        self
    }
    fn string(&mut self, text: &str) -> &mut Self {
        self.bytes(format!("{text}\0").as_bytes())
    }
    fn transform(&mut self, ns: i64, parent: &str, child: &str, pose: &Pose) {
        self.header(ns, parent).string(child).f64s(pose.translation.vector.as_slice());
        self.f64s(pose.rotation.coords.as_slice());
    }
    fn header(&mut self, ns: i64, frame_id: &str) -> &mut Self {
        self.u32((stamp(ns) / 1_000_000_000) as u32)
            .u32((stamp(ns) % 1_000_000_000) as u32)
            .string(frame_id)
    }
}
fn write_log(path: &Path, mut messages: Messages) {
    messages.sort_by_key(|&(ns, topic, ..)| (ns, topic));
    let file = std::io::BufWriter::new(std::fs::File::create(path).expect("the log's file"));
    let options = mcap::WriteOptions::new().profile("ros2").library("unwater test renderer");
    let options = options.compression(Some(mcap::Compression::Zstd)).chunk_size(Some(1 << 20));
    let mut writer = options.create(file).expect("the log's header");
    let mut channels = std::collections::BTreeMap::new();
    for (ns, topic, kind, data) in messages {
        let (channel_id, sequence) = channels.entry(topic).or_insert_with(|| {
            let schema =
                writer.add_schema(kind, "ros2msg", definition(kind).as_bytes()).expect("a schema");
            (writer.add_channel(schema, topic, "cdr", &Default::default()).expect("a channel"), 0)
        });
        let (channel_id, log_time, publish_time) = (*channel_id, stamp(ns), stamp(ns));
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: *sequence,
            log_time,
            publish_time,
        };
        writer.write_to_known_channel(&header, &data).expect("a message");
        *sequence += 1;
    }
    writer.finish().expect("the log's summary");
}
/// A type's full text: its fields, then the types it needs.
fn definition(kind: &str) -> String {
    let (_, fields, parts) = TYPES.iter().find(|entry| entry.0 == kind).expect("a known type");
    let parts: String = parts
        .iter()
        .chain(&[HEADER, TIME])
        .map(|part| format!(", {:=<80}, MSG: {part}", ""))
        .collect();
    format!("{fields}{parts}, ").replace(", ", "\n")
}

const HEADER: &str = "std_msgs/Header, builtin_interfaces/Time stamp, string frame_id";
const TIME: &str = "builtin_interfaces/Time, int32 sec, uint32 nanosec";
const VECTOR: &str = "geometry_msgs/Vector3, float64 x, float64 y, float64 z";
const QUATERNION: &str =
    "geometry_msgs/Quaternion, float64 x 0, float64 y 0, float64 z 0, float64 w 1";
/// Name, fields and what they need, of common_interfaces, marine_acoustic_msgs, dvl_msgs and
/// flir_camera_msgs.
const TYPES: [(&str, &str, &[&str]); 10] = [
    ("std_msgs/msg/Float64", "float64 data", &[]),
    (
        "sensor_msgs/msg/Range",
        "uint8 ULTRASOUND=0, uint8 INFRARED=1, std_msgs/Header header, uint8 radiation_type, \
        float32 field_of_view, float32 min_range, float32 max_range, float32 range, \
        float32 variance",
        &[],
    ),
    (
        "flir_camera_msgs/msg/ImageMetaData",
        "std_msgs/Header header, uint64 camera_time, int16 brightness, uint32 exposure_time, \
        uint32 max_exposure_time, float32 gain",
        &[],
    ),
    (
        "tf2_msgs/msg/TFMessage",
        "geometry_msgs/TransformStamped[] transforms",
        &[
            VECTOR,
            QUATERNION,
            "geometry_msgs/TransformStamped, std_msgs/Header header, string child_frame_id, \
            geometry_msgs/Transform \
        transform",
            "geometry_msgs/Transform, geometry_msgs/Vector3 translation, \
            geometry_msgs/Quaternion rotation",
        ],
    ),
    (
        "sensor_msgs/msg/Imu",
        "std_msgs/Header header, geometry_msgs/Quaternion orientation, float64[9] \
        orientation_covariance, geometry_msgs/Vector3 angular_velocity, float64[9] \
        angular_velocity_covariance, \
        geometry_msgs/Vector3 linear_acceleration, float64[9] linear_acceleration_covariance",
        &[VECTOR, QUATERNION],
    ),
    (
        "marine_acoustic_msgs/msg/Dvl",
        "uint8 DVL_MODE_BOTTOM=1, uint8 DVL_MODE_WATER=2, uint8 DVL_TYPE_PISTON=0, \
        uint8 DVL_TYPE_PHASED_ARRAY=1, std_msgs/Header header, uint8 velocity_mode, uint8 \
        dvl_type, \
        geometry_msgs/Vector3 velocity, float64[9] velocity_covar, float64 altitude, float64 \
        course_gnd, \
        float64 speed_gnd, uint8 num_good_beams, float32 sound_speed, bool beam_ranges_valid, \
        bool beam_velocities_valid, geometry_msgs/Vector3[4] beam_unit_vec, float64[4] range, \
        float32[4] range_covar, \
        float32[4] beam_quality, float32[4] beam_velocity, float32[4] beam_velocity_covar",
        &[VECTOR],
    ),
    (
        "dvl_msgs/msg/DVL",
        "std_msgs/Header header, float64 time, geometry_msgs/Vector3 velocity, float64 fom, \
        float64[] covariance, float64 altitude, DVLBeam[] beams, bool velocity_valid, int64 \
        status, \
        int64 time_of_validity, int64 time_of_transmission, string form",
        &[
            VECTOR,
            "dvl_msgs/DVLBeam, int64 id, float64 velocity, float64 distance, float64 rssi, \
            float64 nsd, bool valid",
        ],
    ),
    (
        "sensor_msgs/msg/Image",
        "std_msgs/Header header, uint32 height, uint32 width, string encoding, \
        uint8 is_bigendian, uint32 step, uint8[] data",
        &[],
    ),
    ("sensor_msgs/msg/CompressedImage", "std_msgs/Header header, string format, uint8[] data", &[]),
    (
        "sensor_msgs/msg/CameraInfo",
        "std_msgs/Header header, uint32 height, uint32 width, string distortion_model, \
        float64[] d, float64[9] k, float64[9] r, float64[12] p, uint32 binning_x, uint32 \
        binning_y, \
        sensor_msgs/RegionOfInterest roi",
        &["sensor_msgs/RegionOfInterest, uint32 x_offset, uint32 y_offset, \
        uint32 height, uint32 width, bool do_rectify"],
    ),
];
