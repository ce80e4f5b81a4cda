//! The fit of an empirical model: per region and band a, b and log B by robust Gauss-Newton steps
//! on log light, held to the mean of the neighbouring regions, so that they are smooth over the
//! image; and per frame a factor of all slant ranges, its tilt, and a gain where a lamp failed.

use nalgebra::{Matrix3, Vector3};

use super::regions::{RegionSample, Regions, rounded};
use crate::image::Bands;
use crate::model::{EmpiricalForm, EmpiricalModel, RangeFactor, RegionLight};
use crate::parallel::par_map;
use crate::stats;

/// Sweeps over all regions.
const SWEEPS: usize = 26;
/// Weights that hold a, b and log B to the mean of the neighbours, for fifty frames.
const SMOOTHNESS: [f64; 3] = [10.0, 500.0, 10.0];
/// Weights that hold them to the median of the image.
const COMMON: [f64; 3] = [0.0, 1.0, 0.5];
/// Smallest robust spread of log light.
const MIN_SPREAD: f64 = 0.05;
/// Damping of a step, and its largest size.
const DAMPING: f64 = 0.8;
const MAX_STEP: f64 = 0.5;
/// Spread of the log factor of a frame's slant ranges, and of its tilt by x and y of the image
/// plane (a few degrees in an oblique view); independent regions of a frame.
const RANGE_SPREAD: [f64; 3] = [0.2, 0.2, 0.2];
const INDEPENDENT_REGIONS: f64 = 60.0;
/// A plane explains the light of a frame if it leaves at most this many times what is left of other
/// frames. Where a lamp failed it does not, and would tint what is dark.
const UNEXPLAINED: f64 = 3.0;
/// Steps for a frame that the model was not fitted to.
const RANGE_STEPS: usize = 8;
/// A frame got another amount of light where its log gain exceeds this, and so many spreads.
const STANDS_OUT: f64 = 0.3;
const SPREADS: f64 = 5.0;
/// log B where there is no backscatter.
const NONE: f64 = -30.0;

/// A model with what was estimated for single frames.
#[derive(Clone, Debug)]
pub struct EmpiricalFit {
    /// the model
    pub model: EmpiricalModel,
    /// per frame: of its slant ranges
    pub ranges: Vec<RangeFactor>,
    /// per frame and band: log of its light over the others', 0 but where a lamp failed
    pub log_gains: Vec<Bands>,
    /// robust spread of the residuals (log light), largest of the bands
    pub residual: f64,
    /// light regions that were fitted
    pub observations: usize,
}

/// a, b, log B of one region.
type Parameters = [f64; 3];

/// The state of the fit.
struct Fit<'r> {
    regions: &'r Regions,
    /// indices of frames
    frames: &'r [usize],
    form: EmpiricalForm,
    reference_m: f64,
    /// per band and region
    parameters: Vec<Vec<Parameters>>,
    /// per band and region: log of a dark quantile of its light, the most that log B may be
    darkest: Vec<Vec<f64>>,
    ranges: Vec<RangeFactor>,
    log_gains: Vec<Bands>,
    spreads: Bands,
}

/// Fits a form to some frames of a log; `None` where they see nothing. `held` are frames whose
/// ranges are estimated with the model as it is, from a part of their regions.
pub fn fit(
    regions: &Regions,
    frames: &[usize],
    held: &[usize],
    form: EmpiricalForm,
) -> Option<EmpiricalFit> {
    let mut fit = Fit::new(regions, frames, form)?;
    if form != EmpiricalForm::WhiteBalance {
        for sweep in 0..SWEEPS {
            fit.sweep();
            if form == EmpiricalForm::Ranges && sweep >= 4 {
                fit.refine_ranges(&|_| true);
                fit.centre_ranges();
            }
            if sweep % 5 == 4 {
                fit.find_gains();
            }
        }
    }
    let typical = stats::median(&frames.iter().map(|f| fit.left_of(*f)).collect::<Vec<_>>());
    if form == EmpiricalForm::Ranges {
        fit.give_up_unexplained(typical, &|_| true);
    }
    let mut found = fit.finish();
    if form == EmpiricalForm::Ranges && !held.is_empty() {
        let refines = |region| regions.grid.refines(region);
        let mut of_held = Fit { frames: held, ..fit };
        for _ in 0..RANGE_STEPS {
            of_held.refine_ranges(&refines);
        }
        of_held.give_up_unexplained(typical, &refines);
        for f in held {
            (found.ranges[*f], found.log_gains[*f]) = (of_held.ranges[*f], of_held.log_gains[*f]);
        }
    }
    Some(found)
}

