"""Manhole covers, grates, valve caps and leaves: small meshes on the ground, and their instances in a tile."""

from collections.abc import Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np
import shapely
import shapely.affinity
from shapely import Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.scene.agents import upright
from pavetwin.scene.appearance import tints
from pavetwin.scene.ground.distractors.fixtures import LEAVES, LITTER, MODULE_M
from pavetwin.scene.ground.ground_plan import GroundPlan
from pavetwin.scene.ground.layout.lines import rotated
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.meshes import anticlockwise, corners_of, upward_normals
from pavetwin.scene.models import BODY
from pavetwin.scene.values import Instance, Mesh, Model, tile_at
from pavetwin.seeds import Stream, child

Layer = tuple[BaseGeometry, float, tuple[float, float, float], float, float]
"""A shape, its height [m], its linear reflectance, roughness and metallic share."""

IRON: Final = (0.095, 0.086, 0.078)
POLISHED: Final = (0.19, 0.178, 0.165)
SLOT: Final = (0.012, 0.011, 0.010)
MORTAR: Final = (0.24, 0.23, 0.21)
DIRT: Final = (0.06, 0.055, 0.048)

COVER_M: Final = 0.605
FRAME_M: Final = 0.785
"""Diameters of a cover and of its frame (EN 124-2; DIN 19584: 605 mm and 785 mm)."""

GRATE_M: Final = (0.46, 0.26)
"""Sides of a gully grate inside its frame of 500 mm × 300 mm, as wide as a gutter (DIN 19594)."""

STEEL: Final = (0.15, 0.145, 0.14)
RUBBER: Final = (0.022, 0.022, 0.023)

COLLAR: Final = (0.30, 0.295, 0.275)

LITTER_KINDS: Final = (
    ((0.62, 0.61, 0.58), 0.11, 0.07),
    ((0.24, 0.17, 0.10), 0.16, 0.10),
    ((0.50, 0.51, 0.52), 0.12, 0.065),
    ((0.55, 0.53, 0.48), 0.05, 0.03),
    ((0.30, 0.03, 0.03), 0.09, 0.04),
    ((0.03, 0.035, 0.04), 0.34, 0.05),
    ((0.58, 0.60, 0.62), 0.30, 0.24),
    ((0.10, 0.075, 0.05), 0.42, 0.018),
)
"""Linear reflectance and sides [m]: paper, carton, a flattened can, a receipt, a wrapper, a strip of a tyre, a bag, a
stick. Ours."""

LITTER_PIECES: Final = (((0, 1, 2, 3, 4), 0.4), ((0, 3, 3), 0.25), ((6,), 0.05), ((5, 7), 0.3), ((2, 4, 7, 3), 0.45))
"""Pieces of each model, and how far they are scattered [m]."""

LEAF_COUNTS: Final = (46, 14)
DRIFT_LEAVES: Final = 90
DRIFT_M: Final = (1.5, 0.10)
"""Half length and spread of leaves that lie along a kerb."""

LEAF_TONES: Final = (
    (0.20, 0.115, 0.04), (0.26, 0.17, 0.05), (0.13, 0.07, 0.03), (0.17, 0.15, 0.05), (0.22, 0.09, 0.035),
)  # fmt: skip
"""Linear reflectances of fallen leaves, brown to yellow."""


@cache
def fixture_models() -> Mapping[str, Model]:
    """Meshes of all flush fixtures, by name."""
    layers = {
        "cover_iron": [*_frame(), *_studded()],
        "cover_filled": [*_frame(), *_filled()],
        "cover_square": _square_cover(),
        "cover_collared": [(_ring(1.16, FRAME_M, 10), 0.001, COLLAR, 0.85, 0.0), *_frame(), *_studded()],
        "grate": _grate(),
        "grate_slots": _slotted(),
        "valve": _valve(),
        "joint_comb": _comb(),
        "joint_strip": _strip(),
    }
    meshes = {name: _plates(of) for name, of in layers.items()}
    meshes |= {name: _leaves(number) for number, name in enumerate(LEAVES)} | {"leaf_drift": _drift()}
    meshes |= {name: _litter(number) for number, name in enumerate(LITTER)}
    return MappingProxyType({name: Model(name, {BODY: mesh}) for name, mesh in meshes.items()})


