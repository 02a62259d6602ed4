//! `Limits`, `Battery` and `FlightSettings`: how a mission is flown, as values that are checked when they are made.

use crate::camera::NadirCamera;
use crate::plain;
use numpy::{PyArray1, PyReadonlyArray1, ToPyArray};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::mission::{self as core, DrainCurve};
use pavetwin_core::navigation;
use pyo3::prelude::*;

#[pyclass(frozen, eq, module = "pavetwin._core")]
#[derive(Clone, PartialEq)]
pub struct Limits(navigation::Limits);

#[pymethods]
impl Limits {
    #[new]
    #[pyo3(signature = (*, speed_mps, acceleration_mps2, yaw_rate_rad_s, airspeed_mps = None, wind_mps = (0.0, 0.0)))]
    fn new(
        speed_mps: f64,
        acceleration_mps2: f64,
        yaw_rate_rad_s: f64,
        airspeed_mps: Option<f64>,
        wind_mps: (f64, f64),
    ) -> PyResult<Self> {
        let limits = navigation::Limits {
            speed_mps,
            acceleration_mps2,
            yaw_rate_rad_s,
            airspeed_mps: airspeed_mps.unwrap_or(f64::INFINITY),
            wind: Vec2::new(wind_mps.0, wind_mps.1),
        };
        limits.check().map_err(plain)?;
        Ok(Self(limits))
    }

    #[getter]
    fn speed_mps(&self) -> f64 {
        self.0.speed_mps
    }

    #[getter]
    fn acceleration_mps2(&self) -> f64 {
        self.0.acceleration_mps2
    }

    #[getter]
    fn yaw_rate_rad_s(&self) -> f64 {
        self.0.yaw_rate_rad_s
    }

    #[getter]
    fn airspeed_mps(&self) -> Option<f64> {
        Some(self.0.airspeed_mps).filter(|airspeed_mps| airspeed_mps.is_finite())
    }

    #[getter]
    fn wind_mps(&self) -> (f64, f64) {
        (self.0.wind.x, self.0.wind.y)
    }

    fn speed_towards(&self, yaw_rad: f64) -> f64 {
        self.0.speed_towards(yaw_rad)
    }

    fn __repr__(&self) -> String {
        let navigation::Limits { speed_mps, acceleration_mps2, yaw_rate_rad_s, wind, .. } = self.0;
        let airspeed_mps = self.airspeed_mps().map_or_else(|| "None".to_string(), |mps| mps.to_string());
        format!(
            "Limits(speed_mps={speed_mps}, acceleration_mps2={acceleration_mps2}, yaw_rate_rad_s={yaw_rate_rad_s}, \
             airspeed_mps={airspeed_mps}, wind_mps=({}, {}))",
            wind.x, wind.y
        )
    }
}

#[pyclass(frozen, eq, module = "pavetwin._core")]
#[derive(Clone, PartialEq)]
pub struct Battery(core::Battery);

#[pymethods]
impl Battery {
    #[new]
    #[pyo3(signature = (*, drain_per_s, lift_per_s, drain_step_mps, drain_per_m_climbed, wind_mps, reserve))]
    fn new(
        drain_per_s: PyReadonlyArray1<'_, f64>,
        lift_per_s: PyReadonlyArray1<'_, f64>,
        drain_step_mps: f64,
        drain_per_m_climbed: f64,
        wind_mps: (f64, f64),
        reserve: f64,
    ) -> PyResult<Self> {
        let drain = DrainCurve {
            per_s: drain_per_s.as_array().to_vec(),
            lift_per_s: lift_per_s.as_array().to_vec(),
            step_mps: drain_step_mps,
            per_m_climbed: drain_per_m_climbed,
            wind: Vec2::new(wind_mps.0, wind_mps.1),
        };
        let battery = core::Battery { drain, reserve };
        battery.check().map_err(plain)?;
        Ok(Self(battery))
    }

    #[pyo3(signature = (velocity_mps, *, climb_mps = 0.0, seconds = 1.0))]
    fn drained(&self, velocity_mps: (f64, f64), climb_mps: f64, seconds: f64) -> f64 {
        self.0.drain.drained(Vec2::new(velocity_mps.0, velocity_mps.1), climb_mps, seconds)
    }

