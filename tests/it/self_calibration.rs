//! Faults of camera, strobe position and clock that no channel reports: rendered, estimated,
//! corrected and compared with the truth.
use crate::support::evenness::Evenness;
use crate::support::judge::{Verdict, assert_within, run_and_show};
use crate::support::render::conditions::{Conditions, Response, SettingsMessage};
use crate::support::render::{Dive, DvlType, Sensor};
use unwater::config::SelfCalibration;
use unwater::model::LightLaw;
use unwater::run::estimate;
use unwater::session::{CameraSession, Options, Silent};

fn dive(seed: u64, conditions: Conditions) -> Dive {
    Dive { seed, frames: 40, conditions, ..Dive::default() }
}

/// Runs a dive, and measures how even its corrected images are.
fn judged(dive: &Dive, options: &Options) -> (Verdict, Evenness) {
    let folder = tempfile::tempdir().expect("a folder");
    let (verdict, truth, images) = run_and_show(dive, options, folder.path());
    let blocks = dive.width / 4 * (dive.height / 4);
    let none = vec![vec![false; blocks]; images.len()];
    let evenness = Evenness::of(dive, &truth, &images, &none);
    (verdict, evenness)
}

/// Attenuation within `bound_per_m` and three standard deviations, images as even as
/// `[flat, cv, hue]`.
fn assert_calibrated(what: &str, dive: &Dive, bound_per_m: f64, images: [f64; 3]) -> Verdict {
    let (v, evenness) = judged(dive, &Options::default());
    let of_bands = v.attenuation_error_per_m.iter().zip(&v.attenuation_std_per_m);
    for (band, (error, std)) in of_bands.enumerate() {
        assert_within(&format!("{what}: attenuation, band {band} [1/m]"), *error, bound_per_m);
        assert!(error.abs() <= 3.0 * std, "{what}: {error:.4} is not {std:.4}");
    }
    assert!(v.model.identified, "{what}: {:?}", v.model.not_identified_because);
    assert_within(&format!("{what}: flat"), evenness.flat, images[0]);
    assert_within(&format!("{what}: brightness over frames"), evenness.cv, images[1]);
    assert_within(&format!("{what}: hue over frames"), evenness.hue, images[2]);
    v
}

#[test]
fn a_camera_without_fault_selects_nothing() {
    let (v, _) = judged(&dive(201, Conditions::default()), &Options::default());
    assert_eq!((v.model.camera, v.model.geometry), (None, None));
    assert!(v.model.frame_gains.is_empty() && v.model.residual_light.is_none());
}

#[test]
fn auto_exposure_and_white_balance_are_compensated() {
    let automatic =
        Conditions { auto_exposure: 0.8, auto_white_balance: 0.5, ..Conditions::default() };
    let dive = dive(202, automatic);
    let v = assert_calibrated("automatic", &dive, 0.015, [1.03, 0.019, 0.006]);
    let camera = v.model.camera.expect("a camera");
    let law = camera.gain_law.expect("a law");
    assert!(law.exposure < -1.5 && law.white_balance < -0.5, "{law:?}");
    assert!(camera.gains.is_some_and(|gains| gains.range_stops > 1.0));

    // Found, but not compensated.
    let mut options = Options::default();
    options.config.estimate.self_calibration = SelfCalibration::Report;
    let (reported, uneven) = judged(&dive, &options);
    assert!(reported.model.camera.is_none() && uneven.cv > 0.03, "{uneven:?}");
    let codes = reported.report.diagnostics.iter();
    let text: Vec<String> = codes.map(|d| format!("{d:?}")).collect();
    assert!(text.iter().any(|d| d.contains("CameraReported")), "{text:?}");
}

#[test]
fn a_flickering_strobe_is_compensated() {
    let flicker = Conditions { strobe_flicker: 0.05, ..Conditions::default() };
    assert_calibrated("flicker", &dive(203, flicker), 0.010, [1.03, 0.015, 0.003]);
}

