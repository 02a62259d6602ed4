"""Grass and moss: in old cracks, in the joints of worn slabs and at the kerbs of worn streets."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Point, STRtree

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.distractors.crack_features import SlabCracks
from pavetwin.scene.ground.layout.lines import LineFrame
from pavetwin.scene.ground.layout.streets import StreetPlan
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.materials.compose import PAINTS
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Defect, Segment
from pavetwin.world.pavement_joints import joints_across, joints_along
from pavetwin.world.segments import segment_key

EDGE_KEY: Final = 18  # Key of this module's children of the scene's random stream
GROWS_FROM_AGE: Final = 0.35  # Least age of a street's surface; on newer ones nothing has taken root
AT_KERBS_PER_100_M: Final = 45.0
"""Mean number of tufts along both kerbs of 100 m of a street that is due for renewal. Ours, as all numbers here."""

IN_JOINTS_PER_100_M: Final = 60.0  # On 100 m of joints between slabs of such a street
ON_MAIN_STREETS: Final = 0.25  # Main streets are swept, and wheels run close to their kerbs: × the number on others
CROWD_M: Final = 1.6  # Standard deviation of the way along a joint or kerb within a crowd of about five
EDGE_TUFT_M: Final = (0.04, 0.34)  # Length along the joint or kerb
EDGE_WIDTH_M: Final = (0.015, 0.075)
IN_JOINT_M: Final = 0.045
"""Greatest width in a joint."""

KERB_WITHIN_M: Final = 0.5  # Farther from the edge of the segment there is a bay, not a kerb
CLEAR_M: Final = 0.1  # Least distance from the patch of a defect, which plants must not hide


def edge_plants(layout: SurfaceLayout) -> Iterator[tuple[tuple[float, ...], np.random.Generator]]:
    """The bars of all tufts, each with the random generator of its segment."""
    rate = layout.style.dirt.plants
    for street in layout.streets if rate else ():
        worn = max(0.0, layout.ageing(street).age - GROWS_FROM_AGE) / (1 - GROWS_FROM_AGE)
        for segment in street.segments if worn else ():
            rng = child(layout.seed, Stream.SCENE, EDGE_KEY, segment_key(segment))
            number = rate * worn * (ON_MAIN_STREETS if street.main else 1.0)
            for bar in (*_at_kerbs(layout, segment, number, rng), *_in_joints(layout, street, segment, number, rng)):
                if not layout.holes.near(shapely.Point(bar[:2]), CLEAR_M + bar[3]):
                    yield bar, rng


def _at_kerbs(
    layout: SurfaceLayout, segment: Segment, rate: float, rng: np.random.Generator
) -> Iterator[tuple[float, ...]]:
    stations = _crowded(rng, segment.length_m, rate * AT_KERBS_PER_100_M / 100)
    sides = rng.choice([-1.0, 1.0], len(stations))
    points = LineFrame(segment.centre_line).points(stations, sides * segment.width_m / 2)
    if not len(points):
        return
    lines = layout.edges.pieces[layout.edges.tree.nearest(shapely.points(points))]
    at = shapely.line_locate_point(lines, shapely.points(points))
    feet = shapely.get_coordinates(shapely.line_interpolate_point(lines, at))
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(lines, np.maximum(0.05, at + 0.05)))
    back = shapely.get_coordinates(shapely.line_interpolate_point(lines, np.maximum(0.0, at - 0.05)))
    for point, foot, step in zip(points, feet, ahead - back, strict=True):
        length = float(np.hypot(*step))
        long, wide = _tuft(rng, EDGE_WIDTH_M[1])
        if length < 1e-6 or np.hypot(*(point - foot)) > KERB_WITHIN_M:
            continue
        # The surface lies to the left of its edges.
        x, y = foot + np.array([-step[1], step[0]]) / length * 0.4 * wide
        yield float(x), float(y), float(np.arctan2(step[1], step[0]) + rng.normal(0.0, 0.06)), long / 2, wide / 2


def _in_joints(
    layout: SurfaceLayout, street: StreetPlan, segment: Segment, rate: float, rng: np.random.Generator
) -> Iterator[tuple[float, ...]]:
    slabs = layout.pavement(street).slabs
    if slabs is None or segment.length_m < slabs.every_m:
        return
    cracks, frame = SlabCracks.of(layout, segment), LineFrame(segment.centre_line)
    half = segment.width_m / 2
    lines = [((at, -half), (at, half)) for at in cracks.across(joints_across(segment, slabs.every_m)).tolist()]
    lines += [((0.0, left), (segment.length_m, left)) for left in cracks.along(joints_along(segment)).tolist()]
    for start, end in np.array(lines).reshape(-1, 2, 2):
        length = float(np.hypot(*(end - start)))
        for way in _crowded(rng, length, rate * IN_JOINTS_PER_100_M / 100).tolist():
            station, left = start + (end - start) * way / length
            long, wide = _tuft(rng, IN_JOINT_M)
            (x, y), (x2, y2) = frame.points([station, station + 0.1], [left, left])
            turn = np.arctan2(y2 - y, x2 - x) + (0.0 if abs(end[0] - start[0]) > 1.0 else np.pi / 2)
            yield float(x), float(y), float(turn + rng.normal(0.0, 0.05)), long / 2, wide / 2


def _crowded(rng: np.random.Generator, length_m: float, per_m: float) -> Float64Array:
    """Ways along a line, crowded."""
    number = int(rng.poisson(per_m * length_m))
    crowds = rng.uniform(0.0, length_m, 1 + number // 5)
    ways = rng.choice(crowds, number) + rng.normal(0.0, CROWD_M, number)
    return np.asarray(ways[(ways > 0.1) & (ways < length_m - 0.1)], dtype=np.float64)


def _tuft(rng: np.random.Generator, widest_m: float) -> tuple[float, float]:
    """Length and width."""
    long = float(np.exp(rng.uniform(*np.log(EDGE_TUFT_M))))
    return long, float(np.clip(long * rng.uniform(0.25, 0.8), EDGE_WIDTH_M[0], widest_m))


CRACK_KEY: Final = 17  # Key of this module's children of the scene's random stream
LEAST: Final = 0.03  # Cracks with less of their length overgrown have no plant large enough to be seen
CRACK_TUFT_M: Final = (0.03, 0.16)
"""Length of a tuft along its crack; its width is a third to the whole of it, 1.4 to 5 cm. Ours."""

CRACK_WIDTH_M: Final = (0.014, 0.05)

STEP_M: Final = 0.05  # Distance of the points in which a crack's course is known
APART_M: Final = 0.4  # Least distance of a plant from the middle lines of paint
KINDS: Final = ("moss", "grass", "straw")  # Among `PAINTS`; those of one crack are of one kind


def plants(layout: SurfaceLayout, painted: Paint) -> Paint:
    """All plants on the carriageways of a world.

    Args:
        painted: existing paint, which plants avoid, since maps mix the colours of neighbouring texels.
    """
    lines = STRtree([LineString(ends) for ends in painted.ends()])
    bars: list[tuple[float, ...]] = []
    paints: list[tuple[float, float]] = []
    for defect in layout.world.defects:
        share = dict(defect.parameters).get("overgrown", 0.0)
        if share < LEAST:
            continue
        rng = child(layout.seed, Stream.SCENE, CRACK_KEY, defect.seed)
        which = list(PAINTS).index(KINDS[int(rng.integers(len(KINDS)))]) / (len(PAINTS) - 1)
        for tuft in _tufts(defect, share, rng):
            wear = float(rng.uniform(0.1, 0.5))
            if not len(lines.query(Point(tuft[:2]), "dwithin", distance=APART_M)):
                bars.append(tuft)
                paints.append((which, wear))
    for tuft, rng in edge_plants(layout):
        if not len(lines.query(Point(tuft[:2]), "dwithin", distance=APART_M)):
            bars.append(tuft)
            which = list(PAINTS).index(KINDS[int(rng.integers(len(KINDS)))]) / (len(PAINTS) - 1)
            paints.append((which, float(rng.uniform(0.1, 0.5))))
    tufts = np.array(bars, dtype=np.float64).reshape(-1, 5)
    is_former = np.zeros(len(tufts), dtype=np.bool_)
    return Paint(tufts, np.array(paints).reshape(-1, 2), (), np.zeros((0, 2)), is_former, np.zeros((0, 6)))


def _tufts(defect: Defect, share: float, rng: np.random.Generator) -> Iterator[tuple[float, ...]]:
    """Bars along a crack, crowded in parts of it, that cover a share of its length."""
    course = _course(defect)
    length = STEP_M * (len(course) - 1)
    count = int(rng.poisson(share * length / np.mean(CRACK_TUFT_M)))
    crowds = rng.random(max(1, round(length / 0.8)))
    for _ in range(count):
        at = float(np.clip(rng.choice(crowds) + rng.normal(0.0, 0.12), 0.0, 1.0)) * (len(course) - 1.001)
        leg = int(at)
        step = course[leg + 1] - course[leg]
        if np.hypot(*step) > 1.5 * STEP_M:  # over to a branch
            continue
        x, y = course[leg] + (at - leg) * step + rng.normal(0.0, 0.004, 2)
        reach = float(rng.uniform(*CRACK_TUFT_M))
        width = float(np.clip(reach * rng.uniform(0.33, 1.0), *CRACK_WIDTH_M))
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
    # Next to a branch the crack itself is the wider part.
    order = np.lexsort((-shapely.length(parts), cut))
    chosen = order[np.searchsorted(cut[order], np.unique(cut))]
    return np.asarray(shapely.get_coordinates(shapely.centroid(parts[chosen])) @ to_world + middle)
