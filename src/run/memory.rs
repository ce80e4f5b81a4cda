//! How much memory a run takes at most. It follows from the pictures' size and the number of cores,
//! not from the log's length: what waits, and what is worked on, is bounded where it is made
//! (`cores.rs`).

use crate::config::{Config, ImageFormat, Method};

use super::pass_two::{CHUNKS_PER_THREAD, FRAMES_PER_THREAD};

/// The program, its tables, the model, and an hour of pings and attitudes (48 bytes each attitude,
/// some 120 each ping) (byte).
const BASE: usize = 64 << 20;
/// A picture of 8 bits while it is decoded, corrected and encoded in pass two, per pixel: codes
/// before and after, and what becomes of them (byte).
const CORRECT_PER_PIXEL: usize = 12;
/// Any other picture, one that a baseline works on, and every picture in pass one: its light as
/// well (byte).
const LIGHT_PER_PIXEL: usize = 20;
/// What pass one keeps of a frame: keypoints with what they look like, samples of the ground
/// (byte).
const SAMPLES_PER_FRAME: usize = 2 << 20;

/// What decides on a run's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// cores
    pub threads: usize,
    /// pixels of a picture
    pub pixels: usize,
    /// a picture's message in the input (byte)
    pub source_bytes: usize,
    /// frames that pass one keeps samples of; 0 where the model is given
    pub pass_one_frames: usize,
}

/// A bound in its parts (byte).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    /// the program itself
    pub base: usize,
    /// pass one: frames that are worked on and wait, and the samples of all, which are gone when
    /// pass two begins
    pub pass_one: usize,
    /// pass two: frames that are worked on
    pub at_work: usize,
    /// frames that wait, encoded, before or after the work
    pub waiting: usize,
    /// chunks, packed and unpacked, before and after
    pub chunks: usize,
}

impl Bound {
    /// All of it.
    pub fn total(&self) -> usize {
        self.base + (self.at_work + self.waiting + self.chunks).max(self.pass_one)
    }
}

impl Load {
    /// The most memory that such a run takes.
    pub fn bound(&self, config: &Config) -> Bound {
        let Self { threads, pixels, source_bytes, pass_one_frames } = *self;
        let under_way = if threads > 1 { FRAMES_PER_THREAD * threads } else { 1 };
        // A corrected picture as JPEG is smaller than a byte per pixel; raw or PNG it may be as
        // large as its codes.
        let packed = matches!(config.render.image_format, ImageFormat::Auto | ImageFormat::Jpeg)
            && config.render.depth == 8;
        let output_bytes =
            if packed { pixels } else { 3 * pixels * usize::from(config.render.depth) / 8 };
        // A chunk holds one picture at least, and lies in memory twice: as it is and unpacked.
        let chunk = 2 * source_bytes.max(4 << 20);
        let own = (config.output.chunk_size_mib << 20) as usize + output_bytes;
        let stage = |chunk: usize| {
            if threads > 1 { (threads * CHUNKS_PER_THREAD).max(2 * chunk) } else { chunk }
        };
        let in_light = threads * pixels * LIGHT_PER_PIXEL;
        let physical = matches!(
            config.render.method,
            Method::Full | Method::Attenuation | Method::BeamPattern
        );
        let is_lean = physical && source_bytes <= pixels && config.render.depth == 8;
        Bound {
            base: BASE,
            pass_one: if pass_one_frames > 0 {
                in_light
                    + under_way * source_bytes
                    + stage(chunk)
                    + pass_one_frames * SAMPLES_PER_FRAME
            } else {
                0
            },
            at_work: if is_lean { threads * pixels * CORRECT_PER_PIXEL } else { in_light },
            waiting: under_way * (source_bytes + output_bytes),
            chunks: stage(chunk) + stage(own) + own,
        }
    }
}

/// The bound for usual cameras, as comments behind the settings.
pub fn table(config: &Config, threads: usize) -> String {
    let mb = |bytes: usize| (bytes as f64 / 1e6).round();
    let mut text = format!(
        "\n# Memory at most, however long the log is, with {threads} threads (-j) and JPEG \
         pictures of half a byte per pixel [MB]:\n#   megapixels   pass two   both passes\n"
    );
    for megapixels in [1.3, 5.0, 12.0] {
        let pixels = (megapixels * 1e6) as usize;
        let load =
            |pass_one_frames| Load { threads, pixels, source_bytes: pixels / 2, pass_one_frames };
        let (two, both) = (load(0).bound(config), load(config.estimate.max_frames).bound(config));
        text += &format!(
            "#   {megapixels:>10.1}   {:>8}   {:>11}\n",
            mb(two.total()),
            mb(both.total())
        );
    }
    text + &format!(
        "# pass two: {} + threads * (pixels * {CORRECT_PER_PIXEL} bytes + {FRAMES_PER_THREAD} * \
         (picture in + picture out)) + chunks ({} per thread, two at least);\n# pass one: {} + \
         threads * pixels * {LIGHT_PER_PIXEL} bytes + the same of pictures in and chunks + {:.1} \
         for each of estimate.max_frames.\n",
        mb(BASE),
        mb(CHUNKS_PER_THREAD),
        mb(BASE),
        SAMPLES_PER_FRAME as f64 / 1e6
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_megapixels_on_two_cores_and_more_of_everything_is_more() {
        let config = Config::default();
        let load =
            Load { threads: 2, pixels: 12_000_000, source_bytes: 6_000_000, pass_one_frames: 0 };
        let more = [
            Load { threads: 3, ..load },
            Load { pixels: 13_000_000, ..load },
            Load { source_bytes: 30_000_000, ..load },
        ];
        let bound = load.bound(&config).total();
        assert!(more.iter().all(|m| m.bound(&config).total() > bound));
        assert!(table(&config, 2).lines().all(|line| line.is_empty() || line.starts_with('#')));
    }
}
