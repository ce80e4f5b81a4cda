//! The strobe's place as three more unknowns of the joint solve, to first order.

use nalgebra::Vector3;

use super::{Observation, PathFor, Problem, Said, Solution, Track};
use crate::geometry::LightPath;
use crate::model::log_geometry;
use crate::spaces::{Body, Strobe, Transform};

/// Step of the numeric derivative [m].
const STEP_M: f64 = 0.01;

/// A step of the strobe that the residuals ask for, with its standard deviation [m].
#[derive(Clone, Copy, Debug)]
pub struct StrobeStep {
    /// in body space
    pub step_m: Vector3<f64>,
    /// per axis
    pub std_m: Vector3<f64>,
}

impl Problem<'_> {
    /// The step of the strobe that would lower the misfits most, to first order, with everything else free.
    pub fn strobe_step(&mut self, tracks: &[Track], mount: Transform<Body, Strobe>, paths: &PathFor<'_>, solution: &Solution) -> Option<StrobeStep> {
        let free = self.with_free_strobe(tracks, mount, paths, solution)?;
        let at = self.columns.strobe();
        let covariance = self.covariance(at)?;
        self.columns.with_strobe = false;
        let std_m = Vector3::new(covariance[(0, 0)], covariance[(1, 1)], covariance[(2, 2)]).map(f64::sqrt);
        Some(StrobeStep { step_m: Vector3::new(free.values[at], free.values[at + 1], free.values[at + 2]), std_m })
    }

    /// The same problem with the strobe's place as three more unknowns, to first order.
    pub fn with_free_strobe(
        &mut self,
        tracks: &[Track],
        mount: Transform<Body, Strobe>,
        paths: &PathFor<'_>,
        solution: &Solution,
    ) -> Option<Solution> {
        self.differentiate(tracks, mount, paths, solution);
        self.columns.with_strobe = true;
        let (normal, right) = self.normal_equations(&self.smoothness());
        Some(Solution { values: normal.cholesky()?.solve(&right), residual: solution.residual })
    }

    /// Derivatives of each row's model by the strobe's place, numerically, with the pattern in hand.
    fn differentiate(&mut self, tracks: &[Track], mount: Transform<Body, Strobe>, paths: &PathFor<'_>, solution: &Solution) {
        let Said { attenuation_per_m: alpha, beam, .. } = self.said(solution);
        let spreading = self.setting.spreading_held();
        let exponent = self.columns.exponent().map_or(0.0, |i| solution.values[i]);
        let common = |p: &LightPath| {
            beam.log_gain(p.angles) + log_geometry(spreading, self.setting.config.incidence, p) - exponent * p.strobe_to_seafloor_m.ln()
        };
        let moved = |axis: usize, by: f64| {
            let mut isometry = mount.isometry();
            isometry.translation.vector[axis] += by;
            Transform::from_isometry(isometry)
        };
        let observations: Vec<&Observation> = tracks.iter().flatten().collect();
        for row in &mut self.rows {
            let o = observations[row.source];
            for axis in 0..3 {
                let (Some(ahead), Some(behind)) = (paths(o, moved(axis, STEP_M)), paths(o, moved(axis, -STEP_M))) else { continue };
                let per_m = 1.0 / (2.0 * STEP_M);
                let (by_common, by_length) = ((common(&ahead) - common(&behind)) * per_m, (ahead.length_m() - behind.length_m()) * per_m);
                row.by_strobe.iter_mut().zip(alpha).for_each(|(d, alpha)| d[axis] = by_common - alpha * by_length);
            }
        }
    }
}
