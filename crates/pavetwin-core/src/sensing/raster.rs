//! Filling windows and shadows: for each row of a patch, the interval of columns that a convex shape covers.

use crate::geometry::Vec2;

/// The patch's lattice: where its first cell's centre is and how many cells follow.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lattice {
    /// World position of the centre of column 0 in row 0.
    pub(crate) origin: Vec2,
    pub(crate) cells_per_m: f64,
    pub(crate) rows: usize,
    pub(crate) columns: usize,
}

impl Lattice {
    /// In cells: a cell's centre is at its column and row.
    fn local(&self, point: Vec2) -> Vec2 {
        (point - self.origin) * self.cells_per_m
    }
}

/// The first whole number not below `value`, kept in `0..=limit`.
pub(crate) fn first_from(value: f64, limit: usize) -> usize {
    if value <= 0.0 {
        0
    } else if value >= limit as f64 {
        limit
    } else {
        let below = value as i32;
        below as usize + usize::from(f64::from(below) < value)
    }
}

/// One past the last whole number not above `value`, kept in `0..=limit`.
fn end_to(value: f64, limit: usize) -> usize {
    if value < 0.0 {
        0
    } else if value >= limit as f64 {
        limit
    } else {
        value as i32 as usize + 1
    }
}

/// The columns a convex shape covers, row by row. Reused from shape to shape.
#[derive(Debug, Clone, Default)]
pub(crate) struct Spans {
    lattice: Lattice,
    first_row: usize,
    end_row: usize,
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Spans {
    pub(crate) fn set_lattice(&mut self, lattice: Lattice) {
        self.lattice = lattice;
        if self.low.len() < lattice.rows {
            self.low.resize(lattice.rows, 0.0);
            self.high.resize(lattice.rows, 0.0);
        }
    }

    /// Rows that the shape may cover.
    pub(crate) fn rows(&self) -> std::ops::Range<usize> {
        self.first_row..self.end_row
    }

    /// Columns covered in `row`; empty where the shape does not reach.
    pub(crate) fn columns(&self, row: usize) -> std::ops::Range<usize> {
        first_from(self.low[row], self.lattice.columns)..end_to(self.high[row], self.lattice.columns)
    }

    /// A convex polygon, counter-clockwise.
    pub(crate) fn polygon(&mut self, points: &[Vec2]) {
        let ys = points.iter().map(|point| self.lattice.local(*point).y);
        let (min, max) = ys.fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), y| (min.min(y), max.max(y)));
        self.begin(min, max);
        self.add_polygon(points);
    }

    /// The convex hull of two discs of which neither holds the other, given with the quadrilateral of the points at
    /// which their common tangents touch them (counter-clockwise), or of one disc when there is no quadrilateral.
    pub(crate) fn discs(&mut self, near: (Vec2, f64), far: (Vec2, f64), tangents: Option<[Vec2; 4]>) {
        let local = |(centre, radius_m): (Vec2, f64)| (self.lattice.local(centre), radius_m * self.lattice.cells_per_m);
        let (near, far) = (local(near), local(far));
        match tangents {
            Some(tangents) => {
                self.begin((near.0.y - near.1).min(far.0.y - far.1), (near.0.y + near.1).max(far.0.y + far.1));
                self.add_disc(near);
                self.add_polygon(&tangents);
            }
            None => self.begin(far.0.y - far.1, far.0.y + far.1),
        }
        self.add_disc(far);
    }

    fn begin(&mut self, min_row: f64, max_row: f64) {
        self.first_row = first_from(min_row, self.lattice.rows);
        self.end_row = end_to(max_row, self.lattice.rows).max(self.first_row);
        self.low[self.first_row..self.end_row].fill(f64::INFINITY);
        self.high[self.first_row..self.end_row].fill(f64::NEG_INFINITY);
    }

    fn add_polygon(&mut self, points: &[Vec2]) {
        let Some(&last) = points.last() else { return };
        let mut from = self.lattice.local(last);
        for point in points {
            let to = self.lattice.local(*point);
            // Counter-clockwise, the interior lies west of an edge that runs north and east of one that runs south.
            if to.y > from.y {
                let rows = self.rows_between(from.y, to.y);
                let slope = (to.x - from.x) / (to.y - from.y);
                for (row, high) in rows.clone().zip(&mut self.high[rows]) {
                    let x = from.x + (row as i32 as f64 - from.y) * slope;
                    *high = if x > *high { x } else { *high };
                }
            } else if to.y < from.y {
                let rows = self.rows_between(to.y, from.y);
                let slope = (to.x - from.x) / (to.y - from.y);
                for (row, low) in rows.clone().zip(&mut self.low[rows]) {
                    let x = from.x + (row as i32 as f64 - from.y) * slope;
                    *low = if x < *low { x } else { *low };
                }
            }
            from = to;
        }
    }

    fn rows_between(&self, low: f64, high: f64) -> std::ops::Range<usize> {
        let first = first_from(low, self.lattice.rows);
        first..end_to(high, self.lattice.rows).max(first)
    }

    fn add_disc(&mut self, (centre, radius): (Vec2, f64)) {
        for row in self.rows_between(centre.y - radius, centre.y + radius) {
            let rise = row as f64 - centre.y;
            let half = (radius * radius - rise * rise).max(0.0).sqrt();
            self.low[row] = self.low[row].min(centre.x - half);
            self.high[row] = self.high[row].max(centre.x + half);
        }
    }
}

/// The bits of word `word` that belong to the columns.
pub(crate) fn word_mask(columns: &std::ops::Range<usize>, word: usize) -> u64 {
    let from = columns.start.saturating_sub(word * 64);
    let to = columns.end.saturating_sub(word * 64).min(64);
    if from >= to { 0 } else { (u64::MAX << from) & (u64::MAX >> (64 - to)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_keeps_to_the_closed_interval() {
        assert_eq!((first_from(-3.0, 9), first_from(2.0, 9), first_from(2.1, 9), first_from(1e9, 9)), (0, 2, 3, 9));
        assert_eq!((end_to(-0.1, 9), end_to(0.0, 9), end_to(2.0, 9), end_to(2.9, 9), end_to(1e9, 9)), (0, 1, 3, 3, 9));
        assert_eq!((first_from(f64::INFINITY, 9), end_to(f64::NEG_INFINITY, 9)), (9, 0));
    }

    #[test]
    fn masks_select_the_columns_of_their_word() {
        assert_eq!(word_mask(&(0..64), 0), u64::MAX);
        assert_eq!(word_mask(&(60..70), 0), 0xF << 60);
        assert_eq!(word_mask(&(60..70), 1), 0x3F);
        assert_eq!(word_mask(&(60..70), 2), 0);
        assert_eq!(word_mask(&(9..9), 0), 0);
    }

    #[test]
    fn a_hull_of_discs_is_as_wide_as_its_parts() {
        let mut spans = Spans::default();
        spans.set_lattice(Lattice { origin: Vec2::ZERO, cells_per_m: 1.0, rows: 64, columns: 64 });
        spans.discs((Vec2::new(5.0, 20.0), 0.0), (Vec2::new(20.0, 20.0), 4.0), None);
        assert_eq!((spans.rows(), spans.columns(20), spans.columns(16)), (16..25, 16..25, 20..21));
    }
}
