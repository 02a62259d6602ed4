"""A tile's ground as meshes: faces of one kind each, from one set of lines, with holes where defects lie."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array, Int64Array
from pavetwin.scene.ground.ground_plan import GroundPlan
from pavetwin.scene.ground.layout.kerbside import BEHIND_M
from pavetwin.scene.ground.layout.lines import ways_along
from pavetwin.scene.ground.layout.paved import PLAIN
from pavetwin.scene.ground.layout.relief import (
    DROP_FAR_M,
    DROP_NEAR_M,
    EXACT_M,
    KERB_WIDTH_M,
    KERBED_FAR_M,
    KERBED_NEAR_M,
    PROFILE,
    Relief,
)
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.meshes import anticlockwise, corners_of, normals_of
from pavetwin.scene.values import PLAIN_FINISH, TILE_M, Finish, GroundKind, GroundPiece, Mesh

SHOULDER_M: Final = 0.8  # Bare strip along a carriageway without a kerb
APRON_M: Final = 1.0  # Paved strip around a house in a garden
TREE_PIT_M: Final = 1.1  # Side of the open earth about a tree in a sidewalk
SPECK_M2: Final = 1.0  # Land that is smaller and lies mostly among pavement is paved too
CORNER_WALK_M: Final = 2.2  # Width of the pavement around the corners of junctions with sidewalks
BAY_RIM_M: Final = 0.16
"""Width of the flush kerb between the carriageway and a bay: a unit as wide as a kerb's (EN 1340)."""

_PAD_M: Final = 6.0

_GRID_M: Final = 1e-8  # Finer than `EXACT_M`, so that corners on an edge stay on it


@dataclass(frozen=True)
class Face:
    """A connected part of a tile."""

    polygon: Polygon  # World frame
    kind: GroundKind
    walk: int = -1  # The sidewalk lane that its paving follows
    gutter: bool = False  # Whether it lies along a kerb
    pit: bool = False  # Whether a tree stands in it
    finish: Finish = PLAIN_FINISH


def faces_of(plan: GroundPlan, key: tuple[int, int], relief: Relief, *, has_holes: bool = True) -> list[Face]:
    """The faces of a tile: together with the holes, if it has them, they cover it exactly."""
    box = tile_box(key)
    wide = tile_box(key, _PAD_M)
    cut = _Cut(plan, box, wide, relief, has_holes)
    # Lines that end on another one are cut there only up to rounding, unless all are snapped to a grid.
    net = shapely.union_all(
        [box.boundary, *(shapely.intersection(line, box) for line in cut.lines())], grid_size=_GRID_M
    )
    polygons = [
        part for part in shapely.get_parts(shapely.polygonize(shapely.get_parts(net))) if isinstance(part, Polygon)
    ]
    return cut.named(polygons)


