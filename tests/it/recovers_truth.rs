//! Render with a known model → estimate → correct → compare. The renderer shares no code with the
//! estimator.
use crate::support::judge::{Verdict, run};
use crate::support::render::{Dive, DvlType, Sensor, Truth};
use unwater::config::{Estimator, Spreading, StrobePosition, Switch};
use unwater::diagnostics::{ClockFact, Diagnostic, EstimateFact, Fact, MountFact};
use unwater::model::{AttenuationKind, LightLaw};
use unwater::session::Options;
use unwater::vehicle::StrobeSource;

fn judged(dive: &Dive, options: &Options) -> (Verdict, Truth) {
    let folder = tempfile::tempdir().expect("a folder");
    run(dive, options, folder.path())
}

fn assert_near(
    what: &str,
    v: &Verdict,
    truth: &Truth,
    alpha_share: f64,
    beam: f64,
    reflectance: f64,
) {
    for (band, error) in v.attenuation_error_per_m.iter().enumerate() {
        let true_alpha =
            truth.attenuation_per_m[if v.attenuation_error_per_m.len() == 1 { 1 } else { band }];
        assert!(
            error.abs() <= alpha_share * true_alpha,
            "{what}: band {band}: attenuation off by {error:.4} of {true_alpha}"
        );
    }
    assert!(v.beam_log_rmse <= beam, "{what}: beam pattern off by {:.3}", v.beam_log_rmse);
    assert!(
        v.reflectance_error.iter().all(|e| *e <= reflectance),
        "{what}: reflectance off by {:.3?}",
        v.reflectance_error
    );
    assert!(v.model.identified, "{what}: {:?}", v.model.not_identified_because);
}

#[test]
fn slope_tilt_lost_beams_and_noise_over_several_seeds() {
    for seed in [11, 12, 13] {
        let dive = Dive {
            seed,
            frames: 32,
            slope_deg: (6.0, -4.0),
            tilt_deg: 4.0,
            lost_beams: 0.08,
            ..Dive::default()
        };
        let (v, truth) = judged(&dive, &Options::default());
        assert_eq!(v.model.estimator, Estimator::Joint);
        assert_eq!((v.report.corrected, v.report.frames), (32, 32));
        assert_near(&format!("seed {seed}"), &v, &truth, 0.03, 0.05, 0.03);
    }
}

#[test]
fn a_water_linked_dvl_without_beam_vectors_and_a_distorting_lens() {
    let dive = Dive {
        seed: 21,
        frames: 32,
        dvl: DvlType::WaterLinked,
        distortion: [0.18, 0.05, 0.001, -0.001, 0.0],
        sensor: Sensor::Jpeg(92),
        ..Dive::default()
    };
    let (v, truth) = judged(&dive, &Options::default());
    assert_near("jpeg, distorted", &v, &truth, 0.03, 0.05, 0.03);
}

/// A dozen frames of such a camera see hardly any change of height: they are taken apart in time.
#[test]
fn a_quick_camera_says_as_much_as_a_slow_one() {
    let dive = Dive {
        seed: 25,
        frames: 240,
        frames_per_s: 8.0,
        width: 288,
        height: 216,
        focal_px: 345.0,
        ..Dive::default()
    };
    let (v, truth) = judged(&dive, &Options::default());
    assert_near("8 pictures a second", &v, &truth, 0.03, 0.05, 0.03);
}

#[test]
fn one_band_is_enough() {
    let (v, truth) = judged(
        &Dive { seed: 31, frames: 28, sensor: Sensor::Mono16, ..Dive::default() },
        &Options::default(),
    );
    assert_eq!(v.model.attenuation_per_m.len(), 1);
    assert_near("mono", &v, &truth, 0.03, 0.05, 0.03);
}

#[test]
fn the_papers_own_estimator_with_the_strobes_spreading() {
    let mut options = Options::default();
    options.config.estimate.estimator = Estimator::Pairs;
    let (v, truth) = judged(&Dive { seed: 41, frames: 40, ..Dive::default() }, &options);
    assert_eq!(v.model.estimator, Estimator::Pairs);
    // Eq. 17 leaves what the seafloor does not average out: levels are common to all bands, so
    // differences are better.
    let e = &v.attenuation_error_per_m;
    assert!(
        e.iter().all(|e| e.abs() < 0.015)
            && (e[0] - e[1]).abs() < 0.005
            && (e[1] - e[2]).abs() < 0.005,
        "{e:.4?} of {:?}",
        truth.attenuation_per_m
    );
    assert!(v.beam_log_rmse < 0.08, "{}", v.beam_log_rmse);
}

