"""Models side by side: how good they are where that was measured, how large, and how fast on this machine."""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, Final

import numpy as np

from pavetwin.arrays import UInt8Array
from pavetwin.perception.evaluation.evaluate import evaluate
from pavetwin.perception.evaluation.labelled import LabelledSplit
from pavetwin.perception.evaluation.running import LEAST_CONFIDENCE, found_by
from pavetwin.perception.inference.detector import Detector

FRAME_PX: Final = (640, 480)
"""Width and height of the image that is timed: the paper's frame, scaled."""

GFLOPS_PX: Final = (640, 640)
"""Of the image whose operations are counted, as published figures do."""

_UNCOUNTED: Final = 3
"""Runs before the time counts: the first ones reserve memory."""


@dataclass(frozen=True, slots=True)
class ComparedModel:
    """One row. What was not measured is None, and an empty cell."""

    name: str
    map50: float | None
    """The four accuracies are shares, of the five classes; precision and recall are macro, at confidence 0.25."""
    map50_95: float | None
    precision: float | None
    recall: float | None
    size_mb: float
    """Of the file."""
    frames_per_s: float
    """Of one image of `FRAME_PX`, from pixels to detections: the median time."""
    gflops: float | None
    """Of convolutions, for one image of `GFLOPS_PX`."""


Count = Callable[[Mapping[str, Any]], float]
"""Billions of operations of an architecture."""


def compared(
    name: str, path: Path, *, split: LabelledSplit | None, frames: int, threads: int, count: Count | None
) -> ComparedModel:
    """The row of a model's file.

    Args:
        split: what its accuracy is measured on; None leaves these cells empty.
        frames: how many are timed.
        threads: of one image; 0 takes one for each core.
        count: counts operations, which needs PyTorch; None leaves the cell empty.

    Raises:
        PaveTwinError: the file is no model, or a picture of the split cannot be read.
    """
    detector = Detector(path, threads=threads, image_px=max(FRAME_PX))
    gflops = count(detector.facts.architecture) if count is not None and detector.facts.architecture else None
    accuracy = (None, None, None, None)
    if split is not None:
        found = found_by(Detector(path, confidence=LEAST_CONFIDENCE, threads=threads), (split,))
        told = evaluate(split, found, resamples=0).intervals
        accuracy = tuple(  # type: ignore[assignment]
            None if np.isnan(told[key].value) else told[key].value
            for key in ("map50", "map50_95", "precision", "recall")
        )
    speed = frames_per_s(detector, frames)
    return ComparedModel(name, *accuracy, path.stat().st_size / 1e6, speed, gflops)


def frames_per_s(detector: Detector, frames: int) -> float:
    """The inverse of the median time of an image of `FRAME_PX` with structures of all sizes."""
    picture = _picture()
    times = []
    for number in range(_UNCOUNTED + frames):
        start = perf_counter()
        detector.detect([picture])
        if number >= _UNCOUNTED:
            times.append(perf_counter() - start)
    return 1 / median(times)


def _picture() -> UInt8Array:
    rng = np.random.default_rng(0)
    width, height = FRAME_PX
    coarse = rng.integers(60, 200, (height // 40, width // 40, 3)).repeat(40, 0).repeat(40, 1)
    return np.clip(coarse + rng.normal(0, 12, (height, width, 3)), 0, 255).astype(np.uint8)


HEADINGS: Final = ("model", "mAP@0.5", "mAP@0.5:0.95", "precision", "recall", "size, MB", "FPS", "GFLOPs")


def cells(row: ComparedModel) -> tuple[str, ...]:
    """As a table shows them: accuracies in per cent, and nothing for what was not measured."""
    shares = (
        "" if each is None else f"{100 * each:.1f}" for each in (row.map50, row.map50_95, row.precision, row.recall)
    )
    gflops = "" if row.gflops is None else f"{row.gflops:.1f}"
    return (row.name, *shares, f"{row.size_mb:.1f}", f"{row.frames_per_s:.1f}", gflops)


def as_csv(rows: Sequence[ComparedModel]) -> str:
    """The table as a file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([HEADINGS, *map(cells, rows)])
    return text.getvalue()
