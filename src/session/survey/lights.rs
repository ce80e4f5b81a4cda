//! Where a vehicle's light comes from: the rig file's word, else the TF tree's, else the camera's
//! place.

use super::super::options::Options;
use super::mounts::Mounts;
use crate::coordinates::{Body, Direction, Optical, Strobe, Transform};
use crate::diagnostics::{Diagnostic, MountFact};
use crate::error::{Error, Result};
use crate::vehicle::{LampFacts, Lamps, MAX_LAMPS, StrobeMount, StrobeSource};

/// A light whose axis is this far off the camera's, as a cosine, does not light what it sees: its
/// turn is another convention's (x ahead) or none.
const MIN_AXIS_COSINE: f64 = 0.4;
/// Words that say of a TF frame that it is a light, alone or at the end of a longer one
/// (`floodlights_2`), …
const LIGHT_WORDS: &[&str] = &["strobe", "flash", "light", "lamp", "led", "lumen"];
/// … but for these, which are short or end by chance, and …
const WHOLE_WORDS: &[&str] = &["led", "lamp"];
/// … not where one of these stands beside it: `ambient_light_sensor`, `flight_controller`.
const NOT_OF_LIGHTS: &[&str] = &["sensor", "ambient", "flight", "controller"];

fn is_light(frame: &str) -> bool {
    let frame = frame.to_ascii_lowercase();
    let words = || frame.split(|c: char| !c.is_ascii_alphabetic());
    let says_light = |word: &str| {
        let word = word.strip_suffix('s').unwrap_or(word);
        LIGHT_WORDS.iter().any(|w| word == *w || (word.ends_with(w) && !WHOLE_WORDS.contains(w)))
    };
    words().any(says_light) && !words().any(|word| NOT_OF_LIGHTS.contains(&word))
}

/// The vehicle as far as the search for its lights needs it.
pub struct Vehicle<'s> {
    pub mounts: &'s Mounts<'s>,
    pub body_frame: &'s str,
    pub body_from_optical: Transform<Body, Optical>,
}

/// The strobe by the rig file, else by the TF tree, else at the camera.
pub fn strobe_mount(
    vehicle: &Vehicle<'_>,
    options: &Options,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<StrobeMount> {
    let strobe = &options.rig.strobe;
    if let Some(lamps) = &strobe.lamps {
        return vehicle.lamps_of_rig_file(lamps);
    }
    if let Some(mount) = &strobe.mount {
        let pose = mount.transform().map_err(Error::Rig)?;
        if !vehicle.lights_view(&pose) {
            diagnostics.push(MountFact::StrobeAxisOff.into());
        }
        return Ok(StrobeMount {
            lamps: Lamps::one(pose),
            source: Some(StrobeSource::Given("rig file".into())),
        });
    }
    let lights = vehicle.light_frames(options.selection.strobe_frame.as_deref())?;
    Ok(vehicle.lamps_of_tree(&lights, diagnostics))
}

impl Vehicle<'_> {
    fn lamps_of_rig_file(&self, facts: &[LampFacts]) -> Result<StrobeMount> {
        let mounts = facts
            .iter()
            .map(|l| Ok((l.mount(self.body_from_optical)?, l.strength)))
            .collect::<std::result::Result<Vec<_>, String>>();
        let lamps = Lamps::several(&mounts.map_err(Error::Rig)?);
        let lamps = lamps.ok_or_else(|| {
            Error::Rig(format!("strobe.lamps takes 1 to {MAX_LAMPS} lamps with a strength above 0"))
        })?;
        Ok(StrobeMount { lamps, source: Some(StrobeSource::Given("rig file".into())) })
    }

    /// Whether a lamp of this pose shines where the camera looks.
    fn lights_view(&self, pose: &Transform<Body, Strobe>) -> bool {
        let (axis, optical_axis) =
            (*pose * Direction::boresight(), self.body_from_optical * Direction::boresight());
        axis.vector().dot(&optical_axis.vector()) >= MIN_AXIS_COSINE
    }

    fn pose(&self, frame: &str) -> Option<Transform<Body, Strobe>> {
        self.mounts.pose_below(self.body_frame, frame).map(Transform::from_isometry)
    }

    /// Frames of the TF tree that are lights: the named one, or all by their names.
    fn light_frames<'f>(&'f self, named: Option<&'f str>) -> Result<Vec<&'f str>> {
        let frames = self.mounts.frames();
        let lights: Vec<&str> = match named {
            Some(frame) if self.pose(frame).is_none() => {
                return Err(Error::Usage(format!(
                    "--strobe-frame {frame}: the TF tree has {}",
                    frames.join(", ")
                )));
            }
            Some(frame) => vec![frame],
            None => {
                let is_mounted = |f: &&str| is_light(f) && self.pose(f).is_some();
                frames.into_iter().filter(is_mounted).collect()
            }
        };
        // `strobe_link` with `strobe_optical_frame` below it is one light, not two.
        let optical: Vec<&str> = lights.iter().copied().filter(|f| f.contains("optical")).collect();
        Ok(if optical.is_empty() { lights } else { optical })
    }

    fn lamps_of_tree(&self, lights: &[&str], diagnostics: &mut Vec<Diagnostic>) -> StrobeMount {
        let names = || lights.iter().map(|frame| (*frame).into()).collect();
        let as_camera = self.body_from_optical.isometry();
        let mut mounts: Vec<(Transform<Body, Strobe>, f64)> =
            lights.iter().take(MAX_LAMPS).filter_map(|f| Some((self.pose(f)?, 1.0))).collect();
        if mounts.iter().any(|(pose, _)| !self.lights_view(pose)) {
            diagnostics.push(MountFact::StrobeOrientationReplaced { frames: names() }.into());
            for (pose, _) in &mut mounts {
                let mut turned = as_camera;
                turned.translation.vector = pose.origin().vector();
                *pose = Transform::from_isometry(turned);
            }
        }
        let stays = |frame: &&&str| self.mounts.stays(frame);
        let frames: Vec<String> = lights.iter().filter(stays).map(|f| (*f).into()).collect();
        if !frames.is_empty() {
            diagnostics.push(MountFact::LampsStay { frames }.into());
        }
        if mounts.len() > 1 {
            let used = mounts.len();
            diagnostics.push(MountFact::SeveralStrobes { frames: names(), used }.into());
        }
        let at_camera = || Lamps::one(Transform::from_isometry(as_camera));
        let lamps = match mounts.as_slice() {
            [(one, _)] => Lamps::one(*one),
            several => Lamps::several(several).unwrap_or_else(at_camera),
        };
        StrobeMount {
            lamps,
            source: (!lights.is_empty()).then(|| StrobeSource::Given(lights.join(" + "))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_told_by_their_names() {
        for light in [
            "strobe_link",
            "strobe1",
            "Left_Light",
            "floodlights_2",
            "led_link",
            "lumens_port",
            "flash_optical_frame",
        ] {
            assert!(is_light(light), "{light}");
        }
        for other in [
            "flight_controller_link",
            "ambient_light_sensor_link",
            "lightware_link",
            "sled",
            "base_link",
            "clamp_link",
        ] {
            assert!(!is_light(other), "{other}");
        }
    }
}
