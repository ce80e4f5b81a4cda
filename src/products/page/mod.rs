//! `unwater report`: one page about a corrected log, made from the log alone. It contains its
//! style, script and images, needs no network, and is readable in light mode, dark mode and print.
//!
//! Text comes from the records in the log; images are corrected again by the same code. A figure
//! that cannot be made is replaced by the reason.

mod before_after;
mod camera;
mod facts;
mod figures;
mod overview;
mod stages;
mod track;

use std::collections::BTreeSet;

use super::display::downscale;
use super::dive::{CameraLog, CorrectedLog, Images};
use super::places::Places;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::plot::escape_markup;
use crate::recording::FrameId;
use crate::run::bench::Bench;
use crate::session::Options;

/// Frames whose channel means are taken (Fig. 6); more make the figure no clearer.
const MEANS_OF_FRAMES: usize = 120;
/// Frames that are shown before and after.
const SHOWN_FRAMES: usize = 5;
/// Longest side of a shown image (px).
const SHOWN_SIDE: usize = 880;

/// A figure, or why there is none.
pub(super) struct Figure {
    id: &'static str,
    title: String,
    /// HTML
    body: std::result::Result<String, String>,
    /// HTML
    caption: String,
}

impl Figure {
    fn of(
        id: &'static str,
        title: &str,
        body: std::result::Result<String, String>,
        caption: &str,
    ) -> Self {
        Self { id, title: title.into(), body, caption: caption.into() }
    }

    fn html(&self, place: &str) -> String {
        let id = format!("{place}{}", self.id);
        match &self.body {
            Ok(body) => format!(
                "<figure id=\"{id}\" data-figure=\"{}\"><h3>{}</h3>{body}<output class=\"read\" \
                 aria-live=\"polite\"></output><figcaption>{}</figcaption></figure>\n",
                self.id,
                escape_markup(&self.title),
                self.caption
            ),
            Err(why) => format!(
                "<section id=\"{id}\" data-figure=\"{}\" class=\"missing\"><h3>{}</h3><p>Not \
                 shown: {}.</p></section>\n",
                self.id,
                escape_markup(&self.title),
                escape_markup(why)
            ),
        }
    }
}

/// Images and numbers of a frame that several figures use.
pub(super) struct Seen {
    /// index of its record
    record: usize,
    altitude_m: f64,
    /// mean light per band of the raw image
    mean_light: [f64; 3],
    bands: usize,
    /// the raw image, downscaled; of the frames that are shown
    raw: Option<LinearImage>,
    /// Fig. 10, of one frame
    stages: Option<std::result::Result<String, String>>,
}

/// The page of a corrected log, as HTML.
///
/// # Errors
/// The log cannot be read. What is missing in it is named on the page.
pub fn page(log: &CorrectedLog, options: &Options) -> Result<String> {
    let places = Places::read(&log.scanned.recording, options.window())?;
    let mut body = String::new();
    for (number, camera) in log.cameras.iter().enumerate() {
        body += &of_camera(log, camera, number, &places, options)?;
    }
    let title = log.cameras.first().map_or("", |c| c.fact("source"));
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta \
         name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta \
         name=\"color-scheme\" content=\"light dark\">\n<meta \
         http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; \
         style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n<link rel=\"icon\" \
         href=\"data:,\">\n<title>{} · \
         unwater</title>\n<style>\n{}</style>\n</head>\n<body>\n<main>\n{body}</main>\n<script>\n\
         {}</script>\n</body>\n</html>\n",
        escape_markup(title),
        include_str!("style.css"),
        include_str!("script.js"),
    ))
}

