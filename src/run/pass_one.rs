//! Pass one over a log: frames → samples → tracks. Frames are decoded on all cores and forgotten at
//! once; samples are small and stay. What the samples mean is for `estimate` to say.

use std::collections::BTreeSet;
use std::sync::Mutex;

use crate::config::{Config, Estimator};
use crate::coordinates::Point;
use crate::correct::MeanFrames;
use crate::error::Result;
use crate::estimate::{
    FrameSamples, Matchable, MatchedPair, PLANES_AROUND_S, coarsest_m, matches, sample_frame,
};
use crate::geometry::{SeafloorPlane, View};
use crate::image::SensorImage;
use crate::image::decode::{Buffers, CameraResponse, DecodedImage, decode_with};
use crate::messages::{Decoder, Kind};
use crate::recording::{Message, Recording};

use crate::parallel::{Threads, ordered_map};
use crate::session::chosen_frames::for_frames;
use crate::session::index::{FrameRef, Scan};
use crate::session::survey::Survey;
use crate::session::{Progress, Step};

/// Frames in a row that pass one takes before it jumps on; overlap needs neighbours.
const STRETCH: usize = 12;
/// Frames nearer in time than this share the ground, the pings and the height, and say the same [s]
/// …
const STEP_S: f64 = 0.5;
/// … but low over the ground it has soon left the picture [s of each m].
const STEP_S_PER_M: f64 = 0.5;
/// Frames by which interval and altitude are judged.
const JUDGED_FRAMES: usize = 40;

/// Frames that many times as far apart as neighbours may cross each other, where the ground they
/// look at lies within this share of the altitude; so many are tried for each.
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

/// Which frames pass one looks at: all, or so many stretches of neighbours. The log is parted into
/// as many parts; of each that stretch is taken whose altitude changes most, as the water shows
/// itself in that. Frames without a seafloor have NaN.
pub fn chosen_frames(altitude_m: &[f64], most: usize) -> BTreeSet<usize> {
    let total = altitude_m.len();
    if total <= most {
        return (0..total).collect();
    }
    let parts = (most / STRETCH).max(1);
    let length = (most / parts).min(total);
    let spread = |first: usize| {
        let heights = altitude_m[first..first + length].iter().filter(|a| a.is_finite());
        let (least, most, seen) =
            heights.fold((f64::INFINITY, 0f64, 0), |(l, m, n), a| (l.min(*a), m.max(*a), n + 1));
        // A stretch that lost its floor shows less; a tenth more or less of spread decides nothing.
        if seen == 0 { 0.0 } else { ((most / least).ln() * 10.0).round() / 10.0 * f64::from(seen) }
    };
    (0..parts)
        .flat_map(|part| {
            let (begin, end) = (part * total / parts, (part + 1) * total / parts);
            let firsts = (begin..=(end - length).max(begin))
                .step_by(length / 2)
                .map(|first| first.min(total - length));
            let best = firsts.fold((0.0, begin), |best, first| {
                if spread(first) > best.0 { (spread(first), first) } else { best }
            });
            best.1..best.1 + length
        })
        .collect()
}

/// How a camera quicker than the vehicle moves is thinned out.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pace {
    /// every so manieth frame may be looked at; fewer are left out where the log has few
    step: usize,
    /// and so many of those on is the next that a frame is matched with
    spacing: usize,
}

impl Pace {
    fn new(interval_s: f64, altitude_m: f64, frames: usize, most: usize) -> Self {
        let step_s = STEP_S.min(STEP_S_PER_M * altitude_m);
        let apart = if interval_s > 0.0 { (step_s / interval_s + 0.01) as usize } else { 1 };
        let step = apart.min(frames / most.max(1)).max(1);
        Self { step, spacing: (apart / step).max(1) }
    }

    fn of(survey: &Survey, config: &Config, most: usize) -> Self {
        let frames = &survey.frames;
        let mut stamps: Vec<i64> = frames.iter().map(|f| f.stamp.0).collect();
        stamps.sort_unstable();
        let mut steps_s: Vec<f64> =
            stamps.windows(2).map(|w| (w[1] - w[0]) as f64 * 1e-9).collect();
        let judged = frames.iter().step_by(frames.len().div_ceil(JUDGED_FRAMES).max(1));
        let mut altitudes_m: Vec<f64> =
            judged.map(|f| altitude_m(survey, config, f)).filter(|a| a.is_finite()).collect();
        let median = |values: &mut Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
        };
        Self::new(median(&mut steps_s), median(&mut altitudes_m), frames.len(), most)
    }
}

