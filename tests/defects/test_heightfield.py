"""Everything drawn, labelled and measured follows from one heightfield: laws that hold for every registered class."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from pavetwin._core import relief_mesh
from pavetwin.defects import (
    Heightfield,
    Marking,
    Stains,
    albedo_factor,
    kinds,
    lost_surface,
    measure,
    mesh_of,
    normal_map,
    occlusion_map,
)
from pavetwin.defects.maps import distances_px, mean_around
from pavetwin.defects.measures import length_of

seeds = st.integers(0, 2**32 - 1)
every_class = pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.name)
few = settings(max_examples=6, deadline=None)


def generated(kind, seed: int) -> Heightfield:  # type: ignore[no-untyped-def]
    return kind.generate(np.random.default_rng(seed))


def flat(shape: tuple[int, int] = (80, 120), cell_m: float = 0.005) -> Heightfield:
    """An intact road with its origin in the middle."""
    empty = np.zeros(shape, dtype=np.float32)
    origin = (-cell_m * (shape[1] // 2), -cell_m * (shape[0] // 2))
    return Heightfield(empty, empty, empty, cell_m, origin, Marking(), lambda: Stains.none(shape))


def with_trench(width_cells: float, depth_m: float) -> Heightfield:
    """A straight crack along x, 0.5 m long: whole cells and one that is partly open."""
    opening = np.zeros((80, 120), dtype=np.float32)
    whole = int(width_cells)
    opening[40 : 40 + whole, 10:110] = 1
    opening[40 + whole, 10:110] = width_cells - whole
    return replace(flat(), opening=opening, height_m=np.asarray(-depth_m * opening, dtype=np.float32))


@every_class
@few
@given(seeds)
def test_the_same_seed_gives_the_same_bytes(kind, seed: int) -> None:  # type: ignore[no-untyped-def]
    one, two = generated(kind, seed), generated(kind, seed)
    _ = albedo_factor(one)  # looking at one first changes neither
    for name in ("height_m", "opening", "exposed", "mask"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes(), name
    for name in ("dirt", "dust", "stone", "tone"):
        assert getattr(one.stains, name).tobytes() == getattr(two.stains, name).tobytes(), name
    assert one.outline.equals_exact(two.outline, 0.0)
    assert generated(kind, seed + 1).height_m.tobytes() != one.height_m.tobytes()


@every_class
@few
@given(seeds)
def test_the_mask_is_the_heightfields(kind, seed: int) -> None:  # type: ignore[no-untyped-def]
    """By scipy's distance transform, a second way: widened, closed, one piece, no holes."""
    from scipy.ndimage import binary_fill_holes, distance_transform_edt, label

    shape = generated(kind, seed)
    rule, cell = shape.marking, shape.cell_m
    pad = round((rule.margin_m + rule.closing_m) / cell) + 3
    marked = np.pad(shape.height_m <= -rule.least_m, pad)
    wide = distance_transform_edt(~marked) <= (rule.margin_m + rule.closing_m) / cell
    closed = (distance_transform_edt(wide) > rule.closing_m / cell)[pad:-pad, pad:-pad]
    parts, count = label(closed)
    assert count >= 1
    largest = parts == 1 + np.argmax([np.count_nonzero(parts == part) for part in range(1, count + 1)])
    assert np.array_equal(shape.mask, binary_fill_holes(largest))
    assert (shape.height_m[~shape.mask] == 0).all(), "the road is intact outside"
    assert (shape.opening[~shape.mask] == 0).all()
    border = np.ones_like(shape.mask)
    border[1:-1, 1:-1] = False
    assert not (shape.mask & border).any()


@pytest.mark.parametrize("size", [4, 5, 33])
@pytest.mark.parametrize(("repeats_edge", "mode"), [(False, "reflect"), (True, "nearest")])
def test_means_are_those_of_scipy(size: int, repeats_edge: bool, mode: str) -> None:
    from scipy.ndimage import uniform_filter

    field = np.random.default_rng(size).normal(0.0, 0.02, (61, 90)).astype(np.float32)
    means = mean_around(field, size, repeats_edge=repeats_edge)
    assert means.dtype == np.float32
    assert np.allclose(means, uniform_filter(field, size, mode=mode), rtol=0, atol=1e-8)


