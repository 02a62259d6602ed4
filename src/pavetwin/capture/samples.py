"""Image specs and camera samples of a dataset: what image i must show, its name, and a pose and light that can meet it.

Spec i depends only on the seed, the platform and i. Each factor follows its own low-discrepancy sequence
frac(start + i·√p) with its own prime p: each share holds in any run of images, and for any combination of factors
(Kronecker, Weyl). So the first 100 images of a dataset of 200 are the dataset of 100, and a dataset of two platforms is
the union of the datasets of each.

Poses are drawn until one can meet the spec, or until the spec is relaxed. Names of image files state their origin, and
no two datasets give different images the same name.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar
from zlib import crc32

import numpy as np
import shapely

from pavetwin.arrays import GeometryArray, IndexArray
from pavetwin.capture.daylight import Daylight, draw_compensation_ev, draw_conditions
from pavetwin.capture.image_spec import DefectIndex, ImageSpec, drawn_gsd_mm
from pavetwin.capture.platforms import PLATFORMS, Platform, Pose
from pavetwin.capture.settings import CaptureSettings, parking_in
from pavetwin.config import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.labels import SPLITS
from pavetwin.labels.classes import Category, category_of_defect
from pavetwin.plugins import plugin_hashes
from pavetwin.scene.light import centre_lonlat
from pavetwin.seeds import Stream, child
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.world.model import World
from pavetwin.world.solids import Solids, parked_boxes

if TYPE_CHECKING:
    from pavetwin._core import Trace


def platform_prefix(world: World, settings: CaptureSettings, platform: str) -> str:
    """Prefix of a platform's image names: `town-s1-uav-3f9c2a81`.

    Neither the number of images nor the other platforms and label formats of a dataset change it.
    """
    others = {"images", "platforms", "formats", "plugins"}
    if not PLATFORMS.get(platform).uses_altitude:
        others |= {"altitudes_m", "camera", "gsd_mm"}
    if settings.gsd_mm is None:
        others |= {"gsd_mm"}
    if not parking_in(settings, world).enabled:
        others |= {"parking"}
    made_from = settings.model_dump(mode="json", exclude=others)
    made_from["plugins"] = sorted(plugin_hashes(settings.plugins).values())
    return prefix(world, settings.seed, platform, made_from)


def prefix(world: World, seed: int, taken_by: str, made_from: Mapping[str, Any]) -> str:
    """World, seed, what took the images, and the beginning of a hash of the world and all that they are made from."""
    content = [world.content_hash, world.defects_hash, seed, taken_by, dict(made_from)]
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:8]
    name = re.sub(r"[^A-Za-z0-9]+", "-", world.name).strip("-")[:40] or "world"
    return f"{name}-s{seed}-{taken_by}-{digest}"


def image_name(prefix: str, index: int) -> str:
    """Name of the n-th image with a prefix, without the file's suffix."""
    return f"{prefix}-{index:06d}"


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


REACH_M = 20.0  # Only what stands this near to a vehicle may overlap it


@dataclass(frozen=True)
class ParkedBodies:
    """Parked vehicles and their outlines."""

    vehicles: ParkedVehicles
    outlines: shapely.STRtree

    @classmethod
    def of(cls, parked: ParkedVehicles) -> Self:
        """Index all parked vehicles of an image's world."""
        xy = np.column_stack([parked.x, parked.y])
        boxes = parked_boxes(xy, parked.yaw_rad, parked.length_m, parked.width_m, parked.height_m)
        return cls(parked, shapely.STRtree(_outlines(boxes)))

    def covered(self, defects: DefectIndex) -> IndexArray:
        """The defects whose centre lies below a parked vehicle."""
        if not len(self.vehicles):
            return np.zeros(0, dtype=np.intp)
        under, _ = self.outlines.query(shapely.points(defects.centres[:, :2]), predicate="intersects")
        return np.unique(under)

    def overlap(self, pose: Pose, trace: "Trace") -> bool:
        """Return whether the vehicle that carries the camera would overlap one of them."""
        if pose.ego is None or not len(self.vehicles):
            return False
        x, y, _ = pose.view.position.tolist()
        poses = trace.agents_near(x, y, REACH_M, pose.time_s)
        own = poses["agent"] == pose.ego
        xy = np.column_stack([poses["x_m"][own], poses["y_m"][own]])
        size = (poses[name][own] for name in ("length_m", "width_m", "height_m"))
        body = _outlines(parked_boxes(xy, poses["yaw_rad"][own], *size))
        return bool(self.outlines.query(body, predicate="intersects").size)


