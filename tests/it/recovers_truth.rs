//! Render with a known model → estimate → correct → compare. The renderer shares no code with the
//! estimator.
use std::cell::RefCell;
use std::rc::Rc;

use crate::support::judge::{Verdict, assert_within, corrected};
use crate::support::render::conditions::Conditions;
use crate::support::render::{Dive, DvlType, Sensor, Truth};
use tempfile::TempDir;
use unwater::config::{Estimator, SelfCalibration, Spreading, StrobePosition, Switch};
use unwater::diagnostics::{ClockFact, Diagnostic, EstimateFact, Fact, MountFact};
use unwater::model::{AttenuationKind, LightLaw};
use unwater::session::Options;
use unwater::vehicle::StrobeSource;

thread_local! {
    /// The dive that the test rendered last, for other options: a dive takes as long as its
    /// estimate.
    static RENDERED: RefCell<Option<(String, TempDir, Rc<Truth>)>> = const { RefCell::new(None) };
}

fn judged(dive: &Dive, options: &Options) -> (Verdict, Rc<Truth>) {
    let name = format!("{dive:?}");
    RENDERED.with_borrow_mut(|rendered| {
        let same = rendered.take().filter(|(of, ..)| *of == name);
        let (_, folder, truth) = rendered.insert(same.unwrap_or_else(|| {
            let folder = tempfile::tempdir().expect("a folder");
            let truth = dive.write(&folder.path().join("dive.mcap"));
            (name, folder, truth.into())
        }));
        (corrected(dive, truth, options, folder.path()).0, Rc::clone(truth))
    })
}

/// Faults are reported and not compensated.
fn reporting() -> Options {
    let mut options = Options::default();
    options.config.estimate.self_calibration = SelfCalibration::Report;
    options
}

/// Largest accepted errors, 1.5 times those measured. Those of attenuation are never below
/// 0.001 per metre, as the error of a single dive may be small by chance.
struct Bounds<'a> {
    /// per band (1/m)
    attenuation_per_m: &'a [f64],
    /// RMSE of the logarithm of the beam pattern
    beam_log: f64,
    /// median relative error, per band
    reflectance: &'a [f64],
}

fn assert_attenuation(what: &str, v: &Verdict, bounds_per_m: &[f64]) {
    assert_eq!(v.attenuation_error_per_m.len(), bounds_per_m.len(), "{what}: bands");
    for (band, (error, bound)) in v.attenuation_error_per_m.iter().zip(bounds_per_m).enumerate() {
        assert_within(&format!("{what}: attenuation, band {band} [1/m]"), *error, *bound);
    }
}

fn assert_near(what: &str, v: &Verdict, bounds: &Bounds) {
    let strobe = v.model.strobe.as_ref().map(|s| s.source.to_string()).unwrap_or_default();
    println!("{what}: strobe {strobe}, camera {:?}", v.model.camera);
    assert_attenuation(what, v, bounds.attenuation_per_m);
    assert_within(&format!("{what}: beam pattern"), v.beam_log_rmse, bounds.beam_log);
    assert_eq!(v.reflectance_error.len(), bounds.reflectance.len(), "{what}: bands");
    for (band, (error, bound)) in v.reflectance_error.iter().zip(bounds.reflectance).enumerate() {
        assert_within(&format!("{what}: reflectance, band {band}"), *error, *bound);
    }
    assert!(v.model.identified, "{what}: {:?}", v.model.not_identified_because);
}

#[test]
fn sloping_seafloor_tilt_lost_beams_and_noise_over_three_seeds() {
    for seed in [11, 12, 13] {
        let dive = Dive {
            seed,
            frames: 32,
            slope_deg: (6.0, -4.0),
            tilt_deg: 4.0,
            lost_beams: 0.08,
            ..Dive::default()
        };
        let (v, _) = judged(&dive, &Options::default());
        assert_eq!(v.model.estimator, Estimator::Joint);
        assert_eq!((v.report.corrected, v.report.frames), (32, 32));
        let bounds = Bounds {
            attenuation_per_m: &[0.0034, 0.0022, 0.0015],
            beam_log: 0.0137,
            reflectance: &[0.0273, 0.0135, 0.0203],
        };
        assert_near(&format!("seed {seed}"), &v, &bounds);
    }
}

