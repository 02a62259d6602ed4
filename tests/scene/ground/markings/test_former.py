"""Markings of an earlier layout, and pavements that are too new for any."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml

from pavetwin.scene.ground import GroundPlan, ground_maps, plan_ground
from pavetwin.scene.ground.layout.paved import ageing
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.styles import pavement, street_style
from pavetwin.scene.ground.styles.marking_standard import marking_standard
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


def test_what_was_painted_over_lies_centimetres_next_to_and_below_it() -> None:
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


AWAY_M = 30.0
"""From the ends of streets, where stop lines and arrows are."""

Planned = Callable[[float, int], GroundPlan]


@pytest.fixture
def planned(tmp_path: Path) -> Planned:
    """The cross without crossings, all of a pavement of one age, and with markings of an earlier layout; by seed."""

    def plan(age: float, seed: int) -> GroundPlan:
        path = tmp_path / f"{age}.yaml"
        values = pavement("dense_asphalt").model_dump(mode="json") | {"age": {"least": age, "most": age}}
        path.write_text(yaml.safe_dump(values), encoding="utf-8")
        only = {"main": {str(path): 1.0}, "other": {str(path): 1.0}, "former_markings": FormerMarkings(share=1.0)}
        world = replace(built("cross").world, crossings=())
        return plan_ground(world, seed, style=street_style("uniform").model_copy(update=only))

    return plan


def test_some_new_streets_have_no_markings_yet(planned: Planned) -> None:
    standard = marking_standard("germany").model_copy(
        update={"edge_share": 1.0, "kerb_share": 1.0, "kerb_colour": "red"}
    )
    painted = {True: 0, False: 0}
    streets = {True: 0, False: 0}
    for seed in range(5):
        plan = planned(0.05, seed)
        middles = shapely.points(markings(plan, standard).bars[:, :2])
        for street in plan.streets:
            unpainted = plan.ageing(street).unpainted
            for segment in street.segments:
                ends = shapely.MultiPoint([segment.centre_line.coords[0], segment.centre_line.coords[-1]])
                inner = segment.polygon.difference(ends.buffer(AWAY_M))
                streets[unpainted] += 1
                painted[unpainted] += int(shapely.contains(inner, middles).sum())
    assert min(streets.values()) > 5
    assert painted[True] == 0 < painted[False]


def test_one_street_in_five_is_unpainted_while_it_is_new() -> None:
    chances = [(number + 0.5) / 100 for number in range(100)]
    aged = [ageing(pavement("dense_asphalt"), (age, 0.5, paint)) for age in chances for paint in chances]
    new = [each.unpainted for each in aged if each.age < 0.1]
    assert sum(new) == pytest.approx(0.2 * len(new))
    assert not any(each.unpainted for each in aged if each.age >= 0.1)


def test_only_a_pavement_of_some_age_has_markings_of_an_earlier_layout(planned: Planned) -> None:
    found = dict.fromkeys((0.15, 0.25), 0)
    for age in found:
        for seed in range(3):
            plan = planned(age, seed)
            paint = markings(plan, plan.standard)
            found[age] += int(paint.is_former.sum()) + len(paint.scars)
    assert found[0.15] == 0 < found[0.25]
