"""The detector's file: an ONNX model that describes its inputs and outputs in its properties.

Input `images`: uint8 (batch, rows, columns, 3) red, green, blue; rows and columns are multiples of `stride`. The
inputs `confidence` and `overlap` may be left out. Outputs, a row for each detection of any image of the batch:

- `image` (n,) int64: which image it is of
- `boxes` (n, 4) float32: left, top, right, bottom in pixels, within the image
- `classes` (n,) int64: number in the list of classes
- `detection` (n,) float32: confidence in the coarse class
- `subtype` (n,) float32: confidence in the subtype of a defect; 1 for others
- `masks` (n, side, side) float32: probabilities within the box, 0 for what is not a defect; only with a mask head
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, check_format
from pavetwin.labels.class_names import CLASS_LABELS

OUTPUTS: Final = ("image", "boxes", "classes", "detection", "subtype", "masks")

INPUT: Final = "uint8 (batch, rows, columns, 3), red, green, blue; divided by 255 within"
"""The input and its normalisation, as the file states them."""


@dataclass(frozen=True, slots=True)
class ModelFacts:
    """The properties of a model file."""

    classes: tuple[str, ...] = CLASS_LABELS
    image_px: int = 640
    """Side of the images it was trained on."""
    native: bool = False
    """Whether it was trained on crops at native resolution."""
    stride: int = 32
    """Sides of images are multiples of it."""
    mask_px: int = 0
    """Side of a mask; 0 without masks."""
    recipe: str = ""
    """SHA-256 of the training's settings and data (`run.json`); empty where they are not known."""
    licence: str = ""
    """Licence of the weights; empty where it is not stated."""
    architecture: Mapping[str, Any] = field(default_factory=dict)

    def as_properties(self) -> dict[str, str]:
        """Texts by name, as the file holds them (`metadata_props`)."""
        return {
            "pavetwin_detector": str(FORMAT),
            "classes": json.dumps(self.classes),
            "input": INPUT,
            "image_px": str(self.image_px),
            "native": json.dumps(self.native),
            "stride": str(self.stride),
            "mask_px": str(self.mask_px),
            "recipe": self.recipe,
            "licence": self.licence,
            "architecture": json.dumps(dict(self.architecture)),
        }

    @classmethod
    def of_properties(cls, stated: Mapping[str, str], where: str) -> "ModelFacts":
        """The facts in a file's properties.

        Raises:
            PaveTwinError: they are not those of a detector of this format.
        """
        if "pavetwin_detector" not in stated:
            raise PaveTwinError(f"{where} is an ONNX model, but not a detector of `pavetwin export`.")
        number = stated["pavetwin_detector"]
        check_format(int(number) if number.isdecimal() else number, where)
        try:
            facts = cls(
                classes=tuple(json.loads(stated["classes"])),
                image_px=int(stated["image_px"]),
                native=bool(json.loads(stated["native"])),
                stride=int(stated["stride"]),
                mask_px=int(stated["mask_px"]),
                recipe=stated["recipe"],
                licence=stated["licence"],
                architecture=json.loads(stated["architecture"]),
            )
        except (KeyError, ValueError, TypeError) as error:
            raise PaveTwinError(f"{where} has damaged properties ({error}); export it again.") from error
        if facts.classes != CLASS_LABELS:
            names = ", ".join(facts.classes)
            raise PaveTwinError(f"{where} has the classes {names}; this version's are {', '.join(CLASS_LABELS)}.")
        return facts


def check_threads(threads: int) -> None:
    """Raises:
    PaveTwinError: it is negative, or above the number of cores.
    """
    cores = os.cpu_count() or 1
    if not 0 <= threads <= cores:
        raise PaveTwinError(f"`threads` {threads}: this machine has {cores} cores, and 0 takes one for each.")


def open_session(path: Path, threads: int) -> tuple[Any, ModelFacts]:
    """An onnxruntime session on the CPU, and the properties of the file.

    Args:
        threads: of the session; 0 takes one for each core.

    Raises:
        PaveTwinError: there is no such file, it is damaged, it is another model, onnxruntime is not installed, or there
            are more threads than cores.
    """
    check_threads(threads)
    try:
        onnxruntime: Any = import_module("onnxruntime")
    except ImportError as error:
        raise PaveTwinError(
            "Detecting needs onnxruntime, which is an extra; install it with `pip install pavetwin[detect]`."
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    # Its exceptions have no class in common but this one.
    except Exception as error:
        raise PaveTwinError(f"'{path}' is damaged, or no ONNX model.") from error
    facts = ModelFacts.of_properties(session.get_modelmeta().custom_metadata_map, f"'{path}'")
    wanted = OUTPUTS if facts.mask_px else OUTPUTS[:-1]
    if tuple(each.name for each in session.get_outputs()) != wanted:
        raise PaveTwinError(f"'{path}' has other outputs than its properties state; export it again.")
    return session, facts


FOLDER: Final = Path(__file__).parent / "weights"

DEFAULT: Final = "rendered"
"""Detector used where none is named."""


def shipped_models() -> list[str]:
    """Names of the detectors that ship."""
    return sorted(file.stem for file in FOLDER.glob("*.onnx"))


def model_path(model: str | Path) -> Path:
    """File of a model: an ONNX file, or a detector that ships, by name. A file takes precedence.

    Raises:
        PaveTwinError: there is neither.
    """
    file = Path(model)
    if file.is_file():
        return file
    if str(model) in shipped_models():
        return FOLDER / f"{model}.onnx"
    raise PaveTwinError(
        f"There is no model '{model}': name one that ships ({', '.join(shipped_models())}), or a file of "
        f"`pavetwin export RUN --output model.onnx`."
    )


def start_path(start: str | Path) -> Path:
    """File of initial weights: `best.pt` of a run, an exported model, or a detector that ships, by name.

    Raises:
        PaveTwinError: there is none of them.
    """
    if Path(start).is_file() or str(start) in shipped_models():
        return model_path(start)
    raise PaveTwinError(
        f"`start`: there is no file of weights '{start}'; name the best.pt of a run, the file of `pavetwin export RUN "
        f"output=model.onnx`, or a model that ships ({', '.join(shipped_models())})."
    )
