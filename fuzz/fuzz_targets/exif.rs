#![no_main]
#[path = "../../tests/it/support/foreign_bytes.rs"]
mod foreign_bytes;

libfuzzer_sys::fuzz_target!(|data: &[u8]| foreign_bytes::run("exif", data));
