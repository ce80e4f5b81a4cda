//! Corrected images as measurements: pixel values convert back to reflectance, and what is not
//! reliable is marked and counted.
use std::path::Path;

use crate::support::judge::{assert_within, images, run_and_show, shown_again, unbend};
use crate::support::render::Dive;
use unwater::config::{ImageFormat, Look, Method};
use unwater::image::LinearImage;
use unwater::image::tone::ContrastCurve;
use unwater::products::data_set::{Archive, export};
use unwater::products::dive::CorrectedLog;
use unwater::run::{correct, estimate_logs};
use unwater::session::{Options, Silent};

fn dive() -> Dive {
    Dive { seed: 161, frames: 14, ..Dive::default() }
}

/// Much of the image above the shoulder: 16 bits stay proportional, 8 bits convert to the same
/// light.
#[test]
fn pixel_values_convert_to_reflectance_also_above_the_shoulder() {
    let folder = tempfile::tempdir().unwrap();
    let mut options = Options::default();
    (options.config.render.highlight_quantile, options.config.render.highlight_level) = (0.9, 0.95);
    let (verdict, truth, deep) = run_and_show(&dive(), &options, folder.path());
    let rendering = &verdict.model.rendering;
    assert_eq!(rendering.shoulder_from, Some(0.75));

    let mut eight = options.clone();
    eight.config.render.image_format = ImageFormat::Png;
    let bent = shown_again(&verdict.model, &eight, folder.path());
    let mut light = bent.clone();
    unbend(&mut light, 0.75);
    let above = |images: &[LinearImage], from: f32| {
        images.iter().flat_map(|p| &p.pixels).filter(|v| **v > from).count()
    };
    assert!(
        above(&bent, 0.76) > 20_000 && above(&bent, 0.999) < above(&deep, 0.999) / 5,
        "highlights are bent, not cut"
    );
    let (mut worst, mut moved) = (0f32, 0f32);
    for (is, shown, expected) in light
        .iter()
        .zip(&bent)
        .zip(&deep)
        .flat_map(|((l, b), d)| l.pixels.iter().zip(&b.pixels).zip(&d.pixels))
        .map(|((l, b), d)| (l, b, d))
    {
        if (0.1..0.99).contains(expected) {
            worst = worst.max((is / expected - 1.0).abs());
            moved = moved.max((shown / expected - 1.0).abs());
        }
    }
    assert_within("highlights decoded: pixel, relative", f64::from(worst), 0.0178);
    assert!(moved > 0.07, "the shoulder changes pixels by {moved} only");

    // The natural look is another curve of the same light.
    let median = |band: usize| rendering.gain[band] * rendering.median_reflectance[band];
    let curve = ContrastCurve::about((0..3).map(median).sum::<f64>() / 3.0);
    let mut natural = eight;
    natural.config.render.look = Look::Natural;
    let shown = shown_again(&verdict.model, &natural, folder.path());
    let light = |y: f64| {
        let ContrastCurve { exponent, half, white } = curve;
        (half * y / (1.0 + half / white.powf(exponent) - y)).powf(1.0 / exponent)
    };
    let pairs = || shown.iter().flat_map(|p| &p.pixels).zip(deep.iter().flat_map(|p| &p.pixels));
    let off: Vec<f64> = pairs()
        .filter(|(_, x)| (0.1..0.99).contains(*x))
        .map(|(y, x)| (light(f64::from(*y)) / f64::from(*x) - 1.0).abs())
        .collect();
    let worst = off.iter().copied().fold(0.0, f64::max);
    assert!(off.len() > 20_000);
    assert_within("natural look decoded: pixel, relative", worst, 0.0178);

    // The stated gain: divided by it, light is reflectance but for one factor, and the log's own
    // scale.
    let ratio = |frame: usize, band: usize| {
        let mut ratios: Vec<f64> = deep[frame]
            .pixels
            .iter()
            .skip(band)
            .step_by(3)
            .zip(&truth.frames[frame].reflectance)
            .filter(|(v, _)| **v < 0.99)
            .map(|(v, r)| f64::from(*v) / rendering.gain[band] / f64::from(r[band]))
            .collect();
        crate::support::judge::median(&mut ratios)
    };
    // The strobe is white here, so the bands agree too, as far as α does.
    let all: Vec<f64> = (0..deep.len())
        .flat_map(|f| (0..3).map(move |b| (f, b)))
        .map(|(f, b)| ratio(f, b))
        .collect();
    let (min, max) = all.iter().fold((f64::INFINITY, 0f64), |(l, m), v| (l.min(*v), m.max(*v)));
    assert_within("corrected light over reflectance: range", max / min - 1.0, 0.0512);

    // 16 bits know nothing of the shoulder.
    let mut cut = options;
    (cut.config.render.depth, cut.config.render.shoulder_from) = (16, 1.0);
    assert!(shown_again(&verdict.model, &cut, folder.path()) == deep);
}

fn mask_of(folder: &Path, options: &Options) -> (unwater::report::Report, Vec<LinearImage>) {
    let options = Options { force: true, ..options.clone() };
    let output = folder.join("masked.mcap");
    let (report, _) = correct(&folder.join("dive.mcap"), &output, None, &options, &Silent).unwrap();
    (report, images(&output, "/unwater/mask/compressed"))
}

