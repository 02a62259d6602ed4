"""An exported model with its convolutions in int8, by static quantisation (onnxruntime.quantization).

Activations are unsigned and weights use seven of their eight bits, by channel, so that sums of products fit 16 bits on
processors with AVX2 alone. What is not a convolution stays in single precision.
"""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import onnx
from onnx import helper

from pavetwin.arrays import UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.files import PICTURE_SUFFIXES, writing
from pavetwin.perception.inference.detector import Detector

MOST: Final = 300
"""Pictures of which ranges are taken; more take longer and change little."""

LEAST: Final = 8
"""Fewer pictures do not show what values there are."""

EVERY: Final = 97
"""Pictures of a folder are taken in steps of this, round and round: neighbours show the same street."""


def pictures_in(folder: Path) -> list[Path]:
    """At most `MOST` pictures of a folder and the folders within.

    Raises:
        PaveTwinError: there are fewer than `LEAST`.
    """
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() in PICTURE_SUFFIXES)
    if len(files) < LEAST:
        raise PaveTwinError(
            f"`int8`: '{folder}' holds {len(files)} pictures; int8 needs at least {LEAST} that show what it will see."
        )
    order = sorted(range(len(files)), key=lambda at: (at * EVERY % len(files), at))
    return [files[at] for at in order[:MOST]]


def store_in_int8(file: Path, pictures: Sequence[Path]) -> None:
    """Change an exported file in single precision in place.

    Args:
        pictures: what the network will see; they give the ranges of its values.

    Raises:
        PaveTwinError: a picture cannot be read, or onnxruntime is not installed.
    """
    try:
        quantization: Any = import_module("onnxruntime.quantization")
    except ImportError as error:
        raise PaveTwinError(
            "`int8` needs onnxruntime, which is an extra; install it with `pip install pavetwin[detect]`."
        ) from error
    model = onnx.load(file)
    properties = {each.key: each.value for each in model.metadata_props}
    with TemporaryDirectory() as folder, _without_advice():
        target = Path(folder) / "int8.onnx"
        quantization.quantize_static(
            model,
            target,
            _Views(file, pictures),
            op_types_to_quantize=["Conv"],
            per_channel=True,
            reduce_range=True,
            activation_type=quantization.QuantType.QUInt8,
            weight_type=quantization.QuantType.QInt8,
        )
        changed = onnx.load(target)
    helper.set_model_props(changed, properties)
    with writing(file) as temporary:
        temporary.write_bytes(changed.SerializeToString())


@contextmanager
def _without_advice() -> Iterator[None]:
    """It advises to join batch normalisation and convolutions first, which the export has done."""
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


class _Views(Detector):
    """What the network is shown of pictures, as a detector shows it: a `CalibrationDataReader`."""

    def __init__(self, file: Path, pictures: Sequence[Path]) -> None:
        super().__init__(file)
        self._seen: list[UInt8Array] = []
        self._left = self._views(pictures)

    def get_next(self) -> dict[str, UInt8Array] | None:
        """The model's input, or None after the last."""
        return next(self._left, None)

    def _views(self, pictures: Sequence[Path]) -> Iterator[dict[str, UInt8Array]]:
        for _ in self.each(pictures):
            for canvas in self._seen:
                yield {"images": canvas}
            self._seen.clear()

    def _told(self, canvas: UInt8Array) -> dict[str, Any]:
        self._seen.append(canvas)
        nothing = {"image": (0,), "boxes": (0, 4), "classes": (0,), "detection": (0,), "subtype": (0,)}
        kinds = {"image": np.int64, "classes": np.int64}
        return {name: np.zeros(shape, kinds.get(name, np.float32)) for name, shape in nothing.items()}
