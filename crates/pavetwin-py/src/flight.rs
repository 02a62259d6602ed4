//! `Flight`, its events, and the prediction of visibility that a policy may ask for.

use crate::arrays::{points, to_array};
use crate::ground::{DefectSampler, Ground};
use crate::plain;
use crate::settings::FlightSettings;
use crate::trace::Trace;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2, ToPyArray};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::mission::{self as core, Event, Mode};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The command has been carried out.
#[pyclass(frozen, module = "pavetwin._core")]
pub struct Arrived {}

/// Going home now leaves just the reserve.
#[pyclass(frozen, module = "pavetwin._core")]
pub struct BatteryLow {}

/// The next step lies past the end of the recording.
#[pyclass(frozen, module = "pavetwin._core")]
pub struct RecordingEnds {}

/// The moment given to `advance` is reached; nothing else has happened.
#[pyclass(frozen, module = "pavetwin._core")]
pub struct Paused {}

/// A capture, and the wanted defects that it shows.
#[pyclass(frozen, get_all, module = "pavetwin._core")]
pub struct Captured {
    number: u32,
    time_s: f64,
    position: (f64, f64),
    altitude_m: f64,
    yaw_rad: f64,
    velocity_mps: (f64, f64),
    segment: u32,
    on_revisit: bool,
    visibility: Option<f64>,
    /// (defect, visible fraction)
    sightings: Vec<(u32, f64)>,
}

/// A look that fell below the threshold.
#[pyclass(frozen, get_all, module = "pavetwin._core")]
pub struct Occluded {
    time_s: f64,
    visibility: f64,
    hidden_place: Option<(f64, f64)>,
    permanently_hidden: f64,
    since_s: f64,
    waited_s: f64,
    displacements: u32,
    since_displacement_m: f64,
}

fn event_object(py: Python<'_>, event: Event) -> PyResult<Py<PyAny>> {
    let object = match event {
        Event::Arrived => Py::new(py, Arrived {})?.into_any(),
        Event::Paused => Py::new(py, Paused {})?.into_any(),
        Event::BatteryLow => Py::new(py, BatteryLow {})?.into_any(),
        Event::RecordingEnds => Py::new(py, RecordingEnds {})?.into_any(),
        Event::Captured(capture) => {
            let viewpoint = capture.viewpoint;
            let sightings =
                capture.sightings.iter().map(|sighting| (sighting.defect, sighting.visible_fraction)).collect();
            let captured = Captured {
                number: capture.number,
                time_s: capture.time_s,
                position: (viewpoint.position.x, viewpoint.position.y),
                altitude_m: viewpoint.altitude_m,
                yaw_rad: viewpoint.yaw_rad,
                velocity_mps: (capture.velocity_mps.x, capture.velocity_mps.y),
                segment: capture.segment,
                on_revisit: capture.on_revisit,
                visibility: capture.visibility,
                sightings,
            };
            Py::new(py, captured)?.into_any()
        }
        Event::Occluded(report) => Py::new(
            py,
            Occluded {
                time_s: report.time_s,
                visibility: report.visibility,
                hidden_place: report.hidden_centroid.map(|place| (place.x, place.y)),
                permanently_hidden: report.permanently_hidden,
                since_s: report.since_s,
                waited_s: report.waited_s,
                displacements: report.displacements,
                since_displacement_m: report.since_displacement_m,
            },
        )?
        .into_any(),
    };
    Ok(object)
}

/// Predicts visibility after displacements from one state; to be asked at any later time.
#[pyclass(frozen, module = "pavetwin._core")]
pub struct DisplacementPredictor(core::DisplacementPredictor);

#[pymethods]
impl DisplacementPredictor {
    fn predict<'py>(
        &self,
        py: Python<'py>,
        displacements: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(self.0.predict(&points(&displacements)?).map_err(plain)?.to_pyarray(py))
    }
}

#[pyclass(module = "pavetwin._core")]
pub struct Flight(core::Flight, DefectSampler);

#[pymethods]
impl Flight {
    #[new]
    #[pyo3(signature = (ground, trace, settings, *, base))]
    fn new(ground: &Ground, trace: &Trace, settings: &FlightSettings, base: (f64, f64)) -> PyResult<Self> {
        let base = Vec2::new(base.0, base.1);
        let flight = core::Flight::new(ground.0.clone(), trace.0.clone(), settings.0.clone(), base).map_err(plain)?;
        Ok(Self(flight, ground.1.clone()))
    }

    #[pyo3(signature = (until_s = None))]
    fn advance(&mut self, py: Python<'_>, until_s: Option<f64>) -> PyResult<Py<PyAny>> {
        py.check_signals()?;
        let event = self.0.advance_until(until_s.unwrap_or(f64::INFINITY)).map_err(plain)?;
        event_object(py, event)
    }

    fn climb_to(&mut self, altitude_m: f64) {
        self.0.climb_to(altitude_m);
    }

