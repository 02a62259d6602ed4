//! `Ground`: what stands still at one altitude, shared by missions.

use crate::arrays::{points, ragged, to_array};
use crate::camera::{NadirCamera, Viewpoint};
use crate::navmesh::NavMesh;
use crate::plain;
use crate::trace::Trace;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::mission as core;
use pavetwin_core::sensing::{self as core_sensing, Observer, Prism, Reach, Scene, Solids, SurfaceGrid};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// Asks Python for the points of a defect when its segment is first inspected.
#[derive(Clone)]
pub struct DefectSampler {
    ground: Arc<core::Ground>,
    points_of: Arc<Py<PyAny>>,
}

impl DefectSampler {
    /// Samples the defects of a segment; none where there is no such segment.
    pub fn sample_segment(&self, py: Python<'_>, segment: u32) -> PyResult<()> {
        let defects = self.ground.segments.get(segment as usize).map_or(&[][..], |surface| &surface.defects);
        defects.iter().try_for_each(|&defect| self.sample(py, defect).map(|_| ()))
    }

    fn sample(&self, py: Python<'_>, defect: u32) -> PyResult<&[Vec2]> {
        let sample = || {
            let array = self.points_of.call1(py, (defect,)).map_err(Failure::Python)?;
            let array = array.extract::<PyReadonlyArray2<'_, f64>>(py).map_err(Failure::Python)?;
            points(&array).map_err(Failure::Python)
        };
        self.ground.sample(defect, sample).map_err(Failure::into_python)
    }
}

/// Why a defect has no points.
enum Failure {
    Python(PyErr),
    Ground(core::GroundError),
}

impl From<core::GroundError> for Failure {
    fn from(error: core::GroundError) -> Self {
        Self::Ground(error)
    }
}

impl Failure {
    fn into_python(self) -> PyErr {
        match self {
            Self::Python(error) => error,
            Self::Ground(error) => plain(error),
        }
    }
}

#[pyclass(frozen, module = "pavetwin._core")]
pub struct Ground(pub Arc<core::Ground>, pub DefectSampler);

#[pymethods]
impl Ground {
    #[new]
    #[pyo3(signature = (
        mesh, *, cell_m, surface_rings, solid_offsets, solid_xy, solid_z0, solid_z1, solid_is_parked, defect_centres,
        defect_segments, defect_points
    ))]
    #[allow(clippy::too_many_arguments)] // ragged arrays, each by name
    fn new(
        mesh: &NavMesh,
        cell_m: f64,
        surface_rings: Vec<Vec<PyReadonlyArray2<'_, f64>>>,
        solid_offsets: PyReadonlyArray1<'_, u32>,
        solid_xy: PyReadonlyArray2<'_, f64>,
        solid_z0: PyReadonlyArray1<'_, f64>,
        solid_z1: PyReadonlyArray1<'_, f64>,
        solid_is_parked: PyReadonlyArray1<'_, bool>,
        defect_centres: PyReadonlyArray2<'_, f64>,
        defect_segments: PyReadonlyArray1<'_, u32>,
        defect_points: Py<PyAny>,
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
        let (mut fixed, mut parked) = (Vec::new(), Vec::new());
        for (prism, &is_parked) in prisms.map_err(plain)?.into_iter().zip(solid_is_parked.as_slice()?) {
            if is_parked { &mut parked } else { &mut fixed }.push(prism);
        }
        let solids = Solids::new(fixed).with_parked(parked);
        let defects = points(&defect_centres)?.into_iter().map(core::DefectTarget::at).collect();
        let ground = core::Ground::new(mesh.0.clone(), solids, grids, defects, defect_segments.as_slice()?);
        let ground = Arc::new(ground.map_err(plain)?);
        Ok(Self(ground.clone(), DefectSampler { ground, points_of: Arc::new(defect_points) }))
    }

    fn observe<'py>(
        &self,
        py: Python<'py>,
        segment: u32,
        trace: &Trace,
        time_s: f64,
        camera: &NadirCamera,
        viewpoint: &Viewpoint,
    ) -> PyResult<Bound<'py, PyDict>> {
        let grid = &self.surface(segment)?.grid;
        let scene = Scene { grid, solids: &self.0.solids, trace: &trace.0 };
        let mut observer = Observer::new();
        let look = observer.observe(&scene, &camera.0, &viewpoint.0, time_s).map_err(plain)?;
        let columns = PyDict::new(py);
        columns.set_item("visibility", look.has_candidates.then_some(look.share))?;
        columns.set_item("hidden_place", look.hidden_centroid.map(|place| (place.x, place.y)))?;
        columns.set_item("permanently_hidden", look.permanently_hidden())?;
        columns.set_item("candidates", to_array(py, &observer.candidates().centres().collect::<Vec<_>>())?)?;
        columns.set_item("visible", to_array(py, &observer.visible().centres().collect::<Vec<_>>())?)?;
        Ok(columns)
    }

    /// What the windows of several viewpoints, all at one altitude, show together without traffic.
    fn reach<'py>(
        &self,
        py: Python<'py>,
        segment: u32,
        camera: &NadirCamera,
        altitude_m: f64,
        places: PyReadonlyArray2<'_, f64>,
        yaws_rad: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let grid = &self.surface(segment)?.grid;
        let viewpoint = |(position, &yaw_rad): (Vec2, &f64)| core_sensing::Viewpoint { position, altitude_m, yaw_rad };
        let viewpoints: Vec<_> = points(&places)?.into_iter().zip(yaws_rad.as_slice()?).map(viewpoint).collect();
        let reach = Reach::of(grid, &self.0.solids, &camera.0, &viewpoints).map_err(plain)?;
        let columns = PyDict::new(py);
        columns.set_item("cells", grid.cell_count())?;
        columns.set_item("visible", reach.visible().count())?;
        columns.set_item("permanently_hidden", reach.permanently_hidden().count())?;
        Ok(columns)
    }

    fn defect_shares<'py>(
        &self,
        py: Python<'py>,
        defect: u32,
        trace: &Trace,
        time_s: f64,
        viewpoint: &Viewpoint,
    ) -> PyResult<Bound<'py, PyDict>> {
        let count = self.0.defects.len();
        if defect as usize >= count {
            return Err(plain(format!("there is no defect {defect}; the ground has {count}")));
        }
        let points = self.1.sample(py, defect)?;
        let shares = Observer::new().point_shares(&self.0.solids, &trace.0, &viewpoint.0, time_s, points);
        let shares = shares.map_err(plain)?.expect("a ground has no defect without points");
        let columns = PyDict::new(py);
        columns.set_item("visible", shares.visible)?;
        columns.set_item("behind_solids", shares.behind_solids)?;
        columns.set_item("behind_parked", shares.behind_parked)?;
        columns.set_item("behind_vehicles", shares.behind_vehicles)?;
        columns.set_item("behind_pedestrians", shares.behind_pedestrians)?;
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
