//! Text and tables of the page: contents of the log, what was done, uncertainty, losses and
//! remedies.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::{Duration, UNIX_EPOCH};

use super::super::dive::{CameraLog, CorrectedLog};
use crate::config::Estimator;
use crate::diagnostics::{Diagnostic, Fact, Severity};
use crate::model::{AttenuationKind, ModelFile};
use crate::plot::escape_markup;
use crate::units::Stamp;
use crate::vehicle::StrobeSource;

/// Ends of a 95 % interval lie this many standard deviations away.
pub const NINETY_FIVE: f64 = 1.96;
/// Frames that are named of those that share a reason.
const NAMED_FRAMES: usize = 5;

/// A time in RFC 3339.
pub fn time_of(stamp: Stamp) -> String {
    let nanos = u64::try_from(stamp.0).unwrap_or_default();
    humantime::format_rfc3339_millis(UNIX_EPOCH + Duration::from_nanos(nanos)).to_string()
}

/// Names of the bands.
pub fn band_names(bands: usize) -> &'static [&'static str] {
    if bands == 1 { &["grey"] } else { &["red", "green", "blue"] }
}

/// Text and tables of a camera.
pub fn section(log: &CorrectedLog, camera: &CameraLog, number: usize, place: &str) -> String {
    let source = escape_markup(camera.fact("source"));
    let heading = if number == 0 {
        format!(
            "<header><h1>{source}</h1><p class=\"sub\">What <b>unwater</b> {} did to this \
             dive</p>{}</header>",
            escape_markup(camera.fact("version")),
            contents(log)
        )
    } else {
        String::new()
    };
    let several = log.cameras.len() > 1;
    let name = if several {
        format!(
            "<h2 class=\"camera\" id=\"camera-{number}\">Camera {}</h2>",
            escape_markup(camera.fact("camera_topic"))
        )
    } else {
        String::new()
    };
    let left_out = list(camera.report.of(Severity::Loss).filter(|d| !d.is_uncorrected()));
    format!(
        "{heading}{name}{}{}{}{}{left_out}",
        overview(log, camera),
        attenuation(&camera.model, place),
        warnings(camera),
        uncorrected(camera)
    )
}

/// Links to the cameras, where there are several.
fn contents(log: &CorrectedLog) -> String {
    if log.cameras.len() < 2 {
        return String::new();
    }
    let link = |(number, camera): (usize, &CameraLog)| {
        format!(
            "<li><a href=\"#camera-{number}\">{}</a></li>",
            escape_markup(camera.fact("camera_topic"))
        )
    };
    format!(
        "<nav aria-label=\"Cameras\"><ul>{}</ul></nav>",
        log.cameras.iter().enumerate().map(link).collect::<String>()
    )
}

