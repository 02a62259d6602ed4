//! A uniform grid of bins over the plane: what lies near a point, at a cost that does not grow with the city.

use crate::geometry::Vec2;

/// Edge length of a bin, in metres, while the mesh is small enough for [`MAX_BINS`].
const BIN_SIZE_M: f64 = 4.0;
/// More bins than this are never made; they grow instead.
const MAX_BINS: f64 = 4.0e6;

/// Numbered items, each known by the box it covers, findable by place.
#[derive(Debug, Clone)]
pub(super) struct BinGrid {
    min: Vec2,
    bin_size_m: f64,
    columns: usize,
    rows: usize,
    starts: Vec<u32>,
    items: Vec<u32>,
}

/// An axis-aligned box, in metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub min: Vec2,
    pub max: Vec2,
}

impl Bounds {
    pub fn of(points: impl IntoIterator<Item = Vec2>) -> Self {
        let inverted = Self { min: Vec2::new(f64::MAX, f64::MAX), max: Vec2::new(f64::MIN, f64::MIN) };
        points.into_iter().fold(inverted, |bounds, point| Self {
            min: Vec2::new(bounds.min.x.min(point.x), bounds.min.y.min(point.y)),
            max: Vec2::new(bounds.max.x.max(point.x), bounds.max.y.max(point.y)),
        })
    }

    pub fn grown(self, margin_m: f64) -> Self {
        let margin = Vec2::new(margin_m, margin_m);
        Self { min: self.min - margin, max: self.max + margin }
    }
}

impl BinGrid {
    /// Sorts the items into bins; `touches(item, bin)` may refuse a bin that lies in the item's box but not on the
    /// item.
    pub fn new(extent: Bounds, boxes: &[Bounds], touches: impl Fn(usize, Bounds) -> bool) -> Self {
        let size = extent.max - extent.min;
        let bin_size_m = BIN_SIZE_M.max((size.x.max(1.0) * size.y.max(1.0) / MAX_BINS).sqrt());
        let mut grid = Self {
            min: extent.min,
            bin_size_m,
            columns: (size.x / bin_size_m) as usize + 1,
            rows: (size.y / bin_size_m) as usize + 1,
            starts: Vec::new(),
            items: Vec::new(),
        };
        let mut placed = Vec::new();
        for (item, bounds) in boxes.iter().enumerate() {
            let (low, high) = (grid.bin_of(bounds.min), grid.bin_of(bounds.max));
            for row in low.1..=high.1 {
                for column in low.0..=high.0 {
                    if touches(item, grid.bin_bounds(column, row)) {
                        placed.push(((row * grid.columns + column) as u32, item as u32));
                    }
                }
            }
        }
        grid.starts = vec![0; grid.columns * grid.rows + 1];
        for (bin, _) in &placed {
            grid.starts[*bin as usize + 1] += 1;
        }
        for bin in 1..grid.starts.len() {
            grid.starts[bin] += grid.starts[bin - 1];
        }
        placed.sort_unstable();
        grid.items = placed.into_iter().map(|(_, item)| item).collect();
        grid
    }

    /// The items of the bin under `point`; a point beyond the grid has none.
    pub fn at(&self, point: Vec2) -> &[u32] {
        let offset = (point - self.min) * (1.0 / self.bin_size_m);
        if !(offset.x >= 0.0 && offset.y >= 0.0 && offset.x < self.columns as f64 && offset.y < self.rows as f64) {
            return &[];
        }
        self.bin(offset.x as usize, offset.y as usize)
    }

    /// Visits the items around `point` in ever wider square rings of bins. `visit` gets each item (once for every bin
    /// it covers) and returns the best distance found so far; the search ends when nothing further out can beat it.
    pub fn visit_outward(&self, point: Vec2, mut visit: impl FnMut(u32) -> f64) {
        let size = Vec2::new(self.columns as f64, self.rows as f64) * self.bin_size_m;
        let inside =
            Vec2::new(point.x.clamp(self.min.x, self.min.x + size.x), point.y.clamp(self.min.y, self.min.y + size.y));
        let (column, row) = self.bin_of(inside);
        let (column, row) = (column as isize, row as isize);
        let mut best_m = f64::INFINITY;
        for ring in 0..self.columns.max(self.rows) as isize {
            for (dx, dy) in ring_offsets(ring) {
                let (x, y) = (column + dx, row + dy);
                if x >= 0 && y >= 0 && x < self.columns as isize && y < self.rows as isize {
                    for item in self.bin(x as usize, y as usize) {
                        best_m = visit(*item);
                    }
                }
            }
            // What was not visited yet lies at least `ring` bins from the point of the grid nearest to `point`.
            if best_m <= point.distance(inside).hypot(ring as f64 * self.bin_size_m) {
                return;
            }
        }
    }

    /// Visits, at least once, every item whose box meets `bounds`.
    pub fn visit_box(&self, bounds: Bounds, mut visit: impl FnMut(u32)) {
        let (low, high) = (self.bin_of(bounds.min), self.bin_of(bounds.max));
        for row in low.1..=high.1 {
            for column in low.0..=high.0 {
                self.bin(column, row).iter().for_each(|item| visit(*item));
            }
        }
    }

    fn bin(&self, column: usize, row: usize) -> &[u32] {
        let bin = row * self.columns + column;
        &self.items[self.starts[bin] as usize..self.starts[bin + 1] as usize]
    }

    fn bin_of(&self, point: Vec2) -> (usize, usize) {
        let offset = (point - self.min) * (1.0 / self.bin_size_m);
        ((offset.x.max(0.0) as usize).min(self.columns - 1), (offset.y.max(0.0) as usize).min(self.rows - 1))
    }

    fn bin_bounds(&self, column: usize, row: usize) -> Bounds {
        let min = self.min + Vec2::new(column as f64, row as f64) * self.bin_size_m;
        Bounds { min, max: min + Vec2::new(self.bin_size_m, self.bin_size_m) }
    }
}

/// The offsets of the bins whose larger coordinate distance is `ring`.
fn ring_offsets(ring: isize) -> impl Iterator<Item = (isize, isize)> {
    (-ring..=ring).flat_map(move |dy| {
        let step = if dy.abs() == ring || ring == 0 { 1 } else { 2 * ring };
        (-ring..=ring).step_by(step as usize).map(move |dx| (dx, dy))
    })
}