def test_distances_are_those_of_scipy() -> None:
    from scipy.ndimage import distance_transform_edt

    inside = np.random.default_rng(3).random((300, 170)) > 0.002
    assert np.array_equal(distances_px(inside), distance_transform_edt(inside))


@every_class
@few
@given(seeds)
def test_the_outline_is_the_masks(kind, seed: int) -> None:  # type: ignore[no-untyped-def]
    shape = generated(kind, seed)
    outline = shape.outline
    assert outline.is_valid
    assert not outline.interiors
    (x0, y0), cell, fine = shape.origin_m, shape.cell_m, 3
    steps = (np.arange(fine) + 0.5) / fine - 0.5
    x = x0 + cell * (np.arange(shape.shape[1])[:, None] + steps).ravel()
    y = y0 + cell * (np.arange(shape.shape[0])[:, None] + steps).ravel()
    shapely.prepare(outline)
    drawn = shapely.contains_xy(outline, *np.meshgrid(x, y))
    mask = np.kron(shape.mask, np.ones((fine, fine), dtype=bool))
    assert np.count_nonzero(drawn & mask) / np.count_nonzero(drawn | mask) >= 0.97


@every_class
@few
@given(seeds)
def test_the_mesh_follows_the_heightfield_and_closes_at_the_road(kind, seed: int) -> None:
    shape = generated(kind, seed)
    mesh = mesh_of(shape, tolerance_m=0.004)
    ring = np.asarray(shape.outline.exterior.coords)[:-1]
    made = relief_mesh(shape.lattice, shape.height_m, np.ascontiguousarray(ring), 0.004, most=20_000)
    assert made is not None
    assert np.array_equal(made[0], mesh.positions)
    assert made[2] <= 0.004
    assert np.allclose(mesh.positions[: mesh.border, :2], ring, atol=1e-6)
    assert (mesh.positions[: mesh.border, 2] == 0).all()
    a, b, c = (mesh.positions[mesh.indices[:, k]].astype(np.float64) for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (area > 0).all(), "anticlockwise from above"
    assert area.sum() == pytest.approx(shape.outline.area, rel=1e-4)
    edges = np.sort(mesh.indices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    pairs, uses = np.unique(edges, axis=0, return_counts=True)
    assert uses.max() == 2
    assert {tuple(pair) for pair in pairs[uses == 1]} == {
        tuple(sorted((k, (k + 1) % mesh.border))) for k in range(mesh.border)
    }
    volume = -float((area * (a + b + c)[:, 2] / 3).sum())
    missing = -float(shape.height_m.sum(dtype=np.float64)) * shape.cell_m**2
    assert abs(volume - missing) <= 0.004 * shape.outline.area


def test_a_mesh_keeps_to_its_most_vertices() -> None:
    shape = generated(kinds()[1], 3)
    assert len(mesh_of(shape, 1e-5, most_vertices=1500).positions) <= 1500
    with pytest.raises(ValueError, match="not positive"):
        mesh_of(shape, 0.0)


@every_class
def test_the_maps_fit_the_heightfield(kind) -> None:  # type: ignore[no-untyped-def]
    shape = generated(kind, 11)
    normals, albedo, occlusion = normal_map(shape), albedo_factor(shape), occlusion_map(shape)
    assert normals.shape == albedo.shape == (*shape.shape, 3)
    assert occlusion.shape == shape.shape
    length = np.linalg.norm(normals.astype(np.float64) / 127.5 - 1, axis=2)
    assert np.abs(length - 1).max() < 0.02
    assert (normals[0, 0] == (128, 128, 255)).all()
    assert np.allclose(albedo[0, 0], 1, atol=0.3)
    assert albedo.min() > 0
    assert albedo.max() < 2.5
    deep = shape.height_m < 0.7 * shape.height_m.min()
    assert occlusion[deep].mean() < occlusion[~shape.mask].mean()
    if (shape.opening > 0.9).any():
        assert albedo[shape.opening > 0.9].mean() < 0.5, "little light comes out of a crack"


def test_the_surface_is_lost_where_it_is_open_or_broken_and_not_where_a_block_sank() -> None:
    def lost(**fields: float) -> float:
        layers = {name: np.full(flat().shape, value, dtype=np.float32) for name, value in fields.items()}
        return float(lost_surface(replace(flat(), **layers))[40, 60])

    assert lost(height_m=-0.02) == 0.0
    assert lost(height_m=-0.02, exposed=0.4) == 1.0
    assert lost(height_m=-0.003, exposed=0.4) == pytest.approx(0.4)
    assert lost(height_m=-0.010, exposed=0.4) == pytest.approx(0.5)
    assert lost(height_m=-0.003, opening=0.6) == pytest.approx(0.6)


def test_normals_lean_away_from_a_rise() -> None:
    slope = np.tile(0.001 * np.arange(120, dtype=np.float32), (80, 1))
    red, green, _ = normal_map(replace(flat(), height_m=slope))[40, 60] / 127.5 - 1
    assert red == pytest.approx(-0.196, abs=0.01)
    assert green == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("width_cells", [0.4, 1.0, 2.6, 7.5])
def test_widths_lengths_and_volumes_are_measured_whatever_the_cell(width_cells: float) -> None:
    sizes = measure(with_trench(width_cells, 0.02))
    width = width_cells * 0.005
    assert sizes.width_m == pytest.approx(width, rel=0.02)
    assert sizes.mean_width_m == pytest.approx(width, rel=0.02)
    assert sizes.crack_length_m == pytest.approx(0.5, rel=0.02)
    assert sizes.volume_m3 == pytest.approx(0.5 * width * 0.02, rel=1e-3)
    assert sizes.depth_m == pytest.approx(0.02 * min(1, width_cells), rel=1e-3)


def test_a_long_shape_at_an_angle_has_the_extents_of_its_rectangle_and_no_crack() -> None:
    x, y = 0.005 * np.arange(-120, 121), 0.005 * np.arange(-120, 121)[:, None]
    along, across = (x + 2 * y) / np.sqrt(5), (y - 2 * x) / np.sqrt(5)
    trough = np.where((np.abs(along) < 0.4) & (np.abs(across) < 0.1), -0.01, 0.0).astype(np.float32)
    plain = Marking(margin_m=0.0, closing_m=0.0)
    sizes = measure(replace(flat((241, 241)), height_m=trough, marking=plain))
    assert sizes.extent_length_m == pytest.approx(0.8, abs=0.012)
    assert sizes.extent_width_m == pytest.approx(0.2, abs=0.012)
    assert sizes.crack_length_m == 0.0
    assert length_of(sizes) == sizes.extent_length_m
    crack = measure(with_trench(1.0, 0.02))
    assert length_of(crack) == crack.crack_length_m != crack.extent_length_m


def test_an_invalid_heightfield_is_refused() -> None:
    whole = flat()
    with pytest.raises(ValueError, match="not float32"):
        replace(whole, opening=np.zeros((80, 121), dtype=np.float32))
    with pytest.raises(ValueError, match="not within 0 … 1"):
        replace(whole, exposed=np.full((80, 120), 1.5, dtype=np.float32))
    with pytest.raises(ValueError, match=r"0\.01 m is not within"):
        replace(whole, cell_m=0.01)
    with pytest.raises(ValueError, match="no outline"):
        _ = whole.outline
    with pytest.raises(ValueError, match="read-only"):
        whole.height_m[0, 0] = 1.0


def test_a_dent_becomes_its_disc() -> None:
    height: npt.NDArray[np.float32] = np.zeros((80, 120), dtype=np.float32)
    height[40, 60] = -0.0006
    outline = replace(flat(), height_m=height).outline
    assert outline.area == pytest.approx(np.pi * 0.02**2, rel=0.12)
    assert outline.centroid.distance(shapely.Point(0, 0)) < 1e-4
    height = height.copy()
    height[40, 60] = -0.0004
    assert not replace(flat(), height_m=height).mask.any()
