"""The sheet of leaves, and the crowns whose cards it cuts."""

import numpy as np
import pytest

from pavetwin.render.gpu_scene import casting
from pavetwin.scene.coarser import coarser
from pavetwin.scene.foliage import CUT, SIDE_PX, SPRAY, cells, leaf_atlas, leaf_levels
from pavetwin.scene.models import library
from pavetwin.scene.values import Mesh

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
