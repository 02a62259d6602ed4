"""The rules of defect classes, tried on shapes of many seeds: what is asked of a user's own, and tests of all."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from math import cos, isfinite, sin
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely import affinity

from pavetwin.defects.heightfield import Heightfield
from pavetwin.defects.measures import Measures, measure
from pavetwin.defects.poses import RoadSection
from pavetwin.errors import told_at
from pavetwin.world.model import Severity

if TYPE_CHECKING:
    from pavetwin.defects.registry import DefectKind

SHAPES = 50
SHAPES_WHEN_READ = 2
"""Tried whenever a plugin is read, also by each worker process."""

ROOM_FROM = 20
"""With fewer shapes nothing is said about whether they find room."""

LARGEST_M, DEEPEST_M = 15.0, 0.5
"""A larger shape is a street rather than a defect of it."""

ROADS = (RoadSection(100.0, 7.0, 2), RoadSection(20.0, 3.0, 1), RoadSection(135.0, 14.0, 4))
"""What poses are asked for: an ordinary road, which is also where room is looked for, a short lane, a wide street."""
POSES, EDGE_M = 30, 0.05

_NAMED_SEEDS = 3


@dataclass(frozen=True)
class TriedShape:
    """One shape of a class and what the class says of it."""

    measures: Measures
    width_m: float
    length_m: float
    severity: Severity
    has_room: bool
    """Whether a pose was proposed at which it lies on a straight road of two lanes, 7 m wide."""


class _Broken:
    """The rules that were broken, each with the seeds that broke it."""

    def __init__(self) -> None:
        self._seeds: dict[str, list[int]] = {}

    def add(self, rule: str, seed: int) -> None:
        self._seeds.setdefault(rule, []).append(seed)

    def sentences(self) -> list[str]:
        return [f"{rule} ({_seeds_text(seeds)})" if seeds else rule for rule, seeds in self._seeds.items()]

    def say(self, rule: str) -> None:
        self._seeds.setdefault(rule, [])


def check_defect_class(kind: "DefectKind", shapes: int = SHAPES) -> list[str]:
    """The rules that a class breaks, each as a sentence; none for one that keeps them.

    Equal generators must give equal shapes, poses and stains. A shape is a `Heightfield` of finite heights around the
    origin, at most 15 m long and 0.5 m deep, flat outside its outline, which keeps clear of the field's border. Its
    width and length are positive and no more than it can hold; its severity is a `Severity`. Poses are (count, 3),
    finite, the first share within 0 … 1, and some shape finds room on a straight road.
    """
    return tried(kind, shapes)[1]


def tried(kind: "DefectKind", shapes: int = SHAPES) -> tuple[list[TriedShape], list[str]]:
    """The shapes of the first seeds, and the rules that they break."""
    broken = _Broken()
    _check_label(kind, broken)
    trials = [trial for seed in range(shapes) if (trial := _trial(kind, seed, broken)) is not None]
    if len(trials) >= ROOM_FROM and not any(trial.has_room for trial in trials):
        broken.say(
            f"none of {len(trials)} shapes finds room on a straight road of two lanes, {ROADS[0].width_m:g} m wide"
        )
    return trials, broken.sentences()


def _check_label(kind: "DefectKind", broken: _Broken) -> None:
    values = {each.name: getattr(kind.label, each.name) for each in fields(kind.label)}
    wrong = [f"{name}={value!r}" for name, value in values.items() if not _is_number(value) or value < 0]
    if wrong:
        broken.say(f"its label rule has {', '.join(wrong)}: give numbers from 0 on")
    elif kind.label.least_short_side_px > kind.label.least_side_px:
        broken.say("its label rule asks for a shorter side that is longer than the longer side")


def _trial(kind: "DefectKind", seed: int, broken: _Broken) -> TriedShape | None:
    """What is known of the shape of a seed; None where it cannot be measured."""

    def call(what: str, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except Exception as error:
            broken.add(f"{what} fails: {told_at(error)}", seed)
            return None

    shape, again = (call("its function", kind.generate, np.random.default_rng(seed)) for _ in range(2))
    if shape is None or again is None:
        return None
    if not isinstance(shape, Heightfield):
        broken.add(f"its function gives {type(shape).__name__}, not a Heightfield", seed)
        return None
    sizes = call("its outline", measure, shape)
    if sizes is None:
        return None
    for rule in (*_wrong_shape(shape, sizes), *_wrong_again(shape, again, call)):
        broken.add(rule, seed)
    width, length = call("`width`", kind.width, sizes), call("`length`", kind.length, sizes)
    severity = call("`rate`", kind.rate, sizes)
    if severity is not None and not isinstance(severity, Severity):
        broken.add(f"`rate` gives {severity!r}, not a Severity", seed)
    for name, value, most in (("width", width, sizes.extent_length_m), ("length", length, np.inf)):
        if value is not None and not (_is_number(value) and 0 <= value <= most + 1e-9):
            limit = "" if most == np.inf else f" and at most its extent of {most:.2f} m"
            broken.add(f"`{name}` gives {value!r}: it must be a finite number of metres from 0 on{limit}", seed)
    has_room, *_ = [_room(kind, shape, road, seed, broken, call) for road in ROADS]
    if not (_is_number(width) and _is_number(length) and isinstance(severity, Severity)):
        return None
    return TriedShape(sizes, float(width), float(length), severity, has_room)


def _wrong_shape(shape: Heightfield, sizes: Measures) -> Iterator[str]:
    """What is wrong with a shape by itself."""
    if not np.isfinite(shape.height_m).all():
        yield "its heights are not finite"
    if not shape.outline.envelope.contains(shapely.Point(0, 0)):
        yield "its outline does not lie around the origin"
    mask = shape.mask
    if mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any():
        yield "its outline reaches the border of the field: leave some intact road around it"
    if (shape.height_m[~mask] != 0).any() or (shape.opening[~mask] != 0).any():
        yield "it changes the road outside its outline: give back the heightfield's `settled()`"
    if sizes.extent_length_m > LARGEST_M:
        yield f"it is longer than {LARGEST_M:g} m"
    if not 0 < sizes.depth_m <= DEEPEST_M:
        yield f"it is not deeper than 0 and at most {DEEPEST_M:g} m deep"


def _wrong_again(shape: Heightfield, again: object, call: Callable[..., Any]) -> Iterator[str]:
    """Where two shapes of equal generators differ."""
    if not isinstance(again, Heightfield) or not _same(shape, again, ("height_m", "opening", "exposed")):
        yield "equal generators give different shapes"
        return
    stains, others = (call("its `paint`", lambda field=field: field.stains) for field in (shape, again))
    if stains is not None and others is not None and not _same(stains, others, ("dirt", "dust", "stone", "tone")):
        yield "its `paint` gives different stains at one generator"


def _same(one: object, other: object, names: tuple[str, ...]) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def _room(
    kind: "DefectKind", shape: Heightfield, road: RoadSection, seed: int, broken: _Broken, call: Callable[..., Any]
) -> bool:
    """Whether a shape lies whole on a straight road at one of the poses that are proposed for it."""
    poses, again = (
        call("`sample_poses`", kind.sample_poses, np.random.default_rng(seed), road, POSES) for _ in range(2)
    )
    if poses is None or again is None:
        return False
    found = np.asarray(poses)
    if found.shape != (POSES, 3) or found.dtype.kind != "f" or not np.isfinite(found).all():
        broken.add(f"`sample_poses` gives {_array_text(found)}, not finite numbers of shape (count, 3)", seed)
        return False
    if not np.array_equal(found, np.asarray(again)):
        broken.add("`sample_poses` proposes different poses with equal generators", seed)
    if not ((found[:, 0] >= 0) & (found[:, 0] <= 1)).all():
        broken.add("`sample_poses` gives shares of the road's length that are not within 0 … 1", seed)
    half = road.width_m / 2 - EDGE_M
    surface = shapely.box(0.0, -half, road.length_m, half)
    return any(
        surface.contains(affinity.affine_transform(shape.outline, _transform(along * road.length_m, offset, turn)))
        for along, offset, turn in found.tolist()
    )


def _transform(x: float, y: float, turn: float) -> list[float]:
    return [cos(turn), -sin(turn), sin(turn), cos(turn), x, y]


def _array_text(found: "np.ndarray[Any, Any]") -> str:
    return f"{found.dtype} of shape {found.shape}"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and isfinite(value)


def _seeds_text(seeds: list[int]) -> str:
    named = ", ".join(map(str, seeds[:_NAMED_SEEDS]))
    more = f" and {len(seeds) - _NAMED_SEEDS} more" if len(seeds) > _NAMED_SEEDS else ""
    return f"seed{'s' * (len(seeds) > 1)} {named}{more}"
