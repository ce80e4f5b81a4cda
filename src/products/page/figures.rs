//! Plots of numbers: Fig. 6, 8 and 9 of the paper for this dive, and attenuation along the dive.

use super::super::dive::CameraLog;
use super::facts::{NINETY_FIVE, band_names, time_of};
use super::figure::{Figure, Seen};
use crate::config::Estimator;
use crate::model::{BeamPatternFile, EstimatorAnswer, ImageAnswer};
use crate::plot::{Axis, Plot, Ramp, Shape};
use crate::units::Stamp;

/// CSS class and shape of each band's points.
pub fn point_styles(bands: usize) -> &'static [(&'static str, Shape)] {
    if bands == 1 {
        &[("b-grey", Shape::Dot)]
    } else {
        &[("b-red", Shape::Dot), ("b-green", Shape::Square), ("b-blue", Shape::Triangle)]
    }
}

fn joined(values: impl Iterator<Item = f64>) -> String {
    values.map(|v| format!("{v:.3}")).collect::<Vec<_>>().join(" / ")
}

/// Fig. 6: log of each frame's channel means against altitude.
pub fn channel_means(camera: &CameraLog, seen: &[Seen], no_raw: &str, place: &str) -> Figure {
    let frames: Vec<&Seen> = seen
        .iter()
        .filter(|s| s.altitude_m.is_finite() && s.mean_light[..s.bands].iter().all(|v| *v > 0.0))
        .collect();
    let bands = camera.model.attenuation_per_m.len();
    let answer = camera.model.estimators.get(&Estimator::Altitude);
    let names =
        ["channel_means_red_per_m", "channel_means_green_per_m", "channel_means_blue_per_m"];
    let used: Option<Vec<f64>> =
        answer.and_then(|a| names.iter().take(bands).map(|n| a.details.get(*n).copied()).collect());
    let farthest = answer.and_then(|a| a.details.get("farthest_m")).copied();
    let body = if seen.is_empty() {
        Err(no_raw.to_string())
    } else if frames.len() < 2 {
        Err("fewer than two raw frames can be read".into())
    } else {
        let plot = means_plot(&frames, bands, used.as_deref(), farthest);
        Ok(plot.into_svg(&format!("{place}plot-means")))
    };
    let mut caption = format!(
        "Mean of each channel over the whole raw frame, in linear light (full scale is 1), \
         natural logarithm; {} frames. Every light path grows with altitude, and the lines fall \
         the steeper the larger the attenuation.",
        frames.len()
    );
    if body.is_ok() {
        caption += &means_caption(camera, answer, used.as_deref(), farthest);
    }
    Figure::of("channel-means", "Log channel means against altitude (Fig. 6)", body, &caption)
}

/// Points and lines of Fig. 6; slopes are −2 `used`, or fitted without it.
fn means_plot(frames: &[&Seen], bands: usize, used: Option<&[f64]>, farthest: Option<f64>) -> Plot {
    let x = Axis::fitting("altitude of the camera [m]", frames.iter().map(|s| s.altitude_m));
    let y = Axis::fitting(
        "ln of channel mean",
        frames.iter().flat_map(|s| s.mean_light[..s.bands].iter().map(|v| v.ln())),
    );
    let ends = [x.from, x.to];
    let mut plot = Plot::standard("Log channel mean against altitude, per band", x, y);
    if let Some(farthest) = farthest {
        plot.shade(0.0, farthest / 2.0);
    }
    for (b, (class, shape)) in point_styles(bands).iter().enumerate() {
        let points: Vec<(f64, f64)> = frames
            .iter()
            .filter(|s| b < s.bands)
            .map(|s| (s.altitude_m, s.mean_light[b].ln()))
            .collect();
        let slope = used.map_or_else(|| fitted_slope(&points), |u| Some(-2.0 * u[b]));
        for (altitude, log) in &points {
            let text = format!("{}: {log:.3} at {altitude:.2} m", band_names(bands)[b]);
            plot.point(class, *shape, (*altitude, *log), &text);
        }
        let n = points.len() as f64;
        let middle = (
            points.iter().map(|p| p.0).sum::<f64>() / n,
            points.iter().map(|p| p.1).sum::<f64>() / n,
        );
        if let Some(slope) = slope {
            let at = |altitude: f64| (altitude, middle.1 + slope * (altitude - middle.0));
            plot.line(class, &ends.map(at));
        }
        plot.legend(class, *shape, band_names(bands)[b]);
    }
    plot
}