def _outlines(boxes: Solids) -> GeometryArray:
    return np.asarray(shapely.polygons(boxes.xy.reshape(-1, 4, 2)), dtype=object)


PROPOSALS: Final = 300  # Poses that are checked by geometry for one attempt at an image

STRICT, EASIER, ANYWHERE = 8, 8, 24
"""Attempts at a spec as it is; then for any class of defects (or for no defect, from any altitude); then for any class
from any altitude."""


_GOLDEN: Final = 0.6180339887  # Its multiples modulo 1 fill the range evenly


@dataclass(frozen=True)
class CameraSample:
    """One image to take."""

    spec: ImageSpec
    attempt: int
    pose: Pose
    daylight: Daylight
    conditions: Conditions


def draw_sample(platform: Platform, spec: ImageSpec, attempt: int) -> CameraSample | None:
    """The n-th attempt at a spec, which the seed, the platform, the image's index and n determine; None if no pose can
    meet it."""
    context = platform.context
    if spec.aims and not len(context.defect_index.candidates(spec)):
        return None
    rng = child(context.settings.seed, Stream.CAPTURE, SAMPLE, platform_key(spec.platform), spec.index, attempt)
    conditions = draw_conditions(rng, *centre_lonlat(context.world))
    daylight = Daylight.of(conditions, context.world, draw_compensation_ev(rng))
    parked = ParkedBodies.of(context.parked(conditions, spec.density))
    covered = parked.covered(context.defect_index)
    for _ in range(PROPOSALS):
        pose = platform.propose(spec, rng)
        if pose is None or not context.defect_index.may_show(pose.view, spec, covered):
            continue
        if not parked.overlap(pose, context.traces[spec.density]):
            return CameraSample(spec, attempt, pose, daylight, conditions)
    return None


def relaxed(platform: Platform, spec: ImageSpec, attempt: int) -> ImageSpec:
    """The spec of the n-th attempt: first as requested, then relaxed to any class of defects (or to any altitude where
    no defect may be seen), at last to both.

    Raises:
        PaveTwinError: no attempts are left.
    """
    if attempt >= STRICT + EASIER + ANYWHERE:
        raise PaveTwinError(
            f"Image {spec.name}: no place was found on the streets of {spec.split} where a defect can be seen; "
            "choose another altitude or ground resolution, a larger `size_px`, other `split` shares, or a world with "
            "more defects."
        )
    if attempt < STRICT:
        return spec
    any_class = tuple(aims_of(platform.context.world))
    if attempt >= STRICT + EASIER:
        return replace(_from_elsewhere(platform, spec, attempt), aims=any_class)
    flies = spec.altitude_m is not None or spec.gsd_mm is not None
    return replace(spec, aims=any_class) if spec.aims or not flies else _from_elsewhere(platform, spec, attempt)


def _from_elsewhere(platform: Platform, spec: ImageSpec, attempt: int) -> ImageSpec:
    """A spec at another of the altitudes or ground resolutions."""
    settings, turn = platform.context.settings, attempt - STRICT
    if spec.gsd_mm is not None and settings.gsd_mm is not None:
        return replace(spec, gsd_mm=drawn_gsd_mm(settings.gsd_mm, (spec.share + turn * _GOLDEN) % 1.0))
    if spec.altitude_m is not None:
        return replace(spec, altitude_m=settings.altitudes_m[turn % len(settings.altitudes_m)])
    return spec


def next_attempt(spec: ImageSpec, attempt: int, sample: CameraSample | None) -> int:
    """The attempt after a failed one. If no pose was found for it, the next stage of relaxation follows at once.

    Args:
        spec: as requested at first.
    """
    stages = (STRICT, STRICT + EASIER) if spec.aims else (STRICT,)
    return attempt + 1 if sample is not None else next((stage for stage in stages if attempt < stage), attempt + 1)