class _Cut:
    """The lines of a tile and the names of what lies between them."""

    def __init__(self, plan: GroundPlan, box: Polygon, wide: Polygon, relief: Relief, has_holes: bool) -> None:
        self.plan, self.box, self.wide, self.relief = plan, box, wide, relief
        self.road = shapely.intersection(relief.road, wide)
        self.kerb = _grown(self.road, KERB_WIDTH_M)
        self.walks = plan.sidewalks.near(wide)
        corners = shapely.union_all(plan.corners.at(wide, CORNER_WALK_M)).buffer(CORNER_WALK_M)
        around = shapely.intersection(_grown(self.road, CORNER_WALK_M), corners)
        bays = plan.bays.at(wide, BEHIND_M)
        self.bays = shapely.intersection(shapely.union_all(bays), wide)
        self.bay_rim = shapely.intersection(_grown(shapely.difference(self.road, self.bays), BAY_RIM_M), self.bays)
        behind = [bay.buffer(BEHIND_M, join_style="mitre") for bay in bays if plan.sidewalks.near(bay, 1.0)]
        walked = [*(plan.sidewalks.shapes[index] for index in self.walks), *plan.corners.at(wide), around]
        walked += [*behind, *plan.on_sidewalks.at(wide)]
        self.paved = shapely.difference(_closed(shapely.union_all(walked)), self.kerb)
        self.gutter = shapely.union_all(plan.gutters.at(wide))
        self.pits = _tree_pits(plan, wide, self.paved)
        self.holes = shapely.union_all(plan.holes.at(wide) if has_holes else [])
        self.pavements = _pavements(plan, wide)

    def lines(self) -> list[BaseGeometry]:
        edges = [_grown(self.road, distance).boundary for distance, _, _ in PROFILE]
        holes = shapely.intersection(self.holes.boundary, self.road)
        gutter = shapely.intersection(self.gutter.boundary, self.road)
        walks = [self.plan.sidewalks.shapes[index].boundary for index in self.walks]
        behind = [shapely.difference(line, self.kerb) for line in (*walks, self.paved.boundary, self.pits.boundary)]
        joints = [shapely.intersection(shape.boundary, self.road) for shape in list(self.pavements.values())[1:]]
        bays = [shapely.intersection(shape.boundary, self.road) for shape in (self.bays, self.bay_rim)]
        return [*edges, holes, gutter, *bays, *joints, *behind, *self._ramps(), *self._lots()]

    def _ramps(self) -> list[BaseGeometry]:
        """Where dropped kerbs begin and end, and where kerbs do."""
        near = shapely.difference(_grown(self.road, KERB_WIDTH_M + 2.0), self.road)
        crossings = self.plan.crossings.at(self.wide, DROP_FAR_M)
        drops = [crossing.buffer(reach, quad_segs=3) for crossing in crossings for reach in (DROP_NEAR_M, DROP_FAR_M)]
        walks = shapely.union_all(
            [*self.plan.sidewalks.at(self.wide, KERBED_FAR_M), *self.plan.corners.at(self.wide, KERBED_FAR_M)]
        )
        ends = [] if walks.is_empty else [walks.buffer((KERBED_NEAR_M + KERBED_FAR_M) / 2, quad_segs=3)]
        return [shapely.intersection(shape.boundary, near) for shape in (*drops, *ends)]

    def _lots(self) -> list[BaseGeometry]:
        lots, _ = self.plan.lots
        aprons = [
            building.buffer(APRON_M, join_style="mitre") for building in self.plan.buildings.at(self.wide, APRON_M)
        ]
        lines = [shape.boundary for shape in (*lots.at(self.box), *aprons, *self.plan.parks.at(self.box))]
        lines.append(_grown(self.road, SHOULDER_M).boundary)
        built = shapely.union_all([self.kerb, self.paved])
        return [shapely.difference(line, built) for line in lines]

    def named(self, polygons: list[Polygon]) -> list[Face]:
        if not polygons:
            return []
        inner = shapely.point_on_surface(np.array(polygons, dtype=object))
        on_road, on_kerb, on_gutter, on_walk, in_pit, in_hole, on_rim = (
            shapely.intersects(shape, inner)
            for shape in (
                *(self.road, self.kerb, self.gutter, self.paved),
                *(self.pits, self.holes, self.bay_rim),
            )
        )
        kerbed = self.relief.kerbed(inner) > 0.01
        faces = []
        for index, polygon in enumerate(polygons):
            if on_rim[index]:
                faces.append(Face(polygon, GroundKind.CONCRETE))
            elif on_road[index]:
                if not in_hole[index]:
                    faces.append(self._carriageway(polygon, inner[index], gutter=bool(on_gutter[index])))
            elif on_kerb[index]:
                faces.append(Face(polygon, GroundKind.KERB if kerbed[index] else GroundKind.EARTH))
            elif in_pit[index]:
                faces.append(Face(polygon, GroundKind.EARTH, pit=True))
            elif on_walk[index]:
                faces.append(self._walk(polygon, self._walk_at(inner[index])))
            else:
                faces.append(Face(polygon, self._land(inner[index], bool(kerbed[index]))))
        return _without_specks(faces, self.box)

    def _carriageway(self, polygon: Polygon, inner: BaseGeometry, *, gutter: bool) -> Face:
        if gutter:
            return Face(polygon, GroundKind.CONCRETE, gutter=True)
        away = [float(shapely.distance(shape, inner)) for shape in self.pavements.values()]
        kind, finish = list(self.pavements)[int(np.argmin(away))]
        return Face(polygon, kind, finish=finish)

    def _walk(self, polygon: Polygon, walk: int) -> Face:
        if walk < 0:
            return Face(polygon, GroundKind.PAVING)
        kind, finish = self.plan.walk_surfaces[walk]
        return Face(polygon, kind, walk, finish=finish)

    def _walk_at(self, point: BaseGeometry) -> int:
        """The sidewalk lane that a paved place belongs to."""
        reach = np.array([shapely.distance(self.plan.sidewalks.shapes[index], point) for index in self.walks])
        return self.walks[int(reach.argmin())] if len(reach) else -1

    def _land(self, point: BaseGeometry, kerbed: bool) -> GroundKind:
        if not kerbed and shapely.distance(self.road, point) < SHOULDER_M:
            return GroundKind.EARTH
        if self.plan.parks.near(point):
            return GroundKind.GRASS
        lots, owners = self.plan.lots
        found = lots.near(point)
        if not found:
            return GroundKind.GRASS
        building = self.plan.world.buildings[owners[found[0]]]
        built_up = building.polygon.area / lots.shapes[found[0]].area > 0.3
        draw = self.plan.chance(f"lot {building.id}")
        yard = _pick(draw, _BUILT_UP if built_up else _GARDENS)
        by_house = self.plan.buildings.near(point, APRON_M)
        return GroundKind.PAVING if by_house and yard in (GroundKind.GRASS, GroundKind.EARTH) and draw < 0.6 else yard


