//! The dive at a glance: a contact sheet, raw frames above corrected ones, and the mean frame,
//! which is even if light and water are removed.

use std::collections::{BTreeMap, BTreeSet};

use super::super::display::{exposure, jpeg_uri, srgb_of_rendered, to_srgb};
use super::figure::Figure;
use crate::image::LinearImage;
use crate::plot::escape_markup;
use crate::stats;

/// Frames on the contact sheet.
const FRAMES: usize = 12;
/// Longest side of its images, and of the mean frames (px).
pub const SIDE: usize = 320;
/// Quality of its JPEGs.
const QUALITY: u8 = 80;
/// Cells of a mean frame along an axis, over which evenness is measured.
const CELLS: usize = 16;

/// Small images of one kind: a few of them, and the mean of all.
#[derive(Default)]
pub struct Small {
    by_record: BTreeMap<usize, LinearImage>,
    sum: Option<LinearImage>,
    count: usize,
}

impl Small {
    /// Adds a frame's image; it is kept if it belongs on the sheet.
    pub fn add(&mut self, record: usize, image: LinearImage, sheet: &BTreeSet<usize>) {
        match &mut self.sum {
            None => self.sum = Some(image.clone()),
            Some(sum) if sum.shape() == image.shape() => {
                sum.pixels.iter_mut().zip(&image.pixels).for_each(|(sum, v)| *sum += v);
            }
            Some(_) => return,
        }
        self.count += 1;
        if sheet.contains(&record) {
            self.by_record.insert(record, image);
        }
    }

    fn mean(&self) -> Option<LinearImage> {
        let mut mean = self.sum.clone()?;
        mean.pixels.iter_mut().for_each(|v| *v /= self.count as f32);
        Some(mean)
    }
}

/// The records on the sheet: evenly spread over those that are read.
pub fn sheet(records: &BTreeSet<usize>) -> BTreeSet<usize> {
    let last = records.len().saturating_sub(1);
    let nth = |k: usize| records.iter().nth(k * last / (FRAMES - 1)).copied();
    (0..FRAMES).filter_map(nth).collect()
}

/// Both figures.
pub fn figures(raw: &Small, corrected: &Small, no_raw: &str) -> [Figure; 2] {
    [contact_sheet(raw, corrected, no_raw), mean_frames(raw, corrected, no_raw)]
}

fn image_html(uri: &str, text: &str) -> String {
    format!("<img alt=\"{text}\" src=\"{uri}\">")
}

fn raw_uri(image: &LinearImage, factor: f32) -> Option<String> {
    jpeg_uri(&to_srgb(image, factor), image.shape(), QUALITY).ok()
}

fn corrected_uri(image: &LinearImage) -> Option<String> {
    jpeg_uri(&srgb_of_rendered(image), image.shape(), QUALITY).ok()
}

fn contact_sheet(raw: &Small, corrected: &Small, no_raw: &str) -> Figure {
    let factor = exposure(raw.by_record.values());
    let pair = |(record, after): (&usize, &LinearImage)| {
        let before = raw.by_record.get(record).and_then(|image| raw_uri(image, factor));
        let before = before.map_or_else(String::new, |uri| image_html(&uri, "as recorded"));
        Some(format!("<div>{before}{}</div>", image_html(&corrected_uri(after)?, "corrected")))
    };
    let pairs: Vec<String> = corrected.by_record.iter().filter_map(pair).collect();
    let body = if pairs.is_empty() {
        Err("no corrected image of this camera can be decoded".to_string())
    } else {
        Ok(format!("<div class=\"contact\">{}</div>", pairs.concat()))
    };
    let caption = if raw.by_record.is_empty() {
        format!("Corrected frames alone: {}.", escape_markup(no_raw))
    } else {
        format!(
            "Frames along the dive, as recorded above, corrected below. Raw frames are brightened \
             by one factor, {factor:.1}."
        )
    };
    Figure::of("contact-sheet", "Contact sheet", body, &caption)
}

fn mean_frames(raw: &Small, corrected: &Small, no_raw: &str) -> Figure {
    let before = raw.mean();
    let uri = before.as_ref().and_then(|mean| raw_uri(mean, exposure(std::iter::once(mean))));
    let before_html = uri.map_or_else(String::new, |uri| image_html(&uri, "mean raw frame"));
    let after = corrected.mean();
    let body = match after.as_ref().and_then(corrected_uri) {
        Some(uri) => {
            let after = image_html(&uri, "mean corrected frame");
            Ok(format!("<div class=\"four\">{before_html}{after}</div>"))
        }
        None => Err("no corrected image of this camera can be decoded".to_string()),
    };
    let spread = |mean: &LinearImage| match evenness(mean) {
        [low, high] if low.is_finite() && high.is_finite() => {
            format!("{:+.0} to {:+.0} %", 100.0 * low, 100.0 * high)
        }
        _ => "unknown, as it is black".into(),
    };
    let of_raw = before.as_ref().map_or_else(|| escape_markup(no_raw), spread);
    let caption = format!(
        "Mean of {} frames, as recorded and corrected: a grey field where light and water are \
         removed, but for what stays in view. Nine tenths of the area are within so much of the \
         median: raw {of_raw}, corrected {}.",
        corrected.count,
        after.as_ref().map_or_else(|| "unknown".into(), spread),
    );
    Figure::of("mean-frame", "Mean frame", body, &caption)
}

/// The 5 and 95 % quantiles of the brightness of cells, over their median, less 1.
fn evenness(mean: &LinearImage) -> [f64; 2] {
    let cell = |k: usize| {
        let (row, column) = (k / CELLS, k % CELLS);
        let span = |i: usize, size: usize| i * size / CELLS..((i + 1) * size / CELLS).min(size);
        let (mut sum, mut count) = (0.0, 0usize);
        for y in span(row, mean.height) {
            for x in span(column, mean.width) {
                sum += mean.at(x, y)[..mean.bands].iter().map(|v| f64::from(*v)).sum::<f64>();
                count += mean.bands;
            }
        }
        sum / count.max(1) as f64
    };
    let cells: Vec<f64> = (0..CELLS * CELLS).map(cell).collect();
    let middle = stats::median(&cells);
    [0.05, 0.95].map(|share| stats::quantile(&cells, share) / middle - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_opposite_ramps_is_even_and_one_of_them_is_not() {
        let ramp = |falls: bool| {
            let mut image = LinearImage::new(64, 32, 3);
            let values = image.pixels.iter_mut().enumerate();
            values.for_each(|(i, v)| {
                let along = (i / 3 % 64) as f32 / 63.0;
                *v = 0.1 + if falls { 1.0 - along } else { along };
            });
            image
        };
        let (mut small, sheet) = (Small::default(), [1].into());
        small.add(0, ramp(true), &sheet);
        assert!(evenness(&small.mean().expect("a mean"))[1] > 0.5);
        small.add(1, ramp(false), &sheet);
        // Another size has no part in the mean.
        small.add(2, LinearImage::new(8, 8, 3), &sheet);
        assert!(evenness(&small.mean().expect("a mean")).iter().all(|v| v.abs() < 1e-3));
        let mut black = Small::default();
        black.add(0, LinearImage::new(64, 32, 3), &sheet);
        let [_, figure] = figures(&black, &black, "");
        let html = figure.html("");
        assert!(html.contains("raw unknown") && !html.contains("NaN"), "{html}");
        assert_eq!(small.by_record.keys().collect::<Vec<_>>(), [&1]);
        assert_eq!(super::sheet(&(0..100).collect()).len(), FRAMES);
    }
}
