"""A world's ground surfaces and the marks on them: computed once, looked up per tile."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol, TypeVar

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.distractors.fixtures import Fixture, placed
from pavetwin.scene.ground.distractors.marks import marks
from pavetwin.scene.ground.distractors.plants import plants
from pavetwin.scene.ground.distractors.repairs import repairs
from pavetwin.scene.ground.distractors.segment_marks import Repairs
from pavetwin.scene.ground.layout.kerbside import GAP_M, bays_of, in_bays
from pavetwin.scene.ground.layout.lines import boxes_of
from pavetwin.scene.ground.layout.paved import PLAIN, PavedSurface
from pavetwin.scene.ground.layout.streets import StreetPlan, streets_of
from pavetwin.scene.ground.layout.surfaces import SpatialIndex, SurfaceLayout, Wear, strips_of
from pavetwin.scene.ground.markings.painter import Paint, standard_of
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.styles import DEFAULT_STYLE, StreetStyle, street_style
from pavetwin.scene.ground.styles.marking_standard import MarkingStandard, marking_standard
from pavetwin.world.model import Lane, Segment, Surface, World

FORMER_M: Final = 0.012
"""Greatest signed distance to paint of an earlier layout: farther inside today's paint that lies over it."""

LAST_PART: Final = "paint"
"""The name of the part of a plan that is made from the others."""

WIDENED_M: Final = 3.0  # Carriageway within this distance of a street or junction counts to it
Value = TypeVar("Value")


class Keep(Protocol):
    """Gets a value by its name: from where it is kept, or by the function that makes it."""

    def __call__(self, name: str, make: Callable[[], Value], /) -> Value: ...


def made(name: str, make: Callable[[], Value], /) -> Value:  # noqa: ARG001 - nothing is kept
    """Makes the value."""
    return make()


