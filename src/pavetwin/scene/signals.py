"""Signal heads: where they hang, and which of their lamps is lit at a time.

A mast stands at the end of the edge whose traffic it stops, with a head low on the mast and one at the arm's end;
people have a head at each end of a crossing. The world's connections state which letter of SUMO's state a head shows.
"""

import bisect
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float32Array, Float64Array
from pavetwin.scene.agents import upright
from pavetwin.scene.ground.layout.streets import PAINTED
from pavetwin.scene.models import BODY
from pavetwin.scene.values import TINTS, Instance
from pavetwin.traffic.recording import Recording
from pavetwin.world.model import (
    CARRIAGEWAY_LANES,
    Connection,
    Crossing,
    Direction,
    Furniture,
    FurnitureKind,
    Lane,
    World,
)

VEHICLES: Final = "signal_head"
WALKERS: Final = "signal_pedestrian"

LOW_HEAD_M: Final = 2.95  # Middle of the head on a mast: its underside is at 2.4 m (RiLSA 2015: at least 2.1 m)
BEHIND_KERB_M: Final = 0.5  # From the carriageway to a pole (RASt 06: half a metre next to it is kept free)
REACH_M: Final = 6.0  # A crossing that ends farther from any kerb has no pole there: it ends between the lanes
WALKER_HEAD_M: Final = 2.4
WALKER_POLE_M: Final = 2.9
"""Middle of the heads at crossings, and height of their poles."""

DARK: Final = 0.22  # Colour of a lamp that is off, as a share of its lens
GLOW: Final = 3.0  # See `Instance.tints`
_LIT: Final[Mapping[str, tuple[int, ...]]] = {
    "r": (1,), "s": (1,), "u": (1, 2), "y": (2,), "Y": (2,), "g": (3,), "G": (3,),
}  # fmt: skip
"""SUMO's letters → slots of the lamps that are lit; `o` blinks amber, `O` is off."""


@dataclass(frozen=True, eq=False)
class Head:
    """One signal head."""

    model: str
    transform: Float64Array
    """(4, 4); the model's x axis points at those who are to see it."""
    controller: str
    link: int | None
    """The letter of the controller's state that it shows; None where no connection states it."""

    @property
    def x_m(self) -> float:
        return float(self.transform[0, 3])

    @property
    def y_m(self) -> float:
        return float(self.transform[1, 3])


def heads_of(world: World, road: BaseGeometry) -> tuple[Head, ...]:
    """All signal heads of a world. In a world without connections those on masts show nothing.

    Args:
        road: its carriageway as it is built, on which no pole stands.
    """
    masts = [thing for thing in world.furniture if thing.kind is FurnitureKind.SIGNAL]
    if not masts:
        return ()
    edge_of = {lane.id: lane.edge for lane in world.lanes}
    by_edge: defaultdict[tuple[str, str], list[Connection]] = defaultdict(list)
    for connection in world.connections:
        if connection.signal is not None:
            by_edge[connection.signal.controller, edge_of[connection.from_lane]].append(connection)
    kerb_lanes = _kerb_lanes(world)
    heads: list[Head] = []
    for mast in masts:
        heads += _on_mast(mast, by_edge, kerb_lanes)
    for crossing in world.crossings:
        if crossing.signal is not None:
            for corner, facing in walker_poles(crossing, road):
                place = upright(*corner, facing, z_m=WALKER_HEAD_M)
                heads.append(Head(WALKERS, place, crossing.signal.controller, crossing.signal.link))
    return tuple(heads)


def instances(heads: Sequence[Head], recording: Recording | None, time_s: float) -> Iterator[Instance]:
    """Heads with their lamps as the recording has them at a time; all off without one."""
    for head in heads:
        yield Instance(head.model, BODY, head.transform, lamps(head, recording, time_s))


def lamps(head: Head, recording: Recording | None, time_s: float) -> Float32Array:
    """(TINTS, 4) of a head at a time."""
    tints = np.full((TINTS, 4), DARK, dtype=np.float32)
    tints[:, 3] = 0.0
    shown = letter(head, recording, time_s)
    blinks = (2,) if shown == "o" and time_s % 1.0 < 0.5 else ()
    for slot in _LIT.get(shown, blinks):
        tints[slot - 1] = (1.0, 1.0, 1.0, GLOW)
    return tints