#[test]
fn the_spreading_exponent_comes_out_as_two() {
    let mut options = Options::default();
    options.config.estimate.spreading = Spreading::Fit;
    let (v, _) = judged(&Dive { seed: 51, frames: 40, ..Dive::default() }, &options);
    let exponent = v.model.spreading_exponents.expect("fitted")[0];
    assert!((exponent - 2.0).abs() < 0.2, "{exponent}");
}

/// A frame the wrong way round, a gamma left in, a range taken for an altitude: each must be seen
/// in the numbers.
#[test]
fn the_likeliest_silent_errors_do_not_pass() {
    let dive = Dive { seed: 61, frames: 28, sensor: Sensor::Rgb8, ..Dive::default() };
    let (right, _) = judged(&dive, &Options::default());
    assert!(
        right.attenuation_error_per_m.iter().all(|e| e.abs() < 0.006),
        "{:.4?}",
        right.attenuation_error_per_m
    );
    let mut gamma_left_in = Options::default();
    gamma_left_in.config.light.transfer = "linear".parse().expect("a transfer");
    let (wrong, _) = judged(&dive, &gamma_left_in);
    assert!(
        wrong.attenuation_error_per_m[0].abs() > 0.05,
        "gamma left in: {:.4?}",
        wrong.attenuation_error_per_m
    );
    let mut no_spreading = Options::default();
    no_spreading.config.estimate.spreading = Spreading::None;
    let (effective, _) = judged(&dive, &no_spreading);
    assert_eq!(effective.model.attenuation_kind, AttenuationKind::Effective);
    assert!(
        effective.attenuation_error_per_m.iter().all(|e| *e > 0.1),
        "spreading swallowed: {:.4?}",
        effective.attenuation_error_per_m
    );
    // Ranges a tenth too long, as a vertical range taken for a slant one would be.
    let mut stretched = Options::default();
    stretched.rig.dvl.sound_speed_ratio = Some(1.1);
    let (long, _) = judged(&dive, &stretched);
    assert!(
        long.attenuation_error_per_m[0].abs() > 0.02,
        "ranges a tenth too long: {:.4?}",
        long.attenuation_error_per_m
    );
}

#[test]
fn a_log_without_attitude_is_still_corrected() {
    let (v, truth) = judged(
        &Dive { seed: 71, frames: 32, with_imu: false, tilt_deg: 1.0, ..Dive::default() },
        &Options::default(),
    );
    assert_near("no attitude", &v, &truth, 0.06, 0.05, 0.04);
}

/// No public recording holds a strobe's pose: the log knows where it is.
#[test]
fn a_strobe_that_nobody_measured_is_found_and_a_wrong_one_is_contradicted() {
    let dive = Dive { seed: 81, frames: 40, with_strobe_mount: false, ..Dive::default() };
    let (v, truth) = judged(&dive, &Options::default());
    let strobe = v.model.strobe.as_ref().expect("a strobe");
    assert_eq!(strobe.source, StrobeSource::Found);
    // The camera looks straight down, image up is forward: right = −y, down = −x, ahead = −z of the
    // vehicle.
    let from_camera: Vec<f64> = truth
        .strobe_position_in_base
        .iter()
        .zip([0.34, -0.10, -0.12])
        .map(|(s, c)| s - c)
        .collect();
    let ought = [-from_camera[1], -from_camera[0], -from_camera[2]];
    let is_near = |found: &[f64; 3]| {
        let off = found.iter().zip(ought).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(off < 0.06, "found {off:.3} m off: {found:?} instead of {ought:?}");
    };
    is_near(&strobe.position_in_optical_m);
    assert!(
        v.attenuation_error_per_m.iter().all(|e| e.abs() < 0.01),
        "{:.4?}",
        v.attenuation_error_per_m
    );

    // The same dive with a pose that is 0.3 m off: kept, as it was given, and contradicted.
    let mut wrong = Options::default();
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

    // Sought from nothing, whatever is given: the way is that from the camera.
    wrong.config.estimate.strobe_position = StrobePosition::Find;
    let (v, _) = judged(&dive, &wrong);
    let strobe = v.model.strobe.as_ref().expect("a strobe");
    is_near(&strobe.position_in_optical_m);
    assert!(
        strobe.source == StrobeSource::Found && strobe.moved_m.is_some_and(|m| m > 0.7),
        "{strobe:?}"
    );
}

#[test]
fn frames_at_half_power_are_found_and_set_right() {
    let dive = Dive { seed: 91, frames: 40, half_power_frames: 0.05, ..Dive::default() };
    let (v, truth) = judged(&dive, &Options::default());
    let halved: Vec<i64> =
        truth.frames.iter().filter(|f| f.gain < 1.0).map(|f| f.stamp_ns as i64).collect();
    let found: Vec<i64> = v.model.frame_gains.iter().map(|g| g.stamp_ns).collect();
    assert_eq!(found, halved);
    assert!(
        v.model.frame_gains.iter().all(|g| (g.gain - 0.5).abs() < 0.01),
        "{:?}",
        v.model.frame_gains
    );
    assert_near("half power", &v, &truth, 0.03, 0.05, 0.03);
    let drop_outs = EstimateFact::DropOuts { frames: halved.len() }.into();
    assert!(v.report.diagnostics.contains(&drop_outs), "{:?}", v.report.diagnostics);
}

