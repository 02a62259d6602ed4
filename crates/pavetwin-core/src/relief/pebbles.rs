//! Aggregate as it shows where the binder has gone: rounded tops of stones, packed closely.

use super::{Grid, hash, share};

/// The tops of stones over every cell that was asked for.
#[derive(Debug, Clone)]
pub struct Pebbles {
    /// 1 at a stone's top, 0 in the gaps between stones.
    pub dome: Vec<f32>,
    /// A number in [0, 1) that is the same all over a stone.
    pub tone: Vec<f32>,
}

/// Stones of about `size_m`, one in each square of a jittered lattice, where `wanted` says so.
pub fn pebbles(grid: &Grid, wanted: &[bool], seed: u64, size_m: f64) -> Pebbles {
    let mut made = Pebbles { dome: vec![0.0; grid.len()], tone: vec![0.0; grid.len()] };
    let mut cache = Cache::new(grid, seed, size_m);
    for row in 0..grid.rows {
        let y = ((grid.y0_m + row as f64 * grid.cell_m) / size_m) as f32;
        cache.go_to(y.floor() as i64);
        for col in 0..grid.cols {
            let at = row * grid.cols + col;
            if wanted[at] {
                let x = ((grid.x0_m + col as f64 * grid.cell_m) / size_m) as f32;
                (made.dome[at], made.tone[at]) = cache.look(x, y);
            }
        }
    }
    made
}

/// Three rows of the lattice's stones around the present one: (x, y, radius, tone), in units of the lattice.
struct Cache {
    seed: u64,
    first: i64,
    count: usize,
    at: i64,
    rows: [Vec<[f32; 4]>; 3],
}

impl Cache {
    fn new(grid: &Grid, seed: u64, size_m: f64) -> Self {
        let first = (grid.x0_m / size_m).floor() as i64 - 1;
        let last = ((grid.x0_m + grid.cols as f64 * grid.cell_m) / size_m).floor() as i64 + 1;
        let rows = [Vec::new(), Vec::new(), Vec::new()];
        Self { seed, first, count: (last - first + 1) as usize, at: i64::MIN, rows }
    }

    fn go_to(&mut self, row: i64) {
        if row != self.at {
            self.at = row;
            for (slot, y) in (row - 1..=row + 1).enumerate() {
                self.rows[slot] = (0..self.count as i64).map(|step| self.stone(self.first + step, y)).collect();
            }
        }
    }

    fn stone(&self, x: i64, y: i64) -> [f32; 4] {
        let bits = hash(self.seed, x, y);
        let more = hash(bits, 3, 5);
        let jitter = |hash: u64| 0.12 + 0.76 * share(hash);
        let radius = 0.42 + 0.3 * share(hash(more, 1, 1));
        [x as f32 + jitter(bits), y as f32 + jitter(more), radius, share(hash(more, 9, 2))]
    }

    fn look(&self, x: f32, y: f32) -> (f32, f32) {
        let middle = (x.floor() as i64 - self.first) as usize;
        let (mut dome, mut tone) = (0.0f32, 0.0f32);
        for row in &self.rows {
            for stone in &row[middle.saturating_sub(1)..(middle + 2).min(self.count)] {
                let (dx, dy) = (x - stone[0], y - stone[1]);
                let top = 1.0 - (dx * dx + dy * dy) / (stone[2] * stone[2]);
                if top > dome {
                    (dome, tone) = (top, stone[3]);
                }
            }
        }
        (dome.sqrt(), tone)
    }
}
