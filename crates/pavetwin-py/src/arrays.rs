//! Between NumPy arrays and the core's points, rows and fields.

use crate::plain;
use numpy::{
    Element, IntoPyArray, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pavetwin_core::geometry::Vec2;
use pyo3::prelude::*;

pub type Field<'py, T> = Bound<'py, PyArray2<T>>;

/// Values, row by row, as an array of that shape.
pub fn field<'py, T: Element>(py: Python<'py>, values: Vec<T>, shape: (usize, usize)) -> PyResult<Field<'py, T>> {
    values.into_pyarray(py).reshape([shape.0, shape.1])
}

/// The rows of an (n, N) array.
pub fn rows<const N: usize, T: Element + Copy>(array: &PyReadonlyArray2<'_, T>) -> PyResult<Vec<[T; N]>> {
    if array.shape()[1] != N {
        return Err(plain(format!("expected an array of shape (n, {N}), not {:?}", array.shape())));
    }
    Ok(array.as_array().rows().into_iter().map(|row| std::array::from_fn(|at| row[at])).collect())
}

/// An (n, 2) array as points.
pub fn points(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<Vec2>> {
    Ok(rows(array)?.into_iter().map(|[x, y]| Vec2::new(x, y)).collect())
}

/// Points as an (n, 2) array.
pub fn to_array<'py>(py: Python<'py>, points: &[Vec2]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = points.iter().flat_map(|point| [point.x, point.y]).collect();
    flat.into_pyarray(py).reshape([points.len(), 2])
}

/// A ragged list as its items: `offsets` (k + 1) into `points`.
pub fn ragged(offsets: &PyReadonlyArray1<'_, u32>, points: &[Vec2]) -> PyResult<Vec<Vec<Vec2>>> {
    let offsets = offsets.as_slice()?;
    let cut = |pair: &[u32]| points.get(pair[0] as usize..pair[1] as usize).map(<[Vec2]>::to_vec);
    let items: Option<Vec<_>> = offsets.windows(2).map(cut).collect();
    items.ok_or_else(|| plain("offsets must rise and end at the number of points"))
}
