//! Pass one: what the model rests on and what the log does not determine.

use super::facts;

/// What helps where altitude does not vary.
const OTHER_MODEL: &str = "a segment of the dive where altitude changes by 15 % or more determines \
                           attenuation; use its model here: unwater correct --model MODEL.json";

facts! {
    /// Facts about a model.
    EstimateFact {
        Warning "estimation-options-ignored" OptionsIgnored,
            text("estimation options are ignored with --model"),
            remedy("leave them out, or estimate again without --model");
        Info "camera-found" CameraFound { summary: String },
            text("the log shows of its camera: {summary}; it is compensated");
        Info "camera-reported" CameraReported { summary: String },
            text("the log shows of its camera: {summary}; it is not compensated");
        Info "beam-from" BeamFrom { logs: String },
            text("beam pattern, strobe position, transfer curve and vignetting are those of a \
                  model of {logs}; only attenuation is estimated");
        Warning "backscatter-of-other-water" BackscatterOfOtherWater,
            text("the water of the model given scatters; backscatter of this dive is not modelled"),
            remedy("estimate all of it, without --beam-from");
        Warning "strobe-drop-outs" DropOuts { frames: usize },
            text("{frames} frames are lit differently from their neighbours (strobe drop-outs); \
                  they are compensated"),
            remedy("nothing has to be done; check the charging or the trigger of the strobe");
        Info "frames-without-strobe" UnlitFrames { frames: usize, of: usize, ratio: f64 },
            text("{frames} of {of} frames were taken without the strobe, or by another lamp: they \
                  take turns with others, {ratio:.1} times as bright, and do not show the pattern \
                  of their light; they are left out of the estimate and stay as they are");
        Info "drop-outs-of-other-logs" GainsOfOtherLogs { frames: usize },
            text("drop-outs of {frames} frames in the model are of other logs and not used"),
            remedy("strobe drop-outs of this log are compensated by a model estimated from it");
        Info "residual-light" ResidualLight,
            text("frames are corrected for light that attenuation and beam pattern leave, too: by \
                  place in the image and slant range");
        Info "empirical-correction" Empirical { form: String },
            text("frames are corrected by an empirical model of this dive's light ({form}): on \
                  held-out frames it is better than attenuation and beam pattern"),
            remedy("its numbers are no properties of the water; overlap at several altitudes and \
                    measured mounts let attenuation be determined");
        Warning "daylight-of-other-logs" DaylightOfOtherLogs,
            text("the model has the daylight of other logs; it is used here too"),
            remedy("daylight depends on depth, hour and clouds: estimate from this log");
        Info "tilts-of-other-logs" TiltsOfOtherLogs,
            text("tilts in the model are of other logs and not used: seafloor is assumed level"),
            remedy("estimate from this log");
        Info "tilts-found" TiltsFound { median_deg: f64, largest_deg: f64 },
            text("seafloor planes that were assumed level are tilted, as overlapping frames show: \
                  by {median_deg:.1}° in the median, {largest_deg:.1}° at most"),
            remedy("an attitude sensor, or ranges of several beams, would measure it");
        Info "daylight-found" DaylightFound { share: f64 },
            text("up to {:.0} % of the light of tracked points is daylight (median, brightest \
                  band); it is modelled", 100.0 * share);
        Warning "backscatter-not-determined" BackscatterUnknown,
            text("--backscatter on: the log does not determine backscatter; it is not removed"),
            remedy("frames that overlap at different altitudes are needed");
    }
}

