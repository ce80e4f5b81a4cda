//! Exposure time, gain and strobe power over time.

use crate::units::Stamp;

/// One setting over time, in the unit of its message.
#[derive(Clone, Debug, PartialEq)]
pub struct SettingSeries {
    /// where it was recorded
    pub topic: String,
    /// `exposure`, `gain`, `strobe`, or `value` for a message that is one number
    pub name: String,
    /// in time order
    pub values: Vec<(Stamp, f64)>,
}

/// A setting within this time of a frame belongs to that frame (s).
const SAME_FRAME_S: f64 = 0.05;

impl SettingSeries {
    /// Values in any order; those that are not finite are dropped.
    pub fn new(topic: String, name: String, mut values: Vec<(Stamp, f64)>) -> Self {
        values.retain(|(_, v)| v.is_finite());
        values.sort_by_key(|(stamp, _)| *stamp);
        Self { topic, name, values }
    }

    /// The setting of a frame: the nearest within `SAME_FRAME_S`, else the last before it, else
    /// the first of the log.
    pub fn at(&self, stamp: Stamp) -> Option<f64> {
        let after = self.values.partition_point(|(s, _)| *s < stamp);
        let (before, next) =
            (after.checked_sub(1).and_then(|i| self.values.get(i)), self.values.get(after));
        let gap = |v: &(Stamp, f64)| v.0.seconds_since(stamp).abs();
        match (before, next) {
            (Some(b), Some(n)) if gap(n) < SAME_FRAME_S && gap(n) <= gap(b) => Some(n.1),
            (Some(b), _) => Some(b.1),
            (None, n) => n.map(|n| n.1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_its_own_setting_or_the_last_one_before() {
        let at = |s: f64| Stamp((s * 1e9) as i64);
        let series = SettingSeries::new(
            "/camera/gain".into(),
            "value".into(),
            vec![(at(1.0), 2.0), (at(2.0), 4.0), (at(0.0), 1.0)],
        );
        assert_eq!(
            [0.5, 0.97, 1.03, 1.9, 9.0, -1.0].map(|s| series.at(at(s))),
            [1.0, 2.0, 2.0, 2.0, 4.0, 1.0].map(Some)
        );
    }
}
