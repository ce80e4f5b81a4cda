use super::*;
use crate::config::{RenderConfig, Spreading};
use crate::coordinates::{Direction, Transform};
use crate::correct::MeanFrames;
use crate::correct::gain_rows::GainRows;
use crate::correct::signal::FrameLight;
use crate::geometry::{SeafloorPlane, Support};
use crate::image::decode::{CameraResponse, Coding};
use crate::image::noise::Noise;
use crate::image::transfer::Transfer;
use crate::image::{Container, LinearImage, interleaved};
use crate::model::{
    BeamGrid, BeamPattern, ImageGrid, ImagingModel, RangeFactor, RegionLight, RenderingFile,
    SpreadingModel,
};
use crate::vehicle::{Camera, Lamps, Rig, StrobeMount};

fn model() -> ImagingModel {
    let nodes = BeamGrid::new(41, 70.0);
    let pattern: Vec<Option<f64>> = (0..41 * 41)
        .map(|i| Some(-4.0 * nodes.angle(i / 41).powi(2) - 2.5 * nodes.angle(i % 41).powi(2)))
        .collect();
    ImagingModel {
        bands: 3,
        attenuation_per_m: [0.5, 0.15, 0.1],
        spreading: SpreadingModel::of(Spreading::Strobe),
        incidence: true,
        beam_pattern: BeamPattern::from_nodes(nodes, &pattern).refined(8),
        over_time: Default::default(),
        backscatter: None,
        daylight: None,
        residual: None,
        empirical: None,
    }
}

fn noise() -> Noise {
    let coding = Coding {
        bits: 16,
        container: Container::Raw,
        transfer: Transfer::Linear,
        bits_used: 0xffff,
    };
    Noise::of(&coding, CameraResponse::default(), Default::default())
}

fn geometry(camera: Camera, pitch_deg: f64) -> (SeafloorPlane, Rig) {
    let (sin, cos) = pitch_deg.to_radians().sin_cos();
    let plane = SeafloorPlane {
        normal: Direction::from_vector(nalgebra::Vector3::new(0.1, sin, cos)).expect("a normal"),
        distance_m: 2.0,
        support: Support::LeastSquares,
        returns: 4,
        residual_m: 0.0,
        nearest_ping_s: 0.0,
    };
    let rig = Rig {
        camera,
        body_from_optical: Transform::identity(),
        body_from_dvl: Transform::identity(),
        strobe: StrobeMount {
            lamps: Lamps::one(Transform::from_parts([-0.8, 0.1, 0.1], [0.0, 0.17, 0.0, 0.985])),
            source: None,
        },
        camera_motion: None,
    };
    (plane, rig)
}

/// The interpolated gain against the exact formula, on a tilted seafloor, with part of the
/// image above the horizon.
#[test]
fn the_interpolated_field_agrees_with_the_exact_model() {
    let model = model();
    let config = RenderConfig::default();
    let rendering = RenderingFile {
        gain: vec![1.0; 3],
        median_correction: vec![1.0; 3],
        ..RenderingFile::default()
    };
    let correction = Correction {
        model: &model,
        rendering: &rendering,
        config: &config,
        backscatter: None,
        means: &MeanFrames::default(),
        clipped_above: 1.0,
        roughness: model.beam_pattern.roughness(0.05),
        electrons: Default::default(),
    };
    let noise = noise();
    for (times, pitch_deg) in [(1, 0.0), (1, 25.0), (1, 66.0), (4, 0.0), (4, 25.0f64)] {
        let (width, height) = (643 * times, 451 * times);
        let camera = Camera::from_field_of_view(width, height, 55.0);
        let (plane, rig) = geometry(camera, pitch_deg);
        let view = View { camera: &camera, rig: &rig, plane: &plane, terrain: None };
        let mut image = LinearImage::new(width, height, 3);
        // A frame that got more light than its neighbours comes out as they do.
        let frame_gain = 1.25;
        let range_factor = RangeFactor::default();
        let light = FrameLight { noise: &noise, gain: frame_gain, range_factor, map: None };
        image.pixels.fill(frame_gain as f32);
        let field = GainField::new(&correction, &view, (width, height), 3, light);
        let bits = field.marked(vec![0; width * height]);
        let mut rows = GainRows::new(&field, None, frame_gain);
        for (y, row) in image.pixels.chunks_exact_mut(3 * width).enumerate() {
            rows.go_to(y);
            // The same light in all bands: their order does not matter on the way in.
            rows.multiply(row);
            row.copy_from_slice(&interleaved(row, 3).collect::<Vec<_>>());
        }
        let (mut worst, mut off) = (0f64, 0);
        for y in (0..height).step_by(3 * times - 1) {
            for x in (0..width).step_by(3 * times - 1) {
                match view.light_path(x as f64, y as f64) {
                    Some(path) if path.length_m() < 30.0 => {
                        let exact = (-model.log_radiance(&path, Removal::FULL)[0]).exp();
                        worst = worst.max((f64::from(image.at(x, y)[0]) / exact - 1.0).abs());
                    }
                    Some(_) => {}
                    None => {
                        assert_eq!(image.at(x, y), [0.0; 3]);
                        assert_eq!(bits[y * width + x], mask::OFF_SURFACE);
                        off += 1;
                    }
                }
            }
        }
        assert!(worst < if pitch_deg < 60.0 { 1e-3 } else { 4e-3 }, "{worst} at {pitch_deg}°");
        assert!((off > 0) == (pitch_deg > 60.0), "{off} off the seafloor at {pitch_deg}°");
    }
}

