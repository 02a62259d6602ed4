"""Road markings as bars and outlines, with the paints of a place's marking standard."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import BoolArray, Float64Array
from pavetwin.scene.ground.layout.lines import ways_along
from pavetwin.scene.ground.materials.compose import PAINTS
from pavetwin.scene.ground.styles.marking_standard import MarkingStandard, PaintName, marking_standard, standard_names
from pavetwin.world.model import World

FALLBACK: Final = "germany"  # Standard of places in no standard's country


def paint(colour: PaintName) -> float:
    """The place of a colour among the paints, 0 … 1, as maps hold it."""
    return list(PAINTS).index(colour) / (len(PAINTS) - 1)


def standard_at(longitude: float, latitude: float) -> MarkingStandard:
    """The standard of a place (WGS 84, degrees)."""
    standards = map(marking_standard, standard_names())
    return next((each for each in standards if each.holds_at(longitude, latitude)), marking_standard(FALLBACK))


def standard_of(world: World) -> MarkingStandard:
    """The standard of a world's place."""
    if not world.segments:
        return marking_standard(FALLBACK)
    return standard_at(*world.georeference.to_wgs84(world.segments[0].centre_line.coords[0]))


_OVERLAP_M: Final = 0.3  # Bars of one line overlap, so that no gap shows where they meet
_BEYOND_M: Final = 0.004
"""At a corner the square end of a bar reaches this far beyond the other bar: less than its edge is uneven."""


@dataclass(frozen=True)
class Paint:
    """All paint of a world."""

    bars: Float64Array
    """(n, 5): middle x and y in the world frame, direction [rad], half length and half width [m]."""
    bar_paints: Float64Array
    """(n, 2): place among the paints and wear, 0 … 1."""
    outlines: tuple[Float64Array, ...]
    """Polygons (n, 2) each, world frame."""
    outline_paints: Float64Array
    """(n, 2) as of the bars."""
    is_former: BoolArray
    """(n,): which bars are of an earlier layout, below the others."""
    scars: Float64Array
    """(m, 6): bars where markings were removed or masked, and the factor on the reflectance there."""

    def ends(self) -> Float64Array:
        """(n, 2, 2) the ends of the bars."""
        along = np.column_stack([np.cos(self.bars[:, 2]), np.sin(self.bars[:, 2])]) * self.bars[:, 3:4]
        return np.stack([self.bars[:, :2] - along, self.bars[:, :2] + along], axis=1)

    def joined(self, *others: "Paint") -> "Paint":
        """This paint and others."""
        every = (self, *others)
        return Paint(
            np.concatenate([each.bars for each in every]),
            np.concatenate([each.bar_paints for each in every]),
            tuple(ring for each in every for ring in each.outlines),
            np.concatenate([each.outline_paints for each in every]),
            np.concatenate([each.is_former for each in every]),
            np.concatenate([each.scars for each in every]),
        )

    def resurfaced(self, where: BaseGeometry) -> "Paint":
        """Without what an earlier layout left in a place that was paved since."""
        shapely.prepare(where)
        gone = self.is_former & shapely.contains_xy(where, self.bars[:, :2])
        scars = self.scars[~shapely.contains_xy(where, self.scars[:, :2])]
        kept = (self.bars[~gone], self.bar_paints[~gone], self.outlines, self.outline_paints, self.is_former[~gone])
        return Paint(*kept, scars)