def _pavements(plan: GroundPlan, wide: Polygon) -> dict[tuple[GroundKind, Finish], BaseGeometry]:
    """Visible area of each material around a tile."""
    index, surfaces = plan.paved
    near = index.near(wide)
    found: dict[tuple[GroundKind, Finish], BaseGeometry] = {}
    if len({surfaces[number].material for number in near}) < 2:
        return {surfaces[near[0]].material if near else PLAIN.material: wide}
    for material, alike in groupby(near, key=lambda number: surfaces[number].material):
        shape = shapely.intersection(shapely.union_all(index.shapes[list(alike)]), wide)
        found = {of: shapely.difference(before, shape) for of, before in found.items() if of != material} | {
            material: shapely.union(found.get(material, shapely.Polygon()), shape)
        }
    return {material: shape for material, shape in found.items() if not shape.is_empty}


_HARD: Final = frozenset(
    {
        *(GroundKind.PAVING, GroundKind.CONCRETE, GroundKind.KERB),
        *(GroundKind.BLOCKS, GroundKind.TILES, GroundKind.SETTS),
    }
)
_SOFT: Final = frozenset({GroundKind.GRASS, GroundKind.EARTH})

_BUILT_UP: Final = {GroundKind.PAVING: 0.4, GroundKind.CONCRETE: 0.25, GroundKind.GRASS: 0.25, GroundKind.EARTH: 0.1}
_GARDENS: Final = {GroundKind.GRASS: 0.72, GroundKind.EARTH: 0.1, GroundKind.PAVING: 0.1, GroundKind.CONCRETE: 0.08}


def _pick(draw: float, shares: Mapping[GroundKind, float]) -> GroundKind:
    for kind, share in shares.items():
        if draw < share:
            return kind
        draw -= share
    return kind


def _grown(shape: BaseGeometry, by_m: float) -> BaseGeometry:
    return shape if by_m == 0 else shape.buffer(by_m, quad_segs=3)


