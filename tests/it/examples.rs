//! The numbered examples run as they are.

#[path = "../../examples/01_correct_log.rs"]
mod correct_log;
#[path = "../../examples/03_custom_model.rs"]
mod custom_model;
#[path = "../../examples/02_one_frame.rs"]
mod one_frame;

#[test]
fn a_log_is_corrected() {
    correct_log::main().unwrap();
}

/// The example compares the corrected frame with the reflectance that it rendered.
#[test]
fn one_frame_is_corrected_to_its_reflectance() {
    one_frame::main().unwrap();
}

#[test]
fn a_model_from_measurements_corrects_a_frame() {
    custom_model::main().unwrap();
}

/// What a model found of its camera counts without a log, too: vignetting, black level, and the
/// gain that its law gives to a frame of such brightness.
#[test]
fn a_frame_without_a_log_is_corrected_with_the_camera_of_its_model() {
    use unwater::model::{CameraFile, GainLawFile, VignettingFile};
    use unwater::{
        Camera, Config, Direction, EncodedImage, FrameCorrector, ModelFile, Removal, Rig,
        SeafloorPlane, Transform, View,
    };

    const REFLECTANCE: f64 = 0.25;
    let strobe = Transform::from_parts([-0.5, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]);
    let rig = Rig::of_camera_and_strobe(Camera::from_field_of_view(320, 240, 60.0), strobe);
    let plane = SeafloorPlane::at_altitude(&rig, Direction::boresight(), 2.0);
    let text = std::fs::read_to_string("examples/model.json").expect("the example's model");
    let mut file = ModelFile::from_json(&text).expect("a model");
    let mut model = file.imaging_model().expect("a beam pattern");
    model.beam_pattern = model.beam_pattern.refined(8);
    let vignetting = VignettingFile { coefficients: [-0.8, 0.2, 0.0], corner_loss: 0.3 };
    let (black_level, gain) = (0.01, 1.5);
    let view = View { camera: &rig.camera, rig: &rig, plane: &plane, terrain: None };
    let (mut pixels, mut mean) = (Vec::new(), [0.0; 3]);
    for (v, u) in (0..240).flat_map(|v| (0..320).map(move |u| (f64::from(v), f64::from(u)))) {
        let path = view.light_path(u, v).expect("seafloor");
        let (x, y) = rig.camera.image_plane(u, v).expect("a ray");
        let log_radiance = model.log_radiance(&path, Removal::FULL);
        for b in 0..3 {
            let light = REFLECTANCE / file.rendering.gain[b] * log_radiance[b].exp();
            let value = gain * light * vignetting.transmission(x, y) + black_level;
            mean[b] += value / (320.0 * 240.0);
            pixels.extend(((value * 65535.0).round() as u16).to_le_bytes());
        }
    }
    // κ = 1: the gain is what the mean reading is over its level.
    let log_level = mean.map(|m: f64| m.ln() - f64::ln(gain)).to_vec();
    file.camera = Some(CameraFile {
        vignetting: Some(vignetting),
        black_level: Some(vec![black_level; 3]),
        gain_law: Some(GainLawFile { exposure: 1.0, white_balance: 0.0, log_level }),
        ..CameraFile::default()
    });
    let image = EncodedImage::Raw {
        width: 320,
        height: 240,
        encoding: "rgb16",
        big_endian: false,
        step: 320 * 6,
        data: &pixels,
    };
    let error = |file: &ModelFile| {
        let mut config = Config::default();
        config.render.depth = 16;
        let corrector = FrameCorrector::from_file(file, rig.clone(), config).expect("a corrector");
        let corrected = corrector.correct(&image, &plane, None).expect("a corrected frame");
        let (values, _) = corrected.samples.as_chunks::<2>();
        let reflectance = values.iter().map(|v| f64::from(u16::from_ne_bytes(*v)) / 65535.0);
        reflectance.map(|r| (r / REFLECTANCE - 1.0).abs()).fold(0.0, f64::max)
    };
    // The mean reading is that of a part of the pixels.
    let with_camera = error(&file);
    assert!(with_camera < 0.01, "{with_camera}");
    file.camera = None;
    assert!(error(&file) > 0.2);
}
