//! Every term's derivatives against finite differences of the forward model.
use crate::model::Metered;

use nalgebra::Vector3;

use super::attenuation::TimeGrid;
use super::black_level::BlackLevel;
use super::daylight::Daylight as DaylightTerm;
use super::gain_law::GainLaw;
use super::geometry::{Geometry, PlaneTrack, ShiftedPlanes, strobe_position};
use super::response::ResponseTerm;
use super::vignetting::Vignetting;
use super::*;
use crate::config::EstimateConfig;
use crate::coordinates::{Body, Direction, Point, Strobe, Transform};
use crate::image::transfer::Transfer;
use crate::model::{Backscatter, BeamGrid, BeamPattern, Daylight, Frustum, ImagingModel, Removal};
use crate::model::{ScatterIntegral, ScatterTable, SpreadingModel};
use crate::solver::camera::{
    CameraUnknowns, ImageRadius, ReadingCurve, SPLINES, splines, vignetting_at,
};
use crate::solver::{Independence, Observation, Sample, ScatterOf, sample_path};
use crate::vehicle::Lamps;

const H: f64 = 1e-5;

fn lamp(x: f64, pitch: f64) -> Transform<Body, Strobe> {
    Transform::from_parts([x, 0.1, 0.05], [0.0, (pitch / 2.0).sin(), 0.0, (pitch / 2.0).cos()])
}

fn observation() -> Observation {
    let hit = Point::from_vector(Vector3::new(0.3, -0.2, 2.1));
    let normal = Direction::from_vector(Vector3::new(0.05, 0.02, 1.0)).expect("a direction");
    let sample = Sample {
        hit,
        seafloor_to_camera_m: hit.vector().norm(),
        normal,
        log_color: [-2.0, -1.5, -1.2],
    };
    Observation { frame: 0, sample }
}

fn setup<'s>(config: &'s EstimateConfig) -> Setup<'s> {
    let independence = Independence { frames: 1, moments: 1 };
    Setup::new(independence, 3, BeamGrid::new(21, 70.0), config)
}

fn model(grid: BeamGrid) -> ImagingModel {
    let log_gain = |i: usize| {
        let (theta, phi) = (grid.angle(i / grid.count), grid.angle(i % grid.count));
        Some(-theta * theta - 0.7 * phi * phi + 0.2 * theta)
    };
    let nodes: Vec<Option<f64>> = (0..grid.count * grid.count).map(log_gain).collect();
    ImagingModel {
        bands: 3,
        attenuation_per_m: [0.45, 0.14, 0.1],
        over_time: Default::default(),
        spreading: SpreadingModel { strobe_leg: 2.0, camera_leg: 0.0 },
        incidence: true,
        beam_pattern: BeamPattern::from_nodes(grid, &nodes),
        backscatter: None,
        daylight: None,
        residual: None,
        empirical: None,
    }
}

fn equation(setup: &Setup<'_>, lamps: Lamps) -> Equation {
    let o = observation();
    let path = sample_path(&o, lamps).expect("a lit point");
    Equation::new(setup, &|_| true, &o, &path, 0).expect("an equation")
}

fn derivatives(term: &dyn Term, equation: &Equation, band: usize) -> Vec<f64> {
    let mut row = Row::default();
    term.jacobian(equation, band, &mut row);
    let mut dense = vec![0.0; term.columns()];
    row.iter().for_each(|(unknown, derivative)| dense[*unknown] += derivative);
    dense
}

fn assert_near(is: f64, expected: f64, what: &str) {
    assert!(
        (is - expected).abs() < 1e-4 * (1.0 + expected.abs()),
        "{what}: {is}, expected {expected}"
    );
}

#[test]
fn attenuation_follows_its_nodes_in_time() {
    let config = EstimateConfig::default();
    let time = TimeGrid { frames: vec![(0, 0.3)], nodes: 2, is_joined: vec![true] };
    let setup = Setup { segments: Some(&time), ..setup(&config) };
    let (lamps, model) = (Lamps::one(lamp(-0.8, 0.3)), model(setup.grid));
    let term = Attenuation::new(3, Some(&time));
    let path = sample_path(&observation(), lamps).expect("a lit point");
    let values = [0.4, 0.5, 0.1, 0.2, 0.05, 0.1];
    let light = |values: &[f64]| model.log_radiance_in(&term.at(0, values), &path, Removal::FULL);
    for band in 0..3 {
        let row = derivatives(&term, &equation(&setup, lamps), band);
        for k in 0..values.len() {
            let (mut ahead, mut behind) = (values, values);
            ahead[k] += H;
            behind[k] -= H;
            let numeric = (light(&ahead)[band] - light(&behind)[band]) / (2.0 * H);
            assert_near(row[k], numeric, &format!("node {k}, band {band}"));
        }
    }
}

