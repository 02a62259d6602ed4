//! The navigation mesh: convex polygons over which the UAV may fly at one altitude, and what can be asked of them.

use std::sync::Arc;

use super::assembly::{Assembly, BORDER_TOLERANCE_M, WALL, assemble, edges, signed_area};
use super::error::NavMeshError;
use super::grid::{BinGrid, Bounds};
use super::search::{End, Searcher};
use crate::geometry::Vec2;

/// A start or goal that misses the mesh by less than this, in metres, is moved onto it.
const SNAP_M: f64 = 1.0e-3;

/// The flight domain at one altitude as convex polygons, in the world frame (east-north, metres).
///
/// Cloning is cheap: clones share the same polygons.
#[derive(Debug, Clone)]
pub struct NavMesh {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    assembly: Assembly,
    /// The half-planes of polygon i are `planes[plane_starts[i]..plane_starts[i + 1]]`, one for each edge.
    planes: Vec<HalfPlane>,
    plane_starts: Vec<u32>,
    grid: BinGrid,
    walls: Vec<[Vec2; 2]>,
    wall_grid: BinGrid,
    searcher: Searcher,
    area_m2: f64,
}

/// The points with `normal · p >= offset`; `normal` has length one and points into the polygon.
#[derive(Debug, Clone, Copy)]
struct HalfPlane {
    normal: Vec2,
    offset: f64,
}

impl HalfPlane {
    fn depth_m(self, point: Vec2) -> f64 {
        self.normal.dot(point) - self.offset
    }
}

impl NavMesh {
    /// Makes a mesh of convex polygons, such as a saved one. Any winding is taken; polygons without area are dropped,
    /// corners at the same place are joined, and corners that lie on another polygon's edge are inserted there.
    ///
    /// # Errors
    /// [`NavMeshError::Empty`], [`NavMeshError::NotFinite`], [`NavMeshError::UnknownVertex`],
    /// and [`NavMeshError::NotConvex`].
    pub fn from_polygons(vertices: &[Vec2], polygons: &[Vec<u32>]) -> Result<Self, NavMeshError> {
        let assembly = assemble(vertices, polygons)?;
        let searcher = Searcher::new(&assembly);
        let corners = |polygon: &[u32]| -> Vec<Vec2> {
            polygon.iter().map(|corner| assembly.vertices[*corner as usize]).collect()
        };
        let mut planes = Vec::new();
        let mut plane_starts = vec![0];
        let mut boxes = Vec::with_capacity(assembly.polygons.len());
        for polygon in &assembly.polygons {
            for (a, b) in edges(polygon) {
                let from = assembly.vertices[a as usize];
                let normal = (assembly.vertices[b as usize] - from).normalized().left();
                planes.push(HalfPlane { normal, offset: normal.dot(from) });
            }
            plane_starts.push(planes.len() as u32);
            boxes.push(Bounds::of(corners(polygon)).grown(2.0 * BORDER_TOLERANCE_M));
        }
        let extent = Bounds::of(assembly.vertices.iter().copied()).grown(1.0);
        let grid = BinGrid::new(extent, &boxes, |polygon, bin| {
            let range = plane_starts[polygon] as usize..plane_starts[polygon + 1] as usize;
            planes[range].iter().all(|plane| {
                let far_x = if plane.normal.x > 0.0 { bin.max.x } else { bin.min.x };
                let far_y = if plane.normal.y > 0.0 { bin.max.y } else { bin.min.y };
                plane.depth_m(Vec2::new(far_x, far_y)) >= -2.0 * BORDER_TOLERANCE_M
            })
        });
        let walls: Vec<[Vec2; 2]> = assembly
            .polygons
            .iter()
            .zip(&assembly.neighbours)
            .flat_map(|(polygon, beyond)| edges(polygon).zip(beyond).filter(|(_, beyond)| **beyond == WALL))
            .map(|((a, b), _)| [assembly.vertices[a as usize], assembly.vertices[b as usize]])
            .collect();
        let wall_boxes: Vec<Bounds> = walls.iter().map(|wall| Bounds::of(*wall)).collect();
        let wall_grid = BinGrid::new(extent, &wall_boxes, |_, _| true);
        let area_m2 = assembly.polygons.iter().map(|polygon| signed_area(&assembly.vertices, polygon)).sum();
        let inner = Inner { assembly, planes, plane_starts, grid, walls, wall_grid, searcher, area_m2 };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// The corners, in metres.
    pub fn vertices(&self) -> &[Vec2] {
        &self.inner.assembly.vertices
    }

    /// The convex polygons as indices into [`Self::vertices`], counter-clockwise. Three corners may lie in a line.
    pub fn polygons(&self) -> &[Vec<u32>] {
        &self.inner.assembly.polygons
    }

    /// The border of the mesh: edges without a polygon beyond, the mesh on their left.
    pub fn walls(&self) -> &[[Vec2; 2]] {
        &self.inner.walls
    }

    /// The area of all polygons, in square metres.
    pub fn area_m2(&self) -> f64 {
        self.inner.area_m2
    }

    /// Whether `point` lies on the mesh, its border included (to within [`BORDER_TOLERANCE_M`]).
    pub fn contains(&self, point: Vec2) -> bool {
        self.polygon_at(point).is_some()
    }

    /// The polygon on which `point` lies; on a shared edge, one of them.
    pub fn polygon_at(&self, point: Vec2) -> Option<u32> {
        self.polygons_at(point).next()
    }

    fn polygons_at(&self, point: Vec2) -> impl Iterator<Item = u32> + '_ {
        self.inner.grid.at(point).iter().copied().filter(move |polygon| {
            self.planes_of(*polygon).iter().all(|plane| plane.depth_m(point) >= -BORDER_TOLERANCE_M)
        })
    }