#[test]
fn vignetting_is_told_from_the_beam_pattern() {
    let lens = Conditions { vignetting_exponent: 4.0, ..Conditions::default() };
    let v = assert_calibrated("vignetting", &dive(204, lens), 0.004, [1.02, 0.005, 0.003]);
    let vignetting = v.model.camera.and_then(|c| c.vignetting).expect("vignetting");
    // cos⁴ of the angle off the axis.
    for (x, y) in [(0.2, 0.1), (0.35, 0.0), (0.3, 0.25)] {
        let expected = 1.0 / (1.0f64 + x * x + y * y).powi(2);
        let ratio = vignetting.transmission(x, y) / expected;
        assert_within("vignetting: transmission, relative", ratio - 1.0, 0.01);
    }
}

#[test]
fn a_black_level_is_told_from_backscatter() {
    let pedestal = Conditions { black_level: 0.01, ..Conditions::default() };
    let dive = dive(205, pedestal);
    let v = assert_calibrated("black level", &dive, 0.005, [1.02, 0.006, 0.004]);
    let level = v.model.camera.and_then(|c| c.black_level).expect("a black level");
    for of_band in level {
        assert_within("black level: of full scale", of_band - 0.01, 0.001);
    }
    // Given in the rig file, it is not looked for.
    let rig = toml::from_str("[camera]\nblack_level = 0.01\n").expect("a rig");
    let (v, _) = judged(&dive, &Options { rig, ..Options::default() });
    assert_eq!(v.model.camera, None);
    let largest = v.attenuation_error_per_m.iter().fold(0.0, |most: f64, e| most.max(e.abs()));
    assert_within("black level given: attenuation [1/m]", largest, 0.004);
}

#[test]
fn another_transfer_curve_is_recognised() {
    let coded = |response| Dive {
        sensor: Sensor::Jpeg(92),
        ..dive(206, Conditions { response, ..Conditions::default() })
    };
    let named = [(Response::Gamma22, "gamma:2.2"), (Response::Linear, "linear")];
    for (response, name) in named {
        let v = assert_calibrated(name, &coded(response), 0.012, [1.03, 0.006, 0.004]);
        let found = v.model.camera.and_then(|c| c.response).expect("a curve");
        assert_eq!(found.transfer, name);
    }
    let contrast = coded(Response::Contrast);
    let v = assert_calibrated("contrast curve", &contrast, 0.012, [1.03, 0.006, 0.004]);
    let found = v.model.camera.and_then(|c| c.response).expect("a curve");
    assert_eq!(found.transfer, "fitted");
    // Errors of this dive's planes bend the curve: the interval has it.
    let bent = Dive { sensor: Sensor::Rgb8, seed: 5, ..contrast };
    assert_calibrated("contrast curve, seed 5", &bent, 0.04, [1.03, 0.006, 0.004]);
}

/// Ridges leave what looks like gains that fall with altitude: no camera does that.
#[test]
fn gains_that_fall_with_altitude_are_attenuation() {
    let ridges = Dive { relief_m: 0.15, ..dive(3, Conditions::default()) };
    let v = assert_calibrated("ridges", &ridges, 0.005, [f64::INFINITY, 0.03, 0.006]);
    assert!(v.model.camera.is_none(), "{:?}", v.model.camera);
}

/// Half a step of the converter is a black level that no file tells: the interval has it.
#[test]
fn an_adc_that_truncates_widens_the_interval() {
    let truncating = Conditions { has_truncating_adc: true, ..Conditions::default() };
    assert_calibrated("truncating", &dive(6, truncating), 0.006, [1.02, 0.005, 0.003]);
}

