"""Overhead wires along streets and to houses, and the strips of ground that thin round things shade."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString, Point, STRtree
from shapely.ops import nearest_points

from pavetwin.arrays import Float64Array
from pavetwin.scene.appearance import tints
from pavetwin.scene.ground.styles.street_style import Overhead
from pavetwin.scene.shafts import WIRE
from pavetwin.scene.values import Instance
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Furniture, FurnitureKind, World

STEP_M: Final = 0.25  # Strips follow the height of the ground in steps of this length
FARTHEST_M: Final = 60.0  # Shadows farther from their segments are left out: the sun's disc has blurred them away
LEVEL_M: Final = 0.004  # Ground that differs by less is level


def shaded_strips(
    segments: Float64Array, to_sun: Float64Array, heights: Callable[[npt.ArrayLike], Float64Array]
) -> Float64Array:
    """The strips of level ground that segments shade.

    Args:
        segments: (n, 7).
        to_sun: (3,) unit vector, above the horizon.
        heights: of the ground [m] at points (m, 2) of the world.

    Returns:
        (m, 8): the part of a segment that shades one level strip (both ends, radius), and the height of that ground.
    """
    a, b = segments[:, :3], segments[:, 3:6]
    # A segment is cut where its shadow would be STEP_M long on ground at height 0.
    flat = (b - a)[:, :2] - to_sun[:2] / to_sun[2] * (b - a)[:, 2:]
    near = np.maximum(a[:, 2], b[:, 2]) / to_sun[2] < FARTHEST_M
    count = np.where(near, np.maximum(np.ceil(np.hypot(*flat.T) / STEP_M), 1), 0).astype(int)
    if not count.sum():
        return np.zeros((0, 8))
    owner = np.repeat(np.arange(len(segments)), count)
    first = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    share = (first + 0.5) / count[owner]
    middle = a[owner] + share[:, None] * (b - a)[owner]
    ground = np.zeros(len(owner))
    for _ in range(2):
        ground = heights(middle[:, :2] - to_sun[:2] / to_sun[2] * (middle[:, 2] - ground)[:, None])
    # Neighbours on one level make one strip.
    starts = np.flatnonzero((first == 0) | (np.abs(np.diff(ground, prepend=np.inf)) > LEVEL_M))
    ends = np.append(starts[1:], len(owner)) - 1
    mine, low, high = owner[starts], first[starts], first[ends] + 1
    step = (b - a)[mine] / count[mine][:, None]
    strips = [a[mine] + low[:, None] * step, a[mine] + high[:, None] * step, segments[mine, 6:], ground[starts, None]]
    return np.concatenate(strips, axis=1)


KEY: Final = 14
"""Key of this module's children of the scene's random stream."""

SPANS_M: Final = (10.0, 58.0)  # Least and greatest distance of two poles with wires between them
PIECE_M: Final = 3.0  # Length of the straight pieces of a sagging wire
ARM_M: Final = 0.9
"""Width of the cross-arm that the upper wires are tied to; those of telephones are tied to the pole below it."""

BELOW_TOP_M: Final = 0.25
LOWER_M: Final = 1.5
"""From a pole's top to the cross-arm, and from there to the lower wires."""

HOUSE_M: Final = 26.0
EAVES_M: Final = 5.2
"""Greatest distance of a house that is connected, and the height of the wire there, if the house is as high. Ours."""

BLACK: Final = (0.025, 0.025, 0.027)
TIMBER: Final = (0.15, 0.11, 0.075)


@dataclass(frozen=True)
class Wires:
    """All wires of a world."""

    pieces: Float64Array
    """(n, 7) as of `thin`."""
    arms: tuple[tuple[float, float, float, float], ...]
    """Cross-arms: middle x, y, z and direction [rad]."""


def wires_of(world: World, rules: Overhead, seed: int) -> Wires:
    """The wires of a world with poles; the same world, rules and seed give the same."""
    poles = [item for item in world.furniture if item.kind is FurnitureKind.POLE]
    if not poles or not world.segments or not rules.wired:
        return Wires(np.zeros((0, 7)), ())
    houses = STRtree([building.polygon for building in world.buildings])
    pieces: list[Float64Array] = []
    arms: dict[str, tuple[float, float, float, float]] = {}
    for number, row in enumerate(_rows(world, poles)):
        rng = child(seed, Stream.SCENE, KEY, number)
        if rng.random() >= rules.wired:
            continue
        count = int(rng.integers(round(rules.wires.least), round(rules.wires.most) + 1))
        places = [(ARM_M * (0.5 - k), 0.0) for k in range(min(count, 2))] + [(0.0, LOWER_M)] * (count > 2)
        places += [(0.08, LOWER_M + 0.35 * k) for k in range(1, count - 2)]
        widths = [rules.diameter_m.at(float(rng.random())) for _ in places]
        sag = rules.sag.at(float(rng.random()))
        for first, second in _spans(row, houses):
            turn = math.atan2(second.position.y - first.position.y, second.position.x - first.position.x)
            for (left, below), width in zip(places, widths, strict=True):
                ends = [_tied(pole, turn, left, below) for pole in (first, second)]
                pieces.append(_hung(ends[0], ends[1], sag * float(rng.uniform(0.85, 1.15)), width / 2))
            for pole in (first, second):
                at = _tied(pole, turn, 0.0, 0.0)
                arms.setdefault(pole.id, (float(at[0]), float(at[1]), float(at[2]), turn + math.pi / 2))
        for pole in row:
            if rng.random() < rules.connections:
                width = rules.diameter_m.at(float(rng.random()))
                pieces += _to_house(world, houses, pole, float(rng.random()), width / 2, sag)
    return Wires(np.concatenate(pieces) if pieces else np.zeros((0, 7)), tuple(arms.values()))