/// The plane below a frame.
fn plane_below(survey: &Survey, config: &Config, frame: &FrameRef) -> Option<SeafloorPlane> {
    survey.pings.seafloor(frame.stamp, &survey.rig, &config.seafloor).ok()
}

/// A frame's view of it, before the frame is decoded.
fn view<'v>(survey: &'v Survey, plane: &'v SeafloorPlane) -> View<'v> {
    View { camera: &survey.rig.camera, rig: &survey.rig, plane, terrain: None }
}

/// Height of the camera over the seafloor; NaN where there is none.
fn altitude_m(survey: &Survey, config: &Config, frame: &FrameRef) -> f64 {
    plane_below(survey, config, frame)
        .map_or(f64::NAN, |plane| view(survey, &plane).camera_altitude_m())
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
    let pace = Pace::of(survey, config, most);
    let offered: Vec<&FrameRef> = survey.frames.iter().step_by(pace.step).collect();
    let altitudes: Vec<f64> =
        offered.iter().map(|frame| altitude_m(survey, config, frame)).collect();
    let places = chosen_frames(&altitudes, most);
    let planes = places.iter().filter_map(|place| plane_below(survey, config, offered[*place]));
    let coarsest = planes.map(|plane| coarsest_m(&view(survey, &plane))).fold(0.0, f64::max);
    let chosen: BTreeSet<usize> = places.into_iter().map(|place| place * pace.step).collect();
    let mut collected =
        Collected { is_all: chosen.len() == survey.frames.len(), ..Collected::default() };
    progress.begin(Step::Estimate, chosen.len());
    let wants_average = config.render.method.needs_mean_frames();
    let with_keypoints = config.estimate.estimator != Estimator::Altitude;
    // As many as there are threads, and no longer than this pass.
    let rooms: Mutex<Vec<Buffers>> = Mutex::default();
    let work = |(index, message): (usize, Message)| {
        let decoder = scan.decoders.get(&message.channel)?;
        let mut room = rooms.lock().map(|mut spare| spare.pop()).ok().flatten().unwrap_or_default();
        let (image, bits) = decoded(decoder, &message, survey, config, &mut room).ok()?;
        let camera = survey.rig.camera.scaled_to(image.light.width, image.light.height)?;
        let stamp = survey.frames.get(index)?.stamp;
        let plane = survey.pings.seafloor(stamp, &survey.rig, &config.seafloor).ok()?;
        let terrain = survey.pings.terrain(stamp, &plane, &survey.rig);
        let view =
            View { camera: &camera, rig: &survey.rig, plane: &plane, terrain: terrain.as_ref() };
        let mut taken = sample_frame(
            (index, stamp),
            &image,
            &view,
            with_keypoints.then_some(coarsest),
            &config.matching,
            &config.estimate,
        );
        taken.eight_bit = bits <= 8;
        let plane_at = |offset_s: f64| {
            let plane = survey
                .pings
                .seafloor(stamp.plus_seconds(offset_s), &survey.rig, &config.seafloor)
                .ok()?;
            Some((plane.normal, plane.distance_m))
        };
        taken.planes_around =
            plane_at(-PLANES_AROUND_S).zip(plane_at(PLANES_AROUND_S)).map(|(a, b)| [a, b]);
        if wants_average {
            return Some((taken, Some((image.into_demosaiced(), view.camera_altitude_m()))));
        }
        room.recycle(image);
        if let Ok(mut spare) = rooms.lock() {
            spare.push(room);
        }
        Some((taken, None))
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
        collected.pairs = matched(&collected.frames, survey, config, pace, threads, progress)?;
    }
    Ok(collected)
}

/// Decodes a camera's message into linear light; and the bits of its codes.
fn decoded(
    decoder: &Decoder,
    message: &Message,
    survey: &Survey,
    config: &Config,
    room: &mut Buffers,
) -> std::result::Result<(SensorImage, u8), String> {
    let value = decoder.read(message.data())?;
    let Kind::Image(read) = decoder.message_type.kind else { return Err("no picture".into()) };
    let light = CameraResponse {
        transfer: config.light.transfer,
        white_level: survey.white_level,
        response: survey.response.as_ref(),
    };
    let DecodedImage { mut image, coding } = decode_with(&read(&value)?, light, room)?;
    survey.flat_field.as_ref().map_or(Ok(()), |flat| flat.divide(&mut image))?;
    Ok((image, coding.bits))
}

