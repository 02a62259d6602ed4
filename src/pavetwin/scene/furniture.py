"""Street furniture as instances: trees, masts, lamps, signs, and small objects such as bins, benches and hedges."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import shapely
from shapely import Point, STRtree

from pavetwin.arrays import Float64Array
from pavetwin.scene.agents import upright
from pavetwin.scene.appearance import tints
from pavetwin.scene.ground.layout.surfaces import strips_of
from pavetwin.scene.meshes import bounds
from pavetwin.scene.models import BODY
from pavetwin.scene.palettes import PAINTS, drawn
from pavetwin.scene.shafts import SHAFT
from pavetwin.scene.values import Instance, Model
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Furniture, FurnitureKind, Lane, LaneKind, World
from pavetwin.world.parking import ParkingPosition

FURNITURE_KEY: Final = 5  # Key of this module's child of the scene's random stream
GALVANISED: Final = (0.36, 0.37, 0.38)
PAINTED: Final = ((0.36, 0.37, 0.38), (0.06, 0.07, 0.065), (0.17, 0.18, 0.19), (0.03, 0.055, 0.04))
"""Colours of lamp posts in different streets."""

TIMBER: Final = (0.15, 0.11, 0.075)
ARM_RADIUS_M: Final = {FurnitureKind.STREET_LIGHT: 0.035, FurnitureKind.SIGNAL: 0.07}
LAMP_M: Final = 0.62
"""Length of a lamp's head."""

SIGN_FACE_M: Final = 0.35  # From the top of a sign's post down to the middle of its plate
SIGNS: Final = ("sign_triangle", "sign_octagon", "sign_round")
SIGN_SHARES: Final = (0.5, 0.2, 0.3)
"""Signs at unsignalled approaches: give way, stop, or speed limit. Ours."""


def stand(item: Furniture, number: int, ground_m: float, seed: int, models: Mapping[str, Model]) -> Iterator[Instance]:
    """The instances of one item of street furniture.

    Args:
        number: its index in the world's list, the key of its random stream.
        ground_m: height of the ground where it stands.
    """
    rng = child(seed, Stream.SCENE, FURNITURE_KEY, number)
    match item.kind:
        case FurnitureKind.TREE:
            yield from _tree(item, ground_m, rng, models)
        case FurnitureKind.STREET_LIGHT:
            yield from _light(item, ground_m)
        case FurnitureKind.SIGNAL:
            yield from _mast(item, ground_m, "tapered", GALVANISED)
        case FurnitureKind.SIGN:
            yield from _mast(item, ground_m, "straight", GALVANISED)
            yield from _plate(item, rng)
        case FurnitureKind.POLE:
            yield from _mast(item, ground_m, "tapered", TIMBER)


def pole(x_m: float, y_m: float, low_m: float, high_m: float, radius_m: float) -> Instance:
    """A plain post."""
    place = upright(x_m, y_m, 0.0, z_m=low_m, scale=(radius_m, radius_m, high_m - low_m))
    return Instance(SHAFT, "straight", place, tints(GALVANISED))


def _tree(
    item: Furniture, ground_m: float, rng: np.random.Generator, models: Mapping[str, Model]
) -> Iterator[Instance]:
    model = _nearest_tree(item, rng, models)
    low, high = bounds(model.parts["crown"])
    across = item.radius_m / model.extras["crown_radius_m"]
    clear = max(item.clear_height_m, ground_m + 0.2)
    upwards = (item.height_m - clear) / float(high[2] - low[2])
    yaw = float(rng.uniform(0, 2 * math.pi))
    x, y = item.position.x, item.position.y
    fresh, yellow = np.exp((0.16, 0.10) * np.clip(rng.standard_normal(2), -2, 2))
    leaf = (float(fresh * yellow), float(fresh), float(fresh * 0.9))
    crown = upright(x, y, yaw, z_m=clear - upwards * float(low[2]), scale=(across, across, upwards))
    yield Instance(model.name, "crown", crown, tints(leaf))
    trunk_top = clear + upwards * (float(bounds(model.parts["trunk"])[1][2]) - float(low[2]))
    height = (trunk_top - ground_m) / float(bounds(model.parts["trunk"])[1][2])
    yield Instance(model.name, "trunk", upright(x, y, yaw, z_m=ground_m, scale=(across, across, height)), tints())