#[test]
fn a_late_camera_clock_is_corrected() {
    let late = Conditions { stamp_delay_s: 0.25, ..Conditions::default() };
    // In this dive a strobe 0.2 m away and daylight explain most of it, too.
    let v = assert_calibrated("clock", &dive(5, late), 0.004, [1.02, 0.005, 0.003]);
    let geometry = v.model.geometry.expect("a clock");
    assert_within("clock: offset [s]", geometry.clock_offset_s.expect("a clock") + 0.25, 0.02);
    assert!(v.model.camera.is_none(), "{:?}", v.model.camera);
}

#[test]
fn a_strobe_that_is_elsewhere_is_moved() {
    let mount = Conditions { strobe_mount_error_m: [0.2, 0.0, 0.0], ..Conditions::default() };
    let v = assert_calibrated("strobe", &dive(208, mount), 0.004, [1.02, 0.005, 0.003]);
    assert!(v.model.strobe.expect("a strobe").source.is_estimated());
    assert!(v.model.camera.is_none(), "{:?}", v.model.camera);
}

/// Few small frames do not say where the strobe sits along the optical axis: the attenuation that
/// another place would give is within the interval.
#[test]
fn what_a_log_cannot_tell_of_the_strobe_widens_the_interval() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("dive.mcap");
    for seed in 1..=3 {
        let along_the_axis = [0.0, 0.0, 0.14];
        let mount = Conditions { strobe_mount_error_m: along_the_axis, ..Conditions::default() };
        let small =
            Dive { frames: 20, width: 160, height: 120, focal_px: 185.0, ..dive(seed, mount) };
        let truth = small.write(&path);
        let options = Options::default();
        let session = CameraSession::open(&path, &options).expect("a camera");
        let model = estimate(&[&session], &options, &Silent).expect("a model");
        for band in 0..3 {
            let error = model.attenuation_per_m[band] - truth.attenuation_per_m[band];
            let std = model.attenuation_std_per_m[band].expect("a standard deviation");
            println!("measured seed {seed}, band {band}: {error:.4} ± {std:.4}");
            assert!(!model.identified || error.abs() < 3.0 * std, "{error:.4} is not {std:.4}");
        }
    }
}

#[test]
fn recorded_settings_that_follow_altitude_are_believed() {
    let laws = |message: SettingsMessage| {
        let recorded = Conditions { settings: Some(message), ..Conditions::default() };
        let dive = dive(209, recorded);
        let v = assert_calibrated("settings", &dive, 0.004, [1.02, 0.004, 0.002]);
        v.model.light_settings.iter().map(|s| s.law).collect::<Vec<_>>()
    };
    assert_eq!(laws(SettingsMessage::Stops), [LightLaw::Stop]);
    let mut both = laws(SettingsMessage::ImageMetaData);
    both.sort_by_key(|law| law.word());
    assert_eq!(both, [LightLaw::Factor, LightLaw::Decibel]);
}

#[test]
fn a_bare_altimeter_takes_its_slopes_from_the_overlap() {
    let altimeter = Dive { dvl: DvlType::Altimeter, ..dive(210, Conditions::default()) };
    let v = assert_calibrated("altimeter", &altimeter, 0.004, [1.02, 0.005, 0.003]);
    assert_eq!(v.model.tilts.expect("tilts").frames.len(), 40);

    // Without an attitude every frame has its own tilt, of 3° at most.
    let alone = Dive { with_imu: false, ..altimeter };
    let v = assert_calibrated("altimeter alone", &alone, 0.005, [1.02, 0.005, 0.003]);
    let tilts = v.model.tilts.expect("tilts");
    assert!(tilts.is_measured);
    let mean = |axis: usize| tilts.frames.iter().map(|t| t.tilt_deg[axis]).sum::<f64>() / 40.0;
    let spread = |axis: usize| {
        let off = |t: &unwater::model::TiltFile| (t.tilt_deg[axis] - mean(axis)).powi(2);
        (tilts.frames.iter().map(off).sum::<f64>() / 40.0).sqrt()
    };
    assert!((1.5..3.0).contains(&spread(0)) && (1.5..3.0).contains(&spread(1)));

    // Nor does a camera that sets its own exposure hide them.
    let metered = Conditions { auto_exposure: 0.8, ..Conditions::default() };
    let metered = Dive { conditions: metered, ..alone };
    assert_calibrated("altimeter and exposure", &metered, 0.008, [1.03, 0.012, 0.003]);
}