    /// Whether a way leads from one point of the mesh to another. A corner at which two parts of the mesh touch
    /// belongs to both, but does not join them.
    pub fn connected(&self, from: Vec2, to: Vec2) -> bool {
        let components = &self.inner.assembly.components;
        self.polygons_at(from)
            .any(|start| self.polygons_at(to).any(|goal| components[start as usize] == components[goal as usize]))
    }

    /// The number of the connected part of the mesh on which `point` lies; `None` outside the mesh.
    ///
    /// A path exists between two points with equal numbers; see [`Self::connected`] for points where two parts touch.
    pub fn component_of(&self, point: Vec2) -> Option<u32> {
        self.polygon_at(point).map(|polygon| self.inner.assembly.components[polygon as usize])
    }

    /// The point of the mesh closest to `point`: `point` itself when it lies inside. [`Self::contains`] holds for it.
    pub fn nearest(&self, point: Vec2) -> Vec2 {
        if self.contains(point) {
            return point;
        }
        let (mut best_m, mut best) = (f64::INFINITY, self.inner.walls[0]);
        self.inner.wall_grid.visit_outward(point, |wall| {
            let wall = self.inner.walls[wall as usize];
            let distance_m = point.distance(closest_on_segment(point, wall));
            if distance_m < best_m {
                (best_m, best) = (distance_m, wall);
            }
            best_m
        });
        let on_border = closest_on_segment(point, best);
        let inward = (best[1] - best[0]).normalized().left();
        let nudges_m = [0.0, 1.0e-9, 1.0e-7, BORDER_TOLERANCE_M, 1.0e-5];
        let nudged = nudges_m.into_iter().map(|nudge_m| on_border + inward * nudge_m);
        nudged.into_iter().find(|candidate| self.contains(*candidate)).unwrap_or(best[0])
    }

    /// Whether the straight line from `from` to `to` stays on the mesh, borders included.
    pub fn segment_inside(&self, from: Vec2, to: Vec2) -> bool {
        let along = to - from;
        let length_m = along.length();
        if length_m < BORDER_TOLERANCE_M {
            return self.contains(from) && self.contains(to);
        }
        let slack = 1.0e-9 / length_m;
        let mut reached = 0.0;
        loop {
            let here = from + along * reached;
            let mut furthest: f64 = reached;
            for polygon in self.inner.grid.at(here) {
                if let Some((_, leaves)) =
                    self.clip(*polygon, from, along).filter(|(enters, _)| *enters <= reached + slack)
                {
                    furthest = furthest.max(leaves);
                }
            }
            if furthest >= 1.0 {
                return true;
            }
            if furthest <= reached + slack {
                return false;
            }
            reached = furthest;
        }
    }

