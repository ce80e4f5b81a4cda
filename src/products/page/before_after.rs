//! Before and after: a few frames, the corrected one wiped over the raw one.

use std::collections::{BTreeMap, BTreeSet};

use super::super::display::{downscale, exposure, jpeg_uri, srgb_of_rendered, to_srgb};
use super::super::dive::{CameraLog, CorrectedLog, Images};
use super::super::messages::messages_by_id;
use super::{Figure, SHOWN_SIDE, Seen};
use crate::error::Result;
use crate::image::LinearImage;
use crate::image::decode::{CameraResponse, decode};
use crate::messages::Kind;
use crate::plot::escape_markup;

/// Quality of a shown JPEG.
const QUALITY: u8 = 84;

/// The frames of the figure.
pub struct Frames<'f> {
    pub camera: &'f CameraLog,
    /// their records
    pub shown: &'f BTreeSet<usize>,
    pub seen: &'f [Seen],
}

pub fn figure(
    log: &CorrectedLog,
    frames: &Frames<'_>,
    no_raw: &str,
    place: &str,
) -> Result<Figure> {
    let Frames { camera, shown, seen } = *frames;
    let raw: BTreeMap<usize, &LinearImage> =
        seen.iter().filter_map(|s| Some((s.record, s.raw.as_ref()?))).collect();
    let brighter = exposure(raw.values().copied());
    let corrected = corrected_images(log, camera, shown)?;
    let mut frames = Vec::new();
    for index in shown {
        let (Some(record), Some(after)) = (camera.frames.get(*index), corrected.get(index)) else {
            continue;
        };
        let uri = |values: &[u8], i: &LinearImage| jpeg_uri(values, i.shape(), QUALITY);
        let Ok(after_uri) = uri(&srgb_of_rendered(after), after) else { continue };
        let before_uri = raw.get(index).and_then(|i| uri(&to_srgb(i, brighter), i).ok());
        let title =
            format!("altitude {:.2} m, {}", record.altitude_m, super::facts::time_of(record.stamp));
        frames.push(frame_html(
            &title,
            before_uri.as_deref(),
            &after_uri,
            (after.width, after.height),
        ));
    }
    let count = frames.len();
    let body = if count == 0 {
        Err("no corrected image of this camera can be decoded".to_string())
    } else {
        Ok(slider(&frames.concat(), count, place, !raw.is_empty()))
    };
    let caption = if raw.is_empty() {
        format!("Corrected frames alone: {}.", escape_markup(no_raw))
    } else {
        format!(
            "Left of the line as recorded, right of it corrected. All raw frames are brightened \
             by one factor, {brighter:.1}; corrected ones are as they are in the log."
        )
    };
    Ok(Figure::of("before-after", "Before and after", body, &caption))
}

fn frame_html(
    title: &str,
    before: Option<&str>,
    after: &str,
    (width, height): (usize, usize),
) -> String {
    let title = escape_markup(title);
    let size = format!("width=\"{width}\" height=\"{height}\"");
    let before = before.map_or_else(String::new, |uri| {
        format!("<img class=\"before\" {size} alt=\"as recorded, {title}\" src=\"{uri}\">")
    });
    format!(
        "<div class=\"frame\"><div class=\"wipe\"><img class=\"after\" {size} alt=\"corrected, \
         {title}\" src=\"{after}\">{before}<i></i></div><p class=\"which\">{title}</p></div>\n"
    )
}

fn slider(frames: &str, count: usize, place: &str, has_before: bool) -> String {
    let which = if count > 1 {
        format!(
            "<label>Frame <input type=\"range\" class=\"which-frame\" id=\"{place}which\" \
             min=\"1\" max=\"{count}\" value=\"1\" step=\"1\"></label>"
        )
    } else {
        String::new()
    };
    let wipe = if has_before {
        format!(
            "<label>Line <input type=\"range\" class=\"wipe-at\" id=\"{place}wipe\" min=\"0\" \
             max=\"100\" value=\"50\" step=\"1\" aria-label=\"line between raw, on its left, and \
             corrected, on its right, in per cent of the width\"></label>"
        )
    } else {
        String::new()
    };
    format!("<div class=\"frames\">{frames}</div><div class=\"knobs\">{wipe}{which}</div>")
}

/// Corrected images in the log, by their records.
fn corrected_images(
    log: &CorrectedLog,
    camera: &CameraLog,
    shown: &BTreeSet<usize>,
) -> Result<BTreeMap<usize, LinearImage>> {
    let mut found = BTreeMap::new();
    each_corrected(log, camera, shown, |record, image| {
        found.insert(record, downscale(image, SHOWN_SIDE));
    })?;
    Ok(found)
}

/// Calls back for the corrected images of these records.
pub fn each_corrected(
    log: &CorrectedLog,
    camera: &CameraLog,
    wanted: &BTreeSet<usize>,
    mut take: impl FnMut(usize, &LinearImage),
) -> Result<()> {
    let mut records = log.records(camera, Images::Corrected);
    records.retain(|_, record| wanted.contains(record));
    let ids = records.keys().copied().collect();
    for message in messages_by_id(&log.scanned.recording, &ids) {
        let message = message?;
        let Some(decoder) = log.scanned.index.decoders.get(&message.channel) else { continue };
        let (Ok(value), Kind::Image(read)) =
            (decoder.read(message.data()), decoder.message_type.kind)
        else {
            continue;
        };
        let image = read(&value).and_then(|image| decode(&image, CameraResponse::default()));
        if let (Ok(decoded), Some(record)) = (image, records.get(&message.id)) {
            take(*record, &decoded.image.into_demosaiced());
        }
    }
    Ok(())
}
