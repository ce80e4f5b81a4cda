//! `unwater compare`: the paper's Fig. 4 for one frame, all methods side by side.
//!
//! Below each image a scatter plot compares the light of points in this frame with that of the same
//! points in other frames, after the same method. Points on the diagonal agree.

mod scatter;

use std::collections::BTreeSet;
use std::path::Path;

use super::display::{INK, PAPER, SOFT, downscale, exposure, scaled, to_srgb};
use super::match_frames;
use crate::config::Method;
use crate::correct::{MeanFrames, apply_baseline};
use crate::error::{Error, Result};
use crate::estimate::FrameSamples;
use crate::image::LinearImage;
use crate::model::{ModelFile, RenderingFile};
use crate::plot::Canvas;
use crate::recording::{FrameId, Message};
use crate::run;
use crate::run::bench::{Bench, BenchFrame};
use crate::session::{CameraSession, FrameRef, Options, Progress};
use scatter::{Agreement, Pairs};

/// Selects a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameSelector {
    /// by number, from 0
    Number(usize),
    /// nearest to a log time (ns)
    LogTime(u64),
}

impl FrameSelector {
    fn index(self, frames: &[FrameRef]) -> Result<usize> {
        match self {
            Self::Number(number) if number < frames.len() => Ok(number),
            Self::Number(number) => Err(Error::Usage(format!(
                "there is no frame {number}: the camera has {} frames, numbered from 0",
                frames.len()
            ))),
            Self::LogTime(time) => {
                let time = i64::try_from(time).unwrap_or(i64::MAX);
                let distance = |f: &FrameRef| f.logged.0.abs_diff(time);
                let nearest = frames.iter().enumerate().min_by_key(|(_, f)| distance(f));
                let nearest = nearest.map(|(i, _)| i);
                nearest.ok_or_else(|| Error::Usage("the camera has no images".into()))
            }
        }
    }
}

/// Longer side at which methods are applied (px).
const SIDE: usize = 1000;
/// Maximum number of frames in mean frames.
const MAX_MEAN_FRAMES: usize = 100;
/// Maximum number of other frames to compare with.
const MAX_OTHERS: usize = 4;
/// Width of a tile's image, and gap between tiles (px).
const TILE_WIDTH: usize = 440;
const GAP: i64 = 20;
const COLUMNS: usize = 4;
/// Height of the text above an image, and of the sheet's header (px).
const CAPTION: i64 = 50;
const HEAD: i64 = 100;

/// A tile: name, description, and the methods applied in order; none for raw.
struct Tile {
    name: &'static str,
    description: &'static str,
    methods: &'static [Method],
}

const TILES: [Tile; 12] = [
    Tile { name: "raw", description: "brightness by one factor", methods: &[] },
    Tile {
        name: "grey world",
        description: "the frame's mean is grey",
        methods: &[Method::GreyWorld],
    },
    Tile {
        name: "white patch",
        description: "the frame's brightest is white",
        methods: &[Method::WhitePatch],
    },
    Tile {
        name: "adaptive histogram",
        description: "contrast-limited, per frame",
        methods: &[Method::Ahe],
    },
    Tile {
        name: "homomorphic, low-pass",
        description: "Eq. 12, per frame",
        methods: &[Method::Homomorphic],
    },
    Tile {
        name: "homomorphic, surface",
        description: "Eq. 12, polynomial per frame",
        methods: &[Method::HomomorphicSurface],
    },
    Tile {
        name: "adaptive hist. + grey world",
        description: "one after the other",
        methods: &[Method::Ahe, Method::GreyWorld],
    },
    Tile {
        name: "low-pass + grey world",
        description: "one after the other",
        methods: &[Method::Homomorphic, Method::GreyWorld],
    },
    Tile {
        name: "surface + grey world",
        description: "one after the other",
        methods: &[Method::HomomorphicSurface, Method::GreyWorld],
    },
    Tile {
        name: "frame average",
        description: "Eq. 14, mean of the log",
        methods: &[Method::FrameAverage],
    },
    Tile {
        name: "range average",
        description: "mean of frames at this altitude",
        methods: &[Method::RangeAverage],
    },
    Tile { name: "unwater", description: "Eq. 15, full correction", methods: &[Method::Full] },
];

/// A frame with its samples and its raw image, downscaled.
struct ComparedFrame {
    at: FrameRef,
    /// for its correction
    message: Message,
    /// altitude of the camera (m)
    altitude_m: f64,
    /// width of the image (px)
    width: usize,
    samples: FrameSamples,
    raw: LinearImage,
}

/// Inputs of all methods.
struct Methods<'m> {
    bench: &'m Bench,
    means: MeanFrames,
    exposure: RenderingFile,
}

