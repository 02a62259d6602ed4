"""Painted marks that follow no standard's lines: of utilities, surveys, bicycles, bus stops. None is a defect."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from shapely import LineString, MultiLineString, Polygon, STRtree

from pavetwin.scene.ground.layout.lines import LineFrame, rotated
from pavetwin.scene.ground.layout.streets import StreetPlan
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.markings.painter import Paint, Painter, paint
from pavetwin.scene.ground.styles import Mark, mark
from pavetwin.scene.ground.styles.marking_standard import MarkPosition
from pavetwin.scene.ground.styles.values import pick
from pavetwin.seeds import Stream, child
from pavetwin.world.ground import Nearby
from pavetwin.world.model import Lane, LaneKind, Segment
from pavetwin.world.segments import segment_key

KEY: Final = 12  # Key of this module's children of the scene's random stream
LAP: Final = 0.35  # By this share of their width strokes reach beyond their corners, so that no gap shows there
APART_M: Final = 0.55  # Least distance of a mark's strokes from the middle lines of paint of another colour
PARKED_M: Final = 3.0  # Least distance of a mark at the kerb from the middle of a parking place
END_FREE_M: Final = 1.0  # Marks lie this far from the ends of a segment


def marks(plan: SurfaceLayout, markings: Paint) -> Paint:
    """All painted marks of a world. Each segment draws its own, by each mark's rate.

    Args:
        markings: what is painted already; marks of another colour keep off it, and off each other.
    """
    placing = _Placing(plan, markings)
    for street in plan.streets:
        for segment in street.segments:
            rng = child(plan.seed, Stream.SCENE, KEY, segment_key(segment))
            for name, per_100_m in plan.style.marks.items():
                kind = mark(name)
                count = int(rng.poisson(per_100_m * segment.length_m / 100))
                if kind.streets == "all" or (kind.streets == "main") == street.main:
                    for _ in range(count):
                        placing.place(street, segment, kind, rng)
    return placing.painter.done()


class _Placing:
    def __init__(self, plan: SurfaceLayout, markings: Paint) -> None:
        self.plan = plan
        self.painter = Painter()
        self.parked = STRtree([place.centre for place in plan.world.parking])
        painted = [LineString(ends) for ends in markings.ends()] + [Polygon(ring) for ring in markings.outlines]
        self.painted = STRtree(painted)
        self.colours = np.concatenate([markings.bar_paints[:, 0], markings.outline_paints[:, 0]])
        self.marked: Nearby[float] = Nearby(4.0)

    def place(self, street: StreetPlan, segment: Segment, kind: Mark, rng: np.random.Generator) -> None:
        """One mark, if there is room for it where it is tried."""
        scale, wear = kind.scale.at(float(rng.random())), kind.wear.at(float(rng.random()))
        colour = pick(kind.colours, float(rng.random()))
        turn = float(rng.uniform(0.0, 2 * np.pi)) if kind.turned else 0.0
        strokes = [rotated(np.array(stroke) * scale, turn) for stroke in kind.strokes]
        everything = np.concatenate(strokes)
        begin, end = everything[:, 0].min(), everything[:, 0].max()
        half = float(np.abs(everything[:, 1]).max())
        frames = list(_frames(self.plan, street, segment, kind.position, rng, half))
        if not frames:
            return
        frame, length_m, left = frames[int(rng.integers(len(frames)))]
        free = length_m - (end - begin) - 2 * END_FREE_M
        station = END_FREE_M - begin + free * float(rng.random())
        lines = [frame.points(stroke[:, 0] + station, stroke[:, 1] + left) for stroke in strokes]
        whole = MultiLineString(lines)
        if free < 0 or not self._is_free(kind, whole, paint(colour)):
            return
        self.marked.add(whole.bounds, paint(colour))
        for line in lines:
            for a, b in pairwise(line):
                lap = (b - a) / max(float(np.hypot(*(b - a))), 1e-9) * kind.width_m * LAP
                self.painter.bar(a - lap, b + lap, kind.width_m, wear, colour=colour)

    def _is_free(self, kind: Mark, strokes: MultiLineString, colour: float) -> bool:
        """Whether no paint of another colour is near, since maps mix the colours of neighbouring texels; at kerbs, no
        parking place either."""
        if kind.position is MarkPosition.KERB and len(self.parked.query(strokes, "dwithin", distance=PARKED_M)):
            return False
        near = self.painted.query(strokes, "dwithin", distance=APART_M)
        return bool((self.colours[near] == colour).all()) and all(
            other == colour for other in self.marked.query(strokes.buffer(APART_M).bounds)
        )


def _frames(
    plan: SurfaceLayout,
    street: StreetPlan,
    segment: Segment,
    position: MarkPosition,
    rng: np.random.Generator,
    half_m: float,
) -> Iterator[tuple[LineFrame, float, float]]:
    """Where a mark may lie: coordinates along a line, its length, and the offset of the mark's origin to its left."""
    if position in (MarkPosition.LANE, MarkPosition.BICYCLE):
        for lane in _lanes(plan, street, segment, position):
            yield LineFrame(lane.centre_line), lane.length_m, 0.0
        return
    half = segment.width_m / 2
    if position is MarkPosition.KERB:
        reverse = LineString(list(segment.centre_line.coords)[::-1])
        yield LineFrame(segment.centre_line), segment.length_m, -half
        yield LineFrame(reverse), segment.length_m, -half
    elif (room := half - half_m - 0.5) > 0:
        yield LineFrame(segment.centre_line), segment.length_m, float(rng.uniform(-room, room))


def _lanes(plan: SurfaceLayout, street: StreetPlan, segment: Segment, position: MarkPosition) -> list[Lane]:
    """The lanes of a segment that a mark may lie on."""
    if position is MarkPosition.LANE:
        return list(street.lanes)
    return [lane for edge in segment.edges for lane in plan.world.lanes_on(edge, LaneKind.BICYCLE)]