def _nearest_tree(item: Furniture, rng: np.random.Generator, models: Mapping[str, Model]) -> Model:
    """A model that needs the least scaling: one of the nearest two."""
    trees = [models[name] for name in sorted(models) if name.startswith("tree_")]

    def stretch(model: Model) -> float:
        across = math.log(item.radius_m / model.extras["crown_radius_m"])
        upwards = math.log(item.height_m / model.extras["height_m"])
        return abs(across) + abs(upwards) + abs(across - upwards)

    ranked = sorted(trees, key=stretch)
    return ranked[int(rng.random() < 0.35) if len(ranked) > 1 else 0]


def _light(item: Furniture, ground_m: float) -> Iterator[Instance]:
    street = int(item.position.x // 150) * 31 + int(item.position.y // 150)
    colour = PAINTED[street % len(PAINTED)]
    yield from _mast(item, ground_m, "tapered", colour)
    reach = max(0.0, item.arm_m - LAMP_M)
    x = item.position.x + reach * math.cos(item.yaw_rad)
    y = item.position.y + reach * math.sin(item.yaw_rad)
    yield Instance("lamp_head", BODY, upright(x, y, item.yaw_rad, z_m=item.height_m), tints(colour))


def _mast(item: Furniture, ground_m: float, part: str, colour: tuple[float, float, float]) -> Iterator[Instance]:
    """The mast and, where it has one, its arm."""
    x, y = item.position.x, item.position.y
    size = (item.radius_m, item.radius_m, item.height_m - ground_m)
    yield Instance(SHAFT, part, upright(x, y, 0.0, z_m=ground_m, scale=size), tints(colour))
    if item.arm_m > 0:
        radius = ARM_RADIUS_M[item.kind]
        length = item.arm_m - (LAMP_M if item.kind is FurnitureKind.STREET_LIGHT else 0.0)
        place = upright(x, y, item.yaw_rad, z_m=item.height_m - radius, scale=(max(length, 0.05), radius, radius))
        yield Instance(SHAFT, "level", place, tints(colour))


def _plate(item: Furniture, rng: np.random.Generator) -> Iterator[Instance]:
    """The plate faces oncoming traffic: its edge is along the furniture's yaw, as in its solid."""
    name = SIGNS[int(rng.choice(len(SIGNS), p=SIGN_SHARES))]
    facing = item.yaw_rad + math.pi / 2
    x = item.position.x + (item.radius_m + 0.012) * math.cos(facing)
    y = item.position.y + (item.radius_m + 0.012) * math.sin(facing)
    yield Instance(name, BODY, upright(x, y, facing, z_m=item.height_m - SIGN_FACE_M), tints())


EXTRAS_KEY: Final = 6  # Key of this module's child of the scene's random stream
HIGHEST_M: Final = 1.2
SPACING_M: Final = (9.0, 26.0)
"""Distance along a sidewalk between two candidate places."""

FROM_ROAD_M: Final = 0.6  # Least distance from the carriageway: the clearance that posts keep from roads
APART_M: Final = 1.4  # Least distance between middles, also from the world's furniture


@dataclass(frozen=True, slots=True)
class StreetObjectKind:
    """One kind of street object, and how often it is chosen."""

    model: str
    share: float
    half_m: float  # Radius of its free circle
    behind_m: float  # Distance of its centre behind the sidewalk's edge
    near_houses: bool | None = None  # True: only within 8 m of a house; False: only farther
    coloured: bool = False


KINDS: Final = (
    StreetObjectKind("bin", 0.26, 0.3, 0.35, None),
    StreetObjectKind("bench", 0.20, 0.95, 0.55, None),
    StreetObjectKind("bicycle", 0.18, 0.9, 0.5, True, coloured=True),
    StreetObjectKind("bicycle_stand", 0.08, 0.5, 0.5, True),
    StreetObjectKind("bollard", 0.12, 0.12, 0.2, True),
    StreetObjectKind("hydrant", 0.06, 0.25, 0.35, None),
    StreetObjectKind("hedge", 0.10, 0.6, 0.7, False),
)
"""Shares: ours, after photographs of streets."""


@dataclass(frozen=True, eq=False)
class StreetObject:
    """One object along a street."""

    model: str
    x_m: float
    y_m: float
    yaw_rad: float
    """Direction of its x axis, which faces the road."""
    tints: np.ndarray[tuple[int, int], np.dtype[np.float32]]


class StreetObjects:
    """Places street objects along a world's sidewalks."""

    def __init__(self, world: World, *, seed: int) -> None:
        self._world = world
        self._seed = seed

    def extras(self) -> Sequence[StreetObject]:
        """All street objects of a world, in the order of its sidewalks."""
        taken: list[tuple[float, float]] = []
        placed: list[StreetObject] = []
        for number, lane in enumerate(self._world.lanes_of(LaneKind.SIDEWALK)):
            for extra in self._along(lane, child(self._seed, Stream.SCENE, EXTRAS_KEY, number)):
                if all(math.dist((extra.x_m, extra.y_m), other) > APART_M for other in taken[-200:]):
                    taken.append((extra.x_m, extra.y_m))
                    placed.append(extra)
        return placed

    def _along(self, lane: Lane, rng: np.random.Generator) -> Iterator[StreetObject]:
        station = float(rng.uniform(2.0, SPACING_M[1]))
        while station < lane.length_m - 2.0:
            kind = KINDS[int(rng.choice(len(KINDS), p=[each.share for each in KINDS]))]
            colour = drawn(PAINTS, rng)
            at, out = self._behind(lane, station, kind.behind_m)
            if self._is_free(at, kind):
                yaw = math.atan2(-out[1], -out[0])
                turned = yaw + math.pi / 2 if kind.model in ("bicycle", "hedge") else yaw
                yield StreetObject(kind.model, at[0], at[1], turned, tints(colour) if kind.coloured else tints())
            station += float(rng.uniform(*SPACING_M))

    def _behind(self, lane: Lane, station_m: float, behind_m: float) -> tuple[tuple[float, float], Float64Array]:
        """A place behind the edge of a sidewalk that is away from the road, and the direction to there."""
        line = lane.centre_line
        a, b = line.interpolate(max(0.0, station_m - 0.5)), line.interpolate(station_m + 0.5)
        along = np.array([b.x - a.x, b.y - a.y]) / max(math.hypot(b.x - a.x, b.y - a.y), 1e-9)
        left = np.array([-along[1], along[0]])
        middle = np.array([(a.x + b.x) / 2, (a.y + b.y) / 2])
        to_left, to_right = (self._road_distance(middle + side * left) for side in (1.0, -1.0))
        out = left if to_left > to_right else -left
        at = middle + (lane.width_m / 2 + behind_m) * out
        return (float(at[0]), float(at[1])), out

    def _is_free(self, at: tuple[float, float], kind: StreetObjectKind) -> bool:
        point = Point(at)
        if self._road_distance(at) < max(FROM_ROAD_M, kind.half_m + 0.1):
            return False
        if _distance(self._places, point) < kind.half_m:
            return False
        to_house = _distance(self._houses, point)
        if to_house < kind.half_m + 0.1 or kind.near_houses not in (None, to_house < 8.0):
            return False
        return _distance(self._standing, point) > APART_M and _distance(self._walks, point) > 0.0

    def _road_distance(self, at: Float64Array | tuple[float, float]) -> float:
        return float(shapely.distance(self._road, Point(at)))

    @cached_property
    def _road(self) -> shapely.Geometry:
        road = self._world.carriageway
        shapely.prepare(road)
        return road

    @cached_property
    def _houses(self) -> STRtree:
        return STRtree([building.polygon for building in self._world.buildings])

    @cached_property
    def _places(self) -> STRtree:
        """Parking bays along the carriageway."""
        beside = [place for place in self._world.parking if place.position is not ParkingPosition.LANE]
        return STRtree([place.polygon for place in beside])

    @cached_property
    def _standing(self) -> STRtree:
        return STRtree([item.position for item in self._world.furniture])

    @cached_property
    def _walks(self) -> STRtree:
        return STRtree(strips_of(self._world.lanes_of(LaneKind.SIDEWALK)))


def _distance(tree: STRtree, point: Point) -> float:
    """Distance to the nearest shape; large if there is none."""
    return float(tree.query_nearest(point, return_distance=True)[1][0]) if len(tree) else 1e3
