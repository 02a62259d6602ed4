//! Lines to fly, fitted into the mesh.

use crate::geometry::Vec2;
use crate::navigation::{NavMesh, NavMeshError};

/// How far apart a wanted line is probed, metres.
const PROBE_M: f64 = 1.0;

/// The wanted line where the mesh has room for it, with the shortest way round wherever it has not, from `start`.
///
/// Stretches of the line outside the mesh, or in a part of it that cannot be reached, are left out; of a line that
/// cannot be reached at all, `start` alone is left.
///
/// # Errors
/// When `start` is outside the mesh.
pub fn course(mesh: &NavMesh, start: Vec2, line: &[Vec2]) -> Result<Vec<Vec2>, NavMeshError> {
    let mut flown = vec![start];
    for stop in stops(mesh, line) {
        if !mesh.connected(start, stop) {
            continue;
        }
        let last = flown[flown.len() - 1];
        if mesh.segment_inside(last, stop) {
            flown.push(stop);
        } else {
            flown.extend_from_slice(&mesh.path(last, stop)?[1..]);
        }
    }
    Ok(flown)
}

/// The place nearest to `goal` that can be reached from `from`; the nearest of the whole mesh when `from` is outside
/// it.
pub fn nearest_reachable(mesh: &NavMesh, from: Vec2, goal: Vec2) -> Vec2 {
    let nearest = mesh.nearest(goal);
    if mesh.connected(from, nearest) {
        return nearest;
    }
    let edges = mesh.polygons().iter().flat_map(|polygon| {
        let corner = |i: usize| mesh.vertices()[polygon[i % polygon.len()] as usize];
        (0..polygon.len()).map(move |i| [corner(i), corner(i + 1)])
    });
    let places = edges.map(|edge| foot_on(&edge, goal)).filter(|place| mesh.connected(from, *place));
    places.min_by(|a, b| a.distance(goal).total_cmp(&b.distance(goal))).unwrap_or(nearest)
}

/// The point of a straight leg that is nearest to `point`.
pub(super) fn foot_on(leg: &[Vec2], point: Vec2) -> Vec2 {
    let along = leg[1] - leg[0];
    let share = (point - leg[0]).dot(along) / along.dot(along).max(f64::MIN_POSITIVE);
    leg[0].lerp(leg[1], share.clamp(0.0, 1.0))
}

/// The points of the line that must be passed: its own corners while it stays inside the mesh, else where it leaves and
/// enters; the ends are moved onto the mesh.
fn stops(mesh: &NavMesh, line: &[Vec2]) -> Vec<Vec2> {
    let mut stops = Vec::new();
    let Some(&first) = line.first() else { return stops };
    stops.push(mesh.nearest(first));
    for pair in line.windows(2) {
        if mesh.segment_inside(pair[0], pair[1]) {
            stops.push(pair[1]);
            continue;
        }
        let count = (pair[0].distance(pair[1]) / PROBE_M).ceil().max(1.0) as usize;
        let probes = (0..=count).map(|k| pair[0].lerp(pair[1], k as f64 / count as f64));
        let inside: Vec<(Vec2, bool)> = probes.map(|point| (point, mesh.contains(point))).collect();
        for (k, &(point, is_inside)) in inside.iter().enumerate() {
            let at_edge = k == 0 || k == count || !inside[k - 1].1 || !inside[k + 1].1;
            if is_inside && at_edge {
                stops.push(point);
            }
        }
    }
    let end = mesh.nearest(line[line.len() - 1]);
    if stops.last().is_some_and(|last| last.distance(end) > PROBE_M) {
        stops.push(end);
    }
    stops
}

/// The path without its last `distance_m`; at least its first point is left.
pub fn shortened(path: &[Vec2], distance_m: f64) -> Vec<Vec2> {
    let mut kept = path.to_vec();
    let mut spare_m = distance_m;
    while kept.len() >= 2 {
        let (last, before) = (kept[kept.len() - 1], kept[kept.len() - 2]);
        let leg_m = last.distance(before);
        if leg_m > spare_m {
            let end = kept.len() - 1;
            kept[end] = last.lerp(before, spare_m / leg_m);
            return kept;
        }
        spare_m -= leg_m;
        kept.pop();
    }
    kept
}

/// What is left of a path from the place on it that is nearest to `position`, that place first.
pub fn rest_of(path: &[Vec2], position: Vec2) -> Vec<Vec2> {
    let feet = path.windows(2).map(|leg| foot_on(leg, position));
    let nearest = feet.enumerate().min_by(|a, b| {
        let (to_a, to_b) = (a.1.distance(position), b.1.distance(position));
        to_a.total_cmp(&to_b)
    });
    let Some((leg, place)) = nearest else { return path.to_vec() };
    std::iter::once(place).chain(path[leg + 1..].iter().copied()).collect()
}
