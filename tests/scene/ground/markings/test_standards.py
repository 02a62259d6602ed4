"""Marking standards from data files: by place, by a look, and what is wrong with a file in one line."""

from importlib.resources import files
from pathlib import Path

import pytest
import yaml

from pavetwin.errors import PaveTwinError
from pavetwin.scene.ground import plan_ground
from pavetwin.scene.ground.looks import street_look
from pavetwin.scene.ground.markings.standard import PACKAGE, marking_standard, paint, standard_names, standard_of
from scenes import built


@pytest.mark.parametrize(("town", "name"), [("berlin_neukoelln", "germany"), ("seattle_roosevelt", "united_states")])
def test_the_place_decides_the_standard(town: str, name: str) -> None:
    assert standard_of(built(town).world) == marking_standard(name)


def test_standards_differ_in_what_one_sees() -> None:
    seen = [
        (each.lane_dash_m, each.centre_colour, each.stripe_m, each.stop_m)
        for each in map(marking_standard, standard_names())
    ]
    assert len(seen) == len(set(seen)) >= 5


def test_a_look_may_ask_for_a_standard_of_its_own(tmp_path: Path) -> None:
    text = (files(PACKAGE) / "standards" / "germany.yaml").read_text(encoding="utf-8")
    mine = tmp_path / "mine.yaml"
    mine.write_text(yaml.safe_dump(yaml.safe_load(text) | {"centre_colour": "blue", "lane_dash_m": [1.0, 1.0]}))
    world = built("berlin_neukoelln").world
    before = plan_ground(world, 3, look=street_look("uniform")).paint
    after = plan_ground(world, 3, look=street_look("uniform").model_copy(update={"markings": str(mine)})).paint
    assert paint("blue") not in before.bar_looks[:, 0]
    assert (after.bar_looks[:, 0] == paint("blue")).sum() > 20


def test_a_mistake_in_a_standard_is_one_line_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("title: mine\nline_m: 12\n")
    with pytest.raises(PaveTwinError, match=r"^marking standard '.*mine\.yaml': \w+: [^\n]*$"):
        marking_standard(str(path))
