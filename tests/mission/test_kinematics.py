"""Every step of a flight keeps the airframe's limits and stays inside the mesh."""

from math import radians
from typing import TYPE_CHECKING

import numpy as np
import pytest
import shapely

from pavetwin.mission.environment import inspect_speed_mps
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import MODES
from pavetwin.navigation.navmesh import flight_domain, navmesh, polygons
from pavetwin.twin import Mode
from scenes.tiny import TRUCK, Scene, bent, block, parked, straight

if TYPE_CHECKING:
    from pavetwin._core import NavMesh

EVERY_STEP = "visibility.interval_s=0.05"
DT_S = 0.05

# A street that bends, a junction, a side street, a wider one, and trucks that make micro, hover and skip move.
TRUCKS = (parked(30, 1.75, TRUCK), parked(100, 45, TRUCK, yaw_rad=np.pi / 2), parked(55, 10, TRUCK, yaw_rad=0.59))
LIMITS = {
    "usual": [],
    "sluggish": ["uav.acceleration_mps2=1.5", "uav.yaw_rate_deg_s=20", "uav.inspect_speed_mps=3"],
    "hasty": ["uav.transit_speed_mps=15", "uav.inspect_speed_mps=8", "uav.stopping_distance_m=0"],
    "low battery": ["energy.capacity_wh=3.7"],
}


