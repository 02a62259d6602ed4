"""Plans in a folder."""

from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.flightplan import PLAN_FORMATS, FlightPlan, PlannedFlight, Waypoint, save_plan
from pavetwin.flightplan.formats.plan_files import remark_on_parts


def plan(flights: int) -> FlightPlan:
    ends = [Waypoint(13.4 + 0.001 * i, 52.5, 10.0, 5.0, i == 0, 0.0, None) for i in range(2)]
    return FlightPlan("m", "mavic3e", (PlannedFlight(tuple(ends)),) * flights, interval_s=0.7, spacing_m=3.5)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_files_of_an_earlier_export_are_removed_and_no_others(tmp_path: Path) -> None:
    save_plan(plan(3), tmp_path, [PLAN_FORMATS.get("qgc")(), PLAN_FORMATS.get("wpml")()])
    others = ["flight-1-part-2.txt", "flight-2-notes.csv", "flight-log.csv", "zones.geojson"]
    for name in ("flight-1-part-2-litchi.csv", *others):
        (tmp_path / name).write_text("")
    save_plan(plan(2), tmp_path, [PLAN_FORMATS.get("qgc")()])
    assert names(tmp_path) == sorted(["flight-1.plan", "flight-2.plan", *others])


def test_parts_are_told(tmp_path: Path) -> None:
    points = [Waypoint(13.4 + 0.001 * i, 52.5, 10.0, 5.0, False, 0.0, None) for i in range(150)]
    long = FlightPlan("m", None, (PlannedFlight(tuple(points)),), interval_s=0.7, spacing_m=3.5)
    told = remark_on_parts(save_plan(long, tmp_path, [PLAN_FORMATS.get("litchi")()])) or ""
    assert told.startswith("2 files are parts of a flight. Each takes off and lands at the base")
    assert remark_on_parts(save_plan(long, tmp_path, [PLAN_FORMATS.get("qgc")()])) is None


def test_an_export_that_is_refused_removes_nothing(tmp_path: Path) -> None:
    save_plan(plan(3), tmp_path, [PLAN_FORMATS.get("qgc")()])
    with pytest.raises(PaveTwinError, match="`drone`"):
        save_plan(plan(2), tmp_path, [PLAN_FORMATS.get("wpml")("mavic3")])
    assert names(tmp_path) == ["flight-1.plan", "flight-2.plan", "flight-3.plan"]
