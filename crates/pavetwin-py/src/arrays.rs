//! Between NumPy arrays and the core's points.

use crate::plain;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pavetwin_core::geometry::Vec2;
use pyo3::prelude::*;

/// An (n, 2) array as points.
pub fn points(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Vec2>> {
    if array.shape()[1] != 2 {
        return Err(plain(format!("expected an array of shape (n, 2), not {:?}", array.shape())));
    }
    Ok(array.as_array().rows().into_iter().map(|row| Vec2::new(row[0], row[1])).collect())
}

/// Points as an (n, 2) array.
pub fn to_array<'py>(py: Python<'py>, points: &[Vec2]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = points.iter().flat_map(|point| [point.x, point.y]).collect();
    use numpy::PyArrayMethods;
    flat.into_pyarray(py).reshape([points.len(), 2])
}

/// A ragged list as its items: `offsets` (k + 1) into `points`.
pub fn ragged(offsets: &PyReadonlyArray1<'_, u32>, points: &[Vec2]) -> PyResult<Vec<Vec<Vec2>>> {
    let offsets = offsets.as_slice()?;
    let cut = |pair: &[u32]| points.get(pair[0] as usize..pair[1] as usize).map(<[Vec2]>::to_vec);
    let items: Option<Vec<_>> = offsets.windows(2).map(cut).collect();
    items.ok_or_else(|| plain("offsets must rise and end at the number of points"))
}
