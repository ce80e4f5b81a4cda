//! The messages that go with every frame: corrected picture, parameters, plots, and at the first
//! frame what the run found.

use super::tally::Tally;
use super::{Added, Done, OfCamera};
use crate::coordinates::{Direction, Optical};
use crate::correct::FrameFacts;
use crate::diagnostics::{Severity, Uncorrected};
use crate::messages::Header;
use crate::messages::output::{self, LogLine};
use crate::model::{AttenuationKind, LightSettingFile};
use crate::recording::{NewChannel, Output};
use crate::units::Stamp;

impl OfCamera<'_> {
    /// Writes all that belongs to a frame; the number of messages.
    pub(super) fn write_frame(
        &self,
        out: &mut Output,
        added: &Added,
        done: &Done,
        is_first: bool,
        tally: &Tally,
    ) -> u64 {
        let (log_time, publish_time) = (done.message.log_time, done.message.publish_time);
        let mut count = 0;
        let mut put = |out: &mut Output, channel: NewChannel, data: &[u8]| {
            count += 1;
            out.write(channel, log_time, publish_time, data);
        };
        let stamp = done.header.stamp.unwrap_or(done.message.log_stamp());
        if is_first {
            for line in self.opening_lines() {
                put(out, added.log, &output::log(self.wire, stamp, &line));
            }
            put(out, added.beam_pattern, &self.beam_pattern_message(&done.header));
            let picture = super::super::beam_picture::png(&self.model.beam_pattern);
            put(
                out,
                added.beam_picture,
                &output::compressed_image(self.wire, &done.header, "png", &picture),
            );
        }
        if let (Some(channel), Some(preview)) = (added.raw_preview, &done.preview) {
            put(out, channel, preview);
        }
        if let Ok(shown) = &done.result {
            put(out, added.corrected, &shown.picture);
            if let (Some(channel), Some(cloud)) = (added.cloud, &shown.cloud) {
                put(out, channel, cloud);
            }
            if let (Some(channel), Some(mask)) = (added.mask, &shown.mask) {
                put(out, channel, mask);
            }
            if let Some(channel) = added.camera_info {
                put(
                    out,
                    channel,
                    &output::camera_info(
                        self.wire,
                        &done.header,
                        &self.survey.rig.camera.rectified(),
                    ),
                );
            }
        }
        put(out, added.strobe, &self.strobe_pose(&done.header));
        let (alpha, std) = self.attenuation_at(stamp);
        let attenuation = output::with_header(self.wire, &done.header)
            .f64_array(&padded(&alpha))
            .f64_array(&padded(&std));
        put(
            out,
            added.attenuation,
            &attenuation
                .u8(u8::from(self.file.attenuation_kind == AttenuationKind::Physical))
                .u8(u8::from(self.file.identified))
                .finish(),
        );
        put(out, added.plot_attenuation, &output::multi_array(self.wire, "red_green_blue", &alpha));
        if let Some(plane) = &done.plane {
            let rig = &self.survey.rig;
            let normal = (rig.body_from_optical.inverse() * plane.normal).vector();
            let altitude = plane.camera_altitude_m(rig);
            let tilt = normal
                .dot(&Direction::<Optical>::boresight().vector())
                .clamp(-1.0, 1.0)
                .acos()
                .to_degrees();
            let seafloor = output::with_header(self.wire, &done.header)
                .f64s(&[normal.x, normal.y, normal.z, altitude, altitude, tilt])
                .u32(plane.returns as u32)
                .f64s(&[plane.residual_m, plane.nearest_ping_s])
                .text(plane.support.word());
            put(out, added.seafloor, &seafloor.finish());
            put(out, added.transform, &self.seafloor_transform(&done.header, plane));
            put(out, added.strobe_beam, &self.strobe_beam(&done.header, plane));
            put(
                out,
                added.plot_altitude,
                &output::multi_array(self.wire, "camera_altitude_m", &[altitude]),
            );
            put(
                out,
                added.plot_residual,
                &output::multi_array(self.wire, "seafloor_residual_m", &[plane.residual_m]),
            );
        }
        let (corrected, reason, facts) = match &done.result {
            Ok(shown) => (true, String::new(), shown.facts),
            Err(reason) => (false, reason.to_string(), UNKNOWN),
        };
        let frame = output::with_header(self.wire, &done.header)
            .u8(u8::from(corrected))
            .text(&reason)
            .f64s(&[
                facts.camera_altitude_m,
                facts.path_length_min_m,
                facts.path_length_mean_m,
                facts.path_length_max_m,
                facts.clipped_input_share,
                facts.clipped_output_share,
                facts.gain_capped_share,
                facts.off_surface_share,
                facts.unseen_beam_share,
                facts.mean_gain,
                facts.low_signal_share,
            ]);
        put(out, added.frame, &frame.finish());
        if let Err(reason) = &done.result
            && tally.frames_of(reason) == 1
        {
            let first = Uncorrected { frames: 1, reason: reason.clone() };
            put(out, added.log, &output::log(self.wire, stamp, &LogLine::of(&first.into())));
        }
        count
    }

    /// α and its standard deviation at a time [1/m]; NaN where it is not known.
    fn attenuation_at(&self, stamp: Stamp) -> (Vec<f64>, Vec<f64>) {
        let bands = self.model.bands;
        match (self.model.over_time.at(stamp), self.model.over_time.std_at(stamp)) {
            (Some(alpha), Some(std)) => (alpha[..bands].to_vec(), std[..bands].to_vec()),
            _ => (
                self.file.attenuation_per_m.clone(),
                self.file.attenuation_std_per_m.iter().map(|s| s.unwrap_or(f64::NAN)).collect(),
            ),
        }
    }

    fn opening_lines(&self) -> Vec<LogLine> {
        let mut lines = vec![LogLine::info(format!(
            "{} attenuation {} per metre, by the {} estimator",
            self.file.attenuation_kind.word(),
            self.file.attenuation_text(),
            self.file.estimator.word()
        ))];
        let diagnostics = [self.model_diagnostics, &self.survey.diagnostics].concat();
        let of = |severity: Severity| {
            let of_severity = diagnostics.iter().filter(move |d| d.severity() == severity);
            of_severity.map(LogLine::of)
        };
        lines.extend(of(Severity::Warning));
        let followed = |s: &LightSettingFile| {
            let law = s.law.word();
            LogLine::info(format!("{} ({}): image brightness follows it as {law}", s.topic, s.name))
        };
        lines.extend(self.file.light_settings.iter().map(followed));
        lines.extend(of(Severity::Info));
        lines
    }

    fn beam_pattern_message(&self, header: &Header) -> Vec<u8> {
        let beam = &self.model.beam_pattern;
        let nodes = beam.nodes();
        let angles: Vec<f64> = (0..nodes.count).map(|i| nodes.angle(i).to_degrees()).collect();
        let log_gain: Vec<f64> =
            beam.by_node().into_iter().map(|v| v.unwrap_or(f64::NAN)).collect();
        output::with_header(self.wire, header)
            .f64_sequence(&angles)
            .f64_sequence(&angles)
            .f64_sequence(&log_gain)
            .finish()
    }
}

const UNKNOWN: FrameFacts = FrameFacts {
    camera_altitude_m: f64::NAN,
    path_length_min_m: f64::NAN,
    path_length_mean_m: f64::NAN,
    path_length_max_m: f64::NAN,
    clipped_input_share: f64::NAN,
    clipped_output_share: f64::NAN,
    gain_capped_share: f64::NAN,
    off_surface_share: f64::NAN,
    unseen_beam_share: f64::NAN,
    mean_gain: f64::NAN,
    low_signal_share: f64::NAN,
};

fn padded(values: &[f64]) -> [f64; 3] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(f64::NAN))
}
