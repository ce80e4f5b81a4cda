//! What each stage costs, one core, on an image of 1.3 megapixels: `cargo bench`. Items are pixels
//! but where a name says otherwise.
//!
//! Times of one machine on one day; what is compared, and with whom, stands in
//! `docs/benchmarks.md`.
#![allow(clippy::unwrap_used)]

use std::path::PathBuf;

use divan::counter::{BytesCount, ItemsCount};
use divan::{Bencher, black_box};
use unwater::config::{Compression, Config, OutputConfig, RenderConfig, Spreading};
use unwater::coordinates::{Direction, Transform};
use unwater::correct::{Correction, Frame, MeanFrames};
use unwater::estimate::sample_frame;
use unwater::geometry::{SeafloorPlane, Support, View};
use unwater::image::decode::{CameraResponse, PixelValues, read_pixels};
use unwater::image::noise::Noise;
use unwater::image::tone::Tone;
use unwater::image::transfer::SrgbTable;
use unwater::image::{EncodedImage, ImageShape, LinearImage, SensorImage, encode};
use unwater::model::{
    BeamGrid, BeamPattern, ImagingModel, RangeFactor, Removal, RenderingFile, SpreadingModel,
};
use unwater::recording::{Output, Recording, Schema, Window};
use unwater::run::estimate_logs;
use unwater::session::{Options, Silent};
use unwater::units::Stamp;
use unwater::vehicle::{Camera, Lamps, Rig, StrobeMount};

const SIZE: (usize, usize) = (1344, 1008);
const SHAPE: ImageShape = ImageShape { width: SIZE.0, height: SIZE.1, bands: 3 };

fn main() {
    divan::main();
}

fn pixels() -> ItemsCount {
    ItemsCount::new(SIZE.0 * SIZE.1)
}

/// Blobs of many sizes: something to compress, and to find keypoints on.
fn rgb8() -> Vec<u8> {
    let wave = |x: f64, y: f64, k: f64| {
        (x / k + 0.3 * (y / (1.7 * k)).sin()).sin() * (y / k - 0.4 * (x / (1.3 * k)).cos()).sin()
    };
    let value = |i: usize| {
        let (x, y) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
        let noise = ((i as u32).wrapping_mul(2_654_435_761) >> 24) as f64 / 255.0 - 0.5;
        0.45 + 0.12 * (wave(x, y, 4.3) + wave(x, y, 11.0) + wave(x, y, 31.0)) + 0.04 * noise
    };
    (0..SIZE.0 * SIZE.1)
        .flat_map(|i| [0.5, 0.9, 0.8].map(|band| (255.0 * band * value(i)) as u8))
        .collect()
}

fn jpeg() -> Vec<u8> {
    encode::jpeg(&rgb8(), SHAPE, 92, true).unwrap()
}

fn raw(encoding: &str, data: &[u8], channels: usize) -> PixelValues<'static> {
    // Lives as long as the program: a bench's input.
    let (data, encoding): (&'static [u8], &'static str) =
        (data.to_vec().leak(), String::from(encoding).leak());
    let image = EncodedImage::Raw {
        width: SIZE.0,
        height: SIZE.1,
        encoding,
        big_endian: false,
        step: SIZE.0 * channels,
        data,
    };
    read_pixels(&image, CameraResponse::default()).unwrap()
}

struct Scene {
    model: ImagingModel,
    rig: Rig,
    plane: SeafloorPlane,
    config: RenderConfig,
    rendering: RenderingFile,
    means: MeanFrames,
}

