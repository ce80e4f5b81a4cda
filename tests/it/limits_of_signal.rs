//! Where light is short: colours without signal are not invented, noise is bounded, nothing that
//! has signal becomes darker, and clipped highlights are not tinted.
use std::path::Path;

use crate::support::colour::{delta_e, lab};
use crate::support::judge::{assert_within, blocks, images, median, run_and_show, shown_again};
use crate::support::render::{Dive, Sensor};
use crate::support::same_point::Ground;
use unwater::image::LinearImage;
use unwater::session::Options;

/// The sensor of the renderer.
const SENSOR: &str = "[camera]\nfull_well_e = 15000.0\nread_noise_e = 8.0\n";

fn raw_images(folder: &Path) -> Vec<LinearImage> {
    images(&folder.join("dive.mcap"), "/camera/image_raw")
}

/// The far frames of such a dive need many times the median gain, and have signal for it.
#[test]
fn a_clear_dive_over_a_wide_range_of_altitudes_is_even() {
    let folder = tempfile::tempdir().unwrap();
    let dive = Dive { seed: 181, frames: 30, altitude_m: (1.2, 4.5), ..Dive::default() };
    let (v, truth, shown) = run_and_show(&dive, &Options::default(), folder.path());
    let raw = raw_images(folder.path());
    let evenness = Ground::of(&dive, &truth, &raw).shown(&dive, &truth, &shown).evenness;
    assert_within("clear dive, 1.2 to 4.5 m: flat", evenness.flat - 1.0, 0.03);
    assert_within("clear dive, 1.2 to 4.5 m: brightness", evenness.cv, 0.02);
    let limited = v.report.mean_shares["gain_capped"];
    assert_within("clear dive, 1.2 to 4.5 m: gain limited", limited, 0.02);
}

/// Turbid water: red is lost in the highest frames.
#[test]
fn noise_is_bounded_and_colour_is_not_invented() {
    let folder = tempfile::tempdir().unwrap();
    let options = Options { rig: toml::from_str(SENSOR).unwrap(), ..Options::default() };
    let dive = Dive {
        seed: 182,
        frames: 26,
        attenuation_per_m: [0.42, 0.2, 0.16],
        altitude_m: (1.4, 4.0),
        sensor: Sensor::Rgb16,
        ..Dive::default()
    };
    let (v, truth, noisy) = run_and_show(&dive, &options, folder.path());
    let mut masked = options.clone();
    (masked.config.render.depth, masked.config.render.mask) = (16, true);
    shown_again(&v.model, &masked, folder.path());
    let masks = images(&folder.path().join("dive.again.mcap"), "/unwater/mask/compressed");
    let clean_folder = tempfile::tempdir().unwrap();
    Dive { noise: false, ..dive.clone() }.write(&clean_folder.path().join("dive.mcap"));
    let clean = shown_again(&v.model, &masked, clean_folder.path());

    let altitude = |k: usize| truth.frames[k].plane_distance_m;
    let mut order: Vec<usize> = (0..noisy.len()).collect();
    order.sort_by(|a, b| altitude(*a).total_cmp(&altitude(*b)));
    let middle = order[order.len() / 2];
    let far = *order.last().unwrap();
    // Robust deviation of what noise changes in a band.
    let noise = |k: usize, band: usize| {
        let pixels = noisy[k].pixels.iter().zip(&clean[k].pixels);
        let mut off: Vec<f64> =
            pixels.skip(band).step_by(3).map(|(a, b)| f64::from((a - b).abs())).collect();
        1.4826 * median(&mut off)
    };
    for band in 0..3 {
        let (near, far) = (noise(middle, band), noise(far, band));
        assert_within("noise, highest frame over a middle one", far / near.max(1e-6), 3.0);
    }
    // Blocks are right in the mean, or marked.
    let of = |at: &dyn Fn(usize, usize, usize) -> f32| {
        let [r, g, b] =
            [0, 1, 2].map(|band| blocks(dive.width, dive.height, |x, y| f64::from(at(x, y, band))));
        r.into_iter().zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect::<Vec<_>>()
    };
    let expected =
        |k: usize| of(&|x, y, band| truth.frames[k].reflectance[y * dive.width + x][band]);
    let gain = [0, 1, 2].map(|band| {
        let (is, ought) = (of(&|x, y, b| noisy[middle].at(x, y)[b]), expected(middle));
        median(&mut is.iter().zip(&ought).map(|(i, o)| o[band] / i[band]).collect::<Vec<_>>())
    });
    let is = of(&|x, y, band| noisy[far].at(x, y)[band] * gain[band] as f32);
    let marked =
        blocks(dive.width, dive.height, |x, y| f64::from(u8::from(masks[far].at(x, y)[0] > 0.0)));
    let mean = |colours: &mut dyn Iterator<Item = [f64; 3]>| {
        let (sum, n) = colours
            .fold(([0.0; 3], 0.0), |(s, n), c| ([s[0] + c[0], s[1] + c[1], s[2] + c[2]], n + 1.0));
        sum.map(|s| s / n)
    };
    let good = |c: &(usize, [f64; 3])| marked[c.0] == 0.0;
    let shown = mean(&mut is.iter().copied().enumerate().filter(good).map(|(_, c)| c));
    let truly = mean(&mut expected(far).into_iter().enumerate().filter(good).map(|(_, c)| c));
    let share = marked.iter().filter(|m| **m > 0.0).count() as f64 / marked.len() as f64;
    println!("far frame at {:.2} m: {share:.2} marked", altitude(far));
    assert!(v.report.mean_shares["gain_capped"] > 0.001, "nothing is limited");
    if share < 0.95 {
        assert_within("mean colour, not marked", delta_e(lab(shown), lab(truly)), 3.0);
    }
    // What is marked is not saturated.
    let grey = mean(&mut is.iter().copied().enumerate().filter(|c| !good(c)).map(|(_, c)| c));
    let chroma = grey.iter().fold(0.0f64, |m, v| m.max((v / grey[1]).ln().abs()));
    assert_within("mean colour, marked: log of the largest ratio", chroma, 0.35);
}

