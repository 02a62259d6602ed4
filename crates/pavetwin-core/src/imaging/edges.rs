//! Stairs along edges made smooth, after the picture is drawn with one sample a pixel: each pixel at an edge takes as
//! much from the other side as the edge, followed to its ends, cuts off it (Lottes 2009, FXAA). On a processor this
//! costs a tenth of drawing four samples a pixel.

/// Differences of tone below this are no edge; grain and noise stay as they are.
const LEAST: f32 = 0.06;

/// And below this share of the brighter side.
const LEAST_SHARE: f32 = 0.18;

/// Pixels that an edge is followed.
const LONGEST: i32 = 12;

/// How far beyond the picture tones are looked up.
const RIM: usize = LONGEST as usize + 1;

/// A picture's tones to find edges in. Those at its border go on outwards for a rim, so that looking there needs no care.
pub struct Tones {
    width: usize,
    height: usize,
    /// (height + 2 · rim) × (width + 2 · rim).
    values: Vec<f32>,
}

impl Tones {
    /// `tone` fills one row of the picture.
    pub fn of(width: usize, height: usize, tone: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        let mut values = vec![0.0_f32; (width + 2 * RIM) * (height + 2 * RIM)];
        super::in_bands(width + 2 * RIM, &mut values, |first, band| {
            for (row, line) in (first..).zip(band.chunks_exact_mut(width + 2 * RIM)) {
                let (left, rest) = line.split_at_mut(RIM);
                let (middle, right) = rest.split_at_mut(width);
                tone(row.saturating_sub(RIM).min(height - 1), middle);
                left.fill(middle[0]);
                right.fill(middle[width - 1]);
            }
        });
        Self { width, height, values }
    }

    fn at(&self, column: i32, row: i32) -> f32 {
        let (column, row) = (column + RIM as i32, row + RIM as i32);
        self.values[row as usize * (self.width + 2 * RIM) + column as usize]
    }

    /// Where a pixel at an edge takes from, as a step to a neighbour, and how much.
    fn share(&self, column: i32, row: i32) -> Option<((i32, i32), f32)> {
        let at = |dx: i32, dy: i32| self.at(column + dx, row + dy);
        let (here, up, down, left, right) = (at(0, 0), at(0, -1), at(0, 1), at(-1, 0), at(1, 0));
        let bend = |a: f32, b: f32, c: f32| (a + c - 2.0 * b).abs();
        let (a, b, c, d) = (at(-1, -1), at(1, -1), at(-1, 1), at(1, 1));
        let level = 2.0 * bend(up, here, down) + bend(a, left, c) + bend(b, right, d);
        let upright = 2.0 * bend(left, here, right) + bend(a, up, b) + bend(c, down, d);
        // The edge runs along `along`; its other side lies across.
        let is_level = level >= upright;
        let (before, after) = if is_level { (up, down) } else { (left, right) };
        let sign = if (before - here).abs() >= (after - here).abs() { -1 } else { 1 };
        let other = if sign < 0 { before } else { after };
        let (across, along) = if is_level { ((0, sign), (1, 0)) } else { ((sign, 0), (0, 1)) };
        let (middle, step) = (0.5 * (here + other), 0.25 * (other - here).abs());
        let between = |way: i32| {
            let (x, y) = (along.0 * way, along.1 * way);
            0.5 * (at(x, y) + at(x + across.0, y + across.1)) - middle
        };
        let end = |sense: i32| {
            (1..=LONGEST)
                .map(|way| (way, between(sense * way)))
                .find(|(_, away)| away.abs() >= step)
                .unwrap_or((LONGEST, 0.0))
        };
        let ((back, back_tone), (ahead, ahead_tone)) = (end(-1), end(1));
        let (nearest, tone) = if back < ahead { (back, back_tone) } else { (ahead, ahead_tone) };
        // Only where the edge ends towards this pixel's side does it cut into the pixel.
        let cuts = (tone < 0.0) != (here < middle) && tone != 0.0;
        let share = 0.5 - nearest as f32 / (back + ahead) as f32;
        (cuts && share > 0.0).then_some((across, share))
    }

