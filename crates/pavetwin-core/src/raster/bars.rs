//! Signed distances to oriented rectangles: paint over paint, and patches over patches.

use super::Raster;

/// An oriented rectangle.
#[derive(Debug, Clone, Copy)]
pub struct Bar {
    pub middle: [f64; 2],
    /// Cosine and sine of its direction.
    pub direction: [f64; 2],
    /// Half its length along the direction, and half its width [m].
    pub half_m: [f64; 2],
    /// Half the sides of the window in which it is looked for [m].
    pub extent_m: [f64; 2],
}

/// What is painted.
#[derive(Debug, Clone)]
pub struct Paint {
    /// Signed distance to the nearest bar's edge, positive inside [m].
    pub distance: Vec<f32>,
    /// What that bar looks like.
    pub looks: [Vec<f32>; 2],
}

/// The bar of every cell that it lies farthest inside of.
///
/// `looks` and the greatest distance that counts inside are of each bar; `outside` is the distance where there is none.
pub fn painted(raster: &Raster, bars: &[Bar], looks: &[[f32; 2]], most: &[f32], outside: f32) -> Paint {
    let mut paint = Paint { distance: raster.full(outside), looks: [raster.full(0.0), raster.full(0.0)] };
    for ((bar, look), &most) in bars.iter().zip(looks).zip(most) {
        each(raster, bar, |at, inside| {
            let inside = inside.min(most);
            if inside > paint.distance[at] {
                paint.distance[at] = inside;
                paint.looks[0][at] = look[0];
                paint.looks[1][at] = look[1];
            }
        });
    }
    paint
}

/// The factor of bars where they are, 1 elsewhere; later ones cover earlier ones, by their share of a cell at edges.
pub fn covered(raster: &Raster, bars: &[Bar], factors: &[f32]) -> Vec<f32> {
    let mut tone = raster.full(1.0);
    let cell = raster.cell_m as f32;
    for (bar, factor) in bars.iter().zip(factors) {
        each(raster, bar, |at, inside| {
            let share = (0.5 + inside / cell).clamp(0.0, 1.0);
            tone[at] += (factor - tone[at]) * share;
        });
    }
    tone
}

/// Calls with each cell of a bar's window and the signed distance there.
fn each(raster: &Raster, bar: &Bar, mut call: impl FnMut(usize, f32)) {
    let low = [0, 1].map(|axis| bar.middle[axis] - bar.extent_m[axis]);
    let high = [0, 1].map(|axis| bar.middle[axis] + bar.extent_m[axis]);
    let Some(window) = raster.window(low, high) else { return };
    let [cos, sin] = bar.direction.map(|value| value as f32);
    let [long, wide] = bar.half_m.map(|value| value as f32);
    let mut inside = Vec::with_capacity(window.columns.len());
    for row in window.rows.clone() {
        let (xs, y) = raster.from(&window, row, bar.middle);
        inside.clear();
        inside.extend(xs.map(|x| {
            let (u, v) = ((cos * x + sin * y).abs() - long, (cos * y - sin * x).abs() - wide);
            let (beside, before) = (u.max(0.0), v.max(0.0));
            -((beside * beside + before * before).sqrt() + u.max(v).min(0.0))
        }));
        let first = row * raster.px + window.columns.start;
        (first..).zip(&inside).for_each(|(at, &inside)| call(at, inside));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raster() -> Raster {
        Raster::new(40, 0.1)
    }

    /// A bar along the first diagonal.
    fn bar(x: f64, y: f64, half_m: [f64; 2]) -> Bar {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        Bar { middle: [x, y], direction: [half, half], half_m, extent_m: [2.0, 2.0] }
    }

    #[test]
    fn distances_are_signed() {
        let found = painted(&raster(), &[bar(2.0, 2.0, [1.0, 0.2])], &[[3.0, 4.0]], &[9.0], -0.25);
        for row in 0..40 {
            for column in 0..40 {
                let (x, y) = (column as f64 * 0.1 + 0.05 - 2.0, row as f64 * 0.1 + 0.05 - 2.0);
                let (along, across) = ((x + y).abs() / 2f64.sqrt(), (y - x).abs() / 2f64.sqrt());
                let (u, v) = (along - 1.0, across - 0.2);
                let away = if u < 0.0 && v < 0.0 { u.max(v) } else { u.max(0.0).hypot(v.max(0.0)) };
                let wanted = (-away).max(-0.25) as f32;
                let at = row * 40 + column;
                assert!((found.distance[at] - wanted).abs() < 1e-5);
                assert_eq!(found.looks[0][at] == 3.0, found.distance[at] > -0.25);
            }
        }
    }

    #[test]
    fn what_is_capped_lets_later_paint_through() {
        let bars = [bar(2.0, 2.0, [1.0, 0.6]), bar(2.0, 2.0, [1.0, 0.3])];
        let looks = [[1.0, 0.0], [2.0, 0.0]];
        let middle = 20 * 40 + 20;
        assert_eq!(painted(&raster(), &bars, &looks, &[9.0, 9.0], -0.25).looks[0][middle], 1.0);
        assert_eq!(painted(&raster(), &bars, &looks, &[0.01, 9.0], -0.25).looks[0][middle], 2.0);
    }

    #[test]
    fn later_covers_lie_over_earlier_ones() {
        let bars = [bar(2.0, 2.0, [1.5, 1.0]), bar(2.0, 2.0, [0.4, 0.4])];
        let tone = covered(&raster(), &bars, &[0.5, 1.5]);
        assert_eq!((tone[20 * 40 + 20], tone[26 * 40 + 26], tone[0]), (1.5, 0.5, 1.0));
    }
}
