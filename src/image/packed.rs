//! Samples of 10 or 12 bits without gaps → 16-bit samples, as GenICam cameras send them and drivers
//! pass them on.
//!
//! `…p` (PFNC) sets sample behind sample, the lowest bit first. `…Packed` (GigE Vision) sets the
//! high bytes of two samples around a byte with the low bits of both.

/// How bits lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    InARow,
    Gige,
}

/// The word for the same samples with gaps, and how to make them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packing {
    /// `bayer_rggb12` for `bayer_rggb12p`
    pub unpacked: String,
    bits: usize,
    order: Order,
}

impl Packing {
    /// Of an encoding's word; `None` where it is not packed.
    pub fn of(encoding: &str) -> Option<Self> {
        let word = encoding.to_ascii_lowercase();
        let (unpacked, order) = match word.strip_suffix("packed") {
            Some(before) => (before.trim_end_matches('_'), Order::Gige),
            None => (word.strip_suffix('p')?, Order::InARow),
        };
        let bits = if unpacked.ends_with("10") { 10 } else { 12 };
        (unpacked.ends_with("10") || unpacked.ends_with("12")).then(|| Self {
            unpacked: unpacked.into(),
            bits,
            order,
        })
    }

    /// Bytes of a row; `None` where a row ends inside a byte, which nobody agrees on.
    fn row(&self, width: usize) -> Option<usize> {
        match self.order {
            Order::InARow => {
                width.checked_mul(self.bits).filter(|b| b.is_multiple_of(8)).map(|b| b / 8)
            }
            Order::Gige => {
                width.is_multiple_of(2).then_some(width / 2).and_then(|pairs| pairs.checked_mul(3))
            }
        }
    }

    /// The picture as little-endian 16-bit samples without padding; `None` where the data are too
    /// short.
    pub fn unpack(
        &self,
        (width, height): (usize, usize),
        step: usize,
        data: &[u8],
    ) -> Option<Vec<u8>> {
        let row = self.row(width)?;
        let needed = step.checked_mul(height.checked_sub(1)?)?.checked_add(row)?;
        if step < row || needed > data.len() {
            return None;
        }
        let mut out = Vec::with_capacity(2 * width * height);
        for y in 0..height {
            let row = &data[y * step..y * step + row];
            match self.order {
                Order::Gige => {
                    let low = self.bits - 8;
                    let mask = (1u16 << low) - 1;
                    for group in row.chunks_exact(3) {
                        let [a, between, b] = [group[0], group[1], group[2]].map(u16::from);
                        out.extend((a << low | between & mask).to_le_bytes());
                        out.extend((b << low | between >> 4 & mask).to_le_bytes());
                    }
                }
                Order::InARow => {
                    let (mut held, mut count) = (0u32, 0);
                    for byte in row {
                        held |= u32::from(*byte) << count;
                        count += 8;
                        if count >= self.bits {
                            out.extend(((held & ((1 << self.bits) - 1)) as u16).to_le_bytes());
                            held >>= self.bits;
                            count -= self.bits;
                        }
                    }
                }
            }
        }
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_samples_in_three_bytes_both_ways() {
        let (a, b) = (0xabcu16, 0x123u16);
        let expected = [a.to_le_bytes(), b.to_le_bytes()].concat().repeat(6);
        for (word, group) in [("Mono12p", [0xbc, 0x3a, 0x12]), ("Mono12Packed", [0xab, 0x3c, 0x12])]
        {
            let packing = Packing::of(word).expect(word);
            assert_eq!(packing.unpacked, "mono12");
            let data = group.repeat(6);
            assert_eq!(packing.unpack((4, 3), 6, &data), Some(expected.clone()), "{word}");
            assert_eq!(packing.unpack((4, 3), 6, &data[1..]), None, "{word}: cut short");
            assert_eq!(
                packing.unpack((5, 3), 8, &[0; 64]),
                None,
                "{word}: a row that ends inside a byte"
            );
            assert_eq!(packing.unpack((usize::MAX - 1, 3), usize::MAX, &data), None);
        }
        assert!(
            Packing::of("mono12").is_none()
                && Packing::of("bayer_rggb8p").is_none()
                && Packing::of("jpegp").is_none()
        );
    }
}
