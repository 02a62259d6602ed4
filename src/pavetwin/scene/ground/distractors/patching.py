"""Patches and trenches of several generations along streets, and repairs where streets meet."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.distractors.segment_marks import SEAM_HALF_M, SegmentMarks, wander
from pavetwin.scene.ground.layout.lines import rotated
from pavetwin.scene.ground.layout.paved import PavedSurface
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.styles import pavement
from pavetwin.scene.ground.styles.street_style import OWN
from pavetwin.scene.ground.styles.values import pick
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Junction

ACROSS_M: Final = 75.0
ALONG_M: Final = 170.0
PATCH_M: Final = 45.0
"""Mean distances between trenches across and along a street, and between patches on a street of medium age. Ours."""

CONNECTIONS_M: Final = (7.0, 16.0)  # Between connections of houses along a trench: the width of a house. Ours.
SEALED_PATCHES: Final = 0.4
SEALED_EDGES: Final = 0.45
"""Shares of patches, and of long edges of trenches, that are sealed. Ours."""

CLEAR_M: Final = 0.05  # Repairs of another material end this far from the patch of a defect
SLIVER_M2: Final = 0.01  # Smaller pieces of a repair are left out


@dataclass(frozen=True)
class _Fill:
    """Material of a repair."""

    surface: PavedSurface
    own_tone: float  # Factor on the reflectance where the street's own pavement is used instead
    cut: bool  # Whether it is another pavement than the street's


class Patching:
    """The patches and trenches of one segment."""

    def __init__(self, at: SegmentMarks) -> None:
        self.at, self.rng, self.between = at, at.rng, at.between
        self.length, self.half = at.length, at.half
        self.repairs = at.plan.style.repairs

    def draw(self) -> None:
        at, rates = self.at, self.at.pavement.repairs
        for _ in range(at.count(rates.trenches * self.length / ACROSS_M)):
            self._trench_across()
        for _ in range(at.count(rates.trenches * self.length / ALONG_M)):
            self._trench_along()
        for _ in range(at.count(rates.patches * (0.25 + at.cracked) * self.length / PATCH_M)):
            self._random_patch()
        for _ in range(at.count(self.repairs.cold_patches_per_100_m * rates.patches * at.cracked * self.length / 100)):
            self._cold_patch()

    def _random_patch(self) -> None:
        along = self.between(0.5, max(0.6, self.length - 0.5))
        left = self.between(-self.half + 0.6, self.half - 0.6)
        half_along, half_across = self.between(0.3, 1.6), self.between(0.25, 0.7)
        self._patch(along, left, half_along, half_across, self._fill("patches"))
        if self.rng.random() < self.repairs.renewed:
            along += self.between(-1.0, 1.0) * half_along
            left += self.between(-0.6, 0.6) * half_across
            self._patch(along, left, half_along * 0.6, half_across * 0.8, self._fill("patches"))

    def _trench_across(self) -> None:
        if self.length < 8.0:
            return
        half_across = self.half * (1.0 if self.rng.random() < 0.5 else 0.5)
        left = 0.0 if half_across == self.half else self.rng.choice([-0.5, 0.5]) * self.half
        along = self.between(3.0, self.length - 3.0)
        self._patch(along, float(left), self.between(0.28, 0.55), half_across, self._fill("trenches"))

    def _trench_along(self) -> None:
        """A long trench in straight parts, so that it follows the street, and those to the houses off it."""
        reach, width = self.between(6.0, 30.0), self.between(0.3, 0.5)
        start = self.between(0.0, max(0.1, self.length - reach))
        left = self.between(-self.half + 0.7, self.half - 0.7)
        fill, along = self._fill("trenches"), start
        # Of one material from end to end: the street's own, where a defect lies in it.
        course = np.linspace(start, min(start + reach, self.length), 20)
        area = LineString(self.at.world(course, np.full(20, left))).buffer(width, cap_style="flat")
        fill = replace(fill, cut=fill.cut and self._is_clear(area))
        while along < min(start + reach, self.length - 0.5):
            step = min(4.0, start + reach - along, self.length - along)
            ends = self.at.world([along, along + step], [left, left])
            turn = float(np.arctan2(*(ends[1] - ends[0])[::-1]))
            self._cover(ends.mean(axis=0), turn, step / 2, width, fill)
            along += step
        stations = np.arange(start, along, 0.8)
        for side in (-1, 1):
            if len(stations) > 2 and self.rng.random() < SEALED_EDGES:
                edge = left + side * width + wander(self.rng, stations, 0.008)
                self.at.seal(self.at.world(stations, edge), self.between(*SEAM_HALF_M))
        if self.rng.random() < self.repairs.connections:
            self._connections(start, along, left, width, fill)

    def _connections(self, start: float, end: float, left: float, width: float, fill: _Fill) -> None:
        """Trenches from one along a street to both kerbs."""
        along = start + self.between(1.0, CONNECTIONS_M[0])
        while along < end - 0.5:
            side = float(self.rng.choice([-1.0, 1.0]))
            near, far = left + side * width, side * self.half
            if side * (far - near) > 0.6:
                self._patch(along, (near + far) / 2, self.between(0.22, 0.36), abs(far - near) / 2, fill)
            along += self.between(*CONNECTIONS_M)

    def _cold_patch(self) -> None:
        """One thrown into a hole: most are where wheels pass, or at the kerb."""
        left = self.between(-self.half + 0.5, self.half - 0.5)
        middle = self.at.world(self.between(0.5, max(0.6, self.length - 0.5)), left)
        turns = np.linspace(0.0, 2 * np.pi, 18, endpoint=False)
        lobes = sum(self.between(0.04, 0.16) * np.sin(k * turns + self.between(0.0, 6.28)) for k in (2, 3, 5))
        radius = self.between(0.18, 0.6) * (1.0 + np.asarray(lobes))
        shape = Polygon(middle + (radius * [np.cos(turns), 0.7 * np.sin(turns)]).T)
        if self._is_clear(shape):
            self._cut(shape, self._fill("cold_patches").surface)

    def _fill(self, table: str) -> _Fill:
        """Material of a repair, with an age of its own."""
        street = self.at.street.name
        name = pick(self.repairs.tables[table], float(self.rng.random()))
        age, spread, tone = self.rng.random(3).tolist()
        used = self.at.pavement if name == OWN else pavement(name)
        # One tint and grain a street, so that a tile is of few materials.
        tint, grain = (self.at.plan.chance(f"repair {what} {name} {street}") for what in ("tint", "grain"))
        surface = PavedSurface.of(used, used.reflectance.at(used.age.at(age), spread), tint, grain)
        # With the street's own pavement: mostly newer and darker than what is around it.
        own = 0.62 + 0.36 * tone if tone < 0.78 else 1.05 + 0.6 * (tone - 0.78)
        return _Fill(surface, own, cut=used != self.at.pavement)

    def _patch(self, along: float, left: float, half_along: float, half_across: float, fill: _Fill) -> None:
        """A repaired rectangle, square to the street, its edges sealed or not."""
        x, y = self.at.world(along, left)
        ax, ay = self.at.world(along - 0.5, left)
        bx, by = self.at.world(along + 0.5, left)
        turn = float(np.arctan2(by - ay, bx - ax)) + self.between(-0.03, 0.03)
        ring = self._cover(np.array([x, y]), turn, half_along, half_across, fill)
        if self.rng.random() < SEALED_PATCHES:
            for a, b in pairwise(ring):
                if self.rng.random() < 0.85:
                    self.at.seam(a, b, 0.008)

    def _cover(self, middle: Float64Array, turn_rad: float, long: float, wide: float, fill: _Fill) -> Float64Array:
        """A rectangle of a material; returns its ring (5, 2)."""
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * (long, wide)
        ring: Float64Array = rotated(corners, turn_rad) + middle
        cut = fill.cut and self._is_clear(Polygon(ring))
        if cut:
            self._cut(Polygon(ring), fill.surface)
        tone = 1.0 if cut else fill.own_tone
        self.at.found.patches.append((float(middle[0]), float(middle[1]), turn_rad, long, wide, tone))
        return ring

    def _cut(self, shape: Polygon, surface: PavedSurface) -> None:
        """Another surface in the street's."""
        parts = shapely.get_parts(shapely.intersection(shape, self.at.segment.polygon))
        cuts = self.at.found.cuts.setdefault(self.at.segment.id, [])
        cuts += [(part, surface) for part in parts if isinstance(part, Polygon) and part.area > SLIVER_M2]

    def _is_clear(self, shape: BaseGeometry) -> bool:
        return not self.at.plan.holes.near(shape, CLEAR_M)


