//! Fractal value noise.

use super::{Grid, hash, share};

/// What noise is made of: octaves whose wavelength halves and whose strength falls by `gain`.
#[derive(Debug, Clone, Copy)]
pub struct Noise {
    pub seed: u64,
    /// Of the first octave, along x and y.
    pub wavelength_m: (f64, f64),
    pub octaves: u32,
    pub gain: f32,
}

/// Noise of mean 0 and a standard deviation of about 1 over large areas.
pub fn noise(grid: &Grid, settings: &Noise) -> Vec<f32> {
    let mut field = vec![0.0f32; grid.len()];
    let mut strength = 1.0f32;
    let mut power = 0.0f32;
    let (mut wave_x, mut wave_y) = settings.wavelength_m;
    for octave in 0..settings.octaves {
        add_octave(grid, hash(settings.seed, i64::from(octave), 0), (wave_x, wave_y), strength, &mut field);
        power += strength * strength;
        strength *= settings.gain;
        wave_x *= 0.5;
        wave_y *= 0.5;
    }
    // Lattice values even in [-1, 1] have the variance 1/3; smoothing between them leaves about 0.55 of it.
    let scale = 1.0 / (power * 0.183).sqrt();
    field.iter_mut().for_each(|value| *value *= scale);
    field
}

fn add_octave(grid: &Grid, seed: u64, wave: (f64, f64), strength: f32, field: &mut [f32]) {
    // Every octave's lattice is shifted, so that their corners do not fall together.
    let shift = (f64::from(share(hash(seed, 1, 7))), f64::from(share(hash(seed, 7, 1))));
    let columns = taps(grid.x0_m / wave.0 + shift.0, grid.cell_m / wave.0, grid.cols);
    let rows = taps(grid.y0_m / wave.1 + shift.1, grid.cell_m / wave.1, grid.rows);
    let (first, last) = (columns[0].0, columns[grid.cols - 1].0 + 1);
    let rights: Vec<f32> = columns.iter().map(|&(_, right)| right).collect();
    let spans: Vec<(usize, usize)> =
        columns.chunk_by(|a, b| a.0 == b.0).map(|cells| ((cells[0].0 - first) as usize, cells.len())).collect();
    let lattice_row =
        |y: i64| -> Vec<f32> { (first..=last).map(|x| strength * (2.0 * share(hash(seed, x, y)) - 1.0)).collect() };
    let (mut below, mut above, mut held) = (Vec::new(), Vec::new(), i64::MIN);
    let mut mixed = Vec::new();
    for (row, &(y, up)) in rows.iter().enumerate() {
        if y != held {
            (below, above, held) = (lattice_row(y), lattice_row(y + 1), y);
        }
        mixed.clear();
        mixed.extend(below.iter().zip(&above).map(|(a, b)| a + up * (b - a)));
        let mut line = &mut field[row * grid.cols..(row + 1) * grid.cols];
        let mut shares = rights.as_slice();
        for &(at, count) in &spans {
            // All cells between two corners at once: plain arithmetic on neighbours, which the compiler widens.
            let (now, rest) = line.split_at_mut(count);
            let (rights, others) = shares.split_at(count);
            let (low, rise) = (mixed[at], mixed[at + 1] - mixed[at]);
            now.iter_mut().zip(rights).for_each(|(value, right)| *value += low + right * rise);
            (line, shares) = (rest, others);
        }
    }
}

/// For each cell along an axis: the lattice corner before it, and the smoothed share of the way to the next.
fn taps(start: f64, step: f64, count: usize) -> Vec<(i64, f32)> {
    (0..count)
        .map(|index| {
            let at = start + step * index as f64;
            let share = (at - at.floor()) as f32;
            (at.floor() as i64, share * share * share * (share * (share * 6.0 - 15.0) + 10.0))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_mean_zero_and_a_standard_deviation_of_one() {
        let grid = Grid { rows: 400, cols: 500, cell_m: 0.01, x0_m: -2.0, y0_m: 3.0 };
        let field = noise(&grid, &Noise { seed: 5, wavelength_m: (0.1, 0.07), octaves: 3, gain: 0.5 });
        let mean = field.iter().sum::<f32>() / field.len() as f32;
        let power = field.iter().map(|value| value * value).sum::<f32>() / field.len() as f32;
        assert!(mean.abs() < 0.05, "{mean}");
        assert!((power.sqrt() - 1.0).abs() < 0.1, "{}", power.sqrt());
    }
}
