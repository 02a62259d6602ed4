"""What a class of defects is, and where classes are registered. A new one is one file with one `@defect_class`."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pavetwin.config.base import Settings
from pavetwin.defects.conformance import SHAPES_WHEN_READ, check_defect_class
from pavetwin.defects.distress import Distress
from pavetwin.defects.heightfield import Heightfield
from pavetwin.defects.measures import Measures, length_of
from pavetwin.defects.poses import PoseSampler
from pavetwin.errors import PaveTwinError, told_at
from pavetwin.registry import Registry
from pavetwin.world.model import Defect, Severity, ShapeParameters, is_class_name

Generate = Callable[..., Heightfield]
"""Makes a defect around the origin, which is its centre; x runs along its length. It takes a random generator and, if
the class has `parameters`, an instance of them."""


@dataclass(frozen=True, slots=True)
class LabelRule:
    """The least that must be visible of a defect for it to be labelled in a dataset."""

    least_side_px: int = 8
    """Of the longer side of its box."""
    least_short_side_px: int = 4
    least_area_px: int = 20
    """Of its mask."""
    least_contrast: float = 15.0
    """How much it changes the image, in standard deviations of the defect-free pavement (`capture.contrast`)."""


@dataclass(frozen=True, slots=True)
class DefectKind:
    """A registered class."""

    name: str
    generate: Generate
    sample_poses: PoseSampler
    """Where on a road it is found."""
    rate: Callable[[Measures], Severity]
    width: Callable[[Measures], float]
    """Which of its measures is its width."""
    length: Callable[[Measures], float]
    """Which is its length."""
    weight: float
    """Among all defects, unless a mix says otherwise."""
    label: LabelRule
    is_thin: bool
    """Whether its outlines are so thin that boxes around them hardly overlap, see `pavetwin.sensing.match`."""
    parameters: type[Settings] | None = None
    """What its shapes may be given besides a seed; None for a class whose shapes come from the seed alone."""
    distress: Distress | None = None
    """As what it counts in the Pavement Condition Index; None for not at all."""

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
    """Register what is decorated, which makes the shapes of a class, under the name of the class.

    Args:
        name: a lower-case identifier.
        sample_poses: where on a road it is found.
        rate: its severity, from its measures.
        width: which of its measures is its width.
        length: which is its length; that of its openings, or of a shape without openings its extent, unless given.
        weight: its share among all defects, relative to the weights of the other classes.
        label: from which size in a picture it is labelled.
        is_thin: its outlines are so thin that boxes around them hardly overlap; detections match by other rules.
        parameters: settings that what is decorated takes as its second argument, or None for their defaults; damage
            populations give some of them.
        distress: as what it counts in the Pavement Condition Index, a name of `Distress`; not at all unless given.

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
    """The classes that ship with PaveTwin and those of plugins, by name: what is placed unless a mix says otherwise.

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
        raise PaveTwinError(f"The defect class '{name}' failed: {told_at(error)}.") from error


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
