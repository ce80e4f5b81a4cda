//! The renderer's conditions of real recordings: the pixels and messages of a rendered log do what
//! each condition says. Laws are written out again here, apart from the renderer.
use std::path::Path;

use crate::support::judge::images;
use crate::support::render::conditions::{Conditions, Response, SecondLamp, SettingsMessage};
use crate::support::render::{Dive, DvlType, FrameTruth, Sensor, Truth};
use unwater::image::LinearImage;
use unwater::image::transfer::srgb_encode;
use unwater::recording::{Entry, Recording, Window};

const ALPHA: [f64; 3] = [0.45, 0.14, 0.10];
/// One code of 12 bits in the upper ones of 16, of full scale.
const CODE: f64 = 16.0 / 65535.0;

/// A dive over flat seafloor without noise or tilt.
fn dive(conditions: Conditions) -> Dive {
    Dive {
        seed: 17,
        frames: 8,
        frames_per_s: 0.5,
        width: 96,
        height: 72,
        focal_px: 115.0,
        tilt_deg: 0.0,
        slope_deg: (0.0, 0.0),
        range_noise: 0.0,
        lost_beams: 0.0,
        sensor: Sensor::Rgb16,
        noise: false,
        conditions,
        ..Dive::default()
    }
}

struct Rendered {
    truth: Truth,
    images: Vec<LinearImage>,
    folder: tempfile::TempDir,
}

impl Rendered {
    fn new(dive: &Dive) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dive.mcap");
        let truth = dive.write(&path);
        let is_jpeg = matches!(dive.sensor, Sensor::Jpeg(_));
        let topic = if is_jpeg { "/camera/image_raw/compressed" } else { "/camera/image_raw" };
        Self { truth, images: images(&path, topic), folder }
    }
    fn of(conditions: Conditions) -> Self {
        Self::new(&dive(conditions))
    }
    fn messages(&self, topic: &str) -> Vec<Vec<u8>> {
        messages(&self.folder.path().join("dive.mcap"), topic)
    }
    /// Mean of each frame, R G B.
    fn means(&self) -> Vec<[f64; 3]> {
        let of_band = |image: &LinearImage, band: usize| {
            let values = image.pixels.iter().skip(band).step_by(3);
            values.map(|v| f64::from(*v)).sum::<f64>() / (image.width * image.height) as f64
        };
        self.images.iter().map(|image| [0, 1, 2].map(|b| of_band(image, b))).collect()
    }
    /// Light per exposure at a pixel.
    fn radiance(&self, frame: usize, (x, y): (usize, usize), band: usize) -> f64 {
        f64::from(self.images[frame].at(x, y)[band]) / self.truth.exposure
    }
    /// Mean light per exposure of eight by eight pixels at the centre.
    fn central_radiance(&self, frame: usize, band: usize) -> f64 {
        centre().map(|at| self.radiance(frame, at, band)).sum::<f64>() / 64.0
    }
    /// Mean reflectance of the same.
    fn central_reflectance(&self, frame: usize, band: usize) -> f64 {
        let reflectance = &self.truth.frames[frame].reflectance;
        centre().map(|(x, y)| f64::from(reflectance[y * 96 + x][band])).sum::<f64>() / 64.0
    }
    fn frames(&self) -> impl Iterator<Item = (&FrameTruth, [f64; 3])> {
        self.truth.frames.iter().zip(self.means())
    }
}

fn messages(path: &Path, topic: &str) -> Vec<Vec<u8>> {
    let recording = Recording::open(path).unwrap();
    let of_topic = recording.messages(Window::ALL).filter_map(|entry| {
        let Entry::Message(message) = entry else { return None };
        let is_wanted = recording.channels[&message.channel].topic == topic;
        is_wanted.then(|| message.data().to_vec())
    });
    of_topic.collect()
}

/// The number of a std_msgs/Float64.
fn number(message: &[u8]) -> f64 {
    f64::from_le_bytes(message[4..12].try_into().unwrap())
}

/// Seconds of a message's header stamp.
fn stamp_s(message: &[u8]) -> f64 {
    let part = |at: usize| f64::from(u32::from_le_bytes(message[at..at + 4].try_into().unwrap()));
    part(4) + part(8) * 1e-9
}

fn centre() -> impl Iterator<Item = (usize, usize)> {
    (32..40).flat_map(|y| (44..52).map(move |x| (x, y)))
}

