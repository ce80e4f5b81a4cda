//! Reports, sheets, mosaics and data sets that are made from a corrected log.
use std::path::Path;

use img_parts::ImageEXIF as _;
use libtest_mimic::Failed;
use unwater::config::OutputConfig;
use unwater::diagnostics::MosaicFact;
use unwater::products::dive::CorrectedLog;
use unwater::products::mosaic::{Mosaic, MosaicOptions, mosaic};
use unwater::recording::{Entry, Output, Recording, Schema, Window};
use unwater::session::Options;

use crate::program::{CorrectedDive, pages_of_poorer_logs, ran, text, unwater};
use crate::support::ensure;
use crate::support::judge::assert_within;
use crate::support::render::{Dive, Truth};

#[test]
fn pages_of_poorer_logs_state_what_is_missing() -> Result<(), Failed> {
    pages_of_poorer_logs().map(drop)
}

/// The page holds every number it must, whole and harmless, and the same bytes for any number of
/// threads.
#[test]
fn page_holds_every_number_and_no_outside_reference() -> Result<(), Failed> {
    let made = CorrectedDive::get();
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

/// Names from a log are escaped: markup in them has no effect.
#[test]
fn names_in_pages_are_escaped() -> Result<(), Failed> {
    let made = CorrectedDive::get();
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

/// The sheet is an image of the right shape; frames that do not exist are an error.
#[test]
fn sheet_shows_a_frame_by_every_method() -> Result<(), Failed> {
    let made = CorrectedDive::get();
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
    let image = image::open(&sheet)?;
    ensure(
        image.width() > 1500 && image.height() > 1200,
        format!("{}×{}", image.width(), image.height()),
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
        "frame 9 by its time is another image",
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

fn laid(made: &CorrectedDive, asked: &MosaicOptions) -> Result<Mosaic, Failed> {
    let options = Options::default();
    Ok(mosaic(&CorrectedLog::open(&made.path("out.mcap"), &options)?, asked, &options)?)
}

/// Poses by DVL and attitude against the truth, and pixels of the strip against the seafloor's
/// reflectance at known points.
#[test]
fn mosaic_agrees_with_the_true_positions() -> Result<(), Failed> {
    let made = CorrectedDive::get();
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
    assert_within("mosaic: length, relative", a.norm() / b.norm() - 1.0, 1e-4);
    let turn = nalgebra::Rotation2::new(b.y.atan2(b.x) - a.y.atan2(a.x));
    let to_truth =
        |p: nalgebra::Vector2<f64>| turn * (p - own(0)) + place(made.truth.frames[0].position);
    for (k, truth) in made.truth.frames.iter().enumerate() {
        let off = (to_truth(own(k)) - place(truth.position)).norm();
        assert_within(&format!("mosaic: position of frame {k} [m]"), off, 0.0008);
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
    assert_within("mosaic: 1 − correlation with reflectance", 1.0 - correlation, 0.05);
    Ok(())
}

/// Without attitude and velocity, shared points alone must place the frames as far apart as they
/// were.
#[test]
fn mosaic_without_attitude_and_velocity_is_registered_by_keypoints() -> Result<(), Failed> {
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
        let expected = (b - a).xy().norm();
        assert_within("mosaic by keypoints: step [m]", step - expected, 0.0143);
    }
    Ok(())
}

/// Names that ask for a GeoTIFF need a position, and the log has none.
#[test]
fn geotiff_without_a_position_is_refused() -> Result<(), Failed> {
    let made = CorrectedDive::get();
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
/// The sea surface in the dive's world (m).
const SURFACE_M: f64 = 40.0;
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
        r#"{{"type":"object","properties":{{"header":{header},
        "latitude":{number},"longitude":{number}}}}}"#
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
    let depth = format!(r#"{{"type":"object","properties":{{"data":{number}}}}}"#);
    let depth = out.add_channel(
        "/depth",
        "json",
        &Schema {
            name: "std_msgs/msg/Float64".into(),
            encoding: "jsonschema".into(),
            data: depth.into_bytes(),
        },
    )?;
    for entry in log.messages(Window::ALL) {
        if let Entry::Message(message) = entry {
            out.copy_message(&message);
        }
    }
    for frame in &truth.frames {
        let below = format!(r#"{{"data":{}}}"#, SURFACE_M - frame.position[2]);
        out.write(depth, frame.stamp_ns, frame.stamp_ns, below.as_bytes());
        let (sec, nanosec) = (frame.stamp_ns / 1_000_000_000, frame.stamp_ns % 1_000_000_000);
        let (latitude, longitude) = (
            ORIGIN.0 + frame.position[1] / M_PER_DEG,
            ORIGIN.1 + frame.position[0] / M_PER_DEG / ORIGIN.0.to_radians().cos(),
        );
        let said = format!(
            r#"{{"header":{{"stamp":{{"sec":{sec},"nanosec":{nanosec}}}}},
            "latitude":{latitude:.12},"longitude":{longitude:.12}}}"#
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
#[test]
fn geotiff_tags_lead_to_the_right_pixel() -> Result<(), Failed> {
    let made = CorrectedDive::get();
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
        ensure(alpha == 255, "below the vehicle there is no seafloor")?;
        shown.push((x, y));
    }
    let metres = ((shown[1].0 - shown[0].0) * f64_at(scale) * ORIGIN.0.to_radians().cos())
        .hypot((shown[1].1 - shown[0].1) * f64_at(scale + 8))
        * M_PER_DEG;
    let (a, b) = (made.truth.frames[0].position, made.truth.frames[21].position);
    let expected = (b[0] - a[0]).hypot(b[1] - a[1]);
    assert_within("GeoTIFF: length, relative", metres / expected - 1.0, 1e-5);
    // A map north up: the same strip laid out by a program that uses degrees only shows the
    // same seafloor at the same position.
    let options = Options::default();
    let mosaic = mosaic(
        &CorrectedLog::open(&log, &options)?,
        &MosaicOptions { is_georeferenced: true, ..MosaicOptions::default() },
        &options,
    )?;
    let place = mosaic.frames[0].world_from_body.translation.vector;
    let (u, v) = mosaic.grid.pixel([place.x, place.y]);
    let off = (u + 0.5 - shown[0].0).hypot(v + 0.5 - shown[0].1) * mosaic.grid.m_per_px;
    assert_within("GeoTIFF and map: position [m]", off, 0.0004);
    Ok(())
}

/// All that a log does not know.
const FACTS: &str = r#"
image-context = { name = "tests" }
image-project = { name = "unwater" }
image-event = { name = "dive 1" }
image-platform = { name = "a renderer" }
image-pi = { name = "nobody", uri = "https://orcid.org/0000-0000-0000-0000" }
image-creators = [{ name = "nobody" }]
image-license = { name = "CC0-1.0", uri = "https://creativecommons.org/publicdomain/zero/1.0/" }
image-copyright = "none"
image-abstract = "A dive that was rendered."
image-coordinate-uncertainty-meters = 0.1
"#;

/// Depth, angles and the lists of other programs, against the truth.
fn agrees_with_truth(
    folder: &Path,
    items: &serde_json::Map<String, serde_json::Value>,
    truth: &Truth,
) -> Result<(), Failed> {
    let read = |name: &str| std::fs::read_to_string(folder.join(name));
    let [biigle, squidle, reference, geo] =
        ["images.csv", "squidle.csv", "reference.csv", "geo.txt"].map(read);
    let (biigle, squidle, reference, geo) = (biigle?, squidle?, reference?, geo?);
    ensure(geo.starts_with("EPSG:4326\n"), "geo.txt has no projection")?;
    ensure(reference.starts_with("label,longitude,latitude,altitude,yaw"), "reference.csv")?;
    let track: serde_json::Value = serde_json::from_str(&read("track.geojson")?)?;
    let line = &track["features"][0]["geometry"]["coordinates"];
    let images = read("colmap/images.txt")?;
    let poses: Vec<Vec<&str>> = images
        .lines()
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map(|line| line.split(' ').collect())
        .collect();
    ensure(poses.len() == truth.frames.len(), format!("{} poses", poses.len()))?;
    let center = |pose: &[&str]| -> Option<[f64; 3]> {
        let n: Vec<f64> = pose[1..8].iter().filter_map(|v| v.parse().ok()).collect();
        let [w, x, y, z, a, b, c] = n[..] else { return None };
        let q = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        Some((-(q.inverse() * nalgebra::Vector3::new(a, b, c))).into())
    };
    let first = center(&poses[0]).ok_or("no pose")?;
    for (k, (pose, frame)) in poses.iter().zip(&truth.frames).enumerate() {
        let item = &items[pose[9]];
        let number = |key: &str| item[key].as_f64().ok_or(format!("no {key}"));
        let q = frame.orientation_xyzw;
        let world_from_base = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
            q[3], q[0], q[1], q[2],
        ));
        let depth = SURFACE_M - frame.position[2];
        assert_within("data set: depth [m]", -number("image-altitude-meters")? - depth, 0.001);
        // Forward of the vehicle is the top of its images.
        let ahead = world_from_base * nalgebra::Vector3::x();
        let heading = ahead.x.atan2(ahead.y).to_degrees();
        let off = (number("image-camera-yaw-degrees")? - heading + 540.0).rem_euclid(360.0) - 180.0;
        assert_within("data set: yaw [°]", off, 3.0);
        // Positions by dead reckoning, from the first frame on.
        let at = center(pose).ok_or("no pose")?;
        let start = truth.frames[0].position;
        let moved = (0..2).map(|k| (at[k] - first[k] - frame.position[k] + start[k]).powi(2));
        assert_within("data set: COLMAP position [m]", moved.sum::<f64>().sqrt(), 0.25);
        // The same in every list.
        let latitude = item["image-latitude"].to_string();
        for list in [&biigle, &squidle, &reference, &geo] {
            let row = list.lines().nth(k + 1).ok_or("a row is missing")?;
            ensure(row.contains(pose[9]) && row.contains(&latitude), row.to_string())?;
        }
        ensure(line[k][1] == item["image-latitude"], "track.geojson")?;
    }
    let cameras = read("colmap/cameras.txt")?;
    ensure(cameras.lines().any(|l| l.starts_with("1 ")), cameras.clone())?;
    ensure(read("colmap/points3D.txt")?.starts_with('#'), "points3D.txt")
}

