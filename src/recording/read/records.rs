//! Record headers and the lengths inside records: <https://mcap.dev/spec>.

use std::ops::Range;

use mcap::records::op;

pub const MAGIC: &[u8] = &[0x89, b'M', b'C', b'A', b'P', 0x30, b'\r', b'\n'];
/// Opcode and length of a record (byte).
pub const RECORD_HEADER: usize = 9;
/// Part of a message record's body before the payload (byte).
pub const MESSAGE_HEADER: usize = 22;

/// Part of a message record's body before the payload.
pub struct MessageHeader {
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
}

impl MessageHeader {
    pub fn parse(body: &[u8]) -> Option<Self> {
        Some(Self {
            channel: u16::from_le_bytes(body.get(0..2)?.try_into().ok()?),
            sequence: u32_at(body, 2)?,
            log_time: u64_at(body, 6)?,
            publish_time: u64_at(body, 14)?,
        })
    }
}

/// Part of a chunk record's body before its records.
pub struct ChunkHeader {
    /// first log time (ns)
    pub start: u64,
    /// last log time (ns)
    pub end: u64,
    pub uncompressed_size: u64,
    /// 0 for none
    pub crc: u32,
    /// empty for none
    pub compression: String,
    /// the records, in the part of the body that was parsed (byte)
    pub data: Range<usize>,
}

impl ChunkHeader {
    /// From a chunk record's body, or the beginning of it.
    pub fn parse(body: &[u8]) -> Option<Self> {
        let (compression, at) = string_at(body, 28)?;
        let size = usize::try_from(u64_at(body, at)?).unwrap_or(usize::MAX);
        Some(Self {
            start: u64_at(body, 0)?,
            end: u64_at(body, 8)?,
            uncompressed_size: u64_at(body, 16)?,
            crc: u32_at(body, 24)?,
            compression,
            data: at + 8..(at + 8).saturating_add(size).min(body.len()),
        })
    }
}

pub fn u64_at(body: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(body.get(at..at.checked_add(8)?)?.try_into().ok()?))
}

fn u32_at(body: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(body.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

/// A length-prefixed string, and the offset of its end.
pub fn string_at(body: &[u8], at: usize) -> Option<(String, usize)> {
    let end = at.checked_add(4)?.checked_add(u32_at(body, at)? as usize)?;
    Some((std::str::from_utf8(body.get(at + 4..end)?).ok()?.to_string(), end))
}

/// Element of a record's body.
enum Part {
    /// of fixed size (byte)
    Fixed(usize),
    /// length-prefixed
    Sized,
    /// length-prefixed sequence of names and values, each [`Part::Sized`]
    Pairs,
}

/// Whether the lengths inside a record stay inside it. The parser of the `mcap` crate assumes that,
/// and allocates what they claim.
pub fn lengths_fit(opcode: u8, mut body: &[u8]) -> bool {
    use Part::{Fixed, Pairs, Sized};
    let parts: &[Part] = match opcode {
        op::HEADER => &[Sized, Sized],
        op::SCHEMA => &[Fixed(2), Sized, Sized, Sized],
        op::CHANNEL => &[Fixed(4), Sized, Sized, Pairs],
        op::METADATA => &[Sized, Pairs],
        _ => return true,
    };
    parts.iter().all(|part| match part {
        Fixed(size) => take(&mut body, *size).is_some(),
        Sized => take_sized(&mut body).is_some(),
        Pairs => take_sized(&mut body).is_some_and(|mut pairs| {
            while !pairs.is_empty() {
                if take_sized(&mut pairs).is_none() || take_sized(&mut pairs).is_none() {
                    return false;
                }
            }
            true
        }),
    })
}

fn take<'b>(body: &mut &'b [u8], size: usize) -> Option<&'b [u8]> {
    let (taken, rest) = body.split_at_checked(size)?;
    *body = rest;
    Some(taken)
}

fn take_sized<'b>(body: &mut &'b [u8]) -> Option<&'b [u8]> {
    let size = u32::from_le_bytes(take(body, 4)?.try_into().ok()?);
    take(body, size as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_beyond_the_record_is_detected() {
        let channel = [
            &[1, 0, 1, 0][..],
            &[1, 0, 0, 0, b't'],
            &[1, 0, 0, 0, b'e'],
            &[10, 0, 0, 0, 1, 0, 0, 0, b'k', 1, 0, 0, 0, b'v'],
        ]
        .concat();
        assert!(lengths_fit(op::CHANNEL, &channel));
        // every byte of every length, set too large
        for at in [4, 5, 7, 9, 12, 14, 17, 18, 21, 23, 26] {
            let mut damaged = channel.clone();
            damaged[at] = 0x7f;
            assert!(!lengths_fit(op::CHANNEL, &damaged), "byte {at}");
        }
        assert!((0..channel.len()).all(|cut| !lengths_fit(op::CHANNEL, &channel[..cut])));
    }
}
