"""The numbers of a recording's flow, on a straight street with a limit of 50 km/h, from traces made by hand."""

from dataclasses import replace
from math import pi
from pathlib import Path

import pytest

from pavetwin.traffic.flow import as_values, at_limits, flow_of
from pavetwin.traffic.job import SpeedLimits
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.recording_file import load_recording, save_recording
from pavetwin.world.model import World
from scenes.recordings import Pose, recording
from scenes.traffic import scene_world

LIMIT_MPS = 13.89


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> World:
    return scene_world("straight", tmp_path_factory.mktemp("worlds"), sidewalks=False)


def with_limits(made: Recording, world: World) -> Recording:
    """A recording with the speed limits of a world."""
    samples = at_limits(made.tracks.rows, made.agents.is_pedestrian, SpeedLimits.of(world), made.step_s)
    return replace(made, at_limits=samples)


def half_and_standing(agent: int, time_s: float) -> Pose:
    """A car at half the limit, and one that stands."""
    speed = LIMIT_MPS / 2 if agent == 0 else 0.0
    return 100.0 + speed * time_s + 200.0 * agent, -1.6, 0.0, speed


def test_a_hand_made_trace_has_the_ratio_that_one_can_compute(street: World) -> None:
    made = replace(recording(["compact", "suv"], half_and_standing), removals=((3, 2),))
    flow = flow_of(with_limits(made, street))
    assert flow.ratio == pytest.approx(0.25, rel=1e-3)  # one at a half, one at 0: their free-flow time over their time
    assert flow.free_flow_kmh == pytest.approx(3.6 * LIMIT_MPS, rel=1e-3)
    assert flow.speed_kmh == pytest.approx(3.6 * LIMIT_MPS / 4, rel=1e-3)
    assert flow.standing == 0.5
    assert flow.level == "F"
    assert flow.per_lane_km == 2.0  # the recording's capacity is 1 km of lanes
    assert flow.flow_per_lane_h == pytest.approx(2 * 3.6 * LIMIT_MPS / 4, rel=1e-3)
    hours = 2 * made.frames * made.step_s / 3600
    assert flow.removed_per_vehicle_hour == pytest.approx(2 / hours)
    assert "beyond capacity" in flow.removals_sentence
    assert "25 % of the speed limits: level of service F by chance, since so few drive; 50 %" in flow.sentence
    assert "level of service F; 50 % of vehicles stand" in replace(flow, vehicle_hours=2.0).sentence
    assert as_values(flow)["level_of_service"] == "F"


def test_people_are_no_traffic(street: World) -> None:
    alone = flow_of(with_limits(recording(["compact"], half_and_standing), street))
    beside = flow_of(with_limits(recording(["compact", "man"], half_and_standing), street))
    assert beside.speed_kmh == alone.speed_kmh
    assert beside.ratio == pytest.approx(0.5, rel=1e-3)
    assert beside.standing == 0.0


def test_without_vehicles_there_is_no_speed(street: World) -> None:
    flow = flow_of(with_limits(recording(["man"], half_and_standing), street))
    assert (flow.speed_kmh, flow.ratio, flow.level, flow.removed_per_vehicle_hour) == (None, None, None, None)
    assert flow.sentence == "There are no vehicles."


def test_the_limit_is_that_of_the_direction(street: World) -> None:
    slow = replace(street, lanes=tuple(_slower(lane) for lane in street.lanes))
    eastward, westward = SpeedLimits.of(slow).at([300.0, 300.0], [0.0, 0.0], [0.0, pi])
    assert eastward == pytest.approx(LIMIT_MPS, rel=1e-3)
    assert westward == pytest.approx(5.0)


def _slower(lane):  # type: ignore[no-untyped-def]
    return replace(lane, speed_limit_mps=5.0) if lane.edge == "ba" else lane


def test_a_saved_recording_has_its_free_flow_speed(street: World, tmp_path: Path) -> None:
    made = with_limits(recording(["compact", "suv"], half_and_standing), street)
    saved = load_recording(save_recording(made, tmp_path / "saved.parquet").path or "")
    assert flow_of(saved).ratio == pytest.approx(0.25, rel=1e-3)
    assert saved.speed_ratio == flow_of(saved).ratio


def test_in_a_world_without_lanes_there_is_no_free_flow(street: World) -> None:
    bare = replace(street, lanes=())
    assert flow_of(with_limits(recording(["compact"], half_and_standing), bare)).ratio is None
