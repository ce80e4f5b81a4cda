//! `unwater compare`: the paper's Fig. 4 for one frame, every method side by side, ours last.
//!
//! Under each picture stands what no eye can judge: points of seafloor that other frames see too,
//! their light in this frame against that in the others, after the same method. On the line they
//! would agree.

mod scatter;

use std::collections::BTreeSet;
use std::path::Path;

use super::pictures::{codes, downscale, exposure, scaled};
use crate::config::Method;
use crate::correct::{MeanFrames, apply_baseline};
use crate::error::{Error, Result};
use crate::estimate::{FrameSamples, Matchable, matches};
use crate::image::LinearImage;
use crate::model::{ModelFile, RenderingFile, ScatterTable};
use crate::plot::Canvas;
use crate::run::bench::{Bench, BenchFrame};
use crate::run::{self};
use crate::session::{self, Options, Progress};
use crate::units::Stamp;
use scatter::{Agreement, Pairs};

/// Which frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// by its number, the first is 0
    Number(usize),
    /// the nearest to a log time [ns]
    At(u64),
}

/// Longest side that methods work at [px].
const SIDE: usize = 1000;
/// Frames that mean frames are made of, at most.
const MEANS_OF_FRAMES: usize = 100;
/// Other frames that points are compared with, at most.
const OTHERS: usize = 4;
/// Width of a tile's picture, and room around tiles [px].
const TILE_WIDTH: usize = 440;
const GAP: i64 = 20;
const COLUMNS: usize = 4;
/// Height of the words over a picture, and of the head of the sheet [px].
const WORDS: i64 = 50;
const HEAD: i64 = 100;

const PAPER: [u8; 3] = [250, 250, 248];
const INK: [u8; 3] = [28, 33, 38];
const SOFT: [u8; 3] = [100, 110, 118];

/// What a tile shows: its name, where it comes from, and the methods one after the other; none is
/// raw.
struct Tile {
    name: &'static str,
    source: &'static str,
    methods: &'static [Method],
}

const TILES: [Tile; 12] = [
    Tile { name: "raw", source: "brightness by one factor", methods: &[] },
    Tile { name: "grey world", source: "the frame's mean is grey", methods: &[Method::GreyWorld] },
    Tile {
        name: "white patch",
        source: "the frame's brightest is white",
        methods: &[Method::WhitePatch],
    },
    Tile {
        name: "adaptive histogram",
        source: "contrast-limited, per frame",
        methods: &[Method::Ahe],
    },
    Tile {
        name: "homomorphic, low-pass",
        source: "Eq. 12, per frame",
        methods: &[Method::Homomorphic],
    },
    Tile {
        name: "homomorphic, surface",
        source: "Eq. 12, polynomial per frame",
        methods: &[Method::HomomorphicSurface],
    },
    Tile {
        name: "adaptive hist. + grey world",
        source: "one after the other",
        methods: &[Method::Ahe, Method::GreyWorld],
    },
    Tile {
        name: "low-pass + grey world",
        source: "one after the other",
        methods: &[Method::Homomorphic, Method::GreyWorld],
    },
    Tile {
        name: "surface + grey world",
        source: "one after the other",
        methods: &[Method::HomomorphicSurface, Method::GreyWorld],
    },
    Tile {
        name: "frame average",
        source: "Eq. 14, mean of the log",
        methods: &[Method::FrameAverage],
    },
    Tile {
        name: "range average",
        source: "mean of frames at this height",
        methods: &[Method::RangeAverage],
    },
    Tile { name: "unwater", source: "Eq. 15, full correction", methods: &[Method::Full] },
];

/// A frame, small, with its samples.
struct Looked {
    frame: BenchFrame,
    samples: FrameSamples,
    raw: LinearImage,
}

/// All that methods are applied with.
struct Methods<'m> {
    bench: &'m Bench,
    means: MeanFrames,
    rendering: RenderingFile,
    glow: Option<ScatterTable>,
}