fn of_camera(
    log: &CorrectedLog,
    camera: &CameraLog,
    number: usize,
    places: &Places,
    options: &Options,
) -> Result<String> {
    // The first camera's figures have plain names.
    let place = if number == 0 { String::new() } else { format!("c{number}-") };
    let bench = log.bench(camera, Images::Raw, options).map_err(|e| why_no_bench(camera, &e));
    let shown = shown_frames(
        camera,
        if log.cameras.len() > 1 { SHOWN_FRAMES.div_ceil(2) } else { SHOWN_FRAMES },
    );
    let wanted = wanted_frames(camera, &shown);
    let sheet = overview::sheet(&wanted);
    let mut raw = overview::Small::default();
    let (seen, bench) = match bench {
        Ok(bench) => match read_frames(&bench, log, camera, (&wanted, &shown, &sheet), &mut raw) {
            Ok(seen) => (seen, Ok(bench)),
            Err(e) => (Vec::new(), Err(e.to_string())),
        },
        Err(why) => (Vec::new(), Err(why)),
    };
    let no_raw = bench
        .as_ref()
        .err()
        .cloned()
        .unwrap_or_else(|| "no raw image of a corrected frame is in this log".into());
    let staged = seen.iter().find_map(|s| s.stages.clone()).unwrap_or_else(|| Err(no_raw.clone()));
    // The trajectory does not need raw images: corrected ones do as well.
    let bench =
        bench.or_else(|_| log.bench(camera, Images::Corrected, options).map_err(|e| e.to_string()));
    let frames = before_after::Frames { camera, shown: &shown, seen: &seen };
    let mut figures = vec![before_after::figure(log, &frames, &no_raw, &place)?];
    let small = |record, image: &LinearImage, sums: &mut overview::Small| {
        sums.add(record, downscale(image, overview::SIDE), &sheet);
    };
    let mut corrected = overview::Small::default();
    before_after::each_corrected(log, camera, &wanted, |record, image| {
        small(record, image, &mut corrected);
    })?;
    figures.extend(overview::figures(&raw, &corrected, &no_raw));
    figures.push(figures::channel_means(camera, &seen, &no_raw, &place));
    figures.push(figures::pairs_by_image(camera, &place));
    figures.push(figures::beam_pattern(camera, &place));
    figures.push(stages::figure(staged));
    figures.extend(track::figures(camera, bench.as_ref(), places, &place));
    figures.extend(figures::attenuation_over_time(camera, &place));
    figures.extend(camera::figures(camera, &place));
    let figures: String = figures.iter().map(|f| f.html(&place)).collect();
    Ok(facts::section(log, camera, number, &place)
        + "<h2>Figures</h2>\n"
        + &figures
        + &facts::settings(log, camera, number))
}

fn why_no_bench(camera: &CameraLog, error: &Error) -> String {
    match error {
        Error::NoSuchTopic { topic, .. } if topic == camera.fact("camera_topic") => format!(
            "the raw images ({topic}) are not in this log, which was written with --drop-raw or \
             --only"
        ),
        other => other.to_string(),
    }
}

/// Records of corrected frames from the lowest to the highest, evenly by rank.
fn shown_frames(camera: &CameraLog, max: usize) -> BTreeSet<usize> {
    let mut by_altitude: Vec<_> = camera.corrected().collect();
    by_altitude.sort_by(|(_, a), (_, b)| a.altitude_m.total_cmp(&b.altitude_m));
    let last = by_altitude.len().saturating_sub(1);
    (0..max)
        .filter_map(|k| by_altitude.get(k * last / (max - 1).max(1)))
        .map(|(record, _)| *record)
        .collect()
}

/// Records of the frames that the figures need.
fn wanted_frames(camera: &CameraLog, shown: &BTreeSet<usize>) -> BTreeSet<usize> {
    let corrected: Vec<usize> = camera.corrected().map(|(record, _)| record).collect();
    let step = corrected.len().div_ceil(MEANS_OF_FRAMES).max(1);
    corrected.into_iter().step_by(step).chain(shown.iter().copied()).collect()
}

/// Decodes what the figures need, each frame once: `wanted` ones, of which some are shown, and some
/// are on the contact sheet.
fn read_frames(
    bench: &Bench,
    log: &CorrectedLog,
    camera: &CameraLog,
    (wanted, shown, sheet): (&BTreeSet<usize>, &BTreeSet<usize>, &BTreeSet<usize>),
    small: &mut overview::Small,
) -> Result<Vec<Seen>> {
    let mut records = log.records(camera, Images::Raw);
    records.retain(|_, record| wanted.contains(record));
    let chosen: BTreeSet<FrameId> = records.keys().copied().collect();
    // The stages are those of the frame in the middle of what is shown.
    let staged = shown.iter().nth(shown.len() / 2).copied();
    let mut seen = Vec::new();
    bench.each(
        &chosen,
        |frame| {
            let record = records.get(&frame.frame.at.id).copied()?;
            let image = frame.image.clone().into_demosaiced();
            let seen = Seen {
                record,
                altitude_m: camera.frames.get(record).map_or(f64::NAN, |f| f.altitude_m),
                mean_light: bench.samples(frame, false).mean_light,
                bands: frame.image.bands(),
                raw: shown.contains(&record).then(|| downscale(&image, SHOWN_SIDE)),
                stages: (staged == Some(record)).then(|| stages::stages(bench, frame)),
            };
            Some((seen, downscale(&image, overview::SIDE)))
        },
        |frame| {
            if let Some((of_frame, image)) = frame {
                small.add(of_frame.record, image, sheet);
                seen.push(of_frame);
            }
        },
    )?;
    Ok(seen)
}
