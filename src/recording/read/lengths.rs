//! Whether the lengths inside a record stay inside it. The parser takes that for granted, and
//! reserves what they claim.

use mcap::records::op;

/// What a record is made of.
enum Part {
    /// so many bytes
    Fixed(usize),
    /// a length of four bytes, then as much
    Sized,
    /// a length of four bytes, then names and values, each [`Part::Sized`], to its end
    Pairs,
}

/// Whether a record of this kind can be given to the parser.
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
        Sized => sized(&mut body).is_some(),
        Pairs => sized(&mut body).is_some_and(|mut pairs| {
            while !pairs.is_empty() {
                if sized(&mut pairs).is_none() || sized(&mut pairs).is_none() {
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

fn sized<'b>(body: &mut &'b [u8]) -> Option<&'b [u8]> {
    let size = u32::from_le_bytes(take(body, 4)?.try_into().ok()?);
    take(body, size as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_that_reaches_out_of_its_record_is_seen() {
        let channel = [
            &[1, 0, 1, 0][..],
            &[1, 0, 0, 0, b't'],
            &[1, 0, 0, 0, b'e'],
            &[10, 0, 0, 0, 1, 0, 0, 0, b'k', 1, 0, 0, 0, b'v'],
        ]
        .concat();
        assert!(lengths_fit(op::CHANNEL, &channel));
        // every byte of every length, made too large
        for at in [4, 5, 7, 9, 12, 14, 17, 18, 21, 23, 26] {
            let mut lying = channel.clone();
            lying[at] = 0x7f;
            assert!(!lengths_fit(op::CHANNEL, &lying), "byte {at}");
        }
        assert!((0..channel.len()).all(|cut| !lengths_fit(op::CHANNEL, &channel[..cut])));
    }
}
