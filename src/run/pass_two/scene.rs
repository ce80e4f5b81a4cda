//! What a frame adds for the eye: the seafloor and the strobe in the viewers' 3-D panels, and the
//! raw picture where the viewers cannot draw it as it was recorded.

use nalgebra::{Isometry3, Point3, Rotation3, UnitQuaternion, Vector3};

use crate::geometry::{MIN_COS_INCIDENCE, SeafloorPlane, View};
use crate::image::decode::PixelValues;
use crate::image::encode;
use crate::image::reduce::downscale;
use crate::image::transfer::SrgbTable;
use crate::messages::Header;
use crate::messages::output::{self, ScenePoint};

use super::OfCamera;

/// Pictures that both viewers draw in their colours, by the first word of their description.
const DRAWN: [&str; 10] = [
    "jpeg",
    "png",
    "rgb8",
    "bgr8",
    "8UC3",
    "yuyv",
    "bayer_rggb8",
    "bayer_bggr8",
    "bayer_gbrg8",
    "bayer_grbg8",
];

/// JPEG quality of the raw pictures for the eye, at most: their noise costs more than it tells.
const PREVIEW_QUALITY: u8 = 80;

/// Steps along a beam's axis.
const BEAM_STEPS: u32 = 48;

/// A corrected picture's samples as they go out, seen as 8-bit sRGB.
pub struct Shown8<'s> {
    /// `height × width × bands` codes of 8 bits, or linear ones of 16, in the machine's order
    pub samples: &'s [u8],
    /// [px]
    pub width: usize,
    /// [px]
    pub height: usize,
    /// 1 or 3
    pub bands: usize,
    /// 8 or 16
    pub depth: u8,
    /// light to codes
    pub srgb: &'s SrgbTable,
}

impl Shown8<'_> {
    fn at(&self, x: usize, y: usize) -> [u8; 3] {
        std::array::from_fn(|band| {
            let index = (y * self.width + x) * self.bands + band.min(self.bands - 1);
            match self.depth {
                16 => self.srgb.encode(
                    f32::from(u16::from_ne_bytes([
                        self.samples[2 * index],
                        self.samples[2 * index + 1],
                    ])) / 65535.0,
                ),
                _ => self.samples[index],
            }
        })
    }
}

