//! What can be wrong with a navigation mesh or with a question put to it.

use crate::geometry::Vec2;

/// Why a mesh could not be made, or a way not be found on it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NavMeshError {
    /// Nothing to bake or to load.
    #[error("the flight domain is empty: give at least one triangle or polygon with an area")]
    Empty,
    /// A corner is NaN or infinite.
    #[error("corner {vertex} of the flight domain is not a finite number of metres: check the source geometry")]
    NotFinite { vertex: usize },
    /// A triangle or polygon names a corner that is not there.
    #[error("polygon {polygon} names corner {vertex}, but there are only {count} corners: check the index list")]
    UnknownVertex { polygon: usize, vertex: u32, count: usize },
    /// A loaded polygon has a reflex corner.
    #[error("polygon {polygon} is not convex: split it into convex parts")]
    NotConvex { polygon: usize },
    /// An option of [`BakeConfig`](super::BakeConfig) makes no sense.
    #[error("{what}: {hint}")]
    BadConfig { what: String, hint: &'static str },
    /// More voxels along one axis than Recast can number.
    #[error(
        "the flight domain is {extent_m:.0} m across, {voxels} voxels of {cell_size_m} m, and at most {most} fit: \
         use a larger cell size or a smaller area"
    )]
    TooLarge { extent_m: f64, voxels: u64, cell_size_m: f64, most: u64 },
    /// Every place is nearer to the border than the agent's radius.
    #[error(
        "no free area is left once the flight domain is narrowed by the agent radius of {agent_radius_m} m: \
         use a smaller radius, another altitude or wider corridors"
    )]
    NothingLeft { agent_radius_m: f64 },
    /// Recast could not turn a tile into polygons.
    #[error("Recast could not make polygons of the area around ({x:.1}, {y:.1}): {reason}; try another cell size")]
    Recast { x: f64, y: f64, reason: String },
    /// The start lies outside the mesh.
    #[error("the start ({x:.2}, {y:.2}) is outside the flight domain: start from the nearest point inside it")]
    StartOutside { x: f64, y: f64 },
    /// The goal lies outside the mesh.
    #[error("the goal ({x:.2}, {y:.2}) is outside the flight domain: choose the nearest point inside it")]
    GoalOutside { x: f64, y: f64 },
    /// Start and goal lie in parts of the mesh that do not touch.
    #[error(
        "no way leads from ({:.2}, {:.2}) to ({:.2}, {:.2}): they lie in separate parts of the flight domain, \
         so choose a goal in the same part or another altitude", start.x, start.y, goal.x, goal.y
    )]
    Unreachable { start: Vec2, goal: Vec2 },
    /// A straight piece that was to be flown leaves the mesh.
    #[error(
        "the straight piece from ({:.2}, {:.2}) to ({:.2}, {:.2}) leaves the flight domain: route it with `path` first",
        from.x, from.y, to.x, to.y
    )]
    LeavesMesh { from: Vec2, to: Vec2 },
}