    #[pyo3(signature = (goal, *, revisit = false, stop_short = false))]
    fn fly_to(&mut self, goal: (f64, f64), revisit: bool, stop_short: bool) -> PyResult<()> {
        let mode = if revisit { Mode::Revisit } else { Mode::Transit };
        self.0.fly_to(Vec2::new(goal.0, goal.1), mode, stop_short).map_err(plain)
    }

    fn fly_home(&mut self) -> PyResult<()> {
        self.0.fly_home().map_err(plain)
    }

    fn turn_to(&mut self, yaw_rad: f64) {
        self.0.turn_to(yaw_rad);
    }

    fn inspect(&mut self, py: Python<'_>, segment: u32, line: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        self.1.sample_segment(py, segment)?;
        self.0.inspect(segment, &points(&line)?).map_err(plain)
    }

    fn revisit(&mut self, py: Python<'_>, segment: u32, stay_s: f64) -> PyResult<()> {
        self.1.sample_segment(py, segment)?;
        self.0.revisit(segment, stay_s).map_err(plain)
    }

    #[pyo3(signature = (segment, *, ahead_mps, left_mps, turn_rad_s))]
    fn steer(&mut self, py: Python<'_>, segment: u32, ahead_mps: f64, left_mps: f64, turn_rad_s: f64) -> PyResult<()> {
        self.1.sample_segment(py, segment)?;
        self.0.steer(segment, core::Steer { ahead_mps, left_mps, turn_rad_s }).map_err(plain)
    }

    fn swap_battery(&mut self, swap_s: f64) {
        self.0.swap_battery(swap_s);
    }

    fn wait(&mut self, seconds: f64) {
        self.0.wait(seconds);
    }

    fn displace(&mut self, east_m: f64, north_m: f64, stay_s: f64) {
        self.0.displace(Vec2::new(east_m, north_m), stay_s);
    }

    fn extend(&mut self, trace: &Trace) -> PyResult<()> {
        self.0.extend(trace.0.clone()).map_err(plain)
    }

    fn remaining<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        to_array(py, &self.0.remaining())
    }

    fn predictor(&self) -> Option<DisplacementPredictor> {
        self.0.predictor().map(DisplacementPredictor)
    }

    fn set_wanted(&mut self, defect: u32, wanted: bool) {
        self.0.set_wanted(defect, wanted);
    }

    fn surface_coverage(&self, segment: u32) -> f64 {
        self.0.surface_coverage(segment)
    }

    fn swept<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.0.swept().to_pyarray(py)
    }

    #[getter]
    fn time_s(&self) -> f64 {
        self.0.time_s()
    }

    #[getter]
    fn position(&self) -> (f64, f64) {
        let position = self.0.viewpoint().position;
        (position.x, position.y)
    }

    #[getter]
    fn altitude_m(&self) -> f64 {
        self.0.viewpoint().altitude_m
    }

    #[getter]
    fn yaw_rad(&self) -> f64 {
        self.0.viewpoint().yaw_rad
    }

    #[getter]
    fn speed_mps(&self) -> f64 {
        self.0.speed_mps()
    }

    #[getter]
    fn battery(&self) -> f64 {
        self.0.battery()
    }

    #[getter]
    fn mode(&self) -> u8 {
        self.0.mode() as u8
    }

    #[getter]
    fn energy_used(&self) -> f64 {
        self.0.energy_used()
    }

    #[getter]
    fn distance_m(&self) -> f64 {
        self.0.distance_m()
    }

    #[getter]
    fn waited_s(&self) -> f64 {
        self.0.waited_s()
    }

    #[getter]
    fn occlusions(&self) -> u32 {
        self.0.occlusions()
    }

    fn track<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let track = self.0.track();
        let columns = PyDict::new(py);
        columns.set_item("t_s", track.time_s.to_pyarray(py))?;
        columns.set_item("x_m", track.x_m.to_pyarray(py))?;
        columns.set_item("y_m", track.y_m.to_pyarray(py))?;
        columns.set_item("altitude_m", track.altitude_m.to_pyarray(py))?;
        columns.set_item("yaw_rad", track.yaw_rad.to_pyarray(py))?;
        columns.set_item("speed_mps", track.speed_mps.to_pyarray(py))?;
        columns.set_item("battery", track.battery.to_pyarray(py))?;
        columns.set_item("mode", track.mode.to_pyarray(py))?;
        columns.set_item("segment", track.segment.to_pyarray(py))?;
        columns.set_item("visibility", track.visibility.to_pyarray(py))?;
        Ok(columns)
    }

    fn captures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let captures = self.0.captures();
        let columns = PyDict::new(py);
        columns.set_item("t_s", captures.time_s.to_pyarray(py))?;
        columns.set_item("x_m", captures.x_m.to_pyarray(py))?;
        columns.set_item("y_m", captures.y_m.to_pyarray(py))?;
        columns.set_item("yaw_rad", captures.yaw_rad.to_pyarray(py))?;
        columns.set_item("segment", captures.segment.to_pyarray(py))?;
        columns.set_item("visibility", captures.visibility.to_pyarray(py))?;
        columns.set_item("on_revisit", captures.on_revisit.to_pyarray(py))?;
        Ok(columns)
    }
}
