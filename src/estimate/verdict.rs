//! Does the correction help? Measured on frames that the model did not see, against raw light and
//! against simpler corrections.
//!
//! Where frames overlap: how well views of one point agree, over the spread between points. Where
//! they do not: how even colour and brightness are over regions of the image and frames. Both where
//! frames overlap and attenuation is not identified: views of one point hardly differ in range
//! then, and what is wrong in the same place of every image does not show. Of full correction,
//! empirical model, mean frame and white balance the first is used that no simpler one is better
//! than.

use super::Dataset;
use super::methods::empirical::{EmpiricalFit, Regions, fit};
use crate::config::{EstimateConfig, Estimator};
use crate::image::Bands;
use crate::model::{
    BeamGrid, EmpiricalForm, ImagingModel, Removal, Verdict, VerdictFigures, VerdictMeasure,
    limited,
};
use crate::parallel::par_map;
use crate::solver::{Observation, Problem, Track, sample_path};
use crate::stats;

/// One frame in so many is held out, where frames overlap.
const EVERY: u32 = 3;
/// Where they do not: one segment in three, of so many.
const SEGMENTS: usize = 12;
const ROTATIONS: usize = 3;
/// Most frames that an empirical model is fitted to, and that judge it.
const MAX_FITTED: usize = 150;
const MAX_JUDGED: usize = 75;
/// Reweightings of the solve without the held-out frames.
const ROUNDS: usize = 5;
/// Fewest held-out views that measure agreement.
const MIN_VIEWS: usize = 100;
/// A simpler correction is used if it is better by this factor.
const BETTER: f64 = 0.9;
/// Refined ranges are used if they make both colour and brightness of held-out frames more even by
/// this factor than the given ranges do: otherwise they follow the seafloor.
const BETTER_RANGES: f64 = 0.85;
/// The signal-to-noise ratio at which a band has half of its weight.
const SIGNAL_TO_NOISE: f64 = 5.0;

/// A figure that is larger than that of raw light by this factor and by this much more is worse.
const WORSE: (f64, f64) = (1.1, 0.03);
/// A correction that makes no figure worse is preferred to one whose figure is better by up to this
/// factor.
const NO_HARM: f64 = 1.5;

/// Names of raw light and of full correction.
const RAW: &str = "raw";
const FULL: &str = "full";

/// The comparison, and the empirical model where it is better than the physical one.
#[derive(Clone, Debug, Default)]
pub struct Judgement {
    /// the figures; `None` where nothing could be measured
    pub verdict: Option<Verdict>,
    /// used instead of the physical model
    pub empirical: Option<EmpiricalFit>,
}

impl Judgement {
    /// The figure of what is used; infinite where nothing was measured.
    pub fn score(&self) -> f64 {
        let used = |v: &Verdict| v.of(&v.used).map(VerdictFigures::score);
        self.verdict.as_ref().and_then(used).unwrap_or(f64::INFINITY)
    }
}

/// What is judged.
pub struct Case<'c> {
    /// samples and tracks without gains and backscatter
    pub data: &'c Dataset<'c>,
    /// light of regions, without gains
    pub regions: Option<&'c Regions>,
    /// the physical model
    pub model: &'c ImagingModel,
    /// the estimator it comes from
    pub estimator: Estimator,
    /// whether its attenuation is identified
    pub is_identified: bool,
    /// the settings
    pub config: &'c EstimateConfig,
}

