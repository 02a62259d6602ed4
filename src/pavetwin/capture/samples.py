"""From an image spec to a camera pose and light: drawn until one can meet the spec, or until it is relaxed."""

from dataclasses import dataclass, replace
from typing import Final

from pavetwin.capture.daylight import Daylight, draw_compensation_ev, draw_conditions
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.parked_bodies import ParkedBodies
from pavetwin.capture.plan import SAMPLE, aims_of, platform_key
from pavetwin.capture.platforms import Platform, Pose
from pavetwin.capture.resolution import drawn_gsd_mm
from pavetwin.config import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.scene.light import centre_lonlat
from pavetwin.seeds import Stream, child

PROPOSALS: Final = 300
"""Poses that are checked by geometry for one attempt at an image."""

STRICT, EASIER, ANYWHERE = 8, 8, 24
"""Attempts at a spec as it is; then for any class of defects (or for no defect, from any altitude); then for any class
from any altitude."""


_GOLDEN: Final = 0.6180339887
"""Its multiples modulo 1 fill the range evenly."""


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
