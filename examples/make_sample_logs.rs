//! Makes `sample_logs/lost_beams.mcap` with the tests' own renderer: tilt and many lost beams.
//!
//!     cargo run --release --example make_sample_logs
#[path = "../tests/it/support/render.rs"]
mod render;

fn main() {
    let dive = render::Dive {
        seed: 7,
        frames: 24,
        width: 320,
        height: 240,
        focal_px: 380.0,
        tilt_deg: 5.0,
        lost_beams: 0.2,
        ..render::Dive::default()
    };
    let path = std::path::Path::new("sample_logs/lost_beams.mcap");
    let truth = dive.write(path);
    println!(
        "{}: {} frames, attenuation {:?} per metre",
        path.display(),
        truth.frames.len(),
        truth.attenuation_per_m
    );
}