/// What shading and lines of Fig. 6 are.
fn means_caption(
    camera: &CameraLog,
    answer: Option<&EstimatorAnswer>,
    used: Option<&[f64]>,
    farthest: Option<f64>,
) -> String {
    let shaded = farthest.map_or_else(String::new, |farthest| {
        format!(
            " Shaded: where the path there and back is no longer than {farthest:.2} m, beyond \
             which the altitude estimator uses no cell."
        )
    });
    let lines = match (used, answer.and_then(|a| a.attenuation_per_m.as_ref())) {
        (Some(u), Some(a)) => format!(
            " Lines: α = −slope/2 as in the paper, {} per metre, which includes spreading and the \
             beam pattern; without them, cell by cell, the altitude estimator gives {}. The run \
             used the {} estimator.",
            joined(u.iter().copied()),
            joined(a.iter().copied()),
            camera.model.estimator.word()
        ),
        _ => format!(
            " Lines: least squares through these points, where altitude varies. The altitude \
             estimator has no result: {}.",
            crate::plot::escape_markup(
                answer.and_then(|a| a.note.as_deref()).unwrap_or("no reason is recorded")
            )
        ),
    };
    shaded + &lines
}

/// Slope by least squares; `None` where x hardly varies.
fn fitted_slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let (x, y) =
        (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let (top, bottom) = points
        .iter()
        .fold((0.0, 0.0), |(t, b), p| (t + (p.0 - x) * (p.1 - y), b + (p.0 - x).powi(2)));
    (bottom > 1e-4 * n).then(|| top / bottom)
}

/// Fig. 8: α of every image's pairs before and after the beam pattern is known.
pub fn pairs_by_image(camera: &CameraLog, place: &str) -> Figure {
    let title = "Attenuation image by image, before and after beam pattern correction (Fig. 8)";
    let nothing = EstimatorAnswer::default();
    let answer = camera.model.estimators.get(&Estimator::Pairs).unwrap_or(&nothing);
    let bands = camera.model.attenuation_per_m.len();
    let images: Vec<&ImageAnswer> = answer
        .by_image
        .iter()
        .filter(|i| {
            i.attenuation_per_m.len() == bands && i.before_beam_pattern_per_m.len() == bands
        })
        .collect();
    let Some(first) = images.first() else {
        let why = match (&answer.note, &answer.attenuation_per_m) {
            (Some(note), _) => format!("the pairs estimator has no result: {note}"),
            (None, Some(_)) => "the model was made by an older version, which does not keep the \
                                results of single images"
                .into(),
            (None, None) => "the pairs estimator was not run".into(),
        };
        return Figure::of("pairs", title, Err(why), "");
    };
    // Images of little overlap scatter far: the axis holds nine in ten values, and the means.
    let mut all: Vec<f64> = images
        .iter()
        .flat_map(|i| {
            (0..bands).flat_map(move |b| [pair_value(i, true, b), pair_value(i, false, b)])
        })
        .collect();
    all.sort_by(f64::total_cmp);
    let at = |share: f64| all[((all.len() - 1) as f64 * share).round() as usize];
    let means_before: Vec<Option<f64>> = ["red", "green", "blue"]
        .map(|c| answer.details.get(&format!("before_beam_pattern_{c}_per_m")).copied())
        .into();
    let means_after: Vec<Option<f64>> =
        (0..3).map(|b| answer.attenuation_per_m.as_ref().and_then(|a| a.get(b).copied())).collect();
    let means = means_before.iter().chain(&means_after).filter_map(|m| *m);
    let range = Axis::fitting("", [at(0.05), at(0.95), 0.0].into_iter().chain(means));
    let outside = all.iter().filter(|v| **v < range.from || **v > range.to).count();
    let start_ns = camera.frames.first().map_or(first.stamp_ns, |f| f.stamp.0);
    let plot = PairsPlot { images: &images, bands, start_ns, range };
    let body = plot.html(true, &means_before, place) + &plot.html(false, &means_after, place);
    let caption = format!(
        "Each image's α by Eq. 16, from its pairs with later images ({} images, {} pairs); \
         dotted: weighted means, in the legend. Bands of one image move together where its light \
         differs, not its water. {outside} of {} values lie beyond the axis. This is the paper's \
         estimator; the model holds the result of the {} estimator.",
        images.len(),
        answer.observations,
        all.len(),
        camera.model.estimator.word()
    );
    Figure::of("pairs", title, Ok(body), &caption)
}

