//! Judges a corrected log against the dive it was rendered from.
#![allow(dead_code)]

use std::path::Path;

use unwater::image::LinearImage;
use unwater::image::decode::{CameraResponse, decode};
use unwater::messages::{Decoder, Kind};
use unwater::model::ModelFile;
use unwater::recording::{Entry, Recording, Window};
use unwater::report::Report;
use unwater::run::correct;
use unwater::session::{Options, Silent};

use super::render::{Dive, Truth};

/// Side of the blocks that pixels are averaged over, so that sensor noise does not count as error
/// (px).
const BLOCK: usize = 4;

/// How near the truth a run came.
#[derive(Clone, Debug)]
pub struct Verdict {
    /// estimate − truth (1/m)
    pub attenuation_error_per_m: Vec<f64>,
    /// claimed standard deviation (1/m)
    pub attenuation_std_per_m: Vec<f64>,
    /// RMSE of log BP where the log has seen it, level taken out
    pub beam_log_rmse: f64,
    /// median relative error of reflectance per band, after one gain per band for the whole log
    pub reflectance_error: Vec<f64>,
    /// the whole model
    pub model: ModelFile,
    /// the account
    pub report: Report,
}

/// Fails where a measured error exceeds its bound. Bounds are 1.5 times the errors of today:
/// `cargo test --test it -- --nocapture | grep measured` prints both.
pub fn assert_within(what: &str, measured: f64, bound: f64) {
    println!("measured {what}: {measured:.5}, bound {bound}");
    assert!(measured.abs() <= bound, "{what}: {measured:.5} exceeds {bound}");
}

/// Renders, corrects (16-bit PNG) and compares.
pub fn run_and_show(
    dive: &Dive,
    options: &Options,
    folder: &Path,
) -> (Verdict, Truth, Vec<LinearImage>) {
    let truth = dive.write(&folder.join("dive.mcap"));
    let (verdict, images) = corrected(dive, &truth, options, folder);
    (verdict, truth, images)
}

/// Corrects the dive that was written to the folder, and compares.
pub fn corrected(
    dive: &Dive,
    truth: &Truth,
    options: &Options,
    folder: &Path,
) -> (Verdict, Vec<LinearImage>) {
    let (input, output) = (folder.join("dive.mcap"), folder.join("dive.corrected.mcap"));
    let mut options = options.clone();
    options.force = true;
    options.config.render.depth = 16;
    let (report, model) =
        correct(&input, &output, None, &options, &Silent).expect("a corrected log");
    let images = images(&output, &report.corrected_topic);
    (verdict(truth, dive, &images, model, report), images)
}

/// Pass two alone over the dive that `run` left in the folder: its images by another method or in
/// other codes.
pub fn shown_again(model: &ModelFile, options: &Options, folder: &Path) -> Vec<LinearImage> {
    let (input, output) = (folder.join("dive.mcap"), folder.join("dive.again.mcap"));
    let options = Options { force: true, ..options.clone() };
    let (report, _) =
        correct(&input, &output, Some(model.clone()), &options, &Silent).expect("a corrected log");
    images(&output, &report.corrected_topic)
}

/// All images of a topic, linear, in order.
pub fn images(path: &Path, topic: &str) -> Vec<LinearImage> {
    let recording = Recording::open(path).expect("a log");
    let mut images = Vec::new();
    for entry in recording.messages(Window::ALL) {
        let Entry::Message(message) = entry else { continue };
        let channel = &recording.channels[&message.channel];
        if channel.topic == topic {
            let schema = &recording.schemas[&channel.schema_id];
            let decoder =
                Decoder::for_channel(topic, "cdr", &schema.name, &schema.encoding, &schema.data)
                    .unwrap()
                    .unwrap();
            let value = decoder.read(message.data()).unwrap();
            let Kind::Image(read) = decoder.message_type.kind else { panic!("no image") };
            images.push(
                decode(&read(&value).unwrap(), CameraResponse::default())
                    .unwrap()
                    .image
                    .into_demosaiced(),
            );
        }
    }
    images
}

