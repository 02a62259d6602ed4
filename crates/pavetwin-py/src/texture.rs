//! `texture_sample`: textures as a graphics card samples them.

use crate::plain;
use numpy::{
    IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pavetwin_core::texture::{Level, Texture};
use pyo3::prelude::*;

#[pyfunction]
pub fn texture_sample<'py>(
    py: Python<'py>,
    levels: Vec<PyReadonlyArray3<'py, f32>>,
    uv: PyReadonlyArray2<'py, f64>,
    level: PyReadonlyArray1<'py, f32>,
    wraps: bool,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let channels = levels.first().map_or(0, |first| first.shape()[2]);
    let alike = levels.iter().all(|each| each.shape()[0] == each.shape()[1] && each.shape()[2] == channels);
    if channels == 0 || !alike || levels.iter().any(|each| each.shape()[0] == 0) {
        return Err(plain("levels are squares of the same channels, one at least"));
    }
    if uv.shape()[1] != 2 || uv.shape()[0] != level.len() {
        return Err(plain("there is one level to every pair of coordinates"));
    }
    let held = levels
        .iter()
        .map(|each| Ok(Level { side: each.shape()[0], texels: each.as_slice()? }))
        .collect::<PyResult<Vec<_>>>()?;
    let texture = Texture { levels: held, channels, wraps };
    let (coordinates, _) = uv.as_slice()?.as_chunks::<2>();
    let wanted = level.as_slice()?;
    let values = py.detach(|| texture.sample(coordinates, wanted));
    values.into_pyarray(py).reshape([wanted.len(), channels])
}
