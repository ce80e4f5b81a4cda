//! `unwater mosaic`: the paper's Fig. 11. Frames are laid onto the seafloor as the log says they
//! were taken, raw and corrected alike, **unblended**: a later frame covers an earlier one, and
//! every step of light between them shows.
//!
//! Where the vehicle was comes from odometry or from the DVL's velocities and the attitude; where
//! the log has neither, from points that frames share. Each frame lies on its own plane, seen from
//! straight above.

mod by_matches;
mod geotiff;
mod grid;
mod poster;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::dive::{CameraLog, CorrectedLog, Pictures};
use super::places::{Places, placed};
use crate::error::{Error, Result};
use crate::geometry::SeafloorPlane;
use crate::image::LinearImage;
use crate::recording::Window;
use crate::run::bench::{Bench, BenchFrame};
use crate::session::Options;
use crate::units::Stamp;
pub use grid::{Grid, Strip};

/// Frames of a mosaic, at most, and where neither -S nor -E says which.
const MOST_FRAMES: usize = 400;
const USUAL_FRAMES: usize = 60;

/// A frame where it was taken.
#[derive(Clone, Copy, Debug)]
pub struct Laid {
    /// log time [ns]
    pub log_time: u64,
    /// its own time
    pub stamp: Stamp,
    /// the body in a world whose z points up [m]
    pub world_from_body: Isometry3<f64>,
    /// the floor below, in the body
    pub plane: SeafloorPlane,
}

/// A stretch of seafloor.
pub struct Mosaic {
    /// what the log's file is called
    pub source: String,
    /// the frames, in time order
    pub frames: Vec<Laid>,
    /// where the places come from, and what was left out
    pub words: Vec<String>,
    /// pixels ⇄ metres
    pub grid: Grid,
    /// as recorded, where the log still has it
    pub raw: Option<Strip>,
    /// as corrected
    pub corrected: Strip,
    position: Option<geotiff::Position>,
}

/// What is asked for.
#[derive(Clone, Debug, Default)]
pub struct Asked {
    /// the camera's topic, where several were corrected
    pub camera: Option<String>,
    /// north up and with a position, or the way up
    pub is_georeferenced: bool,
}

/// Lays out the frames of a corrected log.
///
/// # Errors
/// Several cameras and none named; no way to tell where frames were; no position where one is
/// needed.
pub fn mosaic(log: &CorrectedLog, asked: &Asked, options: &Options) -> Result<Mosaic> {
    let camera = chosen_camera(log, asked)?;
    let mut corrected = log.bench(camera, Pictures::Corrected, options)?;
    if log.config.render.rectify {
        corrected.log.survey.rig.camera = corrected.log.survey.rig.camera.rectified();
    }
    let raw = log.bench(camera, Pictures::Raw, options).ok();
    let window = options.window.unwrap_or(Window::ALL);
    let mut words = Vec::new();
    let frames = chosen_frames(&corrected, camera, options.window.is_some(), &mut words);
    if frames.is_empty() {
        return Err(Error::Image("no corrected frame lies in this stretch of the log".into()));
    }
    let places = Places::read(&log.recording, window);
    let (mut laid, is_level_known) =
        lay(raw.as_ref().unwrap_or(&corrected), &frames, &places, &mut words)?;

    let position = if asked.is_georeferenced {
        Some(geotiff::position(&laid, &places, is_level_known)?)
    } else {
        None
    };
    // North up on a map; the way up on a poster.
    let turn = position.as_ref().map_or_else(|| turn_of_way(&laid), |p| p.turn_rad);
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
    laid.iter_mut().for_each(|l| l.world_from_body = turned * l.world_from_body);

    let grid = Grid::around(&laid, &corrected.log.survey.rig);
    let strip = |bench: &Bench, light: fn(&BenchFrame) -> LinearImage| {
        Strip::of(bench, &grid, &laid, light)
    };
    let own = |frame: &BenchFrame| frame.image.clone().into_demosaiced();
    let raw = raw.as_ref().map(|bench| strip(bench, own)).transpose()?.filter(|s| s.covered() > 0);
    if raw.is_none() {
        words.push("the raw pictures are not in this log: the corrected strip stands alone".into());
    }
    Ok(Mosaic {
        source: camera.fact("source").into(),
        words,
        grid,
        raw,
        corrected: strip(&corrected, own)?,
        frames: laid,
        position,
    })
}

impl Mosaic {
    /// The poster: strips side by side, with their profiles across the track.
    ///
    /// # Errors
    /// The encoder's own words.
    pub fn png(&self) -> std::result::Result<Vec<u8>, String> {
        poster::poster(self).png()
    }

    /// The corrected strip as a GeoTIFF, north up; `None` where no position was asked for.
    pub fn tiff(&self) -> Option<Vec<u8>> {
        self.position.as_ref().map(|position| geotiff::file(self, position))
    }
}

/// Whether a file's name asks for a GeoTIFF.
pub fn is_geotiff(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("tif") || e.eq_ignore_ascii_case("tiff"))
}

