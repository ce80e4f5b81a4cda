//! JPEG header: chroma subsampling, quality, and whether the compressed data are complete.

use super::vectorised;

/// Calls `visit` with marker and payload of every segment before the first scan; returns the offset
/// of that scan.
fn visit_segments(data: &[u8], mut visit: impl FnMut(u8, &[u8])) -> Option<usize> {
    let mut at = 2;
    loop {
        let &[0xff, marker, hi, lo] = data.get(at..at + 4)? else { return None };
        if marker == 0xff {
            at += 1; // a fill byte
            continue;
        }
        let length = usize::from(u16::from_be_bytes([hi, lo])).max(2);
        if marker == 0xda {
            return Some(at);
        }
        visit(marker, data.get(at + 4..at + 2 + length)?);
        at += 2 + length;
    }
}

/// Whether an end-of-image marker follows the first scan. The decoder fills a truncated scan with
/// grey and reports no error. (The end marker of an embedded thumbnail precedes the scan.)
pub fn is_complete(data: &[u8]) -> bool {
    let last = |marker: [u8; 2]| data.windows(2).rposition(|w| w == marker);
    let scan = || visit_segments(data, |_, _| {}).or_else(|| last([0xff, 0xda]));
    last([0xff, 0xd9]).is_some_and(|end| scan().is_some_and(|scan| end > scan))
}

/// Whether the file has one sequential scan and nothing else after its header, so that the decoder
/// writes every pixel.
pub fn is_one_scan(data: &[u8]) -> bool {
    let mut is_sequential = false;
    let scan = visit_segments(data, |marker, _| is_sequential |= matches!(marker, 0xc0 | 0xc1));
    let Some(scan) = scan.and_then(|start| data.get(start + 2..data.len().saturating_sub(2)))
    else {
        return false;
    };
    // In the scan, 0xff is followed by 0, or by the number of a restart marker.
    let is_marker = |(a, b): (&u8, &u8)| u32::from((*a == 0xff) & (*b != 0) & (*b & 0xf8 != 0xd0));
    let pairs = || scan.iter().zip(scan.get(1..).unwrap_or_default());
    let markers = vectorised(
        #[inline(always)]
        || pairs().map(is_marker).sum::<u32>(),
    );
    is_sequential && markers == 0 && data.ends_with(&[0xff, 0xd9])
}

/// Whether there are Huffman tables before the first scan.
pub fn has_huffman_tables(data: &[u8]) -> bool {
    let mut has_tables = false;
    let scan = visit_segments(data, |marker, _| has_tables |= marker == 0xc4);
    has_tables || scan.is_none()
}

/// Whether the frame header samples the first component more finely than the others.
pub fn is_subsampled(data: &[u8]) -> bool {
    let mut subsampled = false;
    visit_segments(data, |marker, body| {
        if matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
            let components = body.get(5).copied().unwrap_or(1);
            subsampled = components >= 3 && body.get(7).is_some_and(|sampling| *sampling != 0x11);
        }
    });
    subsampled
}

/// Quantisation of luminance at quality 50, in zigzag order (ITU-T T.81, table K.1).
const LUMINANCE: [u16; 64] = [
    16, 11, 12, 14, 12, 10, 16, 14, 13, 14, 18, 17, 16, 19, 24, 40, 26, 24, 22, 22, 24, 49, 35, 37,
    29, 40, 58, 51, 61, 60, 57, 51, 56, 55, 64, 72, 92, 78, 64, 68, 87, 69, 55, 56, 80, 109, 81,
    87, 95, 98, 103, 104, 103, 62, 77, 113, 121, 112, 100, 120, 92, 101, 103, 99,
];

/// The quality, 1 to 100, whose luminance table is nearest to that of the file; `None` where the
/// file has no table of 8 bits.
pub fn quality(data: &[u8]) -> Option<u8> {
    let mut found: Option<[u8; 64]> = None;
    visit_segments(data, |marker, mut body| {
        // A segment has several tables: precision and number, then 64 values of a byte or two.
        while let (0xdb, [kind, rest @ ..]) = (marker, body) {
            let (size, number) = (if kind >> 4 == 0 { 64 } else { 128 }, kind & 0x0f);
            let Some((values, next)) = rest.split_at_checked(size) else { break };
            if number == 0 && size == 64 {
                found = values.try_into().ok();
            }
            body = next;
        }
    });
    let found = found?;
    let distance = |quality: &u8| {
        let scaled = LUMINANCE.iter().map(|value| scaled(*value, *quality));
        scaled.zip(found).map(|(a, b)| u32::from(a.abs_diff(b.into()))).sum::<u32>()
    };
    (1..=100).rev().min_by_key(distance)
}

/// A value of a quantisation table at a quality, as libjpeg scales it.
fn scaled(value: u16, quality: u8) -> u16 {
    let quality = u32::from(quality);
    let percent = if quality < 50 { 5000 / quality } else { 200 - 2 * quality };
    ((u32::from(value) * percent + 50) / 100).clamp(1, 255) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{ImageShape, encode};

    #[test]
    fn the_quality_of_a_file_is_that_it_was_written_with() {
        let shape = ImageShape { width: 16, height: 16, bands: 3 };
        let samples: Vec<u8> = (0..16 * 16 * 3).map(|i| (i * 7 % 251) as u8).collect();
        for written in [5, 40, 50, 75, 85, 90, 95, 100] {
            let file = encode::jpeg(&samples, shape, written, true).expect("a JPEG");
            assert_eq!(quality(&file), Some(written));
        }
        assert_eq!(quality(b"no JPEG"), None);
        let file = encode::jpeg(&samples, shape, 90, true).expect("a JPEG");
        let known = (0..file.len()).filter(|end| quality(&file[..*end]).is_some()).count();
        assert!(known > 0 && known < file.len());
    }
}