/// The sheet of one frame, as a PNG. Without a model one is estimated first.
///
/// # Errors
/// The log cannot be used, or the frame is not there, or cannot be decoded, or has no floor.
pub fn sheet(
    input: &Path,
    model: Option<ModelFile>,
    which: Which,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Vec<u8>> {
    let mut options = options.clone();
    options.config.render.method = Method::Full;
    let file = match model {
        Some(file) => file,
        None => run::estimate_logs(&[input], &options, progress)?.0,
    };
    let bench = Bench::new(
        session::prepare(input, &options)?,
        file,
        options.config.clone(),
        options.threads,
    )?;
    let frames = &bench.log.survey.frames;
    let index = match which {
        Which::Number(number) if number < frames.len() => number,
        Which::Number(number) => {
            return Err(Error::Usage(format!(
                "there is no frame {number}: the camera has {} of them, the first is 0",
                frames.len()
            )));
        }
        Which::At(time) => {
            let distance = |s: Stamp| s.0.abs_diff(i64::try_from(time).unwrap_or(i64::MAX));
            let nearest =
                frames.iter().enumerate().min_by_key(|(_, f)| distance(f.logged)).map(|(i, _)| i);
            nearest.ok_or_else(|| Error::Usage("the camera has no pictures".into()))?
        }
    };
    let reach = bench.config.matching.neighbours;
    let near: BTreeSet<usize> = (index.saturating_sub(reach)..=index + reach).collect();
    let mut looked: Vec<Looked> = Vec::new();
    let small = |frame: &BenchFrame| downscale(&frame.image.clone().into_demosaiced(), SIDE);
    bench.each(
        &near,
        |frame| Looked { samples: bench.samples(&frame, true), raw: small(&frame), frame },
        |l| looked.push(l),
    )?;
    let Some(own) = looked.iter().position(|l| l.frame.index == index) else {
        let why = "cannot be decoded, or has no floor below it; `unwater inspect` says more, and \
                   another frame may do";
        return Err(Error::Image(format!("frame {index} of {} {why}", input.display())));
    };
    let here = looked.remove(own);
    let pairs = overlapping(&bench, &here, &looked);

    let mut means = MeanFrames::default();
    let step = frames.len().div_ceil(MEANS_OF_FRAMES).max(1);
    let spread: BTreeSet<usize> = (0..frames.len()).step_by(step).chain([index]).collect();
    bench.each(
        &spread,
        |frame| (small(&frame), bench.view(&frame).camera_altitude_m()),
        |(image, altitude_m)| {
            means.add(Method::FrameAverage, &image, altitude_m);
            means.add(Method::RangeAverage, &image, altitude_m);
        },
    )?;
    let rendering = match bench.file.rendering.method {
        Method::Full => bench.file.rendering.clone(),
        _ => bench.rendering(
            &bench.lit(&here.frame),
            Method::Full,
            bench.config.render.white_balance,
        ),
    };
    let methods = Methods { bench: &bench, means, rendering, glow: bench.glow(Method::Full) };
    methods
        .laid_out(&here, &pairs)
        .png()
        .map_err(|reason| Error::WriteRecord { path: input.into(), reason })
}

/// The frames that see most points of this one, with those points' pixels in both.
fn overlapping<'l>(bench: &Bench, here: &Looked, others: &'l [Looked]) -> Vec<(&'l Looked, Pairs)> {
    let matching = &bench.config.matching;
    let camera = &bench.log.survey.rig.camera;
    let reduction =
        camera.width.max(camera.height).div_ceil(matching.detection_side_px).max(1) as f64;
    let inlier = matching.inlier_px * reduction / camera.fx;
    let of =
        |l: &'l Looked| Matchable { keypoints: &l.samples.keypoints, places: &l.samples.places };
    let own = Matchable { keypoints: &here.samples.keypoints, places: &here.samples.places };
    let pairs_with = |other: &'l Looked| {
        let seed = (here.frame.index as u64) << 32 | other.frame.index as u64;
        let found = matches(&own, &of(other), matching, inlier, seed);
        let place = |l: &Looked, k: u32| l.samples.keypoints.get(k as usize).map(|k| (k.u, k.v));
        let places: Pairs =
            found.iter().filter_map(|(i, j)| Some((place(here, *i)?, place(other, *j)?))).collect();
        (other, places)
    };
    let mut found: Vec<(&Looked, Pairs)> =
        others.iter().map(pairs_with).filter(|(_, p)| !p.is_empty()).collect();
    found.sort_by_key(|(other, pairs)| (std::cmp::Reverse(pairs.len()), other.frame.index));
    found.truncate(OTHERS);
    found
}