facts! {
    /// Why attenuation is not identified.
    NotIdentified {
        Warning "not-identified-altitude" AltitudeConstant { altitude_ratio: f64 },
            text("altitude hardly varies (the highest is {altitude_ratio:.2} times the lowest)"),
            remedy("{OTHER_MODEL}");
        Warning "not-identified-path-lengths" PathLengthsEqual { path_spread_m: f64 },
            text("points are seen from nearly the same distance (path lengths differ by \
                  {path_spread_m:.3} m)"),
            remedy("{OTHER_MODEL}");
        Warning "not-identified-frames" FewFrames { frames: usize, needed: usize },
            text("{frames} frames with a seafloor are too few to separate the water from other \
                  changes; {needed} are needed"),
            remedy("use a longer segment, or a model of another one: --model MODEL.json");
        Warning "not-identified-backscatter" BackscatterIgnored {
            attenuation_per_m: f64,
            with_backscatter_per_m: f64,
        },
            text("there is backscatter, which is not modelled: with it {attenuation_per_m:.3} per \
                  metre would be {with_backscatter_per_m:.3}"),
            remedy("do not use --backscatter off");
        Warning "not-identified-low-frames" LowFramesDiffer {
            attenuation_per_m: f64,
            low_frames_per_m: f64,
        },
            text("the lower half of the frames alone gives {low_frames_per_m:.3} per metre, all \
                  give {attenuation_per_m:.3}: backscatter is not modelled, or the light changed"),
            remedy("inspect the highest frames: where backscatter hides the seafloor, exclude them \
                    with -S and -E, or use a model from lower frames");
        Warning "not-identified-negative" NotPhysical { attenuation_per_m: f64 },
            text("an attenuation of {attenuation_per_m:.3} per metre is not physical: altitude and \
                  light cannot be separated in this log"),
            remedy("check ranges and mounts (unwater inspect), or use a model from another \
                    segment: --model MODEL.json");
        Warning "not-identified-uncertain" Uncertain { std_per_m: f64 },
            text("the estimate is uncertain by {std_per_m:.2} per metre"),
            remedy("more overlap or more change of altitude lowers the uncertainty; so does a \
                    model of several logs of the dive: unwater estimate A.mcap B.mcap");
        Warning "not-identified-misfit" Misfit { systematic: f64 },
            text("the model leaves errors of {:.1} % that are common to regions of the image or to \
                  frames: something in the light is not modelled", 100.0 * systematic),
            remedy("look for a second lamp, daylight, or moving shadows; the differences between \
                    bands suffer less");
        Warning "not-identified-logs-differ" LogsDiffer,
            text("the logs are of different waters, and overlap in time: the model cannot tell \
                  whose attenuation is used"),
            remedy("estimate each log alone");
        Warning "not-identified-residual" LightLeft,
            text("attenuation and beam pattern do not explain the light: what they leave of it \
                  differs by place in the image and slant range, and is removed beside them"),
            remedy("all lamps in the transforms or the rig file, and a calibration of the \
                    camera's vignetting, would explain it");
        Warning "not-identified-empirical" EmpiricalBetter,
            text("an empirical model of the light predicts held-out frames better"),
            remedy("check ranges, mounts and calibration (unwater inspect)");
        Warning "not-identified-no-answers" NoAnswers { reason: String },
            text("no estimator has an answer ({reason}): frames are corrected by an empirical \
                  model of their light"),
            remedy("for attenuation, use a model from another part of the dive or from another \
                    dive of the same water and strobe: --model MODEL.json");
        Warning "not-identified-shared-beam" SharedBeam,
            text("the model of --beam-from is not identified: errors of its beam pattern are in \
                  this attenuation too"),
            remedy("give a model that is identified");
        Warning "not-identified-lamps-stay" LampsStay,
            text("the camera turns in the vehicle and the lamps do not: the beam pattern is \
                  estimated as if they did"),
            remedy("select a part of the log in which the camera stands still with -S and -E");
        Warning "not-identified-slope" SlopeUnknown,
            text("the range instrument sends one number in several copies: the seafloor is assumed \
                  level, and its slope shifts the answer by an unknown amount"),
            remedy("set the driver to send the range of each beam, or use a model of another log: \
                    --model MODEL.json");
        Warning "not-identified-tilts" TiltsAmbiguous,
            text("the log has neither an attitude nor ranges of several beams, and the camera's \
                  gain or the strobe's position is not known either: tilts of the vehicle can \
                  stand in for them"),
            remedy("record an attitude (sensor_msgs/Imu), or give the strobe's mount in a rig file \
                    and fix the camera's exposure and white balance");
        Warning "not-identified-lamps" LampsMayDiffer { lamps: usize },
            text("{lamps} lamps share one beam pattern in the model, and what is left looks like a \
                  camera with uneven gain or vignetting: it may be the difference of their \
                  patterns"),
            remedy("with one lamp at a time, or lamps of one type, attenuation can be determined");
        Warning "not-identified-level" NotLevel { rotation_deg: f64 },
            text("the seafloor is assumed level, and the images contradict it: rotated by \
                  {rotation_deg:.1}° it fits better"),
            remedy("a DVL, or ranges of several beams, would measure the slope");
        Warning "not-identified-mount" MountContradicted,
            text("the mount of the range instrument that is used contradicts the attitude and the \
                  images"),
            remedy("correct the mount, or let the one that fits be used: --self-calibration auto, \
                    without [dvl.mount] in the rig file");
        Warning "not-identified-no-overlap" NoOverlap { tracks: usize, needed: usize },
            text("{tracks} points of the seafloor are seen more than once, {needed} are needed: \
                  what is left is the mean light against the altitude, which assumes the same \
                  seafloor everywhere, and its error is unknown"),
            remedy("record frames that overlap, with a seafloor below them; or use a model from \
                    another segment: --model MODEL.json");
        Warning "not-identified-joint-failed" JointFailed { reason: String },
            text("the joint solve failed ({reason})"),
            remedy("use a model from another segment: --model MODEL.json");
    }
}

facts! {
    /// Why an estimator has no answer.
    NoAnswer {
        Info "few-tracks" FewTracks { tracks: usize, needed: usize },
            text("{tracks} points seen more than once; {needed} are needed");
        Info "unknowns-not-determined" Undetermined,
            text("the points seen more than once do not determine the unknowns");
        Info "several-lamps" SeveralLamps,
            text("several lamps shine; only the joint solve separates them");
        Info "equal-path-lengths" EqualPathLengths,
            text("path lengths do not differ within the pairs");
        Info "altitude-range" AltitudeRange {
            altitude_ratio: f64,
            frames: usize,
            needed_ratio: f64,
        },
            text("the highest altitude is {altitude_ratio:.2} times the lowest over {frames} \
                  frames; {needed_ratio:.2} times is needed");
        Info "few-shared-cells" FewSharedCells,
            text("too few frames share a part of the image that is lit");
    }
}
