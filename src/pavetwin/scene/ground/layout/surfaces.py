"""Layout of a world's ground surfaces, and the wear of lanes: computed once, looked up per tile."""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float32Array, Int32Array
from pavetwin.scene.ground.layout.kerbside import gutters_of, on_sidewalks
from pavetwin.scene.ground.layout.lines import Edges
from pavetwin.scene.ground.layout.paved import Ageing, PavedSurface, ageing
from pavetwin.scene.ground.layout.streets import Approach, Path, StreetPlan, paths_of
from pavetwin.scene.ground.styles import Pavement, StreetStyle
from pavetwin.scene.values import TILE_M, Finish, GroundKind, tile_bounds
from pavetwin.world.model import Direction, FurnitureKind, Lane, LaneKind, Segment, World
from pavetwin.world.pavement_joints import SLAB_SHARE, has_slabs

CORNERS_TOUCH_M: Final = 0.6  # A junction this near to a sidewalk has paved corners
LARGEST_LOT_M2: Final = 2500.0  # Land farther from a house than this is not its yard
NETWORK: Final = "crocodile_crack"
"""The class of defects that slabs of concrete do not have: ASTM D6433 lists alligator cracking for asphalt only."""

GUTTERED_NEAR_M: Final = 0.5  # Kerbs this near to a sidewalk or to a corner with sidewalks may have a gutter


class SpatialIndex:
    """Spatial index of geometries."""

    def __init__(self, shapes: Sequence[BaseGeometry]) -> None:
        self.shapes = np.array(shapes, dtype=object)
        self._tree = STRtree(shapes)

    def __len__(self) -> int:
        return len(self.shapes)

    def near(self, where: BaseGeometry, within_m: float = 0.0) -> list[int]:
        """Indices of shapes that come within a distance of a place, ascending."""
        if not len(self):
            return []
        how = {"predicate": "dwithin", "distance": within_m} if within_m else {"predicate": "intersects"}
        return sorted(int(index) for index in self._tree.query(where, **how))

    def at(self, where: BaseGeometry, within_m: float = 0.0) -> list[BaseGeometry]:
        """The shapes that come within a distance of a place, in their order."""
        return [self.shapes[index] for index in self.near(where, within_m)]


