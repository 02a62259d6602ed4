"""Placement of flush objects that are not defects: manhole covers, gully grates, valve caps, leaves, bridge joints."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely import Point

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.distractors.crack_features import cover_places
from pavetwin.scene.ground.layout.lines import direction
from pavetwin.scene.ground.layout.relief import heights
from pavetwin.scene.ground.layout.streets import StreetPlan
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.styles.street_style import JointName
from pavetwin.scene.ground.styles.values import pick
from pavetwin.seeds import Stream, child
from pavetwin.world.ground import Nearby, around
from pavetwin.world.model import Junction, Segment
from pavetwin.world.segments import segment_key

MODULE_M: Final = 0.5
"""Length of one module of a steel joint across the street."""

PLUG_HALF_M: Final = 0.25  # Half the width of a plug joint. Ours.
PLUG_TONE: Final = 0.55  # Factor on the reflectance where it lies: much binder. Ours.
END_M: Final = 2.0  # A bridge that ends nearer to a junction has its joint in there, where none is drawn


def joints(plan: SurfaceLayout) -> Iterator[tuple[JointName, Float64Array, float, float]]:
    """Each joint: its kind, its middle (2,), the direction across the street [rad] and half its length [m]."""
    for street in plan.streets:
        line = street.street.centre_line
        for number, ends in enumerate(street.street.bridges):
            kind = pick(plan.style.bridge_joints, plan.chance(f"bridge {street.key} {number}"))
            for station in ends:
                if END_M < station < line.length - END_M:
                    at = line.interpolate(station)
                    dx, dy = direction(line, station)
                    yield kind, np.array([at.x, at.y]), float(np.arctan2(dx, -dy)), _half_width(street, at)


def modules(plan: SurfaceLayout) -> Iterator[tuple[str, float, float, float]]:
    """The modules of steel joints: model, middle x and y, direction of the street [rad]."""
    for kind, middle, across, half in joints(plan):
        if kind != "plug":
            count = int(2 * half / MODULE_M)
            for offset in (np.arange(count) - (count - 1) / 2) * MODULE_M:
                x, y = middle + offset * np.array([np.cos(across), np.sin(across)])
                yield kind, float(x), float(y), across - np.pi / 2


def plugs(plan: SurfaceLayout) -> Iterator[tuple[tuple[float, ...], list[Float64Array]]]:
    """Plug joints: a patch as `Repairs` holds them, and the lines of its two sealed edges."""
    for kind, middle, across, half in joints(plan):
        if kind == "plug":
            out = np.array([np.cos(across), np.sin(across)])
            aside = PLUG_HALF_M * np.array([-out[1], out[0]])
            ends = middle - half * out, middle + half * out
            edges = [np.array([end + side * aside for end in ends]) for side in (-1, 1)]
            yield (float(middle[0]), float(middle[1]), across, half, PLUG_HALF_M, PLUG_TONE), edges


def _half_width(street: StreetPlan, at: Point) -> float:
    """Half the carriageway's width at a point of a street."""
    nearest = min(street.segments, key=lambda segment: segment.centre_line.distance(at), default=None)
    return nearest.width_m / 2 if nearest is not None else 3.0


REACH_M: Final = {
    "cover_iron": 0.40,
    "cover_filled": 0.40,
    "cover_square": 0.55,
    "cover_collared": 0.62,
    "grate": 0.33,
    "grate_slots": 0.43,
    "valve": 0.145,
    "leaves": 0.9,
    "leaves_few": 0.9,
    "leaf_drift": 1.7,
    "litter": 0.65,
    "litter_paper": 0.5,
    "litter_bag": 0.3,
    "litter_tyre": 0.65,
    "litter_small": 0.75,
    "joint_comb": 0.36,
    "joint_strip": 0.29,
}
"""Radius of each model."""

COVERS_M: Final = 42.0  # Mean distance between manholes along a street; sewers have one each 40 to 60 m (DWA-A 157)
GRATES_M: Final = 32.0  # Mean distance between gullies on one side; each drains about 400 m² (RAS-Ew)
GRATE_AT_M: Final = {"grate": 0.155, "grate_slots": 0.205}  # From a grate's middle to the kerb, which its frame touches
MOST_COVERS: Final = 0.6  # Share of a town's covers that are of its usual kind; the others are of any
LEAVES: Final = ("leaves", "leaves_few")
LITTER: Final = ("litter", "litter_paper", "litter_bag", "litter_tyre", "litter_small")

LOOSE: Final = frozenset({*LEAVES, "leaf_drift", *LITTER, "joint_comb", "joint_strip"})
"""Fixtures that may lie on others, or next to their own kind."""

