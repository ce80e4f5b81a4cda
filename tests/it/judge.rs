//! The judge's own instruments: colour differences against published pairs, and points of the
//! seafloor against the renderer.
use crate::support::colour::{delta_e, lab};
use crate::support::judge::assert_within;
use crate::support::render::Dive;
use crate::support::same_point::Ground;
use unwater::image::LinearImage;

/// Pairs of table 1 of Sharma, Wu & Dalal 2005: those about hue's seam, its mean and its rotation
/// term.
#[test]
fn colour_differences_match_published_pairs() {
    let pairs = [
        ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
        ([50.0, -1.3802, -84.2814], [50.0, 0.0, -82.7485], 1.0000),
        ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
        ([50.0, 2.49, -0.001], [50.0, -2.49, 0.0009], 7.1792),
        ([50.0, 2.49, -0.001], [50.0, -2.49, 0.0011], 7.2195),
        ([50.0, -0.001, 2.49], [50.0, 0.0011, -2.49], 4.7461),
        ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
        ([50.0, 2.5, 0.0], [61.0, -5.0, 29.0], 22.8977),
        ([50.0, 2.5, 0.0], [58.0, 24.0, 15.0], 19.4535),
        ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
        ([22.7233, 20.0904, -46.694], [23.0331, 14.973, -42.5619], 2.0373),
        ([2.0776, 0.0795, -1.135], [0.9033, -0.0636, -0.5514], 0.9082),
    ];
    for (one, other, expected) in pairs {
        assert!(
            (delta_e(one, other) - expected).abs() < 1e-4,
            "{one:?} {other:?}: {} for {expected}",
            delta_e(one, other)
        );
        assert!((delta_e(other, one) - expected).abs() < 1e-4, "it is the same both ways");
    }
    // scikit-image: rgb2lab of linear 0.2, 0.4, 0.1 (xyz2lab, D65).
    for (is, expected) in lab([0.2, 0.4, 0.1]).iter().zip(LAB) {
        assert!((is - expected).abs() < 2e-3, "{is} {expected}");
    }
}

const LAB: [f64; 3] = [64.62885, -29.95136, 36.51406];

/// The true reflectance at one point is the same in all frames; a shift of a few pixels would be
/// seen.
#[test]
fn one_seafloor_point_is_found_in_all_frames() {
    let dive = Dive { seed: 5, frames: 10, slope_deg: (6.0, -4.0), ..Dive::default() };
    let folder = tempfile::tempdir().unwrap();
    let truth = dive.write(&folder.path().join("dive.mcap"));
    let image = |shift: usize| -> Vec<LinearImage> {
        let of = |(k, f): (usize, &crate::support::render::FrameTruth)| {
            let mut image = LinearImage::new(dive.width, dive.height, 3);
            let pixels = dive.width * dive.height;
            for (i, pixel) in image.pixels.chunks_exact_mut(3).enumerate() {
                // Every other frame looks aside.
                pixel.copy_from_slice(&f.reflectance[(i + shift * (k % 2)) % pixels]);
            }
            image
        };
        truth.frames.iter().enumerate().map(of).collect()
    };
    let right = image(0);
    let ground = Ground::of(&dive, &truth, &right);
    let (of_truth, aside) =
        (ground.shown(&dive, &truth, &right), ground.shown(&dive, &truth, &image(3)));
    for scatter in &of_truth.scatter {
        assert_within("true reflectance at one point: scatter", *scatter, 0.00105);
    }
    assert!(of_truth.delta_e_95 < 1e-6, "{}", of_truth.delta_e_95);
    assert!(
        aside.scatter.iter().zip(&of_truth.scatter).all(|(a, b)| *a > 2.0 * b),
        "{:.4?} {:.4?}",
        aside.scatter,
        of_truth.scatter
    );
}

/// Brightness that grows by 10 % a frame, red that alternates by ±6 %, a right third that is 30 %
/// too bright.
#[test]
fn evenness_is_measured_over_image_and_log() {
    let (frames, width, height) = (6, 96, 72);
    let dive = Dive { frames, width, height, focal_px: 115.0, ..Dive::default() };
    let folder = tempfile::tempdir().unwrap();
    let truth = dive.write(&folder.path().join("dive.mcap"));
    let shown = |k: usize, x: usize, band: usize| {
        let hue = if band == 0 { 0.06 * (-1.0_f64).powi(k as i32) } else { 0.0 };
        (0.1 * k as f64 + hue).exp() * if x >= 64 { 0.13 } else { 0.1 }
    };
    let image = |k: usize| {
        let mut image = LinearImage::new(width, height, 3);
        for (i, value) in image.pixels.iter_mut().enumerate() {
            let reflectance = truth.frames[k].reflectance[i / 3][i % 3];
            *value = reflectance * shown(k, i / 3 % width, i % 3) as f32;
        }
        image
    };
    let images: Vec<LinearImage> = (0..frames).map(image).collect();
    let is = Ground::of(&dive, &truth, &images).shown(&dive, &truth, &images).evenness;
    // Of 0 to 5 the standard deviation is the root of 35/12; a third of red is in the mean.
    let cv = (0.01 * 35.0 / 12.0 + 0.02 * 0.02 - 0.1 * 0.02 * 2.0 * 0.5_f64).sqrt();
    assert_within("flat", is.flat - 1.3, 1e-4);
    assert_within("cv", is.cv - cv, 1e-4);
    assert_within("hue", is.hue - 0.04, 1e-4);
    assert_within("drift", is.drift - (0.6 - 0.02 * 36.0 / 35.0), 1e-4);
}