/// Scattered light is added: taken for attenuation it takes a sixth of that with it.
#[test]
fn what_the_water_scatters_back_is_taken_off() {
    let dive = Dive { seed: 101, frames: 40, backscatter: 0.1, ..Dive::default() };
    let (v, truth) = judged(&dive, &Options::default());
    assert_near("backscatter", &v, &truth, 0.08, 0.05, 0.03);
    let back = v.model.backscatter.as_ref().expect("backscatter");
    let ought = truth.exposure * truth.scattering;
    assert!(
        back.strength_per_m.iter().all(|b| (b / ought - 1.0).abs() < 0.2),
        "{:?} instead of {ought}",
        back.strength_per_m
    );

    let mut off = Options::default();
    off.config.estimate.backscatter = Switch::Off;
    let (without, _) = judged(&dive, &off);
    assert!(without.model.backscatter.is_none());
    assert!(
        without.attenuation_error_per_m[0] < -0.04,
        "unmodelled it would not matter: {:.4?}",
        without.attenuation_error_per_m
    );
    // Three times as much, unmodelled, must not pass for an answer.
    let (murky, _) = judged(&Dive { backscatter: 0.3, ..dive }, &off);
    assert!(!murky.model.identified, "{:.4?} passed for an answer", murky.attenuation_error_per_m);
}

#[test]
fn what_the_lens_takes_is_given_back() {
    let dive = Dive { seed: 131, frames: 28, focal_px: 300.0, vignetting: true, ..Dive::default() };
    let told = Options {
        rig: toml::from_str("[camera]\nvignetting = \"cos4\"\n").expect("a rig"),
        ..Options::default()
    };
    let (v, truth) = judged(&dive, &told);
    assert_near("vignetting", &v, &truth, 0.03, 0.05, 0.03);
    let (untold, _) = judged(&dive, &Options::default());
    assert!(
        untold.reflectance_error[1] > 1.2 * v.reflectance_error[1],
        "{:?} and {:?}",
        untold.reflectance_error,
        v.reflectance_error
    );
}

/// Codes of a response that no named curve has: with the table α comes out, without it does not.
#[test]
fn a_cameras_own_response_is_undone_by_its_table() {
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
        let options = Options { rig: toml::from_str(rig).expect("a rig"), ..Options::default() };
        unwater::run::estimate_logs(&[&path], &options, &unwater::session::Silent)
            .expect("a model")
            .0
            .attenuation_per_m
    };
    let (told, from_file, untold) = (alpha(&inline), alpha(&by_path), alpha(""));
    assert_eq!(told, from_file);
    for (b, ought) in truth.attenuation_per_m.iter().enumerate() {
        assert!((told[b] - ought).abs() < 0.006, "band {b}: {:.4} for {ought}", told[b]);
        assert!((untold[b] - ought).abs() > 0.02, "band {b}: {:.4} without the table", untold[b]);
    }
    let wrong = Options {
        rig: toml::from_str("[camera]\nresponse = [[0.0, 0.0], [0.5, 0.7], [1.0, 0.6]]")
            .expect("a rig"),
        ..Options::default()
    };
    let error = unwater::run::estimate_logs(&[&path], &wrong, &unwater::session::Silent)
        .expect_err("it falls")
        .to_string();
    assert!(error.contains("camera.response") && error.contains("[1, 0.6]"), "{error}");
}

/// Whether a gain is a factor or counts decibels no message says; the pictures do.
#[test]
fn gains_told_on_a_channel_are_taken_out() {
    for (decibels, seed, law) in [(false, 121, LightLaw::Factor), (true, 122, LightLaw::Decibel)] {
        let (v, truth) = judged(
            &Dive { seed, frames: 32, gain_channel: Some(decibels), ..Dive::default() },
            &Options::default(),
        );
        let settings: Vec<_> =
            v.model.light_settings.iter().map(|s| (s.topic.as_str(), s.law)).collect();
        assert_eq!(settings, [("/camera/gain", law)]);
        assert_near("gain channel", &v, &truth, 0.03, 0.05, 0.04);
    }
}

