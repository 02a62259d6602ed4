"""From a wish to an image's pose and light: drawn anew until the place suits, or given up."""

from dataclasses import dataclass, replace
from typing import Final

from pavetwin.capture.daylight import Daylight, base_lonlat, draw_compensation_ev, draw_conditions
from pavetwin.capture.plan import SAMPLE, ImageSpec, aims_of
from pavetwin.capture.platforms import Platform, Pose
from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child

PROPOSALS: Final = 300
"""Poses that are looked at, by geometry, for one image."""

STRICT, EASIER, ANYWHERE = 8, 8, 24
"""Attempts at a wish as it is; then at any class of defects, or at none from any of the altitudes; then at any class
from any of them."""


@dataclass(frozen=True)
class CameraSample:
    """One image to take."""

    spec: ImageSpec
    attempt: int
    pose: Pose
    daylight: Daylight


def draw_sample(platform: Platform, spec: ImageSpec, attempt: int) -> CameraSample | None:
    """The n-th attempt at a wish, from the seed, the image's index and n alone; None when no place suits."""
    setting = platform.setting
    if spec.aims and not len(setting.sight.wanted(spec)):
        return None
    rng = child(setting.settings.seed, Stream.CAPTURE, SAMPLE, spec.index, attempt)
    conditions = draw_conditions(rng, *base_lonlat(setting.world))
    daylight = Daylight.of(conditions, setting.world, draw_compensation_ev(rng))
    for _ in range(PROPOSALS):
        pose = platform.propose(spec, rng)
        if pose is not None and setting.sight.suits(pose.view, spec):
            return CameraSample(spec, attempt, pose, daylight)
    return None


def relaxed(platform: Platform, spec: ImageSpec, attempt: int) -> ImageSpec:
    """What is wished at the n-th attempt: after some any class of defects will do, or any altitude where none is to be
    seen, and at last both.

    Raises:
        PaveTwinError: there have been enough attempts.
    """
    if attempt >= STRICT + EASIER + ANYWHERE:
        raise PaveTwinError(
            f"Image {spec.index}: no place was found on the streets of {spec.split} where a defect can be seen; "
            "choose another altitude, a larger --size, other --split shares, or a world with more defects."
        )
    if attempt < STRICT:
        return spec
    anything = replace(spec, aims=tuple(aims_of(platform.setting.world)))
    heights = platform.setting.settings.altitudes_m
    if not heights:
        return anything
    height = heights[(attempt - STRICT) % len(heights)]
    if attempt >= STRICT + EASIER:
        return replace(anything, altitude_m=height)
    return anything if spec.aims else replace(spec, altitude_m=height)


def next_attempt(spec: ImageSpec, attempt: int, sample: CameraSample | None) -> int:
    """The attempt after one that came to nothing. Where no place was found for it, none is looked for again until what
    is wished becomes easier.

    Args:
        wish: as it was at first.
    """
    stages = (STRICT, STRICT + EASIER) if spec.aims else (STRICT,)
    return attempt + 1 if sample is not None else next((stage for stage in stages if attempt < stage), attempt + 1)
