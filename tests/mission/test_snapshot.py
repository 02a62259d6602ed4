"""D_t as a policy sees it: typed, unchanging, and its predictions against what is then seen."""

import copy
from math import cos, sin

import numpy as np
import pytest

from pavetwin._core import Captured, Occluded, Viewpoint
from pavetwin.mission.environment import nadir_camera
from pavetwin.mission.mission import Mission
from pavetwin.policies import Displace, Wait
from pavetwin.sensing import Detections
from pavetwin.twin import Agent, AgentClass, InspectionMemory, Mode, Snapshot, UavState
from pavetwin.uav import camera_of
from pavetwin.world.model import Segment
from scenes.tiny import SCENES, TRUCK, Scene, parked, passing, straight


def mission_of(scene: Scene, *overrides: str) -> Mission:
    settings = scene.settings(*overrides)
    return Mission(scene.environment(settings), scene.traffic(), settings, [0], policy="watched")


def first_snapshot(scene: Scene, *overrides: str) -> tuple[Mission, Snapshot]:
    mission = mission_of(scene, *overrides)
    for event in mission:
        if isinstance(event, Occluded):
            return mission, mission.snapshot(event)
    raise AssertionError("nothing was hidden")


def test_a_snapshot_is_the_twin_as_typed_values() -> None:
    mission, snapshot = first_snapshot(SCENES["lively_street"]())
    assert snapshot.time_s == mission.flight.time_s > 0
    assert snapshot.segments == mission.environment.world.segments
    assert all(isinstance(segment, Segment) for segment in snapshot.segments)
    assert isinstance(snapshot.uav, UavState)
    assert snapshot.uav.mode is Mode.INSPECT
    assert snapshot.uav.altitude_m == 6.0
    assert 0 < snapshot.uav.battery < 1
    assert isinstance(snapshot.memory, InspectionMemory)
    assert snapshot.policy == "watched"
    assert snapshot.segment is snapshot.segments[0]
    assert snapshot.occlusion is not None
    assert 0 <= snapshot.occlusion.visibility < 0.7
    assert snapshot.occlusion.episode.since_s <= snapshot.time_s
    assert snapshot.window_along_m == pytest.approx(6 * 0.57735)
    assert all(isinstance(agent, Agent) for agent in snapshot.agents)
    assert {agent.kind for agent in snapshot.agents} == {AgentClass.VEHICLE, AgentClass.PEDESTRIAN}


def test_the_memory_in_a_snapshot_is_that_of_the_moment() -> None:
    mission = mission_of(SCENES["queue_at_light"]())
    shares = []
    for event in mission:
        if isinstance(event, Occluded):
            shares.append(mission.snapshot(event).memory.surface_coverage["street"])
            assert shares[-1] == mission.flight.surface_coverage(0)
    assert len(set(shares)) > 5
    assert shares == sorted(shares)


def test_agents_have_the_place_velocity_and_body_they_were_written_with() -> None:
    scene = Scene(straight((30, 0)), (passing(0, -1.75, 4.0), parked(30, 0.5, TRUCK, yaw_rad=0.3)), altitude_m=6.0)
    _, snapshot = first_snapshot(scene)
    car, truck = snapshot.agents
    assert car.position == pytest.approx((4.0 * snapshot.time_s, -1.75), abs=1e-4)
    assert car.velocity_mps == pytest.approx((4.0, 0.0), abs=1e-4)
    assert (car.length_m, car.width_m, car.height_m) == pytest.approx((4.5, 1.8, 1.5))
    assert car.heading_deg == pytest.approx(90.0)
    assert truck.velocity_mps == (0.0, 0.0)
    assert truck.yaw_rad == pytest.approx(0.3)
    assert truck.heading_deg == pytest.approx(90 - np.degrees(0.3), abs=1e-4)


def test_agents_of_a_snapshot_are_those_of_the_recording_at_its_time() -> None:
    mission, snapshot = first_snapshot(SCENES["lively_street"]())
    columns = mission.traffic.trace().agents_at(snapshot.time_s)
    assert [agent.id for agent in snapshot.agents] == list(columns["agent"])
    assert [agent.position for agent in snapshot.agents] == list(zip(columns["x_m"], columns["y_m"], strict=True))


def test_a_snapshot_stays_as_it_is_when_the_mission_flies_on() -> None:
    scene = SCENES["lively_street"]()
    mission, candidates = mission_of(scene), np.array([(0.0, 0.0), (2.0, 1.0), (0.0, -3.0)])
    taken: list[tuple[Snapshot, object]] = []

    def reported(snapshot: Snapshot) -> object:
        place = snapshot.occlusion.hidden_place if snapshot.occlusion else None
        shares = tuple(snapshot.moment.predict(candidates))
        agents = tuple(snapshot.moment.agents())  # computed again, not remembered
        memory = snapshot.memory
        return (
            snapshot.time_s,
            snapshot.uav,
            dict(memory.confirmed),
            dict(memory.surface_coverage),
            memory.notes,
            place,
            shares,
            agents,
        )

    for event in mission:
        match event:
            case Captured():
                mission.confirm(Detections.of_defects(sighting.defect for sighting in mission.frame(event).sightings))
            case Occluded():
                snapshot = mission.snapshot(event)
                taken.append((snapshot, copy.deepcopy(reported(snapshot))))
                mission.act(Wait(1.0) if len(taken) % 2 else Displace(1.0, 1.0))
    assert len(taken) > 4
    assert mission.flight.time_s > taken[-1][0].time_s + 5
    for snapshot, was in taken:
        assert reported(snapshot) == was


