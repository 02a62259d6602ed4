"""Repairs where streets meet: patches and sealed cracks that follow no lane."""

from typing import Final

import numpy as np
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Junction

PATCH_M2: Final = 170.0
"""Carriageway area per repaired rectangle."""

SEALED_M2: Final = 110.0
"""Carriageway area per sealed crack."""


def junction_repairs(layout: SurfaceLayout, junction: Junction) -> tuple[list[tuple[float, ...]], list[Float64Array]]:
    """Patches of a junction as `Repairs` holds them, and the lines of its sealed cracks, (n, 2) each, world frame."""
    area = shapely.intersection(layout.road_near(shapely.box(*junction.polygon.bounds)), junction.polygon)
    inner = area.buffer(-0.8)
    rng = child(layout.seed, Stream.SCENE, 8, layout.name_hash(f"junction {junction.id}"))
    patches: list[tuple[float, ...]] = []
    lines: list[Float64Array] = []
    if inner.is_empty:
        return patches, lines
    shapely.prepare(inner)
    low, high = np.array(inner.bounds).reshape(2, 2)
    edges = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
    square = float(np.arctan2(*(edges[1] - edges[0])[::-1])) if len(edges) > 2 else 0.0
    for _ in range(rng.poisson(area.area / PATCH_M2)):
        x, y = rng.uniform(low, high)
        if inner.contains(shapely.Point(x, y)):
            long, wide = rng.uniform(0.4, 3.2), rng.uniform(0.3, 0.8)
            turn = square + rng.choice([0.0, np.pi / 2]) + rng.normal(0.0, 0.06)
            tone = rng.uniform(0.68, 0.93) if rng.random() < 0.8 else rng.uniform(1.05, 1.15)
            patches.append((x, y, turn, long, wide, tone))
    for _ in range(rng.poisson(area.area / SEALED_M2)):
        steps = int(rng.uniform(1.5, 9.0) / 0.35)
        turn = rng.uniform(0.0, 2 * np.pi) + np.cumsum(rng.normal(0.0, 0.16, steps))
        path = rng.uniform(low, high) + 0.35 * np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]), axis=0)
        inside = shapely.contains_xy(inner, path)
        # A crack ends where it first leaves.
        kept = path[: int(np.argmin(inside))] if not inside.all() else path
        if len(kept) > 4:
            lines.append(kept)
    return patches, lines