@dataclass(frozen=True)
class GroundPlan(SurfaceLayout):
    """A world's surfaces and all marks on them, each computed on first use."""

    kept: Keep = made
    """Gets what takes long to compute, by its name: from the cache, or by the function."""

    @cached_property
    def standard(self) -> MarkingStandard:
        """Marking standard: that of the style, else that of the world's place."""
        return standard_of(self.world) if self.style.markings is None else marking_standard(self.style.markings)

    @cached_property
    def paint(self) -> Paint:
        return self.kept(LAST_PART, self._painted)

    @cached_property
    def markings(self) -> Paint:
        """Today's and former markings, before anything was laid over them."""
        return self.kept("markings", lambda: markings(self, self.standard))

    def _painted(self) -> Paint:
        drawn = self.markings.resurfaced(shapely.union_all([shape for shape, _ in self._stretches]))
        drawn = drawn.joined(marks(self, drawn))
        return drawn.joined(plants(self, drawn))

    @cached_property
    def repairs(self) -> Repairs:
        return self.kept("repairs", lambda: repairs(self, self.fixtures))

    @cached_property
    def fixtures(self) -> tuple[Fixture, ...]:
        """Covers, grates, caps and leaves."""
        return self.kept("fixtures", lambda: placed(self))

    @cached_property
    def gutters(self) -> SpatialIndex:
        return SpatialIndex(self.kept("gutters", self.made_gutters))

    @cached_property
    def fixture_index(self) -> SpatialIndex:
        return SpatialIndex([shapely.Point(fixture.x, fixture.y) for fixture in self.fixtures])

    @cached_property
    def paint_limits(self) -> Float64Array:
        """(n,) Greatest distance inside each bar of paint that counts [m]."""
        return np.where(self.paint.is_former, FORMER_M, np.inf)

    @cached_property
    def outline_boxes(self) -> tuple[Float64Array, Float64Array]:
        """Lower and upper corners (n, 2) of the outlines of paint."""
        return boxes_of(self.paint.outlines)

    @cached_property
    def seal_boxes(self) -> tuple[Float64Array, Float64Array]:
        """Lower and upper corners (n, 2) of the sealed lines."""
        return boxes_of(self.repairs.seals)

    @cached_property
    def skid_boxes(self) -> tuple[Float64Array, Float64Array]:
        """Lower and upper corners (n, 2) of the tyre marks."""
        return boxes_of(line for line, _ in self.repairs.skids)

    @cached_property
    def patches(self) -> Float64Array:
        """(n, 6): a bar as `raster.covered` takes it, and the factor on the reflectance around it."""
        return np.array(self.repairs.patches, dtype=np.float64).reshape(-1, 6)

    @cached_property
    def spots(self) -> Float64Array:
        """(n, 4): x, y, radius, strength."""
        return np.array(self.repairs.spots, dtype=np.float64).reshape(-1, 4)

    @cached_property
    def segments(self) -> tuple[tuple[Segment, StreetPlan], ...]:
        return tuple((segment, street) for street in self.streets for segment in street.segments)

    @cached_property
    def segment_index(self) -> SpatialIndex:
        return SpatialIndex([segment.polygon for segment, _ in self.segments])

    @cached_property
    def lanes(self) -> tuple[tuple[Lane, StreetPlan], ...]:
        return tuple((lane, street) for street in self.streets for lane in street.lanes)

    @cached_property
    def wear(self) -> Wear:
        """Wear of its lanes and segments, by their numbers."""
        return Wear.of(self, self.lanes, self.segments)

    @cached_property
    def lane_index(self) -> SpatialIndex:
        return SpatialIndex(strips_of(lane for lane, _ in self.lanes))

    @cached_property
    def path_index(self) -> SpatialIndex:
        """The ways across junctions."""
        return SpatialIndex([shapely.LineString(path.line) for path in self.paths])

    @cached_property
    def paved(self) -> tuple[SpatialIndex, tuple[PavedSurface, ...]]:
        """Surfaces of one pavement and age each; later ones cover earlier ones."""
        streets = {street.key: self.surface_of(street) for street in self.streets}
        segments = [(segment.polygon, streets[street.key]) for segment, street in self.segments]
        junctions = self._paved_junctions(streets)
        # First all surfaces a little widened: rounded corners belong to the surface next to them, bays to their street.
        of_segment = {segment.id: streets[street.key] for segment, street in self.segments}
        shapes: list[tuple[BaseGeometry, PavedSurface]] = [
            *((shape.buffer(GAP_M, quad_segs=2), of_segment[segment]) for shape, segment in in_bays(self.world)),
            *((shape.buffer(WIDENED_M, quad_segs=2), paved) for shape, paved in (*segments, *junctions)),
        ]
        shapes += [*junctions, *segments]
        for segment, _ in self.segments:
            shapes += self.repairs.lanes.get(segment.id, ())
        shapes += self._stretches
        for segment, _ in self.segments:
            shapes += self.repairs.cuts.get(segment.id, ())
        return SpatialIndex([shape for shape, _ in shapes]), tuple(paved for _, paved in shapes)

    @cached_property
    def _stretches(self) -> list[tuple[BaseGeometry, PavedSurface]]:
        """Parts of segments that were resurfaced."""
        found: list[tuple[BaseGeometry, PavedSurface]] = []
        for segment, _ in self.segments:
            for start, end, paved in self.repairs.stretches.get(segment.id, ()):
                part = substring(segment.centre_line, start, end).buffer(segment.width_m, cap_style="flat")
                found.append((shapely.intersection(part, segment.polygon), paved))
        return found

    def paved_at(self, x_m: float, y_m: float) -> PavedSurface:
        """The surface at a point, in the world frame."""
        index, surfaces = self.paved
        found = index.near(shapely.Point(x_m, y_m))
        return surfaces[found[-1]] if found else PLAIN

    def paved_in(self, hole: int) -> PavedSurface:
        """The surface that the patch in a hole is made of: the one in its middle."""
        middle = self.holes.shapes[hole].centroid
        return self.paved_at(middle.x, middle.y)

    def _paved_junctions(self, streets: dict[str, PavedSurface]) -> list[tuple[Surface, PavedSurface]]:
        """Each junction with its surface: that of the most important street that meets there."""
        best: dict[str, tuple[int, float, str]] = {}
        for path in self.paths:
            street, junction = path.approach.street, path.approach.junction.id
            rank = (len(street.lanes), streets[street.key].finish.tone, street.key)
            best[junction] = max(rank, best.get(junction, rank))
        return [
            (junction.polygon, streets[best[junction.id][2]] if junction.id in best else PLAIN)
            for junction in self.world.junctions
        ]


def plan_ground(
    world: World, seed: int, holes: Sequence[Polygon] = (), style: StreetStyle | None = None, kept: Keep = made
) -> GroundPlan:
    """The plan of a world's ground.

    Args:
        world: with its defects.
        seed: of ageing, repairs and markings.
        holes: where patches of defects replace the carriageway, world frame; they must not overlap.
        style: of its streets; the default one unless given.
        kept: see `GroundPlan`; nothing is kept unless given.
    """
    bays = bays_of(world)
    return GroundPlan(
        world=world,
        seed=seed,
        holes=SpatialIndex(list(holes)),
        road=world.carriageway if bays.is_empty else shapely.union(world.carriageway, bays),
        bays=SpatialIndex([part for part in shapely.get_parts(bays) if not part.is_empty]),
        streets=streets_of(world),
        style=style or street_style(DEFAULT_STYLE),
        kept=kept,
    )