impl Case<'_> {
    /// Compares the corrections and chooses one.
    pub fn judge(&self) -> Judgement {
        let is_chosen = !matches!(self.config.estimator, Estimator::Auto | Estimator::Empirical);
        let has_physical = self.estimator != Estimator::Empirical;
        let is_forced = self.config.estimator == Estimator::Empirical || !has_physical;
        let Some(mut verdict) = self.by_agreement().or_else(|| self.by_evenness()) else {
            return Judgement::default();
        };
        verdict.figures.retain(|f| has_physical || f.name != FULL);
        let is_joint = verdict.measure == VerdictMeasure::SamePoint;
        let is_identified = self.is_identified && is_joint;
        let full = verdict.of(FULL).map_or(f64::INFINITY, VerdictFigures::score);
        let raw = verdict.of(RAW).map_or(f64::INFINITY, VerdictFigures::score);
        if !is_forced && (is_chosen || (is_identified && full <= raw)) {
            verdict.used = FULL.into();
            verdict.figures.retain(|f| f.name == RAW || f.name == FULL);
            return Judgement { verdict: Some(verdict), empirical: None };
        }
        let form = chosen(&verdict, is_forced);
        let fitted = form.zip(self.regions).and_then(|(form, regions)| {
            let fitted = frames_of(regions, MAX_FITTED, |_| true);
            let others = frames_of(regions, usize::MAX, |f| fitted.binary_search(&f).is_err());
            fit(regions, &fitted, &others, form)
        });
        verdict.used = fitted.as_ref().map_or(FULL, |f| f.model.form.name()).into();
        Judgement { verdict: Some(verdict), empirical: fitted }
    }

    /// Agreement of the same point; `None` where too few points are seen again.
    fn by_agreement(&self) -> Option<Verdict> {
        let (data, bands) = (self.data, self.data.bands());
        let color = |o: &Observation| o.sample.log_color.map(f64::from);
        let raw = agreement(data.raw_tracks(), bands, &|o| Some(color(o)))?;
        let model = self.model.without_daylight();
        let by_model = |o: &Observation| {
            let predicted = model.log_radiance(&data.path(o)?, Removal::FULL);
            Some(std::array::from_fn(|b| color(o)[b] - predicted[b]))
        };
        let is_joint = self.estimator == Estimator::Joint;
        let full = is_joint.then(|| self.refitted()).flatten();
        let full = full.or_else(|| agreement(data.tracks, bands, &by_model));
        let mut figures = vec![of_points(RAW, Some(raw)), of_points(FULL, full)];
        let is_needed = !self.is_identified || full.is_none_or(|f| f > raw);
        if let Some(regions) = self.regions.filter(|_| is_needed) {
            let kept = frames_of(regions, MAX_JUDGED, |f| !is_held(f as u32));
            let held = frames_of(regions, usize::MAX, |f| is_held(f as u32));
            let of_form = |form: EmpiricalForm| {
                let fitted = regions.has_enough(form).then(|| fit(regions, &kept, &held, form));
                let agrees = fitted.flatten().and_then(|fitted| {
                    let value = |o: &Observation| {
                        let (x, y, range_m) = data.ray(&o.sample);
                        let light = color(o).map(|v| v - fitted.log_gains[o.frame as usize]);
                        let factor = fitted.log_ranges[o.frame as usize].exp();
                        let (direct, scattered) = fitted.model.light(x, y, range_m * factor);
                        Some(corrected(light, direct, scattered))
                    };
                    agreement(data.raw_tracks(), bands, &value)
                });
                of_points(form.name(), agrees)
            };
            figures.extend(par_map(EmpiricalForm::ALL.to_vec(), of_form));
        }
        let frames = data.frames.len() / EVERY as usize;
        let even = if is_needed { self.by_evenness() } else { None };
        if let Some(even) = even {
            let both = |f: VerdictFigures| {
                let of_evenness = even.of(&f.name);
                f.with_evenness(of_evenness)
            };
            figures = figures.into_iter().map(both).collect();
        }
        Some(Verdict { measure: VerdictMeasure::SamePoint, used: String::new(), frames, figures })
    }

    /// Agreement by the joint solve without the held-out frames.
    fn refitted(&self) -> Option<f64> {
        let (data, config) = (self.data, self.config);
        let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
        // Gains that were found are removed; a held-out frame determines none.
        let setup = data.setup(grid, config).without_gains();
        let kept: Vec<Track> = data
            .tracks
            .iter()
            .map(|t| t.iter().filter(|o| !is_held(o.frame)).copied().collect())
            .collect();
        let mut problem = Problem::new(&kept, &setup, data.lamps, &sample_path)?;
        let solution = problem.solve(ROUNDS)?;
        agreement(data.tracks, setup.bands, &|o| {
            Some(problem.reflectance_by(&solution, o, data.lamps, &sample_path)?.0)
        })
    }

    /// Evenness over regions and frames.
    fn by_evenness(&self) -> Option<Verdict> {
        let regions = self.regions.filter(|r| r.has_enough(EmpiricalForm::FrameAverage))?;
        let all = frames_of(regions, MAX_JUDGED, |_| true);
        let raw = evenness(RAW, regions, &all, &|_, s| Some(s.log_light));
        let model = self.model;
        let predicted = self.predicted(regions, model);
        let reflectance: Bands = std::array::from_fn(|b| {
            let of = |f: &usize| {
                let samples = regions.frames[*f].iter();
                let off = |p: &Option<Bands>, s: f64| p.map(|p| s - p[b]);
                samples.filter_map(|s| off(&predicted[*f][s.region], s.log_light[b])).collect()
            };
            stats::median(&all.iter().flat_map(|f| -> Vec<f64> { of(f) }).collect::<Vec<_>>())
        });
        let full = evenness(FULL, regions, &all, &|f, s| {
            let predicted = predicted[f][s.region]?;
            let direct = std::array::from_fn(|b| predicted[b] + reflectance[b]);
            Some(as_shown(s.log_light, direct, [0.0; 3], regions))
        });
        let of_form = |form: EmpiricalForm| held_out(regions, form);
        let forms = par_map(EmpiricalForm::ALL.to_vec(), of_form);
        let figures = [raw, full].into_iter().chain(forms).collect();
        let frames = all.len();
        Some(Verdict { measure: VerdictMeasure::Evenness, used: String::new(), frames, figures })
    }

    /// Mean log light of white seafloor by the physical model, per frame and region.
    fn predicted(&self, regions: &Regions, model: &ImagingModel) -> Vec<Vec<Option<Bands>>> {
        let data = self.data;
        let of_frame = |frame: &super::FrameSamples| {
            regions.grid.means(frame.grid.iter().chain(&frame.dark).filter_map(|(_, sample)| {
                let (x, y, _) = data.ray(sample);
                let light = model.log_radiance(&sample.path(data.lamps)?, Removal::FULL);
                Some(((x, y), light))
            }))
        };
        data.frames.iter().map(of_frame).collect()
    }
}

