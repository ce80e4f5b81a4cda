//! A dive without overlap, in water whose backscatter the physical model does not know, with a bare
//! altimeter and an unknown strobe: attenuation cannot be determined, and images are even all the
//! same.
use std::path::Path;

use crate::support::evenness::Evenness;
use crate::support::judge::{assert_within, images};
use crate::support::render::conditions::Conditions;
use crate::support::render::{Dive, DvlType, Sensor, Truth};
use unwater::config::{Estimator, Method};
use unwater::error::Error;
use unwater::image::LinearImage;
use unwater::model::{ModelFile, VerdictMeasure};
use unwater::report::Report;
use unwater::run::{correct, estimate_logs};
use unwater::session::{Options, Silent};

fn dive() -> Dive {
    let conditions =
        Conditions { uniform_backscatter: 0.25, vignetting_exponent: 3.0, ..Conditions::default() };
    Dive {
        seed: 191,
        frames: 40,
        frames_per_s: 0.07,
        width: 192,
        height: 144,
        focal_px: 200.0,
        altitude_m: (1.4, 3.4),
        slope_deg: (0.0, 0.0),
        tilt_deg: 1.0,
        sensor: Sensor::Rgb16,
        dvl: DvlType::Altimeter,
        with_strobe_mount: false,
        conditions,
        ..Dive::default()
    }
}

fn corrected(folder: &Path, options: &Options) -> (Report, ModelFile, Vec<LinearImage>) {
    let mut options = options.clone();
    options.force = true;
    options.config.render.depth = 16;
    let output = folder.join("dive.corrected.mcap");
    let (report, model) =
        correct(&folder.join("dive.mcap"), &output, None, &options, &Silent).unwrap();
    let images = images(&output, &report.corrected_topic);
    (report, model, images)
}

fn evenness(dive: &Dive, truth: &Truth, shown: &[LinearImage]) -> Evenness {
    let blocks = dive.width / 4 * (dive.height / 4);
    Evenness::of(dive, truth, shown, &vec![vec![false; blocks]; shown.len()])
}

#[test]
fn a_dive_without_overlap_comes_out_even() {
    let folder = tempfile::tempdir().unwrap();
    let dive = dive();
    let truth = dive.write(&folder.path().join("dive.mcap"));
    let raw =
        evenness(&dive, &truth, &images(&folder.path().join("dive.mcap"), "/camera/image_raw"));
    let (report, model, shown) = corrected(folder.path(), &Options::default());
    let is = evenness(&dive, &truth, &shown);

    // The physical model that would be used without the comparison.
    let mut physical = Options::default();
    physical.config.estimate.estimator = Estimator::Altitude;
    let (of_physical, file, shown) = corrected(folder.path(), &physical);
    let by_physical = evenness(&dive, &truth, &shown);
    println!("raw {raw:.3?}\nempirical {is:.3?}\nphysical {by_physical:.3?}");
    assert!(file.empirical.is_none());
    assert_eq!(of_physical.verdict.unwrap().used, "full", "a chosen estimator stays");

    assert_eq!(model.estimator, Estimator::Empirical);
    assert!(!model.identified && model.empirical.is_some());
    let verdict = report.verdict.expect("a verdict");
    assert_eq!(verdict.measure, VerdictMeasure::Evenness);
    let [before, after, full] = ["raw", verdict.used.as_str(), "full"]
        .map(|name| verdict.of(name).unwrap_or_else(|| panic!("no figures of {name}")).score());
    println!("verdict: {verdict:.3?}");
    assert!(after < 0.5 * before && after < 0.9 * full, "{before} {full} {after}");

    assert_within("no overlap: flat", is.flat - 1.0, 0.2);
    assert_within("no overlap: brightness", is.cv, 0.17);
    assert_within("no overlap: hue", is.hue, 0.08);
    for (is, than) in [(is.flat, raw.flat), (is.cv, raw.cv), (is.hue, raw.hue)] {
        assert!(is < than, "worse than raw: {is} {than}");
    }
    assert!(is.hue < 0.8 * by_physical.hue, "{is:?} {by_physical:?}");

    // The file says the same when it is read again, and corrects the same.
    let json = model.to_json().unwrap();
    let again = ModelFile::from_json(&json).unwrap();
    assert_eq!(again.empirical, model.empirical);
    assert_eq!(again.verdict.unwrap().used, verdict.used);
}

