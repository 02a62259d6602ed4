//! `Trace`: the recorded traffic.

use crate::plain;
use numpy::{PyArray1, PyReadonlyArray1, ToPyArray};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{self as core, AgentPose, Body, BodyClass, TraceColumns};
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
        is_pedestrian, known=None
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
        known: Option<&Self>,
    ) -> PyResult<Self> {
        let wide = |array: &PyReadonlyArray1<'_, f32>| -> PyResult<Vec<f64>> {
            Ok(array.as_slice()?.iter().map(|value| f64::from(*value)).collect())
        };
        let (length_m, width_m, height_m, base_m) =
            (wide(&length_m)?, wide(&width_m)?, wide(&height_m)?, wide(&base_m)?);
        let class_of = |is_pedestrian: &bool| if *is_pedestrian { BodyClass::Pedestrian } else { BodyClass::Vehicle };
        let bodies = is_pedestrian.as_slice()?.iter().enumerate().map(|(agent, is_pedestrian)| Body {
            class: class_of(is_pedestrian),
            length_m: length_m[agent],
            width_m: width_m[agent],
            height_m: height_m[agent],
            base_m: base_m[agent],
        });
        let columns = TraceColumns {
            step_s,
            step_offsets: step_offsets.as_slice()?.to_vec(),
            agent: agent.as_slice()?.to_vec(),
            x_m: wide(&x_m)?,
            y_m: wide(&y_m)?,
            yaw_rad: yaw_rad.as_slice()?.to_vec(),
            speed_mps: speed_mps.as_slice()?.to_vec(),
            bodies: bodies.collect(),
        };
        let made = || match known {
            Some(known) => core::Trace::beginning_with(&known.0, columns),
            None => core::Trace::new(columns),
        };
        py.detach(made).map(|trace| Self(Arc::new(trace))).map_err(plain)
    }

    #[getter]
    fn duration_s(&self) -> f64 {
        self.0.duration_s()
    }

    fn agents_at<'py>(&self, py: Python<'py>, time_s: f64) -> PyResult<Bound<'py, PyDict>> {
        pose_columns(py, &self.0.agents_at(time_s).map_err(plain)?.collect::<Vec<_>>())
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
