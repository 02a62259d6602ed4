"""Reasons of missed defects in scenes with a known reason, and in the files."""

from pathlib import Path

import numpy as np
import polars as pl
import pyogrio
import pytest
import shapely

from pavetwin._core import Viewpoint
from pavetwin.defects import DEFECT_CLASSES
from pavetwin.mission import MissionInputs, fly, save_mission
from pavetwin.mission.inspected_defects import InspectedDefect, MissReason, PolicyResponse, inspected_defects
from pavetwin.mission.result import MissionResult
from pavetwin.policies import policy_names
from scenes.tiny import CAR, PERSON, SCENES, Scene, block, parked, result, straight

SHORT = "policy.max_wait_s=10"


def only(result: MissionResult) -> InspectedDefect:
    (outcome,) = inspected_defects(result)
    return outcome


def test_a_found_defect_names_the_capture_that_confirmed_it() -> None:
    ours = result("empty_street", "baseline")
    outcome, confirmed = only(ours), ours.confirmed
    assert outcome.is_found
    assert (outcome.capture, outcome.time_s) == (confirmed.capture[0], confirmed.time_s[0])
    assert (outcome.visible_fraction, outcome.captures, outcome.responses) == (1.0, 2, ())


@pytest.mark.parametrize(
    ("policy", "response"),
    [
        ("baseline", PolicyResponse.GO_ON),
        ("hover", PolicyResponse.WAIT),
        ("micro", PolicyResponse.DISPLACE),
        ("skip", PolicyResponse.REVISIT),
    ],
)
def test_below_a_parked_car_it_is_hidden_by_a_vehicle_whatever_the_policy_does(
    policy: str, response: PolicyResponse
) -> None:
    outcome = only(result("parked_car_over_defect", policy, SHORT))
    assert outcome.reason is MissReason.HIDDEN_BY_VEHICLES
    assert outcome.responses == (response,)
    assert outcome.visible_fraction == 0.0
    assert outcome.hidden_by is not None
    assert outcome.hidden_by[MissReason.HIDDEN_BY_VEHICLES] == 1.0
    assert (outcome.captures_on_revisit > 0) == (policy == "skip")


def test_where_little_of_the_window_is_hidden_no_policy_is_asked() -> None:
    """A car on a wide street hides the defect below it, and a tenth of the window."""
    ours = Scene(straight((30, 4), width_m=12.0), (parked(30, 4, CAR),), altitude_m=15.0).fly("hover")
    assert ours.rows[0].occlusions == 0
    assert only(ours).responses == (PolicyResponse.NOT_ASKED,)


def test_pedestrians_and_static_objects_are_distinct_reasons() -> None:
    people = tuple(parked(30 + 0.3 * column, 0.3 * row, PERSON) for column in (-1, 0, 1) for row in (-1, 0, 1))
    assert only(Scene(straight((30, 0)), people).fly("baseline")).reason is MissReason.HIDDEN_BY_PEDESTRIANS
    awning = block("awning", 26, 1.5, 34, 3.5, 3.0)
    behind = Scene(straight((30, 2.5), buildings=[awning])).fly("baseline")
    assert only(behind).reason is MissReason.HIDDEN_BY_FIXED_OBJECTS
    assert only(behind).responses == (PolicyResponse.NOT_ASKED,)


def test_a_sensor_that_reports_nothing_has_not_recognised_it() -> None:
    outcome = only(Scene(straight((30, 0))).fly("baseline", "sensing.sensor=recall", "sensing.recall=0"))
    assert outcome.reason is MissReason.NOT_RECOGNISED
    assert (outcome.captures, outcome.visible_fraction, outcome.hidden_by) == (2, 1.0, None)


def test_narrow_windows_leave_defects_outside_the_swath_and_between_captures() -> None:
    """The paper's window at 6 m is 3.6 m wide and 1.9 m long, passes are at ±3 m, and captures 3 m apart."""
    places = [(10 + 0.5 * k, 3.0) for k in range(12)]
    ours = Scene(straight((30, 0.0), *places, width_m=12.0)).fly("baseline", preset="paper")
    outcomes = inspected_defects(ours)
    assert outcomes[0].reason is MissReason.OUTSIDE_SWATH
    assert {outcome.reason for outcome in outcomes[1:]} == {None, MissReason.BETWEEN_CAPTURES}
    assert sum(outcome.reason is not MissReason.OUTSIDE_SWATH for outcome in outcomes) == ours.rows[0].swept