@dataclass(frozen=True)
class SurfaceLayout:
    """A world's surfaces. The shapes are in the world frame, in metres."""

    world: World
    seed: int
    holes: SpatialIndex
    """Where patches of defects replace the carriageway."""
    road: BaseGeometry
    """The world's carriageway and its bays: all that lies within the kerbs."""
    bays: SpatialIndex
    """Parking bays along the carriageway."""
    streets: tuple[StreetPlan, ...]
    style: StreetStyle

    @cached_property
    def road_pieces(self) -> SpatialIndex:
        """Area within the kerbs, cut along the tiles' lines, so that a tile reads its own part only."""
        low_x, low_y, high_x, high_y = shapely.bounds(self.road)
        if np.isnan(low_x):
            return SpatialIndex([])
        step = 4 * TILE_M
        pieces: list[BaseGeometry] = []
        for column in range(int(low_x // step), int(high_x // step) + 1):
            strip = shapely.intersection(
                self.road, shapely.box(column * step, low_y - 1, (column + 1) * step, high_y + 1)
            )
            for row in range(int(low_y // step), int(high_y // step) + 1):
                cell = shapely.box(column * step, row * step, (column + 1) * step, (row + 1) * step)
                pieces.append(shapely.intersection(strip, cell))
        return SpatialIndex([piece for piece in pieces if not piece.is_empty])

    @cached_property
    def edges(self) -> Edges:
        """The kerb line with its stations."""
        return Edges(self.road)

    def road_near(self, box: Polygon) -> BaseGeometry:
        """Area within the kerbs inside a box."""
        return shapely.intersection(shapely.union_all(self.road_pieces.at(box)), box)

    @cached_property
    def sidewalks(self) -> SpatialIndex:
        """Strips of sidewalk lanes, in the order of `sidewalk_lines`."""
        return SpatialIndex(strips_of(self._sidewalk_lanes))

    @cached_property
    def on_sidewalks(self) -> SpatialIndex:
        """Parking places on sidewalks."""
        return SpatialIndex(on_sidewalks(self.world))

    @cached_property
    def sidewalk_lines(self) -> tuple[LineString, ...]:
        return tuple(lane.centre_line for lane in self._sidewalk_lanes)

    @cached_property
    def _sidewalk_lanes(self) -> tuple[Lane, ...]:
        return tuple(self.world.lanes_of(LaneKind.SIDEWALK))

    @cached_property
    def walk_surfaces(self) -> tuple[tuple[GroundKind, Finish], ...]:
        """Material of each sidewalk, in the order of `sidewalk_lines`; the same along a street."""
        streets = {edge: street.street.name for street in self.streets for edge in street.street.edges}
        names = [streets.get(lane.edge, lane.edge) for lane in self._sidewalk_lanes]
        surface = self.style.sidewalks.surface
        made = {
            name: surface(*(self.chance(f"{what} {name}") for what in ("walk", "walk colour", "walk tone")))
            for name in set(names)
        }
        return tuple(made[name] for name in names)

    @cached_property
    def corners(self) -> SpatialIndex:
        """Junctions that sidewalks lead to: outside the carriageway they are paved."""
        shapes = [junction.polygon for junction in self.world.junctions]
        return SpatialIndex([shape for shape in shapes if self.sidewalks.near(shape, CORNERS_TOUCH_M)])

    @cached_property
    def gutters(self) -> SpatialIndex:
        """Concrete along the carriageway of some streets, at its kerbs and before its bays."""
        return SpatialIndex(self.made_gutters())

    def made_gutters(self) -> list[Polygon]:
        walks = [*self.sidewalks.shapes, *self.corners.shapes]
        kerbed = shapely.union_all(shapely.buffer(np.array(walks, dtype=object), GUTTERED_NEAR_M, quad_segs=2))
        return gutters_of(self.world.carriageway, self.world.segments, kerbed) if walks else []

    @cached_property
    def crossings(self) -> SpatialIndex:
        return SpatialIndex([crossing.polygon for crossing in self.world.crossings])

    @cached_property
    def parks(self) -> SpatialIndex:
        return SpatialIndex(list(self.world.parks))

    @cached_property
    def buildings(self) -> SpatialIndex:
        return SpatialIndex([building.polygon for building in self.world.buildings])

    @cached_property
    def trees(self) -> SpatialIndex:
        furniture = self.world.furniture
        return SpatialIndex([item.position for item in furniture if item.kind is FurnitureKind.TREE])

    @cached_property
    def lots(self) -> tuple[SpatialIndex, tuple[int, ...]]:
        """The land nearest to each building, and which building that is."""
        buildings = self.world.buildings
        if len(buildings) < 2:
            return SpatialIndex([]), ()
        middles = np.array([building.polygon.centroid for building in buildings], dtype=object)
        around = shapely.MultiPoint(middles)
        cells = shapely.get_parts(shapely.voronoi_polygons(around, extend_to=around.envelope.buffer(200.0)))
        points, found = STRtree(cells).query(middles, "intersects")
        owner = dict(zip(found.tolist(), points.tolist(), strict=True))
        kept = sorted(owner, key=lambda cell: owner[cell])
        reach = shapely.buffer(middles, (LARGEST_LOT_M2 / np.pi) ** 0.5 + 10.0, quad_segs=2)
        shapes: list[BaseGeometry] = [reach[owner[cell]] & cells[cell] for cell in kept]
        return SpatialIndex(shapes), tuple(owner[cell] for cell in kept)

    @cached_property
    def paths(self) -> tuple[Path, ...]:
        """The ways across junctions."""
        return paths_of(self.world, self.streets)

    @cached_property
    def _ranks(self) -> dict[tuple[str, str], tuple[float, bool]]:
        """Importance of each arm of a junction, and whether a way leads straight on from it."""
        ranks: dict[tuple[str, str], tuple[float, bool]] = {}
        for path in self.paths:
            approach = path.approach
            arm = approach.junction.id, approach.lane.edge
            straight = ranks.get(arm, (0.0, False))[1] or path.turn is Direction.STRAIGHT
            ranks[arm] = (10.0 * len(approach.street.lanes) + approach.lane.speed_limit_mps, straight)
        return ranks

    def gives_way(self, approach: Approach) -> bool:
        """Whether a lane's traffic has to give way at an unsignalled junction: on the lesser arm, or on a T's stem."""
        if approach.junction.kind != "priority":
            return False
        arms = {edge: rank for (junction, edge), rank in self._ranks.items() if junction == approach.junction.id}
        rank, straight = arms.get(approach.lane.edge, (0.0, True))
        return len(arms) > 2 and (rank < max(other for other, _ in arms.values()) - 0.5 or not straight)

    def ageing(self, street: StreetPlan) -> Ageing:
        """Age of a street's surface."""
        age, tone, paint = (self.chance(f"{what} {street.name}") for what in ("age", "tone", "paint"))
        return ageing(self.pavement(street), (age, tone, paint), self.style.paint_wear)

    def pavement(self, street: StreetPlan) -> Pavement:
        """Pavement of a street: concrete slabs first for streets that the world has slabs for, as far as the
        style's share of them goes, and none with networks of cracks, which are a distress of asphalt."""
        chance = self.chance(f"pavement {street.name}")
        rank = SLAB_SHARE * chance if has_slabs(street.name) else SLAB_SHARE + (1 - SLAB_SHARE) * chance
        found = self.style.pavement(main=street.main, chance=rank)
        if found.slabs is None or street.name not in self._with_networks:
            return found
        return self.style.pavement(main=street.main, chance=chance, slabs=False)

    @cached_property
    def _with_networks(self) -> frozenset[str]:
        """Names of the streets that have networks of cracks."""
        found = {defect.segment for defect in self.world.defects if defect.kind == NETWORK}
        return frozenset(self.world.segment(segment).street for segment in found)

    def surface_of(self, street: StreetPlan) -> PavedSurface:
        """The surface of a street, where nothing was paved since."""
        tint, grain = (self.chance(f"{what} {street.name}") for what in ("tint", "grain"))
        return PavedSurface.of(self.pavement(street), self.ageing(street).reflectance, tint, grain)

    def name_hash(self, what: str) -> int:
        """A 32-bit hash of a name and the plan's seed, from which random choices are made."""
        return zlib.crc32(f"{self.seed} {what}".encode())

    def chance(self, what: str) -> float:
        """The same hash, scaled to 0 … 1."""
        return self.name_hash(what) / 2**32


def strips_of(lanes: Iterable[Lane]) -> list[Polygon]:
    """The surface of each lane."""
    return [lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane in lanes]


def tile_box(key: tuple[int, int], margin_m: float = 0.0) -> Polygon:
    """The square of a tile, widened by a margin, world frame."""
    west, south, east, north = tile_bounds(key)
    return shapely.box(west - margin_m, south - margin_m, east + margin_m, north + margin_m)


@dataclass(frozen=True)
class Wear:
    """Tables with one value in reserve at their end, for nothing's number −1."""

    passes: Float32Array
    """(lanes + 1,) factor on the reflectance, of the pass of the paver."""
    wheel_paths: Float32Array
    """(lanes + 1,) change of reflectance in them."""
    oil: Float32Array
    """(lanes + 1,) factor on oil."""
    streaks: Float32Array
    """(segments + 1,) factor on streaks along the street."""
    blotches: Float32Array
    """(segments + 1,) factor on slow changes."""
    parts: Int32Array
    """(segments + 1,) which part of the tables of noise a street has."""

    @classmethod
    def of(
        cls,
        layout: SurfaceLayout,
        lanes: Sequence[tuple[Lane, StreetPlan]],
        segments: Sequence[tuple[Segment, StreetPlan]],
    ) -> "Wear":
        """Wear of the lanes and segments of a layout, each with its street, in the order of their numbers."""
        pavements = {street.key: layout.pavement(street) for _, street in (*lanes, *segments)}
        polish = {street.key: layout.chance(f"polish {street.key}") for _, street in lanes}
        parts = [layout.name_hash(f"part {street.name}") % 4096 for _, street in segments]
        return cls(
            passes=_table(0.97 + 0.06 * layout.chance(f"pass {lane.id}") for lane, _ in lanes),
            wheel_paths=_table(pavements[street.key].wheel_paths.at(polish[street.key]) for _, street in lanes),
            oil=_table(pavements[street.key].oil for _, street in lanes),
            streaks=_table(pavements[street.key].streaks for _, street in segments),
            blotches=_table(pavements[street.key].blotches for _, street in segments),
            parts=np.array([*parts, 0], dtype=np.int32),
        )


def _table(values: Iterable[float]) -> Float32Array:
    return np.array([*values, 1.0], dtype=np.float32)
