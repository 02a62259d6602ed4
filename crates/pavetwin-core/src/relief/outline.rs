//! The outline of a region in one piece.

/// The outer boundary, anticlockwise (row upwards), through the middles of the sides between inside and outside cells.
///
/// Points are (col, row) in cells, a cell's centre at whole numbers. Going through the middles of the sides cuts the
/// stairs' corners, so that the area stays and the ring never touches itself. Empty when no cell is inside.
pub fn outline(rows: usize, cols: usize, inside: &[bool]) -> Vec<[f64; 2]> {
    let is_in = |row: i64, col: i64| {
        row >= 0 && col >= 0 && row < rows as i64 && col < cols as i64 && inside[row as usize * cols + col as usize]
    };
    let Some(start) = inside.iter().position(|&cell| cell) else {
        return Vec::new();
    };
    // Walks corner to corner with the region to the left; corner (x, y) is the lower left one of cell (row y, col x).
    let first = ((start % cols) as i64, (start / cols) as i64);
    let (mut x, mut y, mut dx, mut dy) = (first.0, first.1, 1i64, 0i64);
    let mut ring = Vec::new();
    loop {
        ring.push([x as f64 + 0.5 * dx as f64 - 0.5, y as f64 + 0.5 * dy as f64 - 0.5]);
        (x, y) = (x + dx, y + dy);
        // The two cells ahead: to the left and to the right of the way.
        let (left, right) = match (dx, dy) {
            (1, 0) => (is_in(y, x), is_in(y - 1, x)),
            (0, 1) => (is_in(y, x - 1), is_in(y, x)),
            (-1, 0) => (is_in(y - 1, x - 1), is_in(y, x - 1)),
            _ => (is_in(y - 1, x), is_in(y - 1, x - 1)),
        };
        // Cells that meet in a corner alone are not joined.
        (dx, dy) = match (left, right) {
            (false, _) => (-dy, dx),
            (true, true) => (dy, -dx),
            (true, false) => (dx, dy),
        };
        if (x, y, dx, dy) == (first.0, first.1, 1, 0) {
            return ring;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_loses_its_corners_alone() {
        let (rows, cols) = (8, 9);
        let inside: Vec<bool> =
            (0..rows * cols).map(|at| (2..6).contains(&(at / cols)) && (1..7).contains(&(at % cols))).collect();
        let ring = outline(rows, cols, &inside);
        assert_eq!(ring.len(), 20);
        let next = ring.iter().cycle().skip(1);
        let area: f64 = ring.iter().zip(next).map(|(a, b)| 0.5 * (a[0] * b[1] - b[0] * a[1])).sum();
        assert!((area - (24.0 - 4.0 * 0.125)).abs() < 1e-12, "{area}");
    }
}
