//! Raster canvas for images, text and lines. 8-bit RGB, origin at the upper left.

use super::font::{HEIGHT, WIDTH, dot, glyph};
use crate::image::{ImageShape, encode};

/// An 8-bit RGB image to draw on.
#[derive(Clone, Debug, PartialEq)]
pub struct Canvas {
    /// (px)
    pub width: usize,
    /// (px)
    pub height: usize,
    /// `height × width × 3`, row-major
    pub pixels: Vec<u8>,
}

impl Canvas {
    /// Filled with one colour.
    pub fn new(width: usize, height: usize, color: [u8; 3]) -> Self {
        Self { width, height, pixels: color.repeat(width * height) }
    }

    /// Sets a pixel; pixels outside the canvas are ignored.
    pub fn set(&mut self, x: i64, y: i64, color: [u8; 3]) {
        if (0..self.width as i64).contains(&x) && (0..self.height as i64).contains(&y) {
            let at = 3 * (y as usize * self.width + x as usize);
            self.pixels[at..at + 3].copy_from_slice(&color);
        }
    }

    /// A filled rectangle.
    pub fn fill(&mut self, (x, y): (i64, i64), (width, height): (i64, i64), color: [u8; 3]) {
        for row in y..y + height {
            (x..x + width).for_each(|column| self.set(column, row, color));
        }
    }

    /// Draws an image of 1 or 3 bands (8-bit, row-major) with its upper left corner at `(x, y)`.
    pub fn put(&mut self, (x, y): (i64, i64), pixels: &[u8], width: usize, bands: usize) {
        for (i, pixel) in pixels.chunks_exact(bands).enumerate() {
            let color = std::array::from_fn(|b| pixel[b.min(bands - 1)]);
            self.set(x + (i % width) as i64, y + (i / width) as i64, color);
        }
    }

    /// A straight line.
    pub fn line(&mut self, (x0, y0): (f64, f64), (x1, y1): (f64, f64), color: [u8; 3]) {
        let steps = (x1 - x0).abs().max((y1 - y0).abs()).ceil().clamp(1.0, 1e5);
        for k in 0..=steps as usize {
            let share = k as f64 / steps;
            self.set(
                (x0 + (x1 - x0) * share).round() as i64,
                (y0 + (y1 - y0) * share).round() as i64,
                color,
            );
        }
    }

    /// A line of text with its upper left corner at `(x, y)`; a font dot is `scale` pixels wide.
    pub fn text(&mut self, (x, y): (i64, i64), scale: usize, color: [u8; 3], text: &str) {
        for (i, c) in text.chars().enumerate() {
            let (glyph, left) = (glyph(c), x + (i * (WIDTH + 1) * scale) as i64);
            for index in (0..WIDTH * HEIGHT).filter(|p| dot(glyph, p % WIDTH, p / WIDTH)) {
                let at =
                    (left + (index % WIDTH * scale) as i64, y + (index / WIDTH * scale) as i64);
                self.fill(at, (scale as i64, scale as i64), color);
            }
        }
    }

    /// Width of a line of text (px).
    pub fn text_width(text: &str, scale: usize) -> usize {
        (text.chars().count() * (WIDTH + 1) * scale).saturating_sub(scale)
    }

    /// Text truncated to a width (px), with an ellipsis.
    pub fn truncated(text: &str, scale: usize, width: usize) -> String {
        let max = (width + scale) / ((WIDTH + 1) * scale);
        if text.chars().count() <= max {
            return text.into();
        }
        text.chars().take(max.saturating_sub(2)).chain("..".chars()).collect()
    }

    /// Text wrapped to a width (px); longer words are truncated.
    pub fn wrapped(text: &str, scale: usize, width: usize) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_whitespace() {
            match lines.last_mut() {
                Some(line) if Self::text_width(&format!("{line} {word}"), scale) <= width => {
                    line.push(' ');
                    line.push_str(word);
                }
                _ => lines.push(Self::truncated(word, scale, width)),
            }
        }
        lines
    }

    /// Encodes the canvas as PNG.
    ///
    /// # Errors
    /// The encoder's message.
    pub fn png(&self) -> Result<Vec<u8>, String> {
        let shape = ImageShape { width: self.width, height: self.height, bands: 3 };
        encode::png(&self.pixels, shape, 8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_within_its_width_and_the_canvas() {
        let mut canvas = Canvas::new(40, 12, [255; 3]);
        canvas.text((-3, -2), 1, [0; 3], "outside is ignored: ± 5°");
        canvas.line((-5.0, 3.0), (60.0, 30.0), [9; 3]);
        assert_eq!(canvas.pixels.len(), 40 * 12 * 3);
        assert_eq!(Canvas::text_width("abc", 2), 34);
        assert!(Canvas::text_width(&Canvas::truncated("a long label", 2, 60), 2) <= 60);
        let lines = Canvas::wrapped("no overlap with any other frame", 1, 80);
        assert!(
            lines.len() > 1 && lines.iter().all(|l| Canvas::text_width(l, 1) <= 80),
            "{lines:?}"
        );
    }

    /// The letter L: a vertical stroke and a horizontal one at the bottom.
    #[test]
    fn glyphs_are_drawn_upright() {
        let mut canvas = Canvas::new(5, 9, [0; 3]);
        canvas.text((0, 0), 1, [1; 3], "L");
        let set: Vec<usize> = (0..45).filter(|i| canvas.pixels[3 * i] == 1).collect();
        assert_eq!(set, [0, 5, 10, 15, 20, 25, 30, 31, 32, 33, 34]);
    }
}