PATCH_M2: Final = 170.0  # Carriageway area per repaired rectangle
SEALED_M2: Final = 110.0  # Carriageway area per sealed crack


def junction_repairs(layout: SurfaceLayout, junction: Junction) -> tuple[list[tuple[float, ...]], list[Float64Array]]:
    """Patches of a junction as `Repairs` holds them, and the lines of its sealed cracks, (n, 2) each, world frame."""
    area = shapely.intersection(layout.road_near(shapely.box(*junction.polygon.bounds)), junction.polygon)
    inner = area.buffer(-0.8)
    rng = child(layout.seed, Stream.SCENE, 8, layout.name_hash(f"junction {junction.id}"))
    patches: list[tuple[float, ...]] = []
    lines: list[Float64Array] = []
    if inner.is_empty:
        return patches, lines
    shapely.prepare(inner)
    low, high = np.array(inner.bounds).reshape(2, 2)
    edges = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
    square = float(np.arctan2(*(edges[1] - edges[0])[::-1])) if len(edges) > 2 else 0.0
    for _ in range(rng.poisson(area.area / PATCH_M2)):
        x, y = rng.uniform(low, high)
        if inner.contains(shapely.Point(x, y)):
            long, wide = rng.uniform(0.4, 3.2), rng.uniform(0.3, 0.8)
            turn = square + rng.choice([0.0, np.pi / 2]) + rng.normal(0.0, 0.06)
            tone = rng.uniform(0.68, 0.93) if rng.random() < 0.8 else rng.uniform(1.05, 1.15)
            patches.append((x, y, turn, long, wide, tone))
    for _ in range(rng.poisson(area.area / SEALED_M2)):
        steps = int(rng.uniform(1.5, 9.0) / 0.35)
        turn = rng.uniform(0.0, 2 * np.pi) + np.cumsum(rng.normal(0.0, 0.16, steps))
        path = rng.uniform(low, high) + 0.35 * np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]), axis=0)
        inside = shapely.contains_xy(inner, path)
        # A crack ends where it first leaves.
        kept = path[: int(np.argmin(inside))] if not inside.all() else path
        if len(kept) > 4:
            lines.append(kept)
    return patches, lines
