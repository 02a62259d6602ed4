"""How fast photographs become images of a dataset: decoded, scaled, encoded and written."""

import time
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from benchmarks.measure import Kind, Line, Size
from pavetwin.training.datasets.importing import import_source
from pavetwin.training.datasets.resizing import ImageSize
from pavetwin.training.datasets.resuming import THREADS
from pavetwin.training.datasets.sources import source_of

SIZE_PX: Final = (1280, 960)
"""As the samples of UAV-PDD2023 have it."""

PER_SECOND: Final = 100.0
"""Images resized and written on two cores, as required."""

DIFFERENT: Final = 20
"""Images that are drawn; the others are these again."""


def line(folder: Path, size: Size) -> Line:
    """An import, from nothing."""
    photographs = _made(folder / "photographs", size.photographs)
    begun, used = time.perf_counter(), time.process_time()
    made = import_source(*source_of("highrpd"), photographs, folder / "imported", size=ImageSize())
    took_s, each_ms = time.perf_counter() - begun, 1000 * (time.process_time() - used) / made.images
    width, height = SIZE_PX
    return Line(
        f"photographs of {width} × {height} px resized to 640 and written",
        made.images / took_s,
        Kind.PER_SECOND,
        PER_SECOND,
        took_s=took_s,
        note=f"{made.images} photographs with a label each, {THREADS} threads; {each_ms:.0f} ms of a processor each",
    )


def _made(folder: Path, count: int) -> Path:
    """Photographs with grain as fine as asphalt has, so that JPEG takes as long as with real ones: 150 to 300 kB each.

    A photograph that is there again differs in its last byte, behind the end of its JPEG.
    """
    folder.mkdir()
    rng = np.random.default_rng(0)
    width, height = SIZE_PX
    contents = []
    for number in range(min(count, DIFFERENT)):
        coarse = Image.fromarray(rng.integers(90, 140, (12, 16), dtype=np.uint8)).resize(
            SIZE_PX, Image.Resampling.BICUBIC
        )
        grain = rng.normal(0.0, 7.0, (height, width))
        grey = np.clip(np.asarray(coarse) + grain, 0, 255).astype(np.uint8)
        path = folder / f"drawn-{number}.jpg"
        Image.merge("RGB", [Image.fromarray(grey)] * 3).save(path, quality=85)
        contents.append(path.read_bytes())
        path.unlink()
    for number in range(count):
        (folder / f"{number}.jpg").write_bytes(contents[number % len(contents)] + number.to_bytes(4, "big"))
        (folder / f"{number}.txt").write_text("0 0.5 0.5 0.5 0.5\n")
    return folder
