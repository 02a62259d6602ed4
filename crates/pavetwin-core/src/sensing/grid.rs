//! The surface of a segment as square cells.

use crate::geometry::Vec2;

/// Most words a grid may hold: 128 MiB, a carriageway of some 8 km by 8 km at 0.25 m.
const MAX_WORDS: f64 = (1u32 << 24) as f64;

/// Why a surface cannot be gridded, or two sets not combined.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GridError {
    #[error("the cell side must be a positive number of metres, not {0}")]
    CellSide(f64),
    #[error("a surface needs at least one ring of three points")]
    NoRing,
    #[error("ring {ring} of the surface has a coordinate that is not finite")]
    NotFinite { ring: usize },
    #[error("a surface of {width_m:.0} m by {height_m:.0} m is too large for cells of {cell_m} m")]
    TooLarge { width_m: f64, height_m: f64, cell_m: f64 },
    #[error("the surface holds no cell centre: it is thinner than its cells of {cell_m} m")]
    NoCells { cell_m: f64 },
    #[error("two sets of cells belong to different grids")]
    Misaligned,
}

/// What two sets of cells must share to be combined: place and extent of the grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridShape {
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Index on the world's lattice of the grid's first column, whose cells span `[first, first + 1) · cell_m`.
    pub first_column: i64,
    /// Index on the world's lattice of the grid's first row.
    pub first_row: i64,
    pub rows: usize,
    /// Words of 64 cells in a row; bits beyond the last column are clear.
    pub words_per_row: usize,
}

impl GridShape {
    /// The world position of the centre of a cell.
    pub fn centre(&self, column: usize, row: usize) -> Vec2 {
        let along = |first: i64, index: usize| ((first + index as i64) as f64 + 0.5) * self.cell_m;
        Vec2::new(along(self.first_column, column), along(self.first_row, row))
    }

    pub fn columns(&self) -> usize {
        self.words_per_row * 64
    }
}

/// The cells of one segment's surface. Cells lie on the world's lattice (multiples of the cell side from the origin,
/// along east and north), and belong to the segment when their centre is inside its polygon.
#[derive(Debug, Clone)]
pub struct SurfaceGrid {
    shape: GridShape,
    words: Vec<u64>,
    cell_count: usize,
}

impl SurfaceGrid {
    /// Fills the rings of a polygon or a multi-polygon by the even-odd rule, which makes inner rings holes whatever
    /// their direction. A centre exactly on a shared boundary belongs to the polygon east or north of it, so that
    /// neighbouring segments never share a cell.
    ///
    /// # Errors
    /// For a cell side or rings that describe no surface, and for surfaces without a single cell centre.
    pub fn from_rings(rings: &[Vec<Vec2>], cell_m: f64) -> Result<Self, GridError> {
        if !(cell_m.is_finite() && cell_m > 0.0) {
            return Err(GridError::CellSide(cell_m));
        }
        let shape = shape_of(rings, cell_m)?;
        let mut grid = Self { shape, words: vec![0; shape.rows * shape.words_per_row], cell_count: 0 };
        let mut crossings = Vec::new();
        for row in 0..shape.rows {
            grid.fill_row(rings, row, &mut crossings);
        }
        grid.cell_count = count_bits(&grid.words);
        if grid.cell_count == 0 {
            return Err(GridError::NoCells { cell_m });
        }
        Ok(grid)
    }

    pub fn shape(&self) -> &GridShape {
        &self.shape
    }

    /// Number of cells, at least 1.
    pub fn cell_count(&self) -> usize {
        self.cell_count
    }

    /// Whether the cell belongs to the surface; cells outside the grid do not.
    pub fn contains(&self, column: usize, row: usize) -> bool {
        bit(&self.words, &self.shape, column, row)
    }

    /// The world position of the centre of a cell.
    pub fn centre(&self, column: usize, row: usize) -> Vec2 {
        self.shape.centre(column, row)
    }

    /// The cells of a row, column 0 in the lowest bit of the first word.
    pub fn row_words(&self, row: usize) -> &[u64] {
        &self.words[row * self.shape.words_per_row..][..self.shape.words_per_row]
    }