/// Light of one region by its parameters: direct light and backscatter.
fn light(p: &Parameters, beyond_m: f64) -> (f64, f64) {
    ((p[0] - p[1] * beyond_m).exp(), p[2].exp())
}

impl<'r> Fit<'r> {
    fn new(regions: &'r Regions, frames: &'r [usize], form: EmpiricalForm) -> Option<Self> {
        let all = || frames.iter().flat_map(|f| &regions.frames[*f]);
        let reference_m = stats::median(&all().map(|s| s.range_m).collect::<Vec<_>>());
        if !reference_m.is_finite() {
            return None;
        }
        let count = regions.grid.columns * regions.grid.rows;
        let (mut parameters, mut darkest) = (Vec::new(), Vec::new());
        for b in 0..regions.bands {
            let mut by_region = vec![Vec::new(); count];
            all().for_each(|s| by_region[s.region].push(s.log_light[b]));
            let every: Vec<f64> = all().map(|s| s.log_light[b]).collect();
            let level = |values: &Vec<f64>, share: f64| {
                let few = values.is_empty() || form == EmpiricalForm::WhiteBalance;
                stats::quantile(if few { &every } else { values }, share)
            };
            let low: Vec<f64> = by_region.iter().map(|v| level(v, 0.1)).collect();
            let start = |(values, low): (&Vec<f64>, &f64)| {
                let has_slope = form <= EmpiricalForm::Range;
                let slope = if has_slope { 0.5 } else { 0.0 };
                let scattered = if form <= EmpiricalForm::Backscatter { low - 1.2 } else { NONE };
                [level(values, 0.5), slope, scattered]
            };
            parameters.push(by_region.iter().zip(&low).map(start).collect());
            darkest.push(low);
        }
        let ranges = vec![RangeFactor::default(); regions.frames.len()];
        let log_gains = vec![[0.0; 3]; regions.frames.len()];
        let spreads = [0.2; 3];
        Some(Self {
            regions,
            frames,
            form,
            reference_m,
            parameters,
            darkest,
            ranges,
            log_gains,
            spreads,
        })
    }

    /// How far a sample lies beyond the reference (m).
    fn beyond_m(&self, frame: usize, sample: &RegionSample) -> f64 {
        let (x, y) = self.regions.grid.centre(sample.region);
        sample.range_m * self.ranges[frame].at(x, y) - self.reference_m
    }

    /// Residual, derivatives by a, b and log B, and weight of a sample in a band.
    fn row(&self, frame: usize, s: &RegionSample, b: usize) -> (f64, Vector3<f64>, f64) {
        let beyond_m = self.beyond_m(frame, s);
        let (direct, scattered) = light(&self.parameters[b][s.region], beyond_m);
        let total = direct + scattered;
        let residual = s.log_light[b] - self.log_gains[frame][b] - total.ln();
        let share = direct / total;
        let row = Vector3::new(share, -share * beyond_m, scattered / total);
        let relative_noise = self.regions.noise / s.log_light[b].exp() / self.spreads[b];
        if !residual.is_finite() {
            return (f64::NAN, Vector3::zeros(), 0.0);
        }
        let weight = stats::cauchy_weight(residual, self.spreads[b])
            / (self.spreads[b].powi(2) * (1.0 + relative_noise.powi(2)));
        (residual, row, weight)
    }

    /// One step of all regions.
    fn sweep(&mut self) {
        let this = &*self;
        let stepped = par_map((0..this.regions.bands).collect(), |b| this.stepped(b));
        for (b, (parameters, spread)) in stepped.into_iter().enumerate() {
            self.parameters[b] = parameters;
            self.spreads[b] = spread;
        }
    }

