//! The rig as a rig file: for `init`, and for the output's attachment.

use crate::coordinates::Transform;
use crate::vehicle::{CameraFacts, LampFacts, MountFacts, Rig, RigFile, StrobeMount};

use super::super::log::Log;
use super::super::options::Options;
use super::calibration::{Images, calibration_in_log};
use super::choose::choose_camera;
use super::lights::{Vehicle, strobe_mount};
use super::mounts::Mounts;

/// Camera and strobe of a log without ranges: image size, calibration, mounts.
pub fn facts_without_ranges(log: &Log, options: &Options) -> RigFile {
    let Ok(topic) = choose_camera(log, &options.selection, &mut Vec::new()) else {
        return RigFile::default();
    };
    let of_camera = log.channels(&log.image_channels(&topic));
    let size = of_camera.iter().find_map(|c| c.image_size);
    let camera_frame =
        of_camera.iter().map(|c| c.frame_id.as_str()).find(|f| !f.is_empty()).unwrap_or_default();
    let named_info = options.rig.camera.camera_info.as_deref();
    let images = Images { topic: &topic, frame: camera_frame, size, named_info };
    let mut camera = match calibration_in_log(log, images).camera {
        Some(camera) => CameraFacts::of(&camera),
        None => CameraFacts {
            width: size.map(|p| p.0),
            height: size.map(|p| p.1),
            ..CameraFacts::default()
        },
    };
    let mounts = Mounts::new(log);
    let (body_frame, pose) = mounts.root(camera_frame);
    let mut file = RigFile::default();
    if body_frame != camera_frame {
        camera.mount = Some(MountFacts::of(pose));
        let vehicle = Vehicle {
            mounts: &mounts,
            body_frame: &body_frame,
            body_from_optical: Transform::from_isometry(pose),
        };
        let strobe = strobe_mount(&vehicle, options, &mut Vec::new());
        strobe.iter().for_each(|strobe| put_lamps(&mut file, strobe));
    }
    file.camera = camera;
    file
}

/// Where the lamps sit, if that is known.
fn put_lamps(file: &mut RigFile, strobe: &StrobeMount) {
    let mounts: Vec<_> =
        strobe.lamps.poses().map(|(pose, share)| (MountFacts::of(pose), share)).collect();
    match mounts.as_slice() {
        [(one, _)] => file.strobe.mount = strobe.source.as_ref().map(|_| one.clone()),
        several => {
            file.strobe.lamps =
                Some(several.iter().map(|(mount, share)| LampFacts::of(mount, *share)).collect());
        }
    }
}

/// The rig as a rig file, with what the user gave of the instrument: for `init` and for the
/// output's attachment.
pub fn rig_facts(rig: &Rig, given: &RigFile) -> RigFile {
    let mut file = RigFile {
        dvl: given.dvl.clone(),
        time_offset_s: given.time_offset_s.clone(),
        ..RigFile::default()
    };
    file.camera = CameraFacts::of(&rig.camera.as_calibrated());
    file.camera.medium = given.camera.medium;
    (file.camera.vignetting, file.camera.flat_field) =
        (given.camera.vignetting, given.camera.flat_field.clone());
    file.camera.black_level = given.camera.black_level;
    (file.camera.full_well_e, file.camera.read_noise_e) =
        (given.camera.full_well_e, given.camera.read_noise_e);
    file.camera.response.clone_from(&given.camera.response);
    // A mount in a rig file stands still.
    let is_still = rig.camera_motion.is_none();
    file.camera.mount = is_still.then(|| MountFacts::of(rig.body_from_optical.isometry()));
    file.dvl.mount = Some(MountFacts::of(rig.body_from_dvl.isometry()));
    put_lamps(&mut file, &rig.strobe);
    file
}
