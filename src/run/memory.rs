//! Upper bound of a run's memory. It depends on the size of the images and the number of threads,
//! not on the length of the log: the number of frames in flight is bounded (`parallel.rs`).

use crate::config::{Config, ImageFormat, Method};

use super::pass_two::{CHUNKS_PER_THREAD, FRAMES_PER_THREAD};

/// The program, its tables, the model, and an hour of pings (about 120 bytes each) and attitudes
/// (48 bytes each) (byte).
const BASE: usize = 20 << 20;
/// An 8-bit image while it is decoded, corrected and encoded in pass two, per pixel: pixel values
/// before and after, and the encoded image (byte).
const CORRECT_PER_PIXEL: usize = 12;
/// Any other image, an image that a baseline processes, and every image in pass one, per pixel:
/// its linear light as well (byte).
const LIGHT_PER_PIXEL: usize = 20;
/// Data of a frame that pass one keeps, and the estimators' work on them: keypoints with
/// descriptors, samples of the seafloor, observations of points (byte).
const SAMPLES_PER_FRAME: usize = 2 << 20;
/// The estimators' work beside that (byte).
const ESTIMATORS: usize = 30 << 20;
/// Images of fewer pixels have proportionally fewer keypoints.
const ALL_KEYPOINTS_PIXELS: usize = 300_000;
/// Chunks in flight in a scan, and in pass one, for each thread (byte).
const SCANNED: usize = 16 << 20;

/// The quantities that determine a run's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// number of threads
    pub threads: usize,
    /// pixels of an image
    pub pixels: usize,
    /// an image message of the input (byte)
    pub source_bytes: usize,
    /// the largest chunk of the input, packed and unpacked (byte)
    pub largest_chunk: usize,
    /// all chunks of the input, packed and unpacked (byte)
    pub all_chunks: usize,
    /// frames of which pass one keeps samples; 0 where the model is given
    pub pass_one_frames: usize,
}

/// A bound in its parts (byte).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    /// the program
    pub base: usize,
    /// the scan of the log
    pub scan: usize,
    /// pass one: frames in progress and in queues, and the samples of all, which are freed before
    /// pass two begins
    pub pass_one: usize,
    /// pass two: frames in progress
    pub in_progress: usize,
    /// encoded frames in the queues before and after
    pub queued: usize,
    /// chunks of input and output, compressed and decompressed
    pub chunks: usize,
}

impl Bound {
    /// All of it.
    pub fn total(&self) -> usize {
        let pass_two = self.in_progress + self.queued + self.chunks;
        self.base + pass_two.max(self.pass_one).max(self.scan)
    }
}

impl Load {
    /// Upper bound of the memory of such a run.
    pub fn bound(&self, config: &Config) -> Bound {
        let Self { threads, pixels, source_bytes, pass_one_frames, .. } = *self;
        let in_flight = if threads > 1 { FRAMES_PER_THREAD * threads } else { 1 };
        // A corrected image as JPEG is smaller than a byte per pixel; raw or PNG it may be as large
        // as its pixel values.
        let packed = matches!(config.render.image_format, ImageFormat::Auto | ImageFormat::Jpeg)
            && config.render.depth == 8;
        let output_bytes =
            if packed { pixels } else { 3 * pixels * usize::from(config.render.depth) / 8 };
        // Two chunks are read while a third is worked on, however large they are.
        let read = |in_flight: usize| {
            let stage = if threads > 1 { threads * in_flight } else { 0 };
            stage.max(3 * self.largest_chunk).min(self.all_chunks)
        };
        // No more is written than twice what is read, and not more is queued than written.
        let own = (config.output.chunk_size_mib << 20) as usize + output_bytes;
        let stage = if threads > 1 { (threads * CHUNKS_PER_THREAD).max(2 * own) } else { own };
        let written = (stage + own).min(self.all_chunks.saturating_mul(2));
        let in_light = threads * pixels * LIGHT_PER_PIXEL;
        let physical = matches!(
            config.render.method,
            Method::Full | Method::Attenuation | Method::BeamPattern
        );
        let is_lean = physical && source_bytes <= pixels && config.render.depth == 8;
        Bound {
            base: BASE,
            pass_one: if pass_one_frames > 0 {
                let samples = ESTIMATORS + pass_one_frames * SAMPLES_PER_FRAME;
                let keypoints = pixels.min(ALL_KEYPOINTS_PIXELS) as f64;
                let share = keypoints / ALL_KEYPOINTS_PIXELS as f64;
                in_light
                    + in_flight * source_bytes
                    + read(SCANNED / 2)
                    + (samples as f64 * share) as usize
            } else {
                0
            },
            in_progress: if is_lean { threads * pixels * CORRECT_PER_PIXEL } else { in_light },
            queued: in_flight * (source_bytes + output_bytes),
            chunks: read(CHUNKS_PER_THREAD) + written,
            scan: read(SCANNED) + pixels * LIGHT_PER_PIXEL,
        }
    }
}

