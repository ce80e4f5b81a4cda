//! The paper's Fig. 10: one frame raw, corrected for attenuation alone, for the beam pattern alone,
//! and for both.
//!
//! All by the library's correction. Raw and beam pattern alone keep the blue-green cast of the
//! water and get no white balance; the other two get that of the whole log.

use super::super::display::{downscale, exposure, jpeg_uri, to_srgb};
use super::figure::Figure;
use crate::config::{Method, WhiteBalance};
use crate::image::LinearImage;
use crate::plot::escape_markup;
use crate::run::bench::{Bench, BenchFrame};

/// Longest side of a stage (px).
const SIDE: usize = 560;
const QUALITY: u8 = 84;

/// The four images of a frame as HTML.
pub fn stages(bench: &Bench, frame: &BenchFrame<'_>) -> Result<String, String> {
    let log_colors = bench.log_colors(frame);
    if log_colors.is_empty() {
        return Err("by the model the strobe lights no part of the frame".into());
    }
    let raw = frame.image.clone().into_demosaiced();
    let of_model = &bench.model.file.rendering;
    let balance = balance_of(&of_model.gain);
    let stage = |method, white_balance| {
        bench.corrected(frame, method, &bench.exposure(&log_colors, method, white_balance))
    };
    let both = if of_model.method == Method::Full {
        bench.corrected(frame, Method::Full, of_model)
    } else {
        stage(Method::Full, balance)
    };
    let images = [
        ("raw", raw),
        ("attenuation alone", stage(Method::Attenuation, balance)),
        ("beam pattern alone", stage(Method::BeamPattern, WhiteBalance::None)),
        ("attenuation and beam pattern", both),
    ];
    let mut html = String::from("<div class=\"four\">");
    for (name, image) in &images {
        let small = downscale(image, SIDE);
        let is_both = *name == images[3].0;
        // The last has the exposure of the log; the others get one of their own.
        let factor = if is_both { 1.0 } else { exposure(std::iter::once(&small)) };
        html += &tile(name, &small, factor)?;
    }
    Ok(html + "</div>")
}

/// The white balance in the gains of a log.
fn balance_of(gain: &[f64]) -> WhiteBalance {
    match gain {
        [r, g, b] if [r, g, b].iter().all(|v| **v > 0.0) => {
            let mean = (r * g * b).cbrt();
            WhiteBalance::Factors([r / mean, g / mean, b / mean])
        }
        _ => WhiteBalance::None,
    }
}

fn tile(name: &str, image: &LinearImage, factor: f32) -> Result<String, String> {
    let uri = jpeg_uri(&to_srgb(image, factor), image.shape(), QUALITY)?;
    let name = escape_markup(name);
    Ok(format!(
        "<div><img width=\"{}\" height=\"{}\" alt=\"{name}\" src=\"{uri}\"><p \
         class=\"which\">{name}</p></div>",
        image.width, image.height
    ))
}

pub fn figure(body: Result<String, String>) -> Figure {
    let caption = "One frame, as in the paper's Fig. 10. Raw and beam pattern alone have no white \
                   balance and keep the water's cast; the other two have that of the whole log. \
                   Each has an exposure of its own, except the last, which is as in the log.";
    Figure::of("stages", "Stages of correction (Fig. 10)", body, caption)
}