DRIFTS: Final = 0.6  # Share of trees with leaves along the kerb next to them. Ours.
DRIFT_REACH_M: Final = 6.0
DRIFT_HALF_M: Final = 1.5
STRAIGHT_M: Final = 0.04
"""A tree's distance from the kerb, and half the length of kerb that must be straight to so much, for leaves there."""

DRIFT_KEY: Final = 15  # Key of their child of the scene's random stream
LITTER_KEY: Final = 13  # Key of litter's children of the scene's random stream


@dataclass(frozen=True)
class Fixture:
    """One flush object."""

    model: str
    x: float
    y: float
    z: float
    yaw_rad: float


def placed(layout: SurfaceLayout) -> tuple[Fixture, ...]:
    """All flush objects of a world; none touches the patch of a defect."""
    found: list[Fixture] = []
    covers = pick(layout.style.covers, layout.chance("covers"))
    found += (Fixture(covers, x, y, 0.0, turn) for x, y, turn in cover_places(layout, REACH_M[covers]))
    for street in layout.streets:
        for segment in street.segments:
            found += _on_segment(layout, segment, covers)
    for junction in layout.world.junctions:
        found += _on_junction(layout, junction, covers)
    found += [Fixture(model, x, y, 0.0, turn) for model, x, y, turn in modules(layout)]
    return tuple(_apart(layout, [*found, *_litter(layout), *_leaves(layout), *_drifts(layout)]))


def _apart(layout: SurfaceLayout, candidates: Sequence[Fixture]) -> Iterator[Fixture]:
    """Fixtures that touch neither an earlier one nor the patch of a defect; leaves may lie on fixtures."""
    taken: Nearby[Fixture] = Nearby(2.0)
    for fixture in candidates:
        reach = REACH_M[fixture.model]
        near = () if fixture.model in LOOSE else taken.query(around(fixture.x, fixture.y, reach))
        touches = any(
            np.hypot(fixture.x - other.x, fixture.y - other.y) < reach + REACH_M[other.model] for other in near
        )
        if not touches and not layout.holes.near(shapely.Point(fixture.x, fixture.y), reach):
            if fixture.model not in LOOSE:
                taken.add(around(fixture.x, fixture.y, reach), fixture)
            yield fixture


def _on_segment(layout: SurfaceLayout, segment: Segment, covers: str) -> Iterator[Fixture]:
    rng = child(layout.seed, Stream.SCENE, 4, segment_key(segment))
    length, half = segment.length_m, segment.width_m / 2
    left = float(rng.choice([-0.5, 0.0, 0.5])) * half
    for _ in range(rng.poisson(length / COVERS_M)):
        station = float(rng.uniform(0.0, length))
        model = _cover(layout, rng, covers)
        yield _beside(segment, model, station, left + float(rng.normal(0.0, 0.25)), float(rng.uniform(0, 6.28)))
    for _ in range(rng.poisson(length / 30.0)):
        offset = float(rng.uniform(-half + 0.4, half - 0.4))
        yield _beside(segment, "valve", float(rng.uniform(0.0, length)), offset, float(rng.uniform(0, 6.28)))
    first = float(rng.uniform(0.2, 0.8)) * min(GRATES_M, length)
    model = pick(layout.style.grates, layout.chance("grates"))
    for station in np.arange(first, length - 1.0, GRATES_M):
        for side in (-1.0, 1.0):
            grate = _grate(layout, _beside(segment, model, float(station), side * half, 0.0))
            if grate is not None:
                yield grate


def _on_junction(layout: SurfaceLayout, junction: Junction, covers: str) -> Iterator[Fixture]:
    """Where streets meet, so do their sewers and mains."""
    surface = shapely.intersection(layout.road_near(shapely.box(*junction.polygon.bounds)), junction.polygon)
    inner = surface.buffer(-1.0)
    if inner.is_empty:
        return
    rng = child(layout.seed, Stream.SCENE, 7, layout.name_hash(f"junction {junction.id}"))
    low_x, low_y, high_x, high_y = inner.bounds
    for _ in range(rng.poisson(surface.area / 130.0)):
        x, y, turn = rng.uniform((low_x, low_y, 0.0), (high_x, high_y, 2 * np.pi))
        if inner.contains(shapely.Point(x, y)):
            model = _cover(layout, rng, covers) if rng.random() < 0.6 else "valve"
            yield Fixture(model, float(x), float(y), 0.0, float(turn))


def _cover(layout: SurfaceLayout, rng: np.random.Generator, usual: str) -> str:
    """The kind of one cover."""
    return usual if rng.random() < MOST_COVERS else pick(layout.style.covers, float(rng.random()))


