//! The relief kernels, on NumPy arrays of shape (rows, cols).

use crate::arrays::{Field, field, rows};
use crate::plain;
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pavetwin_core::relief as core;
use pyo3::prelude::*;

type Traced<'py> = (Field<'py, f32>, Field<'py, f32>, Field<'py, f32>);
type Blocks<'py> = (Field<'py, u16>, Field<'py, u16>, Field<'py, f32>);
type Pebbles<'py> = (Field<'py, f32>, Field<'py, f32>);
type Mesh<'py> = (Field<'py, f32>, Field<'py, u32>, f64);

/// (rows, cols), the cell's side, and the centre of the first cell.
type Lattice = ((usize, usize), f64, (f64, f64));

pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(relief_noise, module)?)?;
    module.add_function(wrap_pyfunction!(relief_trace, module)?)?;
    module.add_function(wrap_pyfunction!(relief_blocks, module)?)?;
    module.add_function(wrap_pyfunction!(relief_pebbles, module)?)?;
    module.add_function(wrap_pyfunction!(relief_region, module)?)?;
    module.add_function(wrap_pyfunction!(relief_largest_part, module)?)?;
    module.add_function(wrap_pyfunction!(relief_outline, module)?)?;
    module.add_function(wrap_pyfunction!(relief_widths, module)?)?;
    module.add_function(wrap_pyfunction!(relief_mesh, module)?)
}

fn grid(lattice: Lattice) -> core::Grid {
    let ((rows, cols), cell_m, (x0_m, y0_m)) = lattice;
    core::Grid { rows, cols, cell_m, x0_m, y0_m }
}

fn checked<T: numpy::Element>(array: &PyReadonlyArray2<'_, T>, shape: (usize, usize)) -> PyResult<()> {
    if array.shape() != [shape.0, shape.1] {
        return Err(plain(format!("expected an array of shape {shape:?}, not {:?}", array.shape())));
    }
    Ok(())
}

#[pyfunction]
fn relief_noise<'py>(
    py: Python<'py>,
    lattice: Lattice,
    seed: u64,
    wavelength_m: (f64, f64),
    octaves: u32,
    gain: f32,
) -> PyResult<Field<'py, f32>> {
    let settings = core::Noise { seed, wavelength_m, octaves, gain };
    let values = py.detach(|| core::noise(&grid(lattice), &settings));
    field(py, values, lattice.0)
}

#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn relief_trace<'py>(
    py: Python<'py>,
    lattice: Lattice,
    points: PyReadonlyArray2<'py, f64>,
    offsets: PyReadonlyArray1<'py, u32>,
    half_m: PyReadonlyArray2<'py, f64>,
    depth_m: PyReadonlyArray1<'py, f64>,
    reach_m: f64,
    steepness: i32,
) -> PyResult<Traced<'py>> {
    let (points, half_m) = (rows(&points)?, rows(&half_m)?);
    let (offsets, depth_m) = (offsets.as_slice()?, depth_m.as_slice()?);
    if half_m.len() != points.len() || depth_m.len() != points.len() {
        return Err(plain("every point needs two half widths and a depth"));
    }
    if offsets.last().is_none_or(|&last| last as usize != points.len()) || offsets.windows(2).any(|w| w[0] > w[1]) {
        return Err(plain("offsets must rise and end at the number of points"));
    }
    let strokes = core::Strokes { points: &points, offsets, half_m: &half_m, depth_m };
    let made = py.detach(|| core::trace(&grid(lattice), &strokes, reach_m, steepness));
    let shape = lattice.0;
    Ok((field(py, made.height_m, shape)?, field(py, made.opening, shape)?, field(py, made.distance_m, shape)?))
}

