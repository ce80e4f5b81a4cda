//! Measured camera response (step wedge, exposure series) as a table, linearly interpolated.
//! Replaces a named transfer curve.

use serde::{Deserialize, Serialize};

/// How the transfer curve is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TransferKnown {
    /// given, or linear by the image's encoding
    #[default]
    Surely,
    /// sRGB by the image's encoding, which cameras often only resemble
    Assumed,
    /// found in this log as a named curve
    Named,
    /// found in this log, free
    Fitted,
}

/// A monotone table from pixel value to linear light, both as shares of full scale.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f64; 2]>", into = "Vec<[f64; 2]>")]
pub struct ResponseTable {
    /// (pixel value, light), both strictly increasing
    points: Vec<[f64; 2]>,
}

impl TryFrom<Vec<[f64; 2]>> for ResponseTable {
    type Error = String;

    fn try_from(points: Vec<[f64; 2]>) -> Result<Self, String> {
        Self::new(points)
    }
}

impl From<ResponseTable> for Vec<[f64; 2]> {
    fn from(table: ResponseTable) -> Self {
        table.points
    }
}

impl ResponseTable {
    /// Validates a table.
    ///
    /// # Errors
    /// Fewer than two points, a share outside 0 to 1, a value that does not increase.
    pub fn new(points: Vec<[f64; 2]>) -> Result<Self, String> {
        if points.len() < 2 {
            return Err(format!(
                "a response needs at least two points [pixel value, light]; this one has {}",
                points.len()
            ));
        }
        if let Some([value, light]) =
            points.iter().find(|p| p.iter().any(|v| !(0.0..=1.0).contains(v)))
        {
            return Err(format!(
                "a response is in shares of full scale, 0 to 1; it has [{value}, {light}]"
            ));
        }
        if let Some(pair) = points.windows(2).find(|p| p[1][0] <= p[0][0] || p[1][1] <= p[0][1]) {
            let ([a, b], [c, d]) = (pair[0], pair[1]);
            return Err(format!(
                "pixel value and light of a response must increase from point to point; [{a}, {b}] \
                 is followed by [{c}, {d}]"
            ));
        }
        Ok(Self { points })
    }

    /// Reads a CSV table of two columns, pixel value and light. Lines that start with # and a
    /// header are skipped.
    ///
    /// # Errors
    /// A line that is not two numbers, or see [`Self::new`].
    pub fn from_csv(text: &str) -> Result<Self, String> {
        let mut points = Vec::new();
        for (number, line) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let cells: Vec<Option<f64>> =
                line.split([',', ';', '\t']).map(|c| c.trim().parse().ok()).collect();
            match cells[..] {
                [Some(value), Some(light)] => points.push([value, light]),
                _ if points.is_empty() && cells.iter().all(Option::is_none) => {} // a header
                _ => {
                    return Err(format!(
                        "line {number} of the response is not two numbers, pixel value and light: \
                         {line:?}"
                    ));
                }
            }
        }
        Self::new(points)
    }

    /// Linear light of a pixel value, both as shares of full scale. The first and the last segment
    /// are extrapolated, down to 0.
    pub fn to_linear(&self, value: f64) -> f64 {
        let next = self.points.partition_point(|p| p[0] < value).clamp(1, self.points.len() - 1);
        let ([c0, l0], [c1, l1]) = (self.points[next - 1], self.points[next]);
        (l0 + (l1 - l0) * (value - c0) / (c1 - c0)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolates_between_points_and_extrapolates_beyond() {
        let response =
            ResponseTable::from_csv("code, light\n# dark end\n0.1, 0\n0.5; 0.2\n\n0.9,0.8\n")
                .expect("a table");
        for (value, light) in
            [(0.1, 0.0), (0.3, 0.1), (0.5, 0.2), (0.7, 0.5), (0.9, 0.8), (1.0, 0.95), (0.0, 0.0)]
        {
            assert!(
                (response.to_linear(value) - light).abs() < 1e-12,
                "{value}: {}",
                response.to_linear(value)
            );
        }
    }

    #[test]
    fn an_invalid_table_is_rejected_with_a_reason() {
        for (text, reason) in [
            ("0,0", "at least two points"),
            ("0,0\n255,1", "shares of full scale"),
            ("0,0\n0.5,0.4\n0.5,0.6", "increase"),
            ("0,0\n0.5,0.4\n0.7,0.4", "increase"),
            ("0,0\n0.5,x", "line 2"),
            ("0,0\n0.5,nan", "shares of full scale"),
        ] {
            let error = ResponseTable::from_csv(text).expect_err(text);
            assert!(error.contains(reason), "{text:?}: {error}");
        }
    }
}
