//! A camera's calibration as its `camera_info` states it, and the camera of its images by it.

use super::{Camera, Distortion};
use crate::diagnostics::CameraFact;

/// Focal lengths of real lenses along x and y differ by less than this factor.
const MAX_ASPECT: f64 = 1.25;
/// Focal lengths of cameras, over the image width: below the lower one even a fisheye does not map
/// its whole hemisphere, above the upper one the field of view is below 5°.
const FOCAL_PER_WIDTH: std::ops::RangeInclusive<f64> = 0.15..=12.0;

/// Focal lengths and principal point (px).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Intrinsics {
    /// focal length along x
    pub fx: f64,
    /// focal length along y
    pub fy: f64,
    /// principal point
    pub cx: f64,
    /// principal point
    pub cy: f64,
}

impl Intrinsics {
    fn is_given(&self) -> bool {
        self.fx > 0.0 && self.fy > 0.0 && [self.fx, self.fy].iter().all(|f| f.is_finite())
    }
}

/// The content of a `camera_info`.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraInfo {
    /// width and height of the full sensor (px); 0 where not stated
    pub size: (usize, usize),
    /// of the images as recorded; all 0 for an uncalibrated camera
    pub recorded: Intrinsics,
    /// of rectified images; all 0 where not stated
    pub rectified: Intrinsics,
    /// name of the distortion model
    pub model: String,
    /// its coefficients
    pub coefficients: Vec<f64>,
    /// upper left corner of the region of interest (px of the full sensor)
    pub offset: (usize, usize),
    /// size of the region of interest (px); 0 for all
    pub roi: (usize, usize),
    /// pixels of the full sensor per pixel of the images; 0 means 1
    pub binning: (usize, usize),
}

impl CameraInfo {
    /// Whether any focal length is stated.
    pub fn is_calibrated(&self) -> bool {
        self.recorded.is_given() || self.rectified.is_given()
    }

    /// The camera of images of this size, and what was assumed for it.
    ///
    /// # Errors
    /// Why the calibration cannot be used for them.
    pub fn camera(
        &self,
        image: Option<(usize, usize)>,
        is_rectified: bool,
    ) -> Result<(Camera, Option<CameraFact>), CameraFact> {
        let projected = self.rectified.is_given();
        let intrinsics = if is_rectified && projected { self.rectified } else { self.recorded };
        if !intrinsics.is_given() {
            return Err(CameraFact::Uncalibrated);
        }
        let distortion = if is_rectified {
            Distortion::None
        } else {
            Distortion::named(&self.model, &self.coefficients)
                .map_err(|model| CameraFact::UnknownDistortion { model })?
        };
        let is_sized = self.size.0 > 0 && self.size.1 > 0;
        let size = if is_sized { Some(self.size) } else { image };
        let (width, height) = size.ok_or(CameraFact::Uncalibrated)?;
        let Intrinsics { fx, fy, cx, cy } = intrinsics;
        let full = Camera { width, height, fx, fy, cx, cy, distortion };
        ensure_possible(&full)?;
        let is_finite = distortion.coefficients().iter().all(|c| c.is_finite());
        if !is_finite {
            return Err(CameraFact::UnknownDistortion { model: self.model.clone() });
        }
        let calibration = Calibration::new(full, self.offset, self.roi, self.binning);
        let camera = calibration.for_image_size(image).ok_or_else(|| {
            let (w, h) = image.unwrap_or_default();
            CameraFact::OtherSize { calibrated_px: [width, height], image_px: [w, h] }
        })?;
        let assumed = if is_rectified {
            Some(CameraFact::Rectified)
        } else {
            (!is_sized).then_some(CameraFact::SizeAssumed { image_px: [width, height] })
        };
        Ok((camera, assumed))
    }
}

/// Focal lengths and principal point that a camera of this image size can have.
fn ensure_possible(camera: &Camera) -> Result<(), CameraFact> {
    let Camera { width, height, fx, fy, cx, cy, .. } = *camera;
    let is_inside = |center: f64, size: usize| (0.0..=size as f64).contains(&center);
    let is_possible = (MAX_ASPECT.recip()..=MAX_ASPECT).contains(&(fx / fy))
        && FOCAL_PER_WIDTH.contains(&(fx / width as f64))
        && is_inside(cx, width)
        && is_inside(cy, height);
    if is_possible {
        return Ok(());
    }
    let image_px = [width, height];
    Err(CameraFact::ImpossibleIntrinsics { focal_px: [fx, fy], center_px: [cx, cy], image_px })
}

/// A calibration as in `CameraInfo`: of the full sensor, and of the images after region of interest
/// and binning.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Calibration {
    /// full sensor
    full: Camera,
    /// after region of interest and binning
    cropped: Camera,
}

