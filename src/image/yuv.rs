//! YUV → 8-bit RGB: the YUV encodings of `sensor_msgs/image_encodings` and of Foxglove.
//!
//! BT.601 with video levels (16 to 235), as in OpenCV and `cv_bridge`; the message does not name
//! the standard.

/// Memory layout of a YUV image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// two pixels in four bytes; offsets of Y, U and V
    Packed { y: [usize; 2], u: usize, v: usize },
    /// a plane of Y, then one of interleaved chroma (U at offset `u`), at half resolution or full
    Planes { u: usize, halved: bool },
}

fn order(encoding: &str) -> Option<Order> {
    Some(match encoding.to_ascii_lowercase().as_str() {
        "uyvy" | "yuv422" => Order::Packed { y: [1, 3], u: 0, v: 2 },
        "yuyv" | "yuy2" | "yuv422_yuy2" => Order::Packed { y: [0, 2], u: 1, v: 3 },
        "nv12" => Order::Planes { u: 0, halved: true },
        "nv21" => Order::Planes { u: 1, halved: true },
        "nv24" => Order::Planes { u: 0, halved: false },
        _ => return None,
    })
}

/// Whether this is a YUV encoding.
pub fn is_yuv(encoding: &str) -> bool {
    order(encoding).is_some()
}

/// `rgb8` without padding; `None` where the data are too short.
pub fn to_rgb8(
    encoding: &str,
    (width, height): (usize, usize),
    step: usize,
    data: &[u8],
) -> Option<Vec<u8>> {
    let mut rgb = Vec::new();
    match order(encoding)? {
        Order::Packed { y, u, v } => {
            let row_bytes = width.div_ceil(2) * 4;
            data.get(..step.checked_mul(height - 1)?.checked_add(row_bytes)?)
                .filter(|_| step >= row_bytes)?;
            rgb.reserve_exact(width * height * 3);
            for row in 0..height {
                let row = &data[row * step..row * step + row_bytes];
                for x in 0..width {
                    let group = &row[x / 2 * 4..x / 2 * 4 + 4];
                    rgb.extend(pixel(group[y[x % 2]], group[u], group[v]));
                }
            }
        }
        Order::Planes { u, halved } => {
            let (shrink, chroma_step) = if halved { (2, step) } else { (1, step.checked_mul(2)?) };
            let (chroma_rows, pairs) = (height.div_ceil(shrink), width.div_ceil(shrink));
            let start = step.checked_mul(height)?;
            let end = chroma_step
                .checked_mul(chroma_rows - 1)?
                .checked_add(2 * pairs)?
                .checked_add(start)?;
            let fits = step >= width && chroma_step >= 2 * pairs;
            let (luma, chroma) = data.get(..end).filter(|_| fits)?.split_at(start);
            rgb.reserve_exact(width * height * 3);
            for row in 0..height {
                let (ys, pairs) = (&luma[row * step..], &chroma[row / shrink * chroma_step..]);
                for x in 0..width {
                    let at = x / shrink * 2;
                    rgb.extend(pixel(ys[x], pairs[at + u], pairs[at + 1 - u]));
                }
            }
        }
    }
    Some(rgb)
}

fn pixel(y: u8, u: u8, v: u8) -> [u8; 3] {
    let luma = 255.0 / 219.0 * (f32::from(y) - 16.0);
    let (u, v) = (255.0 / 224.0 * (f32::from(u) - 128.0), 255.0 / 224.0 * (f32::from(v) - 128.0));
    [luma + 1.402 * v, luma - 0.344_136 * u - 0.714_136 * v, luma + 1.772 * u]
        .map(|c| c.round().clamp(0.0, 255.0) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn red_is_the_same_in_every_layout() {
        // Y 81, U 90, V 240 is red in BT.601.
        let red = [254u8, 0, 0];
        let cases: [(&str, usize, Vec<u8>); 5] = [
            ("uyvy", 8, [90, 81, 240, 81].repeat(8)),
            ("yuyv", 8, [81, 90, 81, 240].repeat(8)),
            ("nv12", 4, [vec![81; 16], [90, 240].repeat(4)].concat()),
            ("nv21", 4, [vec![81; 16], [240, 90].repeat(4)].concat()),
            ("nv24", 4, [vec![81; 16], [90, 240].repeat(16)].concat()),
        ];
        for (encoding, step, data) in cases {
            let rgb = to_rgb8(encoding, (4, 4), step, &data).expect(encoding);
            assert_eq!((rgb.len(), &rgb[..3], &rgb[45..]), (48, &red[..], &red[..]), "{encoding}");
            assert_eq!(
                to_rgb8(encoding, (4, 4), step, &data[..data.len() - 1]),
                None,
                "{encoding} truncated"
            );
            assert_eq!(to_rgb8(encoding, (4, 4), usize::MAX, &data), None);
        }
    }
}