class Painter:
    """Collects paint."""

    def __init__(self) -> None:
        self._bars: list[tuple[float, ...]] = []
        self._outlines: list[tuple[Float64Array, float, float]] = []
        self._scars: list[tuple[float, ...]] = []

    def bar(
        self, start: Float64Array, end: Float64Array, width_m: float, wear: float, *, colour: PaintName = "white"
    ) -> None:
        """A straight bar with square ends."""
        dx, dy = end - start
        length = float(np.hypot(dx, dy))
        if length > 0.02:
            x, y = (start + end) / 2
            self._bars.append((x, y, float(np.arctan2(dy, dx)), length / 2, width_m / 2, paint(colour), wear))

    def line(
        self,
        path: BaseGeometry,
        width_m: float,
        wear: float,
        *,
        dash_m: tuple[float, float] | None = None,
        colour: PaintName = "white",
    ) -> None:
        """A line along a path, solid or in dashes (painted, free)."""
        for part in shapely.get_parts(path):
            if not isinstance(part, LineString) or part.length < 0.3:
                continue
            for start, end in _dashes(part.length, dash_m):
                self._along(part, start, end, width_m, wear, colour)

    def _along(
        self, path: LineString, start: float, end: float, width_m: float, wear: float, colour: PaintName
    ) -> None:
        coords = _between(path, start, end)
        steps = np.diff(coords, axis=0)
        kept = np.hypot(*steps.T) > 1e-6
        if not kept.any():
            return
        steps, coords = steps[kept], np.concatenate([coords[:1], coords[1:][kept]])
        lengths = np.hypot(*steps.T)
        laps = np.zeros(len(coords))
        laps[1:-1] = _laps(steps[:-1], steps[1:], width_m)
        if path.is_closed:
            corners = shapely.get_coordinates(path)
            closing = _laps(corners[-1:] - corners[-2:-1], corners[1:2] - corners[:1], width_m)[0]
            laps[0] = closing if start <= 0.0 else 0.0
            laps[-1] = closing if end >= path.length else 0.0
        for leg, (step, length) in enumerate(zip(steps, lengths.tolist(), strict=True)):
            lap = np.minimum(laps[leg : leg + 2, None], length / 2) * step / length
            self.bar(coords[leg] - lap[0], coords[leg + 1] + lap[1], width_m, wear, colour=colour)

    def outline(self, ring: npt.ArrayLike, wear: float, *, colour: PaintName = "white") -> None:
        """A filled polygon (n, 2)."""
        self._outlines.append((np.asarray(ring, dtype=np.float64), paint(colour), wear))

    def scar(self, bar: tuple[float, float, float, float, float], tone: float) -> None:
        """A bar as of `Paint.bars` where the pavement's reflectance is changed by a factor."""
        self._scars.append((*bar, tone))

    def done(self) -> Paint:
        bars = np.array(self._bars, dtype=np.float64).reshape(-1, 7)
        paints = np.array([(which, wear) for _, which, wear in self._outlines]).reshape(-1, 2)
        rings, new = tuple(ring for ring, _, _ in self._outlines), np.zeros(len(bars), dtype=np.bool_)
        return Paint(bars[:, :5], bars[:, 5:], rings, paints, new, np.array(self._scars).reshape(-1, 6))


def _laps(before: Float64Array, after: Float64Array, width_m: float) -> Float64Array:
    """How far two bars reach over the corner between them: to the outer corner that both share, so that no square end
    juts out; (n,) for the directions (n, 2) before and after."""
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn, half = np.abs(np.arctan2(cross, (before * after).sum(axis=1))), width_m / 2
    reach = (half * (1 - np.cos(turn)) + _BEYOND_M) / np.maximum(np.sin(turn), 1e-9)
    return np.asarray(np.where(turn < np.pi / 2, np.minimum(_OVERLAP_M / 2, reach), half), dtype=np.float64)


def _dashes(length_m: float, dash_m: tuple[float, float] | None) -> Iterator[tuple[float, float]]:
    """Begin and end of every dash; solid lines in parts, so that each is used only near its place."""
    on, off = dash_m or (6.0, -_OVERLAP_M)
    at = 0.0 if dash_m is None else off / 2
    while at < length_m - 0.2:
        yield at, min(length_m, at + on)
        at += on + off


def _between(path: LineString, start: float, end: float) -> Float64Array:
    """The points of a path between two stations."""
    coords = shapely.get_coordinates(path)
    ways = ways_along(coords)
    inner = (ways > start + 0.05) & (ways < end - 0.05)
    at = np.concatenate([[start], ways[inner], [end]])
    return np.column_stack([np.interp(at, ways, coords[:, axis]) for axis in (0, 1)])
