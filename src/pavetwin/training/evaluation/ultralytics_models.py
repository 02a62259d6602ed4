"""Adapter for networks of Ultralytics, for comparison only.

Ultralytics is licensed under AGPL-3.0 and not part of PaveTwin: no extra installs it, and nothing of it is copied. It
is imported only if a user has installed it and asks for its networks, with downloads, installation of packages and
usage reports disabled.
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
from pavetwin.detections import Detections
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.labels.class_names import CLASS_LABELS, CLASSES
from pavetwin.perception.images import ImageLike, pixels_of

NETWORKS: Final = tuple(f"{family}{size}" for family in ("yolov8", "yolo11", "yolo12") for size in "nsml")

LICENCE: Final = (
    "Ultralytics is licensed under AGPL-3.0, which it claims for weights trained with it too; PaveTwin holds nothing "
    "of it."
)

_SILENT: Final = {"YOLO_OFFLINE": "true", "YOLO_AUTOINSTALL": "false", "YOLO_VERBOSE": "false"}
"""Environment variables that the package reads on import."""

_OVERLAP: Final = 0.7
_MOST: Final = 300


@dataclass(frozen=True)
class UltralyticsModel:
    """An untrained network of a published size, or one from a file of weights."""

    model: Any
    """`ultralytics.YOLO`."""
    confidence: float
    image_px: int
    """Longer side of the network's input, in pixels."""

    @property
    def size_mb(self) -> float:
        """Size of its parameters in single precision."""
        return float(sum(each.numel() for each in self.model.model.parameters()) * 4 / 1e6)

    def detect(self, images: Iterable[ImageLike]) -> list[Detections]:
        """The detections of each image, by the package's own prediction in PyTorch; those of other classes are left
        out. The one confidence that these networks give stands for that of the coarse class."""
        return [self._of_image(image) for image in images]

    def _of_image(self, image: ImageLike) -> Detections:
        pixels = pixels_of(image)
        # Arrays are taken for blue, green, red.
        (result,) = self.model.predict(
            np.ascontiguousarray(pixels[:, :, ::-1]),
            imgsz=self.image_px,
            conf=self.confidence,
            iou=_OVERLAP,
            max_det=_MOST,
            device="cpu",
            verbose=False,
        )
        rows = result.boxes.data.numpy()
        numbers = classes_of(self.model.names, rows[:, 5])
        kept = (numbers >= 0) & (rows[:, 2:4] > rows[:, :2]).all(axis=1)
        confidence = rows[kept, 4].astype(np.float32)
        return Detections(
            [CLASSES[number] for number in numbers[kept]],
            confidence,
            size_px=(pixels.shape[1], pixels.shape[0]),
            box_px=rows[kept, :4].astype(np.float32),
            detection_confidence=confidence,
            subtype_confidence=np.ones(len(confidence), dtype=np.float32),
        )


def classes_of(names: Mapping[int, str], numbers: Any) -> Int64Array:
    """Indices into `CLASSES` of a network's own class numbers; −1 for other classes.

    Args:
        names: names of the network's classes; case, hyphens and underscores are ignored.
        numbers: (n,) class numbers of the network.
    """
    known = {name.lower(): at for at, name in enumerate(CLASS_LABELS)}
    plain = {at: name.lower().replace("_", " ").replace("-", " ") for at, name in names.items()}
    return np.array([known.get(plain[int(number)], -1) for number in numbers], dtype=np.int64)


def check_ultralytics(given: str | Path) -> None:
    """Raises:
    PaveTwinError: there is no such network or file, or Ultralytics is not installed.
    """
    if isinstance(given, str) and given not in NETWORKS:
        raise PaveTwinError(no_such("network", given, NETWORKS, key="`ultralytics`"))
    if isinstance(given, Path) and not given.is_file():
        raise PaveTwinError(f"`weights`: there is no file '{given}'.")
    if find_spec("ultralytics") is None:
        raise PaveTwinError(
            "Ultralytics is not installed. It is not part of PaveTwin and is licensed under AGPL-3.0; if that suits "
            "you, install it with `pip install ultralytics`."
        )


def open_ultralytics(given: str | Path, *, confidence: float, image_px: int) -> UltralyticsModel:
    """A network of `NETWORKS` by its name, untrained, or a file of weights.

    Args:
        confidence: minimum confidence of detections.
        image_px: longer side of the network's input; 0 takes that of the training.

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
        raise PaveTwinError(f"'{given}' knows none of the classes {', '.join(CLASS_LABELS)}.")
    return UltralyticsModel(model, confidence, image_px or int(model.overrides.get("imgsz", 640)))