def _closed(shape: BaseGeometry) -> BaseGeometry:
    """Close gaps narrower than 1.2 m, so that no narrow strip of lawn is left between two pavements."""
    closed = shapely.buffer(shape, 0.6, join_style="mitre").buffer(-0.6, join_style="mitre")
    return shapely.union(closed, shape)  # sharp corners lose their tips on the way there and back


def _without_specks(faces: list[Face], box: Polygon) -> list[Face]:
    """Pave small pieces of land. Those at the tile's border stay, since they may continue beyond it."""
    soft = [face.polygon for face in faces if face.kind in _SOFT and not face.pit]
    hard = shapely.union_all([face.polygon for face in faces if face.kind in _HARD])
    specks = [
        land
        for land in shapely.get_parts(shapely.union_all(soft))
        if land.area < SPECK_M2
        and not land.intersects(box.boundary)
        and shapely.intersection(land.boundary, hard).length > 0.5 * land.length
    ]
    if not specks:
        return faces
    inside = shapely.union_all(specks).buffer(EXACT_M)
    walks = [face for face in faces if face.walk >= 0]
    shapes = np.array([face.polygon for face in walks], dtype=object)

    def paved(polygon: Polygon) -> Face:
        beside = replace(walks[int(shapely.distance(shapes, polygon).argmin())], polygon=polygon) if walks else None
        return beside or Face(polygon, GroundKind.PAVING)

    return [paved(face.polygon) if not face.pit and inside.contains(face.polygon) else face for face in faces]


def _tree_pits(plan: GroundPlan, wide: Polygon, paved: BaseGeometry) -> BaseGeometry:
    """Squares of earth about trees in sidewalks, square to the walk."""
    pits: list[BaseGeometry] = []
    for tree in plan.trees.at(wide):
        if not isinstance(tree, Point):
            continue
        walks = plan.sidewalks.near(tree, 0.2)
        if not walks:
            continue
        line = plan.sidewalk_lines[walks[0]]
        station = shapely.line_locate_point(line, tree)
        ahead = shapely.line_interpolate_point(line, min(station + 0.5, line.length))
        back = shapely.line_interpolate_point(line, max(station - 0.5, 0.0))
        turn = float(np.arctan2(ahead.y - back.y, ahead.x - back.x))
        pits.append(_square(tree.x, tree.y, TREE_PIT_M / 2, turn))
    return shapely.intersection(shapely.union_all(pits), paved)


def _square(x: float, y: float, half: float, turn_rad: float) -> Polygon:
    cos, sin = np.cos(turn_rad) * half, np.sin(turn_rad) * half
    corners: Float64Array = np.array([[cos - sin, sin + cos], [-cos - sin, cos - sin]])
    return Polygon(np.concatenate([corners, -corners]) + (x, y))


def ground_pieces(plan: GroundPlan, key: tuple[int, int], *, has_holes: bool = True) -> tuple[GroundPiece, ...]:
    """The meshes of a tile's ground, in the tile's frame, in the order of their kinds and finishs.

    `has_holes`: whether the holes that patches of defects fill are left out.
    """
    relief = Relief(plan, tile_box(key))
    faces = faces_of(plan, key, relief, has_holes=has_holes)
    kinds = sorted({(face.kind, face.finish) for face in faces})
    alike = [[face for face in faces if (face.kind, face.finish) == each] for each in kinds]
    triangles = [_triangles(each) for each in alike]
    heights = _heights(relief, [corners.reshape(-1, 2) for corners, _ in triangles])
    return tuple(
        GroundPiece(kind, _mesh(plan, key, kind, mine, *parts, height), finish)
        for (kind, finish), mine, parts, height in zip(kinds, alike, triangles, heights, strict=True)
    )


def _heights(relief: Relief, points: Sequence[Float64Array]) -> list[Float64Array]:
    """Heights at the corners (n, 2) of each piece; once for corners that several share."""
    if not points:
        return []
    unique, back = np.unique(np.concatenate(points), axis=0, return_inverse=True)
    return np.split(relief.heights(unique)[back], np.cumsum([len(each) for each in points])[:-1])


