"""What image i of a dataset must show, computed from the seed and i only.

Each factor follows its own low-discrepancy sequence frac(start + i·√p) with its own prime p: each share holds in any
run of images, and for any combination of factors (Kronecker, Weyl). So the first 100 images of a dataset of 200 are the
dataset of 100.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Final, TypeVar

import numpy as np

from pavetwin.capture.classes import Category, category_of_defect
from pavetwin.capture.settings import SPLITS, CaptureSettings
from pavetwin.seeds import Stream, child
from pavetwin.world.model import World

PLAN, STREETS, SAMPLE = 0, 1, 2
"""Keys of the stream CAPTURE."""

_PRIMES: Final = (2, 3, 5, 7, 11, 13)

T = TypeVar("T")


@dataclass(frozen=True)
class ImageSpec:
    """What one image must show, and in which conditions it is taken."""

    index: int
    split: str
    aims: tuple[Category, ...]
    """It must show one of these classes; empty: it must show no defect."""
    density: str
    altitude_m: float | None
    """Of the UAV."""
    share: float
    """0 … 1, from which the platform derives its own choices."""


def image_specs(settings: CaptureSettings, world: World, count: int, start: int = 0) -> list[ImageSpec]:
    """The specs of images `start` … `start + count − 1`."""
    aims = aims_of(world)
    starts = child(settings.seed, Stream.CAPTURE, PLAN).random(len(_PRIMES))
    steps = np.array([sqrt(prime) for prime in _PRIMES])
    draws = (starts + np.arange(start, start + count)[:, None] * steps) % 1.0
    return [_spec(settings, aims, start + row, draw.tolist()) for row, draw in enumerate(draws)]


def aims_of(world: World) -> list[Category]:
    """The classes of the world's defects."""
    return [category_of_defect(kind) for kind in sorted({defect.kind for defect in world.defects})]


def _spec(settings: CaptureSettings, aims: list[Category], index: int, draw: list[float]) -> ImageSpec:
    open_splits = [split for split, share in enumerate(settings.split) if share > 0]
    reached = np.cumsum([settings.split[split] for split in open_splits])[:-1]
    is_empty = not aims or draw[1] < settings.empty
    return ImageSpec(
        index=index,
        split=SPLITS[open_splits[int(np.searchsorted(reached, draw[0], side="right"))]],
        aims=() if is_empty else (_pick(aims, draw[2]),),
        density=_pick(list(settings.densities), draw[3]),
        altitude_m=_pick(list(settings.altitudes_m), draw[4]) if settings.altitudes_m else None,
        share=draw[5],
    )


def _pick(choices: list[T], share: float) -> T:
    return choices[min(int(share * len(choices)), len(choices) - 1)]
