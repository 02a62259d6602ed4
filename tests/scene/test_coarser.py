"""Coarser meshes stay closed and within their cells; leaf cards keep their area and their share of gaps."""

from functools import cache

import numpy as np
import pytest
import shapely

from pavetwin.render.gpu_scene import casting
from pavetwin.scene.coarser import closed, coarser
from pavetwin.scene.foliage import CUT, SIDE_PX, SPRAY, cells, leaf_atlas, leaf_levels
from pavetwin.scene.models import BODY, library
from pavetwin.scene.values import Mesh
from pavetwin.scene.web.packing import MODEL_TRIANGLES
from pavetwin.scene.web.shared_files import _within

SIDES = ((0, 0, 1), (0, 1, 0))
"""From above, and from the left."""


@cache
def body(name: str) -> Mesh:
    return library()[name].parts[BODY]


def shown_m2(mesh: Mesh, side: tuple[int, int, int]) -> float:
    """What the triangles that face a side cover of it, seen from there."""
    corners = mesh.positions[mesh.indices].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normals @ side > 0.3 * np.linalg.norm(normals, axis=1)
    flat = corners[facing][:, :, [axis for axis in range(3) if not side[axis]]]
    return float(shapely.union_all(shapely.buffer(shapely.polygons(flat), 0)).area)


def test_vehicles_of_coarse_levels_have_no_holes() -> None:
    whole = body("hatchback_parked")
    for most, least in zip(MODEL_TRIANGLES[1:], (0.9, 0.8), strict=True):
        made = _within(whole, most)
        assert 0.3 * most < len(made.indices) <= most
        for side in SIDES:
            assert shown_m2(made, side) > least * shown_m2(whole, side), (most, side)


def test_vertices_stay_in_their_cells_and_keep_their_slots() -> None:
    whole, cell_m = body("hatchback_parked"), 0.1
    made = closed(whole, cell_m)
    assert made.surface is not None
    assert whole.surface is not None
    assert set(made.surface[:, 2]) == set(whole.surface[:, 2])
    known = {tuple(row) for row in whole.positions.tolist()}
    assert all(tuple(row) in known for row in made.positions.tolist()), "places are some of the vertices'"
    cells = np.unique(np.floor(made.positions / cell_m), axis=0)
    assert len(np.unique(made.positions, axis=0)) == len(cells), "one place for each cell"
    triangles = np.sort(made.positions[made.indices].round(6), axis=1).reshape(-1, 9)
    assert len(np.unique(triangles, axis=0)) >= 0.98 * len(triangles)


def test_a_mesh_within_its_cells_is_as_it_was() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float32)
    up = np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1))
    square = Mesh(corners, up, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32))
    made = closed(square, 0.5)
    assert np.array_equal(made.positions[made.indices], square.positions[square.indices])
    assert len(closed(square, 4.0).indices) == 0


TREES = sorted(name for name in library() if name.startswith("tree_"))


def is_leaf(texels: np.ndarray) -> np.ndarray:
    return texels[..., 3] >= 255 * CUT


def cell_of(uv: np.ndarray) -> np.ndarray:
    """The cell (n,) that each card's middle (n, 2) lies in."""
    return (2 * uv).astype(int) @ (1, 2)


def card_uv(mesh: Mesh) -> np.ndarray:
    """(cards, 6, 2)"""
    assert mesh.uv is not None
    return mesh.uv[mesh.indices.reshape(-1, 6)]


def test_the_sheet_is_the_same_whenever_it_is_drawn() -> None:
    first = leaf_atlas().copy()
    leaf_atlas.cache_clear()
    assert leaf_atlas() is not first
    assert leaf_atlas().tobytes() == first.tobytes()
    assert first.shape == (SIDE_PX, SIDE_PX, 4)


def test_every_level_leaves_as_much_of_every_cell() -> None:
    shares = [[float(is_leaf(cell).mean()) for cell in cells(level)] for level in leaf_levels()]
    assert len(shares) > 4
    assert np.array(shares) == pytest.approx(np.tile(shares[0], (len(shares), 1)), abs=0.03)
    assert min(shares[0]) > 0.3
    assert shares[0][SPRAY] == max(shares[0]) < 0.9


def test_no_leaf_is_cut_by_the_edge_of_its_cell() -> None:
    for cell in cells(leaf_atlas()):
        rim = np.concatenate([cell[0], cell[-1], cell[:, 0], cell[:, -1]])
        assert not is_leaf(rim).any()


def test_leaves_differ_in_tone_and_gaps_do_not_stain_their_edges() -> None:
    sheet = leaf_atlas()
    tones = sheet[is_leaf(sheet)][:, :3].mean(axis=1)
    gaps = sheet[sheet[..., 3] == 0][:, :3].mean(axis=1)
    assert tones.std() > 15
    assert np.abs(gaps - tones.mean()).max() < 40


@pytest.mark.parametrize("name", TREES)
def test_every_card_of_a_crown_shows_one_whole_cell(name: str) -> None:
    uv = card_uv(library()[name].parts["crown"])
    assert np.ptp(uv, axis=1) == pytest.approx(0.5)
    kinds = np.bincount(cell_of(uv.mean(axis=1)), minlength=4)
    assert kinds.min() > 0.04 * len(uv)
    assert 600 < len(uv) < 2500


def test_only_crowns_are_foliage() -> None:
    leafy = {
        (model.name, part) for model in library().values() for part, mesh in model.parts.items() if mesh.uv is not None
    }
    assert leafy == {(name, "crown") for name in TREES}


@pytest.mark.parametrize("level", [1, 3])
def test_a_crown_far_away_has_fewer_and_larger_cards_of_the_same_area(level: int) -> None:
    crown = library()["tree_round"].parts["crown"]
    far = coarser(crown, level)
    assert len(far.indices) == pytest.approx(len(crown.indices) / 2**level, abs=2)
    assert np.ptp(card_uv(far), axis=1) == pytest.approx(0.5)
    assert area_m2(far) == pytest.approx(area_m2(crown), rel=0.12)


@pytest.mark.parametrize("level", [0, 2])
def test_every_other_card_of_a_crown_throws_its_shadow(level: int) -> None:
    crown = library()["tree_round"].parts["crown"]
    thrown = casting(crown, level)
    assert len(thrown.indices) == pytest.approx(len(crown.indices) / 2 ** (level + 1), abs=2)
    assert area_m2(thrown) == pytest.approx(area_m2(crown) / 2, rel=0.12)


def test_what_has_no_leaves_throws_the_shadow_of_what_is_seen() -> None:
    trunk = library()["tree_round"].parts["trunk"]
    assert casting(trunk, 0) is trunk


def area_m2(mesh: Mesh) -> float:
    a, b, c = (mesh.positions[mesh.indices[:, corner]].astype(float) for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
