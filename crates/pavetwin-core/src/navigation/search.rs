//! The search over polygons, by the crate `polyanya`.
//!
//! Polyanya computes in single precision and snaps to corners within some millimetres. So only the sequence of polygons
//! is taken from it; [`funnel`](super::funnel) then finds the shortest line through them in double precision.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use super::assembly::{Assembly, WALL, edges};
use super::error::NavMeshError;
use super::funnel;
use super::mesh::NavMesh;
use crate::geometry::Vec2;

/// Polyanya keeps a layer number in the upper eight of 32 bits.
const MOST_POLYGONS: usize = (1 << 24) - 1;

/// How far a point is moved into its polygon when Polyanya finds no way from it, in metres.
const NUDGE_M: f64 = 0.005;

#[derive(Debug)]
pub(super) struct Searcher {
    mesh: polyanya::Mesh,
    /// Subtracted before coordinates become single precision, so that they stay small.
    origin: Vec2,
}

impl Searcher {
    pub fn new(assembly: &Assembly) -> Result<Self, NavMeshError> {
        let count = assembly.polygons.len();
        if count > MOST_POLYGONS {
            return Err(NavMeshError::TooManyPolygons { count, most: MOST_POLYGONS });
        }
        let total = assembly.vertices.iter().fold(Vec2::ZERO, |sum, vertex| sum + *vertex);
        let origin = total * (1.0 / assembly.vertices.len() as f64);
        let vertices = vertices_with_rings(assembly, origin);
        let polygons = assembly
            .polygons
            .iter()
            .zip(&assembly.neighbours)
            .map(|(polygon, beyond)| {
                let mut others: Vec<u32> = beyond.iter().copied().filter(|other| *other != WALL).collect();
                others.sort_unstable();
                others.dedup();
                polyanya::Polygon::new(polygon.clone(), others.len() <= 1)
            })
            .collect();
        let mut mesh = polyanya::Mesh::new(vertices, polygons).map_err(|_| NavMeshError::Empty)?;
        mesh.set_search_delta(0.01);
        Ok(Self { mesh, origin })
    }

    /// The shortest path between two points that lie on the mesh; `None` when the search finds none.
    ///
    /// Polyanya now and then finds nothing from a point that is itself a corner (its rays have no direction there). It
    /// is then asked the other way round, then from a little inside the polygons; and last, polygons are searched by
    /// their edges' middles, which always finds a way, though not always the very shortest.
    pub fn path(&self, mesh: &NavMesh, assembly: &Assembly, start: Vec2, goal: Vec2) -> Option<Vec<Vec2>> {
        let reversed = |mut way: Vec<Vec2>| {
            way.reverse();
            way
        };
        let inner = |point: Vec2| {
            let polygon = mesh.polygon_at(point)? as usize;
            let middle = middle_of(assembly, polygon);
            Some(point + (middle - point).normalized() * NUDGE_M.min(0.5 * point.distance(middle)))
        };
        self.search(mesh, assembly, [start, goal], [start, goal])
            .or_else(|| self.search(mesh, assembly, [goal, start], [goal, start]).map(reversed))
            .or_else(|| self.search(mesh, assembly, [start, goal], [inner(start)?, inner(goal)?]))
            .or_else(|| self.search(mesh, assembly, [goal, start], [inner(goal)?, inner(start)?]).map(reversed))
            .or_else(|| {
                let corridor = corridor_by_middles(assembly, mesh.polygon_at(start)?, mesh.polygon_at(goal)?)?;
                Some(funnel::pull(start, goal, &funnel::portals(assembly, &corridor)?))
            })
    }

