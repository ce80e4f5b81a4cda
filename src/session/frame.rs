//! Message → frame: pixel values and geometry. Both passes and every product build frames here and
//! nowhere else.

use std::borrow::Cow;

use super::camera::CameraSession;
use super::index::FrameRef;
use super::survey::Survey;
use crate::diagnostics::Reason;
use crate::error::Error;
use crate::geometry::{NoSeafloor, SeafloorPlane, Support, Terrain, View};
use crate::image::decode::{CameraResponse, PixelValues, read_pixels_with};
use crate::image::flat_field::FlatField;
use crate::image::noise::Noise;
use crate::image::{EncodedImage, SensorImage};
use crate::messages::value::Value;
use crate::messages::{Header, Kind, header};
use crate::recording::Message;
use crate::units::Stamp;
use crate::vehicle::Camera;

/// An image message, its image still encoded.
pub struct ImageMessage<'m> {
    /// identity and times
    pub at: FrameRef,
    /// its header
    pub header: Header,
    value: Value<'m>,
    decode: for<'v> fn(&'v Value<'_>) -> Result<EncodedImage<'v>, String>,
}

/// A frame: one image of a log with its time and geometry.
pub struct Frame<'f> {
    /// identity and times
    pub at: FrameRef,
    /// its image
    pub pixels: PixelValues<'f>,
    /// vignetting and black level for the size of its image
    pub flat_field: Option<Cow<'f, FlatField>>,
    /// calibration for the size of its image
    pub camera: Camera,
    /// seafloor below it
    pub plane: SeafloorPlane,
    /// heights over the plane; `None` for flat seafloor
    pub terrain: Option<Terrain>,
    session: &'f CameraSession,
}

/// A frame that cannot be corrected.
pub struct UnusableFrame<'f> {
    /// why
    pub reason: Reason,
    /// its image, where it can be decoded
    pub pixels: Option<PixelValues<'f>>,
    /// seafloor below it, where it is known
    pub plane: Option<SeafloorPlane>,
}

impl CameraSession {
    /// Identity and times of a frame. Its stamp includes the clock offset of the rig file.
    pub fn frame_ref(&self, message: &Message) -> FrameRef {
        let logged = message.log_stamp();
        let unknown = FrameRef { id: message.id, stamp: logged, logged };
        self.survey.frame(message.id).copied().unwrap_or(unknown)
    }