/// What the model leaves of the light is divided out once, at its own place and slant range.
#[test]
fn residual_light_is_divided_out() {
    let residual = RegionLight {
        grid: ImageGrid { x: [-0.6, 0.6], y: [-0.4, 0.4], columns: 2, rows: 2 },
        reference_m: 2.0,
        range_m: [1.0, 4.0],
        log_level: vec![vec![-0.1, 0.3, -0.1, 0.3]; 3],
        slope_per_m: vec![vec![0.2; 4]; 3],
        exponent: vec![vec![0.5; 4]; 3],
    };
    let plain = model();
    let left = ImagingModel { residual: Some(std::sync::Arc::new(residual)), ..model() };
    let (config, means, noise) = (RenderConfig::default(), MeanFrames::default(), noise());
    let rendering = RenderingFile { gain: vec![1.0; 3], ..RenderingFile::default() };
    let (width, height) = (320, 240);
    let camera = Camera::from_field_of_view(width, height, 55.0);
    let (plane, rig) = geometry(camera, 20.0);
    let view = View { camera: &camera, rig: &rig, plane: &plane, terrain: None };
    let gain_of = |model: &ImagingModel, x: usize, y: usize| {
        let correction = Correction {
            model,
            rendering: &rendering,
            config: &config,
            backscatter: None,
            means: &means,
            clipped_above: 1.0,
            roughness: model.beam_pattern.roughness(0.05),
            electrons: Default::default(),
        };
        let light = FrameLight {
            noise: &noise,
            gain: 1.0,
            range_factor: RangeFactor::default(),
            map: None,
        };
        let field = GainField::new(&correction, &view, (width, height), 3, light);
        let mut image = LinearImage::new(width, height, 3);
        image.pixels.fill(1.0);
        let mut rows = GainRows::new(&field, None, 1.0);
        for (y, row) in image.pixels.chunks_exact_mut(3 * width).enumerate() {
            rows.go_to(y);
            rows.multiply(row);
            row.copy_from_slice(&interleaved(row, 3).collect::<Vec<_>>());
        }
        f64::from(image.at(x, y)[0])
    };
    for (x, y) in [(40, 200), (160, 120), (290, 60)] {
        let range_m = view.light_path(x as f64, y as f64).expect("seafloor").seafloor_to_camera_m;
        let (u, _) = camera.image_plane(x as f64, y as f64).expect("a ray");
        let level = 0.1 + 0.2 * u / 0.3;
        let expected = level - 0.2 * (range_m - 2.0) - 0.5 * (range_m / 2.0).ln();
        let factor = gain_of(&plain, x, y) / gain_of(&left, x, y);
        assert!((factor.ln() - expected).abs() < 2e-3, "{} {expected} at {x}, {y}", factor.ln());
    }
}
