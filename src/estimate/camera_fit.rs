//! What pass one found of the camera: gains of frames, the law behind them, vignetting, black level
//! and transfer curve. It is removed from the samples; the unknowns stay in the solve, held to what
//! was found, so that α carries their uncertainty.

use super::samples::FrameSamples;
use crate::image::Bands;
use crate::model::Metered;
use crate::solver::camera::{
    CameraUnknowns, FrameGains, ImageRadius, ReadingCurve, SPLINES, VIGNETTING_TERMS, vignetting_at,
};
use crate::solver::{CameraSolution, MIN_DIRECT_SHARE, Sample, Track};
use crate::stats;
use crate::vehicle::Lamps;

/// More frames than this have no gain per band in the solves that follow: their number goes into
/// the cost with the third power, and they do not change α.
const MAX_FRAMES_OF_BAND_GAINS: usize = 120;

/// Standard deviations of the gains that a solve begins with.
pub const FIRST_GAIN_STD: [f64; 2] = [0.02, 0.01];

/// A slope of this many standard deviations is no chance.
const BEYOND_CHANCE: f64 = 4.0;

/// Which of the camera's unknowns the log shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraTermsFound {
    /// gains of the frames
    pub gains: bool,
    /// the law behind them
    pub law: bool,
    /// vignetting
    pub vignetting: bool,
    /// another transfer curve, free
    pub response: bool,
    /// black level
    pub black_level: bool,
}

/// The camera, as the log shows it.
#[derive(Clone, Debug)]
pub struct CameraFit {
    /// 1 or 3
    pub bands: usize,
    /// what was found
    pub found: CameraTermsFound,
    /// per frame and band: log gain, the law's part included
    pub log_gains: Vec<Bands>,
    /// standard deviations of the gains beside the law: shared by the bands, each band's own
    pub gain_std: [f64; 2],
    /// κ and κ', where there is a law
    pub law: Option<[f64; 2]>,
    /// log of the mean reading, to which the law refers
    pub log_level: Bands,
    /// v₁ to v₃, 0 without vignetting
    pub vignetting: [f64; VIGNETTING_TERMS],
    /// black level and transfer curve
    pub curve: ReadingCurve,
    /// image radius
    pub radius: ImageRadius,
    /// where the strobe was when it was found
    pub lamps: Lamps,
    /// residual of the solve without and with the camera's terms (log light)
    pub residual: [f64; 2],
    /// what gains are held to once these are removed
    remaining: Vec<Bands>,
    straight: ReadingCurve,
}

impl CameraFit {
    /// From a solution; `metered`: see [`CameraUnknowns::law`], `log_level` what it refers to.
    pub fn new(
        solution: &CameraSolution,
        found: CameraTermsFound,
        (metered, log_level): (&[Metered], Bands),
        (radius, lamps): (ImageRadius, Lamps),
        bands: usize,
    ) -> Self {
        let of_law = |f: usize| solution.by_law(&metered[f], bands);
        let frames = 0..solution.log_gains.len();
        let random = |f: usize| if found.gains { solution.log_gains[f] } else { [0.0; 3] };
        let log_gain = |f: usize| std::array::from_fn(|b| random(f)[b] + of_law(f)[b]);
        Self {
            bands,
            found,
            log_gains: frames.clone().map(log_gain).collect(),
            gain_std: solution.gain_std,
            law: found.law.then_some(solution.law),
            log_level,
            vignetting: solution.vignetting,
            curve: solution.curve.clone(),
            radius,
            lamps,
            residual: [0.0; 2],
            remaining: frames.map(|f| random(f).map(|g| -g)).collect(),
            straight: ReadingCurve::default(),
        }
    }

    /// The unknowns that stay in the solve when the fit is removed from the samples.
    pub fn unknowns(&self) -> CameraUnknowns<'_> {
        let [common, mut own] = self.gain_std;
        if self.remaining.len() > MAX_FRAMES_OF_BAND_GAINS {
            own = 0.0;
        }
        let gains = FrameGains { means: &self.remaining, std: [common, own], is_estimated: false };
        CameraUnknowns {
            gains: self.found.gains.then_some(gains),
            law: None,
            vignetting: self.found.vignetting,
            response: self.found.response,
            black_level: self.found.black_level,
            start: &self.straight,
            radius: self.radius,
        }
    }

    /// The same with a gain of every frame, by evidence.
    pub fn with_uneven_frames(&self) -> CameraUnknowns<'_> {
        // Errors of planes are common to the bands.
        let std = [FIRST_GAIN_STD[0], 0.0];
        let gains = FrameGains { means: &self.remaining, std, is_estimated: true };
        CameraUnknowns { gains: Some(gains), ..self.unknowns() }
    }

    /// Log gain per frame, the mean over the bands.
    pub fn common_gains(&self) -> Vec<f64> {
        common_gains(&self.log_gains, self.bands).collect()
    }

    /// Removes it from frames and tracks. Samples that are hardly more than the black level are
    /// left out of the frames.
    pub fn remove_from(&self, frames: &mut [FrameSamples], tracks: &mut [Track]) {
        for (frame, gain) in frames.iter_mut().zip(&self.log_gains) {
            frame.grid.retain_mut(|(_, sample)| self.remove(sample, gain));
            frame.dark.iter_mut().for_each(|(_, sample)| {
                self.remove(sample, gain);
            });
            for (b, light) in frame.mean_light[..frame.bands].iter_mut().enumerate() {
                *light = self.light(light.max(1e-9).ln(), b).0.exp() / gain[b].exp();
            }
        }
        for o in tracks.iter_mut().flatten() {
            self.remove(&mut o.sample, &self.log_gains[o.frame as usize]);
        }
    }

    /// Light less black level of a reading, and whether it is a measurement.
    fn light(&self, reading: f64, band: usize) -> (f64, bool) {
        let all = self.curve.light(reading).0.exp();
        let light = all - self.curve.black_level[band];
        (light.max(MIN_DIRECT_SHARE * all).ln(), light > MIN_DIRECT_SHARE * all)
    }

    fn remove(&self, sample: &mut Sample, gain: &Bands) -> bool {
        let vignetting = vignetting_at(&self.vignetting, self.radius.squared(sample));
        let mut is_measured = true;
        for b in 0..self.bands {
            let (light, is_more) = self.light(f64::from(sample.log_color[b]), b);
            sample.log_color[b] = (light - gain[b] - vignetting) as f32;
            is_measured &= is_more;
        }
        is_measured
    }

    /// The fit at full precision of the curve: whether pixel values have to be read again.
    pub fn changes_reading(&self) -> bool {
        self.curve.transfer.is_some() || self.curve.coefficients != [0.0; SPLINES]
    }
}

/// Mean over the bands.
pub fn common_gains(log_gains: &[Bands], bands: usize) -> impl Iterator<Item = f64> {
    log_gains.iter().map(move |g| g[..bands].iter().sum::<f64>() / bands as f64)
}

/// Slope of frames' log gains over path length (1/m); `None` where it may be chance.
pub fn slope_of_gains(frames: &[FrameSamples], log_gains: &[Bands], bands: usize) -> Option<f64> {
    let point = |(f, gain): (&FrameSamples, f64)| (2.0 * f.camera_altitude_m, gain, 1.0);
    let points: Vec<_> = frames.iter().zip(common_gains(log_gains, bands)).map(point).collect();
    let found = stats::slope(&points).filter(|(slope, std)| slope.abs() > BEYOND_CHANCE * std);
    found.map(|(slope, _)| slope)
}
