//! Pass one over a log: frames → samples → tracks. Frames are decoded on all cores and forgotten at once; samples
//! are small and stay. What the samples mean is for `estimate` to say.

use std::collections::BTreeSet;

use crate::config::{Config, Estimator};
use crate::correct::MeanFrames;
use crate::error::Result;
use crate::estimate::{FrameSamples, Matchable, MatchedPair, PLANES_AROUND_S, matches, samples};
use crate::geometry::View;
use crate::image::SensorImage;
use crate::image::decode::{Decoded, Light, decode};
use crate::messages::{Decoder, Kind};
use crate::recording::{Message, Recording};
use crate::spaces::Point;

use super::chosen_frames::for_frames;
use super::scan::{FrameRef, Scan};
use super::survey::Survey;
use super::{Progress, Step};
use crate::cores::{Threads, ordered_map};

/// Frames in a row that pass one takes before it jumps on; overlap needs neighbours.
const STRETCH: usize = 12;

/// Frames that many times as far apart as neighbours may cross each other, where the ground they look at lies within this
/// share of the altitude; so many are tried for each.
const CROSSING_FRAMES: usize = 3;
const CROSSING_SHARE: f64 = 0.5;
const CROSSINGS_PER_FRAME: usize = 2;

/// What pass one keeps of one log.
#[derive(Default)]
pub struct Collected {
    /// samples of the frames, in order
    pub frames: Vec<FrameSamples>,
    /// matched keypoints
    pub pairs: Vec<MatchedPair>,
    /// mean frames, where the method wants them
    pub means: MeanFrames,
    /// whether all frames of the log were looked at
    pub is_all: bool,
}

/// Which frames pass one looks at: all, or so many stretches of neighbours. The log is parted into as many parts; of each that
/// stretch is taken whose altitude changes most, as the water shows itself in that. Frames without a seafloor have NaN.
pub fn chosen_frames(altitude_m: &[f64], most: usize) -> BTreeSet<usize> {
    let total = altitude_m.len();
    if total <= most {
        return (0..total).collect();
    }
    let parts = (most / STRETCH).max(1);
    let length = (most / parts).min(total);
    let spread = |first: usize| {
        let heights = altitude_m[first..first + length].iter().filter(|a| a.is_finite());
        let (least, most, seen) = heights.fold((f64::INFINITY, 0f64, 0), |(l, m, n), a| (l.min(*a), m.max(*a), n + 1));
        // A stretch that lost its floor shows less; a tenth more or less of spread decides nothing.
        if seen == 0 { 0.0 } else { ((most / least).ln() * 10.0).round() / 10.0 * f64::from(seen) }
    };
    (0..parts)
        .flat_map(|part| {
            let (begin, end) = (part * total / parts, (part + 1) * total / parts);
            let firsts = (begin..=(end - length).max(begin)).step_by(length / 2).map(|first| first.min(total - length));
            let best = firsts.fold((0.0, begin), |best, first| if spread(first) > best.0 { (spread(first), first) } else { best });
            best.1..best.1 + length
        })
        .collect()
}