#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn relief_blocks<'py>(
    py: Python<'py>,
    lattice: Lattice,
    wanted: PyReadonlyArray2<'py, bool>,
    sites: PyReadonlyArray2<'py, f64>,
    half_exponent: u32,
    warp_x: PyReadonlyArray2<'py, f32>,
    warp_y: PyReadonlyArray2<'py, f32>,
    reach_m: f64,
) -> PyResult<Blocks<'py>> {
    checked(&wanted, lattice.0)?;
    checked(&warp_x, lattice.0)?;
    checked(&warp_y, lattice.0)?;
    let sites = rows(&sites)?;
    if half_exponent < 2 || sites.is_empty() || sites.len() > usize::from(u16::MAX) {
        return Err(plain("a block pattern needs 1 to 65535 sites and an exponent of at least 1"));
    }
    let (wanted, warp_x, warp_y) = (wanted.as_slice()?, warp_x.as_slice()?, warp_y.as_slice()?);
    let made = py.detach(|| core::blocks(&grid(lattice), wanted, &sites, half_exponent, warp_x, warp_y, reach_m));
    let shape = lattice.0;
    Ok((field(py, made.own, shape)?, field(py, made.other, shape)?, field(py, made.distance_m, shape)?))
}

#[pyfunction]
fn relief_pebbles<'py>(
    py: Python<'py>,
    lattice: Lattice,
    wanted: PyReadonlyArray2<'py, bool>,
    seed: u64,
    size_m: f64,
) -> PyResult<Pebbles<'py>> {
    checked(&wanted, lattice.0)?;
    let wanted = wanted.as_slice()?;
    let made = py.detach(|| core::pebbles(&grid(lattice), wanted, seed, size_m));
    Ok((field(py, made.dome, lattice.0)?, field(py, made.tone, lattice.0)?))
}

#[pyfunction]
fn relief_region<'py>(
    py: Python<'py>,
    marked: PyReadonlyArray2<'py, bool>,
    margin: f64,
    closing: f64,
) -> PyResult<Field<'py, bool>> {
    let (rows, cols) = (marked.shape()[0], marked.shape()[1]);
    let marked = marked.as_slice()?;
    let values = py.detach(|| core::region(rows, cols, marked, margin, closing));
    field(py, values, (rows, cols))
}

#[pyfunction]
fn relief_largest_part<'py>(
    py: Python<'py>,
    inside: PyReadonlyArray2<'py, bool>,
    diagonal: bool,
) -> PyResult<Field<'py, bool>> {
    let (rows, cols) = (inside.shape()[0], inside.shape()[1]);
    let inside = inside.as_slice()?;
    let values = py.detach(|| core::largest_part(rows, cols, inside, diagonal));
    field(py, values, (rows, cols))
}

#[pyfunction]
fn relief_outline<'py>(py: Python<'py>, inside: PyReadonlyArray2<'py, bool>) -> PyResult<Field<'py, f64>> {
    let (rows, cols) = (inside.shape()[0], inside.shape()[1]);
    let inside = inside.as_slice()?;
    let ring = py.detach(|| core::outline(rows, cols, inside));
    let count = ring.len();
    field(py, ring.into_iter().flatten().collect(), (count, 2))
}

#[pyfunction]
fn relief_widths<'py>(py: Python<'py>, opening: PyReadonlyArray2<'py, f32>) -> PyResult<Field<'py, f32>> {
    let (rows, cols) = (opening.shape()[0], opening.shape()[1]);
    let opening = opening.as_slice()?;
    let values = py.detach(|| core::widths(rows, cols, opening));
    field(py, values, (rows, cols))
}

#[pyfunction]
fn relief_mesh<'py>(
    py: Python<'py>,
    lattice: Lattice,
    height_m: PyReadonlyArray2<'py, f32>,
    ring: PyReadonlyArray2<'py, f64>,
    tolerance_m: f64,
    most: usize,
) -> PyResult<Option<Mesh<'py>>> {
    checked(&height_m, lattice.0)?;
    let (heights, ring) = (height_m.as_slice()?, rows(&ring)?);
    let Some(made) = py.detach(|| core::mesh(&grid(lattice), heights, &ring, tolerance_m, most)) else {
        return Ok(None);
    };
    let (vertices, triangles) = (made.vertices.len(), made.triangles.len());
    let positions = field(py, made.vertices.into_iter().flatten().collect(), (vertices, 3))?;
    let indices = field(py, made.triangles.into_iter().flatten().collect(), (triangles, 3))?;
    Ok(Some((positions, indices, made.error_m)))
}