def _ring(outer_m: float, inner_m: float, sides: int = 12) -> BaseGeometry:
    """A flat ring; diameters."""
    disc = Point(0, 0).buffer(outer_m / 2, quad_segs=sides)
    return disc.difference(Point(0, 0).buffer(inner_m / 2, quad_segs=sides))


def _frame() -> list[Layer]:
    gap = COVER_M + 0.012
    return [
        (_ring(FRAME_M, gap), 0.002, IRON, 0.7, 0.25),
        (_ring(FRAME_M - 0.03, FRAME_M - 0.075), 0.004, POLISHED, 0.5, 0.35),
        (_ring(gap + 0.012, gap), 0.004, POLISHED, 0.5, 0.35),
        (_ring(gap, COVER_M), 0.001, SLOT, 0.95, 0.0),
    ]


def _studded() -> list[Layer]:
    """A cast cover with rows of studs, worn bright, and two lifting holes."""
    pitch, half = 0.046, 0.0135
    inside = Point(0, 0).buffer(COVER_M / 2 - 0.03)
    holes = shapely.union_all([box(-0.03, y - 0.012, 0.03, y + 0.012) for y in (-0.2, 0.2)])
    count = int(COVER_M / pitch / 2) + 1
    studs = [
        box(x - half, y - half, x + half, y + half)
        for row in range(-count, count + 1)
        for column in range(-count, count + 1)
        for x, y in [((column + (row % 2) / 2) * pitch, row * pitch)]
    ]
    kept = [stud for stud in studs if inside.contains(stud) and not stud.intersects(holes)]
    return [
        (Point(0, 0).buffer(COVER_M / 2, quad_segs=12), 0.002, IRON, 0.75, 0.2),
        (_ring(COVER_M, COVER_M - 0.04), 0.004, POLISHED, 0.5, 0.35),
        (shapely.union_all(kept), 0.005, POLISHED, 0.5, 0.35),
        (holes, 0.004, SLOT, 0.95, 0.0),
    ]


def _filled() -> list[Layer]:
    """An iron rim and cross filled with concrete, vents around."""
    rim, core = _ring(COVER_M, COVER_M - 0.07), Point(0, 0).buffer(COVER_M / 2 - 0.035, quad_segs=12)
    vents = [
        shapely.affinity.rotate(box(0.195, -0.014, 0.245, 0.014), 22.5 * number, origin=(0, 0)) for number in range(16)
    ]
    badge = Point(0, 0).buffer(0.09, quad_segs=8)
    return [
        (core, 0.002, MORTAR, 0.85, 0.0),
        (rim, 0.004, POLISHED, 0.5, 0.3),
        (badge, 0.004, IRON, 0.6, 0.3),
        (_ring(0.18, 0.15, 8), 0.005, POLISHED, 0.5, 0.35),
        (shapely.union_all(vents), 0.003, SLOT, 0.95, 0.0),
    ]


def _square_cover() -> list[Layer]:
    """Two lids of iron side by side in one frame, over cables."""
    wide, deep = 0.82, 0.62
    frame, inner = _rectangle(wide, deep), _rectangle(wide - 0.10, deep - 0.10)
    lids = [box(side - 0.17, -0.25, side + 0.17, 0.25) for side in (-0.18, 0.18)]
    places = [(side, float(y)) for side in (-0.18, 0.18) for y in np.linspace(-0.2, 0.2, 9)]
    bars = [box(x - 0.14, y - 0.008, x + 0.14, y + 0.008) for x, y in places]
    return [
        (frame.difference(inner), 0.003, IRON, 0.7, 0.25),
        (inner, 0.001, SLOT, 0.95, 0.0),
        (shapely.union_all(lids), 0.003, IRON, 0.75, 0.2),
        (shapely.union_all(bars), 0.005, POLISHED, 0.5, 0.35),
    ]


