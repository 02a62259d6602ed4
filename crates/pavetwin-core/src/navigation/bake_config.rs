//! Voxel size, agent radius and edge error of a bake, and what each may be.

use super::error::NavMeshError;

/// Straightening a border moves it by at most this, in metres.
const MAX_EDGE_ERROR_M: f64 = 0.375;

/// How to bake a [`NavMesh`](super::NavMesh).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BakeConfig {
    /// Edge length of a voxel, in metres.
    pub cell_size_m: f64,
    /// The mesh keeps this distance from the border of the domain, in metres, to within a voxel.
    pub agent_radius_m: f64,
    /// Straightening a border may move it by at most this, in metres. At most the agent's radius, so that the mesh
    /// stays inside the domain.
    pub max_edge_error_m: f64,
}

impl BakeConfig {
    /// A mesh for an agent, with an edge error that suits voxels of 0.25 m: Recast's manual advises 1.1 to 1.5 voxels;
    /// at 1.5 the staircase of an oblique street becomes one edge, which takes a third of the polygons that 1.2 takes.
    pub fn new(cell_size_m: f64, agent_radius_m: f64) -> Self {
        Self { cell_size_m, agent_radius_m, max_edge_error_m: MAX_EDGE_ERROR_M.min(agent_radius_m) }
    }

    pub(super) fn check(&self) -> Result<(), NavMeshError> {
        let bad =
            |name: &str, value: f64, hint| Err(NavMeshError::BadConfig { what: format!("{name} is {value}"), hint });
        if !(self.cell_size_m.is_finite() && self.cell_size_m >= 0.01) {
            return bad("cell_size_m", self.cell_size_m, "give at least 0.01 metres");
        }
        if !(self.agent_radius_m >= 0.0 && self.agent_radius_m / self.cell_size_m <= 100.0) {
            return bad("agent_radius_m", self.agent_radius_m, "give zero or more, and at most 100 cell sizes");
        }
        if !(self.max_edge_error_m >= 0.0 && self.max_edge_error_m <= self.agent_radius_m) {
            return bad("max_edge_error_m", self.max_edge_error_m, "give a value from zero to the agent radius");
        }
        Ok(())
    }

    /// The agent's radius in whole voxels, never less than the radius.
    pub(super) fn radius_voxels(&self) -> u16 {
        (self.agent_radius_m / self.cell_size_m - 1.0e-9).ceil().max(0.0) as u16
    }
}
