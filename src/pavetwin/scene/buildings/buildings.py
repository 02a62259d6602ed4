"""A building of the map as façades and a roof."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from shapely import Polygon, STRtree
from shapely.geometry.polygon import orient

from pavetwin.arrays import Float64Array
from pavetwin.scene.buildings.faces import Faces
from pavetwin.scene.buildings.roofs import RoofPlan, build_roof, plan_roof
from pavetwin.scene.buildings.styles import HouseDetail, Situation, style_of
from pavetwin.scene.buildings.walls import Wall, WallBuilder
from pavetwin.scene.values import FacadePiece
from pavetwin.seeds import Stream, child
from pavetwin.world.model import World

KEY: Final = 4
"""Key of this module's child of the scene's random stream."""

TOUCHES_M: Final = 0.3  # Walls nearer to another building than this are party walls
FRONT_M: Final = 25.0  # A wall faces the street if the street is nearer than this and on its side
SMOOTHED_M: Final = 0.12  # Tolerance of the simplified footprint


class Buildings:
    """All buildings of a world, with the neighbours and streets of each."""

    def __init__(self, world: World, *, seed: int) -> None:
        self._world = world
        self._seed = seed
        self._houses = STRtree([building.polygon for building in world.buildings])
        self._roads = STRtree([segment.polygon for segment in world.segments])

    def pieces(
        self, number: int, origin: tuple[float, float], detail: HouseDetail = HouseDetail.FULL
    ) -> tuple[FacadePiece, ...]:
        """The façade pieces of one building, by its place in the world's list, in the frame of a tile's origin."""
        building = self._world.buildings[number]
        rng = child(self._seed, Stream.SCENE, KEY, number)
        footprint = _tidied(building.polygon)
        touching = self._touching(number, footprint)
        style = style_of(self._situation(footprint, building.height_m, touching), rng)
        plan = plan_roof(footprint, building.height_m, style, touching, rng)
        faces = Faces()
        for wall in self._walls(plan, touching, origin):
            WallBuilder(faces, wall, style, rng, detail).build()
        build_roof(faces, _moved(plan, origin), style, rng, detail)
        return tuple(FacadePiece(building.id, mesh, int(layer)) for layer, mesh in faces.meshes().items())

    def _situation(self, footprint: Polygon, height_m: float, touching: Float64Array) -> Situation:
        near = self._roads.query_nearest(footprint, return_distance=True)[1] if len(self._roads) else np.empty(0)
        ring = np.asarray(footprint.exterior.coords)
        return Situation(
            area_m2=footprint.area,
            height_m=height_m,
            street_m=float(near[0]) if len(near) else 1e3,
            joined=len(touching) > 1,
            long_m=float(np.hypot(*np.diff(ring, axis=0).T).max()),
        )

    def _touching(self, number: int, footprint: Polygon) -> Float64Array:
        """(n, 2) points every half metre of the boundary that stand against another building."""
        others = [int(k) for k in self._houses.query(footprint.buffer(TOUCHES_M)) if k != number]
        if not others:
            return np.empty((0, 2))
        near = shapely.union_all([self._world.buildings[k].polygon for k in others])
        ways = np.arange(0.25, footprint.exterior.length, 0.5)
        points = shapely.line_interpolate_point(footprint.exterior, ways)
        return shapely.get_coordinates(points[shapely.distance(points, near) < TOUCHES_M])

    def _walls(self, plan: RoofPlan, touching: Float64Array, origin: tuple[float, float]) -> Sequence[Wall]:
        walls: list[Wall] = []
        for ring in (plan.footprint.exterior, *plan.footprint.interiors):
            corners = np.asarray(ring.coords)
            way = 0.0
            for start, end in pairwise(corners):
                length = float(np.hypot(*(end - start)))
                if length > 0.02:
                    party = _share_touching(start, end, touching) > 0.3
                    walls.append(Wall(start - origin, end - origin, plan.eaves_m, party, False, way))
                way += length
        away = [self._street_m(wall, origin) for wall in walls]
        nearest = min(away, default=FRONT_M)
        fronts = [distance <= nearest + 0.01 and distance < FRONT_M for distance in away]
        return [replace(wall, front=front) for wall, front in zip(walls, fronts, strict=True)]

    def _street_m(self, wall: Wall, origin: tuple[float, float]) -> float:
        """How far the carriageway before a wall is, less for a long wall; `FRONT_M` for one that faces no street."""
        if wall.party or wall.length_m <= 2.2 or not len(self._roads):
            return FRONT_M
        before = shapely.Point((wall.start + wall.end) / 2 + origin + 2.0 * wall.outward)
        return float(self._roads.query_nearest(before, return_distance=True)[1][0]) - 0.15 * wall.length_m


def _tidied(polygon: Polygon) -> Polygon:
    """The footprint without spikes and needless corners, anticlockwise, its courts clockwise."""
    simple = polygon.simplify(SMOOTHED_M)
    usable = simple if isinstance(simple, Polygon) and simple.is_valid and not simple.is_empty else polygon
    return orient(usable, 1.0)


def _share_touching(start: Float64Array, end: Float64Array, touching: Float64Array) -> float:
    if not len(touching):
        return 0.0
    line = shapely.LineString([start, end])
    return float((shapely.distance(line, shapely.points(touching)) < 0.05).sum()) * 0.5 / max(line.length, 0.5)


def _moved(plan: RoofPlan, origin: tuple[float, float]) -> RoofPlan:
    rectangle = None if plan.rectangle is None else plan.rectangle - np.array(origin)
    footprint = shapely.transform(plan.footprint, lambda xy: xy - np.array(origin))
    return replace(plan, footprint=footprint, rectangle=rectangle)
