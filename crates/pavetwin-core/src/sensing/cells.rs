//! The spatial hash shared by the trace and the solids: 32 m cells, keyed row by row.
//!
//! Entries are kept sorted by key, so that one row of cells is one contiguous run that a binary search finds. The
//! cost of a query grows with what lies near it, and with the logarithm of what lies elsewhere.

use crate::geometry::Vec2;

/// Side of a hash cell, metres: about one camera footprint.
pub(crate) const CELL_M: f64 = 32.0;

/// Largest coordinate that can be indexed, metres either side of the origin.
pub(crate) const MAX_COORDINATE_M: f64 = 1.0e6;

const HALF: i32 = 1 << 15;

/// Index of the cell column (or row) that holds a coordinate; values outside the indexable range go to its rim.
fn cell_of(coordinate_m: f64) -> u32 {
    let index = (coordinate_m / CELL_M).floor() as i32;
    (index.clamp(-HALF, HALF - 1) + HALF) as u32
}

fn key(column: u32, row: u32) -> u32 {
    (row << 16) | column
}

/// The key of the cell that holds `point`.
pub(crate) fn key_of(point: Vec2) -> u32 {
    key(cell_of(point.x), cell_of(point.y))
}

/// A block of hash cells, both ends included.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CellBlock {
    columns: (u32, u32),
    rows: (u32, u32),
}

impl CellBlock {
    /// The cells that meet the box from `min` to `max`.
    pub(crate) fn covering(min: Vec2, max: Vec2) -> Self {
        Self { columns: (cell_of(min.x), cell_of(max.x)), rows: (cell_of(min.y), cell_of(max.y)) }
    }

    pub(crate) fn keys(self) -> impl Iterator<Item = u32> {
        let Self { columns, rows } = self;
        (rows.0..=rows.1).flat_map(move |row| (columns.0..=columns.1).map(move |column| key(column, row)))
    }

    /// The key of the first cell that this block and `other` share. A thing filed under several cells is reported
    /// from this one alone, which needs no marks and so no mutable state.
    pub(crate) fn first_shared_key(&self, other: &Self) -> u32 {
        key(self.columns.0.max(other.columns.0), self.rows.0.max(other.rows.0))
    }

    /// Calls `visit` with the position of every entry of the sorted `keys` that lies in this block.
    pub(crate) fn visit(&self, keys: &[u32], mut visit: impl FnMut(usize)) {
        let mut from = 0;
        for row in self.rows.0..=self.rows.1 {
            let (first, last) = (key(self.columns.0, row), key(self.columns.1, row));
            from += keys[from..].partition_point(|&k| k < first);
            while from < keys.len() && keys[from] <= last {
                visit(from);
                from += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_visits_its_cells_and_no_others() {
        let points: Vec<Vec2> =
            (-4..5).flat_map(|x| (-4..5).map(move |y| Vec2::new(f64::from(x) * 20.0, f64::from(y) * 20.0))).collect();
        let mut keys: Vec<u32> = points.iter().map(|&p| key_of(p)).collect();
        keys.sort_unstable();
        let block = CellBlock::covering(Vec2::new(-33.0, -1.0), Vec2::new(31.0, 40.0));
        let mut found = Vec::new();
        block.visit(&keys, |i| found.push(keys[i]));
        let expected: Vec<u32> = keys.iter().copied().filter(|&k| block.keys().any(|inside| inside == k)).collect();
        assert_eq!(found, expected);
        assert_eq!(block.keys().count(), 9);
    }

    #[test]
    fn far_away_coordinates_fall_on_the_rim() {
        assert_eq!(cell_of(-1.0e12), 0);
        assert_eq!(cell_of(1.0e12), (1 << 16) - 1);
    }
}
