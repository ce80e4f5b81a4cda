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
        Info "camera-info-used" InfoUsed { because: String },
            text("this calibration is used: {because}");
        Info "camera-info-of-another-camera" InfoOfAnotherCamera { frame: String },
            text("this calibration is of another camera (frame {frame:?})");
        Warning "camera-info-uncalibrated" Uncalibrated,
            text("this camera_info is of an uncalibrated camera: its K is zero"),
            remedy("calibrate the camera in water, or name another camera_info under \
                    camera.camera_info in a rig file");
        Warning "camera-info-of-other-size" OtherSize {
            calibrated_px: [usize; 2],
            image_px: [usize; 2],
        },
            text("this calibration is for {}×{}, the images are {}×{}, of another shape: they may \
                  be a crop or binned along one side", calibrated_px[0], calibrated_px[1],
                 image_px[0], image_px[1]),
            remedy("write the calibration of the images as recorded under [camera] in a rig file");
        Info "camera-info-without-size" SizeAssumed { image_px: [usize; 2] },
            text("this calibration states no image size; that of the images, {}×{}, is assumed",
                 image_px[0], image_px[1]);
        Warning "camera-info-impossible" ImpossibleIntrinsics {
            focal_px: [f64; 2],
            center_px: [f64; 2],
            image_px: [usize; 2],
        },
            text("no camera has focal lengths of {:.4} and {:.4} px and a principal point at \
                  {:.1}, {:.1} px in an image of {}×{}", focal_px[0], focal_px[1], center_px[0],
                 center_px[1], image_px[0], image_px[1]),
            remedy("write the calibration under [camera] in a rig file");
        Warning "camera-info-unknown-distortion" UnknownDistortion { model: String },
            text("its distortion model {model:?} is not one of plumb_bob, rational_polynomial, \
                  equidistant, fisheye62, or its coefficients are no numbers"),
            remedy("write the calibration under [camera] in a rig file");
        Info "frame-of-camera-info" FrameOfInfo { frame: String },
            text("the images name no frame; that of their calibration, {frame:?}, is used");
        Info "images-rectified" Rectified,
            text("the images are rectified: P of this calibration is used, and no distortion");
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