def test_without_an_inspection_there_is_no_occlusion_and_nothing_to_predict() -> None:
    mission = mission_of(SCENES["lively_street"]())
    snapshot = mission.snapshot()
    assert snapshot.segment is None
    assert snapshot.occlusion is None
    assert snapshot.uav.mode is Mode.GROUND
    assert list(snapshot.predict_visibility([(0, 0), (1, 1)])) == [0.0, 0.0]
    assert len(snapshot.agents) > 5


# Predictions.


def look(mission: Mission, position: tuple[float, float], yaw_rad: float, time_s: float) -> tuple[set, set]:
    """Which cells are candidates and which visible from a place, by the kernel's own look."""
    settings = mission.settings
    seen = mission.environment.ground.observe(
        0,
        mission.traffic.trace(),
        time_s,
        nadir_camera(camera_of(settings), settings.camera),
        Viewpoint(position=position, altitude_m=settings.altitude_m, yaw_rad=yaw_rad),
    )
    return {tuple(cell) for cell in seen["candidates"]}, {tuple(cell) for cell in seen["visible"]}


@pytest.mark.parametrize("scene", ["truck_beside_defects", "queue_at_light", "parked_car_over_defect"])
def test_a_prediction_in_a_static_scene_is_what_is_then_seen(scene: str) -> None:
    """Displaced or not: the share of the cells hidden now that the camera would see from where it then is."""
    mission, snapshot = first_snapshot(SCENES[scene]())
    yaw, speed = snapshot.uav.yaw_rad, snapshot.uav.speed_mps
    candidates, visible = look(mission, snapshot.uav.position, yaw, snapshot.time_s)
    hidden = candidates - visible
    assert snapshot.occlusion is not None
    assert len(visible) / len(candidates) == pytest.approx(snapshot.occlusion.visibility)
    assert np.mean(list(hidden), axis=0) == pytest.approx(snapshot.occlusion.hidden_place)
    braking_m = speed**2 / 16
    rest = (snapshot.uav.position[0] + braking_m * cos(yaw), snapshot.uav.position[1] + braking_m * sin(yaw))
    moves = [(0.0, 0.0), (0.0, 3.0), (0.0, -2.0), (2.5, 1.0), (-1.5, 0.0), (-2.0, 2.0)]
    shares = snapshot.predict_visibility(moves)
    for (east, north), share in zip(moves, shares, strict=True):
        _, then = look(mission, (rest[0] + east, rest[1] + north), yaw, snapshot.time_s)
        assert share == pytest.approx(len(then & hidden) / len(hidden))
    assert len(set(shares)) > 2


@pytest.mark.parametrize("scene", ["truck_beside_defects", "queue_at_light"])
def test_a_displacement_shows_what_was_predicted_of_it(scene: str) -> None:
    """The displacement is flown, and the capture at its end sees the predicted share of the cells hidden before."""
    mission = mission_of(SCENES[scene](), "visibility.interval_s=0.05")
    flight, promised, hidden = mission.flight, None, set()
    for event in mission:
        if isinstance(event, Occluded) and promised is None:
            snapshot = mission.snapshot(event)
            candidates, visible = look(mission, snapshot.uav.position, snapshot.uav.yaw_rad, snapshot.time_s)
            hidden = candidates - visible
            promised = float(snapshot.predict_visibility([(0.0, 2.0)])[0])
            mission.act(Displace(0.0, 2.0))
    assert promised is not None
    captures = flight.captures()
    aside = int(np.argmax(captures["y_m"]))
    assert captures["y_m"][aside] == pytest.approx(2.0)
    _, then = look(mission, (captures["x_m"][aside], captures["y_m"][aside]), captures["yaw_rad"][aside], 0.0)
    assert len(then & hidden) / len(hidden) == pytest.approx(promised, abs=0.05)


def test_a_displacement_out_of_the_domain_is_marked() -> None:
    _, snapshot = first_snapshot(SCENES["truck_beside_defects"]())
    shares = snapshot.predict_visibility([(0.0, 6.0), (0.0, 8.0), (0.0, -200.0)])
    assert shares[0] >= 0
    assert list(shares[1:]) == [-1.0, -1.0]


def test_a_prediction_moves_the_agents_on_at_their_velocity() -> None:
    """A car about to leave the window is predicted to show more of it than one that stays."""
    leaving = Scene(straight((30, 0), width_m=4.0), (passing(30, 0, 6.0, from_s=9.1),))
    staying = SCENES["parked_car_over_defect"]()
    _, before = first_snapshot(staying)
    settings = leaving.settings()
    mission = Mission(leaving.environment(settings), leaving.traffic(), settings, [0])
    snapshots = [mission.snapshot(event) for event in mission if isinstance(event, Occluded)]
    stays = before.predict_visibility([(0.0, 0.0)])[0]
    assert snapshots
    assert max(snapshot.predict_visibility([(0.0, 0.0)])[0] for snapshot in snapshots) > stays + 0.2


def test_predictions_take_any_array_of_pairs() -> None:
    _, snapshot = first_snapshot(SCENES["truck_beside_defects"]())
    pair = (2 * cos(0.4), 2 * sin(0.4))
    once = snapshot.predict_visibility([pair])
    many = snapshot.predict_visibility(np.array([pair] * 5, dtype=np.float32))
    assert once.shape == (1,)
    assert many == pytest.approx(np.repeat(once, 5), abs=0.02)
    assert snapshot.predict_visibility(np.empty((0, 2))).shape == (0,)