def wire_instances(wires: Wires) -> Iterator[tuple[tuple[float, float], Instance]]:
    """Each piece of wire and each cross-arm with where its middle lies."""
    for row in wires.pieces:
        yield tuple((row[:2] + row[3:5]) / 2), Instance(WIRE, "body", between(row), tints(BLACK))
    for x, y, z, turn in wires.arms:
        half = ARM_M / 2 * np.array([math.cos(turn), math.sin(turn)])
        row = np.array([x - half[0], y - half[1], z, x + half[0], y + half[1], z, 0.045])
        yield (x, y), Instance(WIRE, "body", between(row), tints(TIMBER))


def between(segment: Float64Array) -> Float64Array:
    """(4, 4) that lays a tube of radius 1 from 0 to 1 along x over a segment (7,)."""
    along = segment[3:6] - segment[:3]
    ahead = along / max(float(np.linalg.norm(along)), 1e-9)
    left = np.cross([0.0, 0.0, 1.0] if abs(ahead[2]) < 0.99 else [1.0, 0.0, 0.0], ahead)
    left /= np.linalg.norm(left)
    place = np.eye(4)
    place[:3, 0], place[:3, 1], place[:3, 2] = along, left * segment[6], np.cross(ahead, left) * segment[6]
    place[:3, 3] = segment[:3]
    return place


def _rows(world: World, poles: Sequence[Furniture]) -> list[list[Furniture]]:
    """Poles by street and side of it, in the order of the world."""
    tree = STRtree([segment.centre_line for segment in world.segments])
    rows: defaultdict[tuple[str, bool], list[Furniture]] = defaultdict(list)
    for pole, index in zip(poles, tree.nearest([pole.position for pole in poles]).tolist(), strict=True):
        line = world.segments[index].centre_line
        station = line.project(pole.position)
        a, b = line.interpolate(max(0.0, station - 0.5)), line.interpolate(station + 0.5)
        left = (b.x - a.x) * (pole.position.y - a.y) - (b.y - a.y) * (pole.position.x - a.x) > 0
        rows[world.segments[index].street, left].append(pole)
    return list(rows.values())


def _spans(row: Sequence[Furniture], houses: STRtree) -> Iterator[tuple[Furniture, Furniture]]:
    """Pairs of poles with wires between them: the nearest first, none with more than two neighbours, no rings."""
    pairs = sorted(
        (first.position.distance(second.position), k, j)
        for k, first in enumerate(row)
        for j, second in enumerate(row[:k])
    )
    tied: Counter[int] = Counter()
    group = list(range(len(row)))
    for apart, k, j in pairs:
        if not SPANS_M[0] < apart < SPANS_M[1] or max(tied[k], tied[j]) > 1 or group[k] == group[j]:
            continue
        if len(houses.query(LineString([row[k].position, row[j].position]), "intersects")):
            continue
        tied.update((k, j))
        group = [group[j] if each == group[k] else each for each in group]
        yield row[k], row[j]


def _tied(pole: Furniture, turn_rad: float, left: float, below: float) -> Float64Array:
    """Where a wire is tied to a pole, (3,)."""
    x = pole.position.x - left * math.sin(turn_rad)
    y = pole.position.y + left * math.cos(turn_rad)
    return np.array([x, y, pole.height_m - BELOW_TOP_M - below])


def _hung(a: Float64Array, b: Float64Array, sag: float, radius_m: float) -> Float64Array:
    """(n, 7) pieces of a wire from one point (3,) to another, a parabola."""
    apart = float(np.linalg.norm(b - a))
    share = np.linspace(0.0, 1.0, max(2, math.ceil(apart / PIECE_M)) + 1)
    points = a + share[:, None] * (b - a)
    points[:, 2] -= 4 * sag * apart * share * (1 - share)
    return np.column_stack([points[:-1], points[1:], np.full(len(points) - 1, radius_m)])


def _to_house(
    world: World, houses: STRtree, pole: Furniture, chance: float, radius_m: float, sag: float
) -> Iterator[Float64Array]:
    """The wire from a pole to one of the nearest houses, over the street where there is one."""
    found = []
    for index in sorted(houses.query(pole.position, "dwithin", distance=HOUSE_M).tolist()):
        building = world.buildings[index]
        line = LineString(nearest_points(pole.position, building.polygon))
        if line.length > 4.0 and len(houses.query(line.interpolate(line.length - 0.2).buffer(0.1), "intersects")) < 2:
            over = bool(shapely.intersects(world.carriageway, line))
            found.append((not over, line.length, index, line))
    if found:
        _, _, index, line = sorted(found)[int(chance * min(2, len(found)))]
        end = Point(line.coords[-1])
        high = min(EAVES_M, world.buildings[index].height_m - 0.4)
        start = _tied(pole, 0.0, 0.0, LOWER_M)
        yield _hung(start, np.array([end.x, end.y, high]), sag, radius_m)
