//! `Ground`: what stands still at one altitude, shared by missions.

use crate::arrays::{points, ragged, to_array};
use crate::navmesh::NavMesh;
use crate::plain;
use crate::trace::Trace;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::mission as core;
use pavetwin_core::sensing::{AcrossRule, Camera, Observer, Prism, Scene, Solids, SurfaceGrid, Viewpoint, WindowRule};
use pyo3::prelude::*;
use pyo3::types::PyDict;
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

    fn cell_count(&self, segment: u32) -> PyResult<usize> {
        Ok(self.surface(segment)?.grid.cell_count())
    }

    #[pyo3(signature = (segment, trace, time_s, *, position, altitude_m, yaw_rad, image_px, vertical_fov_rad, window_rows, window_columns, window_across_per_altitude))]
    #[allow(clippy::too_many_arguments)] // a camera and where it is, each by name
    fn observe<'py>(
        &self,
        py: Python<'py>,
        segment: u32,
        trace: &Trace,
        time_s: f64,
        position: (f64, f64),
        altitude_m: f64,
        yaw_rad: f64,
        image_px: (u32, u32),
        vertical_fov_rad: f64,
        window_rows: f64,
        window_columns: Option<f64>,
        window_across_per_altitude: Option<f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let camera = camera(image_px, vertical_fov_rad, window_rows, window_columns, window_across_per_altitude)?;
        let viewpoint = Viewpoint { position: Vec2::new(position.0, position.1), altitude_m, yaw_rad };
        let grid = &self.surface(segment)?.grid;
        let scene = Scene { grid, solids: &self.0.solids, trace: &trace.0 };
        let mut observer = Observer::new();
        let look = observer.observe(&scene, &camera, &viewpoint, time_s).map_err(plain)?;
        let columns = PyDict::new(py);
        columns.set_item("visibility", look.has_candidates.then_some(look.share))?;
        columns.set_item("hidden_place", look.hidden_centroid.map(|place| (place.x, place.y)))?;
        columns.set_item("candidates", to_array(py, &observer.candidates().centres().collect::<Vec<_>>())?)?;
        columns.set_item("visible", to_array(py, &observer.visible().centres().collect::<Vec<_>>())?)?;
        Ok(columns)
    }
}

impl Ground {
    fn surface(&self, segment: u32) -> PyResult<&core::SegmentSurface> {
        let segments = &self.0.segments;
        let missing = || plain(format!("there is no segment {segment}; the ground has {}", segments.len()));
        segments.get(segment as usize).ok_or_else(missing)
    }
}

/// A camera of the core from the numbers that Python gives.
pub fn camera(
    image_px: (u32, u32),
    vertical_fov_rad: f64,
    window_rows: f64,
    window_columns: Option<f64>,
    window_across_per_altitude: Option<f64>,
) -> PyResult<Camera> {
    let across = match (window_columns, window_across_per_altitude) {
        (Some(share), None) => AcrossRule::Columns(share),
        (None, Some(factor)) => AcrossRule::PerAltitude(factor),
        _ => return Err(plain("give exactly one of window_columns and window_across_per_altitude")),
    };
    let window = WindowRule { rows_share: window_rows, across };
    Camera::new(image_px.0, image_px.1, vertical_fov_rad, window).map_err(plain)
}