/// The first form, or the physical model (`None`), that no simpler one is better than.
fn chosen(verdict: &Verdict, is_forced: bool) -> Option<EmpiricalForm> {
    let measured = |name: &str| verdict.of(name).map_or(f64::INFINITY, VerdictFigures::score);
    let harmless =
        |name: &str| if does_harm(verdict, name) { f64::INFINITY } else { measured(name) };
    let names = || EmpiricalForm::ALL.map(EmpiricalForm::name).into_iter().chain([FULL]);
    let best_of = |score: &dyn Fn(&str) -> f64| names().map(score).fold(f64::INFINITY, f64::min);
    let has_harmless = best_of(&harmless) <= NO_HARM * best_of(&measured);
    let score = |name: &str| if has_harmless { harmless(name) } else { measured(name) };
    let mut forms = EmpiricalForm::ALL.to_vec();
    let ranges_help = || {
        let [refined, given, simple] =
            [EmpiricalForm::Ranges, EmpiricalForm::Backscatter, EmpiricalForm::Range]
                .map(|form| verdict.of(form.name()));
        let refined = refined?;
        let is_better = |of: &dyn Fn(&VerdictFigures) -> Option<f64>| {
            let others = [given, simple].into_iter().flatten().filter_map(of);
            of(refined).is_some_and(|v| v <= BETTER_RANGES * others.fold(f64::INFINITY, f64::min))
        };
        let is_even = is_better(&|f| f.chroma) && is_better(&|f| f.light);
        Some(if refined.agreement.is_some() { is_better(&|f| f.agreement) } else { is_even })
    };
    if ranges_help() != Some(true) {
        forms.retain(|form| *form != EmpiricalForm::Ranges);
    }
    let best = forms.iter().map(|form| score(form.name())).fold(f64::INFINITY, f64::min);
    if !best.is_finite() || (!is_forced && BETTER * score(FULL) <= best) {
        return None;
    }
    forms.into_iter().find(|form| BETTER * score(form.name()) <= best)
}

/// Whether a correction makes a figure worse than that of raw light.
fn does_harm(verdict: &Verdict, name: &str) -> bool {
    let Some((raw, corrected)) = verdict.of(RAW).zip(verdict.of(name)) else { return false };
    let figures = |f: &VerdictFigures| [f.agreement, f.chroma, f.light];
    let is_worse = |(raw, is): (Option<f64>, Option<f64>)| {
        raw.zip(is).is_some_and(|(raw, is)| is > WORSE.0 * raw + WORSE.1)
    };
    figures(raw).into_iter().zip(figures(corrected)).any(is_worse)
}

fn is_held(frame: u32) -> bool {
    frame % EVERY == EVERY - 1
}

