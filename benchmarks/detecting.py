"""How long the detector that ships takes with one frame, from its file to the result."""

import os
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from PIL import Image

from benchmarks.measure import Kind, Line, Size
from pavetwin.perception.detector import Detector
from pavetwin.perception.model_file import DEFAULT

PICTURE: Final = Path(__file__).resolve().parent.parent / "docs/gallery/uav.jpg"
"""Of frames from above, with defects, vehicles and people in it."""
FRAME_PX: Final = (640, 480)
TARGET_S: Final = 0.035
"""For one frame on two cores, as aimed at; 60 ms are required."""


def lines(folder: Path, size: Size) -> Iterator[Line]:
    """The frame seen whole, in tiles as it is by default, and scaled down to the size that the network learned from."""
    frame = folder / "frame.jpg"
    width, height = FRAME_PX
    with Image.open(PICTURE) as picture:
        picture.crop((0, 0, width, height)).save(frame, quality=90)
    ways = {
        f"seen whole at {width} px": Detector(DEFAULT, tiled=False, image_px=width),
        "as by default": Detector(DEFAULT),
        "seen whole at the size of training": Detector(DEFAULT, tiled=False),
    }
    for (way, detector), target_s in zip(ways.items(), (TARGET_S, None, None), strict=True):
        found = len(detector.detect([frame])[0])  # the first one does not count
        walls, processors = [], []
        for _ in range(size.runs):
            begun, used = time.perf_counter(), time.process_time()
            detector.detect([frame])
            walls.append(time.perf_counter() - begun)
            processors.append(time.process_time() - used)
        note = f"decoding and masks included; {os.cpu_count()} cores, processor time of all "
        note += f"{1000 * statistics.median(processors):.0f} ms; {found} detections"
        what = f"the detector, a frame of {width} × {height} px {way}"
        yield Line(what, statistics.median(walls), Kind.SECONDS, target_s, note=note)
