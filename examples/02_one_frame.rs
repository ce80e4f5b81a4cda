//! Corrects one frame with a given model, without a log.
//!
//! The frame is a synthetic image of a grey seafloor, made by the same model, so that the corrected
//! image is the reflectance. `cargo run --release --example 02_one_frame`

use std::error::Error;
use std::path::Path;

use unwater::{
    Camera, Config, Direction, EncodedImage, FrameCorrector, ModelFile, Removal, Rig,
    SeafloorPlane, Transform, View,
};

const REFLECTANCE: f64 = 0.3;
/// Where the corrected image goes.
const FOLDER: &str = "target/examples/02_one_frame";

/// Corrects one frame.
pub fn main() -> Result<(), Box<dyn Error>> {
    // The strobe is 0.5 m to the left of the camera (x right, y down, z along the optical axis).
    let strobe = Transform::from_parts([-0.5, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]);
    let rig = Rig::of_camera_and_strobe(Camera::from_field_of_view(640, 480, 60.0), strobe);
    let plane = SeafloorPlane::at_altitude(&rig, Direction::boresight(), 2.0);
    let model = ModelFile::from_json(&std::fs::read_to_string("examples/model.json")?)?;

    let pixels = raw_pixels(&model, &rig, &plane)?;
    let image = EncodedImage::Raw {
        width: 640,
        height: 480,
        encoding: "rgb16",
        big_endian: false,
        step: 640 * 6,
        data: &pixels,
    };
    // Linear output with 16 bits: the pixel values are proportional to reflectance.
    let mut config = Config::default();
    config.render.depth = 16;
    let corrected =
        FrameCorrector::from_file(&model, rig, config)?.correct(&image, &plane, None)?;

    let (values, _) = corrected.samples.as_chunks::<2>();
    let reflectances = values.iter().map(|v| f64::from(u16::from_ne_bytes(*v)) / 65535.0);
    let error = reflectances.map(|r| (r / REFLECTANCE - 1.0).abs()).fold(0.0, f64::max);
    println!("mean light path {:.2} m", corrected.facts.path_length_mean_m);
    println!("largest error of the reflectance {:.2} %", 100.0 * error);
    std::fs::create_dir_all(FOLDER)?;
    std::fs::write(Path::new(FOLDER).join("corrected.png"), corrected.to_png()?)?;
    assert!(error < 0.002, "the corrected image is not the reflectance");
    Ok(())
}

/// A frame as the camera would record it: pixel values of 16 bits, linear.
fn raw_pixels(file: &ModelFile, rig: &Rig, plane: &SeafloorPlane) -> Result<Vec<u8>, String> {
    let mut model = file.imaging_model()?;
    model.beam_pattern = model.beam_pattern.refined(8); // smooth between its nodes
    let view = View { camera: &rig.camera, rig, plane, terrain: None };
    let mut pixels = Vec::new();
    for (v, u) in (0..480).flat_map(|v| (0..640).map(move |u| (v, u))) {
        let path = view.light_path(f64::from(u), f64::from(v)).ok_or("no seafloor")?;
        for (log, gain) in model.log_radiance(&path, Removal::FULL).iter().zip(&file.rendering.gain)
        {
            let light = REFLECTANCE / gain * log.exp();
            pixels.extend(((light * 65535.0).round() as u16).to_le_bytes());
        }
    }
    Ok(pixels)
}
