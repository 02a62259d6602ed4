"""The classes of defects that can be generated. A new class is one new file and one `register` in it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from pavetwin.defects.heightfield import Heightfield
from pavetwin.defects.measures import Measures
from pavetwin.defects.poses import PoseSampler
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.world.model import Defect, DefectClass, Severity

Generate = Callable[[np.random.Generator], Heightfield]
"""Makes a defect around the origin, which is its centre; x runs along its length."""


@dataclass(frozen=True, slots=True)
class DefectKind:
    """A registered class."""

    name: DefectClass
    generate: Generate
    sample_poses: PoseSampler
    """Sampler of its poses on a road."""
    rate: Callable[[Measures], Severity]
    width: Callable[[Measures], float]
    """The measure that is its width."""
    weight: float
    """Its share among all defects, unless a mix is given."""


_KINDS: dict[DefectClass, DefectKind] = {}


def register(
    name: str,
    generate: Generate,
    *,
    sample_poses: PoseSampler,
    rate: Callable[[Measures], Severity],
    width: Callable[[Measures], float],
    weight: float,
) -> DefectKind:
    """Register a class.

    Raises:
        ValueError: the name is taken or no plain lower-case word, or the weight is negative.
    """
    kind = DefectKind(DefectClass(name), generate, sample_poses, rate, width, weight)
    if kind.name in _KINDS:
        raise ValueError(f"the defect class '{name}' is registered already")
    if weight < 0:
        raise ValueError(f"the weight {weight} of the defect class '{name}' is negative")
    _KINDS[kind.name] = kind
    return kind


def unregister(name: str) -> None:
    """Remove a class from the registry.

    Raises:
        PaveTwinError: it is not known.
    """
    del _KINDS[kind_of(name).name]


def kinds() -> tuple[DefectKind, ...]:
    """All registered classes by name."""
    return tuple(_KINDS[name] for name in sorted(_KINDS))


def kind_of(name: str) -> DefectKind:
    """The class of that name.

    Raises:
        PaveTwinError: there is none; the message names the nearest.
    """
    for kind in _KINDS.values():
        if kind.name.value == name:
            return kind
    raise unknown(name, (kind.name.value for kind in kinds()))


def unknown(name: str, known: Iterable[str]) -> PaveTwinError:
    """The message for a class that is not registered."""
    names = list(known)
    return PaveTwinError(f"Unknown defect class '{name}'{nearest_name(name, names)}. Known: {', '.join(names)}.")


def heightfield_of(defect: Defect) -> Heightfield:
    """The shape of a placed defect, regenerated from its seed.

    Its outline turned by `yaw_rad` about the origin and moved to `centre` is the defect's polygon.

    Raises:
        PaveTwinError: its class is not registered here.
    """
    return kind_of(defect.kind).generate(np.random.default_rng(defect.seed))
