//! Light that is not the strobe's direct light: backscatter and daylight.

use super::Dataset;
use super::backscatter::{self, BackscatterFit};
use super::daylight::{self, DaylightFit};
use super::samples::FrameSamples;
use crate::config::Switch;
use crate::parallel::join;
use crate::solver::{Setup, Track};

/// Backscatter and daylight: what predicts held-out frames better, and the other one beside it if
/// it is there, too. Daylight stands in for a strobe that is elsewhere: it is sought where the
/// position is not in doubt.
pub fn other_light(
    data: &Dataset<'_>,
    setup: &Setup<'_>,
    seeks_daylight: bool,
) -> (Option<BackscatterFit>, Option<DaylightFit>) {
    let (scattered, daylight) = join(
        || backscatter::find(data, setup),
        || seeks_daylight.then(|| daylight::find(data, setup, None)).flatten(),
    );
    match (scattered, daylight) {
        // Backscatter that is not to be modelled takes nothing from daylight.
        (Some(scattered), Some(day)) if setup.config.backscatter == Switch::Off => {
            (Some(scattered), Some(day))
        }
        (Some(scattered), Some(day)) if day.improvement < scattered.improvement => {
            let beside = daylight::find(data, setup, Some(&scattered));
            (Some(scattered), beside)
        }
        (_, Some(day)) => {
            let with_day = Setup { daylight: Some(daylight::begun(&day.share)), ..*setup };
            (backscatter::find(data, &with_day), Some(day))
        }
        (scattered, None) => (scattered, None),
    }
}

/// Frames and tracks without backscatter, where there is any.
pub fn without_backscatter(
    data: &Dataset<'_>,
    backscatter: Option<&BackscatterFit>,
) -> (Vec<FrameSamples>, Vec<Track>) {
    backscatter
        .map_or_else(|| (data.frames.to_vec(), data.tracks.to_vec()), |fit| fit.removed_from(data))
}
