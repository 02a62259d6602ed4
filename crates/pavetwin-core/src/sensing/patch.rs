//! The part of a grid below a window, as bits.

use super::grid::{GridShape, SurfaceGrid};
use super::raster::{Lattice, Spans, first_from, word_mask};
use crate::geometry::Vec2;

/// A set of cells within a block of a grid's rows and words: the candidates, the visible or the hidden cells of one
/// look. Cleared and filled again without allocating once it has grown to the size of a window.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Patch {
    shape: Option<GridShape>,
    first_row: usize,
    first_word: usize,
    row_count: usize,
    words_per_row: usize,
    words: Vec<u64>,
}

impl Patch {
    /// The grid the cells belong to; `None` before the first look.
    pub fn shape(&self) -> Option<&GridShape> {
        self.shape.as_ref()
    }

    /// The rows of the block as `(row of the grid, first word in that row, words)`.
    pub fn rows(&self) -> impl Iterator<Item = (usize, usize, &[u64])> {
        let rows = self.words.chunks_exact(self.words_per_row.max(1));
        rows.enumerate().map(|(row, words)| (self.first_row + row, self.first_word, words))
    }

    /// The cells as `(column, row)` of the grid, row by row.
    pub fn cells(&self) -> impl Iterator<Item = (usize, usize)> {
        self.rows().flat_map(|(row, first_word, words)| {
            words.iter().enumerate().flat_map(move |(word, &bits)| {
                let columns = (0..64).filter(move |bit| bits >> bit & 1 == 1);
                columns.map(move |bit| ((first_word + word) * 64 + bit, row))
            })
        })
    }

    /// World positions of the centres of the cells.
    pub fn centres(&self) -> impl Iterator<Item = Vec2> {
        self.cells().filter_map(|(column, row)| Some(self.shape?.centre(column, row)))
    }

    /// Number of cells in the set.
    pub fn count(&self) -> u32 {
        self.words.iter().map(|word| word.count_ones()).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|&word| word == 0)
    }

    /// Mean of the cells' centres, `None` for the empty set.
    pub fn centroid(&self) -> Option<Vec2> {
        let (mut count, mut column_sum, mut row_sum) = (0u64, 0u64, 0u64);
        for (row, first_word, words) in self.rows() {
            for (word, &bits) in words.iter().enumerate() {
                let start = (first_word + word) as u64 * 64;
                for (from, length) in runs(bits) {
                    count += length;
                    column_sum += length * (start + from) + length * (length - 1) / 2;
                    row_sum += length * row as u64;
                }
            }
        }
        let shape = self.shape.filter(|_| count > 0)?;
        let mean = Vec2::new(column_sum as f64 / count as f64, row_sum as f64 / count as f64);
        Some(shape.centre(0, 0) + mean * shape.cell_m)
    }

    /// Becomes the cells of `grid` in the block that holds `corners`.
    pub(crate) fn load(&mut self, grid: &SurfaceGrid, corners: &[Vec2]) {
        let shape = grid.shape();
        let mut min = Vec2::new(f64::INFINITY, f64::INFINITY);
        let mut max = -min;
        for corner in corners {
            min = Vec2::new(min.x.min(corner.x), min.y.min(corner.y));
            max = Vec2::new(max.x.max(corner.x), max.y.max(corner.y));
        }
        let origin = shape.centre(0, 0);
        // A cell more on each side than the corners need, so that rounding never cuts the window.
        let index = |value: f64, origin: f64, limit: usize| first_from((value - origin) / shape.cell_m, limit);
        let first_column = index(min.x, origin.x, shape.columns()).saturating_sub(1);
        let end_column = (index(max.x, origin.x, shape.columns()) + 1).min(shape.columns());
        self.shape = Some(*shape);
        self.first_row = index(min.y, origin.y, shape.rows).saturating_sub(1);
        self.row_count = (index(max.y, origin.y, shape.rows) + 1).min(shape.rows).saturating_sub(self.first_row);
        self.first_word = first_column / 64;
        self.words_per_row = end_column.div_ceil(64).saturating_sub(self.first_word);
        self.words.clear();
        for row in self.first_row..self.first_row + self.row_count {
            self.words.extend_from_slice(&grid.row_words(row)[self.first_word..self.first_word + self.words_per_row]);
        }
    }

    /// The lattice on which `Spans` fills shapes for this patch.
    pub(crate) fn lattice(&self) -> Lattice {
        let Some(shape) = &self.shape else { return Lattice::default() };
        Lattice {
            origin: shape.centre(self.first_word * 64, self.first_row),
            cells_per_m: 1.0 / shape.cell_m,
            rows: self.row_count,
            columns: self.words_per_row * 64,
        }
    }

    /// Becomes a copy of `other`.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.words.clone_from(&other.words);
        self.copy_block(other);
    }

    /// Becomes `whole` less `part`, which must be of the same block.
    pub(crate) fn difference(&mut self, whole: &Self, part: &Self) {
        self.words.clear();
        self.words.extend(whole.words.iter().zip(&part.words).map(|(whole, part)| whole & !part));
        self.copy_block(whole);
    }

    /// Keeps only the cells that the spans cover.
    pub(crate) fn retain(&mut self, spans: &Spans) {
        let inside = spans.rows();
        for (row, words) in self.words.chunks_exact_mut(self.words_per_row.max(1)).enumerate() {
            let columns = if inside.contains(&row) { spans.columns(row) } else { 0..0 };
            words.iter_mut().enumerate().for_each(|(word, bits)| *bits &= word_mask(&columns, word));
        }
    }

    /// Removes the cells that the spans cover.
    pub(crate) fn remove(&mut self, spans: &Spans) {
        for row in spans.rows() {
            let columns = spans.columns(row);
            if columns.is_empty() {
                continue;
            }
            let words = &mut self.words[row * self.words_per_row..][..self.words_per_row];
            for (word, bits) in words.iter_mut().enumerate().take(columns.end.div_ceil(64)).skip(columns.start / 64) {
                *bits &= !word_mask(&columns, word);
            }
        }
    }

    fn copy_block(&mut self, other: &Self) {
        let Self { shape, first_row, first_word, row_count, words_per_row, words: _ } = *other;
        (self.shape, self.first_row, self.first_word) = (shape, first_row, first_word);
        (self.row_count, self.words_per_row) = (row_count, words_per_row);
    }
}

