//! The settings as a TOML file: read, checked, and written with unit and reason of each.

use super::{Config, ImageFormat, Look, SETTINGS};
use crate::toml_file;

impl Config {
    /// Reads a TOML file's text.
    ///
    /// # Errors
    /// A sentence; an unknown key names the nearest known one.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let config: Self = toml_file::parse(text)?;
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
        self.ensure_rules()?;
        if self.render.look == Look::Natural && self.render.depth == 16 {
            return Err("--look natural is for 8 bits: images of --depth 16 are linear".into());
        }
        if self.render.depth == 16 && self.render.image_format == ImageFormat::Jpeg {
            return Err("a JPEG holds 8 bits: use --image-format png or raw with --depth 16".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_printed_file_reads_back() {
        let mut full = Config::default();
        full.light.white_level = Some(4095);
        full.output.only = Some("/camera/.*".into());
        for config in [full, Config::default()] {
            let text = config.to_commented_toml();
            assert_eq!(Config::from_toml(&text).expect("reads back"), config, "{text}");
        }
    }

    #[test]
    fn an_unknown_key_names_its_neighbour() {
        let error = Config::from_toml("[render]\njpg_quality = 3\n").expect_err("unknown");
        assert!(error.contains("render.jpeg_quality"), "{error}");
    }

    #[test]
    fn a_value_out_of_range_names_its_key() {
        let error = Config::from_toml("[matching]\nratio = nan\n").expect_err("not a ratio");
        assert_eq!(error, "matching.ratio must lie in 0.3 to 1");
    }
}
