//! Does the correction help? Measured on frames that the model did not see, against raw light and
//! against simpler corrections.
//!
//! Where frames overlap: how well views of one point agree, over the spread between points. Where
//! they do not: how even colour and brightness are over regions of the image and frames. Both where
//! frames overlap and attenuation is not identified: views of one point hardly differ in range
//! then, and what is wrong in the same place of every image does not show. Of full correction, with
//! what it leaves of the light or without, empirical model, mean frame and white balance the first
//! is used that no simpler one is better than.

use std::sync::OnceLock;

use super::Dataset;
use super::methods::empirical::{EmpiricalFit, RegionSample, Regions, fit};
use super::residual_fit::{self, ResidualFit, View};
use super::verdict_figures::{
    EVERY, LogRatio, MAX_JUDGED, agreement, as_shown, corrected, evenness, frames_of, held_out,
    is_held, of_points,
};
use crate::config::{EstimateConfig, Estimator, Switch};
use crate::image::Bands;
use crate::model::{
    BeamGrid, EmpiricalForm, ImagingModel, Removal, Verdict, VerdictFigures, VerdictMeasure,
};
use crate::parallel::par_map;
use crate::solver::{Observation, Problem, Track, sample_path, thinned};
use crate::stats;

/// Most observations that residual light is fitted to. A quarter of them is too few to judge it.
const MOST_FITTED: usize = 40_000;
/// Most frames that an empirical model is fitted to.
const MAX_FITTED: usize = 150;
/// Reweightings of the solve without the held-out frames.
const ROUNDS: usize = 5;
/// A simpler correction is used if it is better by this factor.
const BETTER: f64 = 0.9;
/// What the physical model leaves of the light is used, where attenuation is identified, if
/// agreement is better by this factor with it: where nothing is left, held-out frames agree by 0.97
/// to 1.06.
const LEFT_IDENTIFIED: f64 = 0.85;
/// … and there by this share of the spread between points, too: a part of a per cent of the light.
const LEAST_LEFT: f64 = 0.01;
/// It is fitted in full where a first round makes agreement better by this factor.
const PROMISING: f64 = 0.97;
/// Refined ranges are used if they make both colour and brightness of held-out frames more even by
/// this factor than the given ranges do: otherwise they follow the seafloor.
const BETTER_RANGES: f64 = 0.85;

/// A figure that is larger than that of raw light by this factor and by this much more is worse.
const WORSE: (f64, f64) = (1.1, 0.03);
/// A correction that makes no figure worse is preferred to one whose figure is better by up to this
/// factor.
const NO_HARM: f64 = 1.5;

/// Names of raw light, of full correction, and of the latter with what it leaves of the light.
const RAW: &str = "raw";
const FULL: &str = Verdict::FULL;
const RESIDUAL: &str = "residual";

/// The comparison, and the empirical model where it is better than the physical one.
#[derive(Clone, Debug, Default)]
pub struct Judgement {
    /// the figures; `None` where nothing could be measured
    pub verdict: Option<Verdict>,
    /// used beside the physical model
    pub residual: Option<ResidualFit>,
    /// used instead of the physical model
    pub empirical: Option<EmpiricalFit>,
}

