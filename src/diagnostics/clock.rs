//! Stamps and clocks.

use super::facts;

/// Why an offset between two clocks is not determined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OffsetUnknown {
    /// too few frames or pings
    #[default]
    FewObservations,
    /// the best offset lies at the end of the interval that was searched
    NoMinimum,
    /// too little motion or too much noise
    Flat,
}

impl std::fmt::Display for OffsetUnknown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::FewObservations => "too few observations",
            Self::NoMinimum => "no offset in the searched interval fits better than its ends",
            Self::Flat => {
                "altitude and attitude of the vehicle change too little, or the measurements are \
                 too noisy"
            }
        })
    }
}

facts! {
    /// Facts about the stamps of a topic.
    ClockFact {
        Warning "stamps-missing" Missing { missing: u64, messages: u64 },
            text("{missing} of {messages} messages have no stamp or a stamp of 0; log time is \
                  used for them"),
            remedy("stamp the messages in the driver; offsets are set under [time_offset_s] in a \
                    rig file");
        Warning "stamps-of-device-clock" DeviceClock { offset_s: f64 },
            text("stamps are {offset_s:+.1} s from log time: the clock of the device itself"),
            remedy("set the offset under [time_offset_s] in a rig file; `unwater inspect \
                    --clocks` estimates it");
        Warning "stamps-repeated" Repeated { messages: usize },
            text("{messages} messages have the stamp of the message before"),
            remedy("check the driver that stamps them; `unwater inspect --clocks` estimates \
                    offsets");
        Warning "stamps-backwards" Backwards { messages: usize },
            text("{messages} messages are stamped earlier than the message before"),
            remedy("check the driver that stamps them; `unwater inspect --clocks` estimates \
                    offsets");
        Warning "stamps-not-on-camera-clock" NotOnCameraClock,
            text("stamps are not on the clock of the camera; log time is used"),
            remedy("set the offset under [time_offset_s] in a rig file; `unwater inspect \
                    --clocks` estimates it");
        Warning "time-offset-of-unknown-topic" OffsetOfUnknownTopic,
            text("named under [time_offset_s] of the rig file, but not a topic of the log"),
            remedy("correct the topic in the rig file");
        /// As below, and the offset is used.
        Warning "camera-clock-replaced" CameraReplaced {
            offset_s: f64,
            std_s: f64,
            time_offset_s: f64,
            residual: [f64; 2],
        },
            text("the clock of the camera is off: {offset_s:+.3} ± {std_s:.3} s are added to its \
                  stamps (residual {:.4} instead of {:.4})", residual[1], residual[0]),
            remedy("write {time_offset_s:.3} for this topic under [time_offset_s] in a rig file; \
                    --self-calibration report keeps the stamps");
        /// The logs of a model had an offset that this log is not corrected with.
        Warning "camera-clock-of-other-logs" OfOtherLogs { time_offset_s: f64 },
            text("the model's logs have stamps of the camera that are off by {time_offset_s:+.3} \
                  s; the stamps of this log are used as they are"),
            remedy("where this log has the same offset, write {time_offset_s:.3} for this topic \
                    under [time_offset_s] in a rig file");
        /// Images fit the seafloor better at other times; `time_offset_s` is the rig key's value.
        Warning "camera-clock-contradicted" CameraContradicted {
            offset_s: f64,
            std_s: f64,
            time_offset_s: f64,
            residual: [f64; 2],
        },
            text("the log contradicts the camera clock: its images fit the seafloor {offset_s:.3} \
                  ± {std_s:.3} s away (residual {:.4} instead of {:.4})", residual[1], residual[0]),
            remedy("if camera and range instrument have two clocks, write under [time_offset_s] \
                    in a rig file: \"<topic>\" = {time_offset_s:.3}");
        Warning "clock-offset-found" OffsetFound { offset_s: f64, std_s: f64, time_offset_s: f64 },
            text("stamps fit the other sensors best {:.2} ± {std_s:.2} s {}",
                 offset_s.abs(), if *offset_s > 0.0 { "later" } else { "earlier" }),
            remedy("if that is so, write under [time_offset_s] in a rig file: \"<topic>\" = \
                    {time_offset_s:.2}");
        Info "clock-agrees" Agrees { offset_s: f64, std_s: f64 },
            text("stamps fit the other sensors ({offset_s:+.2} ± {std_s:.2} s)");
        Info "clock-offset-unknown" Unknown { reason: OffsetUnknown },
            text("an offset of the clock cannot be estimated: {reason}");
    }
}