/// α of an image's pairs in a band (1/m), before or after the beam pattern is known.
fn pair_value(image: &ImageAnswer, before: bool, b: usize) -> f64 {
    if before { image.before_beam_pattern_per_m[b] } else { image.attenuation_per_m[b] }
}

/// What both plots of Fig. 8 share.
struct PairsPlot<'f> {
    images: &'f [&'f ImageAnswer],
    bands: usize,
    /// time of the first frame (ns)
    start_ns: i64,
    /// of α (1/m)
    range: Axis,
}

impl PairsPlot<'_> {
    /// One of the plots, with its heading; `means` per band.
    fn html(&self, before: bool, means: &[Option<f64>], place: &str) -> String {
        let Self { images, bands, start_ns, .. } = *self;
        let (heading, id) = if before {
            ("before: a uniform beam is assumed", "before")
        } else {
            ("after: the beam pattern is known", "after")
        };
        let seconds = |stamp: i64| (stamp.saturating_sub(start_ns)) as f64 * 1e-9;
        let x = Axis::fitting(
            "time since the first frame [s]",
            images.iter().map(|i| seconds(i.stamp_ns)),
        );
        let y = Axis { label: "α [1/m]".into(), ..self.range.clone() };
        let ends = [x.from, x.to];
        let mut plot =
            Plot::new(&format!("Attenuation of each image, {heading}"), x, y, (450.0, 190.0));
        for (b, (class, shape)) in point_styles(bands).iter().enumerate() {
            for image in images {
                let alpha = pair_value(image, before, b);
                let text = format!(
                    "{}: {alpha:.3} per metre, {}",
                    band_names(bands)[b],
                    time_of(Stamp(image.stamp_ns))
                );
                plot.point(class, *shape, (seconds(image.stamp_ns), alpha), &text);
            }
            if let Some(mean) = means.get(b).copied().flatten() {
                plot.line(&format!("{class} dotted"), &ends.map(|x| (x, mean)));
                plot.legend(class, *shape, &format!("{} {mean:.3}", band_names(bands)[b]));
            }
        }
        let svg = plot.into_svg(&format!("{place}plot-pairs-{id}"));
        format!("<p class=\"which\">{heading}</p>{svg}")
    }
}

/// Maximum number of cells per axis; more make the page heavy and the figure no clearer.
const MAX_CELLS: usize = 45;

/// Fig. 9: the strobe's beam pattern in degrees, masked where never seen.
pub fn beam_pattern(camera: &CameraLog, place: &str) -> Figure {
    let title = "Beam pattern of the strobe (Fig. 9)";
    let beam = &camera.model.beam_pattern;
    let seen =
        |i: usize, j: usize| beam.log_gain.get(i).and_then(|row| row.get(j).copied().flatten());
    let (rows, columns) = (beam.theta_deg.len(), beam.phi_deg.len());
    let known: Vec<(usize, usize)> = (0..rows)
        .flat_map(|i| (0..columns).map(move |j| (i, j)))
        .filter(|(i, j)| seen(*i, *j).is_some())
        .collect();
    if known.is_empty() || rows < 2 || columns < 2 {
        return Figure::of(
            "beam-pattern",
            title,
            Err("no frame showed any direction of the beam".into()),
            "",
        );
    }
    // A peak of a few cells at the edge would leave the rest dark: the colours end where nearly all
    // values lie.
    let mut gains: Vec<f64> =
        known.iter().filter_map(|(i, j)| seen(*i, *j)).map(f64::exp).collect();
    gains.sort_by(f64::total_cmp);
    let high_gain = gains[(gains.len() - 1) * 98 / 100];
    let bar = Axis {
        label: "intensity over its peak".into(),
        from: 0.0,
        to: if high_gain < 0.6 { high_gain } else { 1.0 },
    };
    let svg = beam_plot(beam, &known, bar).into_svg(&format!("{place}plot-beam"));
    let share = 100.0 * known.len() as f64 / (rows * columns) as f64;
    let beyond = if high_gain < 0.6 {
        " A few directions at the edge are brighter than the colours reach."
    } else {
        ""
    };
    let caption = format!(
        "Relative intensity in the strobe's angles, (0°, 0°) along its axis; warmer is brighter. \
         No frame showed the blank directions ({:.0} % of the grid, which reaches to \
         ±{:.0}°). One pattern for all bands and the whole dive.{beyond}",
        100.0 - share,
        beam.theta_deg.last().copied().unwrap_or_default()
    );
    Figure::of("beam-pattern", title, Ok(svg), &caption)
}