def _slotted() -> list[Layer]:
    """A grate with slots across the kerb, in a concrete frame."""
    wide, deep = 0.66, 0.34
    outer, inner = _rectangle(wide + 0.08, deep + 0.07), _rectangle(wide, deep)
    slots = [box(x - 0.02, -deep / 2 + 0.04, x + 0.02, deep / 2 - 0.04) for x in np.linspace(-0.27, 0.27, 7)]
    return [
        (outer.difference(inner), 0.002, COLLAR, 0.85, 0.0),
        (inner, 0.004, IRON, 0.65, 0.3),
        (shapely.union_all(slots), 0.005, SLOT, 0.95, 0.0),
    ]


def _comb() -> list[Layer]:
    """A module of a finger joint of a bridge: two steel combs in each other; x is along the street."""
    half, deep = MODULE_M / 2, 0.20
    fingers = [
        box(side * 0.02 - 0.09, y - 0.016, side * 0.02 + 0.09, y + 0.016)
        for number, y in enumerate(np.linspace(-half + 0.025, half - 0.025, 10))
        for side in (1 - 2 * (number % 2),)
    ]
    plates = [box(-deep, -half, -0.07, half), box(0.07, -half, deep, half)]
    bolts = [Point(side * 0.155, y).buffer(0.014, quad_segs=2) for side in (-1, 1) for y in (-0.125, 0.125)]
    return [
        (box(-deep, -half, deep, half), 0.001, SLOT, 0.95, 0.0),
        (shapely.union_all([*plates, *fingers]), 0.004, STEEL, 0.55, 0.35),
        (shapely.union_all(bolts), 0.005, IRON, 0.7, 0.2),
    ]


def _strip() -> list[Layer]:
    """A module of a strip seal of a bridge: a rubber profile between two steel edges."""
    half = MODULE_M / 2
    edges = [box(-0.10, -half, -0.04, half), box(0.04, -half, 0.10, half)]
    return [
        (box(-0.04, -half, 0.04, half), 0.001, RUBBER, 0.8, 0.0),
        (shapely.union_all(edges), 0.003, STEEL, 0.55, 0.35),
        (box(-0.006, -half, 0.006, half), 0.002, SLOT, 0.95, 0.0),
    ]


def _litter(model: int) -> Mesh:
    """Paper, cartons, cans and the like, scattered over a square metre at most."""
    rng = child(1, Stream.SCENE, 101, model)
    positions, colours = [], []
    pieces, apart_m = LITTER_PIECES[model]
    for kind in pieces:
        tone, long_m, wide_m = LITTER_KINDS[kind]
        middle, turn = rng.uniform(-apart_m, apart_m, 2), rng.uniform(0, 2 * np.pi)
        square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (long_m / 2, wide_m / 2)
        outline = square * rng.uniform(0.75, 1.0, (4, 2))
        flat = rotated(outline, turn) + middle
        positions.append(np.column_stack([flat, 0.004 + 0.03 * rng.random(4) ** 3])[[0, 1, 2, 0, 2, 3]])
        colours.append(np.tile(np.array(tone) * rng.uniform(0.8, 1.1), (6, 1)))
    points = np.concatenate(positions)
    return _mesh(points, np.concatenate(colours), np.tile([200, 0, 0], (len(points), 1)))


def _grate() -> list[Layer]:
    """A frame and cross bars over the dark."""
    wide, deep = GRATE_M
    outer, inner = _rectangle(wide + 0.04, deep + 0.04), _rectangle(wide, deep)
    bars = [box(x, -deep / 2, x + 0.026, deep / 2) for x in np.linspace(-wide / 2 + 0.02, wide / 2 - 0.046, 8)]
    spine = box(-wide / 2, -0.014, wide / 2, 0.014)
    rim = inner.difference(_rectangle(wide - 0.05, deep - 0.05))
    return [
        (outer.difference(inner), 0.002, DIRT, 0.8, 0.1),
        (inner, 0.001, SLOT, 0.95, 0.0),
        (shapely.union_all([*bars, spine, rim]), 0.005, IRON, 0.6, 0.3),
        (shapely.union_all([bar.buffer(-0.006) for bar in bars]), 0.006, POLISHED, 0.45, 0.4),
    ]