/// An exposure that clips green and blue on pale seafloor.
#[test]
fn clipped_highlights_are_neutral() {
    let folder = tempfile::tempdir().unwrap();
    let mut options = Options::default();
    options.config.estimate.clipped_above = 0.5;
    (options.config.render.highlight_level, options.config.render.shoulder_from) = (0.4, 1.0);
    let dive = Dive { seed: 183, frames: 14, sensor: Sensor::Rgb16, ..Dive::default() };
    dive.write(&folder.path().join("dive.mcap"));
    // Full scale of the sensor at half of the light.
    let pixels = 6 * dive.width * dive.height;
    crate::support::transcode::with_pixels(
        &folder.path().join("dive.mcap"),
        "/camera/image_raw",
        pixels,
        |codes| {
            for code in codes.chunks_exact_mut(2) {
                let value = u16::from_le_bytes([code[0], code[1]]).min(0x8000);
                code.copy_from_slice(&value.to_le_bytes());
            }
        },
    );
    let (input, output) = (folder.path().join("dive.mcap"), folder.path().join("out.mcap"));
    options.config.render.depth = 16;
    let (report, model) =
        unwater::run::correct(&input, &output, None, &options, &unwater::session::Silent).unwrap();
    let shown = images(&output, &report.corrected_topic);
    let raw = raw_images(folder.path());
    let (mut clipped, mut tinted) = (0, 0);
    for (shown, raw) in shown.iter().zip(&raw) {
        for (s, r) in shown.pixels.chunks_exact(3).zip(raw.pixels.chunks_exact(3)) {
            // Green and blue are only known to be bright; red is known.
            if r[1] >= 0.5 && r[2] >= 0.5 && r[0] < 0.5 {
                clipped += 1;
                tinted += usize::from(s[0] > 1.02 * s[1].min(s[2]));
            }
        }
    }
    assert!(clipped > 500, "only {clipped} pixels are clipped");
    assert_eq!(tinted, 0, "of {clipped} pixels; gain {:?}", model.rendering.gain);
    let restored = report.mean_shares["restored_highlights"];
    assert!(restored > 1e-5 && restored <= report.mean_shares["clipped_input"], "{restored}");
}
