//! One row per corrected dive: frames, altitude, attenuation, and whether it is identified.

use crate::diagnostics::{Diagnostic, Severity};
use crate::model::{AttenuationKind, ModelFile};
use crate::report::Report;

/// A camera of a dive.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// name of the log
    pub log: String,
    /// what came of it, in a word
    pub result: String,
    /// report and model, where it was corrected
    pub facts: Option<Box<(Report, ModelFile)>>,
}

/// Names of the bands in columns.
const BANDS: [&str; 3] = ["red", "green", "blue"];
/// Half the width of a 95 % confidence interval, in standard deviations.
const INTERVAL_95: f64 = 1.96;

impl Row {
    /// A row for each camera.
    pub fn of_cameras(
        log: &str,
        result: &str,
        cameras: impl IntoIterator<Item = (Report, ModelFile)>,
    ) -> Vec<Self> {
        let row =
            |facts| Self { log: log.into(), result: result.into(), facts: Some(Box::new(facts)) };
        cameras.into_iter().map(row).collect()
    }

    /// A log that was not corrected.
    pub fn without_facts(log: &str, result: &str) -> Self {
        Self { log: log.into(), result: result.into(), facts: None }
    }

    fn cells(&self) -> [String; 6] {
        let Self { log, result, facts } = self;
        let Some((report, model)) = facts.as_deref() else {
            let none = String::new;
            return [log.clone(), none(), none(), none(), none(), result.clone()];
        };
        let frames = format!("{}/{}", report.corrected, report.frames);
        let altitude = report
            .camera_altitude_m
            .map_or_else(String::new, |[low, high]| format!("{low:.1}–{high:.1}"));
        let identified = if model.identified { "yes" } else { "no" };
        [log.clone(), frames, altitude, attenuation(model), identified.into(), result.clone()]
    }

    /// The cells of a CSV table.
    fn values(&self) -> Vec<String> {
        let number = |value: Option<f64>| {
            value.filter(|v| v.is_finite()).map_or_else(String::new, |v| format!("{v:.6}"))
        };
        let mut cells = vec![self.log.clone(), self.result.clone()];
        let Some((report, model)) = self.facts.as_deref() else {
            cells.resize(columns().len(), String::new());
            return cells;
        };
        let [low, high] =
            report.camera_altitude_m.map_or([None; 2], |[low, high]| [Some(low), Some(high)]);
        cells.extend([
            report.camera_topic.clone(),
            report.frames.to_string(),
            report.corrected.to_string(),
            number(low),
            number(high),
        ]);
        let kind = match model.attenuation_kind {
            AttenuationKind::Physical => "physical",
            AttenuationKind::Effective => "effective",
        };
        let known = model.has_attenuation();
        for band in 0..BANDS.len() {
            let alpha = model.attenuation_per_m.get(band).copied().filter(|_| known);
            let std = model.attenuation_std_per_m.get(band).copied().flatten();
            let bound = |sign: f64| Some(alpha? + sign * INTERVAL_95 * std?);
            cells.extend([alpha, std.filter(|_| known), bound(-1.0), bound(1.0)].map(number));
        }
        let of = |severity| report.of(severity).count().to_string();
        let codes: Vec<&str> = report.diagnostics.iter().map(Diagnostic::code).collect();
        cells.extend([
            kind.into(),
            model.estimator.word().into(),
            model.identified.to_string(),
            model.not_identified_because.as_ref().map_or_else(String::new, ToString::to_string),
            of(Severity::Warning),
            of(Severity::Loss),
            codes.join(" "),
        ]);
        cells
    }
}

fn attenuation(model: &ModelFile) -> String {
    if model.has_attenuation() { model.attenuation_text() } else { "not determined".into() }
}

fn columns() -> Vec<String> {
    let fixed = ["log", "result", "camera_topic", "frames", "corrected"];
    let altitude = ["altitude_min_m", "altitude_max_m"];
    let of_band = |band: &str| {
        ["", "_std", "_low_95", "_high_95"].map(|what| format!("attenuation_{band}{what}_per_m"))
    };
    let rest = [
        "attenuation_kind",
        "estimator",
        "identified",
        "not_identified_because",
        "warnings",
        "losses",
        "diagnostics",
    ];
    let texts = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
    let bands = BANDS.iter().flat_map(|band| of_band(band)).collect();
    [texts(&fixed), texts(&altitude), bands, texts(&rest)].concat()
}

/// The rows for people, in columns.
pub fn as_text(rows: &[Row]) -> String {
    let head = ["log", "frames", "altitude [m]", "attenuation [1/m]", "identified", "result"];
    let cells: Vec<[String; 6]> =
        [head.map(String::from)].into_iter().chain(rows.iter().map(Row::cells)).collect();
    let width = |column: usize| cells.iter().map(|c| c[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; 6] = std::array::from_fn(width);
    let line = |cells: &[String; 6]| {
        let padded = cells.iter().zip(widths).map(|(c, width)| format!("{c:<width$}"));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_string() + "\n"
    };
    cells.iter().map(line).collect()
}

/// The rows as CSV (RFC 4180), with a header.
pub fn as_csv(rows: &[Row]) -> String {
    let line = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|c| csv_cell(c)).collect();
        cells.join(",") + "\n"
    };
    let rows: String = rows.iter().map(|row| line(&row.values())).collect();
    line(&columns()) + &rows
}

/// A cell of a CSV table, quoted where it must be.
pub fn csv_cell(text: &str) -> String {
    let is_plain = !text.contains([',', '"', '\n', '\r']);
    if is_plain { text.into() } else { format!("\"{}\"", text.replace('"', "\"\"")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_every_column() {
        let rows = [Row::without_facts("a, b", "failed: \"no\" camera")];
        let csv = as_csv(&rows);
        let (head, row) = csv.trim_end().split_once('\n').expect("two lines");
        assert_eq!(head.split(',').count(), columns().len());
        assert!(row.starts_with("\"a, b\",\"failed: \"\"no\"\" camera\",,"), "{row}");
        assert_eq!(rows[0].values().len(), columns().len());
        assert!(as_text(&rows).lines().nth(1).expect("a row").ends_with("failed: \"no\" camera"));
    }
}