impl OfCamera<'_> {
    /// Whether the raw pictures need another one beside them to be looked at.
    pub(super) fn needs_preview(&self) -> bool {
        let channels =
            self.survey.camera_channels.iter().filter_map(|id| self.scan.channels.get(id));
        let is_drawn = channels
            .map(|c| c.description.split(' ').next().unwrap_or(""))
            .all(|word| DRAWN.contains(&word));
        let is_wanted = self.config.output.raw_preview_side_px > 0 && !self.config.output.drop_raw;
        is_wanted && (!is_drawn || self.survey.white_level.is_some())
    }

    /// The raw picture as an 8-bit JPEG, under one exposure for all bands and the whole log: the
    /// one that brings the band that reaches farthest to where it stands in the corrected pictures.
    pub(super) fn preview(
        &self,
        header: &Header,
        raw: &PixelValues<'_>,
        srgb: &SrgbTable,
    ) -> Result<Vec<u8>, String> {
        let small = downscale(raw, self.config.output.raw_preview_side_px);
        let rendering = &self.file.rendering;
        let exposure = rendering
            .gain
            .iter()
            .zip(&rendering.median_correction)
            .map(|(g, c)| g * c)
            .fold(f64::INFINITY, f64::min);
        let exposure = if exposure.is_finite() { exposure as f32 } else { 1.0 };
        let samples: Vec<u8> = small.pixels.iter().map(|v| srgb.encode(v * exposure)).collect();
        let jpeg = encode::jpeg(
            &samples,
            small.shape(),
            self.config.render.jpeg_quality.min(PREVIEW_QUALITY),
            true,
        )?;
        Ok(output::compressed_image(self.wire, header, "jpeg", &jpeg))
    }

    /// The corrected picture laid on the seafloor as it was taken to lie, in the camera's optical
    /// frame.
    pub(super) fn seafloor_cloud(
        &self,
        header: &Header,
        image: &Shown8<'_>,
        view: &View<'_>,
    ) -> Vec<u8> {
        let across = self.config.output.seafloor_points_across.min(image.width).max(1);
        let step = image.width as f64 / across as f64;
        let down = (image.height as f64 / step).round().max(1.0) as usize;
        let optical_from_body = view.rig.body_from_optical.inverse();
        let middle = |i: usize| (i as f64 + 0.5) * step - 0.5;
        let points: Vec<ScenePoint> = (0..down * across)
            .filter_map(|i| {
                let (u, v) = (middle(i % across), middle(i / across));
                let hit = (optical_from_body * view.seafloor_point(u, v)?.position).vector();
                let rgb = image.at(
                    (u.round() as usize).min(image.width - 1),
                    (v.round() as usize).min(image.height - 1),
                );
                Some(ScenePoint { position_m: [hit.x as f32, hit.y as f32, hit.z as f32], rgb })
            })
            .collect();
        output::point_cloud(self.wire, header, &points)
    }

    /// Where the strobe sits and where it looks (z along its beam), in the camera's optical frame;
    /// of several, the first.
    pub(super) fn strobe_pose(&self, header: &Header) -> Vec<u8> {
        let rig = &self.survey.rig;
        let optical_from_strobe =
            rig.body_from_optical.inverse() * rig.strobe.lamps.body_from_strobe();
        output::pose(self.wire, header, &optical_from_strobe.isometry())
    }

    /// Where the seafloor's frame lies: on the plane below the camera, z up, x to the right of the
    /// pictures.
    pub(super) fn seafloor_transform(&self, header: &Header, plane: &SeafloorPlane) -> Vec<u8> {
        let rig = &self.survey.rig;
        let normal = (rig.body_from_optical.inverse() * plane.normal).vector();
        let altitude = plane.camera_altitude_m(rig);
        // z up, and x as near to the pictures' right as lies in the plane.
        let right = if normal.x.abs() < 0.99 { Vector3::x() } else { Vector3::y() };
        let y = (-normal).cross(&right);
        let turn = Rotation3::from_basis_unchecked(&[
            y.cross(&-normal).normalize(),
            y.normalize(),
            -normal,
        ]);
        let pose = Isometry3::from_parts(
            (normal * altitude).into(),
            UnitQuaternion::from_rotation_matrix(&turn),
        );
        output::transform(self.wire, header, &self.seafloor_frame(), &pose)
    }

    /// The name of the seafloor's frame.
    fn seafloor_frame(&self) -> String {
        format!("unwater{}/seafloor", self.place)
    }

    /// The axis of every lamp's beam from the lamp to the seafloor, in the camera's optical frame:
    /// a pose alone is not drawn by all viewers.
    pub(super) fn strobe_beam(&self, header: &Header, plane: &SeafloorPlane) -> Vec<u8> {
        let rig = &self.survey.rig;
        let optical_from_body = rig.body_from_optical.inverse().isometry();
        let mut points = Vec::new();
        for (pose, _) in rig.strobe.lamps.poses() {
            let (from, along) = (pose.translation.vector, pose.rotation * Vector3::z());
            let towards = plane.normal.vector().dot(&along);
            let reach_m = (plane.distance_m - plane.normal.vector().dot(&from)) / towards;
            // A lamp that looks along the floor, or away from it, is drawn this long [m].
            let reach_m = if towards > MIN_COS_INCIDENCE && reach_m > 0.0 { reach_m } else { 1.0 };
            points.extend((0..=BEAM_STEPS).map(|i| {
                let at = optical_from_body
                    * Point3::from(from + along * (reach_m * f64::from(i) / f64::from(BEAM_STEPS)));
                ScenePoint {
                    position_m: [at.x as f32, at.y as f32, at.z as f32],
                    rgb: [255, 214, 64],
                }
            }));
        }
        output::point_cloud(self.wire, header, &points)
    }
}
