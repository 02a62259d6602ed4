"""The classes of defects that can be generated. A new class is one new file and one `register` in it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from shapely import Polygon

from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.world.model import DefectClass

Outline = Callable[[np.random.Generator], Polygon]
"""Draws an outline in metres around the origin, which is the defect's centre; x runs along the street."""


@dataclass(frozen=True, slots=True)
class DefectKind:
    """A registered class: how its outline is drawn, and its weight among all defects unless a mix says otherwise."""

    name: DefectClass
    outline: Outline
    weight: float


_KINDS: dict[DefectClass, DefectKind] = {}


def register(name: DefectClass, outline: Outline, *, weight: float) -> DefectKind:
    """Make a class known.

    Raises:
        ValueError: the name is taken, or the weight is negative.
    """
    if name in _KINDS:
        raise ValueError(f"the defect class '{name}' is registered already")
    if weight < 0:
        raise ValueError(f"the weight {weight} of the defect class '{name}' is negative")
    kind = DefectKind(name, outline, weight)
    _KINDS[name] = kind
    return kind


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
    """The plain sentence for a class that is not registered."""
    names = list(known)
    return PaveTwinError(f"Unknown defect class '{name}'{nearest_name(name, names)}. Known: {', '.join(names)}.")
