//! What the log shows of its camera: gain along the dive, vignetting, transfer curve.

use super::super::dive::CameraLog;
use super::Figure;
use super::facts::band_names;
use super::figures::point_styles;
use crate::image::transfer::Transfer;
use crate::model::{FrameGainFile, ResponseFile, VignettingFile};
use crate::plot::{Axis, Plot};

/// Points of a curve.
const POINTS: usize = 48;

/// The figures that this camera has.
pub fn figures(camera: &CameraLog, place: &str) -> Vec<Figure> {
    let found = camera.model.camera.as_ref();
    let vignetting = found.and_then(|c| c.vignetting.as_ref()).map(|v| fall_off(v, place));
    let response = found.and_then(|c| c.response.as_ref()).map(|r| transfer_curve(r, place));
    gains(camera, place).into_iter().chain(vignetting).chain(response).collect()
}

/// Gain of every frame that has one of its own.
fn gains(camera: &CameraLog, place: &str) -> Option<Figure> {
    let frames = &camera.model.frame_gains;
    let first = frames.iter().map(|f| f.stamp_ns).min()?;
    let is_uneven = |f: &FrameGainFile| f.gain != 1.0 || f.balance.is_some();
    if !frames.iter().any(is_uneven) {
        return None;
    }
    let bands = camera.model.attenuation_per_m.len();
    let seconds = |f: &FrameGainFile| f.stamp_ns.saturating_sub(first) as f64 * 1e-9;
    let stops = |f: &FrameGainFile, b: usize| {
        (f.gain * f.balance.map_or(1.0, |balance| balance[b.min(2)])).log2()
    };
    let values = || frames.iter().flat_map(|f| (0..bands).map(move |b| stops(f, b)));
    let x = Axis::fitting("time since the first of these frames [s]", frames.iter().map(seconds));
    let mut plot =
        Plot::standard("Gain of the frames, per band", x, Axis::fitting("gain [stops]", values()));
    for (b, (class, shape)) in point_styles(bands).iter().enumerate() {
        for frame in frames {
            let (at, gain) = (seconds(frame), stops(frame, b));
            let text = format!("{}: {gain:+.2} stops, {at:.1} s", band_names(bands)[b]);
            plot.point(class, *shape, (at, gain), &text);
        }
        plot.legend(class, *shape, band_names(bands)[b]);
    }
    let caption = "Light of each frame over that of the others, by what the images show (exposure, \
                   white balance, a strobe that flickers); it is divided out. Frames that pass one \
                   did not use follow the camera's law, where one was found.";
    Some(Figure::of(
        "gains",
        "Gain along the dive",
        Ok(plot.into_svg(&format!("{place}plot-gains"))),
        caption,
    ))
}

/// What the lens transmits, from the principal point to the corner.
fn fall_off(found: &VignettingFile, place: &str) -> Figure {
    // The corner is where as much is lost as the file says.
    let lost = |radius: f64| 1.0 - found.transmission(radius, 0.0);
    let corner = (1..400)
        .map(|k| 0.005 * f64::from(k))
        .find(|radius| lost(*radius) >= found.corner_loss)
        .unwrap_or(1.0);
    let points: Vec<(f64, f64)> = (0..=POINTS)
        .map(|k| corner * k as f64 / POINTS as f64)
        .map(|radius| (radius, found.transmission(radius, 0.0)))
        .collect();
    let x = Axis::fitting("tangent of the angle off the axis", points.iter().map(|p| p.0));
    let y = Axis::fitting("transmission", points.iter().map(|p| p.1));
    let mut plot = Plot::standard("Vignetting against image radius", x, y);
    plot.line("l b-grey", &points);
    let caption = format!(
        "Vignetting that the overlapping frames show: {:.0} % of the light is lost in the corner.",
        100.0 * found.corner_loss
    );
    Figure::of(
        "vignetting",
        "Vignetting",
        Ok(plot.into_svg(&format!("{place}plot-vignetting"))),
        &caption,
    )
}

/// The transfer curve, and sRGB.
fn transfer_curve(found: &ResponseFile, place: &str) -> Figure {
    let own: Vec<(f64, f64)> = found.points.iter().map(|[value, light]| (*value, *light)).collect();
    let srgb: Vec<(f64, f64)> = (0..=POINTS)
        .map(|k| k as f64 / POINTS as f64)
        .map(|value| (value, Transfer::Srgb.to_linear(value)))
        .collect();
    let unit = || [0.0, 1.0].into_iter();
    let x = Axis::fitting("pixel value (share of full scale)", unit());
    let y = Axis::fitting("linear light (share of full scale)", unit());
    let mut plot = Plot::standard("Transfer curve of the camera, and sRGB", x, y);
    plot.line("l b-grey dotted", &srgb);
    plot.line("l b-blue", &own);
    let caption = format!(
        "The camera's transfer curve ({}), as the images show it; dotted: sRGB.",
        crate::plot::escape_markup(&found.transfer)
    );
    Figure::of(
        "transfer-curve",
        "Transfer curve",
        Ok(plot.into_svg(&format!("{place}plot-transfer"))),
        &caption,
    )
}