def _mesh(
    plan: GroundPlan,
    key: tuple[int, int],
    kind: GroundKind,
    faces: Sequence[Face],
    corners: Float64Array,
    face: Int64Array,
    height: Float64Array,
) -> Mesh:
    """Corners (n, 3, 2) of triangles, the face of each triangle, and the heights (3 n,) of the corners."""
    flat = corners.reshape(-1, 2)
    uv = _coordinates(plan, kind, faces, corners, face).reshape(-1, 2)
    local = flat - np.array(key) * TILE_M
    rows = np.column_stack([local, height, uv])
    vertices, indices = np.unique(rows, axis=0, return_inverse=True)
    triangles = np.asarray(indices, dtype=np.uint32).reshape(-1, 3)
    return Mesh(
        positions=vertices[:, :3].astype(np.float32),
        normals=normals_of(vertices[:, :3], triangles),
        indices=triangles,
        uv=vertices[:, 3:].astype(np.float32),
    )


def _triangles(faces: Sequence[Face]) -> tuple[Float64Array, Int64Array]:
    """Anticlockwise corners (n, 3, 2) of the faces' triangles, and the face of each."""
    parts = shapely.constrained_delaunay_triangles(np.array([face.polygon for face in faces], dtype=object))
    triangles, face = shapely.get_parts(parts, return_index=True)
    return anticlockwise(corners_of(triangles)), face


def _coordinates(
    plan: GroundPlan, kind: GroundKind, faces: Sequence[Face], corners: Float64Array, face: Int64Array
) -> Float64Array:
    """Where each corner (n, 3) lies in its detail, metres (n, 3, 2)."""
    if kind is GroundKind.KERB:
        return _on_kerb(plan, corners)
    uv = corners.copy()
    gutters = np.array([each.gutter for each in faces])[face]
    if gutters.any():
        uv[gutters] = _on_kerb(plan, corners[gutters])
    walks = np.array([each.walk for each in faces])[face]
    for walk in np.unique(walks[walks >= 0]):
        mine = walks == walk
        uv[mine] = _along(plan.sidewalk_lines[walk], corners[mine])
    return uv


def _on_kerb(plan: GroundPlan, corners: Float64Array) -> Float64Array:
    """Along the carriageway's edge, and up the section and over its top, for the corners (n, 3, 2) of triangles.

    In gutters the second is the way to the edge, below 0.
    """
    way, length, distance = (part.reshape(-1, 3) for part in plan.edges.locate(corners.reshape(-1, 2)))
    # A triangle across the point where its ring begins goes on beyond the ring's length.
    torn = np.ptp(way, axis=1) > length.min(axis=1) / 2
    way = way + np.where(torn[:, None] & (way < length / 2), length, 0.0)
    inside = np.asarray(shapely.intersects(plan.road, shapely.points(corners.mean(axis=1))))
    section = np.array(PROFILE)
    over = np.interp(distance, section[:, 0], section[:, 2])
    return np.stack([way, np.where(inside[:, None], -distance, over)], axis=-1)


def _along(line: LineString, corners: Float64Array) -> Float64Array:
    """Way along a line and offset to its left, for points (..., 2); straight on beyond its ends."""
    coords = shapely.get_coordinates(line)
    points = corners.reshape(-1, 2)
    station = shapely.line_locate_point(line, shapely.points(points))
    ways = ways_along(coords)
    leg = np.clip(np.searchsorted(ways, station, side="right") - 1, 0, len(coords) - 2)
    start = coords[leg]
    dx, dy = ((coords[leg + 1] - start) / (ways[leg + 1] - ways[leg])[:, None]).T
    ahead, left = (points - start).T
    uv = np.column_stack([ways[leg] + dx * ahead + dy * left, dx * left - dy * ahead])
    return uv.reshape(corners.shape)
