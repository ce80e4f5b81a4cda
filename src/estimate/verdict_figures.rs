//! The figures of the verdict: agreement of the same point, and evenness over regions and frames.

use super::methods::empirical::{RegionSample, Regions, fit};
use crate::image::Bands;
use crate::model::{EmpiricalForm, VerdictFigures, limited};
use crate::solver::{Observation, Track};
use crate::stats;

/// One frame in this many is held out, where frames overlap.
pub const EVERY: u32 = 3;
/// Where they do not: one segment in three, of this many.
const SEGMENTS: usize = 12;
const ROTATIONS: usize = 3;
/// Most frames that judge an empirical model.
pub const MAX_JUDGED: usize = 75;
/// Fewest held-out views that measure agreement.
const MIN_VIEWS: usize = 100;
/// The signal-to-noise ratio at which a band has half of its weight.
const SIGNAL_TO_NOISE: f64 = 5.0;

pub fn is_held(frame: u32) -> bool {
    frame % EVERY == EVERY - 1
}

/// Frames of a kind, evenly spread if there are more than `most`.
pub fn frames_of(regions: &Regions, most: usize, wanted: impl Fn(usize) -> bool) -> Vec<usize> {
    let frames: Vec<usize> = (0..regions.frames.len()).filter(|f| wanted(*f)).collect();
    let every = frames.len().div_ceil(most).max(1);
    frames.into_iter().step_by(every).collect()
}

pub fn of_points(name: &str, agreement: Option<f64>) -> VerdictFigures {
    VerdictFigures { name: name.into(), agreement, ..VerdictFigures::default() }
}

/// Robust spread of held-out views about the mean of the other views of their point, over the
/// robust spread of the points; mean of the bands.
pub fn agreement(
    tracks: &[Track],
    bands: usize,
    value: &(dyn Fn(&Observation) -> Option<Bands> + Sync),
) -> Option<f64> {
    let (mut off, mut means) = (vec![Vec::new(); bands], vec![Vec::new(); bands]);
    for track in tracks {
        let views: Vec<(u32, Bands)> =
            track.iter().filter_map(|o| Some((o.frame, value(o)?))).collect();
        let seen: Vec<&Bands> =
            views.iter().filter(|(f, _)| !is_held(*f)).map(|(_, v)| v).collect();
        if seen.is_empty() || seen.len() == views.len() {
            continue;
        }
        for b in 0..bands {
            let mean = seen.iter().map(|v| v[b]).sum::<f64>() / seen.len() as f64;
            means[b].push(mean);
            let held = views.iter().filter(|(f, _)| is_held(*f));
            off[b].extend(held.map(|(_, v)| v[b] - mean));
        }
    }
    let of_band = |b: usize| {
        let middle = stats::median(&means[b]);
        let between: Vec<f64> = means[b].iter().map(|m| m - middle).collect();
        stats::robust_std(&off[b]) / stats::robust_std(&between)
    };
    let is_enough = off.first().is_some_and(|off| off.len() >= MIN_VIEWS);
    is_enough.then(|| (0..bands).map(of_band).sum::<f64>() / bands as f64)
}

/// Log of light over a model, backscatter removed with a soft floor.
pub fn corrected(log_light: Bands, log_direct: Bands, scattered: Bands) -> Bands {
    std::array::from_fn(|b| {
        let light = (log_light[b] - log_direct[b]).exp() as f32;
        let scattered = (scattered[b] / log_direct[b].exp()) as f32;
        f64::from(limited::without_backscatter(light, scattered, 1.0).max(1e-9).ln())
    })
}

/// The same with colour limited by signal to noise, as pass two does.
pub fn as_shown(log_light: Bands, log_direct: Bands, scattered: Bands, regions: &Regions) -> Bands {
    let value = corrected(log_light, log_direct, scattered);
    let noise = |b: usize| regions.noise.hypot(limited::EMPIRICAL_BACKSCATTER_ERROR * scattered[b]);
    let weights: [f32; 3] = std::array::from_fn(|b| {
        limited::weight(log_direct[b].exp(), noise(b), SIGNAL_TO_NOISE) as f32
    });
    let mut pixel = value.map(|v| v.exp() as f32);
    limited::shrink(&mut pixel[..regions.bands], &weights[..regions.bands], &[1.0; 3]);
    pixel.map(|v| f64::from(v.max(1e-4)).ln())
}

/// Corrected log light of a sample of a frame.
pub type Value<'v> = dyn Fn(usize, &RegionSample) -> Option<Bands> + Sync + 'v;

/// Log light of an observation over that of a model.
pub type LogRatio<'v> = dyn Fn(&Observation) -> Option<Bands> + Sync + 'v;

/// Evenness of the regions that did not help to refine a range.
pub fn evenness(
    name: &str,
    regions: &Regions,
    frames: &[usize],
    value: &Value<'_>,
) -> VerdictFigures {
    let of_frame = |f: &usize| {
        let judged = regions.frames[*f].iter().filter(|s| !regions.grid.refines(s.region));
        judged.filter_map(|s| value(*f, s)).collect::<Vec<_>>()
    };
    figures(name, regions.bands, &frames.iter().flat_map(of_frame).collect::<Vec<_>>())
}

pub fn figures(name: &str, bands: usize, colors: &[Bands]) -> VerdictFigures {
    let from_median = |of: &dyn Fn(&Bands) -> f64| {
        let values: Vec<f64> = colors.iter().map(of).collect();
        let middle = stats::median(&values);
        values.into_iter().map(|v| v - middle).collect::<Vec<_>>()
    };
    let green = usize::from(bands == 3);
    let light = stats::robust_std(&from_median(&|c| c[green]));
    let (red, blue) = (from_median(&|c| c[0] - c[1]), from_median(&|c| c[2] - c[1]));
    let is_colour = bands == 3;
    let chroma = stats::robust_std(&red).max(stats::robust_std(&blue));
    let off: Vec<f64> = red.iter().map(|v| v.abs()).collect();
    VerdictFigures {
        name: name.into(),
        chroma: Some(if is_colour { chroma } else { 0.0 }),
        light: (!colors.is_empty()).then_some(light),
        worst: is_colour.then(|| stats::quantile(&off, 0.95)),
        ..VerdictFigures::default()
    }
}

/// Evenness of a form in segments that it was not fitted to.
pub fn held_out(regions: &Regions, form: EmpiricalForm) -> VerdictFigures {
    let nothing = VerdictFigures { name: form.name().into(), ..VerdictFigures::default() };
    if !regions.has_enough(form) {
        return nothing;
    }
    let count = regions.frames.len();
    let rotation = |f: usize| f * SEGMENTS / count % ROTATIONS;
    let mut colors = Vec::new();
    for held_out in 0..ROTATIONS {
        let all = frames_of(regions, MAX_JUDGED, |_| true);
        let (held, kept): (Vec<_>, Vec<_>) =
            all.into_iter().partition(|f| rotation(*f) == held_out);
        let Some(fitted) = fit(regions, &kept, &held, form) else { return nothing };
        for f in held {
            for s in regions.frames[f].iter().filter(|s| !regions.grid.refines(s.region)) {
                let (x, y) = regions.grid.centre(s.region);
                let range_m = s.range_m * fitted.ranges[f].at(x, y);
                let (direct, scattered) = fitted.model.light(x, y, range_m);
                let gain = fitted.log_gains[f];
                let light = std::array::from_fn(|b| s.log_light[b] - gain[b]);
                colors.push(as_shown(light, direct, scattered, regions));
            }
        }
    }
    figures(form.name(), regions.bands, &colors)
}
