//! Where things sit (strobe, range instrument, the camera's clock) as further unknowns of the joint
//! solve, to first order.

use super::{Observation, Problem, Said, Solution, Track};
use crate::geometry::LightPath;
use crate::model::{log_geometry, log_sum};

/// Most further unknowns at a time.
pub const MOST_PLACES: usize = 6;

/// The way of light to an observation with an unknown off by so much.
pub type MovedPath<'f> = dyn Fn(&Observation, f64) -> Option<LightPath> + 'f;

/// One more unknown: the step of its numeric derivative, and the way of light when it is off by so
/// much.
pub struct Place<'f> {
    /// in the unknown's unit
    pub step: f64,
    /// (observation, by how much) → the way of light
    pub path: Box<MovedPath<'f>>,
}

/// A step that the residuals ask for, with its standard deviation, in the unknowns' units.
#[derive(Clone, Debug)]
pub struct PlaceStep {
    /// the step
    pub step: Vec<f64>,
    /// per unknown
    pub std: Vec<f64>,
}

impl Problem<'_> {
    /// The step of `places` that would lower the misfits most, to first order, with everything else
    /// free.
    pub fn place_step(
        &mut self,
        tracks: &[Track],
        places: &[Place<'_>],
        solution: &Solution,
    ) -> Option<PlaceStep> {
        let free = self.with_places(tracks, places, solution)?;
        let at = self.columns.first_place();
        let covariance = self.covariance(at)?;
        self.columns.places = 0;
        let std = (0..places.len()).map(|k| covariance[(k, k)].sqrt()).collect();
        Some(PlaceStep { step: (0..places.len()).map(|k| free.values[at + k]).collect(), std })
    }

    /// The same problem with `places` as more unknowns, to first order.
    pub fn with_places(
        &mut self,
        tracks: &[Track],
        places: &[Place<'_>],
        solution: &Solution,
    ) -> Option<Solution> {
        self.differentiate(tracks, places, solution);
        self.columns.places = places.len();
        let (normal, right) = self.normal_equations(&self.smoothness());
        Some(Solution { values: normal.cholesky()?.solve(&right), residual: solution.residual })
    }

    /// Derivatives of each row's model by each place, numerically, with the pattern in hand.
    fn differentiate(&mut self, tracks: &[Track], places: &[Place<'_>], solution: &Solution) {
        let Said { beam, .. } = self.said(solution);
        let alpha_of = |frame: u32| -> [f64; 3] {
            std::array::from_fn(|b| {
                if b < self.setting.bands {
                    self.attenuation_of(frame, b, &solution.values)
                } else {
                    0.0
                }
            })
        };
        let alphas: Vec<[f64; 3]> = self.rows.iter().map(|r| alpha_of(r.frame)).collect();
        let spreading = self.setting.spreading_held();
        let exponent = self.columns.exponent().map_or(0.0, |i| solution.values[i]);
        let common = |p: &LightPath| {
            beam.log_gain(p.angles) + log_geometry(spreading, self.setting.config.incidence, p)
                - exponent * p.strobe_to_seafloor_m.ln()
        };
        let observations: Vec<&Observation> = tracks.iter().flatten().collect();
        for (row, alpha) in self.rows.iter_mut().zip(alphas) {
            let o = observations[row.source];
            for (k, place) in places.iter().enumerate() {
                let (Some(ahead), Some(behind)) =
                    ((place.path)(o, place.step), (place.path)(o, -place.step))
                else {
                    continue;
                };
                let per_unit = 1.0 / (2.0 * place.step);
                let light = |p: &LightPath, alpha: f64| match p.lamp_paths() {
                    [] => common(p) - alpha * p.length_m(),
                    legs => log_sum(
                        legs.iter()
                            .map(|l| (p.via(l), l.share))
                            .map(|(p, share)| share.ln() + common(&p) - alpha * p.length_m()),
                    ),
                };
                row.by_place.iter_mut().zip(alpha).for_each(|(d, alpha)| {
                    d[k] = (light(&ahead, alpha) - light(&behind, alpha)) * per_unit
                });
            }
        }
    }
}