/// Inverts the shoulder of 8-bit images, as docs/formats.md describes.
pub fn unbend(images: &mut [LinearImage], from: f64) {
    let room = 1.0 - from;
    for value in images.iter_mut().flat_map(|p| &mut p.pixels) {
        let shown = f64::from(*value);
        if shown > from {
            *value = (from - room * (1.0 - (shown - from) / room).max(1e-6).ln()) as f32;
        }
    }
}

/// Means over blocks of an image.
pub fn blocks(width: usize, height: usize, at: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let mut means = Vec::new();
    for y in (0..height / BLOCK).map(|r| r * BLOCK) {
        for x in (0..width / BLOCK).map(|c| c * BLOCK) {
            let sum: f64 = (0..BLOCK * BLOCK).map(|k| at(x + k % BLOCK, y + k / BLOCK)).sum();
            means.push(sum / (BLOCK * BLOCK) as f64);
        }
    }
    means
}

pub fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn verdict(
    truth: &Truth,
    dive: &Dive,
    images: &[LinearImage],
    model: ModelFile,
    report: Report,
) -> Verdict {
    let bands = model.attenuation_per_m.len();
    let true_band = |band: usize| if bands == 1 { 1 } else { band };
    assert_eq!(images.len(), truth.frames.len(), "one corrected image per frame");
    let mut reflectance_error = Vec::new();
    for band in 0..bands {
        let mut ratios = Vec::new();
        for (image, frame) in images.iter().zip(&truth.frames) {
            let is = blocks(dive.width, dive.height, |x, y| f64::from(image.at(x, y)[band]));
            let expected = blocks(dive.width, dive.height, |x, y| {
                f64::from(frame.reflectance[y * dive.width + x][true_band(band)])
            });
            ratios
                .extend(is.iter().zip(&expected).filter(|(i, _)| **i < 0.999).map(|(i, o)| i / o));
        }
        let gain = median(&mut ratios);
        let mut errors: Vec<f64> = ratios.iter().map(|r| (r / gain - 1.0).abs()).collect();
        reflectance_error.push(median(&mut errors));
    }
    let beam_log_rmse = beam_log_rmse(&model, &model, truth);
    let attenuation_error_per_m = (0..bands)
        .map(|b| model.attenuation_per_m[b] - truth.attenuation_per_m[true_band(b)])
        .collect();
    Verdict {
        attenuation_error_per_m,
        attenuation_std_per_m: model
            .attenuation_std_per_m
            .iter()
            .map(|s| s.unwrap_or(f64::NAN))
            .collect(),
        beam_log_rmse,
        reflectance_error,
        model,
        report,
    }
}

/// Root mean square error of a model's beam pattern, up to a factor (log), where another model on
/// the same grid has one, too.
pub fn beam_log_rmse(model: &ModelFile, other: &ModelFile, truth: &Truth) -> f64 {
    let (pattern, other) = (&model.beam_pattern, &other.beam_pattern);
    assert_eq!((&pattern.theta_deg, &pattern.phi_deg), (&other.theta_deg, &other.phi_deg));
    let mut steps = Vec::new();
    let rows = pattern.log_gain.iter().zip(&other.log_gain);
    for ((row, of_other), theta) in rows.zip(&pattern.theta_deg) {
        for ((value, other), phi) in row.iter().zip(of_other).zip(&pattern.phi_deg) {
            let expected = truth.log_beam(theta.to_radians(), phi.to_radians());
            // Where less than a fiftieth of the peak's light goes there is nothing to see it by.
            let is_lit = expected > (0.02f64).ln();
            if let (Some(value), Some(_)) = (value, other.filter(|_| is_lit)) {
                steps.push(value - expected);
            }
        }
    }
    let level = median(&mut steps.clone());
    (steps.iter().map(|s| (s - level).powi(2)).sum::<f64>() / steps.len() as f64).sqrt()
}
