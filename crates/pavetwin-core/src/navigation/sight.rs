//! What is seen from a point of the mesh: triangular expansion (Bungiu, Hemmer, Hershberger, Huang, Kröller 2014).
//!
//! From the polygon of the point, the view widens through every edge into the next polygon, cut down to what the edge
//! leaves open, until it ends at walls. Only corners at which a shortest way can bend are of interest: those where the
//! border is reflex.

use std::f64::consts::PI;

use super::assembly::{Assembly, WALL};
use crate::geometry::Vec2;

/// No corner to bend at.
pub(super) const NO_BEND: u32 = u32::MAX;
/// A border that turns by less than this, in radians, is straight.
const STRAIGHT_RAD: f64 = 1.0e-10;
/// A corner this far beside the view, in metres, is still seen: room for rounding, well below the border tolerance.
const BESIDE_M: f64 = 1.0e-7;

/// A reflex corner of the border, at which a shortest way can bend.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bend {
    pub place: Vec2,
    /// From the corner along the two walls that meet there; what lies between them, by less than half a turn, is no
    /// mesh.
    pub walls: [Vec2; 2],
}

/// One edge of a polygon, from its first corner to that of the next edge.
#[derive(Debug, Clone, Copy)]
struct Edge {
    from: Vec2,
    polygon: u32,
    /// The same edge in the polygon beyond, or [`WALL`].
    twin: u32,
    /// The bend at the first corner, if it is one as seen from this polygon.
    bend: u32,
}

/// The mesh prepared for looking around in it.
#[derive(Debug)]
pub(super) struct Sight {
    /// Those of polygon i are `edges[starts[i]..starts[i + 1]]`, counter-clockwise.
    edges: Vec<Edge>,
    starts: Vec<u32>,
    pub bends: Vec<Bend>,
    /// For each bend, the first edge (the wall that leaves it) of the polygons around it.
    leaving: Vec<u32>,
}

impl Sight {
    pub fn new(assembly: &Assembly) -> Self {
        let mut sight = Self { edges: Vec::new(), starts: vec![0], bends: Vec::new(), leaving: Vec::new() };
        for (number, polygon) in assembly.polygons.iter().enumerate() {
            sight.edges.extend(polygon.iter().map(|corner| Edge {
                from: assembly.vertices[*corner as usize],
                polygon: number as u32,
                twin: WALL,
                bend: NO_BEND,
            }));
            sight.starts.push(sight.edges.len() as u32);
        }
        for (number, (polygon, beyond)) in assembly.polygons.iter().zip(&assembly.neighbours).enumerate() {
            for (i, other) in beyond.iter().enumerate().filter(|(_, other)| **other != WALL) {
                let starts_at = polygon[(i + 1) % polygon.len()];
                let theirs = assembly.polygons[*other as usize].iter().position(|corner| *corner == starts_at);
                let twin = theirs.map_or(WALL, |j| sight.starts[*other as usize] + j as u32);
                sight.edges[sight.starts[number] as usize + i].twin = twin;
            }
        }
        for edge in 0..sight.edges.len() as u32 {
            // Polygons that overlap, in a mesh of somebody's own, may claim one edge twice.
            let twin = sight.edges[edge as usize].twin;
            if twin != WALL && sight.edges[twin as usize].twin != edge {
                sight.edges[edge as usize].twin = WALL;
            }
        }
        for edge in 0..sight.edges.len() as u32 {
            if sight.edges[edge as usize].twin == WALL {
                sight.add_bend(edge);
            }
        }
        sight
    }

    /// Goes counter-clockwise round the corner from the wall that leaves it to the one that arrives.
    fn add_bend(&mut self, wall: u32) {
        let place = self.edges[wall as usize].from;
        let leaves = self.edges[self.next(wall) as usize].from - place;
        let (mut around, mut angle_rad) = (vec![wall], 0.0);
        loop {
            let edge = *around.last().unwrap_or(&wall);
            let arriving = self.before(edge);
            let (out, back) =
                (self.edges[self.next(edge) as usize].from - place, self.edges[arriving as usize].from - place);
            // Without its sign: half a turn comes out as minus half a turn, too.
            angle_rad += out.cross(back).atan2(out.dot(back)).abs();
            match self.edges[arriving as usize].twin {
                WALL => {
                    if angle_rad > PI + STRAIGHT_RAD {
                        let bend = self.bends.len() as u32;
                        self.bends.push(Bend { place, walls: [back, leaves] });
                        self.leaving.push(wall);
                        around.into_iter().for_each(|edge| self.edges[edge as usize].bend = bend);
                    }
                    return;
                }
                twin => around.push(twin),
            }
        }
    }