/// Takes samples of `most` frames at most and matches neighbours.
///
/// # Errors
/// None of its own; a frame that cannot be used is left out here and accounted for in pass two.
pub fn collect(
    recording: &Recording,
    scan: &Scan,
    survey: &Survey,
    config: &Config,
    most: usize,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Collected> {
    // Where all are taken, nobody asks how high they are.
    let altitude_m = |frame: &FrameRef| {
        let plane = survey.pings.seafloor(frame.stamp, &survey.rig, &config.seafloor);
        plane.map_or(f64::NAN, |plane| plane.distance_m)
    };
    let is_all = survey.frames.len() <= most;
    let altitudes: Vec<f64> = survey.frames.iter().map(|frame| if is_all { f64::NAN } else { altitude_m(frame) }).collect();
    let chosen = chosen_frames(&altitudes, most);
    let mut collected = Collected { is_all, ..Collected::default() };
    progress.begin(Step::Estimate, chosen.len());
    let wants_average = config.render.method.needs_mean_frames();
    let with_keypoints = config.estimate.estimator != Estimator::Altitude;
    let work = |(index, message): (usize, Message)| {
        let decoder = scan.decoders.get(&message.channel)?;
        let (image, bits) = decoded(decoder, &message, survey, config).ok()?;
        let camera = survey.rig.camera.scaled_to(image.light.width, image.light.height)?;
        let stamp = survey.frames.get(index)?.stamp;
        let plane = survey.pings.seafloor(stamp, &survey.rig, &config.seafloor).ok()?;
        let relief = survey.pings.relief(stamp, &plane, &survey.rig);
        let view = View { camera: &camera, rig: &survey.rig, plane: &plane, relief: relief.as_ref() };
        let mut taken = samples((index, stamp), &image, &view, with_keypoints, &config.matching, &config.estimate);
        taken.eight_bit = bits <= 8;
        let plane_at = |offset_s: f64| {
            let plane = survey.pings.seafloor(stamp.later(offset_s), &survey.rig, &config.seafloor).ok()?;
            Some((plane.normal, plane.distance_m))
        };
        taken.planes_around = plane_at(-PLANES_AROUND_S).zip(plane_at(PLANES_AROUND_S)).map(|(a, b)| [a, b]);
        Some((taken, wants_average.then(|| (image.into_bands(), view.camera_altitude_m()))))
    };
    for_frames(recording, &survey.frames, &chosen, threads, work, |result| -> Result<()> {
        if let Some((taken, image)) = result {
            collected.frames.push(taken);
            if let Some((image, camera_altitude_m)) = image {
                collected.means.add(config.render.method, &image, camera_altitude_m);
            }
        }
        progress.advance(1);
        Ok(())
    })?;
    progress.end();
    if with_keypoints {
        collected.pairs = matched(&collected.frames, survey, config, threads, progress)?;
    }
    Ok(collected)
}

/// Decodes a camera's message into linear light; and the bits of its codes.
fn decoded(decoder: &Decoder, message: &Message, survey: &Survey, config: &Config) -> std::result::Result<(SensorImage, u8), String> {
    let value = decoder.read(message.data())?;
    let Kind::Picture(read) = decoder.message_type.kind else { return Err("no picture".into()) };
    let light = Light { transfer: config.light.transfer, white_level: survey.white_level, response: survey.response.as_ref() };
    let Decoded { mut image, coding } = decode(&read(&value)?, light)?;
    survey.flat_field.as_ref().map_or(Ok(()), |flat| flat.divide(&mut image))?;
    Ok((image, coding.bits))
}

/// Frames far apart in time that look at the same ground, by the way of the instrument: crossing tracks, return legs.
fn crossings(frames: &[FrameSamples], survey: &Survey, config: &Config) -> Vec<(usize, usize)> {
    let looked_at = |f: &FrameSamples| {
        if f.grid.is_empty() {
            return None;
        }
        let sum: nalgebra::Vector3<f64> = f.grid.iter().map(|(_, s)| s.hit.vector()).sum();
        let middle = Point::from_vector(sum / f.grid.len().max(1) as f64);
        survey.pings.in_world(f.stamp, middle, &survey.rig)
    };
    let places: Vec<_> = frames.iter().map(looked_at).collect();
    let apart = |a: usize, b: usize| {
        let ((s, p), (t, q)) = (places[a]?, places[b]?);
        let (distance, altitude) = ((p - q).norm(), (frames[a].camera_altitude_m + frames[b].camera_altitude_m) / 2.0);
        (s == t && distance < CROSSING_SHARE * altitude).then_some(distance)
    };
    let mut found = Vec::new();
    for a in 0..frames.len() {
        let later = (a + 1..frames.len()).filter(|b| frames[*b].frame - frames[a].frame > CROSSING_FRAMES * config.matching.neighbours);
        let mut of_frame: Vec<(f64, usize)> = later.filter_map(|b| Some((apart(a, b)?, b))).collect();
        of_frame.sort_by(|x, y| x.0.total_cmp(&y.0));
        found.extend(of_frame.into_iter().take(CROSSINGS_PER_FRAME).map(|(_, b)| (a, b)));
    }
    found
}

fn matched(frames: &[FrameSamples], survey: &Survey, config: &Config, threads: &Threads, progress: &dyn Progress) -> Result<Vec<MatchedPair>> {
    let neighbours = (0..frames.len()).flat_map(|a| (a + 1..frames.len().min(a + 1 + config.matching.neighbours)).map(move |b| (a, b)));
    // Frames of one stretch are neighbours; the last of one and the first of the next are not.
    let near = neighbours.filter(|(a, b)| frames[*b].frame - frames[*a].frame <= config.matching.neighbours);
    let near: Vec<(usize, usize)> = near.chain(crossings(frames, survey, config)).collect();
    progress.begin(Step::Match, near.len());
    let camera = &survey.rig.camera;
    let reduction = config.matching.reduction(camera.width, camera.height) as f64;
    let inlier = config.matching.inlier_px * reduction / camera.fx;
    let work = |(a, b): (usize, usize)| {
        let of = |i: usize| Matchable { keypoints: &frames[i].keypoints, places: &frames[i].places };
        MatchedPair { a, b, keypoints: matches(&of(a), &of(b), &config.matching, inlier, (a as u64) << 32 | b as u64) }
    };
    let mut pairs = Vec::new();
    ordered_map(
        near.into_iter(),
        16,
        |_| 1,
        threads,
        work,
        |pair| -> Result<()> {
            progress.advance(1);
            if !pair.keypoints.is_empty() {
                pairs.push(pair);
            }
            Ok(())
        },
    )?;
    progress.end();
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_are_spread_and_bounded() {
        let swing =
            |frames: usize| (0..frames).map(|i| if (20_000..20_030).contains(&i) { 1.0 + i as f64 % 30.0 } else { 2.0 }).collect::<Vec<f64>>();
        assert_eq!(chosen_frames(&swing(10), 400).len(), 10);
        let chosen = chosen_frames(&swing(50_000), 400);
        assert!(chosen.len() <= 400 && chosen.len() > 380, "{}", chosen.len());
        assert!(chosen.iter().any(|i| *i < 2000) && chosen.iter().any(|i| *i > 48_000), "all of the log is asked");
        assert!((20_000..20_030).filter(|i| chosen.contains(i)).count() >= STRETCH, "a change of altitude is not passed by");
        let runs = chosen.iter().zip(chosen.iter().skip(1)).filter(|(a, b)| **b == **a + 1).count();
        assert!(runs * 10 > chosen.len() * 8, "neighbours stay together");
    }
}