impl Judgement {
    /// Whether attenuation and beam pattern alone correct the frames.
    pub fn is_physical(&self) -> bool {
        self.residual.is_none() && self.empirical.is_none()
    }

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
    /// what the model leaves of the light, once it is fitted
    pub residual: OnceLock<Option<ResidualFit>>,
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
        verdict.figures.retain(|f| has_physical || (f.name != FULL && f.name != RESIDUAL));
        let is_joint = verdict.measure == VerdictMeasure::SamePoint;
        let is_identified = self.is_identified && is_joint;
        let full = verdict.of(FULL).map_or(f64::INFINITY, VerdictFigures::score);
        let raw = verdict.of(RAW).map_or(f64::INFINITY, VerdictFigures::score);
        let leaves_light = self.leaves_light(&verdict, is_identified);
        let physical = if leaves_light { RESIDUAL } else { FULL };
        let residual = || if leaves_light { self.residual().cloned() } else { None };
        if !is_forced && (is_chosen || (is_identified && full <= raw)) {
            verdict.used = physical.into();
            verdict.figures.retain(|f| f.name == RAW || f.name == FULL || f.name == physical);
            return Judgement { verdict: Some(verdict), residual: residual(), empirical: None };
        }
        let form = chosen(&verdict, physical, is_forced);
        let fitted = form.zip(self.regions).and_then(|(form, regions)| {
            let fitted = frames_of(regions, MAX_FITTED, |_| true);
            let others = frames_of(regions, usize::MAX, |f| fitted.binary_search(&f).is_err());
            fit(regions, &fitted, &others, form)
        });
        verdict.used = fitted.as_ref().map_or(physical, |f| f.model.form.name()).into();
        let residual = if fitted.is_none() { residual() } else { None };
        Judgement { verdict: Some(verdict), residual, empirical: fitted }
    }

    /// Whether the physical model leaves light that is worth removing.
    fn leaves_light(&self, verdict: &Verdict, is_identified: bool) -> bool {
        let figures = verdict.of(FULL).zip(verdict.of(RESIDUAL));
        let Some([full, left]) = figures.map(|(a, b)| [a, b].map(VerdictFigures::score)) else {
            return false;
        };
        match self.config.residual_light {
            Switch::Off => false,
            Switch::On => left.is_finite(),
            Switch::Auto if is_identified => {
                left < LEFT_IDENTIFIED * full && left < full - LEAST_LEFT
            }
            // What is not identified has nothing to lose, and overlap leaves directions free
            // (a ramp across the images, gains along the log) that residual light holds.
            Switch::Auto => left < full,
        }
    }

    /// Agreement of the same point; `None` where too few points are seen again.
    fn by_agreement(&self) -> Option<Verdict> {
        let (data, bands) = (self.data, self.data.bands());
        let color = |o: &Observation| o.sample.log_color.map(f64::from);
        let raw = agreement(data.raw_tracks(), bands, &|o| Some(color(o)))?;
        let is_joint = self.estimator == Estimator::Joint;
        let refitted = is_joint.then(|| self.refitted()).flatten();
        let (full, left) = refitted.unwrap_or_else(|| self.physical(&self.by_model()));
        let mut figures =
            vec![of_points(RAW, Some(raw)), of_points(FULL, full), of_points(RESIDUAL, left)];
        let is_forced = self.config.estimator == Estimator::Empirical;
        let is_needed = is_forced || !self.is_identified || full.is_none_or(|f| f > raw);
        if let Some(regions) = self.regions.filter(|_| is_needed) {
            let kept = frames_of(regions, MAX_JUDGED, |f| !is_held(f as u32));
            let held = frames_of(regions, usize::MAX, |f| is_held(f as u32));
            let of_form = |form: EmpiricalForm| {
                let fitted = regions.has_enough(form).then(|| fit(regions, &kept, &held, form));
                let agrees = fitted.flatten().and_then(|fitted| {
                    let value = |o: &Observation| {
                        let (x, y, range_m) = data.ray(&o.sample);
                        let frame = o.frame as usize;
                        let (light, gain) = (color(o), fitted.log_gains[frame]);
                        let light = std::array::from_fn(|b| light[b] - gain[b]);
                        let factor = fitted.ranges[frame].at(x, y);
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

    /// Log light over that of the model.
    fn by_model(&self) -> impl Fn(&Observation) -> Option<Bands> + Sync {
        let (model, data) = (self.model.without_daylight(), *self.data);
        move |o| {
            let predicted = model.log_radiance(&data.path(o)?, Removal::FULL);
            Some(std::array::from_fn(|b| f64::from(o.sample.log_color[b]) - predicted[b]))
        }
    }

    /// Agreement by log light over that of a model, without and with the residual light of the
    /// frames that are not held out.
    fn physical(&self, log_ratio: &LogRatio<'_>) -> (Option<f64>, Option<f64>) {
        let (data, bands) = (self.data, self.data.bands());
        let full = agreement(data.tracks, bands, log_ratio);
        let left = |rounds: usize| {
            let light = self.residual_of(log_ratio, |f| !is_held(f), rounds)?.light;
            let value = |o: &Observation| {
                let (x, y, range_m) = data.ray(&o.sample);
                let (ratio, left) = (log_ratio(o)?, light.log_light(x, y, range_m));
                Some(std::array::from_fn(|b| ratio[b] - left[b]))
            };
            agreement(data.tracks, bands, &value)
        };
        // Where one round explains nothing, more do not: they only weigh what it leaves.
        let first = left(1);
        let has_promise = full.zip(first).is_none_or(|(full, first)| first < PROMISING * full);
        (full, if has_promise { left(residual_fit::ROUNDS) } else { first })
    }

    /// What a model leaves of the light of some frames.
    fn residual_of(
        &self,
        log_ratio: &LogRatio<'_>,
        wanted: impl Fn(u32) -> bool + Sync,
        rounds: usize,
    ) -> Option<ResidualFit> {
        let data = self.data;
        if self.config.residual_light == Switch::Off {
            return None;
        }
        let view = |o: &Observation| {
            let (x, y, range_m) = data.ray(&o.sample);
            let log_ratio = log_ratio(o).filter(|ratio| ratio.iter().all(|v| v.is_finite()))?;
            Some(View { place: (x, y), range_m, log_ratio })
        };
        let of_track = |t: &Track| t.iter().filter(|o| wanted(o.frame)).filter_map(view).collect();
        let points = par_map(thinned(data.tracks, MOST_FITTED).iter().collect(), of_track);
        residual_fit::fit(&points, data.frames.len(), data.bands(), rounds)
    }

    /// What the model leaves of the light.
    fn residual(&self) -> Option<&ResidualFit> {
        let fitted = || self.residual_of(&self.by_model(), |_| true, residual_fit::ROUNDS);
        self.residual.get_or_init(fitted).as_ref()
    }

    /// Agreement by the joint solve without the held-out frames, as `physical`.
    fn refitted(&self) -> Option<(Option<f64>, Option<f64>)> {
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
        let ratio = |o: &Observation| {
            Some(problem.reflectance_by(&solution, o, data.lamps, &sample_path)?.0)
        };
        let (full, left) = self.physical(&ratio);
        full.map(|full| (Some(full), left))
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
        let physical = |f: usize, s: &RegionSample, left: Bands| {
            let predicted = predicted[f][s.region]?;
            let direct = std::array::from_fn(|b| predicted[b] + left[b] + reflectance[b]);
            Some(as_shown(s.log_light, direct, [0.0; 3], regions))
        };
        let full = evenness(FULL, regions, &all, &|f, s| physical(f, s, [0.0; 3]));
        let left = self.residual().map(|ResidualFit { light, .. }| {
            evenness(RESIDUAL, regions, &all, &|f, s| {
                let (x, y) = regions.grid.centre(s.region);
                physical(f, s, light.log_light(x, y, s.range_m))
            })
        });
        let of_form = |form: EmpiricalForm| held_out(regions, form);
        let forms = par_map(EmpiricalForm::ALL.to_vec(), of_form);
        let figures = [raw, full].into_iter().chain(left).chain(forms).collect();
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
fn chosen(verdict: &Verdict, physical: &str, is_forced: bool) -> Option<EmpiricalForm> {
    let measured = |name: &str| verdict.of(name).map_or(f64::INFINITY, VerdictFigures::score);
    let does_harm = |name: &str| is_worse_than_raw(verdict, name, WORSE);
    let harmless = |name: &str| if does_harm(name) { f64::INFINITY } else { measured(name) };
    let names = || EmpiricalForm::ALL.map(EmpiricalForm::name).into_iter().chain([physical]);
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
    if !best.is_finite() || (!is_forced && BETTER * score(physical) <= best) {
        return None;
    }
    forms.into_iter().find(|form| BETTER * score(form.name()) <= best)
}

/// Whether a correction makes a figure worse than that of raw light, by a factor and by a share.
fn is_worse_than_raw(verdict: &Verdict, name: &str, (factor, share): (f64, f64)) -> bool {
    let Some((raw, corrected)) = verdict.of(RAW).zip(verdict.of(name)) else { return false };
    let figures = |f: &VerdictFigures| [f.agreement, f.chroma, f.light];
    let is_worse = |(raw, is): (Option<f64>, Option<f64>)| {
        raw.zip(is).is_some_and(|(raw, is)| is > factor * raw + share)
    };
    figures(raw).into_iter().zip(figures(corrected)).any(is_worse)
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
        let choose = |scores: &[(&str, f64, f64)]| chosen(&verdict(scores), FULL, false);
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
