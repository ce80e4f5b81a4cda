//! Where a vehicle's light comes from: the rig file's word, else the TF tree's, else the camera's place.

use super::Selection;
use super::mounts::Mounts;
use crate::error::{Error, Result};
use crate::spaces::{Body, Direction, Optical, Strobe, Transform};
use crate::vehicle::{Lamps, MOST_LAMPS, RigFile, StrobeMount};

/// A light whose axis is this far off the camera's, as a cosine, does not light what it sees: its turn is another
/// convention's (x ahead) or none.
const LEAST_AHEAD: f64 = 0.4;
/// Words in a TF frame's name that say it is a light.
const LIGHT_WORDS: &[&str] = &["strobe", "flash", "light", "lamp", "led", "lumen"];

pub fn strobe_mount(
    mounts: &Mounts<'_>,
    body_frame: &str,
    selection: &Selection,
    rig_file: &RigFile,
    body_from_optical: Transform<Body, Optical>,
    remarks: &mut Vec<String>,
) -> Result<StrobeMount> {
    if let Some(facts) = &rig_file.strobe.lamps {
        let mounts = facts.iter().map(|l| Ok((l.mount(body_from_optical)?, l.strength))).collect::<std::result::Result<Vec<_>, String>>();
        let lamps = Lamps::several(&mounts.map_err(Error::Rig)?);
        let lamps = lamps.ok_or_else(|| Error::Rig(format!("strobe.lamps takes 1 to {MOST_LAMPS} lamps with a strength above 0")))?;
        return Ok(StrobeMount { lamps, source: Some("rig file".into()) });
    }
    if let Some(mount) = &rig_file.strobe.mount {
        return Ok(StrobeMount { lamps: Lamps::one(mount.transform().map_err(Error::Rig)?), source: Some("rig file".into()) });
    }
    let in_tf = |frame: &str| -> Option<Transform<Body, Strobe>> { mounts.pose_below(body_frame, frame).map(Transform::from_isometry) };
    if let Some(frame) = &selection.strobe_frame {
        let found = in_tf(frame).ok_or_else(|| Error::Usage(format!("--strobe-frame {frame}: the TF tree has {}", mounts.frames().join(", "))))?;
        return Ok(StrobeMount { lamps: Lamps::one(found), source: Some(frame.clone()) });
    }
    let is_light = |name: &str| {
        let name = name.to_ascii_lowercase();
        LIGHT_WORDS.iter().any(|w| name.split(|c: char| !c.is_ascii_alphabetic()).any(|part| part == *w || (w.len() > 4 && part.contains(w))))
    };
    let lights: Vec<&str> = mounts.frames().into_iter().filter(|f| is_light(f) && in_tf(f).is_some()).collect();
    // `strobe_link` with `strobe_optical_frame` below it is one light, not two.
    let optical: Vec<&str> = lights.iter().copied().filter(|f| f.contains("optical")).collect();
    match (if optical.is_empty() { &lights } else { &optical }).as_slice() {
        [] => Ok(StrobeMount { lamps: Lamps::one(Transform::from_isometry(body_from_optical.isometry())), source: None }),
        [one] => Ok(StrobeMount { lamps: Lamps::one(in_tf(one).unwrap_or_else(Transform::identity)), source: Some((*one).into()) }),
        several => {
            let ahead = |pose: &Transform<Body, Strobe>| {
                (*pose * Direction::boresight()).vector().dot(&(body_from_optical * Direction::boresight()).vector())
            };
            let mut mounts: Vec<(Transform<Body, Strobe>, f64)> = several.iter().take(MOST_LAMPS).filter_map(|f| Some((in_tf(f)?, 1.0))).collect();
            if mounts.iter().any(|(pose, _)| ahead(pose) < LEAST_AHEAD) {
                remarks.push(
                    "by their turn in the TF tree these lights would not shine where the camera looks; they are taken to look as it does".into(),
                );
                for (pose, _) in &mut mounts {
                    let mut as_camera = body_from_optical.isometry();
                    as_camera.translation.vector = pose.origin().vector();
                    *pose = Transform::from_isometry(as_camera);
                }
            }
            remarks.push(format!(
                "several lights in the TF tree ({}): taken as equally strong and of one beam pattern, {} of them; name the one that shone with --strobe-frame, or strengths under [[strobe.lamps]] in a rig file",
                several.join(", "),
                mounts.len()
            ));
            let lamps = Lamps::several(&mounts).unwrap_or_else(|| Lamps::one(Transform::from_isometry(body_from_optical.isometry())));
            Ok(StrobeMount { lamps, source: Some(several.join(" + ")) })
        }
    }
}
