//! The shortest line through a sequence of convex polygons: the funnel algorithm (Lee, Preparata 1984; the form with
//! one left and one right corner is Mononen's "simple stupid funnel").

use super::assembly::{Assembly, edges};
use super::mesh::{BORDER_TOLERANCE_M, closest_on_segment};
use crate::geometry::Vec2;

/// The passage between two polygons, seen in the direction of travel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Portal {
    pub left: Vec2,
    pub right: Vec2,
}

/// The passages of a corridor of polygons; `None` when two that follow each other share no edge.
pub(super) fn portals(assembly: &Assembly, corridor: &[u32]) -> Option<Vec<Portal>> {
    corridor.windows(2).map(|pair| portal(assembly, pair[0], pair[1])).collect()
}

/// Two polygons may share several edges in one line, where corners of third ones lie between: the portal spans them all.
fn portal(assembly: &Assembly, from: u32, to: u32) -> Option<Portal> {
    let place = |corner: u32| assembly.vertices[corner as usize];
    let mut shared = edges(&assembly.polygons[from as usize])
        .zip(&assembly.neighbours[from as usize])
        .filter(|(_, beyond)| **beyond == to)
        .map(|((a, b), _)| [place(a), place(b)]);
    let first = shared.next()?;
    let along = first[1] - first[0];
    let [mut right, mut left] = first;
    for point in shared.flatten() {
        if along.dot(point - right) < 0.0 {
            right = point;
        }
        if along.dot(point - left) > 0.0 {
            left = point;
        }
    }
    Some(Portal { left, right })
}

/// The shortest line from `start` to `goal` through the portals; both ends are in the answer.
pub(super) fn pull(start: Vec2, goal: Vec2, portals: &[Portal]) -> Vec<Vec2> {
    // From a point on a portal the funnel would open by half a turn, and left and right would lose their meaning. That
    // point lies in the polygon beyond as well, so the way begins there (and ends before, for a goal on a portal).
    let on =
        |point: Vec2, p: &Portal| point.distance(closest_on_segment(point, [p.left, p.right])) <= BORDER_TOLERANCE_M;
    let first = portals.iter().rposition(|portal| on(start, portal)).map_or(0, |last| last + 1);
    let portals = &portals[first..];
    let portals = &portals[..portals.iter().position(|portal| on(goal, portal)).unwrap_or(portals.len())];

    let mut points = vec![start];
    let at = |i: usize| portals.get(i).copied().unwrap_or(Portal { left: goal, right: goal });
    let (mut apex, mut left, mut right) = (start, start, start);
    let (mut left_at, mut right_at) = (0, 0);
    let mut i = 0;
    while i <= portals.len() {
        let next = at(i);
        if turn(apex, right, next.right) >= 0.0 {
            if apex == right || turn(apex, left, next.right) < 0.0 {
                (right, right_at) = (next.right, i);
            } else {
                points.push(left);
                (apex, right) = (left, left);
                i = left_at + 1;
                right_at = left_at;
                continue;
            }
        }
        if turn(apex, left, next.left) <= 0.0 {
            if apex == left || turn(apex, right, next.left) > 0.0 {
                (left, left_at) = (next.left, i);
            } else {
                points.push(right);
                (apex, left) = (right, right);
                i = right_at + 1;
                left_at = right_at;
                continue;
            }
        }
        i += 1;
    }
    points.push(goal);
    points.dedup();
    without_straight_corners(points)
}

/// Positive when `b` lies to the left of the ray from `apex` through `a`.
fn turn(apex: Vec2, a: Vec2, b: Vec2) -> f64 {
    (a - apex).cross(b - apex)
}

/// Drops the corners at which the line does not turn.
fn without_straight_corners(points: Vec<Vec2>) -> Vec<Vec2> {
    let mut kept: Vec<Vec2> = Vec::with_capacity(points.len());
    for (i, point) in points.iter().enumerate() {
        if let (Some(before), Some(after)) = (kept.last(), points.get(i + 1)) {
            let (arrives, leaves) = (*point - *before, *after - *point);
            if arrives.dot(leaves) > 0.0 && arrives.cross(leaves).abs() <= 1.0e-9 * arrives.length() {
                continue;
            }
        }
        kept.push(*point);
    }
    if kept.len() == 1 {
        kept.push(kept[0]);
    }
    kept
}
