//! The trajectory seen from above, coloured by altitude and by the residual of the seafloor plane;
//! along time where the log has no trajectory.

use super::super::dive::{CameraLog, FrameRecord};
use super::super::places::{Places, east_north, fix_at, placed};
use super::facts::time_of;
use super::figure::Figure;
use crate::plot::{Axis, Plot, Ramp, Shape, escape_markup};
use crate::run::bench::Bench;

/// Maximum number of points; more are thinned evenly.
const MAX_POINTS: usize = 1500;

/// A value of a frame with its name and texts.
struct Quantity {
    id: &'static str,
    name: &'static str,
    label: &'static str,
    means: &'static str,
    of: fn(&FrameRecord) -> f64,
    missing: &'static str,
}

const QUANTITIES: [Quantity; 2] = [
    Quantity {
        id: "track-altitude",
        name: "altitude",
        label: "altitude [m]",
        means: "the altitude of the camera over the seafloor plane",
        of: |f| f.altitude_m,
        missing: "no frame has a seafloor plane",
    },
    Quantity {
        id: "track-residual",
        name: "plane residual",
        label: "residual [m]",
        means: "root mean square distance of the returns from the plane",
        of: |f| f.seafloor.as_ref().map_or(f64::NAN, |p| p.residual_m),
        missing: "no plane has more returns than it needs, so there is no residual (an \
                  altimeter, or three beams)",
    },
];

/// Two figures.
pub fn figures(
    camera: &CameraLog,
    bench: Result<&Bench, &String>,
    places: &Places,
    place: &str,
) -> Vec<Figure> {
    let step = camera.frames.len().div_ceil(MAX_POINTS).max(1);
    let frames: Vec<&FrameRecord> = camera.frames.iter().step_by(step).collect();
    let track = track(&frames, bench, places);
    QUANTITIES.iter().map(|quantity| figure(quantity, &frames, track.as_ref(), place)).collect()
}

/// Positions of the frames seen from above (m), labels of the axes and the source.
struct Track {
    at: Vec<Option<[f64; 2]>>,
    labels: [&'static str; 2],
    source: String,
}

fn track(
    frames: &[&FrameRecord],
    bench: Result<&Bench, &String>,
    places: &Places,
) -> Option<Track> {
    let by_pose = bench.ok().and_then(|bench| {
        let survey = &bench.session.survey;
        let with_planes: Vec<_> =
            frames.iter().map(|f| (f.stamp, bench.session.seafloor(f.stamp).ok())).collect();
        let known: Vec<_> =
            with_planes.iter().filter_map(|(stamp, plane)| Some((*stamp, (*plane)?))).collect();
        let placed = placed(&bench.session, places, &known)?;
        let mut found = placed.poses.into_iter();
        let camera = survey.rig.body_from_optical.origin().vector();
        let at = with_planes.iter().map(|(_, plane)| {
            plane.as_ref()?;
            let (_, pose) = found.next().flatten()?;
            let p = pose * nalgebra::Point3::from(camera);
            Some([p.x, p.y])
        });
        Some(Track { at: at.collect(), labels: ["x [m]", "y [m]"], source: placed.source })
    });
    by_pose.or_else(|| {
        let (topic, fixes) = places.best_fixes()?;
        let first = fixes.first()?;
        let at: Vec<_> = frames
            .iter()
            .map(|f| fix_at(fixes, f.stamp).map(|fix| east_north(&fix, first)))
            .collect();
        let is_known = 2 * at.iter().flatten().count() > frames.len();
        is_known.then(|| Track {
            at,
            labels: ["east [m]", "north [m]"],
            source: format!("fixes of {topic}, from the first one"),
        })
    })
}

/// Frames and the values of one quantity, for either figure.
struct Values<'f> {
    quantity: &'f Quantity,
    frames: &'f [&'f FrameRecord],
    values: Vec<f64>,
}

fn figure(
    quantity: &Quantity,
    frames: &[&FrameRecord],
    track: Option<&Track>,
    place: &str,
) -> Figure {
    let title = match track {
        Some(_) => format!("Track from above, by {}", quantity.name),
        None => format!("Along the dive: {}", quantity.name),
    };
    let values: Vec<f64> = frames.iter().map(|f| (quantity.of)(f)).collect();
    if !values.iter().any(|v| v.is_finite()) {
        return Figure::of(quantity.id, &title, Err(quantity.missing.into()), "");
    }
    let values = Values { quantity, frames, values };
    let (plot, caption) = match track {
        Some(track) => (values.seen_from_above(track, &title), values.caption_from_above(track)),
        None => (
            values.along_time(&title),
            format!(
                "{}. Along time, as the log has no trajectory: no odometry, no position, and no \
                 velocity with an attitude.",
                quantity.means
            ),
        ),
    };
    let svg = plot.into_svg(&format!("{place}plot-{}", quantity.id));
    Figure::of(quantity.id, &title, Ok(svg), &caption)
}

