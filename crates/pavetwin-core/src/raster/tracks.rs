//! The nearest of some lines.

use super::Raster;

/// Longer straight parts are cut: the window around an oblique one grows with its length squared.
const LEG_M: f64 = 5.0;

/// Shorter ones have no direction.
const LEAST_M: f64 = 1e-6;

/// A line that is looked for.
#[derive(Debug, Clone, Copy)]
pub struct Line<'a> {
    pub points: &'a [[f64; 2]],
    /// How far from it.
    pub reach_m: f64,
    /// The way at which it begins.
    pub begin_m: f64,
}

/// For every cell the nearest of some lines.
#[derive(Debug, Clone)]
pub struct Tracks {
    /// Which one; −1 where none is within its reach.
    pub index: Vec<i32>,
    /// Way along it to the foot [m].
    pub along: Vec<f32>,
    /// Offset to its left [m].
    pub across: Vec<f32>,
    /// From it [m]; infinite where there is none.
    pub distance: Vec<f32>,
}

/// A straight part of a line.
struct Leg {
    start: [f64; 2],
    direction: [f64; 2],
    length: f64,
    begin: f64,
    is_first: bool,
    is_last: bool,
}

/// The nearest line of every cell; the first of those that are equally near. If `flat`, nothing beyond a line's ends
/// belongs to it.
pub fn tracks(raster: &Raster, lines: &[Line<'_>], flat: bool) -> Tracks {
    let mut found = Tracks {
        index: raster.full(-1),
        along: raster.full(0.0),
        across: raster.full(0.0),
        distance: raster.full(f32::INFINITY),
    };
    for (number, line) in lines.iter().enumerate() {
        for leg in legs(line) {
            add(raster, number as i32, line.reach_m, &leg, flat, &mut found);
        }
    }
    found
}

fn add(raster: &Raster, number: i32, reach_m: f64, leg: &Leg, flat: bool, found: &mut Tracks) {
    let end = [0, 1].map(|axis| leg.start[axis] + leg.direction[axis] * leg.length);
    let low = [0, 1].map(|axis| leg.start[axis].min(end[axis]) - reach_m);
    let high = [0, 1].map(|axis| leg.start[axis].max(end[axis]) + reach_m);
    let Some(window) = raster.window(low, high) else { return };
    let [dx, dy] = leg.direction.map(|value| value as f32);
    let (length, begin, reach) = (leg.length as f32, leg.begin as f32, reach_m as f32);
    let least = if flat && leg.is_first { 0.0 } else { f32::NEG_INFINITY };
    let most = if flat && leg.is_last { length } else { f32::INFINITY };
    let mut measured = Vec::with_capacity(window.columns.len());
    for row in window.rows.clone() {
        let (xs, y) = raster.from(&window, row, leg.start);
        measured.clear();
        measured.extend(xs.map(|x| {
            let (ahead, left) = (dx * x + dy * y, dx * y - dy * x);
            let beyond = (-ahead).max(ahead - length).max(0.0);
            (ahead, left, (left * left + beyond * beyond).sqrt())
        }));
        let first = row * raster.px + window.columns.start;
        for (at, &(ahead, left, away)) in (first..).zip(&measured) {
            if away < found.distance[at] && away < reach && least <= ahead && ahead <= most {
                found.index[at] = number;
                found.along[at] = begin + ahead.max(0.0).min(length);
                found.across[at] = left;
                found.distance[at] = away;
            }
        }
    }
}

fn legs(line: &Line<'_>) -> Vec<Leg> {
    let mut found: Vec<Leg> = Vec::new();
    let mut begin = line.begin_m;
    for ends in line.points.windows(2) {
        let step = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
        let whole = step[0].hypot(step[1]);
        if whole <= LEAST_M || !whole.is_finite() {
            continue;
        }
        let direction = step.map(|value| value / whole);
        let parts = (whole / LEG_M).ceil().max(1.0);
        let length = whole / parts;
        for part in 0..parts as usize {
            let away = part as f64 * length;
            let start = [0, 1].map(|axis| ends[0][axis] + direction[axis] * away);
            found.push(Leg { start, direction, length, begin, is_first: found.is_empty(), is_last: false });
            begin += length;
        }
    }
    if let Some(last) = found.last_mut() {
        last.is_last = true;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const BENT: [[f64; 2]; 3] = [[2.0, 2.0], [14.0, 2.0], [14.0, 9.0]];

    fn bent(flat: bool) -> Tracks {
        tracks(&Raster::new(64, 0.25), &[Line { points: &BENT, reach_m: 1.5, begin_m: 100.0 }], flat)
    }

    fn at(x_m: f64, y_m: f64) -> usize {
        (y_m / 0.25) as usize * 64 + (x_m / 0.25) as usize
    }

    #[test]
    fn a_cell_has_its_way_offset_and_distance() {
        let found = bent(false);
        let near = |value: f32, wanted: f32| assert!((value - wanted).abs() < 1e-4, "{value} is not {wanted}");
        let middle = at(8.0, 3.0);
        assert_eq!(found.index[middle], 0);
        near(found.along[middle], 100.0 + 8.125 - 2.0);
        near(found.across[middle], 1.125);
        near(found.distance[middle], 1.125);
        let second = at(13.0, 7.0);
        near(found.along[second], 100.0 + 12.0 + 7.125 - 2.0);
        near(found.across[second], 0.875);
        assert_eq!((found.index[at(8.0, 6.0)], found.distance[at(8.0, 6.0)]), (-1, f32::INFINITY));
    }

    #[test]
    fn a_flat_line_has_nothing_beyond_its_ends() {
        let (before, beside) = (at(1.0, 2.0), at(2.5, 2.5));
        assert_eq!((bent(false).index[before], bent(true).index[before]), (0, -1));
        assert_eq!((bent(false).index[beside], bent(true).index[beside]), (0, 0));
        assert_eq!(bent(false).along[before], 100.0);
    }

    #[test]
    fn the_nearer_line_wins_in_any_order() {
        let (low, high) = ([[0.0, 4.0], [16.0, 4.0]], [[0.0, 5.0], [16.0, 5.0]]);
        let line = |points| Line { points, reach_m: 4.0, begin_m: 0.0 };
        let raster = Raster::new(64, 0.25);
        let (one, other) =
            (tracks(&raster, &[line(&low), line(&high)], false), tracks(&raster, &[line(&high), line(&low)], false));
        for (a, b) in one.index.iter().zip(&other.index) {
            assert!(*a == -1 && *b == -1 || a + b == 1);
        }
        assert_eq!(one.distance, other.distance);
    }
}
