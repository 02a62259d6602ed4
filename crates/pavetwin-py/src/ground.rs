//! `Ground`: what stands still at one altitude, shared by missions.

use crate::arrays::{points, ragged};
use crate::navmesh::NavMesh;
use crate::plain;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::mission as core;
use pavetwin_core::sensing::{Prism, Solids, SurfaceGrid};
use pyo3::prelude::*;
use std::sync::Arc;

#[pyclass(frozen, module = "pavetwin._core")]
pub struct Ground(pub Arc<core::Ground>);

#[pymethods]
impl Ground {
    #[new]
    #[pyo3(signature = (mesh, *, cell_m, surface_rings, solid_offsets, solid_xy, solid_z0, solid_z1, defect_centres, defect_offsets, defect_points, defect_segments))]
    #[allow(clippy::too_many_arguments)] // ragged arrays, each by name
    fn new(
        mesh: &NavMesh,
        cell_m: f64,
        surface_rings: Vec<Vec<PyReadonlyArray2<'_, f64>>>,
        solid_offsets: PyReadonlyArray1<'_, u32>,
        solid_xy: PyReadonlyArray2<'_, f64>,
        solid_z0: PyReadonlyArray1<'_, f64>,
        solid_z1: PyReadonlyArray1<'_, f64>,
        defect_centres: PyReadonlyArray2<'_, f64>,
        defect_offsets: PyReadonlyArray1<'_, u32>,
        defect_points: PyReadonlyArray2<'_, f64>,
        defect_segments: PyReadonlyArray1<'_, u32>,
    ) -> PyResult<Self> {
        let mut grids = Vec::with_capacity(surface_rings.len());
        for rings in &surface_rings {
            let rings: Vec<Vec<Vec2>> = rings.iter().map(points).collect::<PyResult<_>>()?;
            grids.push(SurfaceGrid::from_rings(&rings, cell_m).map_err(plain)?);
        }
        let bases = ragged(&solid_offsets, &points(&solid_xy)?)?;
        let heights = solid_z0.as_slice()?.iter().zip(solid_z1.as_slice()?);
        let prisms: Result<Vec<_>, _> =
            bases.into_iter().zip(heights).map(|(base, (z0, z1))| Prism::new(base, *z0, *z1)).collect();
        let solids = Solids::new(prisms.map_err(plain)?);
        let samples = ragged(&defect_offsets, &points(&defect_points)?)?;
        let centres = points(&defect_centres)?;
        let defects = centres.into_iter().zip(samples);
        let defects = defects.map(|(centre, points)| core::DefectTarget { centre, points }).collect();
        let ground = core::Ground::new(mesh.0.clone(), solids, grids, defects, defect_segments.as_slice()?);
        ground.map(|ground| Self(Arc::new(ground))).map_err(plain)
    }

    fn cell_count(&self, segment: usize) -> usize {
        self.0.segments[segment].grid.cell_count()
    }
}
