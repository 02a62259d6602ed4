//! Kernels of surface relief: noise, strokes, cells, regions, outlines, widths and meshes on a square grid.
//!
//! A grid's value `[row * cols + col]` belongs to the cell centred at `(x0 + col * cell, y0 + row * cell)`, in metres.
//! Everything is plain arithmetic on one thread, so that the same input gives the same bytes anywhere.

mod blocks;
mod mesh;
mod noise;
mod outline;
mod pebbles;
mod region;
mod strokes;
mod widths;

pub use blocks::{Blocks, blocks};
pub use mesh::{Mesh, mesh};
pub use noise::{Noise, noise};
pub use outline::outline;
pub use pebbles::{Pebbles, pebbles};
pub use region::{largest_part, region};
pub use strokes::{Strokes, Traced, trace};
pub use widths::widths;

/// A square grid's extent and place.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    pub rows: usize,
    pub cols: usize,
    pub cell_m: f64,
    pub x0_m: f64,
    pub y0_m: f64,
}

impl Grid {
    pub fn len(&self) -> usize {
        self.rows * self.cols
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The first and last index (exclusive) of cells whose centres lie within `low … high`, along x.
    fn columns(&self, low: f64, high: f64) -> (usize, usize) {
        span(low - self.x0_m, high - self.x0_m, self.cell_m, self.cols)
    }

    /// The same along y.
    fn rows_between(&self, low: f64, high: f64) -> (usize, usize) {
        span(low - self.y0_m, high - self.y0_m, self.cell_m, self.rows)
    }
}

fn span(low: f64, high: f64, cell: f64, count: usize) -> (usize, usize) {
    let first = (low / cell).ceil().clamp(0.0, count as f64) as usize;
    let end = ((high / cell).floor() + 1.0).clamp(0.0, count as f64) as usize;
    (first, end.max(first))
}

/// A number from a seed and two whole ones, evenly spread over all 64 bits (SplitMix64's finaliser).
fn hash(seed: u64, x: i64, y: i64) -> u64 {
    let mut value = seed
        .wrapping_add((x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15))
        .wrapping_add((y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F));
    value = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    value = (value ^ (value >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    value ^ (value >> 31)
}

/// A share in [0, 1) from a hash's upper bits.
fn share(hash: u64) -> f32 {
    (hash >> 40) as f32 / (1u64 << 24) as f32
}
