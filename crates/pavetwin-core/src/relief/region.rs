//! The region around marked cells: widened, closed, its largest part, without holes. Rows are bits.

/// The region that a careful annotator would mark around the cells of `marked`.
///
/// It is every cell within `margin` of a marked one, closed by a disc of radius `closing` (both in cells), of which the
/// largest part in one piece stays, with its holes filled. A line with a gap of up to 2 √(margin² + 2 margin closing)
/// cells stays one piece.
pub fn region(rows: usize, cols: usize, marked: &[bool], margin: f64, closing: f64) -> Vec<bool> {
    let pad = (margin + closing).ceil() as usize + 2;
    let mut bits = Bits::new(rows + 2 * pad, cols + 2 * pad);
    for row in 0..rows {
        bits.set_row(row + pad, pad, &marked[row * cols..(row + 1) * cols]);
    }
    let mut wide = bits.dilated(margin + closing);
    if closing > 0.0 {
        wide.invert();
        wide = wide.dilated(closing);
        wide.invert();
    }
    let mut inside = vec![false; rows * cols];
    for row in 0..rows {
        wide.read_row(row + pad, pad, &mut inside[row * cols..(row + 1) * cols]);
    }
    let mut kept = largest_part(rows, cols, &inside, false);
    fill_holes(rows, cols, &mut kept);
    kept
}

/// The largest part in one piece, joined by sides, or by corners too if `diagonal`.
pub fn largest_part(rows: usize, cols: usize, inside: &[bool], diagonal: bool) -> Vec<bool> {
    let runs = Runs::of(rows, cols, inside, true, diagonal);
    let mut sizes = vec![0usize; runs.all.len()];
    for (run, &root) in runs.all.iter().zip(&runs.root) {
        sizes[root] += run.end - run.start;
    }
    let best = (0..sizes.len()).rev().max_by_key(|&root| sizes[root]);
    let mut kept = vec![false; inside.len()];
    for (run, &root) in runs.all.iter().zip(&runs.root) {
        if Some(root) == best {
            kept[run.row * cols + run.start..run.row * cols + run.end].fill(true);
        }
    }
    kept
}

/// Fills what no way by sides leads out of, so that the outline nowhere touches itself.
fn fill_holes(rows: usize, cols: usize, inside: &mut [bool]) {
    let runs = Runs::of(rows, cols, inside, false, false);
    let mut open = vec![false; runs.all.len()];
    for (run, &root) in runs.all.iter().zip(&runs.root) {
        open[root] |= run.row == 0 || run.row + 1 == rows || run.start == 0 || run.end == cols;
    }
    for (run, &root) in runs.all.iter().zip(&runs.root) {
        if !open[root] {
            inside[run.row * cols + run.start..run.row * cols + run.end].fill(true);
        }
    }
}

/// Neighbouring cells of a row with the same value, columns `start … end`.
struct Run {
    row: usize,
    start: usize,
    end: usize,
}

/// All runs of one value, and for each the first run of the piece that it belongs to.
struct Runs {
    all: Vec<Run>,
    root: Vec<usize>,
}

impl Runs {
    fn of(rows: usize, cols: usize, inside: &[bool], value: bool, diagonal: bool) -> Self {
        let mut all: Vec<Run> = Vec::new();
        let mut root: Vec<usize> = Vec::new();
        let reach = usize::from(diagonal);
        let mut above = 0..0;
        for row in 0..rows {
            let begun = all.len();
            let mut start = 0;
            for cells in inside[row * cols..(row + 1) * cols].chunk_by(|a, b| a == b) {
                let end = start + cells.len();
                if cells[0] == value {
                    let own = all.len();
                    root.push(own);
                    while above.start < begun && all[above.start].end + reach <= start {
                        above.start += 1;
                    }
                    for other in (above.start..above.end).take_while(|&other| all[other].start < end + reach) {
                        join(&mut root, own, other);
                    }
                    all.push(Run { row, start, end });
                }
                start = end;
            }
            above = begun..all.len();
        }
        for index in 0..root.len() {
            root[index] = find(&mut root, index);
        }
        Self { all, root }
    }
}

fn find(root: &mut [usize], mut index: usize) -> usize {
    while root[index] != index {
        root[index] = root[root[index]];
        index = root[index];
    }
    index
}

/// Joins two pieces under the earlier of their first runs.
fn join(root: &mut [usize], a: usize, b: usize) {
    let (a, b) = (find(root, a), find(root, b));
    root[a.max(b)] = a.min(b);
}

/// A grid of bits, 64 to a word.
struct Bits {
    rows: usize,
    cols: usize,
    words: usize,
    data: Vec<u64>,
}

impl Bits {
    fn new(rows: usize, cols: usize) -> Self {
        // A word to spare, so that what is smeared to the right is not lost before it is shifted back.
        let words = cols.div_ceil(64) + 1;
        Self { rows, cols, words, data: vec![0; rows * words] }
    }

    fn read_row(&self, row: usize, shift: usize, values: &mut [bool]) {
        let line = &self.data[row * self.words..(row + 1) * self.words];
        for (col, value) in values.iter_mut().enumerate() {
            let at = col + shift;
            *value = line[at / 64] >> (at % 64) & 1 == 1;
        }
    }

