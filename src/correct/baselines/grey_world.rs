//! Baseline: grey world, per frame (paper §III-D, Eq. 13 with uniform illumination; Buchsbaum 1980,
//! "A spatial processor model for object colour perception").

use super::common::{MEAN_LEVEL, MIN_LIGHT};
use crate::image::LinearImage;

/// Scales every band to the same mean.
pub fn balance(image: &mut LinearImage) {
    let bands = image.bands;
    for band in 0..bands {
        let of_band = image.pixels.iter().skip(band).step_by(bands);
        let mean =
            of_band.map(|v| f64::from(*v)).sum::<f64>() / (image.width * image.height) as f64;
        let gain = (MEAN_LEVEL / mean.max(f64::from(MIN_LIGHT))) as f32;
        image.pixels.iter_mut().skip(band).step_by(bands).for_each(|v| *v *= gain);
    }
}

#[cfg(test)]
mod tests {
    use super::super::common::tests::{assert_close, pattern};

    /// NumPy: `a = ((7*x + 13*y + 29*b) % 97 + 3) / 128` over 31 × 23 × 3; `a * .25 / a.mean((0,
    /// 1))` at [5, 7].
    #[test]
    fn matches_numpy() {
        let mut image = pattern(31, 23, 3);
        super::balance(&mut image);
        assert_close(image.at(7, 5).iter(), &[0.0982743, 0.2400245, 0.3839579], 1e-6);
    }
}
