//! Stairs along edges made smooth, after the picture is drawn with one sample a pixel: each pixel at an edge takes as
//! much from the other side as the edge, followed to its ends, cuts off it (Lottes 2009, FXAA). On a processor this
//! costs a tenth of drawing four samples a pixel.

/// Differences of tone below this are not edges; grain and noise stay as they are.
const LEAST: f32 = 0.06;

/// And below this share of the brighter side.
const LEAST_SHARE: f32 = 0.18;

/// Pixels that an edge is followed.
const LONGEST: usize = 12;

/// How far beyond the picture tones are looked up.
const RIM: usize = LONGEST + 1;

/// The smaller of two numbers: unlike `f32::min` without care for what is none, which a processor has no word for.
pub(super) fn less(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// A picture's tones to find edges in. Those at its border go on outwards for a rim, so that looking there needs no
/// care.
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

    /// Where a pixel at an edge takes from, as a step to a neighbour, and how much.
    fn share(&self, column: usize, row: usize) -> Option<((isize, isize), f32)> {
        let stride = self.width + 2 * RIM;
        let place = (row + RIM) * stride + column + RIM;
        // The three rows of nine, and so the neighbours, in one look each.
        let [above, level, below] = [place - stride, place, place + stride].map(|at| &self.values[at - 1..][..3]);
        let (here, up, down, left, right) = (level[1], above[1], below[1], level[0], level[2]);
        let bend = |a: f32, b: f32, c: f32| (a + c - 2.0 * b).abs();
        let (a, b, c, d) = (above[0], above[2], below[0], below[2]);
        let flat = 2.0 * bend(up, here, down) + bend(a, left, c) + bend(b, right, d);
        let upright = 2.0 * bend(left, here, right) + bend(a, up, b) + bend(c, down, d);
        // The edge runs along one axis; its other side lies across.
        let is_flat = flat >= upright;
        let (before, after) = if is_flat { (up, down) } else { (left, right) };
        let sign = if (before - here).abs() >= (after - here).abs() { -1 } else { 1 };
        let other = if sign < 0 { before } else { after };
        let (beside, step) = if is_flat { (stride, 1) } else { (1, stride) };
        let across = place.wrapping_add_signed(sign * beside as isize);
        let (middle, least) = (0.5 * (here + other), 0.25 * (other - here).abs());
        let end = |sense: isize| {
            let (mut own, mut their) = (place, across);
            for way in 1..=LONGEST {
                (own, their) = (own.wrapping_add_signed(sense), their.wrapping_add_signed(sense));
                let away = 0.5 * (self.values[own] + self.values[their]) - middle;
                if away.abs() >= least {
                    return (way, away);
                }
            }
            (LONGEST, 0.0)
        };
        let ((back, back_tone), (ahead, ahead_tone)) = (end(-(step as isize)), end(step as isize));
        let (nearest, tone) = if back < ahead { (back, back_tone) } else { (ahead, ahead_tone) };
        // Only where the edge ends towards this pixel's side does it cut into the pixel.
        let cuts = (tone < 0.0) != (here < middle) && tone != 0.0;
        let share = 0.5 - nearest as f32 / (back + ahead) as f32;
        let to = if is_flat { (0, sign) } else { (sign, 0) };
        (cuts && share > 0.0).then_some((to, share))
    }

    /// Whether each pixel of a row differs enough from one beside it to lie at an edge.
    fn edges(&self, row: usize) -> Vec<bool> {
        let stride = self.width + 2 * RIM;
        let line = |row: usize| &self.values[row * stride + RIM..][..self.width];
        let (up, down) = (line(row + RIM - 1), line(row + RIM + 1));
        let here = &self.values[(row + RIM) * stride + RIM - 1..][..self.width + 2];
        (here.windows(3).zip(up.iter().zip(down)))
            .map(|(three, (up, down))| {
                let low = less(less(less(three[0], three[1]), three[2]), less(*up, *down));
                let high = -less(less(less(-three[0], -three[1]), -three[2]), less(-up, -down));
                high - low >= LEAST.max(LEAST_SHARE * high)
            })
            .collect()
    }

    /// Make one row's edges smooth. `line`: its reds, greens and blues; `pixel`: what the picture holds at (column,
    /// row); `white`: what is mixed at most of either side.
    pub fn smooth(&self, row: usize, line: &mut [f32], white: [f32; 3], pixel: impl Fn(usize, usize) -> [f32; 3]) {
        for (column, _) in self.edges(row).into_iter().enumerate().filter(|(_, edge)| *edge) {
            if let Some(((dx, dy), share)) = self.share(column, row) {
                let x = column.saturating_add_signed(dx).min(self.width - 1);
                let y = row.saturating_add_signed(dy).min(self.height - 1);
                for ((channel, other), most) in super::channels_mut(line).into_iter().zip(pixel(x, y)).zip(white) {
                    let own = less(channel[column], most);
                    channel[column] = own + share * (less(other, most) - own);
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
            tones.smooth(row, line, [1.0; 3], |column, row| {
                std::array::from_fn(|it| before[(row * 3 + it) * size + column])
            });
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
    fn stairs_beside_light_that_is_stored_as_white_become_slopes_too() {
        let dark_or = |bright: f32| move |value: &f32| if *value > 0.5 { bright } else { 0.2 };
        let (_, plane) = stairs(0.2, 64);
        let stored: Vec<f32> = plane.iter().map(dark_or(0.8)).collect();
        let mut glaring: Vec<f32> = plane.iter().map(dark_or(6.0)).collect();
        let tones = square(64, &plane.chunks(3 * 64).flat_map(|row| &row[..64]).map(dark_or(1.0)).collect::<Vec<_>>());
        smoothen(&tones, &mut glaring, 64);
        // White is 1: from 0.2 … 1 to the 0.2 … 0.8 that the error is measured in.
        let seen: Vec<f32> = glaring.iter().map(|value| 0.2 + 0.75 * (value.min(1.0) - 0.2)).collect();
        assert!(error(&seen, 0.2, 64) < 0.55 * error(&stored, 0.2, 64));
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
