"""The marks on carriageways while they are collected, and one segment with its own coordinates and random numbers."""

from dataclasses import dataclass, field
from typing import Final

from shapely import Polygon

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.distractors.seals import clear_of_defects, wavering
from pavetwin.scene.ground.layout.lines import LineFrame
from pavetwin.scene.ground.layout.paved import PavedSurface
from pavetwin.scene.ground.layout.streets import StreetPlan
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Segment, Surface
from pavetwin.world.segments import segment_key

SEAL_HALF_M: Final = (0.013, 0.034)
"""Half the width of a sealed crack: flush fillings of 2 to 3 cm up to overbands of 7 cm (FHWA-RD-99-147)."""

SEAM_HALF_M: Final = (0.009, 0.022)
"""Half the width of a sealed edge or joint: the joint sealant and its overband."""

SEALED_GAPS: Final = (0.001, 0.025)
"""Share of a seal that has come off; with more gaps it would look like a dashed line."""


@dataclass
class Repairs:
    """Marks on all carriageways, world frame, metres."""

    patches: list[tuple[float, ...]] = field(default_factory=list)
    """Middle x and y, direction [rad], half length, half width, factor on the reflectance around them."""
    seals: list[Float64Array] = field(default_factory=list)
    """Lines of bitumen, (n, 2)."""
    seal_halves_m: list[float] = field(default_factory=list)
    seal_gaps: list[float] = field(default_factory=list)
    """Share of each that has come off."""
    stretches: dict[str, list[tuple[float, float, PavedSurface]]] = field(default_factory=dict)
    """Of a segment: from and to along its centre line, and what it was paved with since."""
    lanes: dict[str, list[tuple[Surface, PavedSurface]]] = field(default_factory=dict)
    """Of a segment: strips that were paved apart from the rest, later ones over earlier ones."""
    cuts: dict[str, list[tuple[Polygon, PavedSurface]]] = field(default_factory=dict)
    """Of a segment: repairs of another material, later ones over earlier ones."""
    spots: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Oil and damp: x, y, radius, strength."""
    skids: list[tuple[Float64Array, float]] = field(default_factory=list)
    """Tyre marks: line and strength."""

    def seal(self, plan: SurfaceLayout, line: Float64Array, half_m: float, gaps: float) -> None:
        """A line of bitumen (n, 2), except where it would hide a defect."""
        for part in clear_of_defects(plan, line):
            self.seals.append(part)
            self.seal_halves_m.append(half_m)
            self.seal_gaps.append(gaps)


class SegmentMarks:
    """One segment, its marks drawn in coordinates along its centre line and to its left."""

    def __init__(self, plan: SurfaceLayout, street: StreetPlan, segment: Segment, found: Repairs) -> None:
        self.plan, self.street, self.segment, self.found = plan, street, segment, found
        self.length, self.half = segment.length_m, segment.width_m / 2
        self.pavement = plan.pavement(street)
        self.cracked = plan.ageing(street).cracked * (0.3 + 1.4 * plan.chance(f"mended {street.name}"))
        self.rng = child(plan.seed, Stream.SCENE, 2, segment_key(segment))
        self.world = LineFrame(segment.centre_line).points

    def count(self, mean: float) -> int:
        return int(self.rng.poisson(mean))

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def seal(self, line: Float64Array, half_m: float) -> None:
        """A sealed line (n, 2), world frame."""
        self.found.seal(self.plan, line, half_m, self.between(*SEALED_GAPS))

    def seam(self, a: Float64Array, b: Float64Array, sway_m: float) -> None:
        """A sealed edge from one point (2,) to another, world frame."""
        self.seal(wavering(self.rng, a, b, sway_m), self.between(*SEAM_HALF_M))
