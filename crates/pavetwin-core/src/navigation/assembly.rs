//! From loose convex polygons to a mesh whose polygons know their neighbours.
//!
//! Two polygons are neighbours when they share an edge, corner for corner. Where a corner of one lies in the middle of
//! an edge of the other (a T-junction, as on the seam of two tiles), the corner is inserted into that edge: the polygon
//! stays convex, with three corners in a line, and the path search sees the passage.

use std::collections::HashMap;

use super::error::NavMeshError;
use super::grid::{BinGrid, Bounds};
use crate::geometry::Vec2;

/// A point this far outside a border, in metres, still counts as inside: room for rounding, nothing more.
pub const BORDER_TOLERANCE_M: f64 = 1.0e-6;

/// No polygon lies beyond this edge.
pub(super) const WALL: u32 = u32::MAX;
/// Polygons with less area than this are dropped.
const LEAST_AREA_M2: f64 = 1.0e-9;

/// Polygons with shared corners and known neighbours.
#[derive(Debug)]
pub(super) struct Assembly {
    pub vertices: Vec<Vec2>,
    /// Corner indices, counter-clockwise.
    pub polygons: Vec<Vec<u32>>,
    /// For each polygon and each of its edges (corner i to corner i + 1) the polygon beyond it, or [`WALL`].
    pub neighbours: Vec<Vec<u32>>,
    /// For each polygon the number of the connected part it belongs to.
    pub components: Vec<u32>,
}

pub(super) fn assemble(vertices: &[Vec2], polygons: &[Vec<u32>]) -> Result<Assembly, NavMeshError> {
    check_input(vertices, polygons)?;
    let (vertices, polygons) = weld(vertices, polygons);
    let mut kept = Vec::with_capacity(polygons.len());
    for (number, mut polygon) in polygons.into_iter().enumerate() {
        let area_m2 = signed_area(&vertices, &polygon);
        if polygon.len() < 3 || area_m2.abs() < LEAST_AREA_M2 {
            continue;
        }
        if area_m2 < 0.0 {
            polygon.reverse();
        }
        if !is_convex(&vertices, &polygon) {
            return Err(NavMeshError::NotConvex { polygon: number });
        }
        kept.push(polygon);
    }
    if kept.is_empty() {
        return Err(NavMeshError::Empty);
    }
    resolve_t_junctions(&vertices, &mut kept);
    let neighbours = neighbours_of(&kept);
    let components = components_of(&neighbours);
    Ok(Assembly { vertices, polygons: kept, neighbours, components })
}

fn check_input(vertices: &[Vec2], polygons: &[Vec<u32>]) -> Result<(), NavMeshError> {
    if let Some(vertex) = vertices.iter().position(|v| !(v.x.is_finite() && v.y.is_finite())) {
        return Err(NavMeshError::NotFinite { vertex });
    }
    for (number, polygon) in polygons.iter().enumerate() {
        if let Some(vertex) = polygon.iter().find(|v| **v as usize >= vertices.len()) {
            return Err(NavMeshError::UnknownVertex { polygon: number, vertex: *vertex, count: vertices.len() });
        }
    }
    Ok(())
}

/// Gives corners at the same place one number, drops unused ones and repeated corners of a polygon.
fn weld(vertices: &[Vec2], polygons: &[Vec<u32>]) -> (Vec<Vec2>, Vec<Vec<u32>>) {
    let mut numbers = HashMap::new();
    let mut welded = Vec::new();
    let polygons = polygons
        .iter()
        .map(|polygon| {
            let mut corners: Vec<u32> = polygon
                .iter()
                .map(|corner| {
                    // Adding zero turns -0.0 into 0.0, which is the same place.
                    let place = vertices[*corner as usize] + Vec2::ZERO;
                    *numbers.entry((place.x.to_bits(), place.y.to_bits())).or_insert_with(|| {
                        welded.push(place);
                        (welded.len() - 1) as u32
                    })
                })
                .collect();
            corners.dedup();
            while corners.len() > 1 && corners.first() == corners.last() {
                corners.pop();
            }
            corners
        })
        .collect();
    (welded, polygons)
}

pub(super) fn signed_area(vertices: &[Vec2], polygon: &[u32]) -> f64 {
    let Some(first) = polygon.first() else { return 0.0 };
    let origin = vertices[*first as usize];
    edges(polygon).map(|(a, b)| (vertices[a as usize] - origin).cross(vertices[b as usize] - origin)).sum::<f64>() * 0.5
}

