"""Positions of signals and signs: at the ends of the edges that lead into a junction."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from shapely import Point

from pavetwin.world.model import Furniture, FurnitureKind, LaneKind
from pavetwin.world.roadnet import Edge, RoadNet
from pavetwin.world.segments import direction_at, point_at
from pavetwin.world.streets import StreetSurface

SIGNAL_HEIGHT_M = 6.0
"""Underside of the arm above the road [m]; 5.5 is the least that is allowed over a road."""

SIGNAL_SETBACK_M, SIGN_SETBACK_M = 0.8, 0.5
LONGEST_ARM_M = 7.0
BACK_FROM_LINE_M = (1.0, 2.0, 3.5, 5.0, 7.0)
"""Distances before the stop line at which a place is tried [m]."""


def signals_of(net: RoadNet, radius_m: float) -> Iterator[list[Furniture]]:
    """For every signalled approach the candidate masts, best first; the arm ends over the last lane's middle."""
    for name, controller in sorted(net.signalled.items()):
        edge = net.edges[name]
        if not edge.for_cars or not edge.carriageway:
            continue
        last = max((n for n, lane in enumerate(edge.carriageway) if lane.kind is not LaneKind.PARKING), default=0)
        lanes = edge.carriageway[: last + 1]
        arm = SIGNAL_SETBACK_M + sum(lane.width_m for lane in lanes) - lanes[-1].width_m / 2
        mast = Furniture("", FurnitureKind.SIGNAL, Point(0, 0), SIGNAL_HEIGHT_M, radius_m, controller=controller)
        yield [
            replace(mast, position=at, yaw_rad=yaw, arm_m=round(min(arm, LONGEST_ARM_M), 2))
            for at, yaw in _places(edge, SIGNAL_SETBACK_M, net.left_hand)
        ]


def signs_of(
    net: RoadNet, streets: Sequence[StreetSurface], height_m: float, radius_m: float
) -> Iterator[list[Furniture]]:
    """For every unsignalled approach to a junction of three or more streets the places of its sign, best first."""
    arms: dict[str, int] = {}
    for street in streets:
        for end in {street.street.start, street.street.end}:
            arms[end] = arms.get(end, 0) + 1
    for street in streets:
        for edge in street.edges:
            if edge.id not in net.signalled and arms.get(edge.end, 0) >= 3:
                sign = Furniture("", FurnitureKind.SIGN, Point(0, 0), height_m, radius_m)
                yield [
                    replace(sign, position=at, yaw_rad=yaw) for at, yaw in _places(edge, SIGN_SETBACK_M, net.left_hand)
                ]


def _places(edge: Edge, setback_m: float, left_hand: bool) -> Iterator[tuple[Point, float]]:
    """Points behind the kerb near the end of an edge, and the direction from there over the road (yaw, radians)."""
    lane = edge.carriageway[0]
    side = 1.0 if left_hand else -1.0
    for back in BACK_FROM_LINE_M:
        station = max(0.0, lane.length_m - back)
        x, y = point_at(lane.centre_line, station)
        dx, dy = direction_at(lane.centre_line, station)
        out = (-dy * side, dx * side)
        reach = lane.width_m / 2 + setback_m
        yield Point(x + out[0] * reach, y + out[1] * reach), math.atan2(-out[1], -out[0])
