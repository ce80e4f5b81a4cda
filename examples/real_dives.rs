//! What correction does to dives of which nobody knows the truth: do images of one place agree
//! better after it than before, and does colour still fall with the altitude?
//!
//!     cargo run --release --example real_dives -- LOG.mcap...

use std::collections::BTreeMap;
use std::path::Path;

use unwater::config::Method;
use unwater::estimate::{FrameSamples, Matchable, matches, sample_frame};
use unwater::geometry::View;
use unwater::image::decode::{CameraResponse, decode};
use unwater::image::{LinearImage, SensorImage};
use unwater::messages::Kind;
use unwater::recording::{Entry, Recording, Window};
use unwater::run::correct;
use unwater::session::index::LogIndex;
use unwater::session::{CameraSession, Log, Options, Silent};

/// Light is compared over a Gaussian of this standard deviation on the seafloor (m): matches are a
/// pixel or two off.
const PATCH_SIGMA_M: f64 = 0.01;
/// Raw light beyond these (share of full scale) is no measurement.
const USABLE: std::ops::Range<f64> = 0.0015..0.985;

fn main() {
    let mut options = Options { force: true, ..Options::default() };
    options.config.render.depth = 16;
    let folder = std::env::temp_dir().join(format!("unwater-real-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    println!(
        "| dive | frames, pairs, points | median difference at one place, raw R, G, B | corrected \
         | by `frame-average` | slope of log light with altitude, raw [1/m] | corrected | \
         identified |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for path in std::env::args().skip(1) {
        let path = Path::new(&path);
        let log = CameraSession::open(path, &options).expect("a log");
        let frames = keypoints_of(&log, &options);
        let pairs = matched(&log, &frames, &options);
        let raw = images_of(&log.recording, &log.index, &log.survey.camera_topic);
        let output = folder.join("corrected.mcap");
        let (report, model) =
            correct(path, &output, None, &options, &Silent).expect("a corrected log");
        let read_back = || {
            let log = Log::open(&output, &Options::default()).expect("a corrected log");
            images_of(&log.recording, &log.index, &report.corrected_topic)
        };
        let corrected = read_back();
        let mut baseline = options.clone();
        baseline.config.render.method = Method::FrameAverage;
        correct(path, &output, Some(model.clone()), &baseline, &Silent).expect("a corrected log");
        let averaged = read_back();
        let focal_px = log.survey.rig.camera.fx;
        let points: usize = pairs.iter().map(|(_, _, points)| points.len()).sum();
        let differ = |images: &BTreeMap<u64, LinearImage>| {
            text(&differences(&frames, &pairs, &raw, images, focal_px), 3)
        };
        println!(
            "| {} | {}, {}, {points} | {} | {} | {} | {} | {} | {} |",
            path.file_stem().map(|n| n.to_string_lossy()).unwrap_or_default(),
            frames.len(),
            pairs.len(),
            differ(&raw),
            differ(&corrected),
            differ(&averaged),
            text(&slopes(&frames, &raw, &corrected, &raw), 2),
            text(&slopes(&frames, &raw, &corrected, &corrected), 2),
            if model.identified { "yes" } else { "no" },
        );
    }
    let _gone = std::fs::remove_dir_all(folder);
}

/// Images of a topic by log time, linear.
fn decoded(recording: &Recording, index: &LogIndex, topic: &str) -> Vec<(u64, SensorImage)> {
    let of = |entry| {
        let Entry::Message(message) = entry else { return None };
        recording.channels.get(&message.channel).filter(|c| c.topic == topic)?;
        let decoder = index.decoders.get(&message.channel)?;
        let value = decoder.read(message.data()).ok()?;
        let Kind::Image(read) = decoder.message_type.kind else { return None };
        Some((message.log_time, decode(&read(&value).ok()?, CameraResponse::default()).ok()?.image))
    };
    recording.messages(Window::ALL).filter_map(of).collect()
}

fn images_of(recording: &Recording, index: &LogIndex, topic: &str) -> BTreeMap<u64, LinearImage> {
    decoded(recording, index, topic)
        .into_iter()
        .map(|(time, image)| (time, image.into_demosaiced()))
        .collect()
}

/// Keypoints of every frame with a seafloor plane.
fn keypoints_of(log: &CameraSession, options: &Options) -> Vec<(u64, FrameSamples)> {
    let survey = &log.survey;
    let of = |(index, (time, image)): (usize, (u64, SensorImage))| {
        let stamp = survey.frames.get(index)?.stamp;
        let plane = survey.pings.seafloor(stamp, &survey.rig, &options.config.seafloor).ok()?;
        let camera = survey.rig.camera.scaled_to(image.light.width, image.light.height)?;
        let terrain = survey.pings.terrain(stamp, &plane, &survey.rig);
        let view =
            View { camera: &camera, rig: &survey.rig, plane: &plane, terrain: terrain.as_ref() };
        Some((
            time,
            sample_frame(
                (index, stamp),
                &image,
                &view,
                Some(f64::INFINITY),
                &options.config.matching,
                &options.config.estimate,
            ),
        ))
    };
    decoded(&log.recording, &log.index, &survey.camera_topic)
        .into_iter()
        .enumerate()
        .filter_map(of)
        .collect()
}

type Pair = (usize, usize, Vec<(u32, u32)>);

fn matched(log: &CameraSession, frames: &[(u64, FrameSamples)], options: &Options) -> Vec<Pair> {
    let matching = &options.config.matching;
    let camera = &log.survey.rig.camera;
    let reduction =
        camera.width.max(camera.height).div_ceil(matching.detection_side_px).max(1) as f64;
    let inlier = matching.inlier_px * reduction / camera.fx;
    let of =
        |i: usize| Matchable { keypoints: &frames[i].1.keypoints, places: &frames[i].1.places };
    let neighbours = (0..frames.len())
        .flat_map(|a| (a + 1..frames.len().min(a + 1 + matching.neighbours)).map(move |b| (a, b)));
    let pairs = neighbours.map(|(a, b)| {
        (a, b, matches(&of(a), &of(b), matching, inlier, (a as u64) << 32 | b as u64))
    });
    pairs.filter(|(_, _, points)| !points.is_empty()).collect()
}

/// Log of mean light around a place, per band; `None` over the edge.
fn pooled(image: &LinearImage, u: f64, v: f64, sigma_px: f64) -> Option<Vec<f64>> {
    let reach = (2.5 * sigma_px).ceil();
    let inside = u - reach >= 0.0
        && v - reach >= 0.0
        && u + reach < image.width as f64
        && v + reach < image.height as f64;
    let (mut sums, mut weights) = (vec![0.0; image.bands], 0.0);
    for y in (inside.then_some((v - reach) as usize)?)..=(v + reach) as usize {
        for x in (u - reach) as usize..=(u + reach) as usize {
            let weight = (-((x as f64 - u).powi(2) + (y as f64 - v).powi(2))
                / (2.0 * sigma_px * sigma_px))
                .exp();
            weights += weight;
            image
                .at(x, y)
                .iter()
                .zip(&mut sums)
                .for_each(|(value, sum)| *sum += weight * f64::from(*value));
        }
    }
    Some(sums.iter().map(|s| s / weights).collect())
}

/// Median of |log c − log c′| over points that two frames see, where the raw light is usable in
/// both.
fn differences(
    frames: &[(u64, FrameSamples)],
    pairs: &[Pair],
    raw: &BTreeMap<u64, LinearImage>,
    shown: &BTreeMap<u64, LinearImage>,
    focal_px: f64,
) -> Vec<f64> {
    let mut of_band: Vec<Vec<f64>> = vec![Vec::new(); 3];
    for (a, b, points) in pairs {
        for (i, j) in points {
            let light = |frame: usize, keypoint: u32| {
                let (time, samples) = &frames[frame];
                let k = &samples.keypoints[keypoint as usize];
                let sigma_px = PATCH_SIGMA_M * focal_px / samples.camera_altitude_m;
                let usable =
                    pooled(raw.get(time)?, k.u, k.v, sigma_px)?.iter().all(|v| USABLE.contains(v));
                usable.then(|| pooled(shown.get(time)?, k.u, k.v, sigma_px)).flatten()
            };
            let Some((one, other)) = light(*a, *i).zip(light(*b, *j)) else { continue };
            let logs = one.iter().zip(&other).map(|(p, q)| (p / q).ln().abs());
            logs.zip(&mut of_band).filter(|(d, _)| d.is_finite()).for_each(|(d, all)| all.push(d));
        }
    }
    of_band.into_iter().filter(|all| !all.is_empty()).map(median).collect()
}

/// Slope of frames' median log light with the camera's altitude (1/m), over pixels that are lit
/// before and after.
fn slopes(
    frames: &[(u64, FrameSamples)],
    raw: &BTreeMap<u64, LinearImage>,
    corrected: &BTreeMap<u64, LinearImage>,
    shown: &BTreeMap<u64, LinearImage>,
) -> Vec<f64> {
    let of_frame = |(time, samples): &(u64, FrameSamples)| {
        let (raw, corrected, shown) = (raw.get(time)?, corrected.get(time)?, shown.get(time)?);
        let bands = shown.bands;
        let lit = |i: &usize| {
            (0..bands)
                .all(|b| raw.pixels[i * bands + b] > 0.0 && corrected.pixels[i * bands + b] > 0.0)
        };
        let lit: Vec<usize> = (0..shown.width * shown.height).step_by(7).filter(lit).collect();
        let log = |b: usize| {
            median(lit.iter().map(|i| f64::from(shown.pixels[i * bands + b]).ln()).collect())
        };
        (!lit.is_empty())
            .then(|| (samples.camera_altitude_m, (0..bands).map(log).collect::<Vec<_>>()))
    };
    let points: Vec<(f64, Vec<f64>)> = frames.iter().filter_map(of_frame).collect();
    let n = points.len() as f64;
    let mean_altitude = points.iter().map(|(a, _)| a).sum::<f64>() / n;
    let slope = |b: usize| {
        let mean = points.iter().map(|(_, l)| l[b]).sum::<f64>() / n;
        let (top, bottom) = points.iter().fold((0.0, 0.0), |(t, d), (a, l)| {
            (t + (a - mean_altitude) * (l[b] - mean), d + (a - mean_altitude).powi(2))
        });
        top / bottom
    };
    (0..points.first().map_or(0, |(_, l)| l.len())).map(slope).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn text(values: &[f64], digits: usize) -> String {
    values.iter().map(|v| format!("{v:.digits$}")).collect::<Vec<_>>().join(", ")
}
