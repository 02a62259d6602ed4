"""Classes of defects, their registry, and their conformance rules. A new one is one file with one `@defect_class`.

The rules are tried on shapes of many seeds, for plugins and in tests of all classes.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import partial
from math import cos, isfinite, sin
from typing import Any

import numpy as np
import shapely
from shapely import affinity

from pavetwin.config.settings import Settings
from pavetwin.defects.heightfield import Heightfield
from pavetwin.defects.measures import Measures, length_of, measure
from pavetwin.defects.poses import PoseSampler, RoadSection
from pavetwin.defects.severity import Distress
from pavetwin.errors import PaveTwinError, describe_with_place
from pavetwin.registry import Registry
from pavetwin.world.model import Defect, Severity, ShapeParameters, is_class_name

SHAPES = 50
SHAPES_WHEN_READ = 2
"""Tried whenever a plugin is read, also by each worker process."""

ROOM_FROM = 20
"""Least number of shapes for the rule that some find room."""

LARGEST_M, DEEPEST_M = 15.0, 0.5
"""A larger shape is a street rather than a defect of it."""

ROADS = (RoadSection(100.0, 7.0, 2), RoadSection(20.0, 3.0, 1), RoadSection(135.0, 14.0, 4))
"""Roads to sample poses on: an ordinary one, on which shapes must also find room, a short lane, a wide street."""
POSES, EDGE_M = 30, 0.05

_NAMED_SEEDS = 3


@dataclass(frozen=True)
class TriedShape:
    """Shape of a class, with the measures and severity that the class gives it."""

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

    def add(self, rule: str, *seeds: int) -> None:
        self._seeds.setdefault(rule, []).extend(seeds)

    def sentences(self) -> list[str]:
        return [f"{rule} ({_seeds_text(seeds)})" if seeds else rule for rule, seeds in self._seeds.items()]


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
        broken.add(
            f"none of {len(trials)} shapes finds room on a straight road of two lanes, {ROADS[0].width_m:g} m wide"
        )
    return trials, broken.sentences()


def _check_label(kind: "DefectKind", broken: _Broken) -> None:
    values = {each.name: getattr(kind.label, each.name) for each in fields(kind.label)}
    wrong = [f"{name}={value!r}" for name, value in values.items() if not _is_number(value) or value < 0]
    if wrong:
        broken.add(f"its label rule has {', '.join(wrong)}: give numbers from 0 on")
    elif kind.label.least_short_side_px > kind.label.least_side_px:
        broken.add("its label rule asks for a shorter side that is longer than the longer side")


def _trial(kind: "DefectKind", seed: int, broken: _Broken) -> TriedShape | None:
    """Trial of the shape of a seed; None where it cannot be measured."""

    def call(what: str, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except Exception as error:
            broken.add(f"{what} fails: {describe_with_place(error)}", seed)
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
    """Rules that a single shape breaks."""
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
    """Differences between two shapes of equal generators."""
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
        broken.add(
            f"`sample_poses` gives {found.dtype} of shape {found.shape}, not finite numbers of shape (count, 3)", seed
        )
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


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and isfinite(value)


def _seeds_text(seeds: list[int]) -> str:
    named = ", ".join(map(str, seeds[:_NAMED_SEEDS]))
    more = f" and {len(seeds) - _NAMED_SEEDS} more" if len(seeds) > _NAMED_SEEDS else ""
    return f"seed{'s' * (len(seeds) > 1)} {named}{more}"


Generate = Callable[..., Heightfield]
"""Makes a defect around the origin, which is its centre; x runs along its length. It takes a random generator and, if
the class has `parameters`, an instance of them."""


@dataclass(frozen=True, slots=True)
class LabelRule:
    """Minimum visible size and contrast for a defect to be labelled in a dataset."""

    least_side_px: int = 8
    """Longer side of its box."""
    least_short_side_px: int = 4
    least_area_px: int = 20
    """Area of its mask."""
    least_contrast: float = 15.0
    """Change of the image, in standard deviations of the defect-free pavement (`capture.contrast`)."""


@dataclass(frozen=True, slots=True)
class DefectKind:
    """A registered class."""

    name: str
    generate: Generate
    sample_poses: PoseSampler
    """Sampler of its poses on a road."""
    rate: Callable[[Measures], Severity]
    width: Callable[[Measures], float]
    """Width, from its measures."""
    length: Callable[[Measures], float]
    """Length, from its measures."""
    weight: float
    """Share among all defects, unless a mix replaces it."""
    label: LabelRule
    is_thin: bool
    """Whether its outlines are so thin that boxes around them hardly overlap, see `pavetwin.sensing.match`."""
    parameters: type[Settings] | None = None
    """Settings of its shapes besides a seed; None for a class whose shapes come from the seed alone."""
    distress: Distress | None = None
    """Distress in the Pavement Condition Index; None if it does not count."""

    @property
    def ships(self) -> bool:
        """Whether it is one of PaveTwin's own classes."""
        return self.generate.__module__.startswith("pavetwin.defects.")

    def shape(self, seed: int, given: ShapeParameters = ()) -> Heightfield:
        """The shape of a seed, with some parameters given; the others are drawn from the seed.

        Raises:
            PaveTwinError: the class does not have such a parameter, or the value does not fit.
        """
        rng = np.random.default_rng(seed)
        if not given:
            return self.generate(rng)
        return self.generate(rng, self.parameters_from(given, where=f"a defect of the class '{self.name}'"))

    def parameters_from(self, given: ShapeParameters, where: str) -> Settings:
        """Parameters of the class in which those given have one value instead of a range.

        Raises:
            PaveTwinError: the class does not have such a parameter, or the value does not fit; `where` begins it.
        """
        if self.parameters is None:
            raise PaveTwinError(f"{where}: the defect class '{self.name}' has no parameters to give.")
        values: dict[str, Any] = {}
        for name, value in given:
            field = self.parameters.model_fields.get(name)
            default = field.default if field else None
            if isinstance(default, tuple):
                one = round(value) if isinstance(default[0], int) else value
                values[name] = (one, one)
            else:
                values[name] = value
        return self.parameters.parse(values, where=where)