/// The sheet of one frame, as PNG. Without a model one is estimated first.
///
/// # Errors
/// An unusable log; a frame that does not exist, cannot be decoded, or has no seafloor.
pub fn sheet(
    input: &Path,
    model: Option<ModelFile>,
    selector: FrameSelector,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Vec<u8>> {
    let mut options = options.clone();
    options.config.render.method = Method::Full;
    let session = CameraSession::open(input, &options)?;
    let file = match model {
        Some(file) => file,
        None => run::estimate(&[&session], &options, progress)?,
    };
    let bench = Bench::new(session, file, None, options.threads)?;
    let index = selector.index(&bench.session.survey.frames)?;
    let reach = bench.session.config.matching.neighbours;
    let near = frame_ids(&bench, index.saturating_sub(reach)..=index + reach);
    let mut compared: Vec<ComparedFrame> = Vec::new();
    bench.each(&near, |frame| ComparedFrame::new(&bench, frame), |f| compared.push(f))?;
    let Some(own) = compared.iter().position(|f| f.samples.frame == index) else {
        let why = "cannot be decoded or has no seafloor plane; see `unwater inspect`, or select \
                   another frame";
        return Err(Error::Image(format!("frame {index} of {} {why}", input.display())));
    };
    let here = compared.remove(own);
    let pairs = overlapping(&bench, &here, &compared);
    let means = mean_frames(&bench, index)?;
    let exposure = match bench.model.file.rendering.method {
        Method::Full => bench.model.file.rendering.clone(),
        _ => {
            let balance = bench.session.config.render.white_balance;
            let log_colors = bench.with_frame(&here.message, |frame| bench.log_colors(frame));
            bench.exposure(&log_colors.unwrap_or_default(), Method::Full, balance)
        }
    };
    Methods { bench: &bench, means, exposure }
        .draw(&here, &pairs)
        .png()
        .map_err(|reason| Error::WriteRecord { path: input.into(), reason })
}

/// Identities of frames by their numbers; unknown numbers are left out.
fn frame_ids(bench: &Bench, numbers: impl IntoIterator<Item = usize>) -> BTreeSet<FrameId> {
    let frames = &bench.session.survey.frames;
    numbers.into_iter().filter_map(|number| Some(frames.get(number)?.id)).collect()
}

impl ComparedFrame {
    fn new(bench: &Bench, frame: &BenchFrame<'_>) -> Self {
        Self {
            at: frame.frame.at,
            message: frame.message.clone(),
            altitude_m: frame.frame.view().camera_altitude_m(),
            width: frame.frame.camera.width,
            samples: bench.samples(frame, true),
            raw: raw(frame),
        }
    }
}

/// The raw image at [`SIDE`], demosaiced.
fn raw(frame: &BenchFrame<'_>) -> LinearImage {
    downscale(&frame.image.clone().into_demosaiced(), SIDE)
}

/// Mean frames for the baselines, frame `index` included.
fn mean_frames(bench: &Bench, index: usize) -> Result<MeanFrames> {
    let mut means = MeanFrames::default();
    let count = bench.session.survey.frames.len();
    let step = count.div_ceil(MAX_MEAN_FRAMES).max(1);
    let chosen = frame_ids(bench, (0..count).step_by(step).chain([index]));
    bench.each(
        &chosen,
        |frame| (raw(frame), frame.frame.view().camera_altitude_m()),
        |(image, altitude_m)| {
            means.add(Method::FrameAverage, &image, altitude_m);
            means.add(Method::RangeAverage, &image, altitude_m);
        },
    )?;
    Ok(means)
}

/// The frames with the most keypoint matches to this one, with the pixels in both.
fn overlapping<'l>(
    bench: &Bench,
    here: &ComparedFrame,
    others: &'l [ComparedFrame],
) -> Vec<(&'l ComparedFrame, Pairs)> {
    let pairs_with = |other: &'l ComparedFrame| {
        let seed = (here.samples.frame as u64) << 32 | other.samples.frame as u64;
        let found = match_frames(bench, &here.samples, &other.samples, seed);
        let pixel =
            |l: &ComparedFrame, k: u32| l.samples.keypoints.get(k as usize).map(|k| (k.u, k.v));
        let pixels: Pairs =
            found.iter().filter_map(|(i, j)| Some((pixel(here, *i)?, pixel(other, *j)?))).collect();
        (other, pixels)
    };
    let mut found: Vec<(&ComparedFrame, Pairs)> =
        others.iter().map(pairs_with).filter(|(_, p)| !p.is_empty()).collect();
    found.sort_by_key(|(other, pairs)| (std::cmp::Reverse(pairs.len()), other.samples.frame));
    found.truncate(MAX_OTHERS);
    found
}