/// At one altitude and without overlap no estimator has an answer; frames are corrected all the
/// same, and the file says what is not known.
#[test]
fn a_dive_that_determines_no_attenuation_is_corrected() {
    let folder = tempfile::tempdir().unwrap();
    let dive = Dive { seed: 192, altitude_m: (2.0, 2.0), ..dive() };
    let truth = dive.write(&folder.path().join("dive.mcap"));
    let raw =
        evenness(&dive, &truth, &images(&folder.path().join("dive.mcap"), "/camera/image_raw"));
    let (report, model, shown) = corrected(folder.path(), &Options::default());
    let is = evenness(&dive, &truth, &shown);
    println!("raw {raw:.3?}\nempirical {is:.3?}\nverdict {:.3?}", report.verdict);
    let reason = model.not_identified_because.as_deref().unwrap_or_default();
    assert!(reason.contains("no estimator has an answer"), "{reason}");
    assert!(model.attenuation_std_per_m.iter().all(Option::is_none) && model.empirical.is_some());
    assert_eq!(model.attenuation_text(), "not known");
    for (is, than) in [(is.flat, raw.flat), (is.cv, raw.cv), (is.hue, raw.hue)] {
        assert!(is <= than, "worse than raw: {is} {than}");
    }
    assert!(is.flat - 1.0 < 0.5 * (raw.flat - 1.0), "{is:?} {raw:?}");
    // A method that divides by attenuation alone has nothing to divide by.
    let mut alone = Options { force: true, ..Options::default() };
    alone.config.render.method = Method::Attenuation;
    let input = folder.path().join("dive.mcap");
    let refused = correct(&input, &folder.path().join("alone.mcap"), None, &alone, &Silent);
    assert!(matches!(refused, Err(Error::Usage(_))), "{refused:?}");
    // A chosen estimator has no stand-in.
    let mut altitude = Options { force: true, ..Options::default() };
    altitude.config.estimate.estimator = Estimator::Altitude;
    let output = folder.path().join("not.mcap");
    assert!(correct(&folder.path().join("dive.mcap"), &output, None, &altitude, &Silent).is_err());
}

/// Every other frame has another energy of the strobe.
fn in_turns(energy: f64, frames: usize) -> Dive {
    let conditions =
        Conditions { daylight: 0.08, every_other_energy: Some(energy), ..Conditions::default() };
    Dive {
        seed: 192,
        frames,
        frames_per_s: 2.0,
        width: 288,
        height: 216,
        focal_px: 345.0,
        conditions,
        ..Dive::default()
    }
}

#[test]
fn frames_without_strobe_are_left_out_and_stay_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dive.mcap");
    let truth = in_turns(0.0, 60).write(&path);
    let (report, model, shown) = corrected(folder.path(), &Options::default());
    let said = report.diagnostics.iter().find(|d| d.code() == "frames-without-strobe");
    assert!(said.is_some_and(|d| d.to_string().contains("30 of 60 frames")), "{said:?}");
    assert_eq!((report.corrected, shown.len()), (30, 30));
    assert!(!report.has_losses(), "{:?}", report.uncorrected);
    assert!(model.identified, "{:?}", model.not_identified_because);
    for (found, right) in model.attenuation_per_m.iter().zip(truth.attenuation_per_m) {
        assert_within("attenuation [1/m]", found - right, 0.01);
    }
    // A strobe that is dimmed in turns lights every frame.
    in_turns(0.25, 24).write(&path);
    let (dimmed, _) = estimate_logs(&[&path], &Options::default(), &Silent).unwrap();
    assert_eq!((dimmed.inputs[0].unlit_below, dimmed.inputs[0].frames), (None, 24));
}

#[test]
fn the_empirical_estimator_is_used_where_attenuation_is_identified_if_asked_for() {
    let sample = crate::support::edited::sample();
    let mut options = Options::default();
    let model = |options: &Options| estimate_logs(&[&sample], options, &Silent).unwrap().0;
    assert!(model(&options).empirical.is_none());
    options.config.estimate.estimator = Estimator::Empirical;
    let asked = model(&options);
    assert!(asked.empirical.is_some() && !asked.identified, "{:?}", asked.verdict);
}
