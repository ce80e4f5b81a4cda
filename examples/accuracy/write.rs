//! Writes the dives of cases to files, each with its truth.

use std::path::Path;

use crate::Case;
use crate::support::judge::blocks;
use crate::support::render::{Dive, FrameTruth, Truth};

/// `CASE_SEED.mcap`, `.json` (the truth) and `.reflectance.npy` (true reflectance, 4×4-pixel means:
/// frames × rows × columns × R G B, as float32).
pub fn write(case: &Case, seed: u64, folder: &Path) {
    let dive = (case.dive)(seed);
    let stem = folder.join(format!("{}_{seed}", file_name(case.name)));
    let truth = dive.write(&stem.with_extension("mcap"));
    let json = serde_json::to_string_pretty(&facts(case.name, &dive, &truth)).expect("JSON");
    std::fs::write(stem.with_extension("json"), json).expect("the truth's file");
    let reflectance = npy(&dive, &truth);
    std::fs::write(stem.with_extension("reflectance.npy"), reflectance).expect("a file");
    println!("{}", stem.with_extension("mcap").display());
}

/// Letters and digits, the rest as single underscores.
fn file_name(case: &str) -> String {
    let words = case.split(|c: char| !c.is_ascii_alphanumeric() && c != '.');
    words
        .filter(|word| !word.is_empty())
        .collect::<Vec<_>>()
        .join("_")
        .replace('.', "")
        .to_lowercase()
}

fn facts(case: &str, dive: &Dive, truth: &Truth) -> serde_json::Value {
    let frame = |f: &FrameTruth| {
        serde_json::json!({
            "stamp_ns": f.stamp_ns, "gains": f.gains, "strobe_energy": f.strobe_energy,
            "attenuation_per_m": f.attenuation_per_m, "position": f.position,
            "orientation_xyzw": f.orientation_xyzw,
            "plane_normal_in_optical": f.plane_normal_in_optical,
            "plane_distance_m": f.plane_distance_m, "backscatter_share": f.backscatter_share,
            "daylight_share": f.daylight_share,
        })
    };
    serde_json::json!({
        "case": case, "seed": dive.seed, "alpha": truth.attenuation_per_m,
        "strobe_position_in_base": truth.strobe_position_in_base,
        "strobe_orientation_xyzw": truth.strobe_orientation_xyzw,
        "strobe_mount_error_m": dive.conditions.strobe_mount_error_m,
        "stamp_delay_s": dive.conditions.stamp_delay_s,
        "black_level": dive.conditions.black_level,
        "vignetting_exponent": dive.conditions.vignetting_exponent,
        "response": format!("{:?}", dive.conditions.response),
        "exposure": truth.exposure, "focal_px": dive.focal_px,
        "conditions": format!("{:?}", dive.conditions),
        "frames": truth.frames.iter().map(frame).collect::<Vec<_>>(),
    })
}

/// NumPy's format, version 1.0.
fn npy(dive: &Dive, truth: &Truth) -> Vec<u8> {
    let (rows, columns) = (dive.height / 4, dive.width / 4);
    let shape = format!("({}, {rows}, {columns}, 3)", truth.frames.len());
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    let header = format!("{header:<width$}\n", width = 128 - 10 - 1);
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    for frame in &truth.frames {
        let band = |band: usize| {
            blocks(dive.width, dive.height, |x, y| {
                f64::from(frame.reflectance[y * dive.width + x][band])
            })
        };
        let bands = [band(0), band(1), band(2)];
        let values = (0..rows * columns).flat_map(|i| [0, 1, 2].map(|b| bands[b][i] as f32));
        bytes.extend(values.flat_map(f32::to_le_bytes));
    }
    bytes
}