fn brightness(mean: [f64; 3]) -> f64 {
    (mean.iter().sum::<f64>() / 3.0).ln()
}

fn assert_near(what: &str, is: f64, expected: f64, within: f64) {
    assert!((is - expected).abs() <= within, "{what}: {is} for {expected} ± {within}");
}

#[test]
fn automatic_exposure_and_white_balance_follow_their_laws() {
    let ideal = Rendered::of(Conditions::default());
    let exposed = Rendered::of(Conditions { auto_exposure: 0.8, ..Conditions::default() });
    let both = Conditions { auto_exposure: 0.8, auto_white_balance: 0.5, ..Conditions::default() };
    let both = Rendered::of(both);
    let level = |means: &[[f64; 3]]| means.iter().copied().map(brightness).collect::<Vec<_>>();
    let (before, after) = (level(&ideal.means()), level(&exposed.means()));
    let range = |all: &[f64]| {
        let (low, high) = all.iter().fold((f64::MAX, f64::MIN), |r, v| (r.0.min(*v), r.1.max(*v)));
        high - low
    };
    assert!(range(&before) > 1.2, "{before:?}");
    for k in 1..before.len() {
        let (was, is) = (before[k] - before[0], after[k] - after[0]);
        assert_near("log brightness, 20 % of what it was", is, 0.2 * was, 0.01);
        let [gain, first] = [k, 0].map(|k| exposed.truth.frames[k].gains[1].ln());
        assert_near("the gain that the truth holds", gain - first, -0.8 * was, 0.01);
    }
    for (was, (truth, is)) in ideal.means().into_iter().zip(both.frames()) {
        let geometric = |mean: [f64; 3]| mean.iter().map(|m| m.ln()).sum::<f64>() / 3.0;
        for band in 0..3 {
            let cast = was[band].ln() - geometric(was);
            assert_near("cast", is[band].ln() - geometric(is), 0.5 * cast, 0.01);
            let scale = is[band] / was[band] / truth.gains[band];
            let exposures = both.truth.exposure / ideal.truth.exposure;
            assert_near("gains of the truth", scale / exposures, 1.0, 0.01);
        }
    }
}

#[test]
fn the_strobe_flickers() {
    let ideal = Rendered::of(Conditions::default());
    let conditions = Conditions { strobe_flicker: 0.05, ..Conditions::default() };
    let energies: Vec<f64> = (0..2000).map(|k| conditions.strobe_energy(3, k)).collect();
    let mean = energies.iter().sum::<f64>() / 2000.0;
    let variance = energies.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / 2000.0;
    assert_near("mean energy", mean, 1.0, 0.005);
    assert_near("its deviation", variance.sqrt(), 0.05, 0.003);
    let flickering = Rendered::of(conditions);
    let exposures = flickering.truth.exposure / ideal.truth.exposure;
    for (was, (truth, is)) in ideal.means().iter().zip(flickering.frames()) {
        assert_eq!(truth.gains, [truth.strobe_energy; 3]);
        assert!(truth.strobe_energy != 1.0);
        assert_near("energy", is[1] / was[1] / exposures, truth.strobe_energy, 0.003);
    }
}

#[test]
fn the_sensor_adds_its_black_level_and_truncates() {
    let ideal = Rendered::of(Conditions::default());
    let lifted = Rendered::of(Conditions { black_level: 0.01, ..Conditions::default() });
    let cut = Rendered::of(Conditions { has_truncating_adc: true, ..Conditions::default() });
    let differences = |other: &Rendered| -> Vec<f64> {
        let pairs = ideal.images.iter().zip(&other.images);
        let pairs = pairs.flat_map(|(a, b)| a.pixels.iter().zip(&b.pixels));
        let unclipped = pairs.filter(|(_, b)| **b < 0.99);
        unclipped.map(|(a, b)| (f64::from(*b) - f64::from(*a)) / CODE).collect()
    };
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    let lift = differences(&lifted);
    assert_near("mean lift", mean(&lift), 40.95, 0.02);
    lift.iter().for_each(|lift| assert_near("lift of one pixel", *lift, 40.95, 1.0));
    let truncation = differences(&cut);
    assert_near("mean truncation", mean(&truncation), -0.5, 0.02);
    truncation.iter().for_each(|lost| assert!((-1.01..=0.01).contains(lost), "{lost}"));
}