impl Methods<'_> {
    /// A frame after a tile's methods.
    fn apply(&self, compared: &ComparedFrame, tile: &Tile) -> LinearImage {
        let mut image = compared.raw.clone();
        if tile.methods == [Method::Full] {
            let corrected = |frame: &BenchFrame<'_>| {
                downscale(&self.bench.corrected(frame, Method::Full, &self.exposure), SIDE)
            };
            // The frame has been decoded before, so it can be decoded again.
            return self.bench.with_frame(&compared.message, corrected).unwrap_or(image);
        }
        let altitude_m = compared.altitude_m;
        tile.methods
            .iter()
            .for_each(|method| apply_baseline(*method, &mut image, &self.means, altitude_m));
        image
    }

    fn draw(&self, here: &ComparedFrame, others: &[(&ComparedFrame, Pairs)]) -> Canvas {
        let height = (here.raw.height * TILE_WIDTH).div_ceil(here.raw.width.max(1));
        let pitch = (TILE_WIDTH as i64 + GAP, CAPTION + height as i64 + scatter::HEIGHT + GAP);
        let rows = TILES.len().div_ceil(COLUMNS) as i64;
        let mut canvas = Canvas::new(
            (GAP + COLUMNS as i64 * pitch.0) as usize,
            (HEAD + rows * pitch.1 + GAP) as usize,
            PAPER,
        );
        let width = canvas.width - 2 * GAP as usize;
        let (title, subtitle) = self.header(here, others);
        canvas.text((GAP, GAP), 3, INK, &Canvas::truncated(&title, 3, width));
        canvas.text((GAP, GAP + 36), 2, SOFT, &Canvas::truncated(&subtitle, 2, width));
        let usable = scatter::usable(
            &here.raw,
            others.iter().map(|(l, _)| &l.raw),
            self.bench.session.config.estimate.dark_below as f32,
            self.bench.session.config.estimate.clipped_above as f32,
        );
        for (i, tile) in TILES.iter().enumerate() {
            let corner =
                (GAP + (i % COLUMNS) as i64 * pitch.0, HEAD + (i / COLUMNS) as i64 * pitch.1);
            let image = self.apply(here, tile);
            let is_raw = tile.methods.is_empty();
            let factor = if is_raw { exposure(std::iter::once(&image)) } else { 1.0 };
            let description = if is_raw {
                format!("{}, x {factor:.1}", tile.description)
            } else {
                tile.description.into()
            };
            canvas.text(corner, 2, INK, &Canvas::truncated(tile.name, 2, TILE_WIDTH));
            canvas.text(
                (corner.0, corner.1 + 24),
                2,
                SOFT,
                &Canvas::truncated(&description, 2, TILE_WIDTH),
            );
            let scaled = scaled(&image, TILE_WIDTH);
            canvas.put(
                (corner.0, corner.1 + CAPTION),
                &to_srgb(&scaled, factor),
                scaled.width,
                scaled.bands,
            );
            let agreement = Agreement::of(
                &image,
                here.raw.width as f64 / here.width as f64,
                &usable,
                others,
                |other| self.apply(other, tile),
            );
            agreement.draw(
                &mut canvas,
                (corner.0, corner.1 + CAPTION + height as i64 + 8),
                TILE_WIDTH as i64,
            );
        }
        canvas
    }

    fn header(&self, here: &ComparedFrame, others: &[(&ComparedFrame, Pairs)]) -> (String, String) {
        let path = self.bench.session.recording.path();
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let nanos = u64::try_from(here.at.stamp.0).unwrap_or_default();
        let time = humantime::format_rfc3339_millis(
            std::time::UNIX_EPOCH + std::time::Duration::from_nanos(nanos),
        );
        let title = format!("{name}, frame {}", here.samples.frame);
        let points: usize = others.iter().map(|(_, p)| p.len()).sum();
        let overlap = match others.len() {
            0 => "no keypoint matches with other frames".into(),
            n => format!("{points} points in {n} other frames"),
        };
        let file = &self.bench.model.file;
        let alpha: Vec<String> = file.attenuation_per_m.iter().map(|a| format!("{a:.3}")).collect();
        let alpha = match (file.has_attenuation(), file.identified) {
            (false, _) => file.attenuation_text(),
            (_, true) => format!("{} per metre", alpha.join(" / ")),
            (_, false) => format!("{} per metre, not identified", alpha.join(" / ")),
        };
        let altitude_m = here.altitude_m;
        (
            title,
            format!("{time}, {altitude_m:.2} m above the seafloor; {overlap}; attenuation {alpha}"),
        )
    }
}
