//! Where a vehicle's light comes from: the rig file's word, else the TF tree's, else the camera's
//! place.

use super::Selection;
use super::mounts::Mounts;
use crate::coordinates::{Body, Direction, Optical, Strobe, Transform};
use crate::diagnostics::{Diagnostic, MountFact};
use crate::error::{Error, Result};
use crate::vehicle::{Lamps, MAX_LAMPS, RigFile, StrobeMount, StrobeSource};

/// A light whose axis is this far off the camera's, as a cosine, does not light what it sees: its
/// turn is another convention's (x ahead) or none.
const LEAST_AHEAD: f64 = 0.4;
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

pub fn strobe_mount(
    mounts: &Mounts<'_>,
    body_frame: &str,
    selection: &Selection,
    rig_file: &RigFile,
    body_from_optical: Transform<Body, Optical>,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<StrobeMount> {
    if let Some(facts) = &rig_file.strobe.lamps {
        let mounts = facts
            .iter()
            .map(|l| Ok((l.mount(body_from_optical)?, l.strength)))
            .collect::<std::result::Result<Vec<_>, String>>();
        let lamps = Lamps::several(&mounts.map_err(Error::Rig)?);
        let lamps = lamps.ok_or_else(|| {
            Error::Rig(format!("strobe.lamps takes 1 to {MAX_LAMPS} lamps with a strength above 0"))
        })?;
        return Ok(StrobeMount { lamps, source: Some(StrobeSource::Given("rig file".into())) });
    }
    let ahead = |pose: &Transform<Body, Strobe>| {
        (*pose * Direction::boresight())
            .vector()
            .dot(&(body_from_optical * Direction::boresight()).vector())
    };
    if let Some(mount) = &rig_file.strobe.mount {
        let pose = mount.transform().map_err(Error::Rig)?;
        if ahead(&pose) < LEAST_AHEAD {
            diagnostics.push(MountFact::StrobeAxisOff.into());
        }
        return Ok(StrobeMount {
            lamps: Lamps::one(pose),
            source: Some(StrobeSource::Given("rig file".into())),
        });
    }
    let in_tf = |frame: &str| -> Option<Transform<Body, Strobe>> {
        mounts.pose_below(body_frame, frame).map(Transform::from_isometry)
    };
    let frames = mounts.frames();
    let lights: Vec<&str> = match &selection.strobe_frame {
        Some(frame) if in_tf(frame).is_none() => {
            return Err(Error::Usage(format!(
                "--strobe-frame {frame}: the TF tree has {}",
                frames.join(", ")
            )));
        }
        Some(frame) => vec![frame.as_str()],
        None => frames.into_iter().filter(|f| is_light(f) && in_tf(f).is_some()).collect(),
    };
    // `strobe_link` with `strobe_optical_frame` below it is one light, not two.
    let optical: Vec<&str> = lights.iter().copied().filter(|f| f.contains("optical")).collect();
    let lights = if optical.is_empty() { lights } else { optical };
    let names = || lights.iter().map(|frame| (*frame).into()).collect();
    let mut mounts: Vec<(Transform<Body, Strobe>, f64)> =
        lights.iter().take(MAX_LAMPS).filter_map(|f| Some((in_tf(f)?, 1.0))).collect();
    if mounts.iter().any(|(pose, _)| ahead(pose) < LEAST_AHEAD) {
        diagnostics.push(MountFact::StrobeOrientationReplaced { frames: names() }.into());
        for (pose, _) in &mut mounts {
            let mut as_camera = body_from_optical.isometry();
            as_camera.translation.vector = pose.origin().vector();
            *pose = Transform::from_isometry(as_camera);
        }
    }
    if mounts.len() > 1 {
        let used = mounts.len();
        diagnostics.push(MountFact::SeveralStrobes { frames: names(), used }.into());
    }
    let at_camera = || Lamps::one(Transform::from_isometry(body_from_optical.isometry()));
    let lamps = match mounts.as_slice() {
        [(one, _)] => Lamps::one(*one),
        several => Lamps::several(several).unwrap_or_else(at_camera),
    };
    Ok(StrobeMount {
        lamps,
        source: (!lights.is_empty()).then(|| StrobeSource::Given(lights.join(" + "))),
    })
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