#[test]
fn the_lens_darkens_towards_the_corner() {
    let ideal = Rendered::of(Conditions::default());
    let dark = Rendered::of(Conditions { vignetting_exponent: 3.0, ..Conditions::default() });
    for (x, y) in [(0, 0), (95, 71), (95, 20), (48, 36)] {
        let (right, down) = ((x as f64 - 47.5) / 115.0, (y as f64 - 35.5) / 115.0);
        let cosine = right.hypot(down).atan().cos();
        let (mut was, mut is) = (0.0, 0.0);
        for frame in 0..ideal.images.len() {
            was += ideal.radiance(frame, (x, y), 1);
            is += dark.radiance(frame, (x, y), 1);
        }
        assert_near("light through the lens", is / was, cosine.powi(3), 0.005);
    }
}

/// Neither changes a pixel; the log differs only in what is wrong.
#[test]
fn strobe_mount_and_stamps_are_off_and_no_pixel_is() {
    let ideal = Rendered::of(Conditions::default());
    let moved = Conditions { strobe_mount_error_m: [0.0, 0.0, 0.2], ..Conditions::default() };
    let (moved, late) = (
        Rendered::of(moved),
        Rendered::of(Conditions { stamp_delay_s: 0.25, ..Conditions::default() }),
    );
    let transforms = [&ideal, &moved].map(|r| r.messages("/tf_static").remove(0));
    let numbers = |bytes: &[u8]| -> Vec<f64> {
        let all = bytes[4..].chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap()));
        all.collect()
    };
    let differ: Vec<f64> = std::iter::zip(numbers(&transforms[0]), numbers(&transforms[1]))
        .filter(|(a, b)| a.to_bits() != b.to_bits())
        .map(|(a, b)| b - a)
        .collect();
    assert_eq!(differ.len(), 1, "{differ:?}");
    assert_near("the strobe's mount", differ[0], 0.2, 1e-12);
    assert!(ideal.images == moved.images && ideal.images == late.images);
    let stamps = |r: &Rendered, topic: &str| -> Vec<f64> {
        r.messages(topic).iter().map(|m| stamp_s(m)).collect()
    };
    for topic in ["/camera/image_raw", "/camera/camera_info"] {
        for (was, is) in stamps(&ideal, topic).into_iter().zip(stamps(&late, topic)) {
            assert_near("stamp", is - was, 0.25, 1e-6);
        }
    }
    let (pings, after) = (stamps(&ideal, "/dvl/data"), stamps(&late, "/dvl/data"));
    assert_eq!(pings, after[..pings.len()]);
    assert_eq!(late.truth.frames[0].stamp_ns - ideal.truth.frames[0].stamp_ns, 250_000_000);
}

#[test]
fn eight_bit_images_have_their_response() {
    let light = Rendered::of(Conditions::default());
    for (response, sensor) in [
        (Response::Gamma22, Sensor::Rgb8),
        (Response::Linear, Sensor::Rgb8),
        (Response::Contrast, Sensor::Rgb8),
        (Response::Gamma22, Sensor::Jpeg(100)),
    ] {
        let within = if matches!(sensor, Sensor::Jpeg(_)) { 6.0 } else { 0.6 };
        let conditions = Conditions { response, ..Conditions::default() };
        let coded = Rendered::new(&Dive { sensor, ..dive(conditions) });
        let pairs = light.images.iter().zip(&coded.images);
        for (light, coded) in pairs.flat_map(|(a, b)| a.pixels.iter().zip(&b.pixels)) {
            let light = f64::from(*light).min(1.0);
            // The reader took it for sRGB.
            let (code, srgb) = (255.0 * srgb_encode(f64::from(*coded)), srgb_encode(light));
            let expected = match response {
                Response::Gamma22 => light.powf(1.0 / 2.2),
                Response::Linear => light,
                Response::Contrast => srgb - 0.096 * (2.0 * std::f64::consts::PI * srgb).sin(),
                Response::Srgb => srgb,
            };
            // Near black a code of 12 bits is more than one of 8.
            if light > 0.02 {
                assert_near("code", code, 255.0 * expected, within);
            }
        }
    }
}

