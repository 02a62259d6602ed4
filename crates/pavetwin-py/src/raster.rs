//! The raster kernels, on NumPy arrays.

use crate::arrays::{self, Field, field};
use crate::plain;
use numpy::{IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pavetwin_core::raster as core;
use pyo3::prelude::*;

type Tracks<'py> = (Field<'py, i32>, Field<'py, f32>, Field<'py, f32>, Field<'py, f32>);
type Paint<'py> = (Field<'py, f32>, Field<'py, f32>, Field<'py, f32>);

/// Cells along a side, and the side of a cell [m].
type Raster = (usize, f64);

pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(raster_tracks, module)?)?;
    module.add_function(wrap_pyfunction!(raster_painted, module)?)?;
    module.add_function(wrap_pyfunction!(raster_covered, module)?)?;
    module.add_function(wrap_pyfunction!(raster_weathered, module)?)?;
    module.add_function(wrap_pyfunction!(raster_looked_up, module)?)
}

#[pyfunction]
fn raster_tracks<'py>(
    py: Python<'py>,
    raster: Raster,
    points: PyReadonlyArray2<'py, f64>,
    offsets: PyReadonlyArray1<'py, u32>,
    reach_m: PyReadonlyArray1<'py, f64>,
    begin_m: PyReadonlyArray1<'py, f64>,
    flat: bool,
) -> PyResult<Tracks<'py>> {
    let (offsets, reach_m, begin_m) = (offsets.as_slice()?, reach_m.as_slice()?, begin_m.as_slice()?);
    if reach_m.len() != begin_m.len() || offsets.len() != reach_m.len() + 1 {
        return Err(plain("every line has an offset, a reach and a beginning"));
    }
    let points = arrays::rows(&points)?;
    let lines = offsets
        .windows(2)
        .zip(reach_m.iter().zip(begin_m))
        .map(|(cut, (&reach_m, &begin_m))| {
            let points = points.get(cut[0] as usize..cut[1] as usize)?;
            Some(core::Line { points, reach_m, begin_m })
        })
        .collect::<Option<Vec<_>>>()
        .ok_or_else(|| plain("offsets must rise and end at the number of points"))?;
    let (px, cell_m) = raster;
    let found = py.detach(|| core::tracks(&core::Raster::new(px, cell_m), &lines, flat));
    Ok((
        field(py, found.index, (px, px))?,
        field(py, found.along, (px, px))?,
        field(py, found.across, (px, px))?,
        field(py, found.distance, (px, px))?,
    ))
}

/// Rows of middle x and y, cosine and sine, half length and width, half the window's sides.
fn bars(rows: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<core::Bar>> {
    let bar = |[x, y, cos, sin, long, wide, east, north]: [f64; 8]| core::Bar {
        middle: [x, y],
        direction: [cos, sin],
        half_m: [long, wide],
        extent_m: [east, north],
    };
    Ok(arrays::rows(rows)?.into_iter().map(bar).collect())
}

#[pyfunction]
fn raster_painted<'py>(
    py: Python<'py>,
    raster: Raster,
    rows: PyReadonlyArray2<'py, f64>,
    looks: PyReadonlyArray2<'py, f32>,
    most_m: PyReadonlyArray1<'py, f32>,
    outside_m: f32,
) -> PyResult<Paint<'py>> {
    let (bars, looks, most) = (bars(&rows)?, arrays::rows(&looks)?, most_m.as_slice()?);
    if looks.len() != bars.len() || most.len() != bars.len() {
        return Err(plain("every bar has two looks and a greatest distance"));
    }
    let (px, cell_m) = raster;
    let found = py.detach(|| core::painted(&core::Raster::new(px, cell_m), &bars, &looks, most, outside_m));
    let [first, second] = found.looks;
    Ok((field(py, found.distance, (px, px))?, field(py, first, (px, px))?, field(py, second, (px, px))?))
}

#[pyfunction]
fn raster_covered<'py>(
    py: Python<'py>,
    raster: Raster,
    rows: PyReadonlyArray2<'py, f64>,
    factors: PyReadonlyArray1<'py, f32>,
) -> PyResult<Field<'py, f32>> {
    let (bars, factors) = (bars(&rows)?, factors.as_slice()?);
    if factors.len() != bars.len() {
        return Err(plain("every bar has a factor"));
    }
    let (px, cell_m) = raster;
    let tone = py.detach(|| core::covered(&core::Raster::new(px, cell_m), &bars, factors));
    field(py, tone, (px, px))
}

#[pyfunction]
#[pyo3(signature = (*, on_road, land_tone, road_tone, repaired, stain, spilled, dust, wheels))]
#[allow(clippy::too_many_arguments)] // fields of one map, each by name
fn raster_weathered<'py>(
    py: Python<'py>,
    on_road: PyReadonlyArray2<'py, f32>,
    land_tone: PyReadonlyArray2<'py, f32>,
    road_tone: PyReadonlyArray2<'py, f32>,
    repaired: PyReadonlyArray2<'py, f32>,
    stain: (PyReadonlyArray2<'py, f32>, PyReadonlyArray2<'py, f32>),
    spilled: PyReadonlyArray2<'py, f32>,
    dust: (PyReadonlyArray2<'py, f32>, PyReadonlyArray2<'py, f32>),
    wheels: PyReadonlyArray2<'py, f32>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let shape = [on_road.shape()[0], on_road.shape()[1]];
    let others = [&land_tone, &road_tone, &repaired, &stain.0, &stain.1, &spilled, &dust.0, &dust.1, &wheels];
    if others.iter().any(|each| each.shape() != shape) {
        return Err(plain("all fields have one shape"));
    }
    let fields = core::Weathering {
        on_road: on_road.as_slice()?,
        land_tone: land_tone.as_slice()?,
        road_tone: road_tone.as_slice()?,
        repaired: repaired.as_slice()?,
        stain: core::Beside { land: stain.0.as_slice()?, more: stain.1.as_slice()? },
        spilled: spilled.as_slice()?,
        dust: core::Beside { land: dust.0.as_slice()?, more: dust.1.as_slice()? },
        wheels: wheels.as_slice()?,
    };
    let layers = py.detach(|| core::weathered(&fields));
    layers.into_pyarray(py).reshape([shape[0], shape[1], 4])
}

#[pyfunction]
fn raster_looked_up<'py>(
    py: Python<'py>,
    table: PyReadonlyArray2<'py, f32>,
    rows: PyReadonlyArray1<'py, u32>,
    columns: PyReadonlyArray1<'py, u32>,
) -> PyResult<Field<'py, f32>> {
    let [height, width] = [table.shape()[0], table.shape()[1]];
    let (table, rows, columns) = (table.as_slice()?, rows.as_slice()?, columns.as_slice()?);
    if rows.iter().any(|&row| row as usize >= height) || columns.iter().any(|&column| column as usize >= width) {
        return Err(plain("rows and columns lie within the table"));
    }
    let found = py.detach(|| core::looked_up(table, width, rows, columns));
    found.into_pyarray(py).reshape([rows.len(), columns.len()])
}
