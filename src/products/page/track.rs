//! The dive seen from above, coloured by altitude and by how well planes fit; along time where the
//! log tells no way.

use super::super::dive::{CameraLog, FrameRecord};
use super::super::places::{Places, east_north, fix_at, placed};
use super::Figure;
use super::facts::time_of;
use crate::plot::{Axis, Plot, Ramp, Shape, escape_markup};
use crate::run::bench::Bench;

/// Points of a track, at most; thinned evenly.
const MOST_POINTS: usize = 1500;

/// A value of a frame, and how it is called.
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
        means: "the height of the camera over the floor's plane",
        of: |f| f.altitude_m,
        missing: "no frame has a floor below it",
    },
    Quantity {
        id: "track-residual",
        name: "plane residual",
        label: "residual [m]",
        means: "root mean square of the hits' heights over the plane",
        of: |f| f.seafloor.as_ref().map_or(f64::NAN, |p| p.residual_m),
        missing: "no plane is held by more returns than it needs, so nothing is left over (an \
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
    let step = camera.frames.len().div_ceil(MOST_POINTS).max(1);
    let frames: Vec<&FrameRecord> = camera.frames.iter().step_by(step).collect();
    let way = way(&frames, bench, places);
    QUANTITIES.iter().map(|quantity| figure(quantity, &frames, way.as_ref(), place)).collect()
}

/// Where frames were, seen from above (m), and words.
struct Way {
    at: Vec<Option<[f64; 2]>>,
    labels: [&'static str; 2],
    source: String,
}

fn way(frames: &[&FrameRecord], bench: Result<&Bench, &String>, places: &Places) -> Option<Way> {
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
        Some(Way { at: at.collect(), labels: ["x [m]", "y [m]"], source: placed.source })
    });
    by_pose.or_else(|| {
        let (topic, fixes) = places.best_fixes()?;
        let first = fixes.first()?;
        let at: Vec<_> = frames
            .iter()
            .map(|f| fix_at(fixes, f.stamp).map(|fix| east_north(&fix, first)))
            .collect();
        let most = 2 * at.iter().flatten().count() > frames.len();
        most.then(|| Way {
            at,
            labels: ["east [m]", "north [m]"],
            source: format!("fixes of {topic}, from the first one"),
        })
    })
}

fn figure(quantity: &Quantity, frames: &[&FrameRecord], way: Option<&Way>, place: &str) -> Figure {
    let seen_from_above = format!("Track from above, by {}", quantity.name);
    let along_time = format!("Along the dive: {}", quantity.name);
    let values: Vec<f64> = frames.iter().map(|f| (quantity.of)(f)).collect();
    if !values.iter().any(|v| v.is_finite()) {
        return Figure::of(
            quantity.id,
            if way.is_some() { &seen_from_above } else { &along_time },
            Err(quantity.missing.into()),
            "",
        );
    }
    let uncorrected = frames.iter().filter(|f| !f.corrected).count();
    let says = |f: &FrameRecord, v: f64| {
        format!(
            "{}: {v:.3} m, {}{}",
            quantity.name,
            time_of(f.stamp),
            if f.corrected { "" } else { " (not corrected)" }
        )
    };
    let id = format!("{place}plot-{}", quantity.id);
    let grey = if uncorrected > 0 { " Hollow: no value." } else { "" };
    if let Some(way) = way {
        let (x, y) = equal_axes(way);
        let field = field_of(&x, &y);
        let mut plot = Plot::new(&seen_from_above, x, y, field)
            .with_bar(Ramp::Viridis, Axis::fitting(quantity.label, values.iter().copied()));
        let line: Vec<(f64, f64)> =
            way.at.iter().map(|p| p.map_or((f64::NAN, f64::NAN), |[x, y]| (x, y))).collect();
        plot.line("way", &line);
        for ((frame, value), at) in frames.iter().zip(&values).zip(&way.at) {
            if let Some([x, y]) = at {
                plot.colored_point(
                    (*x, *y),
                    *value,
                    &format!("{}; at {x:.2}, {y:.2} m", says(frame, *value)),
                );
            }
        }
        let caption = format!(
            "One point a frame, where the camera was, seen from above: {}. Places from {}.{grey}",
            quantity.means,
            escape_markup(&way.source)
        );
        return Figure::of(quantity.id, &seen_from_above, Ok(plot.into_svg(&id)), &caption);
    }
    let start = frames.first().map_or(frames[0].stamp, |f| f.stamp);
    let seconds = |f: &FrameRecord| f.stamp.seconds_since(start);
    let x = Axis::fitting("time since the first frame [s]", frames.iter().map(|f| seconds(f)));
    let mut plot = Plot::new(
        &along_time,
        x,
        Axis::fitting(quantity.label, values.iter().copied()),
        (450.0, 190.0),
    );
    plot.line(
        "way",
        &frames.iter().zip(&values).map(|(f, v)| (seconds(f), *v)).collect::<Vec<_>>(),
    );
    for (frame, value) in frames.iter().zip(&values) {
        plot.point("b-grey", Shape::Dot, (seconds(frame), *value), &says(frame, *value));
    }
    let caption = format!(
        "{}. Along time, as the log tells no way over the ground: it has no odometry, no \
         position, and no velocity with an attitude.",
        quantity.means
    );
    Figure::of(quantity.id, &along_time, Ok(plot.into_svg(&id)), &caption)
}

/// Axes of one scale around all places.
fn equal_axes(way: &Way) -> (Axis, Axis) {
    let of = |k: usize| way.at.iter().flatten().map(move |p| p[k]);
    let (mut x, mut y) = (Axis::fitting(way.labels[0], of(0)), Axis::fitting(way.labels[1], of(1)));
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
