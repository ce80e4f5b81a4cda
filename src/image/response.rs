//! A camera's response as a table: what code a share of light makes, measured by whoever knows the
//! camera (step wedge, exposure series). Used instead of a named transfer curve; straight between
//! the table's points.

/// A monotone table from codes to light, both as shares of full scale.
#[derive(Clone, Debug, PartialEq)]
pub struct ResponseTable {
    /// code share, light share; both rise
    points: Vec<[f64; 2]>,
}

impl ResponseTable {
    /// Checks a table.
    ///
    /// # Errors
    /// A sentence: too few points, a share out of 0 to 1, a code or light that does not rise.
    pub fn new(points: Vec<[f64; 2]>) -> Result<Self, String> {
        if points.len() < 2 {
            return Err(format!(
                "a response needs at least two points [code share, light share]; this has {}",
                points.len()
            ));
        }
        if let Some([code, light]) =
            points.iter().find(|p| p.iter().any(|v| !(0.0..=1.0).contains(v)))
        {
            return Err(format!(
                "a response is in shares of full scale, 0 to 1; it has [{code}, {light}]"
            ));
        }
        if let Some(pair) = points.windows(2).find(|p| p[1][0] <= p[0][0] || p[1][1] <= p[0][1]) {
            let ([a, b], [c, d]) = (pair[0], pair[1]);
            return Err(format!(
                "in a response both codes and light rise from point to point; [{a}, {b}] is \
                 followed by [{c}, {d}]"
            ));
        }
        Ok(Self { points })
    }

    /// Reads a table of two columns, code share and light share. Lines that begin with # and a
    /// heading are passed over.
    ///
    /// # Errors
    /// A sentence with the line's number, or that of [`Self::new`].
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
                [Some(code), Some(light)] => points.push([code, light]),
                _ if points.is_empty() && cells.iter().all(Option::is_none) => {} // a heading
                _ => {
                    return Err(format!(
                        "line {number} of the response is not two numbers, code share and light \
                         share: {line:?}"
                    ));
                }
            }
        }
        Self::new(points)
    }

    /// Light of a code, both as shares of full scale. Beyond the table the last stretch goes on, to
    /// no less than no light.
    pub fn to_linear(&self, code: f64) -> f64 {
        let next = self.points.partition_point(|p| p[0] < code).clamp(1, self.points.len() - 1);
        let ([c0, l0], [c1, l1]) = (self.points[next - 1], self.points[next]);
        (l0 + (l1 - l0) * (code - c0) / (c1 - c0)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_between_points_and_on_beyond_them() {
        let response =
            ResponseTable::from_csv("code, light\n# dark end\n0.1, 0\n0.5; 0.2\n\n0.9,0.8\n")
                .expect("a table");
        for (code, light) in
            [(0.1, 0.0), (0.3, 0.1), (0.5, 0.2), (0.7, 0.5), (0.9, 0.8), (1.0, 0.95), (0.0, 0.0)]
        {
            assert!(
                (response.to_linear(code) - light).abs() < 1e-12,
                "{code}: {}",
                response.to_linear(code)
            );
        }
    }

    #[test]
    fn what_is_no_table_is_refused_in_a_sentence() {
        for (text, said) in [
            ("0,0", "at least two points"),
            ("0,0\n255,1", "shares of full scale"),
            ("0,0\n0.5,0.4\n0.5,0.6", "rise"),
            ("0,0\n0.5,0.4\n0.7,0.4", "rise"),
            ("0,0\n0.5,x", "line 2"),
            ("0,0\n0.5,nan", "shares of full scale"),
        ] {
            let error = ResponseTable::from_csv(text).expect_err(text);
            assert!(error.contains(said), "{text:?}: {error}");
        }
    }
}
