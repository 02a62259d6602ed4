"""Levels of service out of reach in a study: replaced where its design allows it, and kept where it does not."""

from dataclasses import replace

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.experiments import planning as reach
from pavetwin.experiments.design import Design, preset_text
from pavetwin.experiments.planning import with_levels_in_reach
from pavetwin.experiments.units import units_of
from pavetwin.traffic.demand import Density, density_named
from pavetwin.world.model import World
from scenes.tiny import straight


@pytest.fixture(autouse=True)
def _in_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over `slow` no level is better than D, and over `odd` SUMO fails."""

    def within_reach(over: World, asked: Density, _tell: object, **_how: object) -> Density:
        if over.name == "odd":
            raise PaveTwinError("SUMO crashed.")
        return density_named("los-D") if over.name == "slow" and asked.name in ("los-B", "los-C") else asked

    monkeypatch.setattr(reach, "within_reach", within_reach)


def named(name: str) -> World:
    return replace(straight(), name=name)


def flown(design: Design, *worlds: World) -> tuple[Design, list[str]]:
    notices: list[str] = []
    return with_levels_in_reach(design, worlds, lambda _share, _what: None, notices.append), notices


def test_levels_out_of_reach_are_replaced_once_in_their_world_alone() -> None:
    design = Design(worlds=("x", "y", "z"), densities=("los-B", "los-C", "los-E"), or_nearest=True, replicates=1)
    made, notices = flown(design, named("slow"), named("town"), named("odd"))
    assert [made.traffics(at) for at in range(3)] == [("los-D", "los-E"), design.densities, design.densities]
    assert len(units_of(made)) == 8
    assert notices == [
        "Levels of service B and C are out of reach in 'slow'; the nearest are flown: D for B and D for C."
    ]
    assert Design.model_validate(made.model_dump(mode="json")) == made


def test_levels_asked_for_are_kept() -> None:
    design = Design(worlds=("x",), densities=("los-B",))
    assert flown(design, named("slow")) == (design, [])


@pytest.mark.parametrize(("preset", "allowed"), [("default", True), ("paper", False)])
def test_the_quick_study_allows_it(preset: str, allowed: bool) -> None:
    assert f"or_nearest: {str(allowed).lower()} " in preset_text(preset, "worlds/town")