def _valve() -> list[Layer]:
    """A street box over a valve, in a collar of concrete."""
    lid = Point(0, 0).buffer(0.075, quad_segs=6)
    return [
        (_rectangle(0.20, 0.20).difference(lid), 0.002, MORTAR, 0.85, 0.0),
        (lid, 0.003, IRON, 0.65, 0.25),
        (_ring(0.15, 0.125, 6), 0.004, POLISHED, 0.5, 0.35),
        (box(-0.035, -0.008, 0.035, 0.008), 0.005, SLOT, 0.95, 0.0),
    ]


def _rectangle(wide: float, deep: float) -> Polygon:
    return box(-wide / 2, -deep / 2, wide / 2, deep / 2)


def _plates(layers: Sequence[Layer]) -> Mesh:
    """Flat shapes at their heights as one mesh."""
    positions, colours, surface = [], [], []
    for shape, height, colour, rough, metallic in layers:
        flat = anticlockwise(corners_of(shapely.constrained_delaunay_triangles(shape))).reshape(-1, 2)
        positions.append(np.column_stack([flat, np.full(len(flat), height)]))
        colours.append(np.tile(colour, (len(flat), 1)))
        surface.append(np.tile([round(255 * rough), round(255 * metallic), 0], (len(flat), 1)))
    return _mesh(np.concatenate(positions), np.concatenate(colours), np.concatenate(surface))


def _leaves(model: int) -> Mesh:
    """Leaves scattered over a disc, denser in its middle."""
    rng = child(1, Stream.SCENE, 100, model)
    return _scattered(rng, np.clip(rng.normal(0.0, 0.36, (LEAF_COUNTS[model], 2)), -0.6, 0.6))


def _drift() -> Mesh:
    """Leaves that wind and water left along a kerb; x is along it."""
    rng = child(1, Stream.SCENE, 103)
    along = DRIFT_M[0] * rng.uniform(-1.0, 1.0, DRIFT_LEAVES) * np.sqrt(rng.uniform(0.1, 1.0, DRIFT_LEAVES))
    return _scattered(rng, np.column_stack([along, np.abs(rng.normal(0.0, DRIFT_M[1], DRIFT_LEAVES))]))


def _scattered(rng: np.random.Generator, middles: Float64Array) -> Mesh:
    """A leaf at each place (n, 2), a little bent up at its tip."""
    positions, colours = [], []
    for middle in middles:
        turn, half = rng.uniform(0, 2 * np.pi), rng.uniform(0.018, 0.042)
        outline = np.array([[-1.0, 0.0], [-0.2, -0.55], [1.0, 0.0], [-0.2, 0.55]]) * half
        flat = rotated(outline, turn) + middle
        lift = np.array([0.003, 0.004, 0.004 + 0.5 * half * rng.random(), 0.004])
        corners = np.column_stack([flat, lift])[[0, 1, 2, 0, 2, 3]]
        positions.append(corners)
        colours.append(np.tile(np.array(LEAF_TONES[rng.integers(len(LEAF_TONES))]) * rng.uniform(0.7, 1.25), (6, 1)))
    points = np.concatenate(positions)
    return _mesh(points, np.concatenate(colours), np.tile([230, 0, 0], (len(points), 1)))


def _mesh(positions: Float64Array, colours: Float64Array, surface: Float64Array) -> Mesh:
    """A mesh of loose triangles, corners shared where all agrees, normals up."""
    rows, indices = np.unique(np.column_stack([positions, colours, surface]), axis=0, return_inverse=True)
    return Mesh(
        positions=rows[:, :3].astype(np.float32),
        normals=upward_normals(len(rows)),
        indices=np.asarray(indices, dtype=np.uint32).reshape(-1, 3),
        colours=rows[:, 3:6].astype(np.float32),
        surface=rows[:, 6:].astype(np.uint8),
    )


def fixtures(plan: GroundPlan, key: tuple[int, int]) -> tuple[Instance, ...]:
    """Manhole covers, grates, valve caps and leaves whose middles lie in a tile."""
    near = [plan.fixtures[index] for index in plan.fixture_index.near(tile_box(key))]
    return tuple(
        Instance(each.model, BODY, upright(each.x, each.y, each.yaw_rad, z_m=each.z), tints())
        for each in near
        if tile_at(each.x, each.y) == key
    )