    /// Parameters of a band after a step, and the spread of its residuals before.
    fn stepped(&self, b: usize) -> (Vec<Parameters>, f64) {
        let before = &self.parameters[b];
        let mut systems = vec![(Matrix3::<f64>::zeros(), Vector3::<f64>::zeros()); before.len()];
        let mut residuals = Vec::new();
        for frame in self.frames {
            for s in &self.regions.frames[*frame] {
                let (residual, row, weight) = self.row(*frame, s, b);
                if weight == 0.0 {
                    continue;
                }
                let (normal, right) = &mut systems[s.region];
                *normal += row * row.transpose() * weight;
                *right += row * (weight * residual);
                residuals.push(residual);
            }
        }
        let free = match self.form {
            EmpiricalForm::Ranges | EmpiricalForm::Backscatter => 3,
            EmpiricalForm::Range => 2,
            _ => 1,
        };
        let median = |k: usize| stats::median(&before.iter().map(|p| p[k]).collect::<Vec<_>>());
        let common = [0.0, median(1), median(2)];
        let scale = self.frames.len() as f64 / 50.0;
        let mut after = before.clone();
        for (region, (normal, right)) in systems.iter_mut().enumerate() {
            let (mut sum, mut n) = ([0.0; 3], 0.0);
            for near in self.regions.grid.neighbours(region) {
                (0..3).for_each(|k| sum[k] += before[near][k]);
                n += 1.0;
            }
            for k in 0..3 {
                if k >= free {
                    normal[(k, k)] += 1e12;
                    continue;
                }
                let smooth = SMOOTHNESS[k] * scale;
                normal[(k, k)] += smooth + COMMON[k];
                right[k] += smooth * (sum[k] / n - before[region][k])
                    + COMMON[k] * (common[k] - before[region][k]);
            }
            let Some(factor) = normal.cholesky() else { continue };
            let step = factor.solve(right);
            for k in 0..free {
                after[region][k] += DAMPING * step[k].clamp(-MAX_STEP, MAX_STEP);
            }
            after[region][2] = after[region][2].min(self.darkest[b][region]);
        }
        (after, stats::robust_std(&residuals).max(MIN_SPREAD))
    }

    /// One step of the factors of slant ranges.
    fn refine_ranges(&mut self, is_used: &dyn Fn(usize) -> bool) {
        let step = |frame: usize| {
            let samples: Vec<_> =
                self.regions.frames[frame].iter().filter(|s| is_used(s.region)).collect();
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for s in &samples {
                let (x, y) = self.regions.grid.centre(s.region);
                let range_m = self.beyond_m(frame, s) + self.reference_m;
                for b in 0..self.regions.bands {
                    let (residual, row, weight) = self.row(frame, s, b);
                    if weight == 0.0 {
                        continue;
                    }
                    let by_range = -row[0] * self.parameters[b][s.region][1] * range_m;
                    let row = Vector3::new(1.0, x, y) * by_range;
                    normal += row * row.transpose() * weight;
                    right += row * (weight * residual);
                }
            }
            let share = (INDEPENDENT_REGIONS / samples.len().max(1) as f64).min(1.0);
            let hold = Vector3::from(RANGE_SPREAD).map(|spread| spread.powi(-2));
            let RangeFactor { log_factor, log_tilt: [by_x, by_y], .. } = self.ranges[frame];
            let right = right * share - hold.component_mul(&Vector3::new(log_factor, by_x, by_y));
            let factor = (normal * share + Matrix3::from_diagonal(&hold)).cholesky();
            factor.map_or(Vector3::zeros(), |f| f.solve(&right).map(|v| v.clamp(-0.3, 0.3)))
        };
        let steps: Vec<Vector3<f64>> = self.frames.iter().map(|f| step(*f)).collect();
        for (frame, step) in self.frames.iter().zip(steps) {
            let RangeFactor { log_factor, log_tilt, .. } = &mut self.ranges[*frame];
            *log_factor += step[0];
            (0..2).for_each(|k| log_tilt[k] += step[k + 1]);
        }
    }