    /// One run of Polyanya between the points `asked`, for a path between `ends` next to them.
    fn search(&self, mesh: &NavMesh, assembly: &Assembly, ends: [Vec2; 2], asked: [Vec2; 2]) -> Option<Vec<Vec2>> {
        let [start, goal] = ends;
        let found = self.mesh.path(self.local(asked[0]), self.local(asked[1]))?;
        let corridor: Vec<u32> = found.polygons().into_iter().map(|(_, polygon)| polygon).collect();
        let pulled = funnel::portals(assembly, &corridor).map(|portals| funnel::pull(start, goal, &portals));
        let stays = |points: &Vec<Vec2>| points.windows(2).all(|leg| mesh.segment_inside(leg[0], leg[1]));
        pulled.filter(stays).or_else(|| {
            let corners = found.path.iter().map(|p| mesh.nearest(self.origin + Vec2::new(p.x.into(), p.y.into())));
            let mut direct: Vec<Vec2> = std::iter::once(start).chain(corners).collect();
            *direct.last_mut()? = goal;
            Some(direct).filter(stays)
        })
    }

    fn local(&self, point: Vec2) -> glam::Vec2 {
        let offset = point - self.origin;
        glam::Vec2::new(offset.x as f32, offset.y as f32)
    }
}

/// Polyanya's corners: each knows the polygons around it, counter-clockwise, with a gap mark where there is a wall.
fn vertices_with_rings(assembly: &Assembly, origin: Vec2) -> Vec<polyanya::Vertex> {
    let mut around: Vec<Vec<(f64, u32)>> = vec![Vec::new(); assembly.vertices.len()];
    let mut at_wall = vec![false; assembly.vertices.len()];
    for (number, (polygon, beyond)) in assembly.polygons.iter().zip(&assembly.neighbours).enumerate() {
        for (i, corner) in polygon.iter().enumerate() {
            let next = polygon[(i + 1) % polygon.len()];
            let leaves = assembly.vertices[next as usize] - assembly.vertices[*corner as usize];
            around[*corner as usize].push((leaves.yaw_rad(), number as u32));
            if beyond[i] == WALL {
                at_wall[*corner as usize] = true;
                at_wall[next as usize] = true;
            }
        }
    }
    around
        .into_iter()
        .zip(at_wall)
        .zip(&assembly.vertices)
        .map(|((mut ring, at_wall), place)| {
            ring.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut polygons: Vec<u32> = ring.into_iter().map(|(_, polygon)| polygon).collect();
            if at_wall {
                polygons.push(u32::MAX);
            }
            let offset = *place - origin;
            polyanya::Vertex::new(glam::Vec2::new(offset.x as f32, offset.y as f32), polygons)
        })
        .collect()
}

fn middle_of(assembly: &Assembly, polygon: usize) -> Vec2 {
    let corners = &assembly.polygons[polygon];
    let total = corners.iter().fold(Vec2::ZERO, |sum, corner| sum + assembly.vertices[*corner as usize]);
    total * (1.0 / corners.len() as f64)
}

/// A* from polygon to polygon over the middles of their edges.
fn corridor_by_middles(assembly: &Assembly, start: u32, goal: u32) -> Option<Vec<u32>> {
    let target = middle_of(assembly, goal as usize);
    // Millimetres as whole numbers, so that the queue has a total order.
    let key = |metres: f64| Reverse((metres * 1.0e3) as u64);
    let mut reached = HashMap::from([(start, (0.0, start, middle_of(assembly, start as usize)))]);
    let mut open = BinaryHeap::from([(key(0.0), start)]);
    while let Some((_, polygon)) = open.pop() {
        if polygon == goal {
            let mut corridor = vec![goal];
            while let Some((_, before, _)) = reached.get(corridor.last()?).filter(|_| corridor.last() != Some(&start)) {
                corridor.push(*before);
            }
            corridor.reverse();
            return Some(corridor);
        }
        let (so_far_m, _, place) = reached[&polygon];
        let beyond = &assembly.neighbours[polygon as usize];
        for ((a, b), other) in edges(&assembly.polygons[polygon as usize]).zip(beyond).filter(|(_, o)| **o != WALL) {
            let middle = assembly.vertices[a as usize].lerp(assembly.vertices[b as usize], 0.5);
            let cost_m = so_far_m + place.distance(middle);
            if reached.get(other).is_none_or(|(known_m, _, _)| cost_m < *known_m) {
                reached.insert(*other, (cost_m, polygon, middle));
                open.push((key(cost_m + middle.distance(target)), *other));
            }
        }
    }
    None
}
