"""How many views a second the detector learns from on this machine's processor."""

import json
import statistics
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from PIL import Image

from benchmarks.detecting import PICTURE
from benchmarks.measure import Kind, Line, Size
from pavetwin.labels.class_names import CLASS_LABELS
from pavetwin.training.datasets.packs import read_examples
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions

if TYPE_CHECKING:
    from pavetwin.training.trainer.run_folder import Curves
    from pavetwin.training.trainer.schedule import Phase

OBJECTS: Final = 10
"""Labelled in an image: more than the 1.9 of the synthetic test images (1,278 in 688), since a mosaic shows four."""
UNCOUNTED: Final = 2
"""Steps at the start, in which memory is taken and convolutions are chosen."""


def lines(folder: Path, size: Size) -> Iterator[Line]:
    """Steps of training in the precision that is faster here and in single precision; no time where PyTorch is not
    installed, or where the processor has no instructions for bfloat16."""
    dataset = _drawn(folder / "learned", size.frame_px)
    for half in (True, False):
        precision = "bfloat16" if half else "single precision"
        what = f"the detector, training on views of {size.frame_px[0]} px in {precision}"
        took_s = _step_s(dataset, folder / f"run-{half:d}", size, half) if find_spec("torch") is not None else None
        if took_s is None:
            yield Line(what, None, Kind.PER_SECOND)
            continue
        note = f"size n, batches of {size.batch}; views, losses, steps and moving average included"
        yield Line(what, size.batch / took_s, Kind.PER_SECOND, took_s=took_s, note=note)


def _drawn(folder: Path, side_px: tuple[int, int]) -> Path:
    """A dataset of one image from above; its labels are not what is there, which takes as long to learn."""
    width, height = side_px
    for split in ("train", "val"):
        (folder / "images" / split).mkdir(parents=True)
        (folder / "annotations").mkdir(exist_ok=True)
        with Image.open(PICTURE) as picture:
            picture.crop((0, 0, width, height)).save(folder / "images" / split / "0.jpg", quality=92)
        wide, high = width / OBJECTS, height / 4
        boxes = [[at * wide + 1, (at % 4) * high + 1, wide - 2, high - 2] for at in range(OBJECTS)]
        rows = [
            {"id": at + 1, "image_id": 0, "category_id": at % len(CLASS_LABELS) + 1, "iscrowd": 0}
            | {"bbox": box, "area": box[2] * box[3], "segmentation": [_outline(box)]}
            for at, box in enumerate(boxes)
        ]
        content = {
            "info": {"description": "PaveTwin synthetic images"},
            "images": [{"id": 0, "file_name": "0.jpg", "width": width, "height": height}],
            "annotations": rows,
            "categories": [{"id": at + 1, "name": name} for at, name in enumerate(CLASS_LABELS)],
        }
        (folder / "annotations" / f"instances_{split}.json").write_text(json.dumps(content))
    return folder


def _outline(box: list[float]) -> list[float]:
    left, top, width, height = box
    return [left, top, left + width, top, left + width, top + height, left, top + height]


def _step_s(dataset: Path, folder: Path, size: Size, half: bool) -> float | None:
    """The median time of a step; None where bfloat16 is asked for and is not faster."""
    import torch

    from pavetwin.training.trainer.trainer import Trainer, has_half

    if half and not has_half(torch.device("cpu")):
        return None
    options = TrainingOptions(
        image_px=max(size.frame_px),
        batch=size.batch,
        repeats=size.batch * (size.runs + UNCOUNTED + 1),
        epochs=1,
        classifier_epochs=0,
        mosaic_off=0,
    )
    steps = _Steps()
    machine = TrainingMachine(device="cpu", half=half)
    Trainer(read_examples([dataset]), folder, options, machine, steps).run()
    times = [later - earlier for earlier, later in zip(steps.ended, steps.ended[1:], strict=False)]
    return statistics.median(times[UNCOUNTED:])


class _Steps:
    """When each step was done."""

    def __init__(self) -> None:
        self.ended: list[float] = []

    def on_start(self, where: str) -> None:
        """The steps begin."""

    def on_step(self, phase: "Phase", epoch: int, step: int, steps: int, total: float) -> None:  # noqa: ARG002
        """A step is done."""
        self.ended.append(time.perf_counter())

    def on_epoch(self, curves: "Curves") -> None:
        """The epoch is done."""