    /// Robust spread of the residuals of a frame.
    fn left_of(&self, frame: usize) -> f64 {
        let of_sample = |s| (0..self.regions.bands).map(move |b| self.row(frame, s, b).0);
        let residuals: Vec<f64> = self.regions.frames[frame].iter().flat_map(of_sample).collect();
        stats::robust_std(&residuals)
    }

    /// Frames whose light no plane explains get a gain instead, of each band: what light there is
    /// comes by another way through the water.
    fn give_up_unexplained(&mut self, typical: f64, is_used: &dyn Fn(usize) -> bool) {
        for frame in self.frames {
            if self.left_of(*frame) > UNEXPLAINED * typical {
                self.ranges[*frame] =
                    RangeFactor { is_unexplained: true, ..RangeFactor::default() };
                self.log_gains[*frame] = self.gains_of_bands(*frame, is_used);
            }
        }
    }

    /// Log gain of a frame, and of each band over that where the light is nearest to it.
    fn gains_of_bands(&self, frame: usize, is_used: &dyn Fn(usize) -> bool) -> Bands {
        let (gain, bands) = (self.lit_gain(frame, is_used), self.regions.bands);
        let gains = &self.log_gains[frame];
        let of_sample = |s: &RegionSample| -> (f64, Bands) {
            let log: Bands = std::array::from_fn(|b| {
                if b < bands { self.row(frame, s, b).0 + gains[b] } else { 0.0 }
            });
            let mean = log[..bands].iter().sum::<f64>() / bands as f64;
            ((mean - gain).abs(), log.map(|of_band| of_band - mean))
        };
        let samples = self.regions.frames[frame].iter().filter(|s| is_used(s.region));
        let mut own: Vec<(f64, Bands)> = samples.map(of_sample).collect();
        own.sort_by(|a, b| a.0.total_cmp(&b.0));
        own.truncate(own.len().div_ceil(2));
        let of_band = |b: usize| stats::median(&own.iter().map(|(_, v)| v[b]).collect::<Vec<_>>());
        std::array::from_fn(|b| if b < bands { gain + of_band(b) } else { 0.0 })
    }

    /// The median frame keeps its slant ranges.
    fn centre_ranges(&mut self) {
        let middle = |of: &dyn Fn(&RangeFactor) -> f64| {
            stats::median(&self.frames.iter().map(|f| of(&self.ranges[*f])).collect::<Vec<_>>())
        };
        let middle = RangeFactor {
            log_factor: middle(&|r| r.log_factor),
            log_tilt: [middle(&|r| r.log_tilt[0]), middle(&|r| r.log_tilt[1])],
            is_unexplained: false,
        };
        for frame in self.frames {
            let RangeFactor { log_factor, log_tilt, .. } = &mut self.ranges[*frame];
            *log_factor -= middle.log_factor;
            (0..2).for_each(|k| log_tilt[k] -= middle.log_tilt[k]);
        }
    }

    /// Log gain of a frame by its regions.
    fn lit_gain(&self, frame: usize, is_used: &dyn Fn(usize) -> bool) -> f64 {
        let gains = &self.log_gains[frame];
        let bands = self.regions.bands;
        let of_sample = |s| (0..bands).map(move |b| self.row(frame, s, b).0 + gains[b]);
        let samples = self.regions.frames[frame].iter().filter(|s| is_used(s.region));
        let residuals: Vec<f64> = samples.flat_map(of_sample).collect();
        // Where one of several lamps fails, the part that is lit should be right.
        let [low, high] = [0.25, 0.75].map(|share| stats::quantile(&residuals, share));
        if low.abs() < high.abs() { low } else { high }
    }

    /// Gains of the frames that stand out.
    fn find_gains(&mut self) {
        let gain = |f: &usize| self.lit_gain(*f, &|_| true);
        let gains: Vec<f64> = self.frames.iter().map(gain).collect();
        let middle = stats::median(&gains);
        let off: Vec<f64> = gains.iter().map(|g| g - middle).collect();
        let limit = STANDS_OUT.max(SPREADS * stats::robust_std(&off));
        for (frame, gain) in self.frames.iter().zip(off) {
            self.log_gains[*frame] = [if gain.abs() > limit { gain } else { 0.0 }; 3];
        }
    }