#[test]
fn a_second_lamp_lights_the_seafloor_and_may_be_listed() {
    let ideal = Rendered::of(Conditions::default());
    let [unlisted, listed] = [SecondLamp::Unlisted, SecondLamp::Listed]
        .map(|second_lamp| Rendered::of(Conditions { second_lamp, ..Conditions::default() }));
    assert!(unlisted.images == listed.images);
    let is_listed = |r: &Rendered| {
        let name = b"lamp_optical_frame";
        r.messages("/tf_static")[0].windows(name.len()).any(|bytes| bytes == name)
    };
    assert!(is_listed(&listed) && !is_listed(&unlisted));
    // Its light has another centre than the strobe's.
    let peak = |light: &dyn Fn((usize, usize)) -> f64| {
        let pixels = (0..72).flat_map(|y| (0..96).map(move |x| (x, y)));
        let (mut sum, mut across, mut down) = (0.0, 0.0, 0.0);
        for (x, y) in pixels {
            let value = light((x, y));
            (sum, across, down) = (sum + value, across + value * x as f64, down + value * y as f64);
        }
        (sum, across / sum, down / sum)
    };
    let truth = &ideal.truth.frames[3].reflectance;
    let of_strobe =
        |at: (usize, usize)| ideal.radiance(3, at, 1) / f64::from(truth[at.1 * 96 + at.0][1]);
    let of_lamp = |at: (usize, usize)| {
        let added = unlisted.radiance(3, at, 1) - ideal.radiance(3, at, 1);
        assert!(added > -2.0 * CODE / ideal.truth.exposure, "{added} at {at:?}");
        added / f64::from(truth[at.1 * 96 + at.0][1])
    };
    let (strobe, lamp) = (peak(&of_strobe), peak(&of_lamp));
    assert!((0.1..0.8).contains(&(lamp.0 / strobe.0)), "{strobe:?} {lamp:?}");
    assert!((lamp.1 - strobe.1).hypot(lamp.2 - strobe.2) > 8.0, "{strobe:?} {lamp:?}");
}

/// Rendered dives without and with conditions that add light, which is this share of the strobe's.
fn lit(conditions: Conditions, share: f64) -> (Rendered, Rendered) {
    let (ideal, lit) = (Rendered::of(Conditions::default()), Rendered::of(conditions));
    let total = |r: &Rendered| r.means().iter().flatten().sum::<f64>() / r.truth.exposure;
    let is = total(&lit) / total(&ideal) - 1.0;
    assert_near("share of the whole dive", is, share, 0.01);
    let of_frames = lit.truth.frames.iter().zip(ideal.means()).map(|(frame, mean)| {
        let of_band = |b: usize| frame.daylight_share[b] + frame.backscatter_share[b];
        (0..3).map(|b| of_band(b) * mean[b]).sum::<f64>() / ideal.truth.exposure
    });
    assert_near("shares of the truth", of_frames.sum::<f64>() / total(&ideal), is, 0.003);
    (ideal, lit)
}

#[test]
fn daylight_passes_the_water_above_and_the_path_to_the_camera() {
    let conditions = Conditions { daylight: 0.2, has_depth_sensor: true, ..Conditions::default() };
    let (ideal, lit) = lit(conditions, 0.2);
    let path = |k: usize| lit.truth.frames[k].plane_distance_m;
    let day = |k: usize, band: usize| {
        let added = lit.central_radiance(k, band) - ideal.central_radiance(k, band);
        added / lit.central_reflectance(k, band)
    };
    for band in 0..3 {
        for k in 1..lit.images.len() {
            let expected = (-ALPHA[band] * (path(k) - path(0))).exp();
            let is = day(k, band) / day(0, band);
            assert_near("daylight over path length", is / expected, 1.0, 0.04);
        }
    }
    let water = ((0.35 - 0.05) * 7.0 + (ALPHA[0] - ALPHA[2]) * path(0)).exp();
    assert_near("blue over red", day(0, 2) / day(0, 0) / water, 1.0, 0.04);
    let depths = lit.messages("/depth");
    assert!(depths.len() > 100);
    // The first frame is taken at 1.5 m; the camera is 0.12 m below the base.
    assert_near("depth", number(&depths[9]), 7.0 - 1.5 - 0.12, 0.06);
}

