//! `unwater mosaic`: the paper's Fig. 11. Raw and corrected frames are projected onto the seafloor
//! by the trajectory, **unblended**: a later frame covers an earlier one, so that every step in
//! radiance between frames is visible.
//!
//! The trajectory is from odometry, or from DVL velocities and attitude; where the log has neither,
//! from keypoint matches between frames. Each frame is projected by its own seafloor plane,
//! orthographically from above.

mod by_matches;
mod geotiff;
mod grid;
mod poster;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};

use super::dive::{CameraLog, CorrectedLog, ImageSource, Images};
use super::places::{Places, placed};
use crate::diagnostics::{Diagnostic, MosaicFact};
use crate::error::{Error, Result};
use crate::geometry::SeafloorPlane;
use crate::session::{FrameRef, Options};
use crate::units::Stamp;
use poster::Poster;

pub use grid::{Grid, PlacedFrame, Strip};

/// Maximum number of frames, and the default without -S and -E.
const MAX_FRAMES: usize = 400;
const DEFAULT_FRAMES: usize = 60;

/// A mosaic of the seafloor.
pub struct Mosaic {
    /// file name of the log
    pub source: String,
    /// the frames, in time order
    pub frames: Vec<PlacedFrame>,
    /// source of the poses, and what was left out
    pub diagnostics: Vec<Diagnostic>,
    /// pixels ⇄ metres
    pub grid: Grid,
    /// from the raw images, where the log has them
    pub raw: Option<Strip>,
    /// from the corrected images
    pub corrected: Strip,
    georeference: Option<geotiff::Georeference>,
}

/// Options of a mosaic.
#[derive(Clone, Debug, Default)]
pub struct MosaicOptions {
    /// topic of the camera; needed where several were corrected
    pub camera: Option<String>,
    /// north up, with a position; otherwise the main direction of travel is up
    pub is_georeferenced: bool,
}

/// Builds the mosaic of a corrected log.
///
/// # Errors
/// Several cameras and none named; no trajectory; no position where one is needed.
pub fn mosaic(log: &CorrectedLog, wanted: &MosaicOptions, options: &Options) -> Result<Mosaic> {
    let camera = select_camera(log, wanted)?;
    let mut corrected = log.source(camera, Images::Corrected, options)?;
    if log.config.render.rectify {
        let rig = &mut corrected.bench.session.survey.rig;
        rig.camera = rig.camera.rectified();
    }
    let raw = log.source(camera, Images::Raw, options).ok();
    let mut diagnostics = Vec::new();
    let frames = select_frames(&corrected, camera, options.window.is_some(), &mut diagnostics);
    if frames.is_empty() {
        return Err(Error::Image("there is no corrected frame in this window of the log".into()));
    }
    let places = Places::read(&log.scanned.recording, options.window())?;
    let (mut placed_frames, has_attitude) =
        place_frames(raw.as_ref().unwrap_or(&corrected), &frames, &places, &mut diagnostics)?;

    let georeference = if wanted.is_georeferenced {
        Some(geotiff::georeference(&placed_frames, &places, has_attitude)?)
    } else {
        None
    };
    // North up on a map; the main direction of travel up on a poster.
    let yaw_rad =
        georeference.as_ref().map_or_else(|| yaw_of_travel(&placed_frames), |p| p.yaw_rad);
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    placed_frames.iter_mut().for_each(|f| f.world_from_body = yaw * f.world_from_body);

    let grid = Grid::around(&placed_frames, &corrected.bench.session.survey.rig);
    let strip = |source: &ImageSource| Strip::project(source, &grid, &placed_frames);
    let raw = raw.as_ref().map(strip).transpose()?.filter(|s| s.covered() > 0);
    if raw.is_none() {
        diagnostics.push(MosaicFact::NoRawImages.into());
    }
    Ok(Mosaic {
        source: camera.fact("source").into(),
        diagnostics,
        grid,
        raw,
        corrected: strip(&corrected)?,
        frames: placed_frames,
        georeference,
    })
}

impl Mosaic {
    /// The poster as PNG: strips side by side, with their profiles across the track.
    ///
    /// # Errors
    /// The encoder's message.
    pub fn png(&self) -> std::result::Result<Vec<u8>, String> {
        let Self { source, diagnostics, grid, .. } = self;
        let (raw, corrected, frames) = (self.raw.as_ref(), &self.corrected, self.frames.len());
        Poster { source, diagnostics, grid, frames, raw, corrected }.draw().png()
    }

    /// The corrected strip as a GeoTIFF, north up; `None` without
    /// [`MosaicOptions::is_georeferenced`].
    pub fn tiff(&self) -> Option<Vec<u8>> {
        let georeference = self.georeference.as_ref()?;
        Some(geotiff::encode(&self.source, &self.grid, &self.corrected, georeference))
    }
}

/// Whether a file name has the extension of a GeoTIFF.
pub fn is_geotiff(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("tif") || e.eq_ignore_ascii_case("tiff"))
}