#[test]
fn beam_nodes_weigh_as_the_pattern_interpolates() {
    let config = EstimateConfig::default();
    let setup = setup(&config);
    let (lamps, model) = (Lamps::one(lamp(-0.8, 0.3)), model(setup.grid));
    let term = Beam::new(setup.grid, &vec![9.0; 21 * 21], 1.0);
    let row = derivatives(&term, &equation(&setup, lamps), 0);
    let path = sample_path(&observation(), lamps).expect("a lit point");
    let by_node: Vec<Option<f64>> = model.beam_pattern.by_node();
    let log_gain = |node: usize, step: f64| {
        let mut moved = by_node.clone();
        moved[node] = moved[node].map(|v| v + step);
        BeamPattern::from_nodes(setup.grid, &moved).log_gain(path.angles)
    };
    let peak = by_node.iter().position(|v| *v == Some(0.0));
    for node in (0..row.len()).filter(|n| row[*n] != 0.0 && Some(*n) != peak) {
        // Downwards, so that the peak, to which patterns are normalised, stays.
        let numeric = (log_gain(node, 0.0) - log_gain(node, -H)) / H;
        assert_near(row[node], numeric, &format!("node {node}"));
    }
    assert_near(row.iter().sum(), 1.0, "the weights' sum");
}

#[test]
fn the_exponent_is_that_of_the_strobe_leg() {
    let config = EstimateConfig::default();
    let setup = Setup { fit_exponent: true, ..setup(&config) };
    let (lamps, model) = (Lamps::one(lamp(-0.8, 0.3)), model(setup.grid));
    let path = sample_path(&observation(), lamps).expect("a lit point");
    let light = |strobe_leg: f64| {
        let spreading = SpreadingModel { strobe_leg, camera_leg: 0.0 };
        ImagingModel { spreading, ..model.clone() }.log_radiance(&path, Removal::FULL)[1]
    };
    let numeric = (light(2.0 + H) - light(2.0 - H)) / (2.0 * H);
    assert_near(derivatives(&Exponent, &equation(&setup, lamps), 1)[0], numeric, "exponent");
}