    #[getter]
    fn drain_per_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.drain.per_s.to_pyarray(py)
    }

    #[getter]
    fn lift_per_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.drain.lift_per_s.to_pyarray(py)
    }

    #[getter]
    fn drain_step_mps(&self) -> f64 {
        self.0.drain.step_mps
    }

    #[getter]
    fn drain_per_m_climbed(&self) -> f64 {
        self.0.drain.per_m_climbed
    }

    #[getter]
    fn wind_mps(&self) -> (f64, f64) {
        (self.0.drain.wind.x, self.0.drain.wind.y)
    }

    #[getter]
    fn reserve(&self) -> f64 {
        self.0.reserve
    }

    fn __repr__(&self) -> String {
        let core::Battery { drain: DrainCurve { per_s, lift_per_s, step_mps, per_m_climbed, wind }, reserve } = &self.0;
        format!(
            "Battery(drain_per_s=<{} values>, lift_per_s=<{} values>, drain_step_mps={step_mps}, \
             drain_per_m_climbed={per_m_climbed}, wind_mps=({}, {}), reserve={reserve})",
            per_s.len(),
            lift_per_s.len(),
            wind.x,
            wind.y
        )
    }
}

#[pyclass(frozen, eq, module = "pavetwin._core")]
#[derive(Clone, PartialEq)]
pub struct FlightSettings(pub core::Settings);

#[pymethods]
impl FlightSettings {
    #[new]
    #[pyo3(signature = (
        *, altitude_m, time_step_s, radius_m, clearance_m, inspect, transit, stopping_distance_m, climb_speed_mps,
        camera, look_steps, capture_steps, threshold, min_visible_fraction, battery, every_capture = false
    ))]
    #[allow(clippy::too_many_arguments)] // one mission's numbers, each by name
    fn new(
        altitude_m: f64,
        time_step_s: f64,
        radius_m: f64,
        clearance_m: f64,
        inspect: &Limits,
        transit: &Limits,
        stopping_distance_m: f64,
        climb_speed_mps: f64,
        camera: &NadirCamera,
        look_steps: u32,
        capture_steps: u32,
        threshold: f64,
        min_visible_fraction: f64,
        battery: &Battery,
        every_capture: bool,
    ) -> PyResult<Self> {
        let settings = core::Settings {
            time_step_s,
            altitude_m,
            radius_m,
            clearance_m,
            inspect: inspect.0,
            transit: transit.0,
            stopping_distance_m,
            climb_speed_mps,
            camera: camera.0,
            look_steps,
            capture_steps,
            every_capture,
            threshold,
            min_visible_fraction,
            battery: battery.0.clone(),
        };
        settings.check().map_err(plain)?;
        Ok(Self(settings))
    }

    #[getter]
    fn altitude_m(&self) -> f64 {
        self.0.altitude_m
    }

    #[getter]
    fn time_step_s(&self) -> f64 {
        self.0.time_step_s
    }

    #[getter]
    fn radius_m(&self) -> f64 {
        self.0.radius_m
    }

    #[getter]
    fn clearance_m(&self) -> f64 {
        self.0.clearance_m
    }

    #[getter]
    fn inspect(&self) -> Limits {
        Limits(self.0.inspect)
    }

    #[getter]
    fn transit(&self) -> Limits {
        Limits(self.0.transit)
    }

    #[getter]
    fn stopping_distance_m(&self) -> f64 {
        self.0.stopping_distance_m
    }

    #[getter]
    fn climb_speed_mps(&self) -> f64 {
        self.0.climb_speed_mps
    }

    #[getter]
    fn camera(&self) -> NadirCamera {
        NadirCamera(self.0.camera)
    }

    #[getter]
    fn look_steps(&self) -> u32 {
        self.0.look_steps
    }

    #[getter]
    fn capture_steps(&self) -> u32 {
        self.0.capture_steps
    }

    #[getter]
    fn threshold(&self) -> f64 {
        self.0.threshold
    }

    #[getter]
    fn min_visible_fraction(&self) -> f64 {
        self.0.min_visible_fraction
    }

    #[getter]
    fn battery(&self) -> Battery {
        Battery(self.0.battery.clone())
    }

    #[getter]
    fn every_capture(&self) -> bool {
        self.0.every_capture
    }

    fn __repr__(&self) -> String {
        let settings = &self.0;
        format!(
            "FlightSettings(altitude_m={}, time_step_s={}, radius_m={}, clearance_m={}, inspect={}, transit={}, \
             stopping_distance_m={}, climb_speed_mps={}, camera={}, look_steps={}, capture_steps={}, threshold={}, \
             min_visible_fraction={}, battery={}, every_capture={})",
            settings.altitude_m,
            settings.time_step_s,
            settings.radius_m,
            settings.clearance_m,
            self.inspect().__repr__(),
            self.transit().__repr__(),
            settings.stopping_distance_m,
            settings.climb_speed_mps,
            self.camera().__repr__(),
            settings.look_steps,
            settings.capture_steps,
            settings.threshold,
            settings.min_visible_fraction,
            self.battery().__repr__(),
            if settings.every_capture { "True" } else { "False" },
        )
    }
}