def _check(name: str, kind: DefectKind) -> None:
    if not is_class_name(name):
        raise ValueError(f"'{name}' cannot name a class of defects; use lower-case letters, digits and _")
    if kind.weight < 0:
        raise ValueError(f"the weight {kind.weight} of the defect class '{name}' is negative")


DEFECT_CLASSES: Registry[DefectKind] = Registry(
    "defect class",
    key="defects",
    group="pavetwin.defect_classes",
    home="pavetwin.defects",
    on_add=_check,
    rules=partial(check_defect_class, shapes=SHAPES_WHEN_READ),
)


def defect_class(
    name: str,
    *,
    sample_poses: PoseSampler,
    rate: Callable[[Measures], Severity],
    width: Callable[[Measures], float],
    weight: float,
    length: Callable[[Measures], float] = length_of,
    label: LabelRule | None = None,
    is_thin: bool = False,
    parameters: type[Settings] | None = None,
    distress: Distress | str | None = None,
) -> Callable[[Generate], Generate]:
    """Register the decorated function, which makes the shapes of a class, under the name of the class.

    Args:
        name: a lower-case identifier.
        sample_poses: its places on a road.
        rate: its severity, from its measures.
        width: its width, from its measures.
        length: its length, from its measures; by default that of its openings, or its extent without openings.
        weight: its share among all defects, relative to the weights of the other classes.
        label: least size in an image for a label.
        is_thin: its outlines are so thin that boxes around them hardly overlap; detections match by other rules.
        parameters: settings that the decorated function takes as its second argument, or None for their defaults;
            damage populations give some of them.
        distress: its distress in the Pavement Condition Index, a name of `Distress`; it does not count without one.

    Raises:
        ValueError: the name is taken or cannot name a class, the weight is negative, or there is no such distress.
    """
    counted = None if distress is None else Distress(distress)

    def register(generate: Generate) -> Generate:
        kind = DefectKind(
            *(name, generate, sample_poses, rate, width, length, weight),
            *(label or LabelRule(), is_thin, parameters, counted),
        )
        DEFECT_CLASSES.add(name, kind)
        return generate

    return register


def kinds() -> tuple[DefectKind, ...]:
    """The classes that ship with PaveTwin and those of plugins, by name: the default mix.

    Those of installed packages are left out, so that a package that is installed changes no world.
    """
    return tuple(sorted(DEFECT_CLASSES.values(installed=False), key=lambda kind: kind.name))


def mixed(mix: Mapping[str, float]) -> tuple[DefectKind, ...]:
    """The classes of a mix, by name; `kinds()` for an empty one.

    Raises:
        PaveTwinError: it names an unknown class.
    """
    return tuple(DEFECT_CLASSES.get(name) for name in sorted(mix)) or kinds()


@contextmanager
def failures_named(name: str) -> Iterator[None]:
    """Errors of a user's class in the block are one plain line that names the class, its file and its line.

    Raises:
        PaveTwinError: the class failed.
    """
    try:
        yield
    except PaveTwinError:
        raise
    except Exception as error:
        if DEFECT_CLASSES.is_own(name):
            raise
        raise PaveTwinError(f"The defect class '{name}' failed: {describe_with_place(error)}.") from error


def heightfield_of(defect: Defect) -> Heightfield:
    """The shape of a placed defect, regenerated from its seed and its parameters, without its notch.

    Its outline turned by `yaw_rad` about the origin and moved to `centre` is the defect's polygon.

    Raises:
        PaveTwinError: its class is not registered here, or a class of the user's own fails.
    """
    kind = DEFECT_CLASSES.get(defect.kind)
    with failures_named(kind.name):
        shape = kind.shape(defect.seed, defect.parameters)
        return shape.without(np.array(defect.notch)) if defect.notch else shape
