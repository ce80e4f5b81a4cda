//! The solve on synthetic tracks with a known answer.

use nalgebra::Vector3;

use super::*;
use crate::coordinates::{Body, Direction, Point, Strobe, Transform};
use crate::model::{BeamPattern, Daylight, ImagingModel, Removal};

const ALPHA: [f64; 3] = [0.45, 0.14, 0.1];

fn lamps() -> Lamps {
    let pose: Transform<Body, Strobe> =
        Transform::from_parts([-0.8, 0.1, 0.0], [0.0, 0.1, 0.0, 0.995]);
    Lamps::one(pose)
}

/// A beam pattern that the grid holds exactly and whose second differences are 0.
fn truth(grid: BeamGrid, strobe_leg: f64) -> ImagingModel {
    let log_gain =
        |i: usize| Some(0.4 * grid.angle(i / grid.count) - 0.3 * grid.angle(i % grid.count));
    let nodes: Vec<Option<f64>> = (0..grid.count * grid.count).map(log_gain).collect();
    ImagingModel {
        bands: 3,
        attenuation_per_m: ALPHA,
        over_time: Default::default(),
        spreading: SpreadingModel { strobe_leg, camera_leg: 0.0 },
        incidence: true,
        beam_pattern: BeamPattern::from_nodes(grid, &nodes),
        backscatter: None,
        daylight: None,
        residual: None,
        empirical: None,
    }
}

/// Points seen from three altitudes by a level vehicle over a flat seafloor, without noise but for
/// one false match in fifty.
fn tracks(model: &ImagingModel) -> Vec<Track> {
    let level = Direction::from_vector(Vector3::z()).expect("a direction");
    let track = |i: usize| {
        let reflectance = [0.3 + 0.01 * (i % 37) as f64, 0.4, 0.5 - 0.005 * (i % 53) as f64];
        let view = |k: usize| {
            let frame = (3 * (i / 20) + k) as u32;
            let altitude = 1.4 + 0.5 * ((i / 20 + 5 * k) % 7) as f64 / 3.0;
            let (x, y) =
                ((i % 20) as f64 / 20.0 - 0.5 + 0.1 * k as f64, (i % 11) as f64 / 11.0 - 0.5);
            let hit = Point::from_vector(Vector3::new(x * altitude, y * altitude, altitude));
            let mut sample = Sample {
                hit,
                seafloor_to_camera_m: hit.vector().norm(),
                normal: level,
                log_color: [0.0; 3],
            };
            let radiance = model.log_radiance(&sample.path(lamps()).expect("lit"), Removal::FULL);
            let error = if i % 50 == 7 && k == 1 { 0.5 } else { 0.0 };
            sample.log_color =
                std::array::from_fn(|b| (radiance[b] + reflectance[b].ln() + error) as f32);
            Observation { frame, sample }
        };
        (0..3).map(view).collect()
    };
    (0..600).map(track).collect()
}

fn setup<'s>(config: &'s EstimateConfig, grid: BeamGrid) -> Setup<'s> {
    let independence = Independence { frames: 90, moments: 90 };
    Setup { rounds: 12, ..Setup::new(independence, 3, grid, config) }
}

#[test]
fn attenuation_and_beam_come_back_among_false_matches() {
    let (config, grid) = (EstimateConfig::default(), BeamGrid::new(25, 70.0));
    let model = truth(grid, 2.0);
    let answer =
        solve(&tracks(&model), &setup(&config, grid), lamps(), &sample_path).expect("an answer");
    for b in 0..3 {
        let error = answer.attenuation_per_m[b] - ALPHA[b];
        assert!(error.abs() < 1e-4, "band {b}: {error}");
    }
    assert!(answer.residual < 1e-4, "{}", answer.residual);
}

#[test]
fn the_exponent_comes_back() {
    let (config, grid) = (EstimateConfig::default(), BeamGrid::new(25, 70.0));
    let setup = Setup { fit_exponent: true, ..setup(&config, grid) };
    let answer =
        solve(&tracks(&truth(grid, 1.7)), &setup, lamps(), &sample_path).expect("an answer");
    let (exponent, _) = answer.exponent.expect("an exponent");
    assert!((exponent - 1.7).abs() < 0.02, "{exponent}");
    assert!((answer.attenuation_per_m[0] - ALPHA[0]).abs() < 5e-3);
}

#[test]
fn daylight_and_the_water_it_crosses_come_back() {
    let (config, grid) = (EstimateConfig::default(), BeamGrid::new(25, 70.0));
    let daylight = Daylight { log_strength: [-4.5, -3.0, -2.5] };
    let model = ImagingModel { daylight: Some(daylight), ..truth(grid, 2.0) };
    let setup = Setup { daylight: Some([0.1; 3]), rounds: 24, ..setup(&config, grid) };
    let tracks = tracks(&model);
    let mut problem = Problem::new(&tracks, &setup, lamps(), &sample_path).expect("a problem");
    let solution = problem.solve(setup.rounds).expect("a solution");
    let fit = problem.fit(&solution);
    let found = fit.daylight.expect("daylight");
    for b in 0..3 {
        let error = fit.attenuation_per_m[b] - ALPHA[b];
        assert!(error.abs() < 1e-4, "band {b}: {error}");
        // In the unit of the peak that was seen, which is not the truth's.
        let error = |b: usize| found.log_strength[b] - daylight.log_strength[b];
        assert!((error(b) - error(1)).abs() < 1e-3, "band {b}: {}", error(b));
    }
}

#[test]
fn a_strobe_that_is_off_raises_the_residual_and_the_step_leads_back() {
    let (config, grid) = (EstimateConfig::default(), BeamGrid::new(25, 70.0));
    let (tracks, setup) = (tracks(&truth(grid, 2.0)), setup(&config, grid));
    let off = lamps().moved_to(lamps().origin().vector() + Vector3::new(0.05, 0.0, 0.0));
    let at = |lamps: Lamps| {
        let mut problem = Problem::new(&tracks, &setup, lamps, &sample_path).expect("a problem");
        let solution = problem.solve(setup.rounds).expect("a solution");
        let parameters = strobe_position(lamps, &sample_path);
        let step = problem.parameter_step(&tracks, &parameters, &solution).expect("a step");
        (solution.residual, step.step[0])
    };
    let ((true_residual, _), (residual, step)) = (at(lamps()), at(off));
    assert!(residual > 3.0 * true_residual, "{residual} against {true_residual}");
    assert!((-0.075..-0.02).contains(&step), "{step}");
}

#[test]
fn too_few_tracks_give_no_answer() {
    let (config, grid) = (EstimateConfig::default(), BeamGrid::new(25, 70.0));
    let few = &tracks(&truth(grid, 2.0))[..20];
    assert!(solve(few, &setup(&config, grid), lamps(), &sample_path).is_none());
}

#[test]
fn gauss_newton_finds_the_least_residual_and_stops_there() {
    let truth = Vector3::new(0.3, -0.2, 0.6);
    let evaluate = |point: Vector3<f64>| {
        let off: Vector3<f64> = truth - point;
        // The step overshoots: it has to be shortened.
        let step =
            ParameterStep { step: (off * 1.8).iter().copied().collect(), std: vec![1e-4; 3] };
        Some((0.01 + off.norm_squared(), step))
    };
    let found = minimize(Vector3::zeros(), SETTLED, &evaluate).expect("a minimum");
    assert!((found.point - truth).norm() < 2e-3, "{}", found.point);
    assert!(found.residual[1] < found.residual[0]);
}
