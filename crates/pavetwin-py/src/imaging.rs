//! `expose`: the camera's sensor and what it does to light.

use crate::plain;
use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pavetwin_core::imaging::{Crop, Light, Mosaic, Motion, Sensor};
use pyo3::prelude::*;
use std::collections::HashMap;

#[pyfunction]
#[pyo3(signature = (
    light, *, seed, electrons_per_light, full_electrons, read_electrons, vignetting, blur_px, white_balance, saturation,
    sharpening, curve, mosaic=None, depth=None, labels=None, focal_px=1.0, frame_px=None, corner_px=(0, 0),
    still_m=[0.0; 3], moving_m=HashMap::new()
))]
#[allow(clippy::too_many_arguments)] // a camera's settings, each by name
pub fn expose<'py>(
    py: Python<'py>,
    light: PyReadonlyArray3<'py, u16>,
    seed: u64,
    electrons_per_light: f32,
    full_electrons: f32,
    read_electrons: f32,
    vignetting: f32,
    blur_px: f32,
    white_balance: [f32; 3],
    saturation: f32,
    sharpening: f32,
    curve: PyReadonlyArray1<'py, f32>,
    mosaic: Option<(f32, usize)>,
    depth: Option<PyReadonlyArray2<'py, f32>>,
    labels: Option<PyReadonlyArray2<'py, u32>>,
    focal_px: f32,
    frame_px: Option<(usize, usize)>,
    corner_px: (usize, usize),
    still_m: [f32; 3],
    moving_m: HashMap<u32, [f32; 3]>,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let &[height, width, channels] = light.shape() else { return Err(plain("light is (height, width, 4)")) };
    let same = |shape: &[usize]| shape == [height, width];
    if channels != 4 || height == 0 || width == 0 || curve.len() < 2 {
        return Err(plain("light is (height, width, 4), and a curve has two points at least"));
    }
    if !depth.as_ref().is_none_or(|it| same(it.shape())) || !labels.as_ref().is_none_or(|it| same(it.shape())) {
        return Err(plain("depth and labels have the picture's height and width"));
    }
    let crop = Crop { frame: frame_px.unwrap_or((width, height)), corner: corner_px };
    if corner_px.0 + width > crop.frame.0 || corner_px.1 + height > crop.frame.1 {
        return Err(plain("a crop lies within its frame"));
    }
    let sensor = Sensor {
        electrons_per_light,
        full_electrons,
        read_electrons,
        vignetting,
        blur_px,
        white_balance,
        saturation,
        sharpening,
        curve: curve.as_slice()?.to_vec(),
        mosaic: mosaic.map(|(noise_reduction, colour_reach)| Mosaic { noise_reduction, colour_reach }),
    };
    let picture = {
        let light = Light { width, height, halves: light.as_slice()? };
        let depth = depth.as_ref().map(|depth| depth.as_slice()).transpose()?;
        let labels = labels.as_ref().map(|labels| labels.as_slice()).transpose()?.unwrap_or(&[]);
        let motion = depth.map(|depth| Motion { depth, labels, focal: focal_px, still: still_m, moving: moving_m });
        py.detach(|| sensor.expose(&light, crop, motion.as_ref(), seed))
    };
    picture.into_pyarray(py).reshape([height, width, 3])
}
