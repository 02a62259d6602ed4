"""What image i of a platform must show, computed from the seed, the platform and i only.

Each factor follows its own low-discrepancy sequence frac(start + i·√p) with its own prime p: each share holds in any
run of images, and for any combination of factors (Kronecker, Weyl). So the first 100 images of a dataset of 200 are the
dataset of 100, and a dataset of two platforms is that of the one and that of the other.
"""

from math import sqrt
from typing import Final, TypeVar
from zlib import crc32

import numpy as np

from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.names import image_name, platform_prefix
from pavetwin.capture.platforms import PLATFORMS
from pavetwin.capture.resolution import drawn_gsd_mm
from pavetwin.capture.settings import CaptureSettings
from pavetwin.labels import SPLITS
from pavetwin.labels.classes import Category, category_of_defect
from pavetwin.seeds import Stream, child
from pavetwin.world.model import World

PLAN, STREETS, SAMPLE = 0, 1, 2
"""Keys of the stream CAPTURE."""

_PRIMES: Final = (2, 3, 5, 7, 11, 13)

T = TypeVar("T")


def image_specs(settings: CaptureSettings, world: World, platform: str, count: int, start: int = 0) -> list[ImageSpec]:
    """The specs of a platform's images `start` … `start + count − 1`."""
    aims = aims_of(world)
    starts = child(settings.seed, Stream.CAPTURE, PLAN, platform_key(platform)).random(len(_PRIMES))
    steps = np.array([sqrt(prime) for prime in _PRIMES])
    draws = (starts + np.arange(start, start + count)[:, None] * steps) % 1.0
    prefix = platform_prefix(world, settings, platform)
    return [_spec(settings, aims, platform, prefix, start + row, draw.tolist()) for row, draw in enumerate(draws)]


def platform_key(platform: str) -> int:
    """Key of a platform's random streams."""
    return crc32(platform.encode())


def aims_of(world: World) -> list[Category]:
    """The classes of the world's defects."""
    return [category_of_defect(kind) for kind in sorted({defect.kind for defect in world.defects})]


def _spec(
    settings: CaptureSettings, aims: list[Category], platform: str, prefix: str, index: int, draw: list[float]
) -> ImageSpec:
    open_splits = [split for split, share in enumerate(settings.split) if share > 0]
    reached = np.cumsum([settings.split[split] for split in open_splits])[:-1]
    is_empty = not aims or draw[1] < settings.empty
    flies = PLATFORMS.get(platform).uses_altitude
    return ImageSpec(
        platform=platform,
        index=index,
        number=index * len(settings.platforms) + settings.platforms.index(platform),
        name=image_name(prefix, index),
        split=SPLITS[open_splits[int(np.searchsorted(reached, draw[0], side="right"))]],
        aims=() if is_empty else (_pick(aims, draw[2]),),
        density=_pick(list(settings.densities), draw[3]),
        altitude_m=_pick(list(settings.altitudes_m), draw[4]) if flies and settings.altitudes_m else None,
        gsd_mm=drawn_gsd_mm(settings.gsd_mm, draw[4]) if flies and settings.gsd_mm else None,
        share=draw[5],
    )


def _pick(choices: list[T], share: float) -> T:
    return choices[min(int(share * len(choices)), len(choices) - 1)]
