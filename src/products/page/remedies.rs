//! What can be done about a warning, or about frames that were not corrected. Most warnings say it
//! themselves.

/// Words of the sentence, and the remedy.
const REMEDIES: &[(&str, &str)] = &[
    (
        "altitude hardly varies",
        "A stretch of the dive with changing altitude (15 % or more) tells attenuation; use its \
         model here: unwater correct --model MODEL.json.",
    ),
    (
        "seen from nearly the same distance",
        "A stretch of the dive with changing altitude tells attenuation; use its model here: \
         unwater correct --model MODEL.json.",
    ),
    (
        "the lower half of the frames alone says",
        "Look at the highest frames: where they are veiled, leave them out with -S and -E, or \
         take a model from lower frames.",
    ),
    (
        "is not physical",
        "Check ranges and mounts (unwater inspect), or use a model from another stretch: --model \
         MODEL.json.",
    ),
    (
        "the estimate is uncertain by",
        "More overlap or more change of altitude makes it surer; a model of several logs of the \
         dive too: unwater estimate A.mcap B.mcap.",
    ),
    (
        "known by its field of view alone",
        "Calibrate the camera in water and write fx, fy, cx, cy and the distortion under [camera] \
         in a rig file.",
    ),
    (
        "have been processed already",
        "Correct the pictures as the camera wrote them; what was balanced before cannot be undone.",
    ),
    (
        "not on the camera's clock",
        "Give the offset under [time_offset_s] in a rig file; unwater inspect --clocks looks for \
         it.",
    ),
    (
        "stands still for",
        "Name another instrument with --dvl TOPIC, or mark the value under dvl.bad_values in a \
         rig file.",
    ),
    (
        "have no stamp or one of 0",
        "Stamp the messages where they are made; offsets are set under [time_offset_s] in a rig \
         file.",
    ),
    (
        "a device's own clock",
        "Give the offset under [time_offset_s] in a rig file; unwater inspect --clocks looks for \
         it.",
    ),
    (
        "have the stamp of the one before",
        "Look at the driver that stamps them; unwater inspect --clocks tells offsets.",
    ),
    (
        "are stamped earlier than the one before",
        "Look at the driver that stamps them; unwater inspect --clocks tells offsets.",
    ),
    ("depth pictures without a calibration", "Record the depth camera's camera_info too."),
    (
        "strobe drop-outs",
        "Nothing has to be done; the strobe's charging or trigger is worth a look.",
    ),
    (
        "the picture cannot be decoded",
        "unwater inspect names the encoding; docs/formats.md lists those that are read.",
    ),
    (
        "does not fit the calibration",
        "Give the calibration of these pictures in a rig file: unwater init writes one.",
    ),
    (
        "no range to the seafloor near enough in time",
        "Name another instrument with --dvl TOPIC, or allow for a longer gap with \
         seafloor.max_ping_gap_s in the settings.",
    ),
    (
        "no sonar beam came back",
        "The floor was out of the instrument's reach, or too near; another instrument can be \
         named with --dvl TOPIC.",
    ),
    (
        "the ranges give no plausible seafloor",
        "Check the instrument's mount and beams in a rig file: [dvl.mount], dvl.beams.",
    ),
    ("no pixel looks at the seafloor", "Check the camera's mount in a rig file: [camera.mount]."),
    ("the corrected picture cannot be encoded", "Try --image-format png."),
];

/// The remedy for a sentence, where it does not hold one itself.
pub fn remedy(sentence: &str) -> Option<&'static str> {
    REMEDIES.iter().find(|(words, _)| sentence.contains(words)).map(|(_, remedy)| *remedy)
}

#[cfg(test)]
mod tests {
    use super::remedy;
    use crate::report::Reason;

    #[test]
    fn every_reason_for_an_uncorrected_frame_has_a_remedy() {
        let reasons = [
            Reason::Undecodable("x".into()),
            Reason::WrongSize,
            Reason::NoPing,
            Reason::NoReturn,
            Reason::ImpossiblePlane,
            Reason::OffSurface,
            Reason::Unencodable("x".into()),
        ];
        assert!(reasons.iter().all(|r| remedy(&r.to_string()).is_some()));
        assert_eq!(remedy("something else"), None);
    }
}