impl Methods<'_> {
    /// A frame by a tile's methods.
    fn shown(&self, looked: &Looked, tile: &Tile) -> LinearImage {
        if tile.methods == [Method::Full] {
            return downscale(
                &self.bench.corrected(
                    &looked.frame,
                    Method::Full,
                    &self.rendering,
                    self.glow.as_ref(),
                ),
                SIDE,
            );
        }
        let altitude_m = self.bench.view(&looked.frame).camera_altitude_m();
        let mut image = looked.raw.clone();
        tile.methods
            .iter()
            .for_each(|method| apply_baseline(*method, &mut image, &self.means, altitude_m));
        image
    }

    fn laid_out(&self, here: &Looked, others: &[(&Looked, Pairs)]) -> Canvas {
        let height = (here.raw.height * TILE_WIDTH).div_ceil(here.raw.width.max(1));
        let pitch = (TILE_WIDTH as i64 + GAP, WORDS + height as i64 + scatter::HEIGHT + GAP);
        let rows = TILES.len().div_ceil(COLUMNS) as i64;
        let mut canvas = Canvas::new(
            (GAP + COLUMNS as i64 * pitch.0) as usize,
            (HEAD + rows * pitch.1 + GAP) as usize,
            PAPER,
        );
        let width = canvas.width - 2 * GAP as usize;
        let (title, facts) = self.words(here, others);
        canvas.text((GAP, GAP), 3, INK, &Canvas::truncated(&title, 3, width));
        canvas.text((GAP, GAP + 36), 2, SOFT, &Canvas::truncated(&facts, 2, width));
        let usable = scatter::usable(
            &here.raw,
            others.iter().map(|(l, _)| &l.raw),
            self.bench.config.estimate.dark_below as f32,
            self.bench.config.estimate.clipped_above as f32,
        );
        for (i, tile) in TILES.iter().enumerate() {
            let corner =
                (GAP + (i % COLUMNS) as i64 * pitch.0, HEAD + (i / COLUMNS) as i64 * pitch.1);
            let image = self.shown(here, tile);
            let is_raw = tile.methods.is_empty();
            let factor = if is_raw { exposure(std::iter::once(&image)) } else { 1.0 };
            let source =
                if is_raw { format!("{}, x {factor:.1}", tile.source) } else { tile.source.into() };
            canvas.text(corner, 2, INK, &Canvas::truncated(tile.name, 2, TILE_WIDTH));
            canvas.text(
                (corner.0, corner.1 + 24),
                2,
                SOFT,
                &Canvas::truncated(&source, 2, TILE_WIDTH),
            );
            let picture = scaled(&image, TILE_WIDTH);
            canvas.put(
                (corner.0, corner.1 + WORDS),
                &codes(&picture, factor),
                picture.width,
                picture.bands,
            );
            let agreement = Agreement::of(
                &image,
                here.raw.width as f64 / here.frame.camera.width as f64,
                &usable,
                others,
                |other| self.shown(other, tile),
            );
            agreement.draw(
                &mut canvas,
                (corner.0, corner.1 + WORDS + height as i64 + 8),
                TILE_WIDTH as i64,
            );
        }
        canvas
    }

    fn words(&self, here: &Looked, others: &[(&Looked, Pairs)]) -> (String, String) {
        let path = self.bench.log.recording.path();
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let nanos = u64::try_from(here.frame.stamp.0).unwrap_or_default();
        let time = humantime::format_rfc3339_millis(
            std::time::UNIX_EPOCH + std::time::Duration::from_nanos(nanos),
        );
        let title = format!("{name}, frame {}", here.frame.index);
        let points: usize = others.iter().map(|(_, p)| p.len()).sum();
        let overlap = match others.len() {
            0 => "no other frame sees its points".into(),
            n => format!("{points} points in {n} other frames"),
        };
        let alpha: Vec<String> =
            self.bench.file.attenuation_per_m.iter().map(|a| format!("{a:.3}")).collect();
        let sure = if self.bench.file.identified { "" } else { ", not identified" };
        let altitude_m = self.bench.view(&here.frame).camera_altitude_m();
        (
            title,
            format!(
                "{time}, {altitude_m:.2} m above the floor; {overlap}; attenuation {} per \
                 metre{sure}",
                alpha.join(" / ")
            ),
        )
    }
}
