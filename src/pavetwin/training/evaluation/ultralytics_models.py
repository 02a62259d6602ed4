"""An adapter for the networks of Ultralytics, for comparison only.

Ultralytics is AGPL-3.0 and no part of PaveTwin: it is not among the packages of any extra, nothing of it is copied
here, and it is imported where a user has installed it and asks for its networks. It is kept from the network then: no
download of weights, no installing of packages, no reports of use.
"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from pavetwin.arrays import Int64Array
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.perception.classes import CLASSES
from pavetwin.perception.inference.detections import Detections
from pavetwin.perception.inference.pictures import Picture, pixels_of

NETWORKS: Final = tuple(f"{family}{size}" for family in ("yolov8", "yolo11", "yolo12") for size in "nsml")

LICENCE: Final = (
    "Ultralytics is licensed under AGPL-3.0, which it claims for weights trained with it too; PaveTwin holds nothing "
    "of it."
)

_SILENT: Final = {"YOLO_OFFLINE": "true", "YOLO_AUTOINSTALL": "false", "YOLO_VERBOSE": "false"}
"""What the package reads when it is imported."""

_OVERLAP: Final = 0.7
_MOST: Final = 300


@dataclass(frozen=True)
class UltralyticsModel:
    """A network: of a published size and untrained, or of a file of weights."""

    model: Any
    """`ultralytics.YOLO`."""
    confidence: float
    image_px: int
    """Longer side of what the network sees."""

    @property
    def size_mb(self) -> float:
        """Of its parameters in single precision."""
        return float(sum(each.numel() for each in self.model.model.parameters()) * 4 / 1e6)

    def detect(self, images: Iterable[Picture]) -> list[Detections]:
        """The detections of each image, by the package's own prediction in PyTorch; those of other classes are left
        out. The one confidence that these networks give stands for that of the coarse class."""
        return [self._of_image(image) for image in images]

    def _of_image(self, image: Picture) -> Detections:
        pixels = pixels_of(image)
        # Arrays are taken for blue, green, red.
        (said,) = self.model.predict(
            np.ascontiguousarray(pixels[:, :, ::-1]),
            imgsz=self.image_px,
            conf=self.confidence,
            iou=_OVERLAP,
            max_det=_MOST,
            device="cpu",
            verbose=False,
        )
        rows = said.boxes.data.numpy()
        numbers = classes_of(self.model.names, rows[:, 5])
        kept = (numbers >= 0) & (rows[:, 2:4] > rows[:, :2]).all(axis=1)
        count = int(kept.sum())
        return Detections(
            (pixels.shape[1], pixels.shape[0]),
            rows[kept, :4].astype(np.float32),
            numbers[kept],
            rows[kept, 4].astype(np.float32),
            np.ones(count, dtype=np.float32),
            ((),) * count,
        )


def classes_of(names: Mapping[int, str], said: Any) -> Int64Array:
    """Numbers in `CLASSES` of a network's own; −1 for what is none of them.

    Args:
        names: of the network's classes. Case, hyphens and underscores are no difference.
        said: (n,) its numbers.
    """
    known = {name.lower(): at for at, name in enumerate(CLASSES)}
    plain = {at: name.lower().replace("_", " ").replace("-", " ") for at, name in names.items()}
    return np.array([known.get(plain[int(number)], -1) for number in said], dtype=np.int64)


def check_ultralytics(given: str | Path) -> None:
    """Before anything is loaded.

    Raises:
        PaveTwinError: there is no such network or file, or Ultralytics is not installed.
    """
    if isinstance(given, str) and given not in NETWORKS:
        raise PaveTwinError(no_such("network", given, NETWORKS, key="`ultralytics`"))
    if isinstance(given, Path) and not given.is_file():
        raise PaveTwinError(f"`weights`: there is no file '{given}'.")
    if find_spec("ultralytics") is None:
        raise PaveTwinError(
            "Ultralytics is not installed, and is no part of PaveTwin: it is AGPL-3.0. Where that suits you, "
            "`pip install ultralytics` beside it."
        )


def open_ultralytics(given: str | Path, *, confidence: float, image_px: int) -> UltralyticsModel:
    """A network of `NETWORKS` by its name, untrained, or a file of weights.

    Args:
        confidence: the least of what is said.
        image_px: longer side of what the network sees; 0 takes what it was trained on.

    Raises:
        PaveTwinError: as `check_ultralytics` does, or the file is damaged, or none of its classes is one of the
            detector's.
    """
    check_ultralytics(given)
    is_file = isinstance(given, Path)
    for name, value in _SILENT.items():
        os.environ.setdefault(name, value)
    package: Any = import_module("ultralytics")
    try:
        model = package.YOLO(str(given) if is_file else f"{given}.yaml", task="detect", verbose=False)
    # Unpickling raises nearly anything for damaged files.
    except Exception as error:
        raise PaveTwinError(f"'{given}' is damaged, or no weights of Ultralytics.") from error
    if is_file and (classes_of(model.names, list(model.names)) < 0).all():
        raise PaveTwinError(f"'{given}' knows none of the classes {', '.join(CLASSES)}.")
    return UltralyticsModel(model, confidence, image_px or int(model.overrides.get("imgsz", 640)))
