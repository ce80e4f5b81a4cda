//! The mosaic as a poster: raw and corrected side by side with a scale bar, each with its radiance
//! profile across the track, which blending would hide (paper, Fig. 11).

use super::grid::{Grid, Strip};
use crate::diagnostics::Diagnostic;
use crate::plot::{Canvas, ticks};
use crate::products::display::{
    BANDS, EMPTY, INK, PAPER, SOFT, exposure, srgb_of_rendered, to_srgb,
};

const MARGIN: i64 = 28;
const GAP: i64 = 40;
const HEAD: i64 = 118;
/// Height of a profile, and of everything below a strip (px).
const PROFILE: i64 = 190;
const FOOT: i64 = PROFILE + 154;
/// Minimum width of a strip's column, for the text (px).
const MIN_WIDTH: i64 = 430;
/// Half width of the moving average of profiles (share of the width).
const SMOOTH: f64 = 0.01;
/// Columns with fewer covered pixels than this share of the fullest column have no mean.
const MIN_COVERED_SHARE: f64 = 0.05;

/// Contents of a poster.
pub struct Poster<'m> {
    pub source: &'m str,
    pub diagnostics: &'m [Diagnostic],
    pub grid: &'m Grid,
    /// number of frames
    pub frames: usize,
    pub raw: Option<&'m Strip>,
    pub corrected: &'m Strip,
}

impl Poster<'_> {
    pub fn draw(&self) -> Canvas {
        let grid = self.grid;
        let mut strips: Vec<(String, &Strip, Vec<u8>)> = Vec::new();
        if let Some(raw) = self.raw {
            let factor = exposure(std::iter::once(&raw.image));
            strips.push((
                format!("raw, brightened x {factor:.1}"),
                raw,
                to_srgb(&raw.image, factor),
            ));
        }
        strips.push(("corrected".into(), self.corrected, srgb_of_rendered(&self.corrected.image)));
        let column = (grid.width as i64).max(MIN_WIDTH);
        let count = strips.len() as i64;
        let width = 2 * MARGIN + count * column + (count - 1) * GAP;
        let lines: Vec<String> = std::iter::once(self.title())
            .chain(self.diagnostics.iter().map(ToString::to_string))
            .flat_map(|w| Canvas::wrapped(&w, 2, (width - 2 * MARGIN) as usize))
            .collect();
        let head = HEAD.max(MARGIN + 40 + 22 * lines.len() as i64 + 46);
        let mut canvas =
            Canvas::new(width as usize, (head + grid.height as i64 + FOOT) as usize, PAPER);
        canvas.text(
            (MARGIN, MARGIN),
            3,
            INK,
            &Canvas::truncated(self.source, 3, (width - 2 * MARGIN) as usize),
        );
        for (i, line) in lines.iter().enumerate() {
            canvas.text((MARGIN, MARGIN + 36 + 22 * i as i64), 2, SOFT, line);
        }
        for (i, (name, strip, pixels)) in strips.iter().enumerate() {
            let left = MARGIN + i as i64 * (column + GAP) + (column - grid.width as i64) / 2;
            canvas.text((left, head - 28), 2, INK, name);
            let bands = strip.image.bands;
            for (at, pixel) in pixels.chunks_exact(bands).enumerate() {
                let color = if strip.frame_numbers[at] == 0 {
                    EMPTY
                } else {
                    std::array::from_fn(|b| pixel[b.min(bands - 1)])
                };
                canvas.set(left + (at % grid.width) as i64, head + (at / grid.width) as i64, color);
            }
            draw_profile(&mut canvas, grid, strip, (left, head + grid.height as i64 + 22));
        }
        scale_bar(&mut canvas, grid.m_per_px, (MARGIN, head + grid.height as i64 + FOOT - 30));
        canvas
    }

    fn title(&self) -> String {
        let size = (
            self.grid.width as f64 * self.grid.m_per_px,
            self.grid.height as f64 * self.grid.m_per_px,
        );
        format!(
            "{} frames over {:.1} x {:.1} m, {:.1} mm per pixel, unblended: a later frame covers \
         an earlier one",
            self.frames,
            size.0,
            size.1,
            1000.0 * self.grid.m_per_px
        )
    }
}

