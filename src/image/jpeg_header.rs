//! JPEG header: chroma subsampling, and whether the compressed data are complete.

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
