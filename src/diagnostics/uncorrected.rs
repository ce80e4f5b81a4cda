//! Frames that passed through uncorrected.

use super::{Severity, facts};

facts! {
    /// Why a frame was not corrected.
    Reason {
        Loss "image-not-decodable" Undecodable { reason: String },
            text("the image cannot be decoded ({reason})"),
            remedy("`unwater inspect` names the encoding; docs/formats.md lists those that are \
                    read");
        Loss "image-size" WrongSize,
            text("the size of the image does not fit the calibration"),
            remedy("write the calibration of these images into a rig file: `unwater init` makes \
                    one");
        Loss "image-dark" Dark,
            text("the image is dark"),
            remedy("check that the strobe fires with every image, within reach of the seafloor");
        Info "image-without-strobe" Unlit,
            text("the image was taken without the strobe, or by another lamp, in turns with \
                  others");
        Loss "no-ping" NoPing,
            text("no range to the seafloor near enough in time"),
            remedy("name another instrument with --dvl TOPIC, or allow a longer gap with \
                    seafloor.max_ping_gap_s in the settings");
        Loss "no-return" NoReturn,
            text("no sonar beam has a return"),
            remedy("the seafloor was out of reach of the instrument, or too near; name another one \
                    with --dvl TOPIC");
        Loss "impossible-plane" ImpossiblePlane,
            text("the ranges give no plausible seafloor"),
            remedy("check mount and beams of the instrument in a rig file: [dvl.mount], dvl.beams");
        Loss "off-seafloor" OffSeafloor,
            text("no pixel sees the seafloor"),
            remedy("check the mount of the camera in a rig file: [camera.mount]");
        Loss "image-not-encodable" Unencodable { reason: String },
            text("the corrected image cannot be encoded ({reason})"),
            remedy("try --image-format png");
    }
}

/// Frames that share a reason.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Uncorrected {
    /// how many
    pub frames: usize,
    /// why
    #[serde(flatten)]
    pub reason: Reason,
}

impl Uncorrected {
    pub(super) fn code(&self) -> &'static str {
        self.reason.code()
    }

    pub(super) fn severity(&self) -> Severity {
        self.reason.severity()
    }

    pub(super) fn remedy(&self) -> Option<String> {
        self.reason.remedy()
    }
}

impl std::fmt::Display for Uncorrected {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} frames passed uncorrected: {}", self.frames, self.reason)
    }
}
