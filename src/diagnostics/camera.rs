//! Images and calibration.

use super::facts;

facts! {
    /// Facts about a camera, its images and its calibration.
    CameraFact {
        Info "raw-images-preferred" RawPreferred { compressed_topic: String },
            text("is used, not {compressed_topic}");
        Warning "calibration-is-a-field-of-view" FieldOfViewOnly,
            text("the camera is calibrated by its field of view alone: angles near the image edge \
                  are rough, and a field of view wrong by a tenth shifts attenuation by 0.02 to \
                  0.03 per metre"),
            remedy("calibrate the camera in water and write fx, fy, cx, cy and the distortion \
                    under [camera] in a rig file");
        Info "calibration-scaled" CalibrationScaled {
            calibrated_px: [usize; 2],
            image_px: [usize; 2],
        },
            text("the calibration is for {}×{}, the images are {}×{}; it is scaled",
                 calibrated_px[0], calibrated_px[1], image_px[0], image_px[1]);
        Info "calibration-in-air" CalibratedInAir { focal_px: f64 },
            text("the calibration was made in air; behind a flat port in water the focal length \
                  is {focal_px:.1} px");
        Warning "images-already-processed" AlreadyProcessed,
            text("according to the topic name these images have been processed already"),
            remedy("correct the images as the camera wrote them; earlier colour balancing cannot \
                    be undone");
        Warning "depth-images-without-calibration" DepthWithoutCalibration,
            text("depth images without a calibration that fits them; they are not used"),
            remedy("record the camera_info of the depth camera too");
        Warning "exposure-setting-missing" SettingMissing { setting: String },
            text("the model compensates {setting} of this topic, which the log does not have: \
                  images may be too bright or too dark by a factor"),
            remedy("record the topic, or estimate a model from this log");
    }
}
