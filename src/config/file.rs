//! The settings as a TOML file: read, checked, and written with unit and reason of each.

use super::{Config, ImageFormat, SETTINGS, with_nearest_key};

impl Config {
    /// Reads a TOML file's text.
    ///
    /// # Errors
    /// A sentence; an unknown key names the nearest known one.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let config: Self = toml::from_str(text)
            .map_err(|e| with_nearest_key(&e, SETTINGS.iter().map(|s| s.key)))?;
        config.ensure_valid()?;
        Ok(config)
    }

    /// The effective values as TOML with unit and reason of each.
    pub fn to_commented_toml(&self) -> String {
        let table = toml::Table::try_from(self).unwrap_or_default();
        let mut out = String::new();
        let mut section = "";
        for setting in SETTINGS {
            let (name, key) = setting.key.split_once('.').unwrap_or(("", setting.key));
            if name != section {
                section = name;
                out += &format!("{}[{section}]\n", if out.is_empty() { "" } else { "\n" });
            }
            let line = match table.get(name).and_then(|s| s.get(key)) {
                Some(value) => format!("{key} = {value}"),
                None => format!("# {key} ="),
            };
            out += &format!("{line:<34} # [{}] {}\n", setting.unit, setting.why);
        }
        out
    }

    /// Checks what types cannot.
    ///
    /// # Errors
    /// A sentence naming the key.
    pub fn ensure_valid(&self) -> Result<(), String> {
        let checks = [
            (self.seafloor.pings_each_side >= 1, "seafloor.pings_each_side must be at least 1"),
            (self.seafloor.max_ping_gap_s > 0.0, "seafloor.max_ping_gap_s must be above 0"),
            (self.seafloor.ping_window_s > 0.0, "seafloor.ping_window_s must be above 0"),
            (
                (0.0..=1.0).contains(&self.estimate.clipped_above),
                "estimate.clipped_above must lie in 0 to 1",
            ),
            (
                self.matching.detection_side_px >= 64,
                "matching.detection_side_px must be at least 64",
            ),
            ((0.3..1.0).contains(&self.matching.ratio), "matching.ratio must lie in 0.3 to 1"),
            (self.matching.footprint_px >= 0.5, "matching.footprint_px must be at least 0.5"),
            (self.estimate.grid_step_px >= 2, "estimate.grid_step_px must be at least 2"),
            (
                (8..=129).contains(&self.estimate.beam_nodes),
                "estimate.beam_nodes must lie in 8 to 129",
            ),
            (
                (10.0..90.0).contains(&self.estimate.beam_limit_deg),
                "estimate.beam_limit_deg must lie in 10 to 90",
            ),
            (self.estimate.max_frames >= 2, "estimate.max_frames must be at least 2"),
            (self.estimate.first_frames >= 2, "estimate.first_frames must be at least 2"),
            (self.estimate.precision_per_m >= 0.0, "estimate.precision_per_m must not be below 0"),
            (
                (1..=100).contains(&self.render.jpeg_quality),
                "render.jpeg_quality must lie in 1 to 100",
            ),
            (matches!(self.render.depth, 8 | 16), "render.depth must be 8 or 16"),
            (
                (0.1..=1.0).contains(&self.render.shoulder_from),
                "render.shoulder_from must lie in 0.1 to 1",
            ),
            (self.render.gain_cap > 1.0, "render.gain_cap must be above 1"),
            (
                (1e-5..=0.1).contains(&self.render.gain_error),
                "render.gain_error must lie in 0.00001 to 0.1",
            ),
            (
                !(self.render.depth == 16 && self.render.image_format == ImageFormat::Jpeg),
                "a JPEG holds 8 bits: use --image-format png or raw with --depth 16",
            ),
            (
                (1..=1024).contains(&self.output.chunk_size_mib),
                "output.chunk_size_mib must lie in 1 to 1024",
            ),
            (
                self.output.seafloor_points_across <= 4096,
                "output.seafloor_points_across must be at most 4096",
            ),
        ];
        checks.iter().find(|(ok, _)| !ok).map_or(Ok(()), |(_, sentence)| Err((*sentence).into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_is_documented_and_the_printed_file_reads_back() {
        let mut full = Config::default();
        full.light.white_level = Some(4095);
        full.output.only = Some("/camera/.*".into());
        let table = toml::Table::try_from(&full).expect("a table");
        let keys: Vec<String> = table
            .iter()
            .flat_map(|(s, t)| {
                t.as_table().expect("a section").keys().map(move |k| format!("{s}.{k}"))
            })
            .collect();
        for key in &keys {
            assert!(SETTINGS.iter().any(|s| s.key == key), "{key} is not in SETTINGS");
        }
        assert_eq!(keys.len(), SETTINGS.len());
        assert_eq!(Config::from_toml(&full.to_commented_toml()).expect("reads back"), full);
        assert_eq!(
            Config::from_toml(&Config::default().to_commented_toml()).expect("reads back"),
            Config::default()
        );
    }

    #[test]
    fn an_unknown_key_names_its_neighbour() {
        let error = Config::from_toml("[render]\njpg_quality = 3\n").expect_err("unknown");
        assert!(error.contains("render.jpeg_quality"), "{error}");
    }
}
