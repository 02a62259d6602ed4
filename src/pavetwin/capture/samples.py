"""From an image spec to a camera pose and light: drawn until one can meet the spec, or until it is relaxed."""

from dataclasses import dataclass, replace
from typing import Final

from pavetwin.capture.daylight import Daylight, centre_lonlat, draw_compensation_ev, draw_conditions
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.parked_bodies import ParkedBodies
from pavetwin.capture.plan import SAMPLE, aims_of, platform_key
from pavetwin.capture.platforms import Platform, Pose
from pavetwin.config import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child

PROPOSALS: Final = 300
"""Poses that are checked by geometry for one attempt at an image."""

STRICT, EASIER, ANYWHERE = 8, 8, 24
"""Attempts at a spec as it is; then for any class of defects (or for no defect, from any altitude); then for any class
from any altitude."""


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
            "choose another altitude, a larger `size_px`, other `split` shares, or a world with more defects."
        )
    if attempt < STRICT:
        return spec
    anything = replace(spec, aims=tuple(aims_of(platform.context.world)))
    if spec.altitude_m is None:
        return anything
    heights = platform.context.settings.altitudes_m
    height = heights[(attempt - STRICT) % len(heights)]
    if attempt >= STRICT + EASIER:
        return replace(anything, altitude_m=height)
    return anything if spec.aims else replace(spec, altitude_m=height)


def next_attempt(spec: ImageSpec, attempt: int, sample: CameraSample | None) -> int:
    """The attempt after a failed one. If no pose was found for it, the next stage of relaxation follows at once.

    Args:
        spec: as requested at first.
    """
    stages = (STRICT, STRICT + EASIER) if spec.aims else (STRICT,)
    return attempt + 1 if sample is not None else next((stage for stage in stages if attempt < stage), attempt + 1)
