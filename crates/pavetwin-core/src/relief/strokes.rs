//! Cracks as strokes: lines with an opening to their left and right and a depth along them, drawn on a grid.

use super::Grid;

/// Lines with properties at their points. `offsets` (k + 1) cut the points into k lines.
#[derive(Debug, Clone, Copy)]
pub struct Strokes<'a> {
    pub points: &'a [[f64; 2]],
    pub offsets: &'a [u32],
    /// Half the opening to the left and to the right of the line [m].
    pub half_m: &'a [[f64; 2]],
    pub depth_m: &'a [f64],
}

/// What the strokes make of every cell.
#[derive(Debug, Clone)]
pub struct Traced {
    /// Mean height over the cell, at most 0 [m].
    pub height_m: Vec<f32>,
    /// Share of the cell that lies in an opening.
    pub opening: Vec<f32>,
    /// From the nearest edge of an opening, negative inside, at most `reach_m` [m].
    pub distance_m: Vec<f32>,
}

/// Draws strokes. The section falls to the full depth in the middle: as a V when `steepness` is 1, as a U when it is
/// large.
///
/// A cell holds the *mean* over its square, so that an opening thinner than a cell keeps its area and its volume.
pub fn trace(grid: &Grid, strokes: &Strokes<'_>, reach_m: f64, steepness: i32) -> Traced {
    let mut traced = Traced {
        height_m: vec![0.0; grid.len()],
        opening: vec![0.0; grid.len()],
        distance_m: vec![reach_m as f32; grid.len()],
    };
    for line in strokes.offsets.windows(2) {
        for first in line[0] as usize..(line[1] as usize).saturating_sub(1) {
            draw(grid, strokes, first, reach_m, steepness, &mut traced);
        }
    }
    traced
}

fn draw(grid: &Grid, strokes: &Strokes<'_>, first: usize, reach_m: f64, steepness: i32, traced: &mut Traced) {
    let ([ax, ay], [bx, by]) = (strokes.points[first], strokes.points[first + 1]);
    let (half_a, half_b) = (strokes.half_m[first], strokes.half_m[first + 1]);
    let (depth_a, depth_b) = (strokes.depth_m[first], strokes.depth_m[first + 1]);
    let (dx, dy) = (bx - ax, by - ay);
    let squared = dx * dx + dy * dy;
    let widest = half_a[0].max(half_a[1]).max(half_b[0]).max(half_b[1]);
    if squared <= 0.0 || (widest <= 0.0 && reach_m <= 0.0) {
        return;
    }
    let (along_x, along_y) = (dx / squared, dy / squared);
    let far = widest + reach_m.max(0.5 * grid.cell_m);
    let (top, bottom) = (ay.max(by) + far, ay.min(by) - far);
    let (left, right) = grid.columns(ax.min(bx) - far, ax.max(bx) + far);
    let (low, high) = grid.rows_between(bottom, top);
    let cell = grid.cell_m;
    for row in low..high {
        let py = grid.y0_m + row as f64 * cell - ay;
        for col in left..right {
            let px = grid.x0_m + col as f64 * cell - ax;
            let along = (px * along_x + py * along_y).clamp(0.0, 1.0);
            let (ex, ey) = (px - along * dx, py - along * dy);
            let apart = ex * ex + ey * ey;
            if apart > far * far {
                continue;
            }
            let apart = apart.sqrt();
            let side = usize::from(dx * py - dy * px < 0.0);
            let near = half_a[side] + along * (half_b[side] - half_a[side]);
            let at = row * grid.cols + col;
            let gap = (apart - near) as f32;
            if gap < traced.distance_m[at] {
                traced.distance_m[at] = gap;
            }
            let beyond = half_a[1 - side] + along * (half_b[1 - side] - half_a[1 - side]);
            let covered = ((apart + 0.5 * cell).min(near) - (apart - 0.5 * cell).max(-beyond)) / cell;
            if covered > 0.0 {
                let covered = covered.min(1.0);
                let depth = depth_a + along * (depth_b - depth_a);
                let out = (apart / (near + 0.5 * cell)).min(1.0);
                let height = -depth * covered * (1.0 - out.powi(steepness));
                traced.opening[at] = traced.opening[at].max(covered as f32);
                traced.height_m[at] = traced.height_m[at].min(height as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight crack of `width_m` at an angle; its area must be length × width however thin it is.
    #[test]
    fn a_thin_crack_keeps_its_area() {
        for (angle, width) in [(0.0f64, 0.002), (0.4, 0.002), (0.785, 0.003), (1.2, 0.011), (1.57, 0.0305)] {
            let grid = Grid { rows: 600, cols: 600, cell_m: 0.005, x0_m: -1.5, y0_m: -1.5 };
            let (x, y) = (angle.cos(), angle.sin());
            let points = [[-x, -y], [x, y]];
            let half = [[width / 2.0; 2]; 2];
            let strokes = Strokes { points: &points, offsets: &[0, 2], half_m: &half, depth_m: &[0.02, 0.02] };
            let traced = trace(&grid, &strokes, 0.02, 2);
            let area: f32 = traced.opening.iter().sum::<f32>() * 25e-6;
            let expected = (2.0 * width) as f32;
            assert!((area / expected - 1.0).abs() < 0.1, "{angle} {width}: {area} for {expected}");
        }
    }
}
