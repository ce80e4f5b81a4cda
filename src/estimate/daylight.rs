//! Daylight on the seafloor (Eq. 3), from how light falls with distance.
//!
//! The strobe's light falls with ℓ_a², with α on both legs and towards the rim of its beam;
//! daylight falls with α on the camera's leg alone. So its share grows with altitude and off the
//! beam's axis. Its strength joins the joint solve; for whatever needs light of the strobe alone
//! the samples are divided by what daylight adds.

use super::Dataset;
use super::backscatter::BackscatterFit;
use super::quality::cross_validation;
use super::samples::FrameSamples;
use crate::config::Switch;
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{Daylight, DaylightFile, ImagingModel, Removal};
use crate::parallel::par_map;
use crate::solver::{
    Observation, Problem, Sample, ScatterOf, Setup, Solution, Track, sample_path, thinned,
};
use crate::stats;
use crate::vehicle::Lamps;

/// Observations that decide whether there is daylight.
const MAX_OBSERVATIONS: usize = 12_000;
/// Daylight's share of the light, to begin with; and where light without it gains from distance, as
/// it does where there is hardly anything but daylight.
const FIRST_SHARE: f64 = 0.1;
const MOST_SHARE: f64 = 0.95;
/// The search ends where the residual is not smaller by this share.
const MAX_RESIDUAL: f64 = 0.98;
/// Held-out frames are predicted better by at least this.
const MIN_IMPROVEMENT: f64 = 0.05;
/// Less than this share of the light, in every band, is none.
const MIN_SHARE: f64 = 0.02;
/// Standard deviation of log d that is no measurement any more.
const MAX_LOG_STD: f64 = 0.35;
/// Medians of daylight's share, as the solve begins with them.
const SHARES: (f64, f64) = (0.002, 0.98);

/// Daylight that was found.
#[derive(Clone, Debug)]
pub struct DaylightFit {
    /// the model's part
    pub daylight: Daylight,
    /// standard deviation of log d per band
    pub log_std: Bands,
    /// how much better held-out frames are predicted
    pub improvement: f64,
    /// median share of daylight in the light of tracked points, per band
    pub share: Bands,
    /// the model that tells the share of any sample
    model: ImagingModel,
    lamps: Lamps,
}

impl DaylightFit {
    /// With the daylight of the last solve.
    pub fn of_model(self, model: &ImagingModel) -> Self {
        Self { daylight: model.daylight.unwrap_or(self.daylight), ..self }
    }

    /// Log of the lamps' share of a sample's direct light.
    fn log_lamp_share(&self, sample: &Sample) -> Option<Bands> {
        Some(log_lamp_share(&self.model, &sample.path(self.lamps)?))
    }

    /// Frames and tracks as the strobe alone would have lit them. A factor leaves relative errors
    /// as they are, so all stay.
    pub fn removed_from(&self, data: &Dataset<'_>) -> (Vec<FrameSamples>, Vec<Track>) {
        let bands = data.bands();
        let lit = |sample: &Sample| {
            let (shares, mut sample) = (self.log_lamp_share(sample)?, *sample);
            for (color, share) in sample.log_color.iter_mut().zip(&shares[..bands]) {
                *color += *share as f32;
            }
            Some(sample)
        };
        let of_frame = |frame: &FrameSamples| {
            let cells = frame.grid.iter();
            frame.with_grid(cells.filter_map(|(cell, s)| Some((*cell, lit(s)?))).collect())
        };
        let of_observation =
            |o: &Observation| Some(Observation { frame: o.frame, sample: lit(&o.sample)? });
        let of_track = |t: &Track| t.iter().filter_map(of_observation).collect::<Track>();
        let tracks = data.tracks.iter().map(of_track).filter(|t| t.len() > 1).collect();
        (data.frames.iter().map(of_frame).collect(), tracks)
    }

    /// For `model.json`.
    pub fn file(&self, bands: usize) -> DaylightFile {
        let strength: Vec<f64> =
            self.daylight.log_strength[..bands].iter().map(|d| d.exp()).collect();
        DaylightFile {
            strength_std: strength.iter().zip(self.log_std).map(|(d, std)| d * std).collect(),
            strength,
            median_share: self.share[..bands].to_vec(),
            held_out_improvement: self.improvement,
        }
    }
}

