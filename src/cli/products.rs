//! The commands that make pictures for people: `report`, `compare`, `mosaic`.

use super::commands::{beside, model_file, say};
use super::progress::Bar;
use super::{
    CompareArgs, Ended, ExportArgs, LookOptions, MosaicArgs, RenderOptions, ReportArgs, window,
};
use crate::error::{Error, Result};
use crate::products::dive::CorrectedLog;
use crate::products::mosaic::{self, MosaicOptions};
use crate::products::{data_set, page, sheet, write_whole};
use crate::recording::{Window, check_output_path};
use crate::session::Options;

impl LookOptions {
    fn options(&self) -> Options {
        Options { threads: self.threads, force: self.force, ..Options::default() }
    }

    fn written(&self, path: &std::path::Path) {
        if !self.quiet {
            say(&format!("written      {}\n", path.display()));
        }
    }
}

/// `unwater report`
pub fn report(args: &ReportArgs) -> Result<Ended> {
    let options = args.run.options();
    let output = args.output.clone().unwrap_or_else(|| beside(&args.input, "html"));
    check_output_path(&args.input, &output, options.force)?;
    let log = CorrectedLog::open(&args.input, &options)?;
    write_whole(&output, page::page(&log, &options)?.as_bytes())?;
    args.run.written(&output);
    Ok(Ended::Done)
}

/// A picture's name says how it is written; another ending would promise what is not in it.
fn ensure_named(output: &std::path::Path, endings: &[&str]) -> Result<()> {
    let ending = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let is_known = ending.is_none_or(|e| endings.contains(&e.as_str()));
    if is_known {
        Ok(())
    } else {
        Err(Error::Usage(format!(
            "{}: the picture can be written as .{}",
            output.display(),
            endings.join(" or .")
        )))
    }
}

/// `unwater compare`
pub fn compare(args: &CompareArgs) -> Result<Ended> {
    let options = args.shared.options(&args.estimate, &RenderOptions::default())?;
    check_output_path(&args.input, &args.output, options.force)?;
    ensure_named(&args.output, &["png"])?;
    let which = match (args.frame, args.at) {
        (Some(number), _) => sheet::FrameSelector::Number(number),
        (None, time) => sheet::FrameSelector::LogTime(time.unwrap_or_default()),
    };
    let model = model_file(args.model.as_deref())?;
    let png = sheet::sheet(&args.input, model, which, &options, &Bar::new(args.shared.quiet))?;
    write_whole(&args.output, &png)?;
    if !args.shared.quiet {
        say(&format!("written      {}\n", args.output.display()));
    }
    Ok(Ended::Done)
}

/// `unwater mosaic`
pub fn mosaic(args: &MosaicArgs) -> Result<Ended> {
    let options = Options { window: window(args.start, args.end)?, ..args.run.options() };
    check_output_path(&args.input, &args.output, options.force)?;
    ensure_named(&args.output, &["png", "tif", "tiff"])?;
    let asked = MosaicOptions {
        camera: args.camera.clone(),
        is_georeferenced: mosaic::is_geotiff(&args.output),
    };
    let laid = mosaic::mosaic(&CorrectedLog::open(&args.input, &options)?, &asked, &options)?;
    let bytes = match laid.tiff() {
        Some(tiff) => tiff,
        None => {
            laid.png().map_err(|reason| Error::WriteRecord { path: args.output.clone(), reason })?
        }
    };
    write_whole(&args.output, &bytes)?;
    if !args.run.quiet {
        laid.diagnostics.iter().for_each(|d| eprintln!("note: {d}"));
    }
    args.run.written(&args.output);
    Ok(Ended::Done)
}

/// `unwater export`
pub fn export(args: &ExportArgs) -> Result<Ended> {
    let options = Options { window: window(args.start, args.end)?, ..args.run.options() };
    let is_used = std::fs::read_dir(&args.output).is_ok_and(|mut entries| entries.next().is_some());
    if args.output.is_file() || (is_used && !options.force) {
        return Err(Error::OutputExists { path: args.output.clone() });
    }
    let facts = match &args.facts {
        None => serde_json::Map::new(),
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .map_err(|source| Error::Read { path: path.clone(), source })?;
            toml::from_str(&text).map_err(|e| Error::BadFile {
                path: path.clone(),
                what: "a fact",
                reason: e.to_string().trim().into(),
            })?
        }
    };
    let log = CorrectedLog::open(&args.input, &options)?;
    let topics: Vec<String> =
        log.cameras.iter().map(|c| c.fact("camera_topic").to_string()).collect();
    let camera = match (&args.camera, log.cameras.as_slice()) {
        (Some(topic), cameras) => cameras.iter().find(|c| c.fact("camera_topic") == topic),
        (None, [one]) => Some(one),
        (None, _) => return Err(Error::SeveralCameras { topics }),
    };
    let missing_camera = || Error::NoSuchTopic {
        what: "corrected camera",
        topic: args.camera.clone().unwrap_or_default(),
        seen: topics.join(", "),
    };
    let camera = camera.ok_or_else(missing_camera)?;
    let written = data_set::export(
        &log,
        camera,
        &facts,
        &args.output,
        options.window.unwrap_or(Window::ALL),
        &Bar::new(args.run.quiet),
    )?;
    if !args.run.quiet {
        if !written.missing.is_empty() {
            eprintln!(
                "note: ifdo.json lacks what neither log nor --facts says: {}",
                written.missing.join(", ")
            );
        }
        say(&format!("stills       {}\n", written.stills));
    }
    args.run.written(&args.output);
    Ok(Ended::Done)
}
