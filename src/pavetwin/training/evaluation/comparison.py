"""Models side by side: how good they are where that was measured, how large, and how fast on this machine."""

import csv
import io
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, Final

import numpy as np

from pavetwin.arrays import UInt8Array
from pavetwin.perception.detector import Detector
from pavetwin.perception.model_file import model_path
from pavetwin.training.evaluation.detections import LEAST_CONFIDENCE, Detects, found_by
from pavetwin.training.evaluation.evaluate import evaluate
from pavetwin.training.evaluation.labelled import LabelledSplit
from pavetwin.training.evaluation.ultralytics_models import open_ultralytics

FRAME_PX: Final = (640, 480)  # Width and height of the image that is timed: the paper's frame, scaled
CONFIDENCE: Final = 0.25  # Minimum confidence of detections in timed runs
_UNCOUNTED: Final = 3  # Runs before the time counts: the first ones reserve memory


@dataclass(frozen=True, slots=True)
class ComparedModel:
    """A row of the table; None and an empty cell for values that were not measured."""

    name: str
    map50: float | None
    """The four accuracies are shares, of the five classes; precision and recall are macro, at confidence 0.25."""
    map50_95: float | None
    precision: float | None
    recall: float | None
    size_mb: float
    """Size of the file."""
    frames_per_s: float
    """Rate for one image of `FRAME_PX`, from pixels to detections: inverse of the median time. A model sees the image
    as in the measurement of its accuracy: at the size of its training, and in tiles where it takes some."""
    gflops: float | None
    """Billions of operations of convolutions for one image of 640 × 640 px, as in published figures."""
    speed: float | None = None
    """Frames a second, as a multiple of those of the untrained network n in the same table."""


Count = Callable[[Mapping[str, Any]], float]
"""Billions of operations of an architecture."""


def compared(
    name: str, path: Path, *, split: LabelledSplit | None, frames: int, threads: int, count: Count | None
) -> ComparedModel:
    """The row of a model.

    Args:
        path: of its file; one that ships, by name.
        split: what its accuracy is measured on; None leaves these cells empty.
        frames: how many are timed.
        threads: of one image; 0 takes one for each core.
        count: counts operations, which needs PyTorch; None leaves the cell empty.

    Raises:
        PaveTwinError: the file is not a model, or a picture of the split cannot be read.
    """
    path = model_path(path)
    detector = Detector(path, threads=threads)
    gflops = count(detector.facts.architecture) if count is not None and detector.facts.architecture else None
    accuracy = _NOT_MEASURED
    if split is not None:
        accuracy = _accuracy(Detector(path, confidence=LEAST_CONFIDENCE, threads=threads), split)
    return ComparedModel(name, *accuracy, path.stat().st_size / 1e6, frames_per_s(detector, frames), gflops)


def compared_ultralytics(
    name: str,
    given: str | Path,
    *,
    split: LabelledSplit | None,
    frames: int,
    threads: int,
    count: Callable[[Any], float],
) -> ComparedModel:
    """The row of a network of Ultralytics: see `open_ultralytics`.

    Args:
        given: the name of an untrained network, or a file of weights; only that has an accuracy.
        threads: of one image; 0 takes one for each core.
        count: billions of operations of a network of PyTorch.

    Raises:
        PaveTwinError: as `open_ultralytics` does, or a picture of the split cannot be read.
    """
    detector = open_ultralytics(given, confidence=CONFIDENCE, image_px=max(FRAME_PX))
    # By default the package leaves one core unused.
    torch: Any = import_module("torch")
    torch.set_num_threads(threads or os.cpu_count() or 1)
    # Before the first prediction, which joins batch normalisation and convolutions.
    size_mb, gflops = detector.size_mb, count(detector.model.model)
    accuracy = _NOT_MEASURED
    if split is not None and isinstance(given, Path):
        accuracy = _accuracy(open_ultralytics(given, confidence=LEAST_CONFIDENCE, image_px=0), split)
    return ComparedModel(name, *accuracy, size_mb, frames_per_s(detector, frames), gflops)


Accuracy = tuple[float | None, float | None, float | None, float | None]

_NOT_MEASURED: Final[Accuracy] = (None, None, None, None)


def _accuracy(detector: Detects, split: LabelledSplit) -> Accuracy:
    """mAP@0.5, mAP@0.5:0.95, precision and recall."""
    intervals = evaluate(split, found_by(detector, (split,)), resamples=0).intervals
    values = (intervals[key].value for key in ("map50", "map50_95", "precision", "recall"))
    one, two, three, four = (None if np.isnan(value) else value for value in values)
    return one, two, three, four


def frames_per_s(detector: Detects, frames: int) -> float:
    """The inverse of the median time of an image of `FRAME_PX`, `timed_picture`."""
    picture = timed_picture()
    times = []
    for number in range(_UNCOUNTED + frames):
        start = perf_counter()
        detector.detect([picture])
        if number >= _UNCOUNTED:
            times.append(perf_counter() - start)
    return 1 / median(times)


def timed_picture() -> UInt8Array:
    """Pavement with potholes and a crack, in which every detector that ships finds some: heads that look at regions
    take no time where nothing is found."""
    rng = np.random.default_rng(0)
    width, height = FRAME_PX
    y, x = np.mgrid[:height, :width]
    pixels = 105 + rng.normal(0, 10, (height, width))
    for across, down, radius in ((130, 130, 46), (500, 120, 34), (420, 380, 55)):
        angle, away = np.arctan2(y - down, x - across), np.hypot(x - across, y - down)
        edge = radius * (1 + 0.12 * np.sin(3 * angle + across) + 0.07 * np.sin(7 * angle + down))
        inside = away < edge
        pixels[inside] = 70 + rng.normal(0, 16, inside.sum())
        pixels[inside & (away > edge - 8) & (x < across)] = 35
    crack = 250 + 0.15 * np.arange(height) + rng.normal(0, 0.9, height).cumsum()
    pixels[np.abs(x - crack[:, None]) < 2] = 40
    return np.clip(pixels, 0, 255).astype(np.uint8)[:, :, None].repeat(3, axis=2)


def with_speeds(rows: Sequence[ComparedModel], name: str) -> list[ComparedModel]:
    """The rows with their speed as a multiple of that of one of them; without it where there is none of the name."""
    base = next((row.frames_per_s for row in rows if row.name == name), None)
    return [replace(row, speed=row.frames_per_s / base) for row in rows] if base else list(rows)


def processor() -> str:
    """The name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


HEADINGS: Final = ("model", "mAP@0.5", "mAP@0.5:0.95", "precision", "recall", "size, MB", "FPS", "FPS, n = 1", "GFLOPs")


def cells(row: ComparedModel) -> tuple[str, ...]:
    """Cells of a row: accuracies in per cent, empty where not measured."""
    shares = (
        "" if each is None else f"{100 * each:.1f}" for each in (row.map50, row.map50_95, row.precision, row.recall)
    )
    speed = "" if row.speed is None else f"{row.speed:.2f}"
    gflops = "" if row.gflops is None else f"{row.gflops:.1f}"
    return (row.name, *shares, f"{row.size_mb:.1f}", f"{row.frames_per_s:.1f}", speed, gflops)


def as_csv(rows: Sequence[ComparedModel]) -> str:
    """The table as a file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([HEADINGS, *map(cells, rows)])
    return text.getvalue()
