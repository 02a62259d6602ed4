//! Rows of a picture that are made one after the other, each with those above and below it at hand: what is made of a
//! whole picture need not be kept.

use super::{channels, channels_mut};

/// Three rows of reds, greens and blues, moved down a picture.
pub struct Window {
    height: usize,
    /// Row r is the (r mod 3)-rd.
    rows: [Vec<f32>; 3],
    /// The first row that was not made yet.
    next: usize,
    /// A sum over three rows of one colour, with its first and its last pixel once more beyond the ends.
    upright: Vec<f32>,
}

impl Window {
    /// Above a picture.
    pub fn over(width: usize, height: usize) -> Self {
        let rows = std::array::from_fn(|_| vec![0.0; width * 3]);
        Self { height, rows, next: 0, upright: vec![0.0; width + 2] }
    }

    /// Move down to a row; `make` fills those that are needed and not there yet.
    pub fn move_to(&mut self, row: usize, mut make: impl FnMut(usize, &mut [f32])) {
        let last = (row + 1).min(self.height - 1);
        for row in self.next.max(row.saturating_sub(1))..=last {
            make(row, &mut self.rows[row % 3]);
        }
        self.next = last + 1;
    }

    /// A row that is there.
    pub fn row(&self, row: usize) -> &[f32] {
        &self.rows[row % 3]
    }

    /// The row that it was moved to, convolved with (tail, 1 − 2·tail, tail) both ways; edges go on outwards.
    pub fn convolved(&mut self, row: usize, tail: f32, out: &mut [f32]) {
        let Self { rows, upright, .. } = self;
        let [above, here, below] =
            [row.saturating_sub(1), row, (row + 1).min(self.height - 1)].map(|row| channels(&rows[row % 3]));
        let (centre, width) = (1.0 - 2.0 * tail, upright.len() - 2);
        for (channel, out) in channels_mut(out).into_iter().enumerate() {
            let (above, here, below) = (above[channel], here[channel], below[channel]);
            for (sum, ((above, below), here)) in upright[1..].iter_mut().zip(above.iter().zip(below).zip(here)) {
                *sum = tail * (above + below) + centre * here;
            }
            (upright[0], upright[width + 1]) = (upright[1], upright[width]);
            let neighbours = upright.iter().zip(&upright[1..]).zip(&upright[2..]);
            for (out, ((left, middle), right)) in out.iter_mut().zip(neighbours) {
                *out = tail * (left + right) + centre * middle;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Window;

    #[test]
    fn every_row_is_made_once_and_a_picture_goes_on_at_its_edges() {
        let (width, height) = (4, 5);
        let mut made = Vec::new();
        let mut window = Window::over(width, height);
        for row in 2..height {
            window.move_to(row, |row, line| {
                made.push(row);
                line.fill(row as f32);
            });
            assert!(window.row(row).iter().all(|value| *value == row as f32));
            let mut out = vec![0.0; width * 3];
            window.convolved(row, 0.25, &mut out);
            let below = (row + 1).min(height - 1);
            let mean = 0.25 * ((row - 1) as f32 + below as f32) + 0.5 * row as f32;
            assert!(out.iter().all(|value| (value - mean).abs() < 1e-6), "{row}: {out:?}");
        }
        assert_eq!(made, [1, 2, 3, 4]);
    }
}