    fn set_row(&mut self, row: usize, shift: usize, values: &[bool]) {
        for (col, _) in values.iter().enumerate().filter(|&(_, &value)| value) {
            let at = col + shift;
            self.data[row * self.words + at / 64] |= 1 << (at % 64);
        }
    }

    fn invert(&mut self) {
        for row in 0..self.rows {
            for word in 0..self.words {
                let columns = (self.cols.saturating_sub(word * 64)).min(64);
                let valid = if columns == 64 { u64::MAX } else { (1 << columns) - 1 };
                let at = row * self.words + word;
                self.data[at] = !self.data[at] & valid;
            }
        }
    }

    /// Every cell whose centre lies within `radius` cells of a set one's.
    fn dilated(&self, radius: f64) -> Self {
        let mut result = Self::new(self.rows, self.cols);
        let reach = radius.floor() as i64;
        let (mut wide, mut smeared) = (Vec::new(), Vec::new());
        for row in 0..self.rows {
            let line = &self.data[row * self.words..(row + 1) * self.words];
            if line.iter().all(|&word| word == 0) {
                continue;
            }
            let mut held = usize::MAX;
            for step in (0..=reach).rev() {
                let half = ((radius * radius - (step * step) as f64).max(0.0)).sqrt().floor() as usize;
                if half != held {
                    smear(line, half, &mut wide, &mut smeared);
                    held = half;
                }
                for target in [row as i64 - step, row as i64 + step] {
                    if (0..self.rows as i64).contains(&target) {
                        let at = target as usize * self.words;
                        let into = &mut result.data[at..at + self.words];
                        into.iter_mut().zip(&smeared).for_each(|(into, word)| *into |= word);
                    }
                }
            }
        }
        for row in 0..self.rows {
            for word in 0..self.words {
                let columns = (self.cols.saturating_sub(word * 64)).min(64);
                let valid = if columns == 64 { u64::MAX } else { (1 << columns) - 1 };
                result.data[row * self.words + word] &= valid;
            }
        }
        result
    }
}

/// A row with each set bit widened by `half` to both sides, into `smeared`; `wide` is room to work in.
fn smear(line: &[u64], half: usize, wide: &mut Vec<u64>, smeared: &mut Vec<u64>) {
    let extra = half.div_ceil(64) + 1;
    wide.clear();
    wide.extend(line.iter().copied().chain(std::iter::repeat_n(0, extra)));
    let (mut covered, wanted) = (1, 2 * half + 1);
    while covered < wanted {
        let shift = covered.min(wanted - covered);
        let (words, bits) = (shift / 64, shift % 64);
        for at in (words..wide.len()).rev() {
            let mut moved = wide[at - words] << bits;
            if bits > 0 && at > words {
                moved |= wide[at - words - 1] >> (64 - bits);
            }
            wide[at] |= moved;
        }
        covered += shift;
    }
    let (words, bits) = (half / 64, half % 64);
    smeared.clear();
    smeared.extend((0..line.len()).map(|at| {
        let low = wide[at + words] >> bits;
        if bits > 0 { low | wide.get(at + words + 1).map_or(0, |next| next << (64 - bits)) } else { low }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_cell_becomes_a_disc() {
        let (rows, cols) = (41, 150);
        for (radius, col) in [(1.0, 70), (4.0, 63), (7.5, 64), (12.0, 128)] {
            let mut marked = vec![false; rows * cols];
            marked[20 * cols + col] = true;
            let disc = region(rows, cols, &marked, radius, 0.0);
            for (at, &inside) in disc.iter().enumerate() {
                let (dy, dx) = ((at / cols) as f64 - 20.0, (at % cols) as f64 - col as f64);
                assert_eq!(inside, dx.hypot(dy) <= radius + 1e-12, "{radius} {dx} {dy}");
            }
        }
    }

    #[test]
    fn gaps_are_closed_holes_filled_and_crumbs_dropped() {
        let (rows, cols) = (60, 100);
        let mut marked = vec![false; rows * cols];
        for col in 10..50 {
            for row in [20, 40] {
                marked[row * cols + col] = !(28..32).contains(&col);
            }
        }
        for row in 20..41 {
            (marked[row * cols + 10], marked[row * cols + 49]) = (true, true);
        }
        marked[5 * cols + 90] = true;
        let open = region(rows, cols, &marked, 0.0, 0.0);
        assert!(!open[30 * cols + 30] && !open[5 * cols + 90]);
        let closed = region(rows, cols, &marked, 1.0, 3.0);
        assert!(closed[30 * cols + 30] && closed[20 * cols + 30] && !closed[5 * cols + 90]);
        assert!(!closed[18 * cols + 30] && !closed[43 * cols + 20]);
    }

    #[test]
    fn what_only_a_corner_joins_to_the_outside_is_filled() {
        #[rustfmt::skip]
        let ring = [
            0, 0, 0, 0, 0, 0,
            0, 1, 1, 1, 0, 0,
            0, 1, 0, 1, 0, 0,
            0, 1, 1, 0, 0, 0,
            0, 0, 0, 0, 0, 0,
        ];
        let mut inside = ring.map(|cell| cell == 1);
        fill_holes(5, 6, &mut inside);
        assert!(inside[2 * 6 + 2] && !inside[3 * 6 + 3]);
    }
}
