//! The tangent graph of a mesh: which bends see each other along a line that a shortest way can follow.
//!
//! A shortest way bends at reflex corners of the border only, and around them: it leaves the obstacle on one side.
//! Lines that would run into the obstacle at either end are left out (Liu, Arimoto 1992), which leaves a few for each
//! corner. Over these, the distances from some far landmarks bound every distance from below by the triangle
//! inequality, as Goldberg and Harrelson (2005) use them for road networks. Streets that cross at right angles need
//! such a bound: there the straight line is far shorter than any way.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::sight::{Bend, Sight};
use crate::geometry::Vec2;

/// Landmarks of one connected part.
pub(super) const LANDMARKS: usize = 8;
/// A part with fewer bends is searched without landmarks.
const LEAST_BENDS: usize = 16;
/// A wall this far beyond a tangent, in metres, still counts as beside it.
const TOUCH_M: f64 = 1.0e-7;

/// On which side of a line an obstacle is that it touches; both where it only grazes a straight wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sides {
    pub left: bool,
    pub right: bool,
}

impl Sides {
    /// Of the obstacle at `bend`, for a line that arrives there or leaves it in the direction `along`.
    pub fn of(bend: &Bend, along: Vec2) -> Self {
        let slack = TOUCH_M * along.length();
        let [a, b] = bend.walls.map(|wall| along.cross(wall));
        Self { left: a >= -slack && b >= -slack, right: a <= slack && b <= slack }
    }

    pub fn touches(self) -> bool {
        self.left || self.right
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Sightline {
    pub to: u32,
    pub length_m: f64,
}

#[derive(Debug)]
pub(super) struct Sightlines {
    /// Those from bend i are `lines[starts[i]..starts[i + 1]]`.
    lines: Vec<Sightline>,
    starts: Vec<u32>,
    /// For each bend, its distances to the landmarks of its part; infinite where there is none.
    landmarks_m: Vec<[f64; LANDMARKS]>,
}

impl Sightlines {
    pub fn new(sight: &Sight) -> Self {
        let bends = &sight.bends;
        let (mut pairs, mut seen) = (Vec::new(), Vec::new());
        for (from, bend) in bends.iter().enumerate() {
            let from = from as u32;
            sight.look(bend.place, &sight.polygons_at(from), &mut seen);
            for to in seen.iter().filter(|to| **to != from) {
                let other = &bends[*to as usize];
                let along = other.place - bend.place;
                if Sides::of(bend, along).touches() && Sides::of(other, along).touches() {
                    pairs.extend([(from, *to), (*to, from)]);
                }
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut starts = vec![0; bends.len() + 1];
        pairs.iter().for_each(|(from, _)| starts[*from as usize + 1] += 1);
        (1..starts.len()).for_each(|i| starts[i] += starts[i - 1]);
        let length_m = |from: u32, to: u32| bends[from as usize].place.distance(bends[to as usize].place);
        let lines = pairs.into_iter().map(|(from, to)| Sightline { to, length_m: length_m(from, to) }).collect();
        let mut graph = Self { lines, starts, landmarks_m: vec![[f64::INFINITY; LANDMARKS]; bends.len()] };
        graph.measure();
        graph
    }

    pub fn from(&self, bend: u32) -> &[Sightline] {
        &self.lines[self.starts[bend as usize] as usize..self.starts[bend as usize + 1] as usize]
    }

    pub fn landmarks_m(&self, bend: u32) -> &[f64; LANDMARKS] {
        &self.landmarks_m[bend as usize]
    }

    /// Chooses landmarks in every part, each as far as can be from those before, and measures from them.
    fn measure(&mut self) {
        let mut known = vec![false; self.landmarks_m.len()];
        let mut best_m = vec![f64::INFINITY; self.landmarks_m.len()];
        for seed in 0..known.len() as u32 {
            if known[seed as usize] {
                continue;
            }
            let mut part = self.distances_m(seed, &mut best_m);
            part.iter().for_each(|(bend, _)| known[*bend as usize] = true);
            if part.len() < LEAST_BENDS {
                continue;
            }
            part.sort_unstable_by_key(|(bend, _)| *bend);
            let mut nearest_m: Vec<f64> = part.iter().map(|(_, distance_m)| *distance_m).collect();
            for number in 0..LANDMARKS {
                let furthest = (0..part.len()).max_by(|a, b| nearest_m[*a].total_cmp(&nearest_m[*b])).unwrap_or(0);
                for (bend, distance_m) in self.distances_m(part[furthest].0, &mut best_m) {
                    self.landmarks_m[bend as usize][number] = distance_m;
                }
                for (nearest_m, (bend, _)) in nearest_m.iter_mut().zip(&part) {
                    let distance_m = self.landmarks_m[*bend as usize][number];
                    *nearest_m = if number == 0 { distance_m } else { nearest_m.min(distance_m) };
                }
            }
        }
    }

    /// Every bend of the part that `from` belongs to, with its distance (Dijkstra). All of `best_m` is infinite, before
    /// and afterwards: what a part costs must not depend on how many others there are.
    fn distances_m(&self, from: u32, best_m: &mut [f64]) -> Vec<(u32, f64)> {
        best_m[from as usize] = 0.0;
        let mut open = BinaryHeap::from([(Reverse(Metres(0.0)), from)]);
        let mut reached = Vec::new();
        while let Some((Reverse(Metres(distance_m)), bend)) = open.pop() {
            if distance_m > best_m[bend as usize] {
                continue;
            }
            reached.push((bend, distance_m));
            for line in self.from(bend) {
                let through_m = distance_m + line.length_m;
                if through_m < best_m[line.to as usize] {
                    best_m[line.to as usize] = through_m;
                    open.push((Reverse(Metres(through_m)), line.to));
                }
            }
        }
        reached.iter().for_each(|(bend, _)| best_m[*bend as usize] = f64::INFINITY);
        reached
    }
}

/// A length that is never NaN, in a queue.
#[derive(Debug, Clone, Copy)]
pub(super) struct Metres(pub f64);

impl Ord for Metres {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl PartialOrd for Metres {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Metres {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Metres {}