#[test]
fn backscatter_is_added_to_the_direct_light() {
    let config = EstimateConfig::default();
    let (lamps, model) = (Lamps::one(lamp(-0.8, 0.3)), model(BeamGrid::new(21, 70.0)));
    let frustum = Frustum { x: (-0.5, 0.5), y: (-0.5, 0.5), farthest_m: 3.0 };
    let optical = Transform::identity();
    let table =
        ScatterTable::of_strobe(&model.beam_pattern, optical, &lamps, &[0.45, 0.14, 0.1], frustum);
    let scatter = |_: &Observation| -> ScatterIntegral { table.at(0.1, -0.1, 2.1) };
    let state = Backscatter { strength_per_m: [0.002, 0.004, 0.006], ..Backscatter::NONE };
    let setup = Setup { scatter: Some((&state, &scatter as &ScatterOf<'_>)), ..setup(&config) };
    let equation = equation(&setup, lamps);
    let term = BackscatterTerm::new(3, state);
    for band in 0..3 {
        let row = derivatives(&term, &equation, band);
        let direct = 1.0 / equation.reading.per_direct[band];
        let log_color =
            |state: &Backscatter| (direct + state.light(&equation.reading.scatter)[band]).ln();
        for k in 0..term.columns() {
            let moved = |step: f64| {
                let mut moved = state;
                if k < 3 {
                    moved.strength_per_m[k] += step;
                } else {
                    moved.shape[k - 3] += step;
                }
                moved
            };
            let numeric = (log_color(&moved(H)) - log_color(&moved(-H))) / (2.0 * H);
            let of_direct = numeric / equation.reading.direct_share[band];
            let own = k == band || k >= 3;
            assert_near(row[k], if own { of_direct } else { 0.0 }, &format!("{k}, band {band}"));
        }
    }
}

#[test]
fn a_step_in_backscatter_is_taken_once_and_held_at_its_bounds() {
    let start = Backscatter { strength_per_m: [0.01; 3], ..Backscatter::NONE };
    let mut term = BackscatterTerm::new(3, start);
    term.max_strength_per_m = [0.05, 0.05, 0.015];
    let mut values = [0.002, -0.5, 0.1, 0.0, 0.0];
    term.apply(&mut values);
    assert_eq!(values, [0.0; 5], "the step is consumed");
    assert_eq!(term.state.strength_per_m, [0.012, 0.0, 0.015]);
    assert_eq!(term.held(), [1, 2]);
}

/// Derivatives of the sum of a lamp's light and daylight, by every unknown that changes either.
#[test]
fn daylight_is_linear_about_the_solution() {
    let config = EstimateConfig::default();
    let setup = setup(&config);
    let lamps = Lamps::one(lamp(-0.8, 0.3));
    let daylight = Daylight { log_strength: [-4.0, -2.5, -1.5] };
    let model = ImagingModel { daylight: Some(daylight), ..model(setup.grid) };
    let (beam, alpha) =
        (Beam::new(setup.grid, &vec![9.0; 21 * 21], 1.0), Attenuation::new(3, None));
    let by_node: Vec<f64> = model.beam_pattern.by_node().into_iter().flatten().collect();
    let log_beam = |nodes: &[(usize, f64)]| beam.log_gain(nodes, &by_node);
    let mut equation = equation(&setup, lamps);
    equation.linearize_light(&LightState {
        bands: 3,
        attenuation_per_m: model.attenuation_per_m,
        exponent: 0.0,
        log_daylight: Some(daylight.log_strength),
        log_beam: &log_beam,
    });
    let path = sample_path(&observation(), lamps).expect("a lit point");
    let light = |model: &ImagingModel, band: usize| model.log_radiance(&path, Removal::FULL)[band];
    for band in 0..3 {
        let by_beam = derivatives(&beam, &equation, band);
        let of_beam = by_beam.iter().zip(&by_node).map(|(x, v)| x * v).sum::<f64>();
        let by_alpha = derivatives(&alpha, &equation, band)[band];
        let linear = of_beam + by_alpha * model.attenuation_per_m[band];
        let value = linear + equation.path.geometry[band];
        assert_near(value, light(&model, band), &format!("value, band {band}"));
        let stepped = |change: &dyn Fn(&mut ImagingModel, f64)| {
            let [ahead, behind] = [H, -H].map(|h| {
                let mut moved = model.clone();
                change(&mut moved, h);
                light(&moved, band)
            });
            (ahead - behind) / (2.0 * H)
        };
        let numeric = stepped(&|m, h| m.attenuation_per_m[band] += h);
        assert_near(by_alpha, numeric, &format!("attenuation, band {band}"));
        let numeric = stepped(&|m, h| m.daylight = m.daylight.map(|d| d.shifted(h)));
        let by_daylight = derivatives(&DaylightTerm::new(3, [0.0; 3]), &equation, band)[band];
        assert_near(by_daylight, numeric, &format!("daylight, band {band}"));
        // More light of the whole beam is less daylight.
        assert_near(by_beam.iter().sum(), 1.0 - numeric, &format!("beam, band {band}"));
    }
}

#[test]
fn the_light_of_several_lamps_is_linear_about_the_solution() {
    let config = EstimateConfig::default();
    let setup = setup(&config);
    let lamps = Lamps::several(&[(lamp(-0.8, 0.3), 1.0), (lamp(0.6, -0.2), 0.5)]).expect("two");
    let model = model(setup.grid);
    let beam = Beam::new(setup.grid, &vec![9.0; 21 * 21], 1.0);
    let by_node: Vec<f64> = model.beam_pattern.by_node().into_iter().flatten().collect();
    let log_beam = |nodes: &[(usize, f64)]| beam.log_gain(nodes, &by_node);
    let mut equation = equation(&setup, lamps);
    let state = LightState {
        bands: 3,
        attenuation_per_m: model.attenuation_per_m,
        exponent: 0.0,
        log_daylight: None,
        log_beam: &log_beam,
    };
    equation.linearize_light(&state);
    let path = sample_path(&observation(), lamps).expect("a lit point");
    for band in 0..3 {
        // Exact at the solution: log c = y + geometry, y = linear part + log reflectance.
        let linear = derivatives(&beam, &equation, band)
            .iter()
            .zip(&by_node)
            .map(|(x, v)| x * v)
            .sum::<f64>()
            - equation.path.length_m * model.attenuation_per_m[band];
        let exact = model.log_radiance(&path, Removal::FULL)[band];
        assert_near(linear + equation.path.geometry[band], exact, "the sum");
        let light = |step: f64| {
            let mut alpha = model.attenuation_per_m;
            alpha[band] += step;
            model.log_radiance_in(&alpha, &path, Removal::FULL)[band]
        };
        let numeric = (light(H) - light(-H)) / (2.0 * H);
        let term = Attenuation::new(3, None);
        let is = derivatives(&term, &equation, band)[band];
        // One share of the lamps for all bands: the derivative is that of the bands' mean.
        assert!((is / numeric - 1.0).abs() < 0.02, "band {band}: {is}, expected {numeric}");
    }
}

/// An equation with what of the camera is asked for.
fn camera_equation(curve: &ReadingCurve, observation: &Observation) -> Equation {
    let config = EstimateConfig::default();
    let radius = ImageRadius { body_from_optical: Transform::identity(), corner_squared: 0.2 };
    let camera = CameraUnknowns {
        gains: None,
        law: None,
        vignetting: true,
        response: true,
        black_level: true,
        start: curve,
        radius,
    };
    let setup = Setup { camera: Some(camera), ..setup(&config) };
    let path = sample_path(observation, Lamps::one(lamp(-0.8, 0.3))).expect("a lit point");
    Equation::new(&setup, &|_| true, observation, &path, 0).expect("an equation")
}

#[test]
fn vignetting_is_a_polynomial_of_the_image_radius() {
    let o = observation();
    let row = derivatives(&Vignetting, &camera_equation(&ReadingCurve::default(), &o), 0);
    let q = (0.3f64.powi(2) + 0.2f64.powi(2)) / (2.1f64.powi(2) * 0.2);
    for k in 0..3 {
        let numeric = |step: f64| {
            let mut coefficients = [0.3, -0.2, 0.1];
            coefficients[k] += step;
            vignetting_at(&coefficients, q)
        };
        assert_near(row[k], (numeric(H) - numeric(-H)) / (2.0 * H), &format!("v{}", k + 1));
    }
}

/// Steps of black level and curve change the reading; the terms' derivatives are those of log D at
/// the reading, hence the share of direct light.
#[test]
fn black_level_and_curve_change_the_reading() {
    let o = observation();
    let mut coefficients = [0.0; SPLINES];
    (0..SPLINES).for_each(|k| coefficients[k] = 0.05 * (0.9 * k as f64).cos());
    let level = [0.004, 0.003, 0.002];
    let curve = ReadingCurve::new(level, Some(Transfer::Gamma(2.2)), coefficients);
    let equation = camera_equation(&curve, &o);
    for band in 0..3 {
        let direct = 1.0 / equation.reading.per_direct[band];
        let reading =
            |curve: &ReadingCurve| curve.reading((direct + curve.black_level[band]).ln()).0;
        assert_near(reading(&curve), f64::from(o.sample.log_color[band]), "at the state");
        let share = equation.reading.direct_share[band];
        let row = derivatives(&BlackLevel { bands: 3, level }, &equation, band);
        let with = |step: f64| {
            let mut moved = level;
            moved[band] += step;
            reading(&ReadingCurve::new(moved, curve.transfer, coefficients))
        };
        let numeric = (with(H) - with(-H)) / (2.0 * H);
        assert!((row[band] * share / numeric - 1.0).abs() < 2e-3, "{} {numeric}", row[band]);
        let row = derivatives(&ResponseTerm { coefficients }, &equation, band);
        for (spline, _) in splines(reading(&curve)) {
            let with = |step: f64| {
                let mut moved = coefficients;
                moved[spline] += step;
                reading(&ReadingCurve::new(level, curve.transfer, moved))
            };
            let numeric = (with(1e-3) - with(-1e-3)) / 2e-3;
            assert!((row[spline] * share - numeric).abs() < 0.02, "{} {numeric}", row[spline]);
        }
    }
}

#[test]
fn the_law_of_a_camera_answers_brightness_and_colour() {
    let metered = [Metered { brightness: 0.1, color: [0.2, -0.2, 0.0] }];
    let term = GainLaw { bands: 3, metered: &metered };
    let row = derivatives(&term, &Equation::of_residual(0, 0.0), 1);
    assert_near(row[0], 0.1, "brightness");
    assert_near(row[1], -0.2, "colour of the band");
}

#[test]
fn a_gain_of_a_band_acts_on_its_frame_and_band() {
    let means = vec![0.5; 6];
    let term = frame_gain::FrameGain { frames: 2, bands: 3, means, hold_weight: 2.0 };
    let row = derivatives(&term, &Equation::of_residual(1, 0.4), 2);
    assert_eq!(row, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    // Without light the gains are what they are held to.
    let mut prior = PriorEquations::none(6);
    prior.add(&term, 0);
    let solved = prior.matrix.cholesky().expect("definite").solve(&prior.right);
    assert!(solved.iter().all(|gain| (gain - 0.5).abs() < 1e-12));
}

#[test]
fn a_frame_gain_acts_on_its_own_frame() {
    let term = frame_gain::FrameGain::common(3, 1.0);
    let row = derivatives(&term, &Equation::of_residual(1, 0.4), 0);
    assert_eq!(row, [0.0, 1.0, 0.0]);
}

#[test]
fn the_strobe_position_moves_the_light_path() {
    let config = EstimateConfig::default();
    let setup = setup(&config);
    let (lamps, model) = (Lamps::one(lamp(-0.8, 0.3)), model(setup.grid));
    let o = observation();
    let equations = [equation(&setup, lamps)];
    let log_radiance =
        |_: &Equation, path: &crate::geometry::LightPath| model.log_radiance(path, Removal::FULL);
    let parameters = strobe_position(lamps, &sample_path);
    let term = Geometry::new(&parameters, &equations, &[&o], &log_radiance);
    let row = derivatives(&term, &equations[0], 0);
    for axis in 0..3 {
        let light = |by: f64| {
            let mut position = lamps.origin().vector();
            position[axis] += by;
            let path = sample_path(&o, lamps.moved_to(position)).expect("a lit point");
            model.log_radiance(&path, Removal::FULL)[0]
        };
        let numeric = (light(1e-4) - light(-1e-4)) / 2e-4;
        assert!((row[axis] - numeric).abs() < 0.02, "axis {axis}: {} {numeric}", row[axis]);
    }
}

#[test]
fn a_late_clock_takes_a_later_plane_and_a_rotation_keeps_the_instrument_in_place() {
    let level = Direction::from_vector(Vector3::z()).expect("a direction");
    let track = PlaneTrack { plane: (level, 2.0), around: Some([(level, 1.9), (level, 2.2)]) };
    let instrument = Vector3::new(0.4, 0.0, 0.0);
    let shifted = |by: Vector3<f64>| ShiftedPlanes {
        planes: std::slice::from_ref(&track),
        body_from_optical: Transform::identity(),
        instrument,
        by,
        log_scale: 0.0,
    };
    let o = Observation {
        frame: 0,
        sample: Sample {
            hit: Point::from_vector(Vector3::new(0.0, 0.0, 2.0)),
            seafloor_to_camera_m: 2.0,
            normal: level,
            log_color: [0.0; 3],
        },
    };
    let lamps = Lamps::one(Transform::identity());
    let range =
        |by: Vector3<f64>| shifted(by).path(&o, lamps).expect("a seafloor").seafloor_to_camera_m;
    let later = Vector3::new(geometry::PLANES_AROUND_S, 0.0, 0.0);
    assert_near(range(Vector3::zeros()), 2.0, "as given");
    assert_near(range(later), 2.2, "the later plane");
    assert_near(range(-later), 1.9, "the earlier plane");
    // About the camera's y axis, below an instrument 0.4 m ahead: the seafloor ahead comes up or
    // goes down, that below the instrument stays.
    let rotated = range(Vector3::new(0.0, 0.0, 0.1));
    assert!((rotated - 2.0).abs() > 0.02 && (rotated - 2.0).abs() < 0.08, "{rotated}");
}