impl Scene {
    fn new() -> Self {
        let nodes = BeamGrid::new(41, 70.0);
        let beam: Vec<Option<f64>> = (0..41 * 41)
            .map(|i| Some(-3.0 * nodes.angle(i / 41).powi(2) - 2.0 * nodes.angle(i % 41).powi(2)))
            .collect();
        let camera = Camera::from_field_of_view(SIZE.0, SIZE.1, 45.0);
        Self {
            model: ImagingModel {
                bands: 3,
                attenuation_per_m: [0.45, 0.14, 0.10],
                spreading: SpreadingModel::of(Spreading::Strobe),
                incidence: true,
                beam_pattern: BeamPattern::from_nodes(nodes, &beam).refined(8),
                over_time: Default::default(),
                backscatter: None,
                daylight: None,
                residual: None,
                empirical: None,
            },
            rig: Rig {
                camera,
                body_from_optical: Transform::identity(),
                body_from_dvl: Transform::identity(),
                strobe: StrobeMount {
                    lamps: Lamps::one(Transform::from_parts(
                        [0.0, 0.9, 0.1],
                        [-0.17, 0.0, 0.0, 0.985],
                    )),
                    source: None,
                },
                camera_motion: None,
            },
            plane: SeafloorPlane {
                normal: Direction::from_vector(nalgebra::Vector3::new(0.02, 0.05, 1.0)).unwrap(),
                distance_m: 2.2,
                support: Support::LeastSquares,
                returns: 4,
                residual_m: 0.0,
                nearest_ping_s: 0.0,
            },
            config: RenderConfig::default(),
            rendering: RenderingFile {
                method: Default::default(),
                gain: vec![1.0; 3],
                median_correction: vec![8.0, 5.0, 4.0],
                median_reflectance: Vec::new(),
                shoulder_from: None,
                contrast_curve: None,
                white_level: None,
            },
            means: MeanFrames::default(),
        }
    }

    fn view(&self) -> View<'_> {
        View { camera: &self.rig.camera, rig: &self.rig, plane: &self.plane, terrain: None }
    }

    /// All that pass two does to an image between its codecs.
    fn correct(&self, codes: &PixelValues<'_>, table: &SrgbTable, out: &mut Vec<u8>) {
        let correction = Correction {
            model: &self.model,
            roughness: self.model.beam_pattern.roughness(0.05),
            rendering: &self.rendering,
            config: &self.config,
            backscatter: None,
            means: &self.means,
            clipped_above: 0.985,
            electrons: Default::default(),
        };
        let view = self.view();
        let noise = Noise::of(&codes.coding, CameraResponse::default(), Default::default());
        let frame = Frame {
            codes,
            flat_field: None,
            view: &view,
            gain: 1.0,
            balance: [1.0; 3],
            range_factor: RangeFactor::default(),
            noise: &noise,
            rectified: None,
        };
        out.resize(3 * SIZE.0 * SIZE.1, 0);
        let mut rows = out.chunks_exact_mut(3 * SIZE.0);
        correction
            .apply(&frame, |row| rows.next().map(|out| table.encode_row(row, 3, out)).unwrap());
    }
}

#[divan::bench]
fn jpeg_decode(bencher: Bencher) {
    let data = jpeg();
    let image = EncodedImage::Compressed { format: "jpeg", data: &data };
    bencher
        .counter(pixels())
        .bench(|| read_pixels(black_box(&image), CameraResponse::default()).map(|c| c.width));
}

#[divan::bench]
fn jpeg_encode(bencher: Bencher) {
    let samples = rgb8();
    bencher.counter(pixels()).bench(|| encode::jpeg(black_box(&samples), SHAPE, 92, true));
}

#[divan::bench]
fn png_encode(bencher: Bencher) {
    let samples = rgb8();
    bencher.counter(pixels()).bench(|| encode::png(black_box(&samples), SHAPE, 8));
}

/// Items are ways of light.
#[divan::bench]
fn geometry(bencher: Bencher) {
    let scene = Scene::new();
    let places: Vec<(f64, f64)> =
        (0..5000).map(|i| (f64::from(i % 84) * 16.0, f64::from(i / 84) * 16.0)).collect();
    bencher.counter(ItemsCount::new(places.len())).bench(|| {
        let view = scene.view();
        places
            .iter()
            .filter_map(|(u, v)| view.light_path(*u, *v))
            .map(|p| scene.model.log_radiance(&p, Removal::FULL)[0])
            .sum::<f64>()
    });
}

