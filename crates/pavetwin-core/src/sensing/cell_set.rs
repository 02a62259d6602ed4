//! Sets of cells of a grid, such as those that captures have seen.

use super::grid::{GridError, GridShape, SurfaceGrid, bit, count_bits};
use super::patch::Patch;
use crate::geometry::Vec2;

/// A set of a grid's cells, such as those that captures have seen.
#[derive(Debug, Clone, PartialEq)]
pub struct CellSet {
    shape: GridShape,
    words: Vec<u64>,
}

impl CellSet {
    /// The empty set of cells of `grid`.
    pub fn empty(grid: &SurfaceGrid) -> Self {
        Self { shape: *grid.shape(), words: vec![0; grid.shape().rows * grid.shape().words_per_row] }
    }

    /// Adds the cells of a patch, such as those visible in a capture.
    ///
    /// # Errors
    /// `Misaligned` when it belongs to another grid.
    pub fn insert(&mut self, patch: &Patch) -> Result<(), GridError> {
        if patch.shape() != Some(&self.shape) {
            return Err(GridError::Misaligned);
        }
        for (row, first_word, words) in patch.rows() {
            let start = row * self.shape.words_per_row + first_word;
            self.words[start..start + words.len()].iter_mut().zip(words).for_each(|(mine, theirs)| *mine |= theirs);
        }
        Ok(())
    }

    /// The cells that `other`, a set of the same grid, does not hold.
    #[must_use]
    pub(crate) fn without(&self, other: &Self) -> Self {
        let words = self.words.iter().zip(&other.words).map(|(mine, theirs)| mine & !theirs);
        Self { shape: self.shape, words: words.collect() }
    }

    pub fn contains(&self, column: usize, row: usize) -> bool {
        bit(&self.words, &self.shape, column, row)
    }

    /// The world positions of the centres of the cells.
    pub fn centres(&self) -> impl Iterator<Item = Vec2> {
        (0..self.shape.rows).flat_map(move |row| {
            let columns = (0..self.shape.columns()).filter(move |&column| self.contains(column, row));
            columns.map(move |column| self.shape.centre(column, row))
        })
    }

    /// Number of cells in the set.
    pub fn count(&self) -> usize {
        count_bits(&self.words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_refuses_cells_of_another_grid() {
        let grid =
            SurfaceGrid::from_rings(&[vec![Vec2::ZERO, Vec2::new(20.0, 0.0), Vec2::new(20.0, 5.0)]], 0.25).unwrap();
        let mut set = CellSet::empty(&grid);
        assert_eq!(set.insert(&Patch::default()), Err(GridError::Misaligned));
        assert_eq!(set.count(), 0);
    }
}