impl Calibration {
    /// Applies a region of interest (offset and size in pixels of the full sensor; size 0 for all
    /// of it), then binning.
    fn new(
        full: Camera,
        offset: (usize, usize),
        size: (usize, usize),
        binning: (usize, usize),
    ) -> Self {
        let or = |size: usize, all: usize| if size == 0 { all } else { size };
        let (width, height) = (or(size.0, full.width), or(size.1, full.height));
        let (bx, by) = (binning.0.max(1), binning.1.max(1));
        let inside = offset.0.saturating_add(width) <= full.width
            && offset.1.saturating_add(height) <= full.height;
        if !inside || width < bx || height < by {
            return Self { full, cropped: full };
        }
        let centre =
            |c: f64, offset: usize, bin: usize| (c + 0.5 - offset as f64) / bin as f64 - 0.5;
        let cropped = Camera {
            width: width / bx,
            height: height / by,
            fx: full.fx / bx as f64,
            fy: full.fy / by as f64,
            cx: centre(full.cx, offset.0, bx),
            cy: centre(full.cy, offset.1, by),
            distortion: full.distortion,
        };
        Self { full, cropped }
    }

    /// The calibration for images of this size; `None` where the aspect ratio differs. Some drivers
    /// announce binning or cropping and do not apply it; the image size decides.
    fn for_image_size(&self, image: Option<(usize, usize)>) -> Option<Camera> {
        let Some((width, height)) = image else { return Some(self.cropped) };
        let of_size =
            [self.cropped, self.full].into_iter().find(|c| (c.width, c.height) == (width, height));
        of_size.or_else(|| {
            [self.cropped, self.full].into_iter().find(|c| c.scaled_to(width, height).is_some())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binning_and_region_of_interest() {
        let full = Camera::from_field_of_view(1920, 1200, 60.0);
        let calibration = Calibration::new(full, (320, 200), (1280, 800), (2, 2));
        let half = calibration.cropped;
        assert_eq!((half.width, half.height), (640, 400));
        // The same position on the sensor, the middle of four pixels, by both calibrations.
        let (a, b) = (full.ray(320.0 + 100.5, 200.0 + 60.5), half.ray(50.0, 30.0));
        assert!((a.expect("a ray").vector() - b.expect("a ray").vector()).norm() < 1e-12);
        assert_eq!(
            calibration.for_image_size(Some((1920, 1200))),
            Some(full),
            "a driver that does not crop after all"
        );
        assert_eq!(calibration.for_image_size(Some((640, 640))), None);
    }

    fn info(size: (usize, usize), fx: f64) -> CameraInfo {
        let recorded = Intrinsics { fx, fy: fx.abs(), cx: 79.5, cy: 59.5 };
        CameraInfo {
            size,
            recorded,
            rectified: Intrinsics { fx: 170.0, fy: 170.0, ..recorded },
            model: "plumb_bob".into(),
            coefficients: vec![0.28, 0.15, 0.0, 0.0, 0.0],
            offset: (0, 0),
            roi: (0, 0),
            binning: (0, 0),
        }
    }

    #[test]
    fn what_a_camera_info_does_not_state_is_assumed_or_refused_by_name() {
        let image = Some((160, 120));
        let code = |info: &CameraInfo, image| match info.camera(image, false) {
            Ok((_, fact)) => fact.map_or("", |fact| fact.code()),
            Err(fact) => fact.code(),
        };
        assert_eq!(code(&info((160, 120), 190.0), image), "");
        assert_eq!(code(&info((0, 0), 190.0), image), "camera-info-without-size");
        assert_eq!(code(&info((0, 0), 190.0), None), "camera-info-uncalibrated");
        assert_eq!(code(&info((160, 120), 0.0), image), "camera-info-uncalibrated");
        assert_eq!(code(&info((160, 120), 190.0), Some((160, 160))), "camera-info-of-other-size");
        assert_eq!(code(&info((160, 120), 1.2), image), "camera-info-impossible");
        let mut stretched = info((160, 120), 190.0);
        stretched.recorded.fy = 95.0;
        assert_eq!(code(&stretched, image), "camera-info-impossible");
    }

    #[test]
    fn rectified_images_have_the_projection_and_no_distortion() {
        let camera = info((160, 120), 190.0).camera(Some((160, 120)), true).expect("a camera").0;
        assert_eq!((camera.fx, camera.distortion), (170.0, Distortion::None));
        let mut unprojected = info((160, 120), 190.0);
        unprojected.rectified = Intrinsics::default();
        let camera = unprojected.camera(Some((160, 120)), true).expect("a camera").0;
        assert_eq!((camera.fx, camera.distortion), (190.0, Distortion::None));
    }
}
