//! The estimators of attenuation: *joint* (the default), the paper's *pairs* (Eq. 16) and
//! *altitude* slope (Fig. 6); the latter two with the beam pattern from angular bins (Eq. 17), in
//! sweeps.

pub mod altitude;
pub mod empirical;
pub mod joint;
pub mod pairs;

use super::{Dataset, angular_bins};
use crate::config::EstimateConfig;
use crate::diagnostics::NoAnswer;
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{BeamGrid, BeamPattern, EstimatorAnswer, ImagingModel, Removal, SpreadingModel};

/// Samples and grid → an answer, or why there is none.
pub type Method = fn(&Dataset<'_>, BeamGrid, &EstimateConfig) -> Result<Candidate, NoAnswer>;

/// One estimator's answer, as a complete model.
pub struct Candidate {
    pub model: ImagingModel,
    /// standard deviation of α (1/m)
    pub std_per_m: Bands,
    /// for `model.json`
    pub answer: EstimatorAnswer,
    /// root mean square difference of path length within a track (m)
    pub path_spread_m: Option<f64>,
    /// errors common to regions of frames (log light)
    pub systematic: f64,
    /// largest factor by which common-mode errors widen the standard deviations
    pub inflation: f64,
    /// α and its standard deviation from the lower half of the frames (1/m)
    pub low_frames: Option<(Bands, Bands)>,
}

impl Candidate {
    fn new(
        model: ImagingModel,
        std_per_m: Bands,
        (observations, residual): (usize, f64),
        details: &[(&str, f64)],
    ) -> Self {
        let bands = model.bands;
        let answer = EstimatorAnswer {
            attenuation_per_m: Some(model.attenuation_per_m[..bands].to_vec()),
            attenuation_std_per_m: Some(std_per_m[..bands].to_vec()),
            observations,
            residual: Some(residual),
            details: details.iter().map(|(k, v)| (String::from(*k), *v)).collect(),
            ..EstimatorAnswer::default()
        };
        Self {
            model,
            std_per_m,
            answer,
            path_spread_m: None,
            systematic: 0.0,
            inflation: 1.0,
            low_frames: None,
        }
    }

    /// Inflates the standard deviations by the disagreement with the better-informed estimate.
    pub fn inflate_by(&mut self, other: &EstimatorAnswer) {
        let (Some(alpha), Some(std)) = (&other.attenuation_per_m, &other.attenuation_std_per_m)
        else {
            return;
        };
        for (b, (alpha, std)) in alpha.iter().zip(std).enumerate() {
            self.std_per_m[b] =
                self.std_per_m[b].hypot(self.model.attenuation_per_m[b] - alpha).hypot(*std);
        }
        self.answer.attenuation_std_per_m = Some(self.std_per_m[..self.model.bands].to_vec());
    }
}

/// Eq. 16 and 17 model one strobe.
fn one_lamp(data: &Dataset<'_>) -> Result<(), NoAnswer> {
    if data.lamps.lamps().len() == 1 { Ok(()) } else { Err(NoAnswer::SeveralLamps) }
}

fn enough_tracks(data: &Dataset<'_>, config: &EstimateConfig) -> Result<(), NoAnswer> {
    let (tracks, needed) = (data.tracks.len(), config.least_pairs);
    if tracks < needed { Err(NoAnswer::FewTracks { tracks, needed }) } else { Ok(()) }
}

/// α that changes by less from sweep to sweep is final (1/m).
const SETTLED_PER_M: f64 = 1e-4;

/// Log radiance without attenuation → an answer.
type ByKnown<'f, A> = dyn Fn(&dyn Fn(&LightPath) -> f64) -> Result<A, NoAnswer> + 'f;

/// An estimator of α for a given beam pattern, in sweeps.
struct Sweeps<'s, A> {
    data: &'s Dataset<'s>,
    grid: BeamGrid,
    config: &'s EstimateConfig,
    /// answer from all parts of Eq. 15 but attenuation
    estimate: &'s ByKnown<'s, A>,
    attenuation_per_m: fn(&A) -> Bands,
}

impl<A: Clone> Sweeps<'_, A> {
    /// The first answer, the last one, and the beam pattern that goes with it.
    fn run(&self) -> Result<(A, A, BeamPattern), NoAnswer> {
        let spreading = SpreadingModel::of(self.config.spreading);
        let model = |alpha: Bands, beam: &BeamPattern| {
            self.data.model(alpha, spreading, beam.clone(), self.config)
        };
        let estimate = |beam: &BeamPattern| {
            let model = model([0.0; 3], beam);
            (self.estimate)(&|path| {
                model.log_radiance(path, Removal::FULL.without_attenuation())[0]
            })
        };
        let mut beam = BeamPattern::uniform(self.grid); // "assume BP ≈ 1", §IV-B
        let first = estimate(&beam)?;
        let mut answer = first.clone();
        for _ in 0..self.config.sweeps {
            let before = (self.attenuation_per_m)(&answer);
            let model = model(before, &beam);
            beam = angular_bins::beam_pattern(self.data, &model, self.grid); // Eq. 17
            answer = estimate(&beam)?; // "we also recompute", §IV-C
            let after = (self.attenuation_per_m)(&answer);
            if before.iter().zip(after).all(|(a, b)| (a - b).abs() < SETTLED_PER_M) {
                break;
            }
        }
        Ok((first, answer, beam))
    }
}
