"""How each lane and segment of a town wears, as tables by their numbers, for the maps of all tiles."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pavetwin.arrays import Float32Array, Int32Array
from pavetwin.scene.ground.layout.streets import StreetPlan
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.world.model import Lane, Segment


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
        """Of the lanes and segments of a layout, each with its street, in the order of their numbers."""
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
