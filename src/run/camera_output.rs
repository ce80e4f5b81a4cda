//! One camera in pass two: what its topics are made of.

use crate::config::Method;
use crate::correct::FrameFacts;
use crate::diagnostics::{Diagnostic, Reason};
use crate::geometry::SeafloorPlane;
use crate::image::Container;
use crate::messages::Header;
use crate::messages::writer::WireFormat;
use crate::recording::Message;
use crate::report::Report;
use crate::session::CameraSession;
use crate::units::Stamp;

use super::camera_model::CameraModel;
use super::clouds::Clouds;
use super::corrector::Corrector;
use super::output_names::{corrected_topic, method_name, output_container};

/// A camera that is corrected.
pub struct CameraOutput<'p> {
    /// log and survey
    pub session: &'p CameraSession,
    /// its model
    pub model: &'p CameraModel,
    /// corrects its frames
    pub corrector: Corrector<'p>,
    /// wire format of added messages
    pub wire: WireFormat,
    /// the rig as the text of a rig file
    pub rig_toml: &'p str,
    /// fingerprint of what the run was given beside its input
    pub request: &'p str,
    /// which frames are shown on the seafloor in 3-D
    pub clouds: &'p Clouds,
    /// those of the model
    pub model_diagnostics: &'p [Diagnostic],
    /// follows `/unwater` in the names of all but the first camera
    pub name: String,
}

/// A frame after the work on it.
pub struct FrameOutput {
    /// its message in the input
    pub message: Message,
    /// header of that message
    pub header: Header,
    /// seafloor below it
    pub plane: Option<SeafloorPlane>,
    /// message of the raw image for viewers
    pub preview: Option<Vec<u8>>,
    /// messages of the corrected image, or why there are none
    pub result: Result<ImageMessages, Reason>,
}

/// Messages of a corrected image.
pub struct ImageMessages {
    /// the image
    pub image: Vec<u8>,
    /// its mask
    pub mask: Option<Vec<u8>>,
    /// the image on the seafloor, for 3-D panels
    pub cloud: Option<Vec<u8>>,
    /// path lengths and shares
    pub facts: FrameFacts,
}

impl FrameOutput {
    /// Time of the frame, as in its message.
    pub fn stamp(&self) -> Stamp {
        self.header.stamp.unwrap_or(self.message.log_stamp())
    }
}

impl CameraOutput<'_> {
    /// File format of the corrected images.
    pub fn container(&self) -> Container {
        output_container(self.session.survey.container, &self.session.config)
    }

    /// Quality of the corrected images, where they are JPEGs.
    pub fn jpeg_quality(&self) -> u8 {
        let survey = &self.session.survey;
        self.session.config.render.jpeg_quality.for_source(survey.jpeg_quality)
    }

    /// Topic of the corrected images.
    pub fn corrected_topic(&self) -> String {
        let is_compressed = self.container() != Container::Raw;
        corrected_topic(&self.session.survey.camera_topic, is_compressed)
    }

    /// A topic below `/unwater`.
    pub fn own_topic(&self, name: &str) -> String {
        format!("/unwater{}/{name}", self.name)
    }

    /// Whether frames are corrected by the method that the verdict is about.
    fn is_full(&self) -> bool {
        self.session.config.render.method == Method::Full
    }

    /// The report before the first frame.
    pub fn new_report(&self) -> Report {
        let Self { session, model_diagnostics, .. } = self;
        Report {
            version: env!("CARGO_PKG_VERSION").into(),
            source: session.file_name(),
            camera_topic: session.survey.camera_topic.clone(),
            corrected_topic: self.corrected_topic(),
            camera_info_topic: session.survey.camera_info.clone(),
            dvl_topic: session.survey.dvl_topic.clone(),
            verdict: self.model.file.verdict.clone().filter(|_| self.is_full()),
            method: method_name(session.config.render.method).into(),
            diagnostics: [&session.survey.diagnostics, *model_diagnostics].concat(),
            ..Report::default()
        }
    }
}
