//! `Trace`: the recorded traffic.

use crate::plain;
use numpy::{PyArray1, PyReadonlyArray1, ToPyArray};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{
    self as core, AgentPose, Body, BodyClass, KeyFrames, ReaderError, Stretch, TraceColumns, TraceError,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

#[pyclass(frozen, module = "pavetwin._core")]
pub struct Trace(pub Arc<core::Trace>);

#[pymethods]
impl Trace {
    #[new]
    #[pyo3(signature = (
        *, step_s, step_offsets, agent, x_m, y_m, yaw_rad, speed_mps, length_m, width_m, height_m, base_m,
        is_pedestrian
    ))]
    #[allow(clippy::too_many_arguments)] // the columns of a recording, each by name
    fn new(
        py: Python<'_>,
        step_s: f64,
        step_offsets: PyReadonlyArray1<'_, u32>,
        agent: PyReadonlyArray1<'_, u32>,
        x_m: PyReadonlyArray1<'_, f32>,
        y_m: PyReadonlyArray1<'_, f32>,
        yaw_rad: PyReadonlyArray1<'_, f32>,
        speed_mps: PyReadonlyArray1<'_, f32>,
        length_m: PyReadonlyArray1<'_, f32>,
        width_m: PyReadonlyArray1<'_, f32>,
        height_m: PyReadonlyArray1<'_, f32>,
        base_m: PyReadonlyArray1<'_, f32>,
        is_pedestrian: PyReadonlyArray1<'_, bool>,
    ) -> PyResult<Self> {
        let columns = TraceColumns {
            step_s,
            step_offsets: step_offsets.as_slice()?.to_vec(),
            agent: agent.as_slice()?.to_vec(),
            x_m: wide(&x_m)?,
            y_m: wide(&y_m)?,
            yaw_rad: yaw_rad.as_slice()?.to_vec(),
            speed_mps: speed_mps.as_slice()?.to_vec(),
            bodies: bodies(&length_m, &width_m, &height_m, &base_m, &is_pedestrian)?,
        };
        py.detach(|| core::Trace::new(columns)).map(|trace| Self(Arc::new(trace))).map_err(plain)
    }

    #[staticmethod]
    #[pyo3(signature = (
        read, *, step_s, first_step, step_count, starts, max_speed_mps, length_m, width_m, height_m, base_m,
        is_pedestrian, known=None, held_rows=None
    ))]
    #[allow(clippy::too_many_arguments)] // what a recording is beside its parts, each by name
    fn of_parts(
        read: Py<PyAny>,
        step_s: f64,
        first_step: usize,
        step_count: usize,
        starts: Vec<usize>,
        max_speed_mps: f64,
        length_m: PyReadonlyArray1<'_, f32>,
        width_m: PyReadonlyArray1<'_, f32>,
        height_m: PyReadonlyArray1<'_, f32>,
        base_m: PyReadonlyArray1<'_, f32>,
        is_pedestrian: PyReadonlyArray1<'_, bool>,
        known: Option<&Self>,
        held_rows: Option<usize>,
    ) -> PyResult<Self> {
        let held_rows = held_rows.unwrap_or(core::HELD_ROWS);
        let bodies = bodies(&length_m, &width_m, &height_m, &base_m, &is_pedestrian)?;
        let agents = bodies.len();
        let read: core::ReadPart =
            Box::new(move |part| Python::attach(|py| stretch(read.bind(py), part, agents, step_s)));
        let parts = core::TraceParts { step_s, first_step, step_count, starts, read, bodies, max_speed_mps, held_rows };
        let made = match known {
            Some(known) => core::Trace::going_on(&known.0, parts),
            None => core::Trace::of_parts(parts),
        };
        made.map(|trace| Self(Arc::new(trace))).map_err(plain)
    }

    #[getter]
    fn duration_s(&self) -> f64 {
        self.0.duration_s()
    }

    fn agents_at<'py>(&self, py: Python<'py>, time_s: f64) -> PyResult<Bound<'py, PyDict>> {
        pose_columns(py, &self.0.agents_at(time_s).map_err(plain)?)
    }

    fn agents_near<'py>(
        &self,
        py: Python<'py>,
        east_m: f64,
        north_m: f64,
        radius_m: f64,
        time_s: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut poses = Vec::new();
        let centre = Vec2::new(east_m, north_m);
        self.0.agents_near(centre, radius_m, time_s, &mut |pose| poses.push(pose)).map_err(plain)?;
        poses.sort_by_key(|pose| pose.agent);
        pose_columns(py, &poses)
    }
}