fn chosen_camera<'l>(log: &'l CorrectedLog, asked: &Asked) -> Result<&'l CameraLog> {
    let topics =
        || log.cameras.iter().map(|c| c.fact("camera_topic").to_string()).collect::<Vec<_>>();
    match (&asked.camera, &log.cameras[..]) {
        (None, [only]) => Ok(only),
        (None, _) => Err(Error::SeveralCameras { topics: topics() }),
        (Some(topic), cameras) => {
            let named = cameras
                .iter()
                .find(|c| c.fact("camera_topic") == topic || c.fact("corrected_topic") == topic);
            named.ok_or_else(|| Error::NoSuchTopic {
                what: "camera",
                topic: topic.clone(),
                seen: topics().join(", "),
            })
        }
    }
}

/// Times and planes of the frames that are laid out.
fn chosen_frames(
    bench: &Bench,
    camera: &CameraLog,
    is_window_given: bool,
    words: &mut Vec<String>,
) -> Vec<(u64, Stamp, SeafloorPlane)> {
    let survey = &bench.log.survey;
    let corrected: BTreeSet<u64> = camera.corrected().map(|(_, f)| f.log_time).collect();
    let of = |f: &crate::session::index::FrameRef| {
        let log_time = u64::try_from(f.logged.0).ok().filter(|t| corrected.contains(t))?;
        Some((
            log_time,
            f.stamp,
            survey.pings.seafloor(f.stamp, &survey.rig, &bench.config.seafloor).ok()?,
        ))
    };
    let mut frames: Vec<_> = survey.frames.iter().filter_map(of).collect();
    let total = frames.len();
    if !is_window_given && total > USUAL_FRAMES {
        let first = (total - USUAL_FRAMES) / 2;
        frames = frames.drain(first..first + USUAL_FRAMES).collect();
        words.push(format!(
            "{USUAL_FRAMES} of {total} frames, from the middle of the dive; -S and -E choose \
             others"
        ));
    }
    let step = frames.len().div_ceil(MOST_FRAMES).max(1);
    if step > 1 {
        words.push(format!("one frame in {step}, as the stretch has {}", frames.len()));
    }
    frames.into_iter().step_by(step).collect()
}

/// Frames with their poses, of the stretch that holds most of them; and whether the world's axes
/// are those of an attitude.
fn lay(
    bench: &Bench,
    frames: &[(u64, Stamp, SeafloorPlane)],
    places: &Places,
    words: &mut Vec<String>,
) -> Result<(Vec<Laid>, bool)> {
    let with_planes: Vec<(Stamp, SeafloorPlane)> =
        frames.iter().map(|(_, stamp, plane)| (*stamp, *plane)).collect();
    let (poses, is_level_known) = match placed(&bench.log, places, &with_planes) {
        Some(placed) => {
            words.push(format!("places from {}", placed.source));
            (placed.poses, true)
        }
        None => {
            let times: Vec<u64> = frames.iter().map(|f| f.0).collect();
            let poses = by_matches::poses(bench, &times)?;
            words.push(
                "places from points that neighbouring frames share, as the log tells no way over \
                 the ground"
                    .into(),
            );
            (poses, false)
        }
    };
    let mut stretches: BTreeMap<u32, usize> = BTreeMap::new();
    poses.iter().flatten().for_each(|(stretch, _)| *stretches.entry(*stretch).or_default() += 1);
    let longest = stretches
        .iter()
        .max_by_key(|(stretch, frames)| (**frames, std::cmp::Reverse(**stretch)))
        .map(|(s, _)| *s);
    let mut laid = Vec::new();
    for ((log_time, stamp, plane), pose) in frames.iter().zip(&poses) {
        if let Some((_, world_from_body)) = pose.filter(|(stretch, _)| Some(*stretch) == longest) {
            laid.push(Laid { log_time: *log_time, stamp: *stamp, world_from_body, plane: *plane });
        }
    }
    if laid.len() < 2 {
        let reason = "frames cannot be laid out: the log has no odometry, no velocity over the \
                      ground with an attitude, and no two neighbouring frames that show the same \
                      points"
            .to_string();
        return Err(Error::Image(reason));
    }
    if laid.len() < frames.len() {
        words.push(format!(
            "{} of {} frames: the others are not joined to these",
            laid.len(),
            frames.len()
        ));
    }
    Ok((laid, is_level_known))
}

/// The turn about the vertical that brings the way's main direction up [rad].
fn turn_of_way(laid: &[Laid]) -> f64 {
    let places: Vec<Vector3<f64>> =
        laid.iter().map(|l| l.world_from_body.translation.vector).collect();
    let n = places.len() as f64;
    let mean = places.iter().sum::<Vector3<f64>>() / n;
    let (xx, yy, xy) = places
        .iter()
        .map(|p| p - mean)
        .fold((0.0, 0.0, 0.0), |(a, b, c), d| (a + d.x * d.x, b + d.y * d.y, c + d.x * d.y));
    let mut main = 0.5 * (2.0 * xy).atan2(xx - yy);
    // Of the two ends, up is where the dive went.
    if let (Some(first), Some(last)) = (places.first(), places.last())
        && (last - first).dot(&Vector3::new(main.cos(), main.sin(), 0.0)) < 0.0
    {
        main += std::f64::consts::PI;
    }
    std::f64::consts::FRAC_PI_2 - main
}
