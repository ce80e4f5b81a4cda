//! The closing words of `correct`: about ten lines that say what came of it, where it lies and what
//! opens it.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use super::color::Paint;
use crate::diagnostics::{CameraFact, Fact, Severity};
use crate::model::{ModelFile, StrobeFile};
use crate::report::Report;

/// The account of a camera for people. `given`: the model came from a file. `took`: the whole run,
/// where it is known.
pub fn summary(
    report: &Report,
    model: &ModelFile,
    given: bool,
    took: Option<Duration>,
    paint: Paint,
) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: &str| {
        let _infallible = writeln!(text, "{} {value}", paint.name(&format!("{name:<12}")));
    };
    let count = format!("{} of {} corrected", report.corrected, report.frames);
    let count =
        if report.corrected == report.frames { paint.good(&count) } else { paint.warning(&count) };
    let pace = took.filter(|t| t.as_secs_f64() > 0.0).map_or_else(String::new, |took| {
        format!(" in {}, {:.1} a second", duration(took), report.frames as f64 / took.as_secs_f64())
    });
    line("frames", &(count + &pace));
    for (reason, count) in &report.uncorrected {
        line("", &paint.warning(&format!("{count} passed uncorrected: {reason}")));
    }
    let source = if given { ", from the model given" } else { "" };
    line("attenuation", &format!("{}{source}", attenuation(model, paint)));
    judged(report, model).iter().for_each(|(name, value)| line(name, value));
    if let Some(strobe) = model.strobe.as_ref().filter(|s| s.source.is_estimated()) {
        line("strobe", &position(strobe));
    }
    if let Some(camera) = &model.camera {
        line("camera", &camera.summary());
    }
    if let Some(topic) = &report.camera_info_topic {
        let reason = report.diagnostics.iter().find_map(|d| match &d.fact {
            Fact::CameraFact(CameraFact::InfoUsed { because }) => Some(format!(" ({because})")),
            _ => None,
        });
        line("calibration", &format!("{topic}{}", reason.unwrap_or_default()));
    }
    if let Some([low, high]) = report.camera_altitude_m {
        let planes: Vec<String> = report.planes.iter().map(|(k, v)| format!("{v} {k}")).collect();
        line("altitude", &format!("{low:.2} to {high:.2} m (planes: {})", planes.join(", ")));
    }
    let share = |name: &str| 100.0 * report.mean_shares.get(name).copied().unwrap_or(0.0);
    line(
        "pixels",
        &format!(
            "{:.2} % clipped in, {:.2} % clipped out, {:.2} % gain limited, {:.2} % off the \
             seafloor",
            share("clipped_input"),
            share("clipped_output"),
            share("gain_capped"),
            share("off_surface")
        ),
    );
    let warnings = report.of(Severity::Warning).count();
    if warnings > 0 {
        line("warnings", &paint.warning(&format!("{warnings}, above")));
    }
    text
}

/// Where the strobe was found.
fn position(strobe: &StrobeFile) -> String {
    let [x, y, z] = strobe.position_in_optical_m;
    let std = strobe.position_std_m.map_or_else(String::new, |s| {
        format!(" ± {:.3}", s.iter().map(|s| s * s).sum::<f64>().sqrt())
    });
    format!(
        "{}, at [{x:.3}, {y:.3}, {z:.3}]{std} m from the camera (right, down, ahead)",
        strobe.source
    )
}

/// The empirical model, and what the correction does on held-out frames.
fn judged(report: &Report, model: &ModelFile) -> Vec<(&'static str, String)> {
    let residual = || {
        model.residual_light.as_ref()?;
        Some("what attenuation and beam pattern leave of it by region is removed, too".into())
    };
    let form = model.empirical.as_ref().map(|e| format!("empirical: {}", e.form.word()));
    let form = form.or_else(residual).map(|light| ("light", light));
    let text = report.verdict.as_ref().and_then(|v| Some((v.measure.word(), v.text()?)));
    form.into_iter().chain(text).collect()
}

/// Where the log lies and what opens it.
pub fn written(copied: u64, added: u64, output: &Path, paint: Paint) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: &str| {
        let _infallible = writeln!(text, "{} {value}", paint.name(&format!("{name:<12}")));
    };
    let shown = word(output);
    line("messages", &format!("{copied} copied, {added} added"));
    line("written", &paint.strong(&output.display().to_string()));
    line(
        "look at it",
        &format!("rerun {shown}     all topics; laid out: unwater layout {shown} --rerun"),
    );
    line("", &format!("Foxglove, open the file; laid out: unwater layout {shown} --foxglove"));
    line("", &format!("unwater report {shown}     figures and numbers on one page"));
    text
}

