//! `NavMesh`: where the UAV may fly at one altitude.

use crate::arrays::{points, to_array};
use crate::plain;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::navigation as core;
use pyo3::prelude::*;

#[pyclass(frozen, module = "pavetwin._core")]
pub struct NavMesh(pub core::NavMesh);

#[pymethods]
impl NavMesh {
    #[staticmethod]
    #[pyo3(signature = (vertices, triangles, *, cell_size_m, agent_radius_m))]
    fn bake(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f64>,
        triangles: PyReadonlyArray2<'_, u32>,
        cell_size_m: f64,
        agent_radius_m: f64,
    ) -> PyResult<Self> {
        let corners = points(&vertices)?;
        let triangles: Vec<[u32; 3]> =
            triangles.as_array().rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect();
        let config = core::BakeConfig::new(cell_size_m, agent_radius_m);
        py.detach(|| core::NavMesh::bake(&corners, &triangles, &config)).map(Self).map_err(plain)
    }

    #[staticmethod]
    fn from_polygons(
        vertices: PyReadonlyArray2<'_, f64>,
        offsets: PyReadonlyArray1<'_, u32>,
        corners: PyReadonlyArray1<'_, u32>,
    ) -> PyResult<Self> {
        let corners = corners.as_slice()?;
        let cut = |pair: &[u32]| corners.get(pair[0] as usize..pair[1] as usize).map(<[u32]>::to_vec);
        let polygons: Option<Vec<_>> = offsets.as_slice()?.windows(2).map(cut).collect();
        let polygons = polygons.ok_or_else(|| plain("offsets must rise and end at the number of corners"))?;
        core::NavMesh::from_polygons(&points(&vertices)?, &polygons).map(Self).map_err(plain)
    }

    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, self.0.vertices())
    }

    fn offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let mut offsets = vec![0u32];
        for polygon in self.0.polygons() {
            offsets.push(offsets[offsets.len() - 1] + polygon.len() as u32);
        }
        offsets.to_pyarray(py)
    }

    fn corners<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        self.0.polygons().iter().flatten().copied().collect::<Vec<u32>>().to_pyarray(py)
    }

    fn area_m2(&self) -> f64 {
        self.0.area_m2()
    }

    fn contains(&self, east_m: f64, north_m: f64) -> bool {
        self.0.contains(Vec2::new(east_m, north_m))
    }

    fn nearest(&self, east_m: f64, north_m: f64) -> (f64, f64) {
        let point = self.0.nearest(Vec2::new(east_m, north_m));
        (point.x, point.y)
    }

    fn component_of(&self, east_m: f64, north_m: f64) -> Option<u32> {
        self.0.component_of(Vec2::new(east_m, north_m))
    }

    fn path<'py>(&self, py: Python<'py>, start: (f64, f64), goal: (f64, f64)) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let way = self.0.path(Vec2::new(start.0, start.1), Vec2::new(goal.0, goal.1)).map_err(plain)?;
        to_array(py, &way)
    }
}