def _beside(segment: Segment, model: str, station: float, left: float, turn: float) -> Fixture:
    point = segment.centre_line.interpolate(station)
    dx, dy = direction(segment.centre_line, station)
    return Fixture(model, point.x - dy * left, point.y + dx * left, 0.0, float(np.arctan2(dy, dx)) + turn)


def _grate(layout: SurfaceLayout, rough: Fixture) -> Fixture | None:
    """A grate at the nearest kerb; None where there is no straight kerb near."""
    piece = int(layout.edges.tree.nearest(shapely.Point(rough.x, rough.y)))
    line = layout.edges.pieces[piece]
    station = line.project(shapely.Point(rough.x, rough.y))
    foot = line.interpolate(station)
    if foot.distance(shapely.Point(rough.x, rough.y)) > 1.0:
        return None
    dx, dy = direction(line, station)
    away = GRATE_AT_M[rough.model]
    x, y = foot.x - dy * away, foot.y + dx * away
    kerbed = heights(layout, [(foot.x + dy * 0.3, foot.y - dx * 0.3)])[0] > 0.1
    return Fixture(rough.model, x, y, 0.0, float(np.arctan2(dy, dx))) if kerbed else None


def _litter(layout: SurfaceLayout) -> Iterator[Fixture]:
    """Paper, cans and cartons, most of them along the kerb."""
    for street in layout.streets:
        for segment in street.segments:
            rng = child(layout.seed, Stream.SCENE, LITTER_KEY, segment_key(segment))
            half = segment.width_m / 2
            for _ in range(rng.poisson(layout.style.litter_per_100_m * segment.length_m / 100)):
                away = min(float(rng.exponential(0.5)) + 0.3, segment.width_m - 0.6)
                left = (half - away) * float(rng.choice([-1.0, 1.0]))
                station = float(rng.uniform(0.0, segment.length_m))
                model = LITTER[int(rng.integers(len(LITTER)))]
                yield _beside(segment, model, station, left, float(rng.uniform(0, 6.28)))


def _leaves(layout: SurfaceLayout) -> Iterator[Fixture]:
    """Piles of leaves on level ground around trees."""
    trees = layout.trees.shapes
    if not len(trees):
        return
    rng = child(layout.seed, Stream.SCENE, 5)
    middles = np.repeat(shapely.get_coordinates(trees), 3, axis=0)
    middles = middles + rng.normal(0.0, 1.5, middles.shape)
    kept = rng.random(len(middles)) < min(1.0, 0.5 * layout.style.dirt.leaves)
    turns = rng.uniform(0.0, 2 * np.pi, len(middles))
    # One lookup over trees far apart is slow; a few dozen at a time are near each other.
    for start in range(0, len(middles), 3):
        part = middles[start : start + 3]
        probes = [part + (dx, dy) for dx, dy in ((0, 0), (0.7, 0), (-0.7, 0), (0, 0.7), (0, -0.7))]
        levels = heights(layout, np.concatenate(probes)).reshape(5, -1)
        for index in range(len(part)):
            if kept[start + index] and np.ptp(levels[:, index]) < 0.004:
                x, y = part[index]
                model = LEAVES[(start + index) % len(LEAVES)]
                yield Fixture(model, float(x), float(y), float(levels[0, index]), float(turns[start + index]))


def _drifts(layout: SurfaceLayout) -> Iterator[Fixture]:
    """Leaves along kerbs near trees."""
    rng = child(layout.seed, Stream.SCENE, DRIFT_KEY)
    for tree, draw in zip(layout.trees.shapes, rng.random((len(layout.trees.shapes), 3)).tolist(), strict=True):
        if draw[0] >= min(1.0, DRIFTS * layout.style.dirt.leaves):
            continue
        line = layout.edges.pieces[int(layout.edges.tree.nearest(tree))]
        if line.distance(tree) > DRIFT_REACH_M or line.length < 2 * DRIFT_HALF_M:
            continue
        station = float(np.clip(line.project(tree) + 6.0 * draw[1] - 3.0, DRIFT_HALF_M, line.length - DRIFT_HALF_M))
        foot, (dx, dy) = line.interpolate(station), direction(line, station)
        ends = [line.interpolate(station + side * DRIFT_HALF_M) for side in (-1.0, 1.0)]
        straight = all(abs((end.x - foot.x) * dy - (end.y - foot.y) * dx) < STRAIGHT_M for end in ends)
        if straight and heights(layout, [(foot.x + 0.3 * dy, foot.y - 0.3 * dx)])[0] > 0.1:
            yield Fixture("leaf_drift", foot.x - 0.03 * dy, foot.y + 0.03 * dx, 0.0, float(np.arctan2(dy, dx)))
