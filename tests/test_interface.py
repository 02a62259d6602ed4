"""`import pavetwin as pt`: what Tab shows, and a mission whose events one answers oneself."""

import subprocess
import sys

import numpy as np
import pytest

import pavetwin as pt
from scenes.pilot import Pilot
from scenes.tiny import SCENES


def test_dir_shows_the_interface_and_nothing_else() -> None:
    script = "import pavetwin as pt; print(*dir(pt))"
    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert shown == sorted(pt.__all__)
    assert {"Captured", "Occluded", "BatteryLow", "Mission", "fly", "totals"} <= set(shown)


@pytest.mark.parametrize("name", pt.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(pt, name) is not None


def test_another_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'flyy'"):
        _ = pt.flyy  # type: ignore[attr-defined]


def test_answering_all_events_oneself_gives_the_result_of_fly() -> None:
    pilot = Pilot(SCENES["queue_that_leaves"](), "hover")
    mission = pilot.advance(8.0)
    assert pt.totals(mission).segments == 0
    assert pt.totals(mission).time_s == pytest.approx(8.0, abs=0.1)
    with pytest.raises(pt.PaveTwinError, match="not over"):
        pt.result_of(mission)
    pilot.advance()
    ours, flown = pt.result_of(mission), pilot.scene.fly("hover")
    assert pt.totals(mission) == pt.totals(ours) == pt.totals(flown)
    assert all(np.array_equal(ours.track[name], flown.track[name], equal_nan=True) for name in flown.track)
    assert ours.events == flown.events
    assert ours.swept == flown.swept
    assert ours.spec.policy.name == "handed in"