#[divan::bench]
fn kernel_rgb8(bencher: Bencher) {
    let (scene, codes, table) =
        (Scene::new(), raw("rgb8", &rgb8(), 3), SrgbTable::new(Tone::Shoulder { knee: 0.75 }));
    let mut out = Vec::with_capacity(SIZE.0 * SIZE.1 * 3);
    bencher.counter(pixels()).bench_local(|| scene.correct(&codes, &table, &mut out));
}

#[divan::bench]
fn kernel_bayer16(bencher: Bencher) {
    let mosaic: Vec<u8> =
        rgb8().chunks_exact(3).flat_map(|p| (u16::from(p[1]) << 8).to_le_bytes()).collect();
    let (scene, codes, table) = (
        Scene::new(),
        raw("bayer_rggb16", &mosaic, 2),
        SrgbTable::new(Tone::Shoulder { knee: 0.75 }),
    );
    let mut out = Vec::with_capacity(SIZE.0 * SIZE.1 * 3);
    bencher.counter(pixels()).bench_local(|| scene.correct(&codes, &table, &mut out));
}

/// Samples of a frame for pass one, keypoints among them.
#[divan::bench]
fn keypoints_and_samples(bencher: Bencher) {
    let (scene, codes, config) = (Scene::new(), raw("rgb8", &rgb8(), 3), Config::default());
    let mut light = LinearImage::new(SIZE.0, SIZE.1, 3);
    light
        .pixels
        .chunks_exact_mut(3 * SIZE.0)
        .enumerate()
        .for_each(|(y, row)| codes.linear_row(y, row));
    let image = SensorImage { light, mosaic: None };
    bencher.counter(pixels()).bench(|| {
        sample_frame(
            (0, Stamp(0)),
            &image,
            &scene.view(),
            Some(f64::INFINITY),
            &config.matching,
            &config.estimate,
        )
        .samples
        .len()
    });
}

fn sample_log() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("sample_logs/rendered_clear.mcap")
}

/// Pass one of the bundled log, all of it: most is the solve. Items are frames.
#[divan::bench(sample_count = 5, sample_size = 1)]
fn solve(bencher: Bencher) {
    let (path, options) = (sample_log(), Options { threads: 1, ..Options::default() });
    bencher.counter(ItemsCount::new(20usize)).bench(|| {
        estimate_logs(&[&path], &options, &Silent).map(|(model, _)| model.attenuation_per_m)
    });
}

#[divan::bench]
fn chunk_read(bencher: Bencher) {
    let path = sample_log();
    bencher
        .counter(BytesCount::new(std::fs::metadata(&path).unwrap().len()))
        .bench(|| Recording::open(&path).map(|log| log.messages(Window::ALL).count()).unwrap());
}

#[divan::bench(args = ["zstd", "none"])]
fn chunk_write(bencher: Bencher, compression: &str) {
    let config = OutputConfig {
        compression: if compression == "zstd" { Compression::Zstd } else { Compression::None },
        ..OutputConfig::default()
    };
    let (folder, message) = (tempfile::tempdir().unwrap(), rgb8());
    const MESSAGES: usize = 4;
    bencher.counter(BytesCount::new(MESSAGES * message.len())).bench(|| {
        let (mut out, mut file) =
            Output::create(&folder.path().join("out.mcap"), "", &config).unwrap();
        let schema = Schema { name: "Blob".into(), encoding: String::new(), data: Vec::new() };
        let channel = out.add_channel("/blob", "blob", &schema).unwrap();
        for time in 0..MESSAGES as u64 {
            out.write(channel, time, time, &message);
            while let Some(piece) = out.next_piece() {
                file.put(piece.into_bytes()).unwrap();
            }
        }
        out.flush();
        while let Some(piece) = out.next_piece() {
            file.put(piece.into_bytes()).unwrap();
        }
    });
}