/// The edges of a polygon, each as its two corners.
pub(super) fn edges(polygon: &[u32]) -> impl Iterator<Item = (u32, u32)> + '_ {
    (0..polygon.len()).map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]))
}

/// Counter-clockwise with no reflex corner beyond the border tolerance.
fn is_convex(vertices: &[Vec2], polygon: &[u32]) -> bool {
    edges(polygon).all(|(a, b)| {
        let from = vertices[a as usize];
        let along = (vertices[b as usize] - from).normalized();
        polygon.iter().all(|corner| along.cross(vertices[*corner as usize] - from) >= -BORDER_TOLERANCE_M)
    })
}

fn resolve_t_junctions(vertices: &[Vec2], polygons: &mut [Vec<u32>]) {
    let neighbours = neighbours_of(polygons);
    let mut loose_corners: Vec<u32> = polygons
        .iter()
        .zip(&neighbours)
        .flat_map(|(polygon, beyond)| edges(polygon).zip(beyond).filter(|(_, beyond)| **beyond == WALL))
        .flat_map(|((a, b), _)| [a, b])
        .collect();
    loose_corners.sort_unstable();
    loose_corners.dedup();
    let boxes: Vec<Bounds> = loose_corners.iter().map(|c| Bounds::of([vertices[*c as usize]])).collect();
    let extent = Bounds::of(loose_corners.iter().map(|c| vertices[*c as usize])).grown(1.0);
    let grid = BinGrid::new(extent, &boxes, |_, _| true);

    for (polygon, beyond) in polygons.iter_mut().zip(&neighbours) {
        let mut completed = Vec::with_capacity(polygon.len());
        for ((a, b), beyond) in edges(polygon).zip(beyond) {
            completed.push(a);
            if *beyond == WALL {
                completed.extend(corners_between(vertices, a, b, &grid, &loose_corners));
            }
        }
        *polygon = completed;
    }
}

/// The corners that lie on the edge from `a` to `b`, strictly between its ends, in order.
fn corners_between(vertices: &[Vec2], a: u32, b: u32, grid: &BinGrid, corners: &[u32]) -> Vec<u32> {
    // Boxes of this size along the edge keep an oblique edge from asking for the whole square it spans.
    const STRIDE_M: f64 = 8.0;
    let (from, to) = (vertices[a as usize], vertices[b as usize]);
    let length_m = from.distance(to);
    let along = (to - from).normalized();
    let mut found = Vec::new();
    let pieces = (length_m / STRIDE_M).ceil().max(1.0) as usize;
    for piece in 0..pieces {
        let ends = [piece, piece + 1].map(|i| from.lerp(to, i as f64 / pieces as f64));
        grid.visit_box(Bounds::of(ends).grown(BORDER_TOLERANCE_M), |item| {
            let corner = corners[item as usize];
            let offset = vertices[corner as usize] - from;
            let (ahead_m, aside_m) = (along.dot(offset), along.cross(offset));
            if ahead_m > BORDER_TOLERANCE_M && ahead_m < length_m - BORDER_TOLERANCE_M && aside_m.abs() <= 1.0e-7 {
                found.push((ahead_m, corner));
            }
        });
    }
    found.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
    found.dedup_by_key(|(_, corner)| *corner);
    found.into_iter().map(|(_, corner)| corner).collect()
}

fn neighbours_of(polygons: &[Vec<u32>]) -> Vec<Vec<u32>> {
    let mut owners: HashMap<(u32, u32), u32> = HashMap::new();
    for (number, polygon) in polygons.iter().enumerate() {
        owners.extend(edges(polygon).map(|edge| (edge, number as u32)));
    }
    polygons
        .iter()
        .map(|polygon| edges(polygon).map(|(a, b)| owners.get(&(b, a)).copied().unwrap_or(WALL)).collect())
        .collect()
}

fn components_of(neighbours: &[Vec<u32>]) -> Vec<u32> {
    let mut components = vec![WALL; neighbours.len()];
    let mut next = 0;
    for seed in 0..neighbours.len() {
        if components[seed] != WALL {
            continue;
        }
        let mut open = vec![seed as u32];
        components[seed] = next;
        while let Some(polygon) = open.pop() {
            for beyond in neighbours[polygon as usize].iter().filter(|beyond| **beyond != WALL) {
                if components[*beyond as usize] == WALL {
                    components[*beyond as usize] = next;
                    open.push(*beyond);
                }
            }
        }
        next += 1;
    }
    components
}