/// Frames of a kind, evenly spread if there are more than `most`.
fn frames_of(regions: &Regions, most: usize, wanted: impl Fn(usize) -> bool) -> Vec<usize> {
    let frames: Vec<usize> = (0..regions.frames.len()).filter(|f| wanted(*f)).collect();
    let every = frames.len().div_ceil(most).max(1);
    frames.into_iter().step_by(every).collect()
}

fn of_points(name: &str, agreement: Option<f64>) -> VerdictFigures {
    VerdictFigures { name: name.into(), agreement, ..VerdictFigures::default() }
}

/// Robust spread of held-out views about the mean of the other views of their point, over the
/// robust spread of the points; mean of the bands.
fn agreement(
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
fn corrected(log_light: Bands, log_direct: Bands, scattered: Bands) -> Bands {
    std::array::from_fn(|b| {
        let light = (log_light[b] - log_direct[b]).exp() as f32;
        let scattered = (scattered[b] / log_direct[b].exp()) as f32;
        f64::from(limited::without_backscatter(light, scattered, 1.0).max(1e-9).ln())
    })
}

/// The same with colour limited by signal to noise, as pass two does.
fn as_shown(log_light: Bands, log_direct: Bands, scattered: Bands, regions: &Regions) -> Bands {
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
type Value<'v> =
    dyn Fn(usize, &super::methods::empirical::RegionSample) -> Option<Bands> + Sync + 'v;

/// Evenness of the regions that did not help to refine a range.
fn evenness(name: &str, regions: &Regions, frames: &[usize], value: &Value<'_>) -> VerdictFigures {
    let of_frame = |f: &usize| {
        let judged = regions.frames[*f].iter().filter(|s| !regions.grid.refines(s.region));
        judged.filter_map(|s| value(*f, s)).collect::<Vec<_>>()
    };
    figures(name, regions.bands, &frames.iter().flat_map(of_frame).collect::<Vec<_>>())
}

fn figures(name: &str, bands: usize, colors: &[Bands]) -> VerdictFigures {
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
fn held_out(regions: &Regions, form: EmpiricalForm) -> VerdictFigures {
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
                let range_m = s.range_m * fitted.log_ranges[f].exp();
                let (direct, scattered) = fitted.model.light(x, y, range_m);
                let light = s.log_light.map(|v| v - fitted.log_gains[f]);
                colors.push(as_shown(light, direct, scattered, regions));
            }
        }
    }
    figures(form.name(), regions.bands, &colors)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(scores: &[(&str, f64, f64)]) -> Verdict {
        let of = |(name, chroma, light): &(&str, f64, f64)| VerdictFigures {
            name: String::from(*name),
            chroma: Some(*chroma),
            light: Some(*light),
            ..VerdictFigures::default()
        };
        Verdict { figures: scores.iter().map(of).collect(), ..Verdict::default() }
    }

    #[test]
    fn the_first_correction_that_no_simpler_one_is_better_than_is_used() {
        use EmpiricalForm as F;
        let choose = |scores: &[(&str, f64, f64)]| chosen(&verdict(scores), false);
        let raw = ("raw", 0.5, 1.0);
        assert_eq!(choose(&[raw, ("full", 0.1, 0.1), ("backscatter", 0.1, 0.1)]), None);
        // A wrong model is worse than any other.
        let wrong = ("full", 0.9, 0.6);
        let backscatter = ("backscatter", 0.2, 0.2);
        assert_eq!(choose(&[raw, wrong, backscatter]), Some(F::Backscatter));
        assert_eq!(
            choose(&[raw, wrong, backscatter, ("frame-average", 0.1, 0.1)]),
            Some(F::FrameAverage)
        );
        assert_eq!(choose(&[raw, wrong, ("white-balance", 0.4, 0.6)]), Some(F::WhiteBalance));
        // Refined ranges have to make colour more even, too.
        assert_eq!(
            choose(&[raw, wrong, ("ranges", 0.19, 0.01), backscatter]),
            Some(F::Backscatter)
        );
        assert_eq!(choose(&[raw, wrong, ("ranges", 0.1, 0.01), backscatter]), Some(F::Ranges));
        // Better on the whole, and worse than raw in colour; unless nothing else comes near.
        let tinted = ("full", 0.6, 0.1);
        assert_eq!(choose(&[raw, tinted, ("range", 0.4, 0.32)]), Some(F::Range));
        assert_eq!(choose(&[raw, tinted, ("range", 0.4, 0.9)]), None);
    }
}