/// Log of the lamps' share of direct light, by a model with daylight.
fn log_lamp_share(model: &ImagingModel, path: &LightPath) -> Bands {
    let all = model.log_radiance(path, Removal::FULL);
    let of_lamps = model.without_daylight().log_radiance(path, Removal::FULL);
    std::array::from_fn(|b| of_lamps[b] - all[b])
}

/// Estimates d; `None` where the log shows none. Backscatter that is known stays an unknown beside
/// it.
pub fn find(
    data: &Dataset<'_>,
    setup: &Setup<'_>,
    backscatter: Option<&BackscatterFit>,
) -> Option<DaylightFit> {
    if setup.config.daylight == Switch::Off {
        return None;
    }
    let tracks = thinned(data.tracks, MAX_OBSERVATIONS);
    let scatter_of = |o: &Observation| {
        backscatter.map_or_else(Default::default, |fit| fit.scatter(data, &o.sample))
    };
    let scatter = backscatter.map(|fit| (&fit.backscatter, &scatter_of as &ScatterOf<'_>));
    let without = Setup { scatter, free_strobe: false, ..*setup };
    let (plain, solution) = solved(&tracks, &without, data.lamps)?;
    let (attenuation_per_m, residual) = (plain.fit(&solution).attenuation_per_m, solution.residual);
    let is_gaining = attenuation_per_m[..setup.bands].iter().any(|a| *a < 0.0);
    let shares = [FIRST_SHARE, MOST_SHARE];
    let begins = par_map(shares[..1 + usize::from(is_gaining)].to_vec(), |share| {
        solved(&tracks, &Setup { daylight: Some([share; 3]), ..without }, data.lamps)
    });
    let residual_of = |(_, solution): &(Problem<'_>, Solution)| solution.residual;
    let (problem, solution) =
        begins.into_iter().flatten().min_by(|a, b| residual_of(a).total_cmp(&residual_of(b)))?;
    let is_asked = setup.config.daylight == Switch::On;
    if solution.residual > MAX_RESIDUAL * residual && !is_asked {
        return None;
    }
    let daylight = problem.fit(&solution).daylight?;
    let log_std = problem.answer(&solution, &[])?.log_daylight?.1;
    let model = problem.imaging_model(&solution);
    let share = median_shares(&model, &tracks, data);
    let with = Setup { daylight: Some(begun(&share)), ..without };
    let held_out =
        |setup: &Setup<'_>| cross_validation::residuals(&tracks, setup, data.lamps, &sample_path);
    let improvement = cross_validation::improvement(&held_out(&without)?, &held_out(&with)?);
    let is_there = |b: usize| share[b] > MIN_SHARE && log_std[b] < MAX_LOG_STD;
    let is_found = improvement > MIN_IMPROVEMENT && (0..setup.bands).any(is_there);
    (is_found || is_asked).then_some(DaylightFit {
        daylight,
        log_std,
        improvement,
        share,
        model,
        lamps: data.lamps,
    })
}

fn solved<'s>(
    tracks: &[Track],
    setup: &Setup<'s>,
    lamps: Lamps,
) -> Option<(Problem<'s>, Solution)> {
    let mut problem = Problem::new(tracks, setup, lamps, &sample_path)?;
    let solution = problem.solve(setup.rounds)?;
    Some((problem, solution))
}

/// Median shares within what a solve can begin with.
pub fn begun(share: &Bands) -> Bands {
    share.map(|s| s.clamp(SHARES.0, SHARES.1))
}

/// Median share of daylight in the light of tracked points.
fn median_shares(model: &ImagingModel, tracks: &[Track], data: &Dataset<'_>) -> Bands {
    let paths = tracks.iter().flatten().filter_map(|o| data.path(o));
    let shares: Vec<Bands> = paths.map(|path| log_lamp_share(model, &path)).collect();
    std::array::from_fn(|b| {
        stats::median(&shares.iter().map(|s| 1.0 - s[b].exp()).collect::<Vec<_>>())
    })
}