def letter(head: Head, recording: Recording | None, time_s: float) -> str:
    """SUMO's letter for a head at a time, `O` where nothing is known."""
    states = recording.signals.get(head.controller, ()) if recording is not None else ()
    if recording is None or head.link is None or not states:
        return "O"
    step = time_s / recording.step_s + 1e-9
    _, state = states[max(0, bisect.bisect_right(states, step, key=lambda entry: entry[0]) - 1)]
    return state[head.link] if head.link < len(state) else "O"


def _on_mast(
    mast: Furniture, connections: Mapping[tuple[str, str], list[Connection]], kerb_lanes: Mapping[str, Lane]
) -> Iterator[Head]:
    """The two heads of a mast, turned towards the traffic of its edge."""
    edges = [edge for controller, edge in connections if controller == mast.controller and edge in kerb_lanes]
    edge = min(edges, key=lambda name: _misfit(mast, kerb_lanes[name]), default=None)
    if edge is None:
        facing, link = mast.yaw_rad + math.pi / 2, None
    else:
        facing, link = _heading(kerb_lanes[edge]) + math.pi, _through(connections[mast.controller, edge])
    x, y = mast.position.x, mast.position.y
    ahead = (math.cos(facing), math.sin(facing))
    out = mast.radius_m + 0.02
    yield Head(VEHICLES, upright(x + out * ahead[0], y + out * ahead[1], facing, z_m=LOW_HEAD_M), mast.controller, link)
    if mast.arm_m > 0.8:
        reach = mast.arm_m - 0.25
        end = (x + reach * math.cos(mast.yaw_rad) + 0.1 * ahead[0], y + reach * math.sin(mast.yaw_rad) + 0.1 * ahead[1])
        yield Head(VEHICLES, upright(*end, facing, z_m=mast.height_m), mast.controller, link)


def _kerb_lanes(world: World) -> Mapping[str, Lane]:
    """Edge → its carriageway's lane next to the kerb."""
    lanes = {edge: world.lanes_on(edge, *CARRIAGEWAY_LANES) for edge in {lane.edge for lane in world.lanes}}
    return {edge: of_edge[0] for edge, of_edge in lanes.items() if of_edge}


def _heading(lane: Lane) -> float:
    (ax, ay), (bx, by) = list(lane.centre_line.coords)[-2:]
    return math.atan2(by - ay, bx - ax)


def _misfit(mast: Furniture, lane: Lane) -> float:
    """How far a mast stands from where one for this lane would: metres, and 4 m for a radian."""
    end = lane.centre_line.coords[-1]
    turn = mast.yaw_rad - _heading(lane)
    return math.hypot(mast.position.x - end[0], mast.position.y - end[1]) + 4 * abs(math.cos(turn))


def _through(connections: Sequence[Connection]) -> int | None:
    """The link straight on, else the first that there is: what most drivers go by."""
    order = (Direction.STRAIGHT, Direction.RIGHT, Direction.LEFT)
    ranks = {turn: order.index(painted) for turn, painted in PAINTED.items()}
    ranked = [(ranks.get(each.direction, 3), each.signal.link) for each in connections if each.signal is not None]
    return min(ranked)[1] if ranked else None


def walker_poles(crossing: Crossing, road: BaseGeometry) -> Iterator[tuple[tuple[float, float], float]]:
    """Where the poles of a crossing's heads stand, and which way each faces: in line with one of its sides,
    behind the kerb, which lies farther out than its ends where a corner is rounded."""
    ring = np.asarray(crossing.polygon.exterior.coords)[:4]
    sides = [(ring[k] + ring[(k + 1) % 4]) / 2 for k in range(4)]
    lengths = [float(np.hypot(*(ring[(k + 1) % 4] - ring[k]))) for k in range(4)]
    first = 0 if lengths[0] < lengths[1] else 1
    steps = np.arange(0.0, REACH_M, 0.1)[:, None]
    for k, other in ((first, first + 2), (first + 2, first)):
        across = (sides[k % 4] - sides[other % 4]) / np.hypot(*(sides[k % 4] - sides[other % 4]))
        beside = np.array([-across[1], across[0]])
        tried = sides[k % 4] + steps * across + np.array([[[1.0]], [[-1.0]]]) * beside * (lengths[first] / 2 + 0.25)
        free = shapely.distance(shapely.points(tried), road) >= BEHIND_KERB_M
        side = int(np.where(free.any(axis=1), free.argmax(axis=1), len(steps)).argmin())
        if free[side].any():
            x, y = tried[side, free[side].argmax()].tolist()
            yield (x, y), math.atan2(-across[1], -across[0])
