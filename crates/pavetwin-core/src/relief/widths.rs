//! How wide an opening is at each of its cells.

/// Openings thinner than this share of a cell end a chord.
const LEAST: f32 = 0.02;

/// The opening's width at every cell [cells]; 0 where there is none.
///
/// Through a straight strip of width w a chord along x is h = w/|sin a| long and one along y is v = w/|cos a|, so
/// w = h v / √(h² + v²) at any angle. The chords add up shares of cells, so strips thinner than a cell are measured
/// too.
pub fn widths(rows: usize, cols: usize, opening: &[f32]) -> Vec<f32> {
    let mut across = vec![0.0f32; opening.len()];
    for row in 0..rows {
        chords(opening, row * cols, 1, cols, &mut across);
    }
    let mut upwards = vec![0.0f32; opening.len()];
    for col in 0..cols {
        chords(opening, col, cols, rows, &mut upwards);
    }
    across
        .iter()
        .zip(&upwards)
        .map(|(&h, &v)| if h > 0.0 && v > 0.0 { h * v / (h * h + v * v).sqrt() } else { 0.0 })
        .collect()
}

fn chords(opening: &[f32], start: usize, stride: usize, count: usize, lengths: &mut [f32]) {
    let mut step = 0;
    while step < count {
        if opening[start + step * stride] < LEAST {
            step += 1;
            continue;
        }
        let (begun, mut sum) = (step, 0.0);
        while step < count && opening[start + step * stride] >= LEAST {
            sum += opening[start + step * stride];
            step += 1;
        }
        (begun..step).for_each(|inner| lengths[start + inner * stride] = sum);
    }
}
