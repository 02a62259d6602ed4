"""Buildings: within their solids, closed towards the street, their windows in the walls, alike for the same seed."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, affinity

from pavetwin.scene.buildings import FACADE_PX, Buildings, FacadeTexture, facade_textures
from pavetwin.scene.values import FacadePiece
from pavetwin.world.model import Building, World
from scenes import tiny

OUT_M = 0.45
"""Eaves, sills and mouldings reach this far out of a footprint at most."""

SOLID_LAYERS = {FacadeTexture.TILES, FacadeTexture.SLATE, FacadeTexture.SEAMS, FacadeTexture.GRAVEL, FacadeTexture.FELT}


def world_of(*houses: Building) -> World:
    return tiny.world([tiny.street("street", (0.0, 0.0), (80.0, 0.0))], buildings=houses)


def pieces(world: World, number: int = 0, seed: int = 0) -> tuple[FacadePiece, ...]:
    return Buildings(world, seed=seed).pieces(number, (0.0, 0.0))


def triangles(parts: tuple[FacadePiece, ...], *layers: FacadeTexture) -> np.ndarray:
    """(m, 3, 3) of pieces, of some layers or all."""
    chosen = [part for part in parts if not layers or part.layer in layers]
    return np.concatenate([part.mesh.positions[part.mesh.indices].astype(float) for part in chosen])


def facing(corners: np.ndarray) -> np.ndarray:
    """(m, 3) twice the area times the normal."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@st.composite
def footprints(draw: st.DrawFn) -> Polygon:
    """Rectangles, Ls and round shapes in any direction."""
    width, depth = draw(st.floats(4.0, 30.0)), draw(st.floats(4.0, 25.0))
    shape = shapely.box(0, 0, width, depth)
    kind = draw(st.sampled_from(["box", "wing", "bay", "round"]))
    if kind == "wing":
        shape = shape.union(shapely.box(0, 0, width * 0.45, depth * 1.6))
    if kind == "bay":
        shape = shape.difference(shapely.box(width * 0.3, depth * 0.5, width * 0.6, depth + 1))
    if kind == "round":
        shape = shape.buffer(-1.9).buffer(1.9, quad_segs=5)
    turned = affinity.rotate(shape, draw(st.floats(0, 360)), origin="centroid")
    moved = affinity.translate(turned, 30.0, 20.0)
    assert isinstance(moved, Polygon)
    return moved


@given(footprint=footprints(), height=st.floats(2.6, 24.0), seed=st.integers(0, 2**32))
@settings(max_examples=30)
def test_a_building_fills_its_solid_and_stays_in_it(footprint: Polygon, height: float, seed: int) -> None:
    made = pieces(world_of(Building("b", footprint, height)), seed=seed)
    points = triangles(made).reshape(-1, 3)
    assert points[:, 2].min() >= -1e-6
    high = height + (0.5 if footprint.area > 260 else 0.06)  # machines behind a parapet; ridge tiles
    assert height - 0.7 < points[:, 2].max() <= high
    outside = shapely.distance(footprint, shapely.points(points[:, :2]))
    assert outside.max() < OUT_M
    for part in made:
        normals = np.linalg.norm(part.mesh.normals, axis=1)
        assert np.abs(normals - 1).max() < 1e-4
        assert part.mesh.uv is not None
        assert part.mesh.colours is not None
        assert part.mesh.colours.min() >= 0


@given(footprint=footprints(), height=st.floats(6.0, 14.0))
@settings(max_examples=25)
def test_nothing_of_the_inside_is_seen_from_above(footprint: Polygon, height: float) -> None:
    """Rays straight down over the footprint meet a face that looks up before one that looks down."""
    made = triangles(pieces(world_of(Building("b", footprint, height))))
    inner = footprint.buffer(-0.5)
    low_x, low_y, high_x, high_y = inner.bounds
    x, y = np.meshgrid(np.linspace(low_x, high_x, 12) + 0.0137, np.linspace(low_y, high_y, 12) + 0.0171)
    points = shapely.points(x.ravel(), y.ravel())
    for point in points[shapely.contains(inner, points)]:
        at = shapely.get_coordinates(point)[0]
        height_m, up = highest(made, at)
        assert up > 0, at
        assert height_m > 0.4 * height