/// Names and values of a table.
type Rows = Vec<(&'static str, String)>;

fn overview(log: &CorrectedLog, camera: &CameraLog) -> String {
    let (report, model) = (&camera.report, &camera.model);
    let mut rows = frame_rows(camera);
    rows.extend(model_rows(model));
    rows.push(("pixels", pixel_shares(camera)));
    if report.messages_copied > 0 {
        rows.push((
            "messages",
            format!("{} copied, {} added", report.messages_copied, report.messages_added),
        ));
    }
    let from: Vec<String> =
        model.inputs.iter().map(|i| format!("{} ({} frames)", i.name, i.frames)).collect();
    rows.push(("model from", from.join(", ")));
    rows.push(("source", format!("{} · {}", camera.fact("source"), camera.source())));
    let rows: String = rows
        .iter()
        .map(|(name, value)| format!("<dt>{name}</dt><dd>{}</dd>", escape_markup(value)))
        .collect();
    let damage: Vec<String> =
        report.damage.iter().map(|d| format!("{} (byte {})", d.reason, d.offset)).collect();
    let of_log: Vec<String> = log
        .scanned
        .index
        .damage
        .iter()
        .map(|d| format!("in this log itself: {} (byte {})", d.reason, d.offset))
        .collect();
    format!(
        "<section><h2>What was done</h2><dl>{rows}</dl>{}{}</section>\n",
        titled("Damage: what could not be read", &damage),
        titled("Damage", &of_log)
    )
}

/// Frames, channels and method of the run.
fn frame_rows(camera: &CameraLog) -> Rows {
    let report = &camera.report;
    let mut rows: Rows =
        vec![("frames", format!("{} of {} corrected", report.corrected, report.frames))];
    if let (Some(first), Some(last)) = (camera.frames.first(), camera.frames.last()) {
        rows.push((
            "when",
            format!(
                "{} to {} ({:.0} s)",
                time_of(first.stamp),
                time_of(last.stamp),
                last.stamp.seconds_since(first.stamp)
            ),
        ));
    }
    if let Some([low, high]) = report.camera_altitude_m {
        rows.push(("altitude of the camera", format!("{low:.2} to {high:.2} m")));
    }
    let planes: Vec<String> =
        report.planes.iter().map(|(support, frames)| format!("{frames} {support}")).collect();
    rows.extend([
        ("camera", camera.fact("camera_topic").into()),
        ("corrected images", camera.fact("corrected_topic").into()),
        ("ranges", camera.fact("dvl_topic").into()),
        ("seafloor planes", planes.join(", ")),
        ("method", camera.fact("method").into()),
    ]);
    rows
}

/// Strobe, backscatter and recorded exposures of the model.
fn model_rows(model: &ModelFile) -> Rows {
    let mut rows = Rows::new();
    if let Some(strobe) = &model.strobe {
        let [x, y, z] = strobe.position_in_optical_m;
        let std = strobe.position_std_m.map_or_else(String::new, |s| {
            format!(" ± {:.3} m", s.iter().map(|s| s * s).sum::<f64>().sqrt())
        });
        let text = match &strobe.source {
            StrobeSource::Camera => "unknown; assumed to be at the camera".into(),
            source => {
                format!(
                    "{}, {}, {} of the camera{std} ({source})",
                    sided(x, "right", "left"),
                    sided(y, "down", "up"),
                    sided(z, "ahead", "behind")
                )
            }
        };
        rows.push(("strobe", text));
    }
    if let Some(b) = &model.backscatter {
        rows.push(("backscatter", format!("{}, subtracted", shares_text(&b.median_share))));
    }
    if let Some(d) = &model.daylight {
        rows.push(("daylight", format!("{}, modelled", shares_text(&d.median_share))));
    }
    let followed: Vec<String> = model
        .light_settings
        .iter()
        .map(|s| format!("{} of {} ({})", s.name, s.topic, s.law.word()))
        .collect();
    if !followed.is_empty() {
        rows.push(("light follows", followed.join(", ")));
    }
    rows
}

/// Median shares of a part of the light, per band.
fn shares_text(shares: &[f64]) -> String {
    let of_band: Vec<String> = shares.iter().map(|s| format!("{:.0} %", 100.0 * s)).collect();
    let bands = band_names(shares.len()).join(" / ");
    format!("{} of the light of tracked points (median; {bands})", of_band.join(" / "))
}

/// Mean shares of pixels that are not reliable.
fn pixel_shares(camera: &CameraLog) -> String {
    let shares = &camera.report.mean_shares;
    let share = |name: &str| 100.0 * shares.get(name).copied().unwrap_or(0.0);
    format!(
        "{:.2} % clipped as recorded, {:.2} % clipped as corrected, {:.2} % with a limited gain, \
         {:.2} % off the seafloor, {:.2} % lit by a part of the beam that no frame showed before, \
         {:.2} % with too little light",
        share("clipped_input"),
        share("clipped_output"),
        share("gain_capped"),
        share("off_surface"),
        share("unseen_beam"),
        share("low_signal")
    )
}

/// A signed length in words (m).
fn sided(length_m: f64, positive: &str, negative: &str) -> String {
    format!("{:.2} m {}", length_m.abs(), if length_m < 0.0 { negative } else { positive })
}

fn attenuation(model: &ModelFile, place: &str) -> String {
    let names = band_names(model.attenuation_per_m.len());
    let mut rows = String::new();
    for (b, alpha) in model.attenuation_per_m.iter().enumerate() {
        let interval = match model.attenuation_std_per_m.get(b).copied().flatten() {
            Some(std) => {
                format!("{:.4} to {:.4}", alpha - NINETY_FIVE * std, alpha + NINETY_FIVE * std)
            }
            None => "unknown".into(),
        };
        let name = names.get(b).copied().unwrap_or("");
        let alpha =
            if model.has_attenuation() { format!("{alpha:.4}") } else { "unknown".to_string() };
        let _infallible = write!(
            rows,
            "<tr><th scope=\"row\"><span class=\"key \
             k-{name}\"></span>{name}</th><td>{alpha}</td><td>{interval}</td></tr>"
        );
    }
    let kind = match model.attenuation_kind {
        _ if model.empirical.is_some() => {
            "<b>Not determined</b>: frames are corrected by an empirical model of their light, \
             which has no α; the numbers are those of the best physical estimator."
        }
        AttenuationKind::Physical => {
            "<b>Physical</b>: the spreading of the strobe's light is modelled apart; α is a \
             property of the water."
        }
        AttenuationKind::Effective => {
            "<b>Effective</b>: spreading is not modelled and is part of α. Not comparable with \
             coefficients of the water."
        }
    };
    let identified = match (&model.not_identified_because, model.identified) {
        (None, true) => "<p class=\"yes\">Identified: the log determines it.</p>".to_string(),
        (why, _) => {
            let why = why.as_deref().unwrap_or("the log does not determine it");
            let found = model.diagnostics.iter().find(|d| d.is_not_identified());
            let helps = found.map_or_else(String::new, remedy);
            format!("<p class=\"no\"><b>Not identified</b>: {}.{helps}</p>", escape_markup(why))
        }
    };
    format!(
        "<section id=\"{place}attenuation\"><h2>Attenuation of the water</h2>{identified}<div \
         class=\"wide\"><table><thead><tr><th scope=\"col\">band</th><th scope=\"col\">α \
         [1/m]</th><th scope=\"col\">95 % interval \
         [1/m]</th></tr></thead><tbody>{rows}</tbody></table></div><p>{kind} Result of the {} \
         estimator.</p>{}</section>\n",
        model.estimator.word(),
        estimators(model)
    )
}

fn estimators(model: &ModelFile) -> String {
    let three = |values: &Option<Vec<f64>>| {
        values.as_ref().map_or_else(
            || "–".into(),
            |v| v.iter().map(|v| format!("{v:.4}")).collect::<Vec<_>>().join(" / "),
        )
    };
    let row = |(name, answer): (&Estimator, &crate::model::EstimatorAnswer)| {
        let residual = answer.residual.map_or_else(|| "–".into(), |r| format!("{r:.4}"));
        let note = answer.note.as_deref().unwrap_or("");
        format!(
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{residual}</td><td \
             class=\"words\">{}</td></tr>",
            name.word(),
            three(&answer.attenuation_per_m),
            three(&answer.attenuation_std_per_m),
            answer.observations,
            escape_markup(note)
        )
    };
    let rows: String = model.estimators.iter().map(row).collect();
    format!(
        "<details><summary>Estimates of each estimator</summary><div \
         class=\"wide\"><table><thead><tr><th scope=\"col\">estimator</th><th scope=\"col\">α \
         [1/m]</th><th scope=\"col\">standard deviation [1/m]</th><th \
         scope=\"col\">observations</th><th scope=\"col\">residual [log light]</th><th \
         scope=\"col\">note</th></tr></thead><tbody>{rows}</tbody></table></div></details>"
    )
}

/// The remedy of a diagnostic, in HTML.
fn remedy(diagnostic: &Diagnostic) -> String {
    let text = diagnostic.remedy();
    text.map_or_else(String::new, |r| {
        format!(" <span class=\"remedy\">{}.</span>", escape_markup(&r))
    })
}

/// Diagnostics as a list, in HTML; nothing where there are none.
fn list<'d>(diagnostics: impl Iterator<Item = &'d Diagnostic>) -> String {
    let item = |d: &Diagnostic| {
        let (code, text) = (escape_markup(d.code()), escape_markup(&d.to_string()));
        format!("<li data-code=\"{code}\">{text}.{}</li>", remedy(d))
    };
    let items: String = diagnostics.map(item).collect();
    if items.is_empty() { items } else { format!("<ul>{items}</ul>") }
}