#[test]
fn daylight_is_told_from_the_strobe() {
    let sunlit = |daylight: f64| Conditions { daylight, ..Conditions::default() };
    let v = assert_calibrated("daylight", &dive(213, sunlit(0.2)), 0.010, [1.04, 0.015, 0.01]);
    let daylight = v.model.daylight.expect("daylight");
    // The share is that of the means over dive and bands.
    let share = daylight.median_share.iter().sum::<f64>() / 3.0;
    assert_within("daylight: share", share / (1.0 - share) - 0.2, 0.1);
    assert!(v.model.camera.is_none() && v.model.backscatter.is_none());

    // Without a strobe to speak of; the seafloor slopes, so its depth is not the same everywhere.
    let v = assert_calibrated("sun alone", &dive(214, sunlit(50.0)), 0.010, [1.04, 0.03, 0.04]);
    assert!(v.model.daylight.expect("daylight").median_share.iter().all(|s| *s > 0.9));
}

#[test]
fn an_even_field_is_told_from_a_black_level_and_from_the_strobes() {
    use unwater::model::ScatterSource;
    let even = Conditions { uniform_backscatter: 0.1, ..Conditions::default() };
    let v = assert_calibrated("even field", &dive(215, even), 0.010, [1.04, 0.015, 0.01]);
    let found = v.model.backscatter.expect("backscatter");
    assert_eq!((found.source, v.model.camera), (ScatterSource::Uniform, None));
}

/// One beam pattern does not explain two lamps of unlike patterns; images are corrected all the
/// same, and attenuation is not called identified.
#[test]
fn lamps_of_unlike_patterns_are_corrected() {
    use crate::support::render::conditions::SecondLamp;
    let dives = [("listed", 216, SecondLamp::Listed), ("not listed", 217, SecondLamp::Unlisted)];
    for (what, seed, second_lamp) in dives {
        let dive = dive(seed, Conditions { second_lamp, ..Conditions::default() });
        let (v, evenness) = judged(&dive, &Options::default());
        assert!(v.model.residual_light.is_some() && v.model.empirical.is_none(), "{what}");
        assert!(!v.model.identified, "{what}: {:?}", v.attenuation_error_per_m);
        assert_within(&format!("lamp {what}: flat"), evenness.flat, 1.1);
        assert_within(&format!("lamp {what}: brightness over frames"), evenness.cv, 0.02);
        assert_within(&format!("lamp {what}: hue over frames"), evenness.hue, 0.01);
    }
}

/// What the log does not tell apart must show.
#[test]
fn a_confident_wrong_number_is_not_given() {
    use crate::support::render::conditions::SecondLamp;
    let lamp = Conditions { second_lamp: SecondLamp::Unlisted, ..Conditions::default() };
    // Exposure and tilts at once.
    let metered = Conditions { auto_exposure: 0.8, ..Conditions::default() };
    let without_imu = Dive { dvl: DvlType::Altimeter, with_imu: false, ..dive(211, metered) };
    let dives = [("second lamp", dive(212, lamp)), ("no attitude", without_imu)];
    for (what, dive) in dives {
        let (v, _) = judged(&dive, &Options::default());
        let z = v.attenuation_error_per_m.iter().zip(&v.attenuation_std_per_m);
        let z = z.map(|(error, std)| error.abs() / std).fold(0.0, f64::max);
        println!("measured {what}: identified {}, z {z:.1}", v.model.identified);
        assert!(!v.model.identified || z < 3.0, "{what}: {:.4?}", v.attenuation_error_per_m);
    }
}