@pytest.fixture(scope="module", params=[*LIMITS])
def limits(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module", params=["baseline", "hover", "micro", "skip"])
def tour(request: pytest.FixtureRequest, limits: str) -> MissionResult:
    scene = Scene(bent(), TRUCKS, altitude_m=10.0)
    return scene.fly(request.param, EVERY_STEP, "policy.max_wait_s=6", *LIMITS[limits])


def test_speed_acceleration_and_yaw_rate_hold_at_every_step(tour: MissionResult) -> None:
    track, uav, inspecting_mps = tour.track, tour.settings.uav, inspect_speed_mps(tour.settings)
    assert np.diff(track["t_s"]) == pytest.approx(DT_S)
    at = np.stack([track["x_m"], track["y_m"]], axis=1)
    velocity = np.diff(at, axis=0) / DT_S
    speed = np.hypot(*velocity.T)
    inspecting = np.isin(track["mode"][1:], [MODES.index(Mode.INSPECT), MODES.index(Mode.DISPLACE)])
    assert speed[inspecting].max() <= inspecting_mps + 1e-6
    assert speed.max() <= uav.transit_speed_mps + 1e-6
    assert speed.max() > 0.9 * inspecting_mps
    turned = np.abs((np.diff(track["yaw_rad"]) + np.pi) % (2 * np.pi) - np.pi)
    assert turned.max() <= radians(uav.yaw_rate_deg_s) * DT_S + 1e-9
    faster = np.abs(np.diff(track["speed_mps"]))
    assert faster.max() <= uav.acceleration_mps2 * DT_S + 1e-9
    # The two agree: the speed it claims is the way it makes, but in the steps that begin or end at rest.
    claimed = (track["speed_mps"][1:] + track["speed_mps"][:-1]) / 2
    assert np.abs(claimed - speed).max() <= uav.acceleration_mps2 * DT_S


def test_every_flown_position_is_inside_the_mesh(tour: MissionResult) -> None:
    mesh = navmesh(tour.environment.world, 10.0, 0.5)
    surface = shapely.union_all(polygons(mesh)).buffer(1e-3)
    points = shapely.points(tour.track["x_m"], tour.track["y_m"])
    assert shapely.covers(surface, points).all()


def test_the_low_battery_is_swapped(tour: MissionResult, limits: str) -> None:
    assert (tour.swaps > 0) == (limits == "low battery")


def test_it_climbs_and_sinks_at_the_climbs_speed_and_on_the_spot(tour: MissionResult) -> None:
    track = tour.track
    rate = np.abs(np.diff(track["altitude_m"])) / DT_S
    assert rate.max() <= tour.settings.uav.climb_speed_mps + 1e-9
    moves = np.hypot(np.diff(track["x_m"]), np.diff(track["y_m"]))
    assert moves[rate > 0].max() == 0.0


def test_it_stands_where_it_arrives(tour: MissionResult) -> None:
    """Between one command and the next the UAV is at rest: it braked to arrive."""
    track = tour.track
    kinds = [MODES.index(mode) for mode in (Mode.TRANSIT, Mode.INSPECT, Mode.HOME, Mode.LAND, Mode.CLIMB)]
    groups = np.where(np.isin(track["mode"], kinds), track["mode"], 255)
    changes = np.flatnonzero((groups[1:] != groups[:-1]) & (groups[1:] != 255) & (groups[:-1] != 255))
    low_battery = {round(action.time_s, 2) for action in tour.actions if action.action == "battery"}
    for change in changes:
        if any(abs(track["t_s"][change] - time) < 0.2 for time in low_battery):
            continue  # an alarm in flight: it brakes on the way home
        assert track["speed_mps"][change] <= tour.settings.uav.acceleration_mps2 * DT_S + 1e-9


def test_a_low_battery_in_flight_does_not_stop_it_on_the_spot() -> None:
    ours = Scene(straight(length_m=300.0), altitude_m=10.0).fly("baseline", EVERY_STEP, "energy.capacity_wh=4.4")
    alarm = next(action for action in ours.actions if action.action == "battery")
    before = int(np.searchsorted(ours.track["t_s"], alarm.time_s - 1e-6))
    assert ours.track["speed_mps"][before] > 4.0
    rest = before + int(np.argmax(ours.track["speed_mps"][before:] == 0.0))
    speed = ours.track["speed_mps"][before]
    assert ours.track["t_s"][rest] - alarm.time_s >= speed / 8 - 0.06
    assert ours.track["x_m"][rest] - alarm.position[0] == pytest.approx(speed**2 / 16, abs=0.3)


@pytest.mark.parametrize("stopping_m", [0.0, 1.0, 3.0])
def test_a_pass_ends_the_stopping_distance_before_its_lines_end(stopping_m: float) -> None:
    ours = Scene(straight((30, 0))).fly("baseline", EVERY_STEP, f"uav.stopping_distance_m={stopping_m}")
    inspecting = ours.track["mode"] == MODES.index(Mode.INSPECT)
    assert ours.track["x_m"][inspecting].max() == pytest.approx(60 - stopping_m, abs=1e-6)


# Around what stands in the way.


def blocked_street() -> Scene:
    """A house stands on the street's middle and leaves a way past it on the north side."""
    return Scene(straight((10, 0), (50, 0), buildings=[block("house", 28, -9, 33, 1.5, 30.0)]), altitude_m=10.0)


def test_a_pass_goes_round_what_stands_on_it_and_inspects_both_sides() -> None:
    ours = blocked_street().fly("baseline", EVERY_STEP)
    assert ours.rows[0].confirmed == 2
    house = shapely.box(28, -9, 33, 1.5)
    points = shapely.points(ours.track["x_m"], ours.track["y_m"])
    assert shapely.distance(points, house).min() >= 0.5 - 0.26  # its radius, to a voxel
    mesh = navmesh(ours.environment.world, 10.0, 0.5)
    assert all(mesh.contains(x, y) for x, y in zip(ours.track["x_m"], ours.track["y_m"], strict=True))


def walled_street(wall_x_m: float) -> Scene:
    """A wall from kerb to kerb and beyond: what lies behind it cannot be reached."""
    wall = block("wall", wall_x_m, -30, wall_x_m + 4, 30, 30.0)
    return Scene(straight((10, 0), (58, 0), buildings=[wall]), altitude_m=10.0)


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_a_segment_whose_end_cannot_be_reached_is_inspected_as_far_as_it_can_be(preset: str) -> None:
    """Its second pass, flown back, would begin behind the wall."""
    ours = walled_street(50.0).fly("baseline", preset=preset)
    assert ours.rows[0].confirmed == 1
    assert ours.rows[0].surface_coverage > (0.75 if preset == "default" else 0.5)
    assert ours.track["x_m"].max() < 50.0


def _inside(mesh: "NavMesh", result: MissionResult) -> bool:
    return all(mesh.contains(x, y) for x, y in zip(result.track["x_m"], result.track["y_m"], strict=True))


@pytest.mark.parametrize("seed", range(6))
def test_micro_stays_inside_the_mesh_among_houses_and_trucks(seed: int) -> None:
    """The policy displaces in all directions, next to walls and corners."""
    rng = np.random.default_rng(seed)
    houses = [
        block(f"h{k}", x, y, x + 6, y + 8, 30.0) for k, (x, y) in enumerate(rng.uniform((4, 2.5), (50, 5), (3, 2)))
    ]
    movers = [parked(x, y, TRUCK, yaw_rad=yaw) for x, y, yaw in rng.uniform((8, -2, -0.6), (55, 2, 0.6), (5, 3))]
    scene = Scene(straight((30, 0), buildings=houses), tuple(movers), altitude_m=10.0)
    ours = scene.fly("micro", EVERY_STEP, "policy.max_displacement_m=6")
    assert _inside(navmesh(ours.environment.world, 10.0, 0.5), ours)
    assert (
        flight_domain(ours.environment.world, 10.0)
        .surface.buffer(0.25)
        .covers(shapely.multipoints(np.stack([ours.track["x_m"], ours.track["y_m"]], axis=1)))
    )


# A whole town.