/// Mean light per column, relative to the mean of the strip, per band; NaN for columns with too few
/// pixels.
pub fn column_means(strip: &Strip) -> Vec<Vec<f64>> {
    let (width, height, bands) = (strip.image.width, strip.image.height, strip.image.bands);
    let counts: Vec<usize> = (0..width)
        .map(|x| (0..height).filter(|y| strip.frame_numbers[y * width + x] > 0).count())
        .collect();
    let max = counts.iter().copied().max().unwrap_or(0);
    let is_known = |x: usize| counts[x] as f64 >= (MIN_COVERED_SHARE * max as f64).max(1.0);
    let of_band = |b: usize| {
        // Uncovered pixels are black and add nothing.
        let sums: Vec<f64> = (0..width)
            .map(|x| {
                (0..height)
                    .map(|y| f64::from(strip.image.pixels[(y * width + x) * bands + b]))
                    .sum()
            })
            .collect();
        let mean = sums.iter().sum::<f64>() / counts.iter().sum::<usize>().max(1) as f64;
        let reach = ((width as f64 * SMOOTH) as usize).max(1);
        let smooth = |x: usize| {
            let around = x.saturating_sub(reach)..(x + reach + 1).min(width);
            let (sum, count) = around.fold((0.0, 0), |(s, c), k| (s + sums[k], c + counts[k]));
            if is_known(x) { sum / count.max(1) as f64 / mean.max(1e-12) } else { f64::NAN }
        };
        (0..width).map(smooth).collect()
    };
    (0..bands).map(of_band).collect()
}

/// Root mean square deviation of the profiles from 1, over all bands (%).
pub fn unevenness(profiles: &[Vec<f64>]) -> f64 {
    let all: Vec<f64> = profiles.iter().flatten().copied().filter(|v| v.is_finite()).collect();
    100.0 * (all.iter().map(|v| (v - 1.0).powi(2)).sum::<f64>() / all.len().max(1) as f64).sqrt()
}

fn draw_profile(canvas: &mut Canvas, grid: &Grid, strip: &Strip, (left, top): (i64, i64)) {
    let width = grid.width as i64;
    let profiles = column_means(strip);
    canvas.fill((left, top), (width, PROFILE), [255; 3]);
    let (from, to) = (0.0, 2.0);
    let row = |v: f64| top + PROFILE - ((v - from) / (to - from) * PROFILE as f64) as i64;
    for (value, label) in ticks(from, to, 4) {
        canvas.fill((left, row(value)), (width, 1), if value == 1.0 { SOFT } else { EMPTY });
        canvas.text(
            (left - 8 - Canvas::text_width(&label, 1) as i64, row(value) - 4),
            1,
            INK,
            &label,
        );
    }
    let metres = grid.width as f64 * grid.m_per_px;
    for (value, label) in ticks(0.0, metres, ((width / 130) as usize).max(2)) {
        let x = left + (value / grid.m_per_px) as i64;
        canvas.fill((x, top + PROFILE), (1, 6), SOFT);
        canvas.text(
            (x - Canvas::text_width(&label, 2) as i64 / 2, top + PROFILE + 10),
            2,
            INK,
            &label,
        );
    }
    for (b, values) in profiles.iter().enumerate() {
        let color = if profiles.len() == 1 { INK } else { BANDS[b] };
        for (x, pair) in
            values.windows(2).enumerate().filter(|(_, p)| p.iter().all(|v| v.is_finite()))
        {
            let at =
                |k: usize, v: f64| ((left + (x + k) as i64) as f64, row(v.clamp(from, to)) as f64);
            canvas.line(at(0, pair[0]), at(1, pair[1]), color);
            let ((x0, y0), (x1, y1)) = (at(0, pair[0]), at(1, pair[1]));
            canvas.line((x0, y0 + 1.0), (x1, y1 + 1.0), color);
        }
    }
    canvas.text(
        (left, top + PROFILE + 36),
        2,
        SOFT,
        "across the track [m]; vertical: light relative to its mean",
    );
    canvas.text(
        (left, top + PROFILE + 58),
        2,
        INK,
        &format!("deviation {:.1} % (rms)", unevenness(&profiles)),
    );
}

/// A scale bar of round length.
fn scale_bar(canvas: &mut Canvas, m_per_px: f64, (x, y): (i64, i64)) {
    let length = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0]
        .into_iter()
        .rfind(|l| l / m_per_px < 320.0)
        .unwrap_or(0.1);
    let pixels = (length / m_per_px) as i64;
    canvas.fill((x, y), (pixels, 5), INK);
    canvas.text((x + pixels + 10, y - 6), 2, INK, &format!("{length} m"));
}
