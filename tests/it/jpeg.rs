//! The JPEG encoder by pixel values: against the pixels it was given, against another encoder and
//! through two decoders; grey and every subsampling, and sizes that are no multiple of a block.
use image::ImageFormat;
use jpeg_encoder::{ColorType, SamplingFactor};
use libjpeg_turbo_rs::{PixelFormat, Subsampling};
use unwater::image::ImageShape;

use crate::support::judge::assert_within;

const QUALITY: u8 = 92;
/// Widths and heights around those of one and two blocks of every subsampling, up to 32 pixels.
const SIZES: [usize; 11] = [1, 2, 3, 7, 8, 9, 15, 17, 31, 33, 50];
/// Each with the largest accepted errors, see `worst`.
const SAMPLINGS: [(Subsampling, SamplingFactor, [f64; 3]); 6] = [
    (Subsampling::S444, SamplingFactor::R_4_4_4, [3.25, 10.5, 3.0]),
    (Subsampling::S422, SamplingFactor::R_4_2_2, [4.17, 16.5, 4.5]),
    (Subsampling::S420, SamplingFactor::R_4_2_0, [5.48, 21.0, 13.5]),
    (Subsampling::S440, SamplingFactor::R_4_4_0, [5.33, 18.0, 4.5]),
    (Subsampling::S411, SamplingFactor::R_4_1_1, [6.90, 33.0, 3.0]),
    (Subsampling::S441, SamplingFactor::R_4_4_1, [10.77, 48.0, 3.0]),
];

/// Smooth in every band, so that subsampling loses little, and different in every band.
fn pixels(width: usize, height: usize, bands: usize) -> Vec<u8> {
    let value = |x: usize, y: usize, band: usize| {
        let (x, y) = (x as f64 / 11.0, y as f64 / 7.0);
        let wave = [(x + y).sin(), (x - 0.5 * y).cos(), (0.3 * x + y).cos()][band];
        (128.0 + 90.0 * wave).round() as u8
    };
    (0..width * height * bands)
        .map(|i| value(i / bands % width, i / bands / width, i % bands))
        .collect()
}

fn decoded(file: &[u8], width: usize, height: usize, bands: usize) -> Vec<u8> {
    let image = image::load_from_memory_with_format(file, ImageFormat::Jpeg).expect("a JPEG");
    assert_eq!((image.width() as usize, image.height() as usize), (width, height));
    assert_eq!(usize::from(image.color().channel_count()), bands);
    image.into_bytes()
}

fn by_another_encoder(
    pixels: &[u8],
    [width, height]: [usize; 2],
    color: ColorType,
    sampling: SamplingFactor,
) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut file, QUALITY);
    encoder.set_sampling_factor(sampling);
    encoder.encode(pixels, width as u16, height as u16, color).expect("another encoder's JPEG");
    file
}

/// Mean and largest difference of pixel values (DN).
fn differences(a: &[u8], b: &[u8]) -> [f64; 2] {
    assert_eq!(a.len(), b.len());
    let off = a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b)));
    let [sum, max] = off.fold([0.0, 0.0], |[sum, max], off| [sum + off, f64::max(max, off)]);
    [sum / a.len() as f64, max]
}

/// Pixels by libjpeg-turbo-rs's own decoder.
fn decoded_by_turbo(file: &[u8]) -> Vec<u8> {
    libjpeg_turbo_rs::decompress(file).expect("a JPEG").data
}

/// Largest values over all sizes: mean and largest error of the pixels that `image` reads, and
/// largest difference to what libjpeg-turbo-rs reads (DN).
fn worst(format: PixelFormat, ours: Subsampling, other: SamplingFactor) -> [f64; 3] {
    let (bands, color) =
        if format == PixelFormat::Rgb { (3, ColorType::Rgb) } else { (1, ColorType::Luma) };
    let mut worst = [0.0; 3];
    for (width, height) in SIZES.iter().flat_map(|w| SIZES.map(|h| (*w, h))) {
        let given = pixels(width, height, bands);
        let file = libjpeg_turbo_rs::compress(&given, width, height, format, QUALITY, ours)
            .expect("a JPEG");
        let read = decoded(&file, width, height, bands);
        let [mean, max] = differences(&read, &given);
        let [_, between] = differences(&read, &decoded_by_turbo(&file));
        worst = std::array::from_fn(|k| f64::max(worst[k], [mean, max, between][k]));
        // The other encoder takes every n-th chroma value instead of their mean. `image` misreads
        // its 4:4:1, so it is read by the other decoder.
        let file = by_another_encoder(&given, [width, height], color, other);
        let [mean_of_other, _] = differences(&decoded_by_turbo(&file), &given);
        assert!(
            mean < mean_of_other + BEHIND_OTHER,
            "{ours:?} {width}×{height}: {mean} DN off, the other encoder {mean_of_other} DN"
        );
    }
    worst
}

/// By how much the mean error may exceed the other encoder's (DN).
const BEHIND_OTHER: f64 = 1.0;

fn assert_worst(what: &str, worst: [f64; 3], bounds: [f64; 3]) {
    let names = ["mean error", "largest error", "largest difference of two decoders"];
    for ((name, worst), bound) in names.iter().zip(worst).zip(bounds) {
        assert_within(&format!("JPEG {what}: {name} [DN]"), worst, bound);
    }
}

#[test]
fn grey_and_every_subsampling_hold_the_given_pixels() {
    let grey = worst(PixelFormat::Grayscale, Subsampling::S444, SamplingFactor::R_4_4_4);
    assert_worst("grey", grey, [1.05, 4.5, 1.5]);
    for (ours, other, bounds) in SAMPLINGS {
        assert_worst(&format!("{ours:?}"), worst(PixelFormat::Rgb, ours, other), bounds);
    }
}

/// As corrected images are written.
#[test]
fn corrected_images_are_written_with_the_subsampling_of_the_settings() {
    for (bands, subsampled, format, sampling) in [
        (1, false, PixelFormat::Grayscale, Subsampling::S444),
        (1, true, PixelFormat::Grayscale, Subsampling::S444),
        (3, false, PixelFormat::Rgb, Subsampling::S444),
        (3, true, PixelFormat::Rgb, Subsampling::S420),
    ] {
        let shape = ImageShape { width: 33, height: 15, bands };
        let given = pixels(shape.width, shape.height, bands);
        let written = unwater::image::encode::jpeg(&given, shape, QUALITY, subsampled);
        let direct = libjpeg_turbo_rs::compress(&given, 33, 15, format, QUALITY, sampling);
        assert_eq!(written.expect("a JPEG"), direct.expect("a JPEG"), "{bands} {subsampled}");
    }
}
