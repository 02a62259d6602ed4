"""Pavements so new that they have no markings yet, or none of an earlier layout."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import shapely
import yaml

from pavetwin.scene.ground import GroundPlan, plan_ground
from pavetwin.scene.ground.layout.paved import ageing
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.styles import pavement, street_style
from pavetwin.scene.ground.styles.marking_standard import marking_standard
from pavetwin.scene.ground.styles.street_style import FormerMarkings
from scenes import built

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