    fn finish(&self) -> EmpiricalFit {
        let samples = || self.frames.iter().flat_map(|f| self.regions.frames[*f].iter());
        let of = |k: usize| -> Vec<Vec<f64>> {
            self.parameters
                .iter()
                .map(|band| band.iter().map(|p| rounded(p[k])).collect())
                .collect()
        };
        let has_backscatter = self.form <= EmpiricalForm::Backscatter;
        let scattered = |p: &Parameters| if has_backscatter { rounded(p[2].exp()) } else { 0.0 };
        let backscatter = self.parameters.iter().map(|band| band.iter().map(scattered).collect());
        let ranges = || {
            self.frames.iter().flat_map(|f| {
                self.regions.frames[*f].iter().map(|s| self.beyond_m(*f, s) + self.reference_m)
            })
        };
        let grid = self.regions.grid;
        let model = EmpiricalModel {
            form: self.form,
            direct: RegionLight {
                grid: grid.rounded(),
                reference_m: rounded(self.reference_m),
                range_m: [
                    rounded(ranges().fold(f64::INFINITY, f64::min)),
                    rounded(ranges().fold(0.0, f64::max)),
                ],
                log_level: of(0),
                slope_per_m: of(1),
                exponent: Vec::new(),
            },
            backscatter: backscatter.collect(),
        };
        EmpiricalFit {
            model,
            residual: self.spreads[..self.regions.bands].iter().copied().fold(0.0, f64::max),
            observations: samples().count(),
            ranges: self.ranges.clone(),
            log_gains: self.log_gains.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::regions::RegionGrid;
    use super::*;

    /// Planes that are higher and tilted otherwise than measured are found by their light, with
    /// their signs; textures of the seafloor are not taken for them.
    #[test]
    fn the_plane_of_a_frame_is_found_by_its_light() {
        const FRAMES: usize = 60;
        let grid = RegionGrid::over([-0.6, 0.6], [-0.4, 0.4], 400).expect("a grid");
        let wave = |f: usize, k: f64| 0.12 * (f as f64 * k).sin();
        let plane = |f: usize| [wave(f, 0.7), wave(f, 1.1), 1.5 * wave(f, 1.9)];
        let frame = |f: usize| -> Vec<RegionSample> {
            let [log_factor, by_x, by_y] = plane(f);
            let truth =
                RangeFactor { log_factor, log_tilt: [by_x, by_y], ..RangeFactor::default() };
            let of_region = |region: usize| {
                let (x, y) = grid.centre(region);
                let range_m = (2.0 + 0.8 * (f as f64 * 0.37).sin()) * (1.0 - 0.2 * y);
                let texture = 0.1 * ((f * 31 + region * 17) % 97) as f64 / 97.0;
                let light = |slope: f64| {
                    let direct = (-1.0 - x * x - slope * (range_m * truth.at(x, y) - 2.0)).exp();
                    (direct + 0.002).ln() + texture
                };
                RegionSample { region, range_m, log_light: [0.9, 0.45, 0.5].map(light) }
            };
            (0..grid.columns * grid.rows).map(of_region).collect()
        };
        let frames: Vec<usize> = (0..FRAMES).collect();
        let regions =
            Regions { grid, bands: 3, frames: (0..FRAMES).map(frame).collect(), noise: 1e-4 };
        let found = fit(&regions, &frames, &[], EmpiricalForm::Ranges).expect("a fit");
        for k in 0..3 {
            let is = |r: &RangeFactor| [r.log_factor, r.log_tilt[0], r.log_tilt[1]][k];
            let by_frame = |f: usize| (is(&found.ranges[f]), plane(f)[k]);
            let products = frames.iter().map(|f| by_frame(*f)).map(|(is, t)| [is * t, t * t]);
            let [both, truth] = products.fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
            assert!((0.6..1.2).contains(&(both / truth)), "{k}: {}", both / truth);
        }
    }
}
