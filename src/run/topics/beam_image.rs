//! The beam pattern as an image with axes (the paper's Fig. 9): brighter is more light, grey was
//! never seen.

use crate::geometry::StrobeAngles;
use crate::model::BeamPattern;
use crate::plot::{Canvas, Ramp};

/// Of the pattern itself (px).
const SIDE: usize = 320;
/// Left of it and below it, where the axes' words stand, and beside it, where the scale stands
/// (px).
const MARGIN: usize = 44;
const TICK_DEG: f64 = 30.0;
const SCALE_WIDTH: i64 = 12;
const UNSEEN: [u8; 3] = [110, 110, 110];
const PAPER: [u8; 3] = [255, 255, 255];
const INK: [u8; 3] = [40, 40, 40];

/// A PNG, θ down and φ to the right over the grid's whole range (°), and the scale of the gain.
pub fn png(beam: &BeamPattern) -> Vec<u8> {
    let limit = beam.nodes().limit_rad;
    let mut canvas = Canvas::new(MARGIN + SIDE + 2 * MARGIN, SIDE + 2 * MARGIN, PAPER);
    let (left, top, side) = (MARGIN as i64, (MARGIN / 2) as i64, SIDE as i64);
    let angle = |i: i64| (2.0 * (i as f64 + 0.5) / SIDE as f64 - 1.0) * limit;
    for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
        let (log_gain, is_seen) =
            beam.read(StrobeAngles { theta_rad: angle(y), phi_rad: angle(x) });
        canvas.set(
            left + x,
            top + y,
            if is_seen { Ramp::Plasma.at(log_gain.exp()) } else { UNSEEN },
        );
    }
    let width = |text: &str| Canvas::text_width(text, 1) as i64;
    let ticks = (limit.to_degrees() / TICK_DEG).floor() as i64;
    for tick in -ticks..=ticks {
        let degrees = tick as f64 * TICK_DEG;
        let at = ((degrees.to_radians() / limit + 1.0) / 2.0 * SIDE as f64).round() as i64;
        let text = format!("{degrees:.0}");
        canvas.fill((left + at, top + side), (1, 4), INK);
        canvas.text((left + at - width(&text) / 2, top + side + 7), 1, INK, &text);
        canvas.fill((left - 4, top + at), (4, 1), INK);
        canvas.text((left - 7 - width(&text), top + at - 4), 1, INK, &text);
    }
    let (across, down) = ("phi [°]", "theta");
    canvas.text((left + (side - width(across)) / 2, top + side + 22), 1, INK, across);
    canvas.text((2, top - 14), 1, INK, down);
    canvas.text((2, top - 3), 1, INK, "[°]");
    let scale = left + side + 14;
    (0..side).for_each(|y| {
        canvas.fill(
            (scale, top + y),
            (SCALE_WIDTH, 1),
            Ramp::Plasma.at(1.0 - y as f64 / SIDE as f64),
        );
    });
    for quarter in 0..=4 {
        let at = top + side * quarter / 4;
        canvas.text(
            (scale + SCALE_WIDTH + 5, at - 4),
            1,
            INK,
            &format!("{:.2}", 1.0 - quarter as f64 / 4.0),
        );
    }
    canvas.text((scale, top + side + 7), 1, INK, "gain");
    canvas.fill((scale, top + side + 22), (9, 9), UNSEEN);
    canvas.text((scale + 13, top + side + 22), 1, INK, "not seen");
    canvas.png().unwrap_or_default()
}
