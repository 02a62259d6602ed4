"""A defect class of your own: rutting, two long shallow troughs in the wheel paths of a lane.

One file registers it, and `--plugin` makes it known to a command:

    pavetwin world build --generate town -o worlds/rutted --plugin examples/rutting.py
    pavetwin fly worlds/rutted --plugin examples/rutting.py
    pavetwin capture worlds/rutted -o datasets/rutted --images 200 --jobs 2 --plugin examples/rutting.py

A design of a study has a key for it, `plugins: [rutting.py]`, relative to the design. The class is placed, drawn,
labelled `Rutting` (after Car, as class 5) and counted like those that ship with PaveTwin.

A class is a function from a random generator to a `Heightfield`: what is drawn, labelled and measured follows from it.
x runs along the defect, y to its left, and cells are at most 5 mm. Equal generators must give equal heightfields.
Beside it stand where on a road it is found, how severe it is, and how common.
"""

import numpy as np

from pavetwin.defects import Heightfield, LabelRule, Marking, Measures, Stains, defect_class
from pavetwin.defects.poses import Poses, RoadSection, poses
from pavetwin.world import Severity

CELL_M = 0.005
LENGTH_M, HALF_TRACK_M, HALF_WIDTH_M, DEPTH_M = (2.5, 6.0), (0.72, 0.85), (0.22, 0.35), (0.008, 0.035)
SAG_M = 0.002
"""How far the lane between the troughs has sunk: it makes them one defect."""
END_M = 0.6
"""Over which it fades out at both ends."""


def in_lanes(rng: np.random.Generator, road: RoadSection, count: int) -> Poses:
    """In the middle of lanes, along them."""
    lane = rng.integers(road.lanes, size=count)
    return poses(rng, (lane + 0.5) * road.lane_width_m - road.width_m / 2, 0.0, 0.01)


def severity(sizes: Measures) -> Severity:
    """By its depth: ASTM D6433 has 6 to 13 mm low, to 25 mm medium, above high."""
    return Severity.LOW if sizes.depth_m <= 0.013 else Severity.MEDIUM if sizes.depth_m <= 0.025 else Severity.HIGH


@defect_class(
    "rutting",
    sample_poses=in_lanes,
    rate=severity,
    width=lambda sizes: sizes.extent_width_m,
    weight=0.05,
    label=LabelRule(least_side_px=40, least_short_side_px=12, least_area_px=400, least_contrast=60.0),
    distress="rutting",
)
def rutting(rng: np.random.Generator) -> Heightfield:
    """Two troughs with the section of a cosine, which wander a little along the road, worn dark by tyres."""
    length, track, half, depth = (rng.uniform(*each) for each in (LENGTH_M, HALF_TRACK_M, HALF_WIDTH_M, DEPTH_M))
    reach_x, reach_y = length / 2 + 0.1, track + half + 0.1
    x = CELL_M * np.arange(-round(reach_x / CELL_M), round(reach_x / CELL_M) + 1)
    y = CELL_M * np.arange(-round(reach_y / CELL_M), round(reach_y / CELL_M) + 1)[:, None]
    knots = np.arange(-reach_x - 1.0, reach_x + 2.0)
    wander, deep = np.interp(x, knots, rng.normal(0, 0.02, len(knots))), rng.uniform(0.7, 1.0, len(knots))
    fade = np.sin(np.pi / 2 * np.clip((length / 2 - np.abs(x)) / END_M, 0, 1)) ** 2
    away = np.abs(np.abs(y - wander) - track) / half
    trough = np.where(away < 1, 0.5 + 0.5 * np.cos(np.pi * away), 0.0) * fade * np.interp(x, knots, deep)
    between = (np.abs(y - wander) < track) * fade
    height = -np.maximum(depth * trough, SAG_M * between)
    clean = np.zeros(height.shape, dtype=np.float32)

    def stains() -> Stains:
        return Stains(dirt=np.float32(0.45) * trough.astype(np.float32), dust=clean, stone=clean, tone=clean)

    return Heightfield(
        height_m=height.astype(np.float32),
        opening=clean,
        exposed=clean,
        cell_m=CELL_M,
        origin_m=(float(x[0]), float(y[0, 0])),
        marking=Marking(margin_m=0.0, closing_m=0.0),
        paint=stains,
    ).settled()
