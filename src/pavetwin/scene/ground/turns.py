"""Where vehicles cross junctions: from the ends of lanes to the beginnings of others, as smooth paths."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
import shapely
from shapely import STRtree

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.streets import Street
from pavetwin.world.model import Junction, Lane, World

ENDS_NEAR_M: Final = 1.5
"""A lane ends at a junction that is this near to its end."""

STRAIGHT_RAD: Final = math.radians(35)
BACK_RAD: Final = math.radians(150)
"""Less of a turn is straight on, more is a U-turn, which nobody paints."""


class Turn(StrEnum):
    LEFT = "left"
    STRAIGHT = "straight"
    RIGHT = "right"


@dataclass(frozen=True)
class Approach:
    """A lane that ends at a junction."""

    lane: Lane
    street: Street
    junction: Junction
    place: int
    """Among the lanes of its direction, 0 beside the kerb."""
    lanes: int
    """Of its direction."""


@dataclass(frozen=True)
class Path:
    """One way across a junction."""

    approach: Approach
    turn: Turn
    line: Float64Array
    """(n, 2), world frame."""


def paths_of(world: World, streets: tuple[Street, ...]) -> tuple[Path, ...]:
    """All likely ways across all junctions."""
    if not world.junctions:
        return ()
    tree = STRtree([junction.polygon for junction in world.junctions])
    arriving: dict[int, list[Approach]] = {}
    leaving: dict[int, list[Approach]] = {}
    for street in streets:
        for way in street.ways:
            for place, lane in enumerate(way):
                for end, found in ((-1, arriving), (0, leaving)):
                    point = shapely.Point(lane.centre_line.coords[end])
                    for junction in sorted(tree.query(point, "dwithin", distance=ENDS_NEAR_M).tolist())[:1]:
                        approach = Approach(lane, street, world.junctions[junction], place, len(way))
                        found.setdefault(junction, []).append(approach)
    return tuple(
        path for junction in sorted(arriving) for path in _across(arriving[junction], leaving.get(junction, []))
    )


def _across(arriving: list[Approach], leaving: list[Approach]) -> Iterator[Path]:
    for approach in arriving:
        exits: dict[str, list[Approach]] = {}
        for other in leaving:
            exits.setdefault(other.lane.edge, []).append(other)
        for lanes in exits.values():
            turn, angle = _turn(approach, lanes[0])
            if abs(angle) > BACK_RAD:
                continue
            chosen = _exit(approach, turn, lanes)
            if chosen is not None:
                yield Path(approach, turn, _curve(approach.lane, chosen.lane))


def _exit(approach: Approach, turn: Turn, lanes: list[Approach]) -> Approach | None:
    """The lane of the exit that this lane leads to; None when another lane does."""
    outer = Turn.LEFT if approach.street.left_hand else Turn.RIGHT
    ordered = sorted(lanes, key=lambda lane: lane.place)
    if turn is Turn.STRAIGHT:
        return ordered[min(approach.place, len(ordered) - 1)]
    if turn is outer:
        return ordered[0] if approach.place == 0 else None
    return ordered[-1] if approach.place == approach.lanes - 1 else None


def _turn(approach: Approach, leaving: Approach) -> tuple[Turn, float]:
    ax, ay = _heading(approach.lane, -1)
    bx, by = _heading(leaving.lane, 0)
    angle = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    if abs(angle) < STRAIGHT_RAD:
        return Turn.STRAIGHT, angle
    return (Turn.LEFT if angle > 0 else Turn.RIGHT), angle


def _heading(lane: Lane, end: int) -> tuple[float, float]:
    """Unit direction of a lane at its beginning (0) or end (−1)."""
    coords = shapely.get_coordinates(lane.centre_line)
    step = coords[-1] - coords[-2] if end else coords[1] - coords[0]
    length = float(np.hypot(*step)) or 1.0
    return float(step[0]) / length, float(step[1]) / length


def _curve(arriving: Lane, leaving: Lane, points: int = 14) -> Float64Array:
    """A cubic Bézier curve that leaves one lane and meets the other in their directions."""
    a, b = np.array(arriving.centre_line.coords[-1]), np.array(leaving.centre_line.coords[0])
    reach = 0.42 * float(np.hypot(*(b - a)))
    p = a + reach * np.array(_heading(arriving, -1))
    q = b - reach * np.array(_heading(leaving, 0))
    t = np.linspace(0.0, 1.0, points)[:, None]
    return np.asarray((1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * p + 3 * (1 - t) * t**2 * q + t**3 * b)
