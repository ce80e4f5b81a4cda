//! Corrects a frame with a model from measurements instead of a log: attenuation from a
//! transmissometer, the beam pattern from a data sheet.
//!
//! `cargo run --release --example 03_custom_model`

use std::error::Error;
use std::path::Path;

use unwater::{
    AttenuationOverTime, BeamGrid, BeamPattern, Camera, CameraResponse, Config, Direction,
    EncodedImage, FrameCorrector, ImagingModel, Rig, SeafloorPlane, Spreading, SpreadingModel,
    Transform, View, decode, estimate_rendering,
};

/// Where the corrected image goes.
const FOLDER: &str = "target/examples/03_custom_model";
/// Full width of the beam at half the maximum (rad).
const BEAM_WIDTH_RAD: f64 = 1.4;

/// Corrects a frame.
pub fn main() -> Result<(), Box<dyn Error>> {
    let model = ImagingModel {
        bands: 3,
        attenuation_per_m: [0.45, 0.14, 0.10], // red, green, blue
        over_time: AttenuationOverTime::default(),
        spreading: SpreadingModel::of(Spreading::Strobe),
        incidence: true,
        beam_pattern: beam_pattern(),
        backscatter: None,
        daylight: None,
        residual: None,
        empirical: None,
    };
    let strobe = Transform::from_parts([-0.5, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]);
    let rig = Rig::of_camera_and_strobe(Camera::from_field_of_view(640, 480, 60.0), strobe);
    let plane = SeafloorPlane::at_altitude(&rig, Direction::boresight(), 2.0);
    let data = [15, 60, 60].repeat(640 * 480); // what the camera recorded: red is weak
    let (encoding, big_endian) = ("rgb8", false);
    let image = EncodedImage::Raw {
        width: 640,
        height: 480,
        encoding,
        big_endian,
        step: 1920,
        data: &data,
    };

    // Exposure and white balance come from samples: log light and light path, best of many frames.
    let light = decode(&image, CameraResponse::default())?.image.into_demosaiced();
    let view = View { camera: &rig.camera, rig: &rig, plane: &plane, terrain: None };
    let grid = (0..480).step_by(16).flat_map(|y| (0..640).step_by(16).map(move |x| (x, y)));
    let sample = |(x, y): (usize, usize)| {
        let bands = light.at(x, y);
        Some(([0, 1, 2].map(|b| bands[b].ln()), view.light_path(x as f64, y as f64)?))
    };
    let samples: Vec<_> = grid.filter_map(sample).collect();
    let config = Config::default();
    let exposure = estimate_rendering(&samples, &model, None, &config.render);
    println!("gain per band {:.3?}", exposure.gain);

    let corrector = FrameCorrector::new(model, exposure, rig, config)?;
    let corrected = corrector.correct(&image, &plane, None)?;
    println!("mean gain {:.1}", corrected.facts.mean_gain);
    std::fs::create_dir_all(FOLDER)?;
    std::fs::write(Path::new(FOLDER).join("corrected.png"), corrected.to_png()?)?;
    Ok(())
}

/// A Gaussian beam on a grid of ±60°.
fn beam_pattern() -> BeamPattern {
    let grid = BeamGrid::new(25, 60.0);
    let log_gain = |theta: f64, phi: f64| {
        -4.0 * std::f64::consts::LN_2 * (theta * theta + phi * phi) / BEAM_WIDTH_RAD.powi(2)
    };
    let nodes = (0..grid.count).flat_map(|i| (0..grid.count).map(move |j| (i, j)));
    let values = nodes.map(|(i, j)| Some(log_gain(grid.angle(i), grid.angle(j))));
    BeamPattern::from_nodes(grid, &values.collect::<Vec<_>>())
}