#[test]
fn water_that_changes_is_followed_and_steady_water_is_not_split() {
    let (v, truth) = judged(
        &Dive { seed: 111, frames: 48, attenuation_drift: 0.3, ..Dive::default() },
        &Options::default(),
    );
    assert!(v.model.segments.0.len() >= 3, "{} nodes", v.model.segments.0.len());
    for frame in &truth.frames {
        let at = v.model.segments.at(unwater::units::Stamp(frame.stamp_ns as i64)).expect("nodes");
        for b in 0..3 {
            let ought = frame.attenuation_per_m[b];
            assert!(
                (at[b] / ought - 1.0).abs() < 0.1,
                "band {b}: {:.4} instead of {ought:.4}",
                at[b]
            );
        }
    }
    let (steady, _) =
        judged(&Dive { seed: 112, frames: 32, ..Dive::default() }, &Options::default());
    assert!(steady.model.segments.0.is_empty() && steady.model.backscatter.is_none());
}

fn codes(v: &Verdict) -> Vec<&str> {
    v.report.diagnostics.iter().map(Diagnostic::code).collect()
}

/// What the log says against clock and mounts.
fn contradicted(v: &Verdict) -> Vec<Diagnostic> {
    let is_meant = |d: &&Diagnostic| d.code().ends_with("-contradicted");
    v.report.diagnostics.iter().filter(is_meant).cloned().collect()
}

/// What the log cannot tell must not pass for an answer.
#[test]
fn a_single_altitude_is_called_not_identified() {
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
        "from one height nothing can be said of the strobe: {:?}",
        v.report.diagnostics
    );
}

#[test]
fn a_late_clock_and_a_turned_mount_are_told_and_nothing_else_is() {
    let dive = Dive { seed: 141, frames: 40, ..Dive::default() };
    let (v, _) = judged(&dive, &Options::default());
    assert!(contradicted(&v).is_empty(), "{:?}", contradicted(&v));

    let late = Options {
        rig: toml::from_str("[time_offset_s]\n\"/camera/image_raw\" = 0.2\n").expect("a rig"),
        ..Options::default()
    };
    let (v, _) = judged(&dive, &late);
    let check = v.model.mount_check.as_ref().expect("a check");
    assert!((check.clock_offset_s + 0.2).abs() < 0.03, "{check:?}");
    let time_offset = contradicted(&v).into_iter().find_map(|d| match d.fact {
        Fact::ClockFact(ClockFact::CameraContradicted { time_offset_s, .. }) => Some(time_offset_s),
        _ => None,
    });
    assert!(time_offset.is_some_and(|s| s.abs() < 0.03), "{:?}", contradicted(&v));

    // Pitched by 2° in the vehicle (y to port) is 2° too far about the camera's x (to starboard)
    // the other way.
    let mount = "[dvl.mount]\ntranslation_m = [-0.08, 0.15, -0.16]\nroll_pitch_yaw_deg = [180.0, \
                 2.0, 0.0]\n";
    let (v, _) = judged(
        &dive,
        &Options { rig: toml::from_str(mount).expect("a rig"), ..Options::default() },
    );
    let check = v.model.mount_check.as_ref().expect("a check");
    assert!((check.turn_deg[0] - 2.0).abs() < 0.5 && check.turn_deg[1].abs() < 0.5, "{check:?}");
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
fn ground_that_is_not_flat_is_followed_and_flat_ground_is_left_a_plane() {
    let dive = Dive { seed: 151, frames: 40, relief_m: 0.15, ..Dive::default() };
    let is_told = |v: &Verdict| codes(v).contains(&"seafloor-not-flat");
    let (v, truth) = judged(&dive, &Options::default());
    assert!(is_told(&v), "{:?}", v.report.diagnostics);
    assert_near("ridges", &v, &truth, 0.06, 0.05, 0.04);
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
    assert!(!is_told(&flat), "{:?}", flat.report.diagnostics);
}

#[test]
fn a_return_leg_is_matched_with_the_way_out() {
    let dive = Dive { seed: 161, frames: 48, return_leg: true, ..Dive::default() };
    let (v, truth) = judged(&dive, &Options::default());
    assert_near("return leg", &v, &truth, 0.03, 0.05, 0.03);
    let longest = v.model.estimators[&Estimator::Joint].details["longest_track_frames"];
    assert!(longest > 20.0, "the way out and the way back share no point: {longest}");
}

#[test]
fn two_strobes_are_told_from_one() {
    let dive = Dive { seed: 171, frames: 40, second_strobe: true, ..Dive::default() };
    let (v, truth) = judged(&dive, &Options::default());
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
    assert!(one.reflectance_error[1] > 1.5 * v.reflectance_error[1]);
    assert_near("two strobes", &v, &truth, 0.04, 0.06, 0.04);
}

#[test]
fn two_lamps_side_by_side_are_one() {
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
        assert!(
            (a - b).abs() < 0.002,
            "{:.4?} and {:.4?}",
            one.attenuation_error_per_m,
            two.attenuation_error_per_m
        );
    }
    assert_near("side by side", &two, &truth, 0.03, 0.05, 0.03);
}
