"""Grass and moss: in old cracks, as a world's defects say (their parameter `overgrown`), and as `edge_plants` says.

They are held in the maps like paint: they cover what is below, and their edges follow the stones. So the outline of a
crack and its label stay as they are.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Point, STRtree

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.distractors.edge_plants import edge_plants
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.materials.compose import PAINTS
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Defect

KEY: Final = 17
"""Key of this module's children of the scene's random stream."""

LEAST: Final = 0.03
"""Cracks with less of their length overgrown have no plant large enough to be seen."""

TUFT_M: Final = (0.03, 0.16)
"""Length of a tuft along its crack; its width is a third to the whole of it, 1.4 to 5 cm. Ours."""

WIDTH_M: Final = (0.014, 0.05)

STEP_M: Final = 0.05
"""Distance of the points in which a crack's course is known."""

APART_M: Final = 0.4
"""Least distance of a plant from the middle lines of paint."""

KINDS: Final = ("moss", "grass", "straw")
"""Among `PAINTS`; those of one crack are of one kind."""


def plants(layout: SurfaceLayout, painted: Paint) -> Paint:
    """All plants on the carriageways of a world.

    Args:
        painted: what is painted already; plants keep off it, as maps mix the colours of neighbouring texels.
    """
    lines = STRtree([LineString(ends) for ends in painted.ends()])
    bars: list[tuple[float, ...]] = []
    looks: list[tuple[float, float]] = []
    for defect in layout.world.defects:
        share = dict(defect.parameters).get("overgrown", 0.0)
        if share < LEAST:
            continue
        rng = child(layout.seed, Stream.SCENE, KEY, defect.seed)
        which = list(PAINTS).index(KINDS[int(rng.integers(len(KINDS)))]) / (len(PAINTS) - 1)
        for tuft in _tufts(defect, share, rng):
            wear = float(rng.uniform(0.1, 0.5))
            if not len(lines.query(Point(tuft[:2]), "dwithin", distance=APART_M)):
                bars.append(tuft)
                looks.append((which, wear))
    for tuft, rng in edge_plants(layout):
        if not len(lines.query(Point(tuft[:2]), "dwithin", distance=APART_M)):
            bars.append(tuft)
            which = list(PAINTS).index(KINDS[int(rng.integers(len(KINDS)))]) / (len(PAINTS) - 1)
            looks.append((which, float(rng.uniform(0.1, 0.5))))
    tufts = np.array(bars, dtype=np.float64).reshape(-1, 5)
    is_former = np.zeros(len(tufts), dtype=np.bool_)
    return Paint(tufts, np.array(looks).reshape(-1, 2), (), np.zeros((0, 2)), is_former, np.zeros((0, 6)))


def _tufts(defect: Defect, share: float, rng: np.random.Generator) -> Iterator[tuple[float, ...]]:
    """Bars along a crack, crowded in parts of it, that cover a share of its length."""
    course = _course(defect)
    length = STEP_M * (len(course) - 1)
    count = int(rng.poisson(share * length / np.mean(TUFT_M)))
    crowds = rng.random(max(1, round(length / 0.8)))
    for _ in range(count):
        at = float(np.clip(rng.choice(crowds) + rng.normal(0.0, 0.12), 0.0, 1.0)) * (len(course) - 1.001)
        leg = int(at)
        step = course[leg + 1] - course[leg]
        if np.hypot(*step) > 1.5 * STEP_M:  # over to a branch
            continue
        x, y = course[leg] + (at - leg) * step + rng.normal(0.0, 0.004, 2)
        reach = float(rng.uniform(*TUFT_M))
        width = float(np.clip(reach * rng.uniform(0.33, 1.0), *WIDTH_M))
        turn = float(np.arctan2(step[1], step[0]) + rng.normal(0.0, 0.35))
        yield float(x), float(y), turn, reach / 2, width / 2


def _course(defect: Defect) -> Float64Array:
    """The middle line of a crack's outline, (n ≥ 2, 2) in the world frame."""
    cos, sin = np.cos(defect.yaw_rad), np.sin(defect.yaw_rad)
    to_world = np.array([[cos, sin], [-sin, cos]])
    middle = np.array([defect.centre.x, defect.centre.y])
    own = shapely.transform(defect.polygon, lambda points: (points - middle) @ to_world.T)
    low_x, low_y, high_x, high_y = own.bounds
    x = np.linspace(low_x + 0.02, high_x - 0.02, max(2, int((high_x - low_x) / STEP_M) + 1))
    cuts = shapely.linestrings([[(at, low_y - 1), (at, high_y + 1)] for at in x])
    parts, cut = shapely.get_parts(shapely.intersection(cuts, own), return_index=True)
    # Beside a branch the crack itself is the wider part.
    order = np.lexsort((-shapely.length(parts), cut))
    chosen = order[np.searchsorted(cut[order], np.unique(cut))]
    return np.asarray(shapely.get_coordinates(shapely.centroid(parts[chosen])) @ to_world + middle)
