"""A world's ground surfaces and the marks on them: computed once, looked up per tile."""

from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.distractors.fixtures import Fixture, placed
from pavetwin.scene.ground.distractors.repairs import Repairs, repairs
from pavetwin.scene.ground.layout.lines import boxes_of
from pavetwin.scene.ground.layout.streets import StreetPlan, streets_of
from pavetwin.scene.ground.layout.surfaces import SpatialIndex, SurfaceLayout
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.markings.rules import MarkingRules, rules_of
from pavetwin.world.model import Lane, Segment, Surface, World

WIDENED_M: Final = 3.0
"""How far from a street or junction the carriageway is still counted to it."""


class GroundPlan(SurfaceLayout):
    """A world's surfaces and all marks on them, each computed on first use."""

    @cached_property
    def rules(self) -> MarkingRules:
        """How roads are marked where the world lies."""
        return rules_of(self.world)

    @cached_property
    def paint(self) -> Paint:
        return markings(self, self.rules)

    @cached_property
    def repairs(self) -> Repairs:
        return repairs(self, self.fixtures)

    @cached_property
    def fixtures(self) -> tuple[Fixture, ...]:
        """Covers, grates, caps and leaves."""
        return placed(self)

    @cached_property
    def fixture_index(self) -> SpatialIndex:
        return SpatialIndex([shapely.Point(fixture.x, fixture.y) for fixture in self.fixtures])

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
        """(n, 6): a bar as `raster.bars` takes it, and the factor on the reflectance around it."""
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
    def lane_index(self) -> SpatialIndex:
        return SpatialIndex([lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane, _ in self.lanes])

    @cached_property
    def path_index(self) -> SpatialIndex:
        """The ways across junctions."""
        return SpatialIndex([shapely.LineString(path.line) for path in self.paths])

    @cached_property
    def tones(self) -> tuple[SpatialIndex, tuple[float, ...]]:
        """Surfaces of one age each, and their reflectance factors; later ones cover earlier ones."""
        streets = {street.key: self.ageing(street).tone for street in self.streets}
        segments = [(segment.polygon, streets[street.key]) for segment, street in self.segments]
        junctions = self._junction_tones(streets)
        # First all surfaces a little widened: rounded corners belong to the surface next to them.
        shapes: list[tuple[BaseGeometry, float]] = [
            (shape.buffer(WIDENED_M, quad_segs=2), tone) for shape, tone in (*segments, *junctions)
        ]
        shapes += [*junctions, *segments]
        for segment, street in self.segments:
            for start, end, tone in self.repairs.stretches.get(segment.id, ()):
                part = substring(segment.centre_line, start, end).buffer(segment.width_m, cap_style="flat")
                shapes.append((shapely.intersection(part, segment.polygon), tone * streets[street.key]))
        return SpatialIndex([shape for shape, _ in shapes]), tuple(tone for _, tone in shapes)

    def _junction_tones(self, streets: dict[str, float]) -> list[tuple[Surface, float]]:
        """Each junction with its tone: it is as old as the most important street that meets there."""
        best: dict[str, tuple[int, float]] = {}
        for path in self.paths:
            street, junction = path.approach.street, path.approach.junction.id
            rank = (len(street.lanes), streets[street.key])
            best[junction] = max(rank, best.get(junction, rank))
        return [(junction.polygon, best.get(junction.id, (0, 1.0))[1]) for junction in self.world.junctions]


def plan_ground(world: World, seed: int, holes: Sequence[Polygon] = ()) -> GroundPlan:
    """The plan of a world's ground.

    Args:
        world: with its defects.
        seed: of ageing, repairs and markings.
        holes: where patches of defects replace the carriageway, world frame; they must not overlap.
    """
    return GroundPlan(
        world=world, seed=seed, holes=SpatialIndex(list(holes)), road=world.carriageway, streets=streets_of(world)
    )