impl Values<'_> {
    /// Text of a point.
    fn text(&self, frame: &FrameRecord, value: f64) -> String {
        let value = if value.is_finite() { format!("{value:.3} m") } else { "unknown".to_string() };
        format!(
            "{}: {value}, {}{}",
            self.quantity.name,
            time_of(frame.stamp),
            if frame.corrected { "" } else { " (not corrected)" }
        )
    }

    fn axis(&self) -> Axis {
        Axis::fitting(self.quantity.label, self.values.iter().copied())
    }

    fn seen_from_above(&self, track: &Track, title: &str) -> Plot {
        let (x, y) = equal_axes(track);
        let field = field_of(&x, &y);
        let mut plot = Plot::new(title, x, y, field).with_bar(Ramp::Viridis, self.axis());
        let line: Vec<(f64, f64)> =
            track.at.iter().map(|p| p.map_or((f64::NAN, f64::NAN), |[x, y]| (x, y))).collect();
        plot.line("way", &line);
        for ((frame, value), at) in self.frames.iter().zip(&self.values).zip(&track.at) {
            if let Some([x, y]) = at {
                let text = format!("{}; at {x:.2}, {y:.2} m", self.text(frame, *value));
                plot.colored_point((*x, *y), *value, &text);
            }
        }
        plot
    }

    fn caption_from_above(&self, track: &Track) -> String {
        let hollow =
            if self.frames.iter().all(|f| f.corrected) { "" } else { " Hollow: no value." };
        format!(
            "One point per frame at the position of the camera, seen from above: {}. Positions \
             from {}.{hollow}",
            self.quantity.means,
            escape_markup(&track.source)
        )
    }

    fn along_time(&self, title: &str) -> Plot {
        let start = self.frames.first().map(|f| f.stamp).unwrap_or_default();
        let seconds = |f: &FrameRecord| f.stamp.seconds_since(start);
        let times = self.frames.iter().map(|f| seconds(f));
        let x = Axis::fitting("time since the first frame [s]", times.clone());
        let mut plot = Plot::new(title, x, self.axis(), (450.0, 190.0));
        plot.line("way", &times.zip(self.values.iter().copied()).collect::<Vec<_>>());
        for (frame, value) in self.frames.iter().zip(&self.values) {
            let text = self.text(frame, *value);
            plot.point("b-grey", Shape::Dot, (seconds(frame), *value), &text);
        }
        plot
    }
}

/// Axes of one scale around all positions.
fn equal_axes(track: &Track) -> (Axis, Axis) {
    let of = |k: usize| track.at.iter().flatten().map(move |p| p[k]);
    let (mut x, mut y) =
        (Axis::fitting(track.labels[0], of(0)), Axis::fitting(track.labels[1], of(1)));
    // A straight leg still needs a field that has both sides.
    let least = 0.35 * (x.to - x.from).max(y.to - y.from).max(0.2);
    for axis in [&mut x, &mut y] {
        let missing = least - (axis.to - axis.from);
        if missing > 0.0 {
            (axis.from, axis.to) = (axis.from - missing / 2.0, axis.to + missing / 2.0);
        }
    }
    (x, y)
}

fn field_of(x: &Axis, y: &Axis) -> (f64, f64) {
    let scale = (430.0 / (x.to - x.from)).min(330.0 / (y.to - y.from));
    ((x.to - x.from) * scale, (y.to - y.from) * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Stamp;

    #[test]
    fn a_frame_without_a_seafloor_has_an_unknown_altitude() {
        let frame = FrameRecord {
            log_time: 0,
            stamp: Stamp(0),
            corrected: false,
            reason: "no ping".into(),
            altitude_m: f64::NAN,
            seafloor: None,
        };
        let frames = [&frame];
        for quantity in &QUANTITIES {
            let values = Values { quantity, frames: &frames, values: vec![f64::NAN] };
            let text = values.text(&frame, (quantity.of)(&frame));
            assert_eq!(
                text,
                format!("{}: unknown, 1970-01-01T00:00:00.000Z (not corrected)", quantity.name)
            );
        }
    }
}
