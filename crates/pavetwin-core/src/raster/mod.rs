//! Distances to lines and bars on the square raster of a ground tile, each computed only where it is needed.
//!
//! Coordinates are metres from the raster's south-west corner; row 0 is south. Distances are in single precision, as
//! the maps that are made of them.

mod bars;
mod tracks;
mod weathering;

pub use bars::{Bar, Paint, covered, painted};
pub use tracks::{Line, Tracks, tracks};
pub use weathering::{Beside, Weathering, looked_up, weathered};

use std::ops::Range;

/// A square of `px` × `px` cells.
#[derive(Debug, Clone)]
pub struct Raster {
    px: usize,
    cell_m: f64,
    /// Of the cells' centres along either axis.
    middles: Vec<f32>,
}

/// Some of its cells.
struct Window {
    rows: Range<usize>,
    columns: Range<usize>,
}

impl Raster {
    pub fn new(px: usize, cell_m: f64) -> Self {
        let middles = (0..px).map(|index| ((index as f64 + 0.5) * cell_m) as f32).collect();
        Self { px, cell_m, middles }
    }

    fn full<T: Clone>(&self, value: T) -> Vec<T> {
        vec![value; self.px * self.px]
    }

    /// The cells between two corners; None when there are none.
    fn window(&self, low: [f64; 2], high: [f64; 2]) -> Option<Window> {
        let within = |index: f64| index.clamp(0.0, self.px as f64) as usize;
        let first = low.map(|at| within((at / self.cell_m - 0.5).floor()));
        let last = high.map(|at| within((at / self.cell_m + 0.5).ceil()));
        let found = Window { rows: first[1]..last[1], columns: first[0]..last[0] };
        (!found.rows.is_empty() && !found.columns.is_empty()).then_some(found)
    }

    /// East and north of a place, of the columns and of one row of a window.
    fn from(&self, window: &Window, row: usize, [x, y]: [f64; 2]) -> (impl Iterator<Item = f32>, f32) {
        let (x, y) = (x as f32, y as f32);
        (self.middles[window.columns.clone()].iter().map(move |middle| middle - x), self.middles[row] - y)
    }
}
