//! Orientation and descriptor of a keypoint: histograms of the directions of gradients around it
//! (Lowe, IJCV 2004).

use super::keypoints::Plane;

/// 4 × 4 cells of 8 gradient directions, as small integers whose dot products are exact.
pub type Descriptor = [i16; 128];

/// The whole part of what is not negative and not large; to 32 bits it is one instruction and a
/// check, to 64 it is many.
fn whole(value: f32) -> usize {
    value as i32 as usize
}

/// Direction of a gradient in turns, 0 to 1, within 0.0001: histograms are coarser.
fn turns(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (least, most) = (ax.min(ay), ax.max(ay).max(1e-30));
    let t = least / most;
    let s = t * t;
    let eighth = t
        * (0.999_866 + s * (-0.330_299_5 + s * (0.180_141 + s * (-0.085_133 + s * 0.020_835_1))))
        * (0.5 / std::f32::consts::PI);
    let quarter = if ay > ax { 0.25 - eighth } else { eighth };
    let half = if x < 0.0 { 0.5 - quarter } else { quarter };
    if y < 0.0 { 1.0 - half } else { half }
}

impl Plane {
    /// Gradients in the square around a place, row by row: where each lies from it (px), its
    /// strength under a Gaussian of exponent `per_square` · r², its direction (turns). `within`
    /// gives the columns of interest of a row, from the place on.
    fn around(
        &self,
        (u, v): (f32, f32),
        radius: usize,
        per_square: f32,
        within: impl Fn(f32) -> (f32, f32),
        mut take: impl FnMut(f32, f32, f32, f32),
    ) {
        // At the edges there is none.
        let span = |centre: f32, count: usize| {
            let centre = centre.round() as usize;
            centre.saturating_sub(radius).max(1)..(centre + radius + 1).min(count - 1)
        };
        let falloff = |d: f32| (d * d * per_square).exp();
        let columns = span(u, self.width);
        let across: Vec<(f32, f32)> =
            columns.clone().map(|x| x as f32 - u).map(|d| (d, falloff(d))).collect();
        let (mut strengths, mut directions) = (vec![0f32; across.len()], vec![0f32; across.len()]);
        for y in span(v, self.height) {
            let py = y as f32 - v;
            let down = falloff(py);
            let (from, to) = within(py);
            // A pixel more on both sides: what lies on the very edge is for `take` to say.
            let from = ((u + from).floor() as usize).clamp(columns.start, columns.end);
            let to = (((u + to).ceil() + 1.0) as usize).clamp(from, columns.end);
            let (count, row) =
                (to - from, |y: usize, x: usize| &self.data[y * self.width + x..][..to - from]);
            let (left, right, above, below) =
                (row(y, from - 1), row(y, from + 1), row(y - 1, from), row(y + 1, from));
            let (strengths, directions) = (&mut strengths[..count], &mut directions[..count]);
            for i in 0..count {
                let (gx, gy) = (right[i] - left[i], below[i] - above[i]);
                strengths[i] = (gx * gx + gy * gy).sqrt();
                directions[i] = turns(gy, gx);
            }
            for ((px, weight), (strength, direction)) in
                across[from - columns.start..].iter().zip(strengths.iter().zip(&*directions))
            {
                take(*px, py, strength * weight * down, *direction);
            }
        }
    }