/// The runs of set bits as `(first bit, length)`.
fn runs(mut bits: u64) -> impl Iterator<Item = (u64, u64)> {
    std::iter::from_fn(move || {
        if bits == 0 {
            return None;
        }
        let from = bits.trailing_zeros();
        let length = (bits >> from).trailing_ones();
        bits &= if from + length >= 64 { 0 } else { u64::MAX << (from + length) };
        Some((u64::from(from), u64::from(length)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_bits() {
        assert_eq!(runs(0).count(), 0);
        assert_eq!(runs(u64::MAX).collect::<Vec<_>>(), [(0, 64)]);
        assert_eq!(runs(0b1_0110 | 1 << 63).collect::<Vec<_>>(), [(1, 2), (4, 1), (63, 1)]);
    }

    #[test]
    fn a_patch_holds_the_cells_of_its_block() {
        let ring = [(0.0, 0.0), (40.0, 0.0), (40.0, 10.0), (0.0, 10.0)].map(|(x, y)| Vec2::new(x, y));
        let grid = SurfaceGrid::from_rings(&[ring.to_vec()], 0.25).unwrap();
        let corners = [(18.0, 2.0), (20.0, 2.0), (20.0, 5.0), (18.0, 5.0)].map(|(x, y)| Vec2::new(x, y));
        let mut patch = Patch::default();
        patch.load(&grid, &corners);
        let mut spans = Spans::default();
        spans.set_lattice(patch.lattice());
        spans.polygon(&corners);
        patch.retain(&spans);
        assert_eq!(patch.count(), 8 * 12);
        assert_eq!(patch.cells().count(), 8 * 12);
        assert!(patch.centroid().unwrap().distance(Vec2::new(19.0, 3.5)) < 1e-12);
        let mut rest = patch.clone();
        rest.remove(&spans);
        assert!(rest.is_empty() && rest.centroid().is_none());
        patch.load(&grid, &corners.map(|corner| corner + Vec2::new(500.0, -500.0)));
        spans.set_lattice(patch.lattice());
        spans.polygon(&corners.map(|corner| corner + Vec2::new(500.0, -500.0)));
        patch.retain(&spans);
        assert_eq!(patch.count(), 0);
    }
}