/// Frames far apart in time that look at the same ground, by the way of the instrument: crossing
/// tracks, return legs.
fn crossings(frames: &[FrameSamples], survey: &Survey, nearest: usize) -> Vec<(usize, usize)> {
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
        let (distance, altitude) =
            ((p - q).norm(), (frames[a].camera_altitude_m + frames[b].camera_altitude_m) / 2.0);
        (s == t && distance < CROSSING_SHARE * altitude).then_some(distance)
    };
    let mut found = Vec::new();
    for a in 0..frames.len() {
        let later = (a + 1..frames.len())
            .filter(|b| frames[*b].frame - frames[a].frame > CROSSING_FRAMES * nearest);
        let mut of_frame: Vec<(f64, usize)> =
            later.filter_map(|b| Some((apart(a, b)?, b))).collect();
        of_frame.sort_by(|x, y| x.0.total_cmp(&y.0));
        found.extend(of_frame.into_iter().take(CROSSINGS_PER_FRAME).map(|(_, b)| (a, b)));
    }
    found
}

fn matched(
    frames: &[FrameSamples],
    survey: &Survey,
    config: &Config,
    Pace { step, spacing }: Pace,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Vec<MatchedPair>> {
    let neighbours = config.matching.neighbours;
    let later =
        |a: usize| (1..=neighbours).map(move |n| a + n * spacing).filter(|b| *b < frames.len());
    let near = (0..frames.len()).flat_map(|a| later(a).map(move |b| (a, b)));
    // Frames of one stretch are neighbours; the last of one and the first of the next are not.
    let farthest = neighbours * spacing * step;
    let near = near.filter(|(a, b)| frames[*b].frame - frames[*a].frame <= farthest);
    let near: Vec<(usize, usize)> = near.chain(crossings(frames, survey, farthest)).collect();
    progress.begin(Step::Match, near.len());
    let camera = &survey.rig.camera;
    let reduction = config.matching.reduction(camera.width, camera.height) as f64;
    let inlier = config.matching.inlier_px * reduction / camera.fx;
    let work = |(a, b): (usize, usize)| {
        let of =
            |i: usize| Matchable { keypoints: &frames[i].keypoints, places: &frames[i].places };
        MatchedPair {
            a,
            b,
            keypoints: matches(
                &of(a),
                &of(b),
                &config.matching,
                inlier,
                (a as u64) << 32 | b as u64,
            ),
        }
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
    fn a_quick_camera_is_thinned_out_where_the_log_is_long() {
        assert_eq!(Pace::new(1.0, 2.0, 4000, 60), Pace { step: 1, spacing: 1 });
        assert_eq!(Pace::new(1.0 / 30.0, 2.0, 40_000, 60), Pace { step: 15, spacing: 1 });
        assert_eq!(Pace::new(0.1, 0.3, 4000, 60), Pace { step: 1, spacing: 1 });
        assert_eq!(
            Pace::new(0.1, 2.0, 400, 400),
            Pace { step: 1, spacing: 5 },
            "all are looked at, those apart are matched"
        );
        assert_eq!(Pace::new(f64::NAN, 2.0, 1, 60), Pace { step: 1, spacing: 1 });
    }

    #[test]
    fn stretches_are_spread_and_bounded() {
        let swing = |frames: usize| {
            (0..frames)
                .map(|i| if (20_000..20_030).contains(&i) { 1.0 + i as f64 % 30.0 } else { 2.0 })
                .collect::<Vec<f64>>()
        };
        assert_eq!(chosen_frames(&swing(10), 400).len(), 10);
        let chosen = chosen_frames(&swing(50_000), 400);
        assert!(chosen.len() <= 400 && chosen.len() > 380, "{}", chosen.len());
        assert!(
            chosen.iter().any(|i| *i < 2000) && chosen.iter().any(|i| *i > 48_000),
            "all of the log is asked"
        );
        assert!(
            (20_000..20_030).filter(|i| chosen.contains(i)).count() >= STRETCH,
            "a change of altitude is not passed by"
        );
        let runs = chosen.iter().zip(chosen.iter().skip(1)).filter(|(a, b)| **b == **a + 1).count();
        assert!(runs * 10 > chosen.len() * 8, "neighbours stay together");
    }
}