fn wide(array: &PyReadonlyArray1<'_, f32>) -> PyResult<Vec<f64>> {
    Ok(array.as_slice()?.iter().map(|value| f64::from(*value)).collect())
}

fn bodies(
    length_m: &PyReadonlyArray1<'_, f32>,
    width_m: &PyReadonlyArray1<'_, f32>,
    height_m: &PyReadonlyArray1<'_, f32>,
    base_m: &PyReadonlyArray1<'_, f32>,
    is_pedestrian: &PyReadonlyArray1<'_, bool>,
) -> PyResult<Vec<Body>> {
    let (length_m, width_m, height_m, base_m) = (wide(length_m)?, wide(width_m)?, wide(height_m)?, wide(base_m)?);
    let class_of = |is_pedestrian: &bool| if *is_pedestrian { BodyClass::Pedestrian } else { BodyClass::Vehicle };
    let body = |(agent, is_pedestrian): (usize, &bool)| Body {
        class: class_of(is_pedestrian),
        length_m: length_m[agent],
        width_m: width_m[agent],
        height_m: height_m[agent],
        base_m: base_m[agent],
    };
    Ok(is_pedestrian.as_slice()?.iter().enumerate().map(body).collect())
}

/// What `read` gives for a part: a dictionary of the fields of `KeyFrames`.
fn stretch(read: &Bound<'_, PyAny>, part: usize, agents: usize, step_s: f64) -> Result<Stretch, TraceError> {
    let made = || -> PyResult<Result<Stretch, TraceError>> {
        let fields = read.call1((part,))?;
        let step = |name: &str| fields.get_item(name)?.extract::<u32>();
        let counts = |name: &str| fields.get_item(name)?.extract::<PyReadonlyArray1<'_, u32>>();
        let values = |name: &str| fields.get_item(name)?.extract::<PyReadonlyArray1<'_, f32>>();
        let (agent, steps) = (counts("agent")?, counts("step")?);
        let (x_m, y_m) = (values("x_m")?, values("y_m")?);
        let (yaw_rad, speed_mps) = (values("yaw_rad")?, values("speed_mps")?);
        let is_last = fields.get_item("is_last")?.extract::<PyReadonlyArray1<'_, bool>>()?;
        let keys = KeyFrames {
            first_step: step("first_step")?,
            last_step: step("last_step")?,
            agent: agent.as_slice()?,
            step: steps.as_slice()?,
            x_m: x_m.as_slice()?,
            y_m: y_m.as_slice()?,
            yaw_rad: yaw_rad.as_slice()?,
            speed_mps: speed_mps.as_slice()?,
            is_last: is_last.as_slice()?,
        };
        Ok(Stretch::of_key_frames(&keys, agents, step_s))
    };
    made().unwrap_or_else(|raised| Err(ReaderError(Arc::new(raised)).into()))
}

/// Poses as one array a column.
pub fn pose_columns<'py>(py: Python<'py>, poses: &[AgentPose]) -> PyResult<Bound<'py, PyDict>> {
    let column = |value: &dyn Fn(&AgentPose) -> f64| -> Bound<'py, PyArray1<f64>> {
        poses.iter().map(value).collect::<Vec<f64>>().to_pyarray(py)
    };
    let columns = PyDict::new(py);
    columns.set_item("agent", poses.iter().map(|pose| pose.agent).collect::<Vec<u32>>().to_pyarray(py))?;
    columns.set_item("x_m", column(&|pose| pose.position.x))?;
    columns.set_item("y_m", column(&|pose| pose.position.y))?;
    columns.set_item("yaw_rad", column(&|pose| pose.yaw_rad))?;
    columns.set_item("east_mps", column(&|pose| pose.velocity.x))?;
    columns.set_item("north_mps", column(&|pose| pose.velocity.y))?;
    columns.set_item("length_m", column(&|pose| pose.body.length_m))?;
    columns.set_item("width_m", column(&|pose| pose.body.width_m))?;
    columns.set_item("height_m", column(&|pose| pose.body.height_m))?;
    let is_pedestrian: Vec<bool> = poses.iter().map(|pose| pose.body.class == BodyClass::Pedestrian).collect();
    columns.set_item("is_pedestrian", is_pedestrian.to_pyarray(py))?;
    Ok(columns)
}