    fn fill_row(&mut self, rings: &[Vec<Vec2>], row: usize, crossings: &mut Vec<f64>) {
        let shape = self.shape;
        let y = shape.centre(0, row).y;
        crossings.clear();
        for ring in rings {
            for (i, &a) in ring.iter().enumerate() {
                let b = ring[(i + 1) % ring.len()];
                if (a.y <= y) != (b.y <= y) {
                    crossings.push(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
                }
            }
        }
        crossings.sort_unstable_by(f64::total_cmp);
        let column_from = |x: f64| {
            let column = (x / shape.cell_m - 0.5).ceil() - shape.first_column as f64;
            column.clamp(0.0, shape.columns() as f64) as usize
        };
        for pair in crossings.chunks_exact(2) {
            for column in column_from(pair[0])..column_from(pair[1]) {
                self.words[row * shape.words_per_row + column / 64] |= 1 << (column % 64);
            }
        }
    }
}

fn shape_of(rings: &[Vec<Vec2>], cell_m: f64) -> Result<GridShape, GridError> {
    let mut min = Vec2::new(f64::INFINITY, f64::INFINITY);
    let mut max = -min;
    for (ring, points) in rings.iter().enumerate() {
        for point in points {
            if !(point.x.is_finite() && point.y.is_finite()) {
                return Err(GridError::NotFinite { ring });
            }
            min = Vec2::new(min.x.min(point.x), min.y.min(point.y));
            max = Vec2::new(max.x.max(point.x), max.y.max(point.y));
        }
    }
    if !rings.iter().any(|ring| ring.len() >= 3) {
        return Err(GridError::NoRing);
    }
    let first = |low: f64| (low / cell_m).floor();
    let extent = |low: f64, high: f64| (high / cell_m).floor() - (low / cell_m).floor() + 1.0;
    let (columns, rows) = (extent(min.x, max.x), extent(min.y, max.y));
    let words_per_row = (columns / 64.0).ceil();
    if words_per_row * rows > MAX_WORDS {
        return Err(GridError::TooLarge { width_m: max.x - min.x, height_m: max.y - min.y, cell_m });
    }
    Ok(GridShape {
        cell_m,
        first_column: first(min.x) as i64,
        first_row: first(min.y) as i64,
        rows: rows as usize,
        words_per_row: words_per_row as usize,
    })
}

pub(super) fn bit(words: &[u64], shape: &GridShape, column: usize, row: usize) -> bool {
    row < shape.rows
        && column < shape.columns()
        && words[row * shape.words_per_row + column / 64] >> (column % 64) & 1 == 1
}

pub(super) fn count_bits(words: &[u64]) -> usize {
    words.iter().map(|word| word.count_ones() as usize).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(x0: f64, y0: f64, x1: f64, y1: f64) -> Vec<Vec2> {
        vec![Vec2::new(x0, y0), Vec2::new(x1, y0), Vec2::new(x1, y1), Vec2::new(x0, y1)]
    }

    #[test]
    fn a_rectangle_with_a_hole() {
        let rings = [rectangle(-10.0, -5.0, 30.0, 5.0), rectangle(0.0, -1.0, 2.0, 1.0)];
        let grid = SurfaceGrid::from_rings(&rings, 0.25).expect("a grid");
        assert_eq!(grid.cell_count(), (400 - 4) * 16);
        let (column, row) = (42, 20);
        assert_eq!(grid.centre(column, row), Vec2::new(0.625, 0.125));
        assert!(!grid.contains(column, row) && grid.contains(39, row) && !grid.contains(99_999, row));
    }

    #[test]
    fn neighbours_that_share_a_boundary_share_no_cell() {
        let slope = Vec2::new(3.375, 7.125);
        let left = vec![Vec2::new(0.125, 0.125), slope, Vec2::new(0.125, 7.125)];
        let right = vec![Vec2::new(0.125, 0.125), Vec2::new(3.375, 0.125), slope];
        let whole = rectangle(0.125, 0.125, 3.375, 7.125);
        let count =
            |ring: &Vec<Vec2>| SurfaceGrid::from_rings(std::slice::from_ref(ring), 0.25).map(|g| g.cell_count());
        assert_eq!(count(&left).unwrap() + count(&right).unwrap(), count(&whole).unwrap());
        assert_eq!(count(&whole), Ok(13 * 28));
    }

    #[test]
    fn what_is_no_surface_is_refused() {
        let thin = [rectangle(0.01, 0.0, 0.02, 9.0)];
        assert_eq!(SurfaceGrid::from_rings(&thin, 0.25).unwrap_err(), GridError::NoCells { cell_m: 0.25 });
        assert_eq!(SurfaceGrid::from_rings(&[], 0.25).unwrap_err(), GridError::NoRing);
        assert_eq!(SurfaceGrid::from_rings(&thin, 0.0).unwrap_err(), GridError::CellSide(0.0));
        let vast = [rectangle(0.0, 0.0, 1e6, 1e6)];
        assert!(matches!(SurfaceGrid::from_rings(&vast, 0.25), Err(GridError::TooLarge { .. })));
        let broken = [rectangle(0.0, 0.0, f64::NAN, 1.0)];
        assert_eq!(SurfaceGrid::from_rings(&broken, 0.25).unwrap_err(), GridError::NotFinite { ring: 0 });
    }
}
