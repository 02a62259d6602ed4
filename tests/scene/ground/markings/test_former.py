"""Markings of an earlier layout: ghosts below today's lines, lines painted over, scars of removed ones."""

from functools import cache

import numpy as np
import pytest
import shapely

from pavetwin.scene.ground import GroundPlan, ground_maps, plan_ground
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.styles import street_style
from pavetwin.scene.ground.styles.street_style import FormerKind, FormerMarkings
from pavetwin.scene.values import TILE_M
from scenes import built


@cache
def plan(kind: str = "", share: float = 1.0) -> GroundPlan:
    """The cross with earlier markings of one kind; without any unless named."""
    rules = FormerMarkings.model_validate({"share": share, "kinds": {kind: 1}} if kind else {})
    style = street_style("uniform").model_copy(update={"former_markings": rules})
    return plan_ground(built("cross").world, 3, style=style)


@cache
def drawn(kind: str = "", share: float = 1.0) -> Paint:
    return markings(plan(kind, share), plan().standard)


@pytest.mark.parametrize("kind", list(FormerKind))
def test_todays_markings_are_as_without_an_earlier_layout(kind: str) -> None:
    found, plain = drawn(kind), drawn()
    assert not plain.is_former.any()
    assert not len(plain.scars)
    np.testing.assert_array_equal(found.bars[~found.is_former], plain.bars)
    assert found.is_former.sum() + len(found.scars) > 20


def test_what_was_painted_over_lies_centimetres_beside_and_below_it() -> None:
    found, rules = drawn("overpainted"), plan("overpainted").style.former_markings
    old, new = found.bars[found.is_former], found.bars[~found.is_former]
    assert found.bar_paints[found.is_former, 1].min() >= rules.wear.least
    along = np.column_stack([np.cos(old[:, 2]), np.sin(old[:, 2])])
    for bar, ahead in zip(old, along, strict=True):
        alike = new[np.abs(np.sin(new[:, 2] - bar[2])) < 1e-6]
        aside = (alike[:, :2] - bar[:2]) @ [-ahead[1], ahead[0]]
        assert np.abs(aside).min() <= rules.beside_m.most + 1e-6


def test_todays_paint_covers_what_is_below_it() -> None:
    """In the middle of a new line over an old one, the maps hold the new one's wear."""
    found = drawn("overpainted")
    new = found.bars[~found.is_former]
    lines = np.flatnonzero((new[:, 4] * 2 > 0.1) & (new[:, 3] > 1.0))
    key = tuple(np.floor(new[lines[0], :2] / TILE_M).astype(int).tolist())
    with_old, without = (ground_maps(plan(kind), key).drawn for kind in ("overpainted", ""))
    deep = without[..., 0] > 128 + 12
    assert deep.sum() > 300
    assert (np.abs(with_old[deep, 2].astype(int) - without[deep, 2]) < 3).mean() > 0.95
    assert (with_old[..., 0] > 128).sum() > 1.02 * (without[..., 0] > 128).sum()


def test_removed_lines_leave_scars_in_the_tone_of_the_pavement() -> None:
    found = drawn("masked")
    assert not found.is_former.any()
    scar = found.scars[int(found.scars[:, 3].argmax())]
    key = tuple(np.floor(scar[:2] / TILE_M).astype(int).tolist())
    scarred, plain = (ground_maps(plan(kind), key).weathering[..., 0].astype(float) for kind in ("masked", ""))
    ratio = scarred / np.maximum(plain, 1)
    assert ratio.min() == pytest.approx(scar[5], abs=0.03)
    assert np.median(ratio) == pytest.approx(1.0)


def test_a_share_of_streets_and_crossings_has_an_earlier_layout() -> None:
    counts = [int(drawn("worn", share).is_former.sum()) for share in (0.0, 0.5, 1.0)]
    assert counts[0] == 0 < counts[1] < counts[2]


def test_nothing_of_it_is_left_where_a_street_was_resurfaced() -> None:
    found = drawn("worn")
    bars = found.bars[found.is_former]
    where = shapely.Point(bars[0, :2]).buffer(10.0)
    kept = found.resurfaced(where)
    assert 0 < kept.is_former.sum() < len(bars)
    assert not shapely.contains_xy(where, kept.bars[kept.is_former, :2]).any()
    assert (~kept.is_former).sum() == (~found.is_former).sum()
