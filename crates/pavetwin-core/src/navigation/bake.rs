//! Baking: from the triangles of the flight domain to the navigation mesh, tile by tile through Recast.
//!
//! Recast's own limits (65,535 corners a mesh, contours of 40,000 steps) and its memory (a voxel for every 0.06 m² of
//! the city's box, street or not) would end at a few square kilometres. So the plane is cut into square tiles, only
//! those that hold some of the domain are baked, and the seams are joined corner for corner.

use std::collections::{BTreeMap, HashMap};

use super::bake_config::BakeConfig;
use super::error::NavMeshError;
use super::grid::Bounds;
use super::mesh::NavMesh;
use super::tile::{self, GridPoint, TILE_VOXELS};
use crate::geometry::Vec2;

/// Voxels along one axis; Recast numbers them with 16 bits, and the path search's single precision stays below a
/// millimetre over this extent.
const MOST_VOXELS: u64 = u16::MAX as u64;

impl NavMesh {
    /// Bakes the flat flight domain at one altitude, given as triangles of any winding (overlaps do no harm).
    ///
    /// A voxel counts as free when its centre lies in the domain. Recast then narrows the free area by the agent's
    /// radius, traces its contours, straightens them and cuts them into convex polygons. Half a voxel's diagonal of
    /// rounding and the edge error eat into the radius: with voxels of 0.25 m and a radius of 0.5 m the mesh may at
    /// worst come 0.05 m out of the domain, a fifth of a voxel.
    ///
    /// # Errors
    /// [`NavMeshError::Empty`], [`NavMeshError::NotFinite`], [`NavMeshError::UnknownVertex`],
    /// [`NavMeshError::BadConfig`], [`NavMeshError::TooLarge`], [`NavMeshError::NothingLeft`],
    /// and [`NavMeshError::Recast`].
    pub fn bake(vertices: &[Vec2], triangles: &[[u32; 3]], config: &BakeConfig) -> Result<Self, NavMeshError> {
        config.check()?;
        let corners = corners_of(vertices, triangles)?;
        let bounds = Bounds::of(corners.iter().flatten().copied());
        let (cell, extent) = (config.cell_size_m, bounds.max - bounds.min);
        let voxels = (extent.x.max(extent.y) / cell).ceil() as u64 + 2;
        if voxels > MOST_VOXELS {
            let extent_m = extent.x.max(extent.y);
            return Err(NavMeshError::TooLarge { extent_m, voxels, cell_size_m: cell, most: MOST_VOXELS });
        }
        // Voxels lie on whole multiples of their size, so that the same street bakes alike in a larger city.
        let origin = Vec2::new((bounds.min.x / cell).floor(), (bounds.min.y / cell).floor());
        let corners: Vec<[Vec2; 3]> =
            corners.into_iter().map(|triangle| triangle.map(|corner| corner * (1.0 / cell) - origin)).collect();

        let mut pool = Pool::default();
        for (tile, triangles) in tiles_of(&corners, tile::margin_voxels(config)) {
            let polygons = tile::bake(tile, triangles.iter().map(|i| &corners[*i]), config).map_err(|reason| {
                let centre = (origin + Vec2::new(tile.0 as f64 + 0.5, tile.1 as f64 + 0.5) * TILE_VOXELS as f64) * cell;
                NavMeshError::Recast { x: centre.x, y: centre.y, reason }
            })?;
            polygons.into_iter().for_each(|polygon| pool.add(&polygon));
        }
        if pool.polygons.is_empty() {
            return Err(NavMeshError::NothingLeft { agent_radius_m: config.agent_radius_m });
        }
        let to_world = |point: &GridPoint| (origin + Vec2::new(point.0.into(), point.1.into())) * cell;
        let vertices: Vec<Vec2> = pool.points.iter().map(to_world).collect();
        Self::from_polygons(&vertices, &pool.polygons)
    }
}

fn corners_of(vertices: &[Vec2], triangles: &[[u32; 3]]) -> Result<Vec<[Vec2; 3]>, NavMeshError> {
    let mut corners = Vec::with_capacity(triangles.len());
    for (polygon, triangle) in triangles.iter().enumerate() {
        let mut places = [Vec2::ZERO; 3];
        for (place, vertex) in places.iter_mut().zip(triangle) {
            let count = vertices.len();
            *place = *vertices.get(*vertex as usize).ok_or(NavMeshError::UnknownVertex {
                polygon,
                vertex: *vertex,
                count,
            })?;
            if !(place.x.is_finite() && place.y.is_finite()) {
                return Err(NavMeshError::NotFinite { vertex: *vertex as usize });
            }
        }
        if (places[1] - places[0]).cross(places[2] - places[0]) != 0.0 {
            corners.push(places);
        }
    }
    if corners.is_empty() { Err(NavMeshError::Empty) } else { Ok(corners) }
}

/// For each tile, the triangles whose box reaches into it or into its margin. Sorted, so that results repeat.
fn tiles_of(triangles: &[[Vec2; 3]], margin: u16) -> BTreeMap<(i32, i32), Vec<usize>> {
    let mut tiles: BTreeMap<(i32, i32), Vec<usize>> = BTreeMap::new();
    let tile_of = |voxel: f64| (voxel / TILE_VOXELS as f64).floor() as i32;
    for (number, triangle) in triangles.iter().enumerate() {
        let bounds = Bounds::of(*triangle).grown(f64::from(margin) + 1.0);
        for row in tile_of(bounds.min.y)..=tile_of(bounds.max.y) {
            for column in tile_of(bounds.min.x)..=tile_of(bounds.max.x) {
                tiles.entry((column, row)).or_default().push(number);
            }
        }
    }
    tiles
}

/// Polygons of all tiles with their corners joined.
#[derive(Debug, Default)]
struct Pool {
    numbers: HashMap<GridPoint, u32>,
    points: Vec<GridPoint>,
    polygons: Vec<Vec<u32>>,
}

impl Pool {
    fn add(&mut self, polygon: &[GridPoint]) {
        let corners = polygon.iter().map(|point| {
            *self.numbers.entry(*point).or_insert_with(|| {
                self.points.push(*point);
                (self.points.len() - 1) as u32
            })
        });
        self.polygons.push(corners.collect());
    }
}
