"""Painted marks and other distractors from data files: as often as a style states, and never labelled."""

from collections import Counter
from functools import cache

import numpy as np
import pytest
import shapely

from pavetwin.config.named import names_in
from pavetwin.scene.ground import GroundPlan, fixture_models, fixtures, plan_ground
from pavetwin.scene.ground.distractors.fixtures import LEAVES, LITTER, REACH_M
from pavetwin.scene.ground.distractors.marks import marks
from pavetwin.scene.ground.markings.painter import Paint, paint
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.styles import mark, street_style
from pavetwin.scene.ground.styles.pavement import PACKAGE
from pavetwin.scene.values import TILE_M
from scenes import built, tiny

TOWN = "seattle_roosevelt"


@cache
def plan(**rates: float) -> GroundPlan:
    """A town with marks at these rates, by name, and otherwise as `varied` has them."""
    style = street_style("varied")
    return plan_ground(built(TOWN).world, 3, style=style.model_copy(update={"marks": rates}) if rates else style)


@cache
def standard_paint() -> Paint:
    return markings(plan(), plan().standard)


@cache
def marked(**rates: float) -> Paint:
    """The marks at these rates."""
    return marks(plan(**rates), standard_paint())


@pytest.mark.parametrize("name", names_in(PACKAGE, "marks"))
def test_every_mark_is_in_the_style_and_can_be_painted(name: str) -> None:
    assert street_style("varied").marks[name] > 0
    if mark(name).position != "bicycle":  # this town has no bicycle lanes on its carriageways
        assert len(marked(**{name: 20.0}).bars) > 5


def test_marks_are_as_many_as_their_rate_states() -> None:
    length_m = sum(segment.length_m for segment in plan().world.segments)
    found = [len(marked(survey_cross=rate).bars) / 2 for rate in (2.0, 4.0)]  # two strokes each
    assert 0.5 * 2 < found[0] / (length_m / 100) < 2.2
    assert found[1] > 1.5 * found[0]


def test_a_mark_has_the_colours_of_its_file() -> None:
    used = set(marked(utility_arrow=10.0).bar_paints[:, 0].tolist())
    assert used == {paint(colour) for colour in mark("utility_arrow").colours}


def test_paint_of_two_colours_never_meets() -> None:
    """Maps interpolate which paint is where: between two that touch, a third colour would show."""
    both = standard_paint().joined(marked())
    bars = [
        shapely.affinity.rotate(shapely.box(x - half, y - wide, x + half, y + wide), turn, use_radians=True)
        for x, y, turn, half, wide in both.bars
    ]
    new = np.arange(len(standard_paint().bars), len(bars))
    mine, other = shapely.STRtree(bars).query([bars[index] for index in new], "intersects")
    assert len(new) > 200
    np.testing.assert_array_equal(both.bar_paints[new[mine], 0], both.bar_paints[other, 0])


def test_distractors_have_no_label() -> None:
    of_kind = Counter(fixture.model for fixture in plan().fixtures)
    assert {"litter", "valve", "leaves"} < set(of_kind)
    assert {"cover_iron", "cover_filled", "cover_square", "cover_collared"} <= set(of_kind)
    where = {(int(fixture.x // TILE_M), int(fixture.y // TILE_M)) for fixture in plan().fixtures[:40]}
    seen = [instance for key in where for instance in fixtures(plan(), key)]
    assert len(seen) >= 40
    assert {instance.label for instance in seen} == {0}


def test_every_flush_fixture_has_a_model_within_its_reach() -> None:
    assert set(REACH_M) == set(fixture_models())
    for name, model in fixture_models().items():
        positions = model.parts["body"].positions
        assert np.hypot(positions[:, 0], positions[:, 1]).max() <= REACH_M[name], name
        assert positions[:, 2].max() < (0.05 if name.startswith(("lea", "litter")) else 0.01), name


def test_litter_and_leaves_are_of_many_forms_and_leaves_drift_to_kerbs() -> None:
    forms = [fixture_models()[name].parts["body"].positions for name in (*LITTER, *LEAVES)]
    assert len({form.tobytes() for form in forms}) == len(LITTER) + len(LEAVES)
    found = Counter(fixture.model for fixture in plan().fixtures)
    assert min(found[name] for name in (*LITTER, *LEAVES)) > 0
    drifts = [fixture for fixture in plan().fixtures if fixture.model == "leaf_drift"]
    assert len(drifts) > 10
    to_kerb = shapely.distance(plan().road.boundary, shapely.points([(each.x, each.y) for each in drifts]))
    assert to_kerb.max() < 0.05
    assert all(plan().road.contains(shapely.Point(each.x, each.y)) for each in drifts)


def test_water_runs_along_kerbs_as_often_as_the_style_states() -> None:
    world = tiny.straight(length_m=400.0)
    varied = street_style("varied")
    dry, wet = (
        varied.model_copy(update={"dirt": varied.dirt.model_copy(update={"water": water})}) for water in (0.0, 3.0)
    )
    few, many = (np.array(plan_ground(world, 3, style=style).repairs.spots) for style in (dry, wet))
    assert len(many) > len(few) + 100
    damp = many[many[:, 2] > 0.04]
    assert (np.abs(damp[:, 1]) > 2.5).mean() > 0.6
