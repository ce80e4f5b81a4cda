//! Topics of the attenuation: coefficients with their standard deviations, and their plot.

use super::super::camera_output::CameraOutput;
use super::topic::OutputTopic;
use crate::messages::output;
use crate::model::AttenuationKind;
use crate::units::Stamp;

pub const ATTENUATION: OutputTopic = OutputTopic {
    rank: 3,
    name: |camera| Some(camera.own_topic("attenuation")),
    message_type: |_| output::ATTENUATION,
    write: |frame, put| {
        let (alpha, std) = attenuation_at(frame.camera, frame.output.stamp());
        let file = &frame.camera.model.file;
        let message = output::with_header(frame.camera.wire, &frame.output.header)
            .f64_array(&padded(&alpha))
            .f64_array(&padded(&std))
            .u8(u8::from(file.attenuation_kind == AttenuationKind::Physical))
            .u8(u8::from(file.identified));
        put(&message.finish());
    },
};

pub const PLOT: OutputTopic = OutputTopic {
    rank: 14,
    name: |camera| Some(camera.own_topic("plot/attenuation_per_m")),
    message_type: |_| output::MULTI_ARRAY,
    write: |frame, put| {
        let (alpha, _) = attenuation_at(frame.camera, frame.output.stamp());
        put(&output::multi_array(frame.camera.wire, "red_green_blue", &alpha));
    },
};

/// α and its standard deviation at a time, per band (1/m); NaN where unknown.
fn attenuation_at(camera: &CameraOutput<'_>, stamp: Stamp) -> (Vec<f64>, Vec<f64>) {
    let (model, file) = (&camera.model.prepared.model, &camera.model.file);
    if !file.has_attenuation() {
        return (vec![f64::NAN; model.bands], vec![f64::NAN; model.bands]);
    }
    match (model.over_time.at(stamp), model.over_time.std_at(stamp)) {
        (Some(alpha), Some(std)) => (alpha[..model.bands].to_vec(), std[..model.bands].to_vec()),
        _ => (
            file.attenuation_per_m.clone(),
            file.attenuation_std_per_m.iter().map(|s| s.unwrap_or(f64::NAN)).collect(),
        ),
    }
}

fn padded(values: &[f64]) -> [f64; 3] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(f64::NAN))
}