/// A path as a shell takes it.
fn word(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = text.chars().all(|c| c.is_alphanumeric() || "/._-+,:@%".contains(c));
    if is_plain { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

/// Attenuation with its standard deviations and what kind of number it is.
pub fn attenuation(model: &ModelFile, paint: Paint) -> String {
    let text = model.attenuation_text();
    let bands: Vec<&str> = text.split(" / ").collect();
    let bands: Vec<String> = bands
        .iter()
        .enumerate()
        .map(|(i, b)| if bands.len() == 3 { paint.band(i, b) } else { (*b).into() })
        .collect();
    if model.empirical.is_some() {
        return format!("{}, empirical estimator", paint.warning("not determined"));
    }
    let sure = if model.identified {
        String::new()
    } else {
        format!(", {}", paint.warning("not identified"))
    };
    format!(
        "{} per metre ({}, {} estimator{sure})",
        bands.join(" / "),
        model.attenuation_kind.word(),
        model.estimator.word()
    )
}

/// 8.3 s, 2 min 5 s
pub fn duration(took: Duration) -> String {
    let seconds = took.as_secs_f64();
    if seconds < 60.0 {
        format!("{seconds:.1} s")
    } else {
        format!("{} min {} s", took.as_secs() / 60, took.as_secs() % 60)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::MountFact;

    const MODEL: &str = r#"{
        "format": "unwater-model", "version": 1,
        "spreading": "strobe", "spreading_exponents": [2.0, 0.0], "incidence": true,
        "attenuation_per_m": [0.45, 0.14, 0.1],
        "attenuation_std_per_m": [0.001, 0.001, null],
        "attenuation_kind": "physical", "identified": true,
        "estimator": "joint", "estimators": {}, "strobe": null, "backscatter": null,
        "frame_gains": [], "light_settings": [], "warnings": [], "segments": [],
        "beam_pattern": {
            "theta_deg": [-70, 0, 70], "phi_deg": [-70, 0, 70],
            "log_gain": [[0, 0, 0], [0, 0, 0], [0, 0, 0]]
        },
        "rendering": {
            "method": "full", "gain": [1, 1, 1], "median_correction": [1, 1, 1],
            "white_level": null
        },
        "inputs": []
    }"#;

    fn report() -> Report {
        Report {
            frames: 20,
            corrected: 19,
            uncorrected: [("no sonar beam came back".to_string(), 1)].into(),
            planes: [("least squares".to_string(), 19)].into(),
            camera_altitude_m: Some([1.612, 2.737]),
            mean_shares: [("gain_capped".to_string(), 0.0006)].into(),
            diagnostics: vec![MountFact::StrobeUnknown.into()],
            ..Report::default()
        }
    }

    #[test]
    fn the_summary_says_it_in_ten_lines_and_plainly_without_a_terminal() {
        let model = ModelFile::from_json(MODEL).expect("a model");
        let said =
            summary(&report(), &model, true, Some(Duration::from_millis(8300)), Paint::PLAIN);
        let written = written(1040, 163, Path::new("my dive.mcap"), Paint::PLAIN);
        let expected = "\
frames       19 of 20 corrected in 8.3 s, 2.4 a second
             1 passed uncorrected: no sonar beam came back
attenuation  0.4500 ± 0.0010 / 0.1400 ± 0.0010 / 0.1000 ± ? per metre (physical, joint estimator), \
                        from the model given
altitude     1.61 to 2.74 m (planes: 19 least squares)
pixels       0.00 % clipped in, 0.00 % clipped out, 0.06 % gain limited, 0.00 % off the seafloor
warnings     1, above
messages     1040 copied, 163 added
written      my dive.mcap
look at it   rerun 'my dive.mcap'     all topics; laid out: unwater layout 'my dive.mcap' --rerun
             Foxglove, open the file; laid out: unwater layout 'my dive.mcap' --foxglove
             unwater report 'my dive.mcap'     figures and numbers on one page
";
        assert_eq!(said + &written, expected);
    }

    #[test]
    fn minutes_are_minutes() {
        assert_eq!(
            [0.04, 59.94, 125.0].map(|s| duration(Duration::from_secs_f64(s))),
            ["0.0 s", "59.9 s", "2 min 5 s"]
        );
    }
}
