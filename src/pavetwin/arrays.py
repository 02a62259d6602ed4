"""Types of NumPy arrays, named by what they hold: `Float64Array` holds `numpy.float64`, whatever its shape.

Shapes, units and frames are documented at the field or function.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
Float16Array = npt.NDArray[np.float16]
FloatArray = npt.NDArray[np.floating[Any]]
"""Floating-point numbers of any width."""

Int64Array = npt.NDArray[np.int64]
Int32Array = npt.NDArray[np.int32]
Int16Array = npt.NDArray[np.int16]
IndexArray = npt.NDArray[np.intp]
"""Indices of another array's elements, as NumPy returns them."""

UInt32Array = npt.NDArray[np.uint32]
UInt16Array = npt.NDArray[np.uint16]
UInt8Array = npt.NDArray[np.uint8]

BoolArray = npt.NDArray[np.bool_]
StrArray = npt.NDArray[np.str_]
StructuredArray = npt.NDArray[np.void]
"""Records of named fields (a structured dtype), as vertex and instance buffers have them."""

ObjectArray = npt.NDArray[np.object_]
"""Python objects of any kind, such as texts of different lengths."""

GeometryArray = npt.NDArray[np.object_]
"""Shapely geometries."""

AnyArray = npt.NDArray[Any]