#[test]
fn water_linked_dvl_without_beam_vectors_and_lens_distortion() {
    let dive = Dive {
        seed: 21,
        frames: 32,
        dvl: DvlType::WaterLinked,
        distortion: [0.18, 0.05, 0.001, -0.001, 0.0],
        sensor: Sensor::Jpeg(92),
        ..Dive::default()
    };
    let (v, _) = judged(&dive, &Options::default());
    let bounds = Bounds {
        attenuation_per_m: &[0.001, 0.0032, 0.0042],
        beam_log: 0.0089,
        reflectance: &[0.0219, 0.0109, 0.0154],
    };
    assert_near("jpeg, distorted", &v, &bounds);
}

/// Held still, the mount is wrong by up to 12°.
#[test]
fn a_camera_on_a_servo_is_followed() {
    let dive = Dive {
        seed: 26,
        frames: 32,
        slope_deg: (4.0, 2.0),
        conditions: Conditions { servo_deg: 12.0, ..Conditions::default() },
        ..Dive::default()
    };
    let (v, _) = judged(&dive, &Options::default());
    let bounds = Bounds {
        attenuation_per_m: &[0.003, 0.003, 0.003],
        beam_log: 0.0137,
        reflectance: &[0.0273, 0.0135, 0.0203],
    };
    assert_near("servo", &v, &bounds);
    // An attitude sensor beside the camera turns with it.
    let conditions = Conditions { imu_on_servo: true, ..dive.conditions.clone() };
    let (beside, _) = judged(&Dive { conditions, ..dive.clone() }, &Options::default());
    assert_near("servo with attitude", &beside, &bounds);
    let has = |code: &str| v.report.diagnostics.iter().any(|d| d.code() == code);
    assert!(has("joint-followed") && !has("joint-contradicted"), "{:?}", v.report.diagnostics);
    // Lamps beside the servo turn in the image.
    let conditions = Conditions { lamps_stay: true, ..dive.conditions.clone() };
    let (v, _) = judged(&Dive { conditions, frames: 20, ..dive }, &Options::default());
    println!("measured lamps that stay: {:.4?}", v.attenuation_error_per_m);
    let reason = v.model.not_identified_because.unwrap_or_default();
    assert!(reason.contains("the lamps do not"), "{reason}");
}

/// A dozen consecutive frames of such a camera see hardly any change of altitude: frames have to be
/// selected that are apart in time.
#[test]
fn a_high_frame_rate_does_not_degrade_the_estimate() {
    let dive = Dive {
        seed: 25,
        frames: 240,
        frames_per_s: 8.0,
        width: 288,
        height: 216,
        focal_px: 345.0,
        ..Dive::default()
    };
    let (v, _) = judged(&dive, &Options::default());
    let bounds = Bounds {
        attenuation_per_m: &[0.001, 0.001, 0.0018],
        beam_log: 0.008,
        reflectance: &[0.0255, 0.0124, 0.0181],
    };
    assert_near("8 frames per second", &v, &bounds);
}

#[test]
fn monochrome_images_are_corrected() {
    let (v, _) = judged(
        &Dive { seed: 31, frames: 28, sensor: Sensor::Mono16, ..Dive::default() },
        &Options::default(),
    );
    assert_eq!(v.model.attenuation_per_m.len(), 1);
    let bounds = Bounds { attenuation_per_m: &[0.001], beam_log: 0.0098, reflectance: &[0.0076] };
    assert_near("mono", &v, &bounds);
}

#[test]
fn pairs_estimator_with_spreading_from_the_strobe() {
    let mut options = Options::default();
    options.config.estimate.estimator = Estimator::Pairs;
    let (v, _) = judged(&Dive { seed: 41, frames: 40, ..Dive::default() }, &options);
    assert_eq!(v.model.estimator, Estimator::Pairs);
    assert_attenuation("pairs", &v, &[0.0143, 0.0145, 0.0147]);
    // Eq. 17 averages over the seafloor; what remains is common to all bands, so differences
    // between bands are more accurate.
    let e = &v.attenuation_error_per_m;
    assert_within("pairs: attenuation, red − green [1/m]", e[0] - e[1], 0.001);
    assert_within("pairs: attenuation, green − blue [1/m]", e[1] - e[2], 0.001);
    assert_within("pairs: beam pattern", v.beam_log_rmse, 0.0464);
}

