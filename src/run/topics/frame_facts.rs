//! Topics of what the run found: facts of every frame, and the log.

use super::super::camera_output::CameraOutput;
use super::topic::OutputTopic;
use crate::correct::FrameFacts;
use crate::diagnostics::{Severity, Uncorrected};
use crate::messages::output::{self, LogLine};
use crate::model::LightSettingFile;

pub const FRAME: OutputTopic = OutputTopic {
    rank: 12,
    name: |camera| Some(camera.own_topic("frame")),
    message_type: |_| output::FRAME,
    write: |frame, put| {
        let (corrected, reason, facts) = match &frame.output.result {
            Ok(images) => (true, String::new(), images.facts),
            Err(reason) => (false, reason.to_string(), UNKNOWN),
        };
        let message = output::with_header(frame.camera.wire, &frame.output.header)
            .u8(u8::from(corrected))
            .text(&reason)
            .f64s(&numbers(&facts));
        put(&message.finish());
    },
};

/// The log before the first frame: the model, and all diagnostics.
pub const OPENING_LOG: OutputTopic = OutputTopic {
    write: |frame, put| {
        for line in opening_lines(frame.camera).iter().filter(|_| frame.is_first) {
            put(&output::log(frame.camera.wire, frame.output.stamp(), line));
        }
    },
    ..LOG
};

/// The log along the dive: frames that are not corrected, once per reason.
pub const LOG: OutputTopic = OutputTopic {
    rank: 13,
    name: |camera| Some(camera.own_topic("log")),
    message_type: |_| output::LOG,
    write: |frame, put| {
        if let (Err(reason), true) = (&frame.output.result, frame.is_first_of_reason) {
            let first = Uncorrected { frames: 1, reason: reason.clone() };
            let line = LogLine::of(&first.into());
            put(&output::log(frame.camera.wire, frame.output.stamp(), &line));
        }
    },
};

fn opening_lines(camera: &CameraOutput<'_>) -> Vec<LogLine> {
    let file = &camera.model.file;
    let (kind, estimator) = (file.attenuation_kind.word(), file.estimator.word());
    let attenuation = match file.attenuation_text() {
        text if file.has_attenuation() => format!("{kind} attenuation {text} per metre"),
        text => format!("attenuation {text}"),
    };
    let mut lines = vec![LogLine::info(format!("{attenuation}, by the {estimator} estimator"))];
    let diagnostics = [camera.model_diagnostics, &camera.session.survey.diagnostics].concat();
    let of = |severity: Severity| {
        let of_severity = diagnostics.iter().filter(move |d| d.severity() == severity);
        of_severity.map(LogLine::of)
    };
    lines.extend(of(Severity::Warning));
    let followed = |s: &LightSettingFile| {
        let law = s.law.word();
        LogLine::info(format!("{} ({}): image brightness follows it as {law}", s.topic, s.name))
    };
    lines.extend(file.light_settings.iter().map(followed));
    lines.extend(of(Severity::Info));
    lines
}

/// In the order of the message.
fn numbers(facts: &FrameFacts) -> [f64; 14] {
    let [red, green, blue] = facts.frame_gain;
    [
        facts.camera_altitude_m,
        facts.path_length_min_m,
        facts.path_length_mean_m,
        facts.path_length_max_m,
        facts.clipped_input_share,
        facts.clipped_output_share,
        facts.gain_capped_share,
        facts.off_surface_share,
        facts.unseen_beam_share,
        facts.mean_gain,
        facts.low_signal_share,
        red,
        green,
        blue,
    ]
}

const UNKNOWN: FrameFacts = FrameFacts {
    camera_altitude_m: f64::NAN,
    path_length_min_m: f64::NAN,
    path_length_mean_m: f64::NAN,
    path_length_max_m: f64::NAN,
    clipped_input_share: f64::NAN,
    clipped_output_share: f64::NAN,
    gain_capped_share: f64::NAN,
    off_surface_share: f64::NAN,
    unseen_beam_share: f64::NAN,
    mean_gain: f64::NAN,
    low_signal_share: f64::NAN,
    restored_share: f64::NAN,
    frame_gain: [f64::NAN; 3],
};
