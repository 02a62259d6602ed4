//! Python bindings of `pavetwin-core`, as the module `pavetwin._core`: conversions and nothing else.

mod arrays;
mod camera;
mod flight;
mod ground;
mod imaging;
mod navmesh;
mod raster;
mod relief;
mod settings;
mod texture;
mod trace;

use pavetwin_core::mission::Mode;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::error::Error;

pyo3::import_exception!(pavetwin.errors, PaveTwinError);

/// The kernel's error as the exception that the command line shows, with the same words. An exception of Python's that
/// the kernel only passed on, such as the one that ends the process, is raised again as it was.
fn plain(error: impl Into<Box<dyn Error>>) -> PyErr {
    let error = error.into();
    let mut causes = std::iter::successors(error.source(), |&cause| cause.source());
    match causes.find_map(|cause| cause.downcast_ref::<PyErr>()) {
        Some(raised) => Python::attach(|py| raised.clone_ref(py)),
        None => PaveTwinError::new_err(error.to_string()),
    }
}

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<navmesh::NavMesh>()?;
    module.add_class::<trace::Trace>()?;
    module.add_class::<ground::Ground>()?;
    module.add("MODES", PyTuple::new(module.py(), Mode::NAMES)?)?;
    module.add_class::<camera::NadirCamera>()?;
    module.add_class::<camera::Viewpoint>()?;
    module.add_class::<settings::Limits>()?;
    module.add_class::<settings::Battery>()?;
    module.add_class::<settings::FlightSettings>()?;
    module.add_class::<flight::Flight>()?;
    module.add_class::<flight::DisplacementPredictor>()?;
    module.add_class::<flight::Arrived>()?;
    module.add_class::<flight::Paused>()?;
    module.add_class::<flight::Captured>()?;
    module.add_class::<flight::Occluded>()?;
    module.add_class::<flight::BatteryLow>()?;
    module.add_class::<flight::RecordingEnds>()?;
    module.add_function(wrap_pyfunction!(imaging::expose, module)?)?;
    module.add_function(wrap_pyfunction!(texture::texture_sample, module)?)?;
    raster::add_to(module)?;
    relief::add_to(module)
}