fn select_camera<'l>(log: &'l CorrectedLog, wanted: &MosaicOptions) -> Result<&'l CameraLog> {
    let topics =
        || log.cameras.iter().map(|c| c.fact("camera_topic").to_string()).collect::<Vec<_>>();
    match (&wanted.camera, &log.cameras[..]) {
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

/// A frame without its pose.
struct SelectedFrame {
    record: usize,
    log_time: u64,
    stamp: Stamp,
    plane: SeafloorPlane,
}

/// The frames in the mosaic.
fn select_frames(
    source: &ImageSource,
    camera: &CameraLog,
    is_window_given: bool,
    diagnostics: &mut Vec<Diagnostic>,
) -> Vec<SelectedFrame> {
    let session = &source.bench.session;
    let selected = |f: &FrameRef| {
        let record = *source.records.get(&f.id)?;
        let log_time = camera.frames.get(record)?.log_time;
        let plane = session.seafloor(f.stamp).ok()?;
        Some(SelectedFrame { record, log_time, stamp: f.stamp, plane })
    };
    let mut frames: Vec<_> = session.survey.frames.iter().filter_map(selected).collect();
    let total = frames.len();
    if !is_window_given && total > DEFAULT_FRAMES {
        let first = (total - DEFAULT_FRAMES) / 2;
        frames = frames.drain(first..first + DEFAULT_FRAMES).collect();
        diagnostics.push(MosaicFact::FramesChosen { used: DEFAULT_FRAMES, frames: total }.into());
    }
    let step = frames.len().div_ceil(MAX_FRAMES).max(1);
    if step > 1 {
        diagnostics.push(MosaicFact::FramesThinned { step, frames: frames.len() }.into());
    }
    frames.into_iter().step_by(step).collect()
}

/// Frames with their poses, of the trajectory segment with the most frames; and whether the world's
/// axes are those of an attitude.
fn place_frames(
    source: &ImageSource,
    frames: &[SelectedFrame],
    places: &Places,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<(Vec<PlacedFrame>, bool)> {
    let with_planes: Vec<(Stamp, SeafloorPlane)> =
        frames.iter().map(|f| (f.stamp, f.plane)).collect();
    let (poses, has_attitude) = match placed(&source.bench.session, places, &with_planes) {
        Some(placed) => {
            diagnostics.push(MosaicFact::PosesFrom { source: placed.source }.into());
            (placed.poses, true)
        }
        None => {
            let records: Vec<usize> = frames.iter().map(|f| f.record).collect();
            let poses = by_matches::poses(source, &records)?;
            diagnostics.push(MosaicFact::PosesFromMatches.into());
            (poses, false)
        }
    };
    let mut segments: BTreeMap<u32, usize> = BTreeMap::new();
    poses.iter().flatten().for_each(|(segment, _)| *segments.entry(*segment).or_default() += 1);
    let longest = segments
        .iter()
        .max_by_key(|(segment, frames)| (**frames, std::cmp::Reverse(**segment)))
        .map(|(s, _)| *s);
    let mut placed_frames = Vec::new();
    for (frame, pose) in frames.iter().zip(&poses) {
        if let Some((_, world_from_body)) = pose.filter(|(segment, _)| Some(*segment) == longest) {
            placed_frames.push(PlacedFrame {
                record: frame.record,
                log_time: frame.log_time,
                stamp: frame.stamp,
                world_from_body,
                plane: frame.plane,
            });
        }
    }
    if placed_frames.len() < 2 {
        let reason =
            "no poses for the frames: the log has no odometry, no velocity over ground with \
                      attitude, and no keypoint matches between neighbouring frames"
                .to_string();
        return Err(Error::Image(reason));
    }
    if placed_frames.len() < frames.len() {
        let (used, frames) = (placed_frames.len(), frames.len());
        diagnostics.push(MosaicFact::FramesNotConnected { used, frames }.into());
    }
    Ok((placed_frames, has_attitude))
}

/// Rotation about the vertical that turns the main direction of travel up (rad).
fn yaw_of_travel(frames: &[PlacedFrame]) -> f64 {
    let positions: Vec<Vector3<f64>> =
        frames.iter().map(|f| f.world_from_body.translation.vector).collect();
    let n = positions.len() as f64;
    let mean = positions.iter().sum::<Vector3<f64>>() / n;
    let (xx, yy, xy) = positions
        .iter()
        .map(|p| p - mean)
        .fold((0.0, 0.0, 0.0), |(a, b, c), d| (a + d.x * d.x, b + d.y * d.y, c + d.x * d.y));
    let mut main = 0.5 * (2.0 * xy).atan2(xx - yy);
    // The end of the track is up, not its start.
    if let (Some(first), Some(last)) = (positions.first(), positions.last())
        && (last - first).dot(&Vector3::new(main.cos(), main.sin(), 0.0)) < 0.0
    {
        main += std::f64::consts::PI;
    }
    std::f64::consts::FRAC_PI_2 - main
}