#[test]
fn fitted_spreading_exponent_is_two() {
    let mut options = Options::default();
    options.config.estimate.spreading = Spreading::Fit;
    let (v, _) = judged(&Dive { seed: 51, frames: 40, ..Dive::default() }, &options);
    let exponent = v.model.spreading_exponents.expect("fitted")[0];
    assert_within("spreading exponent", exponent - 2.0, 0.0243);
}

/// A gamma left in, spreading left out, a range taken for an altitude: each must show in the
/// numbers, or the bounds of the other tests could not detect them.
#[test]
fn likely_silent_errors_exceed_the_bounds() {
    let dive = Dive { seed: 61, frames: 28, sensor: Sensor::Rgb8, ..Dive::default() };
    let (right, _) = judged(&dive, &Options::default());
    assert_attenuation("8-bit sRGB", &right, &[0.001; 3]);
    let mut as_given = Options::default();
    as_given.config.estimate.self_calibration = SelfCalibration::Off;
    let mut gamma_left_in = as_given.clone();
    gamma_left_in.config.light.transfer = "linear".parse().expect("a transfer");
    let (wrong, _) = judged(&dive, &gamma_left_in);
    assert!(
        wrong.attenuation_error_per_m[0].abs() > 0.05,
        "gamma left in: {:.4?}",
        wrong.attenuation_error_per_m
    );
    let mut no_spreading = as_given.clone();
    no_spreading.config.estimate.spreading = Spreading::None;
    let (effective, _) = judged(&dive, &no_spreading);
    assert_eq!(effective.model.attenuation_kind, AttenuationKind::Effective);
    assert!(
        effective.attenuation_error_per_m.iter().all(|e| *e > 0.1),
        "spreading left out: {:.4?}",
        effective.attenuation_error_per_m
    );
    // Ranges a tenth too long, as a vertical range taken for a slant one would be.
    let mut stretched = as_given;
    stretched.rig.dvl.sound_speed_ratio = Some(1.1);
    let (long, _) = judged(&dive, &stretched);
    assert!(
        long.attenuation_error_per_m[0].abs() > 0.02,
        "ranges a tenth too long: {:.4?}",
        long.attenuation_error_per_m
    );
}

#[test]
fn log_without_attitude_is_corrected() {
    let (v, _) = judged(
        &Dive { seed: 71, frames: 32, with_imu: false, tilt_deg: 1.0, ..Dive::default() },
        &Options::default(),
    );
    let bounds = Bounds {
        attenuation_per_m: &[0.0173, 0.0088, 0.0082],
        beam_log: 0.0177,
        reflectance: &[0.0288, 0.0166, 0.023],
    };
    assert_near("no attitude", &v, &bounds);
}