/// A JPEG without its EXIF.
fn without_exif(file: &[u8]) -> Result<Vec<u8>, Failed> {
    let mut jpeg = img_parts::jpeg::Jpeg::from_bytes(file.to_vec().into())?;
    jpeg.set_exif(None);
    Ok(jpeg.encoder().bytes().to_vec())
}

/// EXIF, by an independent reader, says what the record says.
fn exif_agrees(file: &[u8], item: &serde_json::Value) -> Result<(), Failed> {
    let exif = exif::Reader::new().read_from_container(&mut std::io::Cursor::new(file))?;
    let field = |tag| exif.get_field(tag, exif::In::PRIMARY).ok_or(format!("no {tag}"));
    let text = |tag| match &field(tag)?.value {
        exif::Value::Ascii(parts) => Ok(String::from_utf8_lossy(&parts.concat()).into_owned()),
        other => Err(format!("{tag} is {other:?}")),
    };
    let numbers = |tag| match &field(tag)?.value {
        exif::Value::Rational(parts) => {
            Ok(parts.iter().map(exif::Rational::to_f64).collect::<Vec<_>>())
        }
        other => Err(format!("{tag} is {other:?}")),
    };
    let said = |key: &str| item[key].as_f64().ok_or(format!("no {key}"));
    let moment = format!(
        "{}.{}",
        text(exif::Tag::DateTimeOriginal)?.replacen(':', "-", 2),
        text(exif::Tag::SubSecTimeOriginal)?
    );
    ensure(item["image-datetime"] == moment, moment)?;
    ensure(text(exif::Tag::OffsetTimeOriginal)? == "+00:00", "the zone")?;
    let id = item["image-uuid"].as_str().ok_or("no UUID")?.replace('-', "");
    ensure(text(exif::Tag::ImageUniqueID)? == id, id)?;
    for (tag, key) in
        [(exif::Tag::GPSLatitude, "image-latitude"), (exif::Tag::GPSLongitude, "image-longitude")]
    {
        let [degrees, minutes, seconds] = numbers(tag)?[..] else { return Err("an angle".into()) };
        let angle = degrees + minutes / 60.0 + seconds / 3600.0;
        assert_within("EXIF: an angle [°]", angle - said(key)?.abs(), 1e-9);
    }
    let depth_m = numbers(exif::Tag::GPSAltitude)?[0];
    assert_within("EXIF: depth [m]", depth_m + said("image-altitude-meters")?, 0.001);
    ensure(field(exif::Tag::GPSAltitudeRef)?.value.get_uint(0) == Some(1), "below the surface")?;
    let distance_m = numbers(exif::Tag::SubjectDistance)?[0];
    assert_within("EXIF: distance [m]", distance_m - said("image-meters-above-ground")?, 0.001);
    let heading = numbers(exif::Tag::GPSImgDirection)?[0] - said("image-camera-yaw-degrees")?;
    assert_within("EXIF: heading [°]", (heading + 180.0).rem_euclid(360.0) - 180.0, 0.001);
    Ok(())
}