    /// The polygons around a bend.
    pub fn polygons_at(&self, bend: u32) -> Vec<u32> {
        let mut edge = self.leaving[bend as usize];
        let mut polygons = vec![self.edges[edge as usize].polygon];
        while let Some(twin) = Some(self.edges[self.before(edge) as usize].twin).filter(|twin| *twin != WALL) {
            edge = twin;
            polygons.push(self.edges[edge as usize].polygon);
        }
        polygons
    }

    /// The bends seen from `eye`, which lies in (or on the border of) all of `polygons`. Sorted, each once.
    pub fn look(&self, eye: Vec2, polygons: &[u32], seen: &mut Vec<u32>) {
        seen.clear();
        let mut views = Vec::new();
        for polygon in polygons {
            for i in self.range(*polygon) {
                let edge = self.edges[i as usize];
                seen.push(edge.bend);
                let view = View {
                    through: edge.twin,
                    right: edge.from - eye,
                    left: self.edges[self.next(i) as usize].from - eye,
                };
                let known = || polygons.contains(&self.edges[edge.twin as usize].polygon);
                if edge.twin != WALL && view.is_open() && !known() {
                    views.push(view);
                }
            }
        }
        while let Some(view) = views.pop() {
            self.widen(eye, view, &mut views, seen);
        }
        seen.sort_unstable();
        seen.dedup();
        if seen.last() == Some(&NO_BEND) {
            seen.pop();
        }
    }

    /// From the edge through which a polygon is seen to its other edges, from right to left.
    fn widen(&self, eye: Vec2, view: View, views: &mut Vec<View>, seen: &mut Vec<u32>) {
        let mut i = self.next(view.through);
        let mut right = self.edges[i as usize].from - eye;
        while i != view.through {
            let edge = self.edges[i as usize];
            i = self.next(i);
            let left = self.edges[i as usize].from - eye;
            if i != view.through && self.edges[i as usize].bend != NO_BEND && view.shows(left) {
                seen.push(self.edges[i as usize].bend);
            }
            if edge.twin != WALL {
                let narrowed = View {
                    through: edge.twin,
                    right: if view.right.cross(right) > 0.0 { right } else { view.right },
                    left: if left.cross(view.left) > 0.0 { left } else { view.left },
                };
                if narrowed.is_open() {
                    views.push(narrowed);
                }
            }
            right = left;
        }
    }

    fn range(&self, polygon: u32) -> std::ops::Range<u32> {
        self.starts[polygon as usize]..self.starts[polygon as usize + 1]
    }

    fn next(&self, edge: u32) -> u32 {
        let range = self.range(self.edges[edge as usize].polygon);
        if edge + 1 == range.end { range.start } else { edge + 1 }
    }

    fn before(&self, edge: u32) -> u32 {
        let range = self.range(self.edges[edge as usize].polygon);
        if edge == range.start { range.end - 1 } else { edge - 1 }
    }
}

/// What an edge leaves open to the eye: everything between two rays, less than half a turn.
#[derive(Debug, Clone, Copy)]
struct View {
    /// The edge as the polygon beyond has it.
    through: u32,
    right: Vec2,
    left: Vec2,
}

impl View {
    fn is_open(&self) -> bool {
        self.right.cross(self.left) > 0.0
    }

    fn shows(&self, offset: Vec2) -> bool {
        let reaches = |side: f64, ray: Vec2| side >= 0.0 || side * side <= BESIDE_M * BESIDE_M * ray.dot(ray);
        reaches(self.right.cross(offset), self.right) && reaches(offset.cross(self.left), self.left)
    }
}