/// The cells of Fig. 9 that frames showed (θ row, φ column), thinned to [`MAX_CELLS`] per axis.
fn beam_plot(beam: &BeamPatternFile, known: &[(usize, usize)], bar: Axis) -> Plot {
    let step = (beam.theta_deg[1] - beam.theta_deg[0]).abs();
    let stride = beam.theta_deg.len().div_ceil(MAX_CELLS).max(1);
    let half = step * stride as f64 / 2.0;
    let span = |angles: Vec<f64>| {
        angles.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), v| (l.min(*v), m.max(*v)))
    };
    let (left, right) = span(known.iter().map(|(_, j)| beam.phi_deg[*j]).collect());
    let (low, high) = span(known.iter().map(|(i, _)| beam.theta_deg[*i]).collect());
    let margin = 2.0 * step;
    let x = Axis {
        label: "φ, about the strobe's y axis [°]".into(),
        from: left - margin,
        to: right + margin,
    };
    // θ falls: seen along the strobe's axis, what is below the axis is below in the figure.
    let y =
        Axis { label: "θ, about its x axis [°]".into(), from: high + margin, to: low - margin };
    // Degrees are as long up as across.
    let scale = (430.0 / (x.to - x.from)).min(430.0 / (y.from - y.to));
    let field = ((x.to - x.from) * scale, (y.from - y.to) * scale);
    let mut plot = Plot::new("Beam pattern over two angles, in colour", x, y, field)
        .with_bar(Ramp::Plasma, bar);
    for (i, j) in known.iter().filter(|(i, j)| i % stride == 0 && j % stride == 0) {
        let (theta, phi) = (beam.theta_deg[*i], beam.phi_deg[*j]);
        let gain = beam.log_gain[*i][*j].map(f64::exp);
        let text = format!("θ {theta:.1}°, φ {phi:.1}°: {:.3}", gain.unwrap_or(f64::NAN));
        plot.cell((phi - half, theta - half), (phi + half, theta + half), gain, &text);
    }
    plot
}

/// α along the dive, where it changes.
pub fn attenuation_over_time(camera: &CameraLog, place: &str) -> Option<Figure> {
    let nodes = &camera.model.segments.0;
    let first = nodes.first()?.stamp_ns;
    let bands = camera.model.attenuation_per_m.len();
    let seconds = |stamp: i64| stamp.saturating_sub(first) as f64 * 1e-9;
    let ends = |n: &crate::model::TimeNode, b: usize| {
        let (alpha, std) = (
            n.attenuation_per_m.get(b).copied().unwrap_or(f64::NAN),
            n.attenuation_std_per_m.get(b).copied().unwrap_or(f64::NAN),
        );
        (alpha, NINETY_FIVE * std)
    };
    let x =
        Axis::fitting("time since the first node [s]", nodes.iter().map(|n| seconds(n.stamp_ns)));
    let values = nodes
        .iter()
        .flat_map(|n| (0..bands).map(move |b| ends(n, b)))
        .flat_map(|(a, e)| [a - e, a + e]);
    let mut plot =
        Plot::standard("Attenuation along the dive, per band", x, Axis::fitting("α [1/m]", values));
    for (b, (class, shape)) in point_styles(bands).iter().enumerate() {
        let curve = |sign: f64| {
            nodes
                .iter()
                .map(|n| (seconds(n.stamp_ns), ends(n, b).0 + sign * ends(n, b).1))
                .collect::<Vec<_>>()
        };
        plot.line(class, &curve(0.0));
        plot.line(&format!("{class} dotted"), &curve(1.0));
        plot.line(&format!("{class} dotted"), &curve(-1.0));
        for node in nodes {
            let (alpha, half) = ends(node, b);
            let text = format!(
                "{}: {alpha:.4} ± {half:.4} per metre (95 %), {}",
                band_names(bands)[b],
                time_of(Stamp(node.stamp_ns))
            );
            plot.point(class, *shape, (seconds(node.stamp_ns), alpha), &text);
        }
        plot.legend(class, *shape, band_names(bands)[b]);
    }
    let caption = "The water changes along this dive: α at its nodes, linear between; dotted: 95 \
                   % intervals.";
    Some(Figure::of(
        "over-time",
        "Attenuation along the dive",
        Ok(plot.into_svg(&format!("{place}plot-over-time"))),
        caption,
    ))
}
