//! Packed 10- and 12-bit samples of GenICam cameras → 16-bit samples.
//!
//! `…p` (PFNC) stores the samples contiguously, least significant bit first. `…Packed` (GigE
//! Vision) stores the high bytes of two samples around a byte with the low bits of both.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Pfnc,
    GigeVision,
}

/// A packed encoding and its unpacked equivalent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packing {
    /// `bayer_rggb12` for `bayer_rggb12p`
    pub unpacked: String,
    bits: usize,
    order: Order,
}

impl Packing {
    /// `None` for an encoding that is not packed.
    pub fn from_encoding(encoding: &str) -> Option<Self> {
        let name = encoding.to_ascii_lowercase();
        let (unpacked, order) = match name.strip_suffix("packed") {
            Some(before) => (before.trim_end_matches('_'), Order::GigeVision),
            None => (name.strip_suffix('p')?, Order::Pfnc),
        };
        let bits = if unpacked.ends_with("10") { 10 } else { 12 };
        (unpacked.ends_with("10") || unpacked.ends_with("12")).then(|| Self {
            unpacked: unpacked.into(),
            bits,
            order,
        })
    }

    /// Bytes per row; `None` where a row ends within a byte, for which no layout is defined.
    fn row(&self, width: usize) -> Option<usize> {
        match self.order {
            Order::Pfnc => {
                width.checked_mul(self.bits).filter(|b| b.is_multiple_of(8)).map(|b| b / 8)
            }
            Order::GigeVision => {
                width.is_multiple_of(2).then_some(width / 2).and_then(|pairs| pairs.checked_mul(3))
            }
        }
    }

    /// Little-endian 16-bit samples without padding; `None` where the data are too short.
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
                Order::GigeVision => {
                    let low = self.bits - 8;
                    let mask = (1u16 << low) - 1;
                    for group in row.chunks_exact(3) {
                        let [a, low_bits, b] = [group[0], group[1], group[2]].map(u16::from);
                        out.extend((a << low | low_bits & mask).to_le_bytes());
                        out.extend((b << low | low_bits >> 4 & mask).to_le_bytes());
                    }
                }
                Order::Pfnc => {
                    let (mut bits, mut count) = (0u32, 0);
                    for byte in row {
                        bits |= u32::from(*byte) << count;
                        count += 8;
                        if count >= self.bits {
                            out.extend(((bits & ((1 << self.bits) - 1)) as u16).to_le_bytes());
                            bits >>= self.bits;
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
    fn two_samples_in_three_bytes_in_both_orders() {
        let (a, b) = (0xabcu16, 0x123u16);
        let expected = [a.to_le_bytes(), b.to_le_bytes()].concat().repeat(6);
        for (name, group) in [("Mono12p", [0xbc, 0x3a, 0x12]), ("Mono12Packed", [0xab, 0x3c, 0x12])]
        {
            let packing = Packing::from_encoding(name).expect(name);
            assert_eq!(packing.unpacked, "mono12");
            let data = group.repeat(6);
            assert_eq!(packing.unpack((4, 3), 6, &data), Some(expected.clone()), "{name}");
            assert_eq!(packing.unpack((4, 3), 6, &data[1..]), None, "{name}: truncated");
            assert_eq!(
                packing.unpack((5, 3), 8, &[0; 64]),
                None,
                "{name}: a row that ends within a byte"
            );
            assert_eq!(packing.unpack((usize::MAX - 1, 3), usize::MAX, &data), None);
        }
        assert!(
            Packing::from_encoding("mono12").is_none()
                && Packing::from_encoding("bayer_rggb8p").is_none()
                && Packing::from_encoding("jpegp").is_none()
        );
    }
}