/// Public recordings hold no strobe pose, so it has to be estimated from the log.
#[test]
fn unknown_strobe_position_is_estimated_and_a_wrong_one_is_reported() {
    let dive = Dive { seed: 81, frames: 40, with_strobe_mount: false, ..Dive::default() };
    let (v, truth) = judged(&dive, &Options::default());
    let strobe = v.model.strobe.as_ref().expect("a strobe");
    assert_eq!(strobe.source, StrobeSource::Found);
    // The camera looks straight down and image up is forward: x_optical = −y, y_optical = −x and
    // z_optical = −z of the vehicle.
    let from_camera: Vec<f64> = truth
        .strobe_position_in_base
        .iter()
        .zip([0.34, -0.10, -0.12])
        .map(|(s, c)| s - c)
        .collect();
    let expected = [-from_camera[1], -from_camera[0], -from_camera[2]];
    let distance_m = |found: &[f64; 3]| {
        found.iter().zip(expected).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let error_m = distance_m(&strobe.position_in_optical_m);
    assert_within("strobe: position [m]", error_m, 0.0345);
    assert_attenuation("strobe", &v, &[0.0084, 0.0067, 0.0067]);

    // The same dive with a pose that is 0.3 m off: it is used as given, and reported as wrong.
    let mut wrong = reporting();
    let place = truth.strobe_position_in_base;
    let mount = format!(
        "[strobe.mount]\ntranslation_m = [{}, {}, {}]\nrotation_xyzw = [0.7071, -0.7071, 0.0, \
         0.0]\n",
        place[0] + 0.3,
        place[1],
        place[2]
    );
    wrong.rig = toml::from_str(&mount).expect("a rig");
    let (v, _) = judged(&dive, &wrong);
    let is_contradicted = v.report.diagnostics.iter().any(|d| match d.fact {
        Fact::MountFact(MountFact::StrobeContradicted { moved_m, .. }) => {
            (moved_m - 0.3).abs() < 0.1
        }
        _ => false,
    });
    assert!(is_contradicted, "{:?}", v.report.diagnostics);

    // Estimated although a position is given: it is searched from the camera's own position.
    wrong.config.estimate.strobe_position = StrobePosition::Find;
    let (v, _) = judged(&dive, &wrong);
    let strobe = v.model.strobe.as_ref().expect("a strobe");
    let error_m = distance_m(&strobe.position_in_optical_m);
    assert_within("strobe, searched: position [m]", error_m, 0.0345);
    assert!(
        strobe.source == StrobeSource::Found && strobe.moved_m.is_some_and(|m| m > 0.7),
        "{strobe:?}"
    );
}

#[test]
fn frames_at_half_strobe_power_are_detected_and_corrected() {
    let dive = Dive { seed: 91, frames: 40, half_power_frames: 0.05, ..Dive::default() };
    let (v, truth) = judged(&dive, &Options::default());
    let halved: Vec<i64> =
        truth.frames.iter().filter(|f| f.gain < 1.0).map(|f| f.stamp_ns as i64).collect();
    let found: Vec<i64> = v.model.frame_gains.iter().map(|g| g.stamp_ns).collect();
    assert_eq!(found, halved);
    for gain in &v.model.frame_gains {
        assert_within("half power: frame gain", gain.gain - 0.5, 0.0015);
    }
    let bounds = Bounds {
        attenuation_per_m: &[0.001, 0.001, 0.001],
        beam_log: 0.0068,
        reflectance: &[0.03, 0.0137, 0.0215],
    };
    assert_near("half power", &v, &bounds);
    let drop_outs = EstimateFact::DropOuts { frames: halved.len() }.into();
    assert!(v.report.diagnostics.contains(&drop_outs), "{:?}", v.report.diagnostics);
}

/// Backscatter adds light: if it is not modelled, attenuation comes out a sixth too small.
#[test]
fn backscatter_is_modelled_and_subtracted() {
    let dive = Dive { seed: 101, frames: 40, backscatter: 0.1, ..Dive::default() };
    let (v, truth) = judged(&dive, &Options::default());
    let bounds = Bounds {
        attenuation_per_m: &[0.0063, 0.0025, 0.0018],
        beam_log: 0.0115,
        reflectance: &[0.03, 0.0133, 0.0215],
    };
    assert_near("backscatter", &v, &bounds);
    let back = v.model.backscatter.as_ref().expect("backscatter");
    let expected = truth.exposure * truth.scattering;
    for strength in &back.strength_per_m {
        assert_within("backscatter: strength, relative", strength / expected - 1.0, 0.124);
    }

    let mut off = Options::default();
    off.config.estimate.backscatter = Switch::Off;
    let mut ideal = off.clone();
    ideal.config.estimate.self_calibration = SelfCalibration::Off;
    let (without, _) = judged(&dive, &ideal);
    assert!(without.model.backscatter.is_none());
    assert!(
        without.attenuation_error_per_m[0] < -0.04,
        "without the model the error is no larger: {:.4?}",
        without.attenuation_error_per_m
    );
    // Three times as much backscatter, not modelled, must not be reported as identified.
    let (murky, _) = judged(&Dive { backscatter: 0.3, ..dive }, &off);
    assert!(
        !murky.model.identified,
        "{:.4?} reported as identified",
        murky.attenuation_error_per_m
    );
}

#[test]
fn vignetting_given_in_the_rig_is_corrected() {
    let conditions = Conditions { vignetting_exponent: 4.0, ..Conditions::default() };
    let dive = Dive { seed: 131, frames: 28, focal_px: 300.0, conditions, ..Dive::default() };
    let with_vignetting = Options {
        rig: toml::from_str("[camera]\nvignetting = \"cos4\"\n").expect("a rig"),
        ..Options::default()
    };
    let (v, _) = judged(&dive, &with_vignetting);
    let bounds = Bounds {
        attenuation_per_m: &[0.0039, 0.0023, 0.0014],
        beam_log: 0.0087,
        reflectance: &[0.03, 0.0155, 0.0231],
    };
    assert_near("vignetting", &v, &bounds);
    let mut ideal = Options::default();
    ideal.config.estimate.self_calibration = SelfCalibration::Off;
    let (without, _) = judged(&dive, &ideal);
    assert!(
        without.reflectance_error[1] > 1.2 * v.reflectance_error[1],
        "{:?} and {:?}",
        without.reflectance_error,
        v.reflectance_error
    );
}

/// A camera response that no named transfer curve has: α is right with its table and wrong without.
#[test]
fn camera_response_table_is_inverted() {
    let folder = tempfile::tempdir().expect("a folder");
    let dive = Dive { seed: 151, frames: 28, ..Dive::default() };
    let code_of = |light: f64| 0.15 * light + 0.85 * light.powf(0.55);
    let path = folder.path().join("dive.mcap");
    let truth = dive.write(&path);
    crate::support::transcode::with_pixels(
        &path,
        "/camera/image_raw",
        2 * dive.width * dive.height,
        |codes| {
            for code in codes.chunks_exact_mut(2) {
                let light = f64::from(u16::from_le_bytes([code[0], code[1]]) >> 4) / 4095.0;
                code.copy_from_slice(
                    &(((code_of(light) * 4095.0).round() as u16) << 4).to_le_bytes(),
                );
            }
        },
    );
    let points = (0..=64)
        .map(|i| f64::from(i) / 64.0)
        .map(|t| t * t)
        .map(|light| format!("[{:.6}, {light:.6}]", code_of(light)));
    let inline =
        format!("[camera]\nresponse = [{}]\n", points.clone().collect::<Vec<_>>().join(", "));
    let csv = folder.path().join("response.csv");
    std::fs::write(
        &csv,
        points.map(|p| p.trim_matches(['[', ']']).to_string() + "\n").collect::<String>(),
    )
    .expect("a table");
    let by_path = format!("[camera]\nresponse = {:?}\n", csv.display().to_string());
    let alpha = |rig: &str| {
        // No other curve is looked for.
        let mut options =
            Options { rig: toml::from_str(rig).expect("a rig"), ..Options::default() };
        options.config.estimate.self_calibration = SelfCalibration::Off;
        unwater::run::estimate_logs(&[&path], &options, &unwater::session::Silent)
            .expect("a model")
            .0
            .attenuation_per_m
    };
    let (with, from_file, without) = (alpha(&inline), alpha(&by_path), alpha(""));
    assert_eq!(with, from_file);
    for (b, expected) in truth.attenuation_per_m.iter().enumerate() {
        let what = format!("response table: attenuation, band {b} [1/m]");
        assert_within(&what, with[b] - expected, [0.0031, 0.0017, 0.001][b]);
        assert!((without[b] - expected).abs() > 0.02, "band {b}: {:.4}, no table", without[b]);
    }
    let wrong = Options {
        rig: toml::from_str("[camera]\nresponse = [[0.0, 0.0], [0.5, 0.7], [1.0, 0.6]]")
            .expect("a rig"),
        ..Options::default()
    };
    let error = unwater::run::estimate_logs(&[&path], &wrong, &unwater::session::Silent)
        .expect_err("the table is not monotonic")
        .to_string();
    assert!(error.contains("camera.response") && error.contains("[1, 0.6]"), "{error}");
}

/// No message states whether a gain is a factor or in decibels; the images decide.
#[test]
fn recorded_gains_are_compensated_as_factor_or_decibel() {
    for (decibels, seed, law) in [(false, 121, LightLaw::Factor), (true, 122, LightLaw::Decibel)] {
        let (v, _) = judged(
            &Dive { seed, frames: 32, gain_channel: Some(decibels), ..Dive::default() },
            &Options::default(),
        );
        let settings: Vec<_> =
            v.model.light_settings.iter().map(|s| (s.topic.as_str(), s.law)).collect();
        assert_eq!(settings, [("/camera/gain", law)]);
        let bounds = Bounds {
            attenuation_per_m: &[0.0018, 0.0021, 0.0024],
            beam_log: 0.0113,
            reflectance: &[0.04, 0.0178, 0.0266],
        };
        assert_near("gain channel", &v, &bounds);
    }
}

#[test]
fn drifting_attenuation_is_followed_and_constant_attenuation_is_not_split() {
    let (v, truth) = judged(
        &Dive { seed: 111, frames: 48, attenuation_drift: 0.3, ..Dive::default() },
        &Options::default(),
    );
    assert!(v.model.segments.0.len() >= 3, "{} nodes", v.model.segments.0.len());
    let mut worst = [0.0; 3];
    for frame in &truth.frames {
        let at = v.model.segments.at(unwater::units::Stamp(frame.stamp_ns as i64)).expect("nodes");
        for b in 0..3 {
            let error = at[b] / frame.attenuation_per_m[b] - 1.0;
            worst[b] = f64::max(worst[b], error.abs());
        }
    }
    for (band, worst) in worst.iter().enumerate() {
        let what = format!("drift: attenuation of a frame, band {band}, relative");
        assert_within(&what, *worst, [0.0281, 0.0673, 0.1][band]);
    }
    let (steady, _) =
        judged(&Dive { seed: 112, frames: 32, ..Dive::default() }, &Options::default());
    assert!(steady.model.segments.0.is_empty() && steady.model.backscatter.is_none());
}

fn codes(v: &Verdict) -> Vec<&str> {
    v.report.diagnostics.iter().map(Diagnostic::code).collect()
}

/// Diagnostics by which the log contradicts a clock or a mount.
fn contradicted(v: &Verdict) -> Vec<Diagnostic> {
    let is_meant = |d: &&Diagnostic| d.code().ends_with("-contradicted");
    v.report.diagnostics.iter().filter(is_meant).cloned().collect()
}

/// Attenuation that the log does not determine must not be reported as identified.
#[test]
fn a_single_altitude_is_not_identified() {
    let (v, _) = judged(
        &Dive { seed: 102, frames: 24, altitude_m: (2.0, 2.05), ..Dive::default() },
        &Options::default(),
    );
    assert!(
        !v.model.identified && codes(&v).contains(&"not-identified-altitude"),
        "{:?}",
        v.report.diagnostics
    );
    assert!(
        contradicted(&v).is_empty(),
        "one altitude does not determine the strobe position: {:?}",
        v.report.diagnostics
    );
}

#[test]
fn clock_offset_and_rotated_mount_are_reported_and_nothing_else() {
    let dive = Dive { seed: 141, frames: 40, ..Dive::default() };
    let (v, _) = judged(&dive, &Options::default());
    assert!(contradicted(&v).is_empty(), "{:?}", contradicted(&v));

    let late = Options {
        rig: toml::from_str("[time_offset_s]\n\"/camera/image_raw\" = 0.2\n").expect("a rig"),
        ..reporting()
    };
    let (v, _) = judged(&dive, &late);
    let check = v.model.mount_check.as_ref().expect("a check");
    assert_within("clock offset [s]", check.clock_offset_s + 0.2, 0.0061);
    let time_offset = contradicted(&v).into_iter().find_map(|d| match d.fact {
        Fact::ClockFact(ClockFact::CameraContradicted { time_offset_s, .. }) => Some(time_offset_s),
        _ => None,
    });
    assert!(time_offset.is_some_and(|s| s.abs() < 0.03), "{:?}", contradicted(&v));

    // A pitch of 2° about the vehicle's y axis (to port) is −2° about the camera's x axis (to
    // starboard), so the correction is +2°.
    let mount = "[dvl.mount]\ntranslation_m = [-0.08, 0.15, -0.16]\nroll_pitch_yaw_deg = [180.0, \
                 2.0, 0.0]\n";
    let (v, _) =
        judged(&dive, &Options { rig: toml::from_str(mount).expect("a rig"), ..reporting() });
    let check = v.model.mount_check.as_ref().expect("a check");
    assert_within("mount: rotation about x [°]", check.turn_deg[0] - 2.0, 0.092);
    assert_within("mount: rotation about y [°]", check.turn_deg[1], 0.5);
    // The remedy is the mount as it was rendered: half a turn about x.
    let q = contradicted(&v).into_iter().find_map(|d| match d.fact {
        Fact::MountFact(MountFact::DvlContradicted { rotation_xyzw, .. }) => Some(rotation_xyzw),
        _ => None,
    });
    let q = q.expect("a mount");
    assert!(
        q[0].abs() > 0.9999 && q[1].abs() < 0.008 && q[2].abs() < 0.02 && q[3].abs() < 0.008,
        "{q:?}"
    );
}

#[test]
fn terrain_is_modelled_and_a_flat_seafloor_stays_a_plane() {
    let dive = Dive { seed: 151, frames: 40, relief_m: 0.15, ..Dive::default() };
    let is_reported = |v: &Verdict| codes(v).contains(&"seafloor-not-flat");
    let (v, _) = judged(&dive, &Options::default());
    assert!(is_reported(&v), "{:?}", v.report.diagnostics);
    let bounds = Bounds {
        attenuation_per_m: &[0.0068, 0.0054, 0.0059],
        beam_log: 0.0357,
        reflectance: &[0.04, 0.0362, 0.04],
    };
    assert_near("ridges", &v, &bounds);
    let mut off = Options::default();
    off.config.seafloor.relief = Switch::Off;
    let (plane, _) = judged(&dive, &off);
    assert!(
        plane.reflectance_error[1] > 2.0 * v.reflectance_error[1],
        "{:?} and {:?}",
        plane.reflectance_error,
        v.reflectance_error
    );
    let (flat, _) = judged(&Dive { relief_m: 0.0, frames: 24, ..dive }, &Options::default());
    assert!(!is_reported(&flat), "{:?}", flat.report.diagnostics);
}

#[test]
fn return_leg_is_matched_with_the_outward_leg() {
    let dive = Dive { seed: 161, frames: 48, return_leg: true, ..Dive::default() };
    let (v, _) = judged(&dive, &Options::default());
    let bounds = Bounds {
        attenuation_per_m: &[0.0017, 0.001, 0.001],
        beam_log: 0.0104,
        reflectance: &[0.0283, 0.0127, 0.0203],
    };
    assert_near("return leg", &v, &bounds);
    let longest = v.model.estimators[&Estimator::Joint].details["longest_track_frames"];
    assert!(longest > 20.0, "the two legs share no keypoint: {longest}");
}

#[test]
fn two_strobes_are_modelled_as_two() {
    let dive = Dive { seed: 171, frames: 40, second_strobe: true, ..Dive::default() };
    let (v, _) = judged(&dive, &Options::default());
    assert!(
        v.report.diagnostics.iter().any(|d| match &d.fact {
            Fact::MountFact(MountFact::SeveralStrobes { frames, used: 2 }) => {
                frames.iter().any(|f| f == "second_strobe_optical_frame")
            }
            _ => false,
        }),
        "{:?}",
        v.report.diagnostics
    );
    let mut named = Options::default();
    named.selection.strobe_frame = Some("strobe_optical_frame".into());
    let (one, _) = judged(&dive, &named);
    // One lamp does not explain the light of two.
    assert!(v.model.residual_light.is_none(), "{:?}", v.model.verdict);
    assert!(one.model.residual_light.is_some(), "{:?}", one.model.verdict);
    named.config.estimate.residual_light = Switch::Off;
    let (one, _) = judged(&dive, &named);
    let (one, both) = (one.reflectance_error[1], v.reflectance_error[1]);
    assert!(one > 1.5 * both, "{one} with one lamp, {both} with both");
    let bounds = Bounds {
        attenuation_per_m: &[0.0012, 0.001, 0.001],
        beam_log: 0.0161,
        reflectance: &[0.0273, 0.0123, 0.0199],
    };
    assert_near("two strobes", &v, &bounds);
}

#[test]
fn two_adjacent_lamps_equal_one() {
    let dive = Dive { seed: 181, frames: 32, ..Dive::default() };
    let (one, truth) = judged(&dive, &Options::default());
    let lamp = |beside: f64| {
        let [x, y, z] = truth.strobe_position_in_base;
        format!(
            "[[strobe.lamps]]\ntranslation_m = [{x}, {}, {z}]\nrotation_xyzw = {:?}\n",
            y + beside,
            truth.strobe_orientation_xyzw
        )
    };
    let rig = toml::from_str(&(lamp(0.04) + &lamp(-0.04))).expect("a rig");
    let (two, _) = judged(&dive, &Options { rig, ..Options::default() });
    for (a, b) in one.attenuation_error_per_m.iter().zip(&two.attenuation_error_per_m) {
        assert_within("two lamps or one: attenuation [1/m]", a - b, 0.0006);
    }
    let bounds = Bounds {
        attenuation_per_m: &[0.0016, 0.0018, 0.0022],
        beam_log: 0.0111,
        reflectance: &[0.0264, 0.0123, 0.0189],
    };
    assert_near("two lamps", &two, &bounds);
}
