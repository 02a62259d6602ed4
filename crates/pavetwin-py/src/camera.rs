//! `NadirCamera` and `Viewpoint`: what the UAV sees the ground with, and from where.

use crate::plain;
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{self as core, AcrossRule, WindowRule};
use pyo3::prelude::*;

#[pyclass(frozen, eq, module = "pavetwin._core")]
#[derive(Clone, PartialEq)]
pub struct NadirCamera(pub core::NadirCamera);

#[pymethods]
impl NadirCamera {
    #[new]
    #[pyo3(signature = (
        *, image_px, vertical_fov_rad, window_rows, window_columns = None, window_across_per_altitude = None
    ))]
    fn new(
        image_px: (u32, u32),
        vertical_fov_rad: f64,
        window_rows: f64,
        window_columns: Option<f64>,
        window_across_per_altitude: Option<f64>,
    ) -> PyResult<Self> {
        let across = match (window_columns, window_across_per_altitude) {
            (Some(share), None) => AcrossRule::Columns(share),
            (None, Some(factor)) => AcrossRule::PerAltitude(factor),
            _ => return Err(plain("give exactly one of window_columns and window_across_per_altitude")),
        };
        let window = WindowRule { rows_share: window_rows, across };
        core::NadirCamera::new(image_px.0, image_px.1, vertical_fov_rad, window).map(Self).map_err(plain)
    }

    #[getter]
    fn image_px(&self) -> (u32, u32) {
        (self.0.image_width_px(), self.0.image_height_px())
    }

    #[getter]
    fn vertical_fov_rad(&self) -> f64 {
        self.0.vertical_fov_rad()
    }

    #[getter]
    fn window_rows(&self) -> f64 {
        self.0.window_rule().rows_share
    }

    #[getter]
    fn window_columns(&self) -> Option<f64> {
        if let AcrossRule::Columns(share) = self.0.window_rule().across { Some(share) } else { None }
    }

    #[getter]
    fn window_across_per_altitude(&self) -> Option<f64> {
        if let AcrossRule::PerAltitude(factor) = self.0.window_rule().across { Some(factor) } else { None }
    }

    fn window_m(&self, altitude_m: f64) -> (f64, f64) {
        let window = self.0.window(altitude_m);
        (2.0 * window.half_across_m, 2.0 * window.half_along_m)
    }

    pub fn __repr__(&self) -> String {
        let width = match self.0.window_rule().across {
            AcrossRule::Columns(share) => format!("window_columns={share}"),
            AcrossRule::PerAltitude(factor) => format!("window_across_per_altitude={factor}"),
        };
        format!(
            "NadirCamera(image_px={:?}, vertical_fov_rad={}, window_rows={}, {width})",
            self.image_px(),
            self.vertical_fov_rad(),
            self.window_rows(),
        )
    }
}

#[pyclass(frozen, eq, module = "pavetwin._core")]
#[derive(Clone, PartialEq)]
pub struct Viewpoint(pub core::Viewpoint);

#[pymethods]
impl Viewpoint {
    #[new]
    #[pyo3(signature = (*, position, altitude_m, yaw_rad))]
    fn new(position: (f64, f64), altitude_m: f64, yaw_rad: f64) -> PyResult<Self> {
        let viewpoint = core::Viewpoint { position: Vec2::new(position.0, position.1), altitude_m, yaw_rad };
        viewpoint.check().map_err(plain)?;
        Ok(Self(viewpoint))
    }

    #[getter]
    fn position(&self) -> (f64, f64) {
        (self.0.position.x, self.0.position.y)
    }

    #[getter]
    fn altitude_m(&self) -> f64 {
        self.0.altitude_m
    }

    #[getter]
    fn yaw_rad(&self) -> f64 {
        self.0.yaw_rad
    }

    pub fn __repr__(&self) -> String {
        let core::Viewpoint { position, altitude_m, yaw_rad } = self.0;
        format!("Viewpoint(position=({}, {}), altitude_m={altitude_m}, yaw_rad={yaw_rad})", position.x, position.y)
    }
}
