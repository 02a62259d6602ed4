"""Marks on a segment's carriageway while they are collected, and the courses of sealed and open joints."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.layout.lines import LineFrame
from pavetwin.scene.ground.layout.paved import PavedSurface
from pavetwin.scene.ground.layout.streets import StreetPlan
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Segment, Surface
from pavetwin.world.segments import segment_key

CLEAR_OF_DEFECTS_M: Final = 0.03
"""Nothing is sealed this near to the patch of a defect, or the seal would hide the defect."""

SLENDER_M: Final = 0.13
"""Patches that are nowhere farther from their border are those of single cracks: up to 8 cm wide with their broken
edges, and 4 cm around them. Of two real towns' 1157 single cracks 97 in 100 are, and 1 in 100 potholes."""

RUNS_ON_M: Final = 0.35
"""A seal runs on over a single crack that it crosses within this length: a road's joints do not end at every crack."""

SHORTEST_M: Final = 0.4  # Shorter remains are left out


def clear_of_defects(plan: SurfaceLayout, line: Float64Array) -> Iterator[Float64Array]:
    """The parts of a line (n, 2) that hide no defect, world frame."""
    path = LineString(line)
    near = [hole for hole in plan.holes.at(path, CLEAR_OF_DEFECTS_M) if not _runs_on(path, hole)]
    free = shapely.difference(path, shapely.union_all(near).buffer(CLEAR_OF_DEFECTS_M)) if near else path
    for part in shapely.get_parts(free):
        if part.length > SHORTEST_M:
            yield shapely.get_coordinates(part)


def _runs_on(path: LineString, hole: BaseGeometry) -> bool:
    """Whether a line only crosses a patch, and that of a single crack."""
    return bool(shapely.intersection(path, hole).length < RUNS_ON_M and hole.buffer(-SLENDER_M).is_empty)


def wavering(rng: np.random.Generator, a: Float64Array, b: Float64Array, sway: float) -> Float64Array:
    """A slightly irregular line from one point to another."""
    length = float(np.hypot(*(b - a)))
    stations = np.linspace(0.0, length, max(3, int(length / 0.35)))
    along = (b - a) / max(length, 1e-9)
    left = np.array([-along[1], along[0]])
    return np.asarray(a + along * stations[:, None] + left * wander(rng, stations, sway)[:, None])


def wander(rng: np.random.Generator, stations: Float64Array, sway: float) -> Float64Array:
    """Offsets of a line from the straight one, standard deviation `sway` [m], corrected about every metre."""
    waves = np.array([0.9, 2.3, 6.1])[:, None]
    phases = rng.uniform(0.0, 2 * np.pi, (3, 1))
    swing = np.array([0.4, 0.8, 1.1]) @ np.sin(2 * np.pi * stations / waves + phases)
    return np.asarray(sway * swing + rng.normal(0.0, 0.2 * sway, len(stations)))


SEAL_HALF_M: Final = (0.013, 0.034)
"""Half the width of a sealed crack: flush fillings of 2 to 3 cm up to overbands of 7 cm (FHWA-RD-99-147)."""

SEAM_HALF_M: Final = (0.009, 0.022)
"""Half the width of a sealed edge or joint: the joint sealant and its overband."""

SEALED_GAPS: Final = (0.001, 0.025)
"""Share of a seal that has come off; with more gaps it would look like a dashed line."""


@dataclass
class Repairs:
    """Marks on all carriageways, world frame, metres."""

    patches: list[tuple[float, ...]] = field(default_factory=list)
    """Middle x and y, direction [rad], half length, half width, factor on the reflectance around them."""
    seals: list[Float64Array] = field(default_factory=list)
    """Lines of bitumen, (n, 2)."""
    seal_halves_m: list[float] = field(default_factory=list)
    seal_gaps: list[float] = field(default_factory=list)
    """Share of each that has come off."""
    stretches: dict[str, list[tuple[float, float, PavedSurface]]] = field(default_factory=dict)
    """From and to along a segment's centre line, and its later paving."""
    lanes: dict[str, list[tuple[Surface, PavedSurface]]] = field(default_factory=dict)
    """Strips of a segment that were paved apart from the rest, later ones over earlier ones."""
    cuts: dict[str, list[tuple[Polygon, PavedSurface]]] = field(default_factory=dict)
    """Repairs of a segment in another material, later ones over earlier ones."""
    spots: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Oil and damp: x, y, radius, strength."""
    skids: list[tuple[Float64Array, float]] = field(default_factory=list)
    """Tyre marks: line and strength."""

    def seal(self, plan: SurfaceLayout, line: Float64Array, half_m: float, gaps: float) -> None:
        """A line of bitumen (n, 2), except where it would hide a defect."""
        for part in clear_of_defects(plan, line):
            self.seals.append(part)
            self.seal_halves_m.append(half_m)
            self.seal_gaps.append(gaps)


class SegmentMarks:
    """One segment, its marks drawn in coordinates along its centre line and to its left."""

    def __init__(self, plan: SurfaceLayout, street: StreetPlan, segment: Segment, found: Repairs) -> None:
        self.plan, self.street, self.segment, self.found = plan, street, segment, found
        self.length, self.half = segment.length_m, segment.width_m / 2
        self.pavement = plan.pavement(street)
        self.cracked = plan.ageing(street).cracked * (0.3 + 1.4 * plan.chance(f"mended {street.name}"))
        self.rng = child(plan.seed, Stream.SCENE, 2, segment_key(segment))
        self.world = LineFrame(segment.centre_line).points

    def count(self, mean: float) -> int:
        return int(self.rng.poisson(mean))

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def seal(self, line: Float64Array, half_m: float) -> None:
        """A sealed line (n, 2), world frame."""
        self.found.seal(self.plan, line, half_m, self.between(*SEALED_GAPS))

    def seam(self, a: Float64Array, b: Float64Array, sway_m: float) -> None:
        """A sealed edge from one point (2,) to another, world frame."""
        self.seal(wavering(self.rng, a, b, sway_m), self.between(*SEAM_HALF_M))
