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