def highest(corners: np.ndarray, at: np.ndarray) -> tuple[float, float]:
    """Height of the topmost face over a point, and which way it looks: positive is up."""
    normal = facing(corners)
    level = np.abs(normal[:, 2]) > 1e-9
    corners, normal = corners[level], normal[level]
    a, b, c = (corners[:, k, :2] for k in range(3))
    sides = [
        (q[:, 0] - p[:, 0]) * (at[1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (at[0] - p[:, 0])
        for p, q in ((a, b), (b, c), (c, a))
    ]
    signs = np.sign(normal[:, 2]) * np.array(sides)
    over = (signs >= 0).all(axis=0)
    assert over.any(), at
    z = corners[over, 0, 2] - ((at - corners[over, 0, :2]) * normal[over, :2]).sum(axis=1) / normal[over, 2]
    top = int(np.argmax(z))
    return float(z[top]), float(normal[over][top, 2])


def test_windows_lie_in_the_wall_and_look_out() -> None:
    house = tiny.block("b", 20.0, 8.0, 34.0, 18.0, 9.0)
    made = pieces(world_of(house))
    panes = triangles(made, FacadeTexture.WINDOWS, FacadeTexture.GLAZING)
    assert len(panes) >= 2 * 12
    middles, normals = panes.mean(axis=1), facing(panes)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inward = shapely.distance(house.polygon.exterior, shapely.points(middles[:, :2]))
    assert (inward > 0.03).all()
    assert (inward < 0.35).all()
    outside = middles[:, :2] + 1.0 * normals[:, :2]
    assert not shapely.contains(house.polygon, shapely.points(outside)).any()


def test_the_walls_are_whole_but_for_their_openings() -> None:
    house = tiny.block("b", 20.0, 8.0, 34.0, 18.0, 9.0)
    made = pieces(world_of(house))
    upright = triangles(made)
    normal = facing(upright)
    south = (normal[:, 1] < -1e-9) & (np.abs(normal[:, 0]) < 1e-6) & (np.abs(normal[:, 2]) < 1e-6)
    assert south.any()
    # Seen along y, wall and panes together cover the south side from the ground to the eaves once over.
    faces = shapely.polygons(upright[south][:, :, [0, 2]])
    seen = shapely.union_all(shapely.buffer(faces, 1e-6))
    eaves = min(4.0, 9.0)
    assert seen.intersection(shapely.box(20, 0, 34, eaves)).area == pytest.approx(14 * eaves, rel=1e-3)


def test_doors_and_shops_are_towards_the_street_and_party_walls_are_blind() -> None:
    row = [tiny.block(f"b{k}", 10.0 + 9 * k, 5.0, 19.0 + 9 * k, 15.0, 11.0) for k in range(3)]
    world = world_of(*row)
    middle = pieces(world, 1)
    openings = triangles(middle, FacadeTexture.WINDOWS, FacadeTexture.GLAZING, FacadeTexture.DOORS)
    normal = facing(openings)
    assert (np.abs(normal[:, 0]) < 1e-6 * np.abs(normal[:, 1])).all(), "no opening in a party wall"
    doors = triangles(middle, FacadeTexture.DOORS)
    assert len(doors)
    assert (facing(doors)[:, 1] < 0).all()
    roof = triangles(middle, FacadeTexture.TILES, FacadeTexture.SLATE)
    assert (np.abs(facing(roof)[:, 0]) < 1e-6).all(), "the ridge runs from house to house"


def test_the_same_seed_builds_the_same_house_and_another_one_another() -> None:
    world = world_of(tiny.block("b", 20.0, 8.0, 34.0, 18.0, 9.0))
    first, again = pieces(world, seed=3), pieces(world, seed=3)
    assert all(np.array_equal(a.mesh.positions, b.mesh.positions) for a, b in zip(first, again, strict=True))
    looks = {
        tuple((part.layer, round(float(part.mesh.colours.mean()), 3)) for part in pieces(world, seed=seed))
        for seed in range(12)
        for part in [pieces(world, seed=seed)[0]]
        if part.mesh.colours is not None
    }
    assert len(looks) > 6


def test_a_town_has_many_kinds_of_houses() -> None:
    """Garages, sheds, houses, blocks, halls and a tower."""
    sizes = [(4, 7, 3.0), (14, 8, 4.5), (10, 9, 7.5), (12, 11, 12.0), (30, 18, 12.0), (34, 15, 8.0), (6, 6, 27.0)]
    houses = [
        tiny.block(f"b{number}", 50.0 * number, 6.0, 50.0 * number + width, 6.0 + depth, height)
        for number, (width, depth, height) in enumerate(sizes * 6)
    ]
    builder = Buildings(world_of(*houses), seed=0)
    made = [builder.pieces(number, (0.0, 0.0)) for number in range(len(houses))]
    walls = {
        FacadeTexture.RENDER,
        FacadeTexture.BRICK,
        FacadeTexture.CONCRETE,
        FacadeTexture.STONE,
        FacadeTexture.CLADDING,
    }
    layers = {part.layer for parts in made for part in parts}
    assert walls <= layers
    assert len(layers & SOLID_LAYERS) >= 4
    assert layers >= {FacadeTexture.WINDOWS, FacadeTexture.GLAZING, FacadeTexture.DOORS}
    colours = {
        tuple(np.round(part.mesh.colours.max(axis=0), 2))
        for parts in made
        for part in parts[1:2]
        if part.mesh.colours is not None
    }
    assert len(colours) > 20


def test_textures_repeat_are_pale_where_they_are_tinted_and_no_two_windows_are_alike() -> None:
    textures = facade_textures(0)
    assert textures.shape == (len(FacadeTexture) - 1, FACADE_PX, FACADE_PX, 4)
    for layer in (
        FacadeTexture.RENDER,
        FacadeTexture.CONCRETE,
        FacadeTexture.STONE,
        FacadeTexture.TILES,
        FacadeTexture.GRAVEL,
    ):
        image = textures[layer, ..., :3].astype(float)
        across = np.abs(image[:, 0] - image[:, -1]).mean()
        inside = np.abs(np.diff(image, axis=1)).mean()
        assert across < 2.5 * inside + 3, layer
    assert textures[FacadeTexture.RENDER, ..., :3].mean() > 215
    size = FACADE_PX // 4
    cells = textures[FacadeTexture.WINDOWS].reshape(4, size, 4, size, 4).swapaxes(1, 2).reshape(16, -1)
    assert len({cell.tobytes() for cell in cells}) == 16
    glass = textures[FacadeTexture.GLAZING, ..., 3]
    assert np.median(glass) < 40
    assert textures[FacadeTexture.BRICK, ..., 3].min() > 200


def test_wide_and_narrow_walls_have_bays_of_the_same_kind() -> None:
    """Windows fit the wall: their number follows its length, their width hardly changes."""
    widths, counts = [], []
    for length in (8.0, 12.0, 18.0):
        house = tiny.block("b", 20.0, 8.0, 20.0 + length, 17.0, 9.0)
        made = pieces(world_of(house), seed=5)
        panes = triangles(made, FacadeTexture.WINDOWS)
        north = facing(panes)[:, 1] > 1e-6
        boxes = panes[north]
        width = np.ptp(boxes[:, :, 0], axis=1)
        widths.append(float(np.median(width)))
        counts.append(len(boxes) // 2)
    assert counts == sorted(counts)
    assert counts[-1] > counts[0]
    assert max(widths) / min(widths) < 1.4
    assert math.isfinite(widths[0])