    /// The shortest way from `start` to `goal` over the mesh, any-angle, both ends included: at least two points.
    /// Every point is on the mesh and every straight piece stays on it. An end that misses the mesh by less than a
    /// millimetre is moved onto it.
    ///
    /// It is the optimum, up to rounding: A* over the tangent graph of the border's reflex corners.
    ///
    /// # Errors
    /// [`NavMeshError::StartOutside`], [`NavMeshError::GoalOutside`], [`NavMeshError::Unreachable`].
    pub fn path(&self, start: Vec2, goal: Vec2) -> Result<Vec<Vec2>, NavMeshError> {
        let from = self.snapped(start).ok_or(NavMeshError::StartOutside { x: start.x, y: start.y })?;
        let to = self.snapped(goal).ok_or(NavMeshError::GoalOutside { x: goal.x, y: goal.y })?;
        if !self.connected(from, to) {
            return Err(NavMeshError::Unreachable { start, goal });
        }
        if self.segment_inside(from, to) {
            return Ok(vec![from, to]);
        }
        let polygons = [from, to].map(|end| self.polygons_at(end).collect::<Vec<u32>>());
        let (from, to) = (End { place: from, polygons: &polygons[0] }, End { place: to, polygons: &polygons[1] });
        self.inner.searcher.path(from, to).ok_or(NavMeshError::Unreachable { start, goal })
    }

    /// `point` if it lies on the mesh, the nearest point of the mesh if that is less than a millimetre away.
    pub(super) fn snapped(&self, point: Vec2) -> Option<Vec2> {
        if !(point.x.is_finite() && point.y.is_finite()) {
            return None;
        }
        let near = self.nearest(point);
        (near.distance(point) < SNAP_M).then_some(near)
    }

    /// Every border edge that comes within `radius_m` of `point`, each once.
    pub(super) fn walls_near(&self, point: Vec2, radius_m: f64) -> Vec<[Vec2; 2]> {
        let mut found = Vec::new();
        self.inner.wall_grid.visit_box(Bounds::of([point]).grown(radius_m), |wall| found.push(wall));
        found.sort_unstable();
        found.dedup();
        let walls = found.into_iter().map(|wall| self.inner.walls[wall as usize]);
        walls.filter(|wall| point.distance(closest_on_segment(point, *wall)) <= radius_m).collect()
    }

    fn planes_of(&self, polygon: u32) -> &[HalfPlane] {
        let starts = &self.inner.plane_starts;
        &self.inner.planes[starts[polygon as usize] as usize..starts[polygon as usize + 1] as usize]
    }

    /// The shares of the line `from + along * share` at which it enters and leaves a polygon.
    fn clip(&self, polygon: u32, from: Vec2, along: Vec2) -> Option<(f64, f64)> {
        let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
        for plane in self.planes_of(polygon) {
            let depth_m = plane.depth_m(from) + BORDER_TOLERANCE_M;
            let gain_m = plane.normal.dot(along);
            if gain_m.abs() < 1.0e-14 {
                if depth_m < 0.0 {
                    return None;
                }
            } else if gain_m > 0.0 {
                enters = enters.max(-depth_m / gain_m);
            } else {
                leaves = leaves.min(-depth_m / gain_m);
            }
        }
        (enters <= leaves).then_some((enters, leaves))
    }
}

/// The point of the segment closest to `point`.
pub(super) fn closest_on_segment(point: Vec2, segment: [Vec2; 2]) -> Vec2 {
    let along = segment[1] - segment[0];
    let share = (point - segment[0]).dot(along) / along.dot(along).max(f64::MIN_POSITIVE);
    segment[0] + along * share.clamp(0.0, 1.0)
}