/// The bound for usual cameras, as comments behind the settings.
pub fn table(config: &Config, threads: usize) -> String {
    let mb = |bytes: usize| (bytes as f64 / 1e6).round();
    let mut text = format!(
        "\n# Upper bound of memory for logs of any length, with {threads} threads (-j) and \
         JPEG images of half a byte per pixel [MB]:\n#   megapixels   pass two   both passes\n"
    );
    for megapixels in [1.3, 5.0, 12.0] {
        let pixels = (megapixels * 1e6) as usize;
        let source_bytes = pixels / 2;
        let largest_chunk = 2 * source_bytes.max(4 << 20);
        let load = |pass_one_frames| Load {
            threads,
            pixels,
            source_bytes,
            largest_chunk,
            all_chunks: usize::MAX,
            pass_one_frames,
        };
        let (two, both) = (load(0).bound(config), load(config.estimate.max_frames).bound(config));
        text += &format!(
            "#   {megapixels:>10.1}   {:>8}   {:>11}\n",
            mb(two.total()),
            mb(both.total())
        );
    }
    text + &format!(
        "# pass two: {} + threads * (pixels * {CORRECT_PER_PIXEL} bytes + {FRAMES_PER_THREAD} * \
         (input image + output image)) + chunks ({} per thread, at least two);\n# pass one: {} + \
         threads * pixels * {LIGHT_PER_PIXEL} bytes + input images and chunks as above + {:.1} + \
         {:.1} for each of estimate.max_frames;\n# chunks of more than {:.0} count three times.\n",
        mb(BASE),
        mb(CHUNKS_PER_THREAD),
        mb(BASE),
        ESTIMATORS as f64 / 1e6,
        SAMPLES_PER_FRAME as f64 / 1e6,
        mb(SCANNED / 3 * threads)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_grows_with_threads_pixels_and_message_size() {
        let config = Config::default();
        let load = Load {
            threads: 2,
            pixels: 12_000_000,
            source_bytes: 6_000_000,
            largest_chunk: 12_000_000,
            all_chunks: usize::MAX,
            pass_one_frames: 0,
        };
        let more = [
            Load { threads: 3, ..load },
            Load { pixels: 13_000_000, ..load },
            Load { source_bytes: 30_000_000, ..load },
            Load { largest_chunk: 150_000_000, ..load },
        ];
        let bound = load.bound(&config).total();
        // The bound of a short log is no more than what there is.
        let short = Load { all_chunks: 400_000, pixels: 20_000, source_bytes: 4_000, ..load };
        assert!(short.bound(&config).total() < 24 << 20);
        assert!(more.iter().all(|m| m.bound(&config).total() > bound));
        assert!(table(&config, 2).lines().all(|line| line.is_empty() || line.starts_with('#')));
    }
}