fn warnings(camera: &CameraLog) -> String {
    // The reason why attenuation is not identified is above.
    let warnings = list(camera.report.of(Severity::Warning).filter(|d| !d.is_not_identified()));
    let body = if warnings.is_empty() { "<p>None.</p>".into() } else { warnings };
    let infos = list(camera.report.of(Severity::Info));
    let infos = if infos.is_empty() {
        infos
    } else {
        format!("<details><summary>Assumptions and repairs</summary>{infos}</details>")
    };
    format!("<section><h2>Warnings</h2>{body}{infos}</section>\n")
}

fn uncorrected(camera: &CameraLog) -> String {
    let mut by_reason: BTreeMap<&str, Vec<Stamp>> = BTreeMap::new();
    for frame in camera.frames.iter().filter(|f| !f.corrected) {
        by_reason.entry(&frame.reason).or_default().push(frame.stamp);
    }
    if by_reason.is_empty() {
        return "<section><h2>Frames not corrected</h2><p>None.</p></section>\n".into();
    }
    let row = |(reason, stamps): (&&str, &Vec<Stamp>)| {
        let mut times: Vec<String> =
            stamps.iter().take(NAMED_FRAMES).map(|s| time_of(*s)).collect();
        if stamps.len() > NAMED_FRAMES {
            times.push(format!("and {} more", stamps.len() - NAMED_FRAMES));
        }
        let is_same = |d: &&Diagnostic| match &d.fact {
            Fact::Uncorrected(u) => u.reason.to_string() == **reason,
            _ => false,
        };
        let known = camera.report.diagnostics.iter().find(is_same);
        let helps = known.and_then(Diagnostic::remedy).unwrap_or_default();
        format!(
            "<tr><td>{}</td><td class=\"words\">{}</td><td class=\"words\">{}</td><td \
             class=\"words\">{}</td></tr>",
            stamps.len(),
            escape_markup(reason),
            escape_markup(&times.join(", ")),
            escape_markup(&helps)
        )
    };
    let rows: String = by_reason.iter().map(row).collect();
    format!(
        "<section><h2>Frames not corrected</h2><div class=\"wide\"><table><thead><tr><th \
         scope=\"col\">frames</th><th scope=\"col\">why</th><th scope=\"col\">when</th><th \
         scope=\"col\">what helps</th></tr></thead><tbody>{rows}</tbody></table></div></section>\n"
    )
}

/// The effective settings, folded away; once, with the last camera.
pub fn settings(log: &CorrectedLog, camera: &CameraLog, number: usize) -> String {
    if number + 1 < log.cameras.len() {
        return String::new();
    }
    let text = escape_markup(camera.fact("configuration"));
    format!(
        "<section><h2>Settings</h2><details><summary>All settings of the run, with unit and \
         reason</summary><pre>{text}</pre></details></section>\n"
    )
}

fn titled(title: &str, sentences: &[String]) -> String {
    if sentences.is_empty() {
        return String::new();
    }
    format!(
        "<h3>{title}</h3><ul>{}</ul>",
        sentences.iter().map(|s| format!("<li>{}</li>", escape_markup(s))).collect::<String>()
    )
}