#[test]
fn mask_and_report_agree() {
    let folder = tempfile::tempdir().unwrap();
    dive().write(&folder.path().join("dive.mcap"));
    let mut options = Options::default();
    assert!(mask_of(folder.path(), &options).1.is_empty(), "no mask unless it is asked for");
    // A mosaic from 8-bit codes: bits come back as codes through the sRGB curve.
    options.config.render.mask = true;
    options.config.render.gain_signal_to_noise = 400.0;
    options.config.estimate.clipped_above = 0.6;
    for rectify in [false, true] {
        options.config.render.rectify = rectify;
        let (report, masks) = mask_of(folder.path(), &options);
        assert_eq!(masks.len(), dive().frames);
        assert_eq!(
            (masks[0].width, masks[0].height, masks[0].bands),
            (dive().width, dive().height, 1)
        );
        let codes: Vec<u8> = masks
            .iter()
            .flat_map(|m| &m.pixels)
            .map(|v| (unwater::image::transfer::srgb_encode(f64::from(*v)) * 255.0).round() as u8)
            .collect();
        let share =
            |bit: u8| codes.iter().filter(|c| **c & bit != 0).count() as f64 / codes.len() as f64;
        let capped = report.mean_shares["gain_capped"];
        assert!(capped > 0.1 && (share(2) / capped - 1.0).abs() < 0.05, "{} {capped}", share(2));
        let clipped = report.mean_shares["clipped_input"];
        assert!(
            clipped > 0.001 && share(1) > clipped && share(1) < 25.0 * clipped,
            "{} {clipped}",
            share(1)
        );
        // Counted on nodes, of which the last lie beyond the edge.
        let unseen = report.mean_shares["unseen_beam"];
        assert!((share(8) - unseen).abs() < 0.01 + 0.15 * unseen, "{} {unseen}", share(8));
        assert!(share(4) == 0.0 && share(16) < 0.02, "{} {}", share(4), share(16));
        assert!(codes.iter().all(|c| *c < 32) && codes.contains(&0));
        // For COLMAP: clipped, capped, off the seafloor or outside is left out.
        let exported: Vec<u8> = colmap_masks(folder.path()).into_iter().flatten().collect();
        let is_left_out = |code: &u8| code & (1 | 2 | 4 | 16) != 0;
        assert!(codes.iter().map(|c| if is_left_out(c) { 0 } else { 255 }).eq(exported));
    }
}

/// Of the masked log, by an export of it, in the order of the dive.
fn colmap_masks(folder: &Path) -> Vec<Vec<u8>> {
    let log = CorrectedLog::open(&folder.join("masked.mcap"), &Options::default()).unwrap();
    let data_set = tempfile::tempdir().unwrap();
    let archive = Archive::default();
    export(&log, &log.cameras[0], &archive, data_set.path(), &Silent).unwrap();
    let stills = std::fs::read_dir(data_set.path().join("images")).unwrap();
    let mut names: Vec<_> = stills.map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    let masks = data_set.path().join("colmap/masks");
    let mask = |name: std::ffi::OsString| {
        let path = masks.join(format!("{}.png", name.into_string().unwrap()));
        image::open(path).unwrap().into_luma8().into_raw()
    };
    names.into_iter().map(mask).collect()
}

/// Fewer electrons, more noise: what is too near to it is counted, also without anyone's data
/// sheet.
#[test]
fn pixels_close_to_the_noise_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    dive().write(&folder.path().join("dive.mcap"));
    let low = |rig: &str| {
        let options = Options { rig: toml::from_str(rig).unwrap(), ..Options::default() };
        mask_of(folder.path(), &options).0.mean_shares["low_signal"]
    };
    let (unknown, known, starved) = (
        low(""),
        low("[camera]\nfull_well_e = 15000.0\nread_noise_e = 5.0\n"),
        low("[camera]\nfull_well_e = 600.0\n"),
    );
    assert!(
        unknown < 0.05 && unknown < known && known + 0.1 < starved && starved < 1.0,
        "{unknown} {known} {starved}"
    );
}

/// The samples of an estimate are without backscatter. A method that leaves it in the images gets
/// its exposure from what it leaves, in a run of its own as with a given model.
#[test]
fn exposure_is_of_what_the_method_leaves() {
    let folder = tempfile::tempdir().unwrap();
    let [log, out] = ["dive.mcap", "out.mcap"].map(|name| folder.path().join(name));
    let small = Dive { frames: 20, width: 288, height: 216, focal_px: 340.0, ..Dive::default() };
    Dive { seed: 101, backscatter: 0.2, ..small }.write(&log);
    let (full, _) = estimate_logs(&[&log], &Options::default(), &Silent).unwrap();
    assert!(full.backscatter.is_some());
    let mut options = Options::default();
    options.config.render.method = Method::BeamPattern;
    let (own, _) = estimate_logs(&[&log], &options, &Silent).unwrap();
    let (_, given) = correct(&log, &out, Some(full), &options, &Silent).unwrap();
    assert_eq!(own.rendering.gain, given.rendering.gain);
    assert_eq!(own.rendering.median_reflectance, given.rendering.median_reflectance);
}
