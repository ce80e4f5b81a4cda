//! Pictures for people: the page of a run opens in a browser, the sheet says what it must, the
//! mosaic puts known points where they are, and the data set for archives is whole.
//!
//! Pages are opened in headless Chromium where there is one, with node and playwright-core
//! (`NODE_PATH`); elsewhere those tests are reported as ignored, never as passed. So are those on
//! dives that `UNWATER_DATA` names.
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::support::ensure;
use crate::support::render::{Dive, Sensor, Truth};
use libtest_mimic::{Failed, Trial};
use unwater::config::OutputConfig;
use unwater::diagnostics::MosaicFact;
use unwater::products::dive::CorrectedLog;
use unwater::products::mosaic::{Mosaic, MosaicOptions, mosaic};
use unwater::recording::{Entry, Output, Recording, Schema, Window};
use unwater::session::Options;

fn unwater(args: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_unwater")).args(args).output().expect("the program runs")
}

fn ran(args: &[&str]) -> Result<(), Failed> {
    let output = unwater(args);
    ensure(
        output.status.success(),
        format!("{args:?}: {}", String::from_utf8_lossy(&output.stderr)),
    )
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

/// A dive of 22 frames with its truth, and corrected: once for all tests.
struct Corrected {
    folder: tempfile::TempDir,
    dive: Dive,
    truth: Truth,
}

impl Corrected {
    fn get() -> &'static Self {
        static MADE: OnceLock<Corrected> = OnceLock::new();
        MADE.get_or_init(|| {
            let folder = tempfile::tempdir().expect("a folder");
            // The strip is laid by the velocity: without its noise, so that what is off is off by
            // the laying.
            let dive = Dive {
                frames: 22,
                width: 320,
                height: 240,
                focal_px: 380.0,
                velocity_noise_m_per_s: 0.0,
                ..Dive::default()
            };
            let truth = dive.write(&folder.path().join("dive.mcap"));
            ran(&[
                "correct",
                text(&folder.path().join("dive.mcap")),
                "-o",
                text(&folder.path().join("out.mcap")),
                "-q",
            ])
            .expect("a corrected log");
            Corrected { folder, dive, truth }
        })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

/// The page holds every number it must, whole and harmless, and the same bytes for any number of
/// threads.
fn page_says_what_it_must() -> Result<(), Failed> {
    let made = Corrected::get();
    let (one, two) = (made.path("one.html"), made.path("two.html"));
    for (threads, page) in [("1", &one), ("3", &two)] {
        ran(&["report", text(&made.path("out.mcap")), "-o", text(page), "-j", threads])?;
    }
    let html = std::fs::read_to_string(&one)?;
    ensure(html == std::fs::read_to_string(&two)?, "the bytes depend on the threads")?;
    for word in [
        "22 of 22 corrected",
        "95 % interval",
        "Identified",
        "(Fig. 6)",
        "(Fig. 8)",
        "(Fig. 9)",
        "(Fig. 10)",
        "Track from above",
        "dive.mcap",
    ] {
        ensure(html.contains(word), format!("{word:?} is not in the page"))?;
    }
    ensure(!html.contains("Not shown"), "a figure is missing")?;
    let outside = ["http://", "https://", "src=\"/", "@import", "url(http"];
    ensure(outside.iter().all(|o| !html.contains(o)), "the page asks for something outside of it")?;
    ensure(html.len() < 6 << 20, format!("{} bytes", html.len()))?;
    let again = unwater(&["report", text(&made.path("out.mcap")), "-o", text(&one)]);
    ensure(again.status.code() == Some(1), "an existing page is overwritten without --force")?;
    let not_corrected =
        unwater(&["report", text(&made.path("dive.mcap")), "-o", text(&made.path("never.html"))]);
    let said = String::from_utf8_lossy(&not_corrected.stderr).into_owned();
    ensure(not_corrected.status.code() == Some(1) && said.contains("unwater correct"), said)?;
    ensure(!made.path("never.html").exists(), "something stands under the page's name")
}

/// Outputs that lack things: each figure that cannot be made says why.
fn pages_of_poorer_logs() -> Result<Vec<(PathBuf, tempfile::TempDir)>, Failed> {
    let mut pages = Vec::new();
    let mono = Dive {
        frames: 14,
        width: 288,
        height: 216,
        focal_px: 340.0,
        sensor: Sensor::Mono16,
        ..Dive::default()
    };
    let level =
        Dive { altitude_m: (2.0, 2.05), with_imu: false, sensor: Sensor::Jpeg(90), ..mono.clone() };
    let cases: [(&str, &Dive, &[&str], &[&str]); 3] = [
        ("mono", &mono, &[], &["grey"]),
        (
            "dropped",
            &mono,
            &["--drop-raw", "--depth", "16"],
            &["--drop-raw", "Corrected frames alone"],
        ),
        ("level", &level, &[], &["Not identified", "Along the dive: altitude"]),
    ];
    for (name, dive, options, words) in cases {
        let folder = tempfile::tempdir()?;
        let (log, out) =
            (folder.path().join(format!("{name}.mcap")), folder.path().join("out.mcap"));
        dive.write(&log);
        ran(&[&["correct", text(&log), "-o", text(&out), "-q"], options].concat())?;
        let page = folder.path().join(format!("{name}.html"));
        ran(&["report", text(&out), "-o", text(&page)])?;
        let html = std::fs::read_to_string(&page)?;
        for word in words {
            ensure(html.contains(word), format!("{name}: {word:?} is not in the page"))?;
        }
        pages.push((page, folder));
    }
    Ok(pages)
}

/// What a log says of itself stays text: names with markup in them do nothing.
fn names_are_escaped() -> Result<(), Failed> {
    let made = Corrected::get();
    let folder = tempfile::tempdir()?;
    let (log, out) =
        (folder.path().join("<img src=x onerror=alert(1)>&.mcap"), folder.path().join("out.mcap"));
    std::fs::copy(made.path("dive.mcap"), &log)?;
    ran(&["correct", text(&log), "-o", text(&out), "-q"])?;
    let page = folder.path().join("page.html");
    ran(&["report", text(&out), "-o", text(&page)])?;
    let html = std::fs::read_to_string(&page)?;
    ensure(
        !html.contains("<img src=x")
            && html.contains("&lt;img src=x onerror=alert(1)&gt;&amp;.mcap"),
        "markup of a name is in the page",
    )
}

fn in_chromium(pages: &[&Path]) -> Result<(), Failed> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/report_page.cjs");
    let ran = Command::new("node").arg(script).args(pages).output()?;
    ensure(ran.status.success(), String::from_utf8_lossy(&ran.stderr).into_owned())
}

fn has_chromium() -> bool {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/report_page.cjs");
    Command::new("node").args([script, "--probe"]).output().is_ok_and(|ran| ran.status.success())
}

fn pages_open() -> Result<(), Failed> {
    let made = Corrected::get();
    let page = made.path("opened.html");
    ran(&["report", text(&made.path("out.mcap")), "-o", text(&page), "--force"])?;
    in_chromium(&[&page])?;
    let poorer = pages_of_poorer_logs()?;
    in_chromium(&poorer.iter().map(|(page, _)| page.as_path()).collect::<Vec<_>>())
}

fn pages_of_dives_open(data: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut pages = Vec::new();
    for log in [
        "rendered/A/A_clear_flat_raw16",
        "stonefish/sf_w020_square_srgb",
        "real/auv_set02",
        "real/auv_set07",
        "real/towed_port",
    ] {
        let name = log.rsplit('/').next().unwrap_or(log);
        let (out, page) = (
            folder.path().join(format!("{name}.mcap")),
            folder.path().join(format!("{name}.html")),
        );
        ran(&["correct", text(&data.join(format!("{log}.mcap"))), "-o", text(&out), "-q"])?;
        ran(&["report", text(&out), "-o", text(&page)])?;
        ensure(
            std::fs::metadata(&page)?.len() < 6 << 20,
            format!("{name}: the page is too large"),
        )?;
        pages.push(page);
    }
    in_chromium(&pages.iter().map(PathBuf::as_path).collect::<Vec<_>>())
}

/// The sheet is a picture of the right shape; frames that are not there are refused in words.
fn sheet_is_made() -> Result<(), Failed> {
    let made = Corrected::get();
    let (log, sheet, model) =
        (made.path("dive.mcap"), made.path("sheet.png"), made.path("model.json"));
    ran(&["estimate", text(&log), "-o", text(&model), "-q"])?;
    ran(&[
        "compare",
        text(&log),
        "--model",
        text(&model),
        "--frame",
        "9",
        "-o",
        text(&sheet),
        "-q",
    ])?;
    let picture = image::open(&sheet)?;
    ensure(
        picture.width() > 1500 && picture.height() > 1200,
        format!("{}×{}", picture.width(), picture.height()),
    )?;
    let time = (made.truth.frames[9].stamp_ns + 40_000_000).to_string();
    let same = made.path("same.png");
    ran(&[
        "compare",
        text(&log),
        "--model",
        text(&model),
        "--at",
        &time,
        "-o",
        text(&same),
        "-q",
        "-j",
        "1",
    ])?;
    ensure(
        std::fs::read(&sheet)? == std::fs::read(&same)?,
        "frame 9 by its time is another picture",
    )?;
    let none = unwater(&[
        "compare",
        text(&log),
        "--model",
        text(&model),
        "--frame",
        "99",
        "-o",
        text(&made.path("none.png")),
    ]);
    let said = String::from_utf8_lossy(&none.stderr).into_owned();
    ensure(none.status.code() == Some(2) && said.contains("22"), said)
}

fn laid(made: &Corrected, asked: &MosaicOptions) -> Result<Mosaic, Failed> {
    let options = Options::default();
    Ok(mosaic(&CorrectedLog::open(&made.path("out.mcap"), &options)?, asked, &options)?)
}

/// Poses by DVL and attitude against the truth, and pixels of the strip against the floor's
/// reflectance at known points.
fn mosaic_puts_points_where_they_are() -> Result<(), Failed> {
    let made = Corrected::get();
    let laid = laid(made, &MosaicOptions::default())?;
    ensure(
        laid.frames.len() == made.truth.frames.len(),
        format!("{} frames laid", laid.frames.len()),
    )?;
    // The mosaic's world against the true one: a shift and a turn, from the first and the last
    // frame alone.
    let place = |v: [f64; 3]| nalgebra::Vector2::new(v[0], v[1]);
    let own = |k: usize| laid.frames[k].world_from_body.translation.vector.xy();
    let last = laid.frames.len() - 1;
    let (a, b) = (
        own(last) - own(0),
        place(made.truth.frames[last].position) - place(made.truth.frames[0].position),
    );
    ensure(
        (a.norm() / b.norm() - 1.0).abs() < 0.01,
        format!("the way is {} m long, not {}", a.norm(), b.norm()),
    )?;
    let turn = nalgebra::Rotation2::new(b.y.atan2(b.x) - a.y.atan2(a.x));
    let to_truth =
        |p: nalgebra::Vector2<f64>| turn * (p - own(0)) + place(made.truth.frames[0].position);
    for (k, truth) in made.truth.frames.iter().enumerate() {
        let off = (to_truth(own(k)) - place(truth.position)).norm();
        ensure(off < 0.05, format!("frame {k} lies {off:.3} m off"))?;
    }
    // Known points: pixels of every frame, where they truly lie, looked up in the strip.
    let base_from_optical = nalgebra::Matrix3::new(0.0, -1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let camera_in_base = nalgebra::Vector3::new(0.34, -0.10, -0.12);
    let (dive, strip) = (&made.dive, &laid.corrected);
    let mut pairs = Vec::new();
    for (k, frame) in made.truth.frames.iter().enumerate() {
        let [x, y, z, w] = frame.orientation_xyzw;
        let world_from_base =
            nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        for i in (0..dive.width * dive.height).step_by(53) {
            let ray = nalgebra::Vector3::new(
                ((i % dive.width) as f64 - (dive.width as f64 - 1.0) / 2.0) / dive.focal_px,
                ((i / dive.width) as f64 - (dive.height as f64 - 1.0) / 2.0) / dive.focal_px,
                1.0,
            );
            let depth = frame.plane_distance_m
                / nalgebra::Vector3::from(frame.plane_normal_in_optical).dot(&ray);
            let ground = nalgebra::Vector3::from(frame.position)
                + world_from_base * (camera_in_base + base_from_optical * (ray * depth));
            let own =
                turn.inverse() * (ground.xy() - place(made.truth.frames[0].position)) + own(0);
            let (u, v) = laid.grid.pixel([own.x, own.y]);
            let (u, v) = (u.round(), v.round());
            if u < 0.0 || v < 0.0 || u >= laid.grid.width as f64 || v >= laid.grid.height as f64 {
                continue;
            }
            let at = v as usize * laid.grid.width + u as usize;
            // Of several frames the last one covers.
            if strip.frame_numbers[at] as usize == k + 1 {
                pairs.push((
                    f64::from(strip.image.pixels[3 * at + 1]),
                    f64::from(frame.reflectance[i][1]),
                ));
            }
        }
    }
    ensure(pairs.len() > 5000, format!("{} known points in the strip", pairs.len()))?;
    let n = pairs.len() as f64;
    let (p, q) =
        (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
    let (pq, pp, qq) = pairs.iter().fold((0.0, 0.0, 0.0), |(a, b, c), (x, y)| {
        (a + (x - p) * (y - q), b + (x - p).powi(2), c + (y - q).powi(2))
    });
    let correlation = pq / (pp * qq).sqrt();
    ensure(
        correlation > 0.95,
        format!("light and reflectance at one place correlate by {correlation:.3} alone"),
    )
}

/// Without attitude and velocity, shared points alone must lay the frames out as long as the way
/// was.
fn mosaic_by_shared_points() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let dive = Dive {
        frames: 10,
        width: 320,
        height: 240,
        focal_px: 330.0,
        with_imu: false,
        tilt_deg: 0.0,
        noise: false,
        ..Dive::default()
    };
    let truth = dive.write(&folder.path().join("dive.mcap"));
    let out = folder.path().join("out.mcap");
    ran(&["correct", text(&folder.path().join("dive.mcap")), "-o", text(&out), "-q"])?;
    let options = Options::default();
    let laid = mosaic(&CorrectedLog::open(&out, &options)?, &MosaicOptions::default(), &options)?;
    ensure(
        laid.diagnostics.contains(&MosaicFact::PosesFromMatches.into()),
        format!("{:?}", laid.diagnostics),
    )?;
    ensure(laid.frames.len() >= 8, format!("{} frames are joined", laid.frames.len()))?;
    for pair in laid.frames.windows(2) {
        let truth_of = |time: u64| {
            truth
                .frames
                .iter()
                .find(|f| f.stamp_ns.abs_diff(time) < 100_000_000)
                .map(|f| nalgebra::Vector3::from(f.position))
        };
        let (Some(a), Some(b)) = (truth_of(pair[0].log_time), truth_of(pair[1].log_time)) else {
            return Err("a frame of no time".into());
        };
        let step = (pair[1].world_from_body.translation.vector
            - pair[0].world_from_body.translation.vector)
            .xy()
            .norm();
        let ought = (b - a).xy().norm();
        ensure((step - ought).abs() < 0.05, format!("a step of {step:.3} m, not {ought:.3}"))?;
    }
    Ok(())
}

/// Names that ask for a GeoTIFF need a position, and the log has none.
fn mosaic_without_a_position() -> Result<(), Failed> {
    let made = Corrected::get();
    let none =
        unwater(&["mosaic", text(&made.path("out.mcap")), "-o", text(&made.path("map.tif"))]);
    let said = String::from_utf8_lossy(&none.stderr).into_owned();
    ensure(!none.status.success() && said.contains("no position") && said.contains(".png"), said)?;
    ensure(!made.path("map.tif").exists(), "something stands under the map's name")?;
    let poster = made.path("mosaic.png");
    ran(&["mosaic", text(&made.path("out.mcap")), "-o", text(&poster), "-q"])?;
    ensure(image::open(&poster)?.width() > 800, "the poster is too small")
}

const ORIGIN: (f64, f64) = (60.0, 10.0);
const M_PER_DEG: f64 = 111_195.0;

/// The log with a fix at every frame, as JSON.
fn with_fixes(source: &Path, target: &Path, truth: &Truth) -> Result<(), Failed> {
    let log = Recording::open(source)?;
    let (mut out, mut file) = Output::create(target, &log.profile, &OutputConfig::default())?;
    log.schemas.iter().for_each(|(id, schema)| out.copy_schema(*id, schema));
    log.channels.iter().for_each(|(id, channel)| out.copy_channel(*id, channel));
    let number = r#"{"type":"number"}"#;
    let stamp =
        r#"{"type":"object","properties":{"sec":{"type":"integer"},"nanosec":{"type":"integer"}}}"#;
    let header = format!(r#"{{"type":"object","properties":{{"stamp":{stamp}}}}}"#);
    let data = format!(
        r#"{{"type":"object","properties":{{"header":{header},"latitude":{number},"longitude":{number}}}}}"#
    );
    let fix = out.add_channel(
        "/fix",
        "json",
        &Schema {
            name: "sensor_msgs/msg/NavSatFix".into(),
            encoding: "jsonschema".into(),
            data: data.into_bytes(),
        },
    )?;
    for entry in log.messages(Window::ALL) {
        if let Entry::Message(message) = entry {
            out.copy_message(&message);
        }
    }
    for frame in &truth.frames {
        let (sec, nanosec) = (frame.stamp_ns / 1_000_000_000, frame.stamp_ns % 1_000_000_000);
        let (latitude, longitude) = (
            ORIGIN.0 + frame.position[1] / M_PER_DEG,
            ORIGIN.1 + frame.position[0] / M_PER_DEG / ORIGIN.0.to_radians().cos(),
        );
        let said = format!(
            r#"{{"header":{{"stamp":{{"sec":{sec},"nanosec":{nanosec}}}}},"latitude":{latitude:.12},"longitude":{longitude:.12}}}"#
        );
        out.write(fix, frame.stamp_ns, frame.stamp_ns, said.as_bytes());
    }
    out.flush();
    while let Some(piece) = out.next_piece() {
        file.put(piece.into_bytes())?;
    }
    for attachment in log.attachments().flatten() {
        file.copy_attachment(&log, &attachment)?;
    }
    log.metadata.iter().try_for_each(|record| file.metadata(&record.name, &record.metadata))?;
    Ok(file.finish(out.declarations())?)
}

/// The GeoTIFF's tags lead from a known point's degrees to the pixel that shows it, as a GIS would
/// take them.
fn map_is_where_it_is() -> Result<(), Failed> {
    let made = Corrected::get();
    let (log, map) = (made.path("fixes.mcap"), made.path("fixes.tif"));
    with_fixes(&made.path("out.mcap"), &log, &made.truth)?;
    ran(&["mosaic", text(&log), "-o", text(&map), "-q"])?;
    let bytes = std::fs::read(&map)?;
    let u16_at = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let f64_at = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    ensure(bytes.starts_with(b"II*\0"), "no TIFF")?;
    let directory = u32_at(4);
    let tag = |tag: usize| {
        (0..u16_at(directory))
            .map(|i| directory + 2 + 12 * i)
            .find(|e| u16_at(*e) == tag)
            .map(|e| e + 8)
            .ok_or("a tag is missing")
    };
    let (width, height) = (u32_at(tag(256)?), u32_at(tag(257)?));
    ensure(u32_at(tag(279)?) == 4 * width * height, "the pixels are not all there")?;
    let (scale, tie) = (u32_at(tag(33550)?), u32_at(tag(33922)?));
    // The first frame's own place, and the last one's: both are on the mosaic, and as far apart as
    // they truly are.
    let mut shown = Vec::new();
    for frame in [&made.truth.frames[0], &made.truth.frames[21]] {
        let (latitude, longitude) = (
            ORIGIN.0 + frame.position[1] / M_PER_DEG,
            ORIGIN.1 + frame.position[0] / M_PER_DEG / ORIGIN.0.to_radians().cos(),
        );
        let (x, y) = (
            (longitude - f64_at(tie + 24)) / f64_at(scale),
            (f64_at(tie + 32) - latitude) / f64_at(scale + 8),
        );
        ensure(
            x > 0.0 && y > 0.0 && x < width as f64 && y < height as f64,
            format!("pixel {x:.0}, {y:.0} of {width}×{height}"),
        )?;
        let alpha = bytes[8 + 4 * (y as usize * width + x as usize) + 3];
        ensure(alpha == 255, "below the vehicle there is no floor")?;
        shown.push((x, y));
    }
    let metres = ((shown[1].0 - shown[0].0) * f64_at(scale) * ORIGIN.0.to_radians().cos())
        .hypot((shown[1].1 - shown[0].1) * f64_at(scale + 8))
        * M_PER_DEG;
    let (a, b) = (made.truth.frames[0].position, made.truth.frames[21].position);
    let ought = (b[0] - a[0]).hypot(b[1] - a[1]);
    ensure((metres / ought - 1.0).abs() < 1e-3, format!("{metres} m, not {ought}"))?;
    // A map north up: the same strip laid out by a program that knows degrees alone shows the same
    // floor at the same place.
    let options = Options::default();
    let mosaic = mosaic(
        &CorrectedLog::open(&log, &options)?,
        &MosaicOptions { is_georeferenced: true, ..MosaicOptions::default() },
        &options,
    )?;
    let place = mosaic.frames[0].world_from_body.translation.vector;
    let (u, v) = mosaic.grid.pixel([place.x, place.y]);
    let off = (u + 0.5 - shown[0].0).hypot(v + 0.5 - shown[0].1) * mosaic.grid.m_per_px;
    ensure(off < 0.05, format!("the map is {off:.3} m off"))
}

/// The stills are the log's own bytes, and the lists say of each where and when it was taken, by
/// the truth.
fn data_set_is_whole() -> Result<(), Failed> {
    let made = Corrected::get();
    let (log, folder, facts) =
        (made.path("exported.mcap"), made.path("data_set"), made.path("facts.toml"));
    with_fixes(&made.path("out.mcap"), &log, &made.truth)?;
    std::fs::write(
        &facts,
        "image-copyright = \"nobody\"\nimage-license = { name = \"CC0-1.0\" }\n",
    )?;
    let said = unwater(&["export", text(&log), "-o", text(&folder), "--facts", text(&facts)]);
    let words = String::from_utf8_lossy(&said.stderr);
    ensure(
        said.status.success() && words.contains("image-pi") && !words.contains("image-license"),
        words.as_ref(),
    )?;
    let ifdo: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("ifdo.json"))?)?;
    let (header, items) =
        (&ifdo["image-set-header"], ifdo["image-set-items"].as_object().ok_or("no items")?);
    ensure(
        header["image-license"]["name"] == "CC0-1.0"
            && header["image-set-ifdo-version"] == "v2.1.0",
        "the header",
    )?;
    ensure(items.len() == 22, format!("{} items", items.len()))?;
    let recording = Recording::open(&log)?;
    let topic = recording
        .channels
        .iter()
        .find(|(_, c)| c.topic == "/camera/image_corrected/compressed")
        .ok_or("no pictures")?
        .0;
    let pictures: Vec<Vec<u8>> = recording
        .messages(Window::ALL)
        .filter_map(|entry| {
            if let Entry::Message(m) = entry {
                (m.channel == *topic).then(|| m.data().to_vec())
            } else {
                None
            }
        })
        .collect();
    let table = std::fs::read_to_string(folder.join("images.csv"))?;
    let rows: Vec<Vec<&str>> =
        table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    ensure(
        rows.len() == 22 && pictures.len() == 22,
        format!("{} rows, {} pictures", rows.len(), pictures.len()),
    )?;
    for ((row, picture), frame) in rows.iter().zip(&pictures).zip(&made.truth.frames) {
        let still = std::fs::read(folder.join("images").join(row[0]))?;
        ensure(
            picture.windows(still.len()).any(|w| w == still),
            format!("{} is not the log's", row[0]),
        )?;
        let item = &items[row[0]];
        ensure(item["image-hash-sha256"] == unwater::session::sha256(&still), "the fingerprint")?;
        ensure(
            row[5] == frame.stamp_ns.to_string(),
            format!("{} is not of {}", row[5], frame.stamp_ns),
        )?;
        let above = item["image-meters-above-ground"].as_f64().ok_or("no height")?;
        ensure(
            (above - frame.plane_distance_m).abs() < 0.05,
            format!("{above} m, not {}", frame.plane_distance_m),
        )?;
        let north_m =
            (item["image-latitude"].as_f64().ok_or("no latitude")? - ORIGIN.0) * M_PER_DEG;
        ensure(
            (north_m - frame.position[1]).abs() < 0.01,
            format!("{north_m} m north, not {}", frame.position[1]),
        )?;
    }
    ensure(
        items.values().all(|i| {
            i["image-datetime"]
                .as_str()
                .is_some_and(|t| t.starts_with("2025-10-09 08:53:") && t.len() == 23)
        }),
        "a moment",
    )?;
    let again = unwater(&["export", text(&log), "-o", text(&folder)]);
    ensure(
        again.status.code() == Some(1)
            && String::from_utf8_lossy(&again.stderr).contains("--force"),
        "a folder in use is not refused",
    )
}

pub fn trials() -> Vec<Trial> {
    let data = std::env::var_os("UNWATER_DATA").map(PathBuf::from).filter(|d| d.is_dir());
    let has_chromium = has_chromium();
    let no_data = data.is_none();
    let data = data.unwrap_or_default();
    let trials = vec![
        Trial::test("look: the page says what it must", page_says_what_it_must),
        Trial::test("look: pages of poorer logs say why", || pages_of_poorer_logs().map(drop)),
        Trial::test("look: names are escaped", names_are_escaped),
        Trial::test("look: pages open in Chromium", pages_open).with_ignored_flag(!has_chromium),
        Trial::test("look: pages of the dives open in Chromium", move || {
            pages_of_dives_open(&data)
        })
        .with_ignored_flag(!has_chromium || no_data),
        Trial::test("look: the sheet is made", sheet_is_made),
        Trial::test(
            "look: the mosaic puts points where they are",
            mosaic_puts_points_where_they_are,
        ),
        Trial::test("look: the mosaic by shared points", mosaic_by_shared_points),
        Trial::test("look: the mosaic without a position", mosaic_without_a_position),
        Trial::test("look: the map is where it is", map_is_where_it_is),
        Trial::test("look: the data set is whole", data_set_is_whole),
    ];
    if !has_chromium {
        eprintln!(
            "Chromium, node or playwright-core is missing: the tests in a browser are skipped"
        );
    }
    trials
}