/// The stills are the log's own bytes, and the lists say of each where and when it was taken, by
/// the truth.
#[test]
fn exported_data_set_is_complete() -> Result<(), Failed> {
    let made = CorrectedDive::get();
    let (log, folder, facts) =
        (made.path("exported.mcap"), made.path("data_set"), made.path("facts.toml"));
    with_fixes(&made.path("out.mcap"), &log, &made.truth)?;
    // A record is refused by the names of what it lacks, before anything is written.
    std::fs::write(&facts, "image-license = { name = \"CC0-1.0\" }\n")?;
    let export = ["export", text(&log), "-o", text(&folder), "--facts", text(&facts)];
    let said = unwater(&export);
    let words = String::from_utf8_lossy(&said.stderr);
    ensure(
        said.status.code() == Some(2)
            && words.contains("image-pi")
            && words.contains("image-handle")
            && !words.contains("image-license")
            && !words.contains("image-latitude")
            && !words.contains("image-altitude-meters")
            && !folder.exists(),
        words.as_ref(),
    )?;
    std::fs::write(&facts, FACTS)?;
    let handle = ["--handle-prefix", "https://hdl.handle.net/20.500.12085/"];
    let said = unwater(&[&export[..], &handle].concat());
    let words = String::from_utf8_lossy(&said.stderr);
    ensure(said.status.success() && words.is_empty(), words.as_ref())?;
    let ifdo: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("ifdo.json"))?)?;
    let (header, items) =
        (&ifdo["image-set-header"], ifdo["image-set-items"].as_object().ok_or("no items")?);
    ensure(
        header["image-license"]["name"] == "CC0-1.0"
            && header["image-set-ifdo-version"] == "v2.2.1"
            && header["image-photometric-calibration"].as_object().is_some_and(|p| p.len() == 8),
        "the header",
    )?;
    let handle = |uuid: &serde_json::Value| {
        let uuid = uuid.as_str().unwrap_or_default();
        let is_version_4 =
            uuid.len() == 36 && &uuid[14..15] == "4" && "89ab".contains(&uuid[19..20]);
        is_version_4.then(|| format!("https://hdl.handle.net/20.500.12085/{uuid}"))
    };
    for (at, uuid) in [(&header["image-set-handle"], &header["image-set-uuid"])]
        .into_iter()
        .chain(items.values().map(|item| (&item["image-handle"], &item["image-uuid"])))
    {
        ensure(at.as_str().is_some() && at.as_str() == handle(uuid).as_deref(), format!("{at}"))?;
    }
    agrees_with_truth(&folder, items, &made.truth)?;
    ensure(items.len() == 22, format!("{} items", items.len()))?;
    let recording = Recording::open(&log)?;
    let topic = recording
        .channels
        .iter()
        .find(|(_, c)| c.topic == "/camera/image_corrected/compressed")
        .ok_or("no images")?
        .0;
    let images: Vec<Vec<u8>> = recording
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
        rows.len() == 22 && images.len() == 22,
        format!("{} rows, {} images", rows.len(), images.len()),
    )?;
    for ((row, image), frame) in rows.iter().zip(&images).zip(&made.truth.frames) {
        let still = std::fs::read(folder.join("images").join(row[0]))?;
        let item = &items[row[0]];
        let bare = without_exif(&still)?;
        ensure(
            image.windows(bare.len()).any(|w| w == bare),
            format!("{} is not the log's", row[0]),
        )?;
        exif_agrees(&still, item)?;
        ensure(item["image-hash-sha256"] == unwater::session::sha256(&still), "the fingerprint")?;
        ensure(
            row[5] == frame.stamp_ns.to_string(),
            format!("{} is not of {}", row[5], frame.stamp_ns),
        )?;
        let above = item["image-meters-above-ground"].as_f64().ok_or("no height")?;
        assert_within("data set: altitude [m]", above - frame.plane_distance_m, 0.0081);
        let north_m =
            (item["image-latitude"].as_f64().ok_or("no latitude")? - ORIGIN.0) * M_PER_DEG;
        assert_within("data set: north [m]", north_m - frame.position[1], 1e-5);
    }
    ensure(
        items.values().all(|i| {
            i["image-datetime"]
                .as_str()
                .is_some_and(|t| t.starts_with("2025-10-09 08:53:") && t.len() == 23)
        }),
        "a moment",
    )?;
    // Back again: EXIF has what the table leaves out.
    let short: String = rows.iter().fold("filename,distance_to_ground\n".into(), |text, row| {
        format!("{text}{},{}\n", row[0], row[4])
    });
    std::fs::write(made.path("short.csv"), short)?;
    let stills = folder.join("images");
    let imported = |table: &Path, name: &str| -> Result<Vec<(String, u64)>, Failed> {
        let log = made.path(name);
        ran(&["import", text(&stills), "--table", text(table), "-o", text(&log)])?;
        let recording = Recording::open(&log)?;
        let messages = recording.messages(Window::ALL).filter_map(|entry| match entry {
            Entry::Message(m) => Some((recording.channels[&m.channel].topic.clone(), m.log_time)),
            Entry::Damaged(_) => None,
        });
        Ok(messages.collect())
    };
    let by_table = imported(&folder.join("images.csv"), "by_table.mcap")?;
    let by_exif = imported(&made.path("short.csv"), "by_exif.mcap")?;
    ensure(by_table == by_exif && by_exif.len() > 4 * rows.len(), format!("{by_exif:?}"))?;
    // Without facts there are lists and no record.
    let bare = made.path("bare_data_set");
    let said = unwater(&["export", text(&log), "-o", text(&bare)]);
    let words = String::from_utf8_lossy(&said.stderr);
    ensure(said.status.success() && words.contains("image-pi"), words.as_ref())?;
    ensure(!bare.join("ifdo.json").exists() && bare.join("images.csv").exists(), "a record")?;
    let again = unwater(&["export", text(&log), "-o", text(&folder)]);
    ensure(
        again.status.code() == Some(1)
            && String::from_utf8_lossy(&again.stderr).contains("--force"),
        "a folder in use is not refused",
    )
}