@pytest.mark.parametrize("policy", policy_names())
@pytest.mark.parametrize("scene", ["lively_street", "truck_beside_defects", "queue_that_leaves"])
def test_what_is_judged_again_is_what_the_kernel_saw(scene: str, policy: str) -> None:
    """Found are those that were confirmed, and what a confirming capture showed is judged alike from its columns."""
    ours = result(scene, policy, SHORT)
    outcomes = {outcome.defect.id: outcome for outcome in inspected_defects(ours)}
    assert len(outcomes) == ours.rows[0].defects
    assert {number for number, outcome in outcomes.items() if outcome.is_found} == set(ours.memory.confirmed)
    found, captures = ours.confirmed, ours.captures
    for row, (defect, capture) in enumerate(zip(found.defect.tolist(), found.capture.tolist(), strict=True)):
        place = float(captures["x_m"][capture]), float(captures["y_m"][capture])
        yaw_rad = float(captures["yaw_rad"][capture])
        eye = Viewpoint(position=place, altitude_m=ours.settings.altitude_m, yaw_rad=yaw_rad)
        shares = ours.environment.ground.defect_shares(defect, ours.trace, float(found.time_s[row]), eye)
        assert shares["visible"] == found.visible_fraction[row]
        assert outcomes[defect].captures > 0
    least = ours.settings.sensing.min_visible_fraction
    missed = [outcome for outcome in outcomes.values() if not outcome.is_found]
    assert all((outcome.visible_fraction or 0.0) < least for outcome in missed), "the sensor misses nothing"


@pytest.mark.parametrize("policy", ["hover", "skip"])
@pytest.mark.parametrize("scene", ["truck_beside_defects", "queue_at_light"])
def test_what_is_watched_in_flight_is_not_asked_of_the_traffic_again(
    scene: str, policy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = result(scene, policy, SHORT)
    made = SCENES[scene]()
    inputs = MissionInputs(made.environment(ours.settings), made.traffic())
    watched = fly(ours.spec, inputs=inputs, watches_defects=True)
    expected = inspected_defects(ours)
    assert len(watched.known_shares) == sum(each.captures for each in expected if not each.is_found) > 0
    monkeypatch.setattr("pavetwin.mission.inspected_defects.shares_of", None)
    assert inspected_defects(watched) == expected


def test_the_files_hold_every_defect_with_its_sizes_and_its_reason(tmp_path: Path) -> None:
    ours = result("queue_at_light", "skip", SHORT)
    save_mission(ours, tmp_path / "m")
    table = pl.read_csv(tmp_path / "m" / "defects.csv")
    assert table["id"].to_list() == list(range(7))
    assert set(table["outcome"]) == {"missed"}
    assert set(table["reason"]) == {"hidden_by_vehicles"}
    assert table["policy_response"].str.contains("revisit").any()
    assert table.select("class", "severity", "width_m", "area_m2", "segment", "street").row(0) == (
        *("pothole", "medium", 0.4, 0.16, "street", "unnamed street, street"),
    )
    assert table["longitude"].is_between(8.9, 9.1).all()
    meta, _, shapes, columns = pyogrio.raw.read(tmp_path / "m" / "defects.gpkg", layer="defects")
    assert meta["crs"] == "EPSG:32632"
    assert list(meta["fields"]) == table.columns
    fields = dict(zip(meta["fields"], columns, strict=True))
    assert fields["reason"].tolist() == table["reason"].to_list()
    centre = shapely.centroid(shapely.from_wkb(shapes[0]))
    np.testing.assert_allclose((centre.x, centre.y), (500010.0, 5000000.0), atol=1e-6)


def test_what_has_no_value_is_null_in_both_files(tmp_path: Path) -> None:
    save_mission(Scene(straight((30, 0.0), (30, 3.0), width_m=12.0)).fly("baseline", preset="paper"), tmp_path / "m")
    table = pl.read_csv(tmp_path / "m" / "defects.csv")
    assert table["capture"].null_count() == table["visible_fraction"].null_count() >= 1
    meta, _, _, columns = pyogrio.raw.read(tmp_path / "m" / "defects.gpkg", layer="defects")
    fields = dict(zip(meta["fields"], columns, strict=True))
    assert np.isnan(fields["capture"]).sum() == table["capture"].null_count()


def test_a_mission_over_no_defects_has_the_files_too(tmp_path: Path) -> None:
    save_mission(Scene(straight()).fly("baseline"), tmp_path / "m")
    assert pl.read_csv(tmp_path / "m" / "defects.csv").height == 0
    assert pyogrio.read_info(tmp_path / "m" / "defects.gpkg", layer="defects")["features"] == 0


def test_the_classes_of_found_defects_carry_their_id_and_sizes_in_geojson(tmp_path: Path) -> None:
    ours = result("empty_street", "baseline")
    save_mission(ours, tmp_path / "m")
    meta, _, _, columns = pyogrio.raw.read(tmp_path / "m" / "captures.geojson")
    fields = {name: column[0] for name, column in zip(meta["fields"], columns, strict=True)}
    assert fields["class"] in DEFECT_CLASSES.names()
    assert (fields["id"], fields["severity"], fields["width_m"], fields["area_m2"]) == (0, "medium", 0.4, 0.16)
    assert fields["capture"] == ours.confirmed.capture[0]