    /// Whether each pixel of a row differs enough from one beside it to lie at an edge.
    fn edges(&self, row: usize) -> Vec<bool> {
        let stride = self.width + 2 * RIM;
        let line = |row: usize| &self.values[row * stride + RIM..][..self.width];
        let (up, down) = (line(row + RIM - 1), line(row + RIM + 1));
        let here = &self.values[(row + RIM) * stride + RIM - 1..][..self.width + 2];
        (here.windows(3).zip(up.iter().zip(down)))
            .map(|(three, (up, down))| {
                let low = three[0].min(three[1]).min(three[2]).min(*up).min(*down);
                let high = three[0].max(three[1]).max(three[2]).max(*up).max(*down);
                high - low >= LEAST.max(LEAST_SHARE * high)
            })
            .collect()
    }

    /// Make one row's edges smooth. `line`: its reds, greens and blues; `pixel`: what the picture holds at (column, row).
    pub fn smooth(&self, row: usize, line: &mut [f32], pixel: impl Fn(usize, usize) -> [f32; 3]) {
        for (column, _) in self.edges(row).into_iter().enumerate().filter(|(_, edge)| *edge) {
            if let Some(((dx, dy), share)) = self.share(column as i32, row as i32) {
                let x = (column as i32 + dx).clamp(0, self.width as i32 - 1) as usize;
                let y = (row as i32 + dy).clamp(0, self.height as i32 - 1) as usize;
                for (channel, other) in super::channels_mut(line).into_iter().zip(pixel(x, y)) {
                    channel[column] += share * (other - channel[column]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Tones;

    fn square(size: usize, values: &[f32]) -> Tones {
        Tones::of(size, size, |row, line| line.copy_from_slice(&values[row * size..][..size]))
    }

    /// Rows of reds, greens and blues.
    fn grey(size: usize, values: &[f32]) -> Vec<f32> {
        values.chunks(size).flat_map(|row| row.repeat(3)).collect()
    }

    /// A half plane under y = slope · x, drawn with one sample a pixel.
    fn stairs(slope: f32, size: usize) -> (Tones, Vec<f32>) {
        let values: Vec<f32> = (0..size * size)
            .map(|pixel| {
                let (x, y) = ((pixel % size) as f32 + 0.5, (pixel / size) as f32 + 0.5);
                if y - 0.5 * size as f32 > slope * (x - 0.5 * size as f32) { 0.8 } else { 0.2 }
            })
            .collect();
        (square(size, &values), grey(size, &values))
    }

    fn smoothen(tones: &Tones, plane: &mut [f32], size: usize) {
        let before = plane.to_vec();
        for (row, line) in plane.chunks_mut(size * 3).enumerate() {
            tones.smooth(row, line, |column, row| std::array::from_fn(|it| before[(row * 3 + it) * size + column]));
        }
    }

    /// Mean distance of an edge from where it should be, in each column.
    fn error(plane: &[f32], slope: f32, size: usize) -> f32 {
        let column_error = |column: usize| {
            let bright: f32 = (0..size).map(|row| (plane[row * 3 * size + column] - 0.2) / 0.6).sum();
            let edge = 0.5 * size as f32 + slope * (column as f32 + 0.5 - 0.5 * size as f32);
            (bright - (size as f32 - edge)).abs()
        };
        (8..size - 8).map(column_error).sum::<f32>() / (size - 16) as f32
    }

    #[test]
    fn stairs_become_slopes() {
        for slope in [0.1, 0.2, 0.35] {
            let (tones, plane) = stairs(slope, 64);
            let mut smooth = plane.clone();
            smoothen(&tones, &mut smooth, 64);
            let (before, after) = (error(&plane, slope, 64), error(&smooth, slope, 64));
            assert!(after < 0.55 * before, "slope {slope}: {before} → {after}");
        }
    }

    #[test]
    fn straight_edges_and_grain_stay() {
        let (tones, plane) = stairs(0.0, 32);
        let mut smooth = plane.clone();
        smoothen(&tones, &mut smooth, 32);
        assert_eq!(plane, smooth);
        let grain: Vec<f32> = (0..32 * 32).map(|pixel| 0.4 + 0.02 * ((pixel * 7919 % 13) as f32 / 12.0)).collect();
        let (tones, plane) = (square(32, &grain), grey(32, &grain));
        let mut smooth = plane.clone();
        smoothen(&tones, &mut smooth, 32);
        assert_eq!(plane, smooth);
    }
}