#[test]
fn uniform_backscatter_saturates_with_the_path() {
    let conditions = Conditions { uniform_backscatter: 0.1, ..Conditions::default() };
    let (ideal, lit) = lit(conditions, 0.1);
    let path = |k: usize| lit.truth.frames[k].plane_distance_m;
    let paths: Vec<f64> = (0..lit.images.len()).map(path).collect();
    assert!(paths.iter().any(|p| *p > paths[0] + 0.8), "{paths:?}");
    let added =
        |k: usize, band: usize| lit.central_radiance(k, band) - ideal.central_radiance(k, band);
    for band in 0..3 {
        let saturating = |path: f64| 1.0 - (-ALPHA[band] * path).exp();
        for (k, path) in paths.iter().enumerate() {
            let expected = saturating(*path) / saturating(paths[0]);
            let is = added(k, band) / added(0, band);
            assert_near("backscatter over path length", is / expected, 1.0, 0.04);
        }
    }
}

#[test]
fn an_altimeter_takes_the_place_of_the_dvl() {
    let dive = Dive { dvl: DvlType::Altimeter, ..dive(Conditions::default()) };
    let rendered = Rendered::new(&dive);
    assert!(rendered.messages("/dvl/data").is_empty());
    let ranges = rendered.messages("/altimeter/range");
    let first_frame = stamp_s(&rendered.messages("/camera/image_raw")[0]);
    let before: Vec<_> = ranges.iter().filter(|m| stamp_s(m) <= first_frame).collect();
    let last = before.last().unwrap();
    let range = f32::from_le_bytes(last[last.len() - 8..last.len() - 4].try_into().unwrap());
    // The camera is level, at its lowest, and 0.04 m above the altimeter.
    assert_near("range", f64::from(range), 1.5 - 0.04, 0.01);
    assert!(ranges.len() > 60);
}

#[test]
fn recorded_settings_are_those_of_the_image() {
    let ideal = Rendered::of(Conditions::default());
    for message in
        [SettingsMessage::ImageMetaData, SettingsMessage::Float64, SettingsMessage::Stops]
    {
        let recorded =
            Rendered::of(Conditions { settings: Some(message), ..Conditions::default() });
        let gains: Vec<f64> = match message {
            SettingsMessage::ImageMetaData => recorded
                .messages("/camera/meta")
                .iter()
                .map(|m| {
                    let tail: [u8; 12] = m[m.len() - 12..].try_into().unwrap();
                    let exposure_us = u32::from_le_bytes(tail[..4].try_into().unwrap());
                    let gain_db = f32::from_le_bytes(tail[8..].try_into().unwrap());
                    f64::from(exposure_us) / 2000.0 * 10f64.powf(f64::from(gain_db) / 20.0)
                })
                .collect(),
            SettingsMessage::Float64 => {
                let [exposures, gains] =
                    ["/camera/exposure_time", "/camera/gain"].map(|topic| recorded.messages(topic));
                exposures.iter().zip(&gains).map(|(e, g)| number(e) / 0.002 * number(g)).collect()
            }
            SettingsMessage::Stops => {
                recorded.messages("/camera/exposure_ev").iter().map(|m| number(m).exp2()).collect()
            }
        };
        assert_eq!(gains.len(), recorded.images.len());
        let exposures = recorded.truth.exposure / ideal.truth.exposure;
        let (low, high) = gains.iter().fold((9.0, 0.0), |r, g| (g.min(r.0), g.max(r.1)));
        assert!(low < 1.01 && high / low > 6.0, "{gains:?}");
        for ((gain, was), (truth, is)) in gains.iter().zip(ideal.means()).zip(recorded.frames()) {
            assert_near("gain of the truth", truth.gains[0] / gain, 1.0, 1e-6);
            assert_near("gain in the image", is[1] / was[1] / exposures / gain, 1.0, 0.01);
        }
    }
}

/// A cheap camera: 4:2:0 below quality 90, full colour from there on.
#[test]
fn jpegs_below_quality_90_are_subsampled() {
    let sampling = |quality: u8| {
        let sensor = Sensor::Jpeg(quality);
        let rendered = Rendered::new(&Dive { frames: 2, sensor, ..dive(Conditions::default()) });
        let message = rendered.messages("/camera/image_raw/compressed").remove(0);
        // SOF0: length, precision, height, width, number of components, id, sampling factors
        let at = message.windows(2).position(|b| b == [0xff, 0xc0]).unwrap();
        message[at + 11]
    };
    assert_eq!((sampling(75), sampling(92)), (0x22, 0x11));
}