    /// Reads an image message.
    ///
    /// # Errors
    /// It contradicts its schema, or is no image.
    pub fn read<'m>(&self, message: &'m Message) -> Result<ImageMessage<'m>, Reason> {
        let undecodable = |reason: String| Reason::Undecodable { reason };
        let decoder = self.index.decoders.get(&message.channel);
        let decoder = decoder.ok_or_else(|| undecodable("its channel is not read".into()))?;
        let value = decoder.read(message.data()).map_err(undecodable)?;
        let Kind::Image(decode) = decoder.message_type.kind else {
            return Err(undecodable("no image".into()));
        };
        Ok(ImageMessage { at: self.frame_ref(message), header: header(&value), value, decode })
    }

    /// Builds a frame: decodes the image, and finds seafloor plane and terrain below it. The
    /// buffer is reused for the pixel values.
    ///
    /// # Errors
    /// The image cannot be decoded, its size contradicts the calibration, or no seafloor is known
    /// at its time.
    pub fn frame<'f>(
        &'f self,
        image: &'f ImageMessage<'_>,
        buffer: Vec<u8>,
    ) -> Result<Frame<'f>, Box<UnusableFrame<'f>>> {
        let unusable = |reason, pixels, plane| Box::new(UnusableFrame { reason, pixels, plane });
        let undecodable = |reason| unusable(Reason::Undecodable { reason }, None, None);
        let encoded = (image.decode)(&image.value).map_err(undecodable)?;
        let pixels = read_pixels_with(&encoded, self.response(), buffer).map_err(undecodable)?;
        let (width, height) = (pixels.width, pixels.height);
        let flat_field = self.survey.flat_field.as_ref().map(|f| f.for_size(width, height));
        let Ok(flat_field) = flat_field.transpose() else {
            return Err(unusable(Reason::WrongSize, None, None));
        };
        if is_dark(&pixels) {
            return Err(unusable(Reason::Dark, Some(pixels), None));
        }
        if self.survey.unlit_below.is_some_and(|below| pixels.brightness() < below) {
            return Err(unusable(Reason::Unlit, Some(pixels), None));
        }
        let plane = match self.seafloor(image.at.stamp) {
            Ok(plane) => plane,
            Err(e) => return Err(unusable(no_seafloor(&e), Some(pixels), None)),
        };
        let Some(camera) = self.survey.rig.camera.scaled_to(width, height) else {
            return Err(unusable(Reason::WrongSize, Some(pixels), Some(plane)));
        };
        let terrain = self.survey.pings.terrain(image.at.stamp, &plane, &self.survey.rig);
        Ok(Frame { at: image.at, pixels, flat_field, camera, plane, terrain, session: self })
    }

    /// How pixel values of this camera relate to light.
    pub fn response(&self) -> CameraResponse<'_> {
        CameraResponse {
            transfer: self.config.light.transfer,
            white_level: self.survey.white_level,
            response: self.survey.response.as_ref(),
        }
    }

    /// The seafloor plane at a time.
    ///
    /// # Errors
    /// No ping near enough, no return, or an implausible plane.
    pub fn seafloor(&self, stamp: Stamp) -> Result<SeafloorPlane, NoSeafloor> {
        let Survey { pings, rig, tilts, camera_offset_s, .. } = &self.survey;
        let plane = pings.seafloor(stamp, rig, &self.config.seafloor)?;
        let tilt = tilts.as_ref().filter(|_| plane.support == Support::AssumedLevel);
        Ok(tilt.map_or(plane, |tilts| {
            plane.changed(rig, tilts.at(stamp.plus_seconds(-camera_offset_s)))
        }))
    }

    /// Number of frames with a seafloor below them.
    ///
    /// # Errors
    /// None has; with the most frequent reason.
    pub fn frames_with_seafloor(&self) -> crate::error::Result<usize> {
        let (frames, survey) = (&self.survey.frames, &self.survey);
        let (camera_topic, dvl_topic) = (&survey.camera_topic, &survey.dvl_topic);
        let mut reasons: Vec<(Reason, usize)> = Vec::new();
        let mut with_seafloor = 0;
        for frame in frames {
            let Err(why) = self.seafloor(frame.stamp) else {
                with_seafloor += 1;
                continue;
            };
            let reason = no_seafloor(&why);
            match reasons.iter_mut().find(|(known, _)| *known == reason) {
                Some((_, count)) => *count += 1,
                None => reasons.push((reason, 1)),
            }
        }
        if with_seafloor > 0 {
            return Ok(with_seafloor);
        }
        let reason = reasons.into_iter().max_by_key(|(_, count)| *count).map(|(reason, _)| reason);
        Err(Error::Data(match reason {
            None => format!("{camera_topic} has no images"),
            Some(reason) => format!(
                "no image of {camera_topic} has a seafloor below it by {dvl_topic}: {reason}; {}",
                reason.remedy().unwrap_or_default()
            ),
        }))
    }

    /// Geometry of a frame before its image is decoded: at the size of the calibration, on flat
    /// seafloor.
    pub fn flat_view<'v>(&'v self, plane: &'v SeafloorPlane) -> View<'v> {
        let rig = &self.survey.rig;
        View { camera: &rig.camera, rig, plane, terrain: None }
    }
}

/// Mean light of an 8-bit image that shows nothing: about three steps of its pixel values.
const DARK: f64 = 0.001;

/// Whether an image is dark all over: no strobe, or no seafloor within reach of its light. Images
/// of more bits have a signal there.
fn is_dark(pixels: &PixelValues<'_>) -> bool {
    pixels.coding.bits <= 8 && pixels.mean_light().iter().all(|light| *light < DARK)
}

fn no_seafloor(why: &NoSeafloor) -> Reason {
    match why {
        NoSeafloor::NoPing { .. } => Reason::NoPing,
        NoSeafloor::NoReturn => Reason::NoReturn,
        NoSeafloor::Implausible => Reason::ImpossiblePlane,
    }
}

impl Frame<'_> {
    /// Its geometry.
    pub fn view(&self) -> View<'_> {
        View {
            camera: &self.camera,
            rig: &self.session.survey.rig,
            plane: &self.plane,
            terrain: self.terrain.as_ref(),
        }
    }

    /// Its linear light, without vignetting, in a buffer that is reused.
    ///
    /// # Errors
    /// The flat field has another size.
    pub fn light(&self, buffer: Vec<f32>) -> Result<SensorImage, String> {
        let mut image = self.pixels.to_linear(buffer);
        self.flat_field.as_ref().map_or(Ok(()), |flat| flat.divide(&mut image))?;
        Ok(image)
    }

    /// Noise of its linear light.
    pub fn noise(&self) -> Noise {
        let Self { session, pixels, .. } = self;
        Noise::of(&pixels.coding, session.response(), session.survey.electrons)
    }
}
