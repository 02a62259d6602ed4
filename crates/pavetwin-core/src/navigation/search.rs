//! The shortest way over the mesh: A* from bend to bend along the sightlines, exact up to rounding.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::assembly::Assembly;
use super::sight::Sight;
use super::sightlines::{LANDMARKS, Metres, Sides, Sightlines};
use crate::geometry::Vec2;

/// A turn away from the obstacle by less than this, in radians, is rounding.
const STRAIGHT_RAD: f64 = 1.0e-6;
/// A way that gains less than this, in metres, is not better.
const EQUAL_M: f64 = 1.0e-9;

#[derive(Debug)]
pub(super) struct Searcher {
    sight: Sight,
    lines: Sightlines,
}

/// An end of the way, and what it sees.
#[derive(Debug, Clone, Copy)]
pub(super) struct End<'a> {
    pub place: Vec2,
    /// All polygons on which it lies.
    pub polygons: &'a [u32],
}

/// How a bend is best reached.
#[derive(Debug, Clone, Copy)]
struct Reached {
    bend: u32,
    /// The index of the one before, or the start.
    before: Option<u32>,
    along: Vec2,
    so_far_m: f64,
    to_go_m: f64,
}

impl Searcher {
    pub fn new(assembly: &Assembly) -> Self {
        let sight = Sight::new(assembly);
        let lines = Sightlines::new(&sight);
        Self { sight, lines }
    }

    /// The shortest way between two points that do not see each other; `None` when there is none.
    pub fn path(&self, start: End, goal: End) -> Option<Vec<Vec2>> {
        let from_start = self.bends_seen(start);
        let to_goal = self.bends_seen(goal);
        let bound = Bound::new(&self.lines, goal.place, &to_goal);
        let mut search = Search {
            searcher: self,
            bound,
            open: BinaryHeap::new(),
            reached: Vec::new(),
            at: vec![0; self.sight.bends.len()],
        };
        for (bend, distance_m) in from_start {
            let along = self.sight.bends[bend as usize].place - start.place;
            search.reach(bend, None, along, distance_m);
        }
        let (mut best_m, mut last) = (f64::INFINITY, None);
        while let Some((Reverse(Metres(least_m)), index)) = search.open.pop() {
            if least_m >= best_m {
                break;
            }
            let here = search.reached[index as usize];
            if search.at[here.bend as usize] != index + 1 || least_m > here.so_far_m + here.to_go_m {
                continue;
            }
            if let Ok(seen) = to_goal.binary_search_by_key(&here.bend, |(bend, _)| *bend) {
                let whole_m = here.so_far_m + to_goal[seen].1;
                if whole_m < best_m {
                    (best_m, last) = (whole_m, Some(index));
                }
            }
            search.go_on(index);
        }
        let mut points = vec![goal.place];
        let mut next = Some(last?);
        while let Some(index) = next {
            let reached = search.reached[index as usize];
            points.push(self.sight.bends[reached.bend as usize].place);
            next = reached.before;
        }
        points.push(start.place);
        points.reverse();
        points.dedup();
        Some(without_straight_corners(points))
    }

    /// The bends that a shortest way from or to `end` can go to first, with their distances, sorted.
    fn bends_seen(&self, end: End) -> Vec<(u32, f64)> {
        let mut seen = Vec::new();
        self.sight.look(end.place, end.polygons, &mut seen);
        let bends = seen.into_iter().map(|bend| (bend, &self.sight.bends[bend as usize]));
        bends
            .filter(|(_, bend)| Sides::of(bend, bend.place - end.place).touches())
            .map(|(number, bend)| (number, bend.place.distance(end.place)))
            .collect()
    }
}

struct Search<'a> {
    searcher: &'a Searcher,
    bound: Bound,
    open: BinaryHeap<(Reverse<Metres>, u32)>,
    reached: Vec<Reached>,
    /// For each bend one more than its index in `reached`, zero when it was not reached.
    at: Vec<u32>,
}

impl Search<'_> {
    /// Follows every sightline from a bend that turns around the obstacle there.
    fn go_on(&mut self, index: u32) {
        let here = self.reached[index as usize];
        let bends = &self.searcher.sight.bends;
        let bend = &bends[here.bend as usize];
        let arrives = Sides::of(bend, here.along);
        let slack = STRAIGHT_RAD * here.along.length();
        for line in self.searcher.lines.from(here.bend) {
            let along = bends[line.to as usize].place - bend.place;
            let turn = here.along.cross(along);
            let bends_left = arrives.left && turn >= -slack * line.length_m;
            let bends_right = arrives.right && turn <= slack * line.length_m;
            if bends_left || bends_right {
                self.reach(line.to, Some(index), along, here.so_far_m + line.length_m);
            }
        }
    }

    fn reach(&mut self, bend: u32, before: Option<u32>, along: Vec2, so_far_m: f64) {
        let known = self.at[bend as usize];
        let index = known.wrapping_sub(1);
        let to_go_m = if known == 0 {
            let place = self.searcher.sight.bends[bend as usize].place;
            let to_go_m = self.bound.to_go_m(place, self.searcher.lines.landmarks_m(bend));
            self.reached.push(Reached { bend, before, along, so_far_m, to_go_m });
            self.at[bend as usize] = self.reached.len() as u32;
            to_go_m
        } else {
            let reached = &mut self.reached[index as usize];
            if so_far_m >= reached.so_far_m - EQUAL_M {
                return;
            }
            *reached = Reached { before, along, so_far_m, ..*reached };
            reached.to_go_m
        };
        if to_go_m.is_finite() {
            let index = self.at[bend as usize] - 1;
            self.open.push((Reverse(Metres(so_far_m + to_go_m)), index));
        }
    }
}

/// A lower bound of the way from a bend to the goal.
struct Bound {
    goal: Vec2,
    /// Between these lie the goal's distances to the landmarks: the least by a way through a bend that it sees, and the
    /// most that those bends leave possible.
    least_m: [f64; LANDMARKS],
    most_m: [f64; LANDMARKS],
}

impl Bound {
    fn new(lines: &Sightlines, goal: Vec2, seen: &[(u32, f64)]) -> Self {
        let (mut least_m, mut most_m) = ([f64::INFINITY; LANDMARKS], [f64::NEG_INFINITY; LANDMARKS]);
        for (bend, distance_m) in seen {
            for (k, landmark_m) in lines.landmarks_m(*bend).iter().enumerate() {
                least_m[k] = least_m[k].min(landmark_m + distance_m);
                most_m[k] = most_m[k].max(landmark_m - distance_m);
            }
        }
        // A landmark that some of them cannot reach says nothing.
        for (least_m, most_m) in least_m.iter_mut().zip(&mut most_m).filter(|(_, most_m)| !most_m.is_finite()) {
            (*least_m, *most_m) = (f64::NEG_INFINITY, f64::INFINITY);
        }
        Self { goal, least_m, most_m }
    }

    fn to_go_m(&self, place: Vec2, landmarks_m: &[f64; LANDMARKS]) -> f64 {
        let mut bound_m = place.distance(self.goal);
        for (k, landmark_m) in landmarks_m.iter().enumerate() {
            // A comparison with NaN (two infinities) is false and leaves the bound as it is.
            for candidate_m in [self.least_m[k] - landmark_m, landmark_m - self.most_m[k]] {
                if candidate_m > bound_m {
                    bound_m = candidate_m;
                }
            }
        }
        bound_m
    }
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
