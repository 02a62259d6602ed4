"""Mixes of vehicles: data files with sources, the default one as it always was."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pavetwin.scene.looks import vehicle_model
from pavetwin.traffic.demand import DEFAULT_MIX, kinds_of, mix_named, mix_names
from pavetwin.traffic.kinds import KINDS, OTHER_VEHICLES, PEDESTRIANS, VEHICLES, sumo_types
from pavetwin.traffic.record import record
from scenes.traffic import scene_world


def test_the_default_mix_is_that_of_the_densities() -> None:
    assert mix_names()[0] == DEFAULT_MIX
    assert mix_named(DEFAULT_MIX).vehicles == tuple((kind, kind.share) for kind in VEHICLES)
    assert sumo_types(kinds_of(DEFAULT_MIX)) == sumo_types()
    assert sumo_types().count("<vType") == len(VEHICLES) + len(PEDESTRIANS)


@pytest.mark.parametrize("name", mix_names())
def test_every_mix_says_where_it_is_from(name: str) -> None:
    mix = mix_named(name)
    assert sum(mix.shares.values()) == pytest.approx(1.0)
    assert all(len(source) > 40 for source in (*mix.sources, mix.ours))


def test_every_further_kind_is_in_a_mix_and_drawn_with_a_model_that_exists() -> None:
    named = {kind for name in mix_names() for kind in mix_named(name).shares}
    for kind in OTHER_VEHICLES:
        assert kind.name in named
        model = vehicle_model(kind.name, np.array([kind.length_m, kind.width_m, kind.height_m]))
        assert model == kind.model
        assert not KINDS[model].model  # it has one of its own


def test_vehicles_on_the_streets_follow_the_mix(tmp_path: Path) -> None:
    world = scene_world("cross", tmp_path, sidewalks=False)
    made = record(world, "v40-p0+south_asia", 1, 300.0)
    assert made.name == "v40-p0+south_asia"
    kinds = Counter(made.agents.kind)
    two_wheelers = (kinds["scooter"] + kinds["motorcycle"]) / kinds.total()
    assert two_wheelers == pytest.approx(0.5, abs=0.12)
    assert kinds["auto_rickshaw"] / kinds.total() == pytest.approx(0.10, abs=0.06)
    first = made.agents.kind.index("auto_rickshaw")
    assert made.agents.length_m[first] == pytest.approx(2.64)
