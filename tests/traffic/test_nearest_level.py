"""Where nobody asks for a level of service, a world that cannot reach the usual one gets the nearest that it can."""

from collections.abc import Callable
from functools import partialmethod
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.demand import LevelOfService, density_named
from pavetwin.traffic.demand_search import DemandSearch, nearest_first, within_reach
from pavetwin.world.model import World
from scenes.demand import on_the_curve
from scenes.traffic import scene_world


@pytest.fixture(scope="module")
def cross(tmp_path_factory: pytest.TempPathFactory) -> World:
    return scene_world("cross", tmp_path_factory.mktemp("worlds"), sidewalks=False)


@pytest.fixture
def keeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Makes the nearly empty network keep a share of the speed limits."""
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path))

    def keep(share: float) -> None:
        monkeypatch.setattr(DemandSearch, "_simulated", partialmethod(on_the_curve, empty_ratio=share))

    return keep


@pytest.mark.parametrize(
    ("empty", "asked", "flown"),
    [
        (0.72, "los-C", "los-C"),
        (0.47, "los-C", "los-D"),
        (0.36, "los-C", "los-E"),
        (0.36, "los-C+south_asia", "los-E+south_asia"),
        (0.72, "los-A", "los-B"),
        (0.36, "hour-08", "hour-08"),
        (0.36, "high", "high"),
    ],
)
def test_the_nearest_level_that_is_reached_takes_its_place(
    cross: World, keeps: Callable[[float], None], empty: float, asked: str, flown: str
) -> None:
    keeps(empty)
    assert within_reach(cross, density_named(asked)).name == flown


def test_of_two_levels_as_near_the_worse_comes_first() -> None:
    assert "".join(nearest_first(LevelOfService.C)) == "CDBEAF"
    assert "".join(nearest_first(LevelOfService.A)) == "ABCDEF"


def test_what_goes_wrong_in_the_simulation_is_no_level_out_of_reach(
    cross: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise PaveTwinError("SUMO crashed.")

    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path))
    monkeypatch.setattr(DemandSearch, "_simulated", fail)
    with pytest.raises(PaveTwinError, match="SUMO crashed"):
        within_reach(cross, density_named("los-C"))