    /// The strongest direction of the gradients around a point (rad).
    pub fn orientation(&self, u: f32, v: f32, sigma: f32) -> f32 {
        const BINS: usize = 36;
        let mut histogram = [0f32; BINS];
        let per_square = -0.5 / (1.5 * sigma).powi(2);
        let (centre, radius, all) =
            ((u.round(), v.round()), (4.5 * sigma).round() as usize, |_| {
                (f32::NEG_INFINITY, f32::INFINITY)
            });
        self.around(centre, radius, per_square, all, |_, _, strength, direction| {
            histogram[whole(direction * BINS as f32 + 0.5) % BINS] += strength;
        });
        for _ in 0..2 {
            let before = histogram;
            for (i, value) in histogram.iter_mut().enumerate() {
                *value = 0.25 * before[(i + BINS - 1) % BINS]
                    + 0.5 * before[i]
                    + 0.25 * before[(i + 1) % BINS];
            }
        }
        let peak = (0..BINS).max_by(|a, b| histogram[*a].total_cmp(&histogram[*b])).unwrap_or(0);
        let (l, c, r) =
            (histogram[(peak + BINS - 1) % BINS], histogram[peak], histogram[(peak + 1) % BINS]);
        let curvature = l - 2.0 * c + r;
        let offset = if curvature.abs() > 1e-12 { 0.5 * (l - r) / curvature } else { 0.0 };
        (peak as f32 + offset) / BINS as f32 * std::f32::consts::TAU
    }

    /// 4 × 4 cells, turned by `angle` (rad), of the directions of gradients in each.
    pub fn descriptor(&self, u: f32, v: f32, sigma: f32, angle: f32) -> Descriptor {
        // Directions are a circle: what falls into the ninth is the first's.
        // Eight cells per row, where seven would do: an index in range needs no check.
        let mut padded = [[0f32; 9]; 8 * 8];
        let (sin, cos) = angle.sin_cos();
        let zero = (angle / std::f32::consts::TAU).rem_euclid(1.0);
        let per_px = 1.0 / (3.0 * sigma);
        let radius = (3.0 * sigma * std::f32::consts::SQRT_2 * 2.5).round() as usize;
        // The turned square's edges on a row: where either of its axes is left.
        let half = 2.5 / per_px;
        let within = |py: f32| {
            let edges = |middle: f32, slope: f32| {
                ((middle - half.copysign(slope)) / slope, (middle + half.copysign(slope)) / slope)
            };
            let (along, square) = (edges(-sin * py, cos), edges(cos * py, sin));
            (along.0.max(square.0), along.1.min(square.1))
        };
        self.around((u, v), radius, -per_px * per_px / 8.0, within, |px, py, weight, direction| {
            let (rx, ry) = ((cos * px + sin * py) * per_px, (cos * py - sin * px) * per_px);
            if rx.abs() >= 2.5 || ry.abs() >= 2.5 {
                return;
            }
            let direction = direction - zero;
            let direction = 8.0 * if direction < 0.0 { direction + 1.0 } else { direction };
            // Cells of margin hold what falls beside the sixteen, and what rounding carries to the
            // very edge.
            let (bx, by) = (rx + 2.5, ry + 2.5);
            let (ix, iy, id) = (whole(bx), whole(by), whole(direction).min(7));
            let (fx, fy, fd) = (bx - ix as f32, by - iy as f32, direction - id as f32);
            for (row, wy) in [(iy, 1.0 - fy), (iy + 1, fy)] {
                for (column, wx) in [(ix, 1.0 - fx), (ix + 1, fx)] {
                    let cell = &mut padded[(8 * row + column) % 64];
                    let share = weight * wx * wy;
                    cell[id] += share * (1.0 - fd);
                    cell[id + 1] += share * fd;
                }
            }
        });
        padded.iter_mut().for_each(|cell| cell[0] += cell[8]);
        let mut histogram: [f32; 128] =
            std::array::from_fn(|i| padded[(i / 32 + 1) * 8 + i / 8 % 4 + 1][i % 8]);
        let norm = |h: &[f32; 128]| h.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-12);
        let first = norm(&histogram);
        histogram.iter_mut().for_each(|v| *v = (*v / first).min(0.2));
        let second = norm(&histogram);
        histogram.map(|v| (v / second * 512.0).round() as i16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_right_all_around() {
        for k in 0..1000 {
            let angle = k as f32 / 1000.0;
            let (sin, cos) = (angle * std::f32::consts::TAU).sin_cos();
            let error = turns(3.0 * sin, 3.0 * cos) - angle;
            assert!((error - error.round()).abs() < 1e-4, "{error} at {angle}");
        }
    }
}
