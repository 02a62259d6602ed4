"""The battery in flight: it sends the UAV home in time, is swapped, and the mission goes on where it was."""

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from shapely import Polygon, box

from pavetwin._core import BatteryLow
from pavetwin.errors import PaveTwinError
from pavetwin.mission.events import SegmentOutOfReach
from pavetwin.mission.mission import Mission
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import MODES
from pavetwin.twin import Mode
from pavetwin.world.model import Junction
from scenes.tiny import SCENES, Scene, parked, straight, street, world

if TYPE_CHECKING:
    from pavetwin._core import TrackColumns

LONG = straight(*[(10 + 5 * k, 0) for k in range(55)], length_m=300)


def battery(capacity_wh: float) -> list[str]:
    """Batteries of another size for the same airframe."""
    return [f"energy.capacity_wh={capacity_wh}"]


def at(track: "TrackColumns", mode: Mode) -> np.ndarray:
    return track["mode"] == MODES.index(mode)


def landings(result: MissionResult) -> list[float]:
    """The battery's charge whenever the UAV touched the ground."""
    landing, charge = at(result.track, Mode.LAND), result.track["battery"]
    ends = np.flatnonzero(landing & ~np.append(landing[1:], False))
    return [float(charge[end]) for end in ends]


@pytest.fixture(scope="module")
def in_parts() -> MissionResult:
    return Scene(LONG, altitude_m=10.0).fly("baseline", *battery(4.0))


def test_a_low_battery_goes_home_is_swapped_and_the_pass_goes_on_where_it_was(in_parts: MissionResult) -> None:
    whole = Scene(LONG, altitude_m=10.0).fly("baseline")
    row = in_parts.rows[0]
    assert whole.swaps == 0
    assert in_parts.swaps == row.swaps >= 2
    assert [action.action for action in in_parts.actions] == ["battery"] * in_parts.swaps
    assert row.surface_coverage >= 0.95
    assert row.inspected
    assert row.confirmed == whole.rows[0].confirmed == 55
    # Between alarm and return to the place nothing is inspected, and no more of the pass is flown twice than a look.
    inspecting = at(in_parts.track, Mode.INSPECT)
    along = in_parts.track["x_m"][inspecting]
    assert np.diff(along).min() > -0.5
    assert np.diff(along).max() < 2.0
    assert np.abs(in_parts.track["y_m"][inspecting]).max() < 1e-6


def test_it_is_swapped_on_the_ground_at_the_base_and_takes_its_time(in_parts: MissionResult) -> None:
    track, base = in_parts.track, in_parts.environment.world.base
    swapping = at(track, Mode.SWAP)
    assert (track["altitude_m"][swapping] == 0.0).all()
    assert np.hypot(track["x_m"] - base.x, track["y_m"] - base.y)[swapping].max() < 0.6
    assert swapping.sum() * 0.3 == pytest.approx(120.0 * in_parts.swaps, abs=0.7 * in_parts.swaps)
    assert (track["battery"][swapping] == 1.0).all()


def test_it_never_lands_with_less_than_the_reserve(in_parts: MissionResult) -> None:
    charges = landings(in_parts)
    assert len(charges) == in_parts.swaps + 1
    assert min(charges) >= 0.15
    assert min(charges[:-1]) < 0.3  # nor does it fly home long before it must


def zigzag() -> Scene:
    """Streets around fifteen corners: the way home is mostly turning."""
    corners = [(0.0, 0.0)]
    for step in range(8):
        x, y = corners[-1]
        corners += [(x, y + (20 if step % 2 == 0 else -20)), (x + 20, y + (20 if step % 2 == 0 else -20))]
    segments = [street(f"s{k}", a, b, width_m=5) for k, (a, b) in enumerate(pairwise(corners))]
    squares = [box(x - 2.5, y - 2.5, x + 2.5, y + 2.5) for x, y in corners]
    junctions = [Junction(f"j{k}", "priority", square) for k, square in enumerate(squares)]
    assert all(isinstance(square, Polygon) for square in squares)
    return Scene(world(segments, junctions=junctions, base=corners[0]), altitude_m=10.0)


@pytest.mark.parametrize("reserve", [0.05, 0.15, 0.4])
@pytest.mark.parametrize("wind_mps", [0.0, 6.0])
@pytest.mark.parametrize("wind_from_deg", [90, 200, 270])
def test_the_reserve_is_kept_around_corners_and_in_the_wind(
    reserve: float, wind_mps: float, wind_from_deg: float
) -> None:
    wind = [f"conditions.wind_mps={wind_mps}", f"conditions.wind_from_deg={wind_from_deg}"]
    wind.append(f"energy.reserve={reserve}")
    ours = zigzag().fly("baseline", *battery(7.0 if reserve < 0.1 else 8.0 if reserve < 0.3 else 12.0), *wind)
    assert ours.swaps >= 1
    assert min(landings(ours)) >= reserve
    assert min(row.surface_coverage for row in ours.rows) >= 0.95


@pytest.mark.parametrize(("yaw_rate_deg_s", "capacity_wh"), [(10, 15.0), (15, 11.5), (25, 7.8)])
def test_slow_turns_are_allowed_for(yaw_rate_deg_s: float, capacity_wh: float) -> None:
    """The corners take most of the way home's time."""
    ours = zigzag().fly("baseline", *battery(capacity_wh), f"uav.yaw_rate_deg_s={yaw_rate_deg_s}")
    assert ours.swaps >= 1
    assert min(landings(ours)) >= 0.15


@pytest.mark.parametrize("capacity_wh", [0.3, 1.0, 2.0, 3.0])  # 1.0: low just where the UAV comes to rest
def test_a_battery_too_small_for_the_mission_is_one_plain_error(capacity_wh: float) -> None:
    with pytest.raises(PaveTwinError, match="One battery is too small") as caught:
        Scene(LONG, altitude_m=10.0).fly("baseline", *battery(capacity_wh))
    assert "\n" not in str(caught.value)


def test_waiting_longer_than_a_battery_lasts_is_one_plain_error() -> None:
    with pytest.raises(PaveTwinError, match=r"policy\.max_wait_s"):
        SCENES["parked_car_over_defect"]().fly("hover", *battery(8.0))


def test_waiting_on_a_low_battery_goes_on_with_the_next() -> None:
    """The car stays longer than the battery lasts; the wait begins again with the next, and ends with the car."""
    scene = Scene(straight((30, 0), width_m=4.0), (parked(30, 0, until_s=300.0),))
    ours = scene.fly("hover", *battery(6.5))
    assert ours.swaps >= 1
    assert ours.rows[0].wait_s > 100.0
    assert ours.rows[0].confirmed == 1
    assert min(landings(ours)) >= 0.15


def test_a_low_battery_during_a_revisit_finishes_the_revisit() -> None:
    ours = SCENES["queue_at_light"]().fly("skip", *battery(3.5))
    whole = SCENES["queue_at_light"]().fly("skip")
    assert ours.swaps >= 1
    assert ours.rows[0].revisits == whole.rows[0].revisits
    modes = at(ours.track, Mode.REVISIT) & (ours.track["segment"] == 0)
    assert modes.sum() >= 0.9 * (at(whole.track, Mode.REVISIT) & (whole.track["segment"] == 0)).sum()


def test_each_alarm_is_heard_once_and_comes_when_just_the_way_home_is_left() -> None:
    scene = Scene(LONG, altitude_m=10.0)
    settings = scene.settings(*battery(4.6))
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0])
    alarms = []
    for event in mission:
        if isinstance(event, BatteryLow):
            state = mission.state()
            alarms.append((state.position[0], state.battery))
    assert len(alarms) == mission.swaps == 1
    (place, charge), *_ = alarms
    hovering_s = 38 * 60 * (4.6 * 0.8) / 77  # with what is usable of such batteries
    needed = settings.energy.reserve + (place / 10 + 10 / 3) * 0.9 / hovering_s
    assert needed < charge < needed + 0.25


def test_the_linear_battery_falls_by_one_1800th_a_second_in_the_air_and_not_on_the_ground() -> None:
    ours = Scene(LONG, altitude_m=10.0).fly("baseline", "energy.model=linear", "energy.endurance_s=100")
    track = ours.track
    assert ours.swaps >= 1
    flying = ~(at(track, Mode.SWAP) | at(track, Mode.GROUND))
    steady = flying[1:] & flying[:-1]
    falls, times = -np.diff(track["battery"])[steady], np.diff(track["t_s"])[steady]
    assert falls == pytest.approx(times / 100)
    swapping = at(track, Mode.SWAP)
    assert np.ptp(track["battery"][swapping]) == 0.0
    assert ours.energy == pytest.approx((ours.duration_s - 120.0 * ours.swaps) / 100, abs=1e-3)


def out_of_reach(*overrides: str, aircraft: str = "mavic3e") -> tuple[str, list[SegmentOutOfReach]]:
    """The error and the events of a mission to a street that lies 600 m east of the base."""
    far = world([street("far", (600, 0), (660, 0))], junctions=[Junction("way", "x", box(-5, -5, 600, 5))])
    scene = Scene(far, altitude_m=10.0)
    settings = scene.settings(f"aircraft={aircraft}", *overrides)
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0])
    with pytest.raises(PaveTwinError) as caught:
        mission.advance_until(np.inf)
    assert "\n" not in str(caught.value)
    return str(caught.value), [event for event in mission.events if isinstance(event, SegmentOutOfReach)]


def test_a_segment_out_of_reach_is_an_event_and_a_clear_line() -> None:
    reported, (event,) = out_of_reach("energy.capacity_wh=6")
    assert "One battery is too small to inspect 'far' and to come back; lower energy.reserve" in reported
    assert event.segment == 0


def test_a_head_wind_on_the_way_home_puts_a_segment_out_of_reach() -> None:
    """In calm the same batteries bring it there and back."""
    far = world([street("far", (600, 0), (660, 0))], junctions=[Junction("way", "x", box(-5, -5, 600, 5))])
    enough = "energy.capacity_wh=9.5"
    calm = Scene(far, altitude_m=10.0).fly("baseline", enough)
    assert (calm.swaps, min(landings(calm)) >= 0.15) == (0, True)
    reported, (event,) = out_of_reach(enough, "conditions.wind_mps=11", "conditions.wind_from_deg=270")
    assert "to come back in a wind of 11 m/s" in reported
    assert event.segment == 0


@pytest.mark.parametrize("wind_from_deg", [0, 90, 180, 270])
def test_the_reserve_is_kept_when_the_wind_slows_the_way_home(wind_from_deg: int) -> None:
    """At a top speed of 20 m/s the UAV makes 10.5 m/s against the wind, and 18 with it."""
    wind = ["conditions.wind_mps=9.5", f"conditions.wind_from_deg={wind_from_deg}", "aircraft=phantom4pro"]
    ours = Scene(LONG, altitude_m=10.0).fly("baseline", *battery(16.0), *wind, "uav.transit_speed_mps=18")
    assert min(landings(ours)) >= 0.15


@pytest.mark.parametrize("worse", ["energy.usable=0.6", "energy.health=0.7", "conditions.temperature_c=0"])
def test_weaker_batteries_make_for_more_of_them(worse: str) -> None:
    fresh, weak = (Scene(LONG, altitude_m=10.0).fly("baseline", *battery(6.0), *more) for more in ([], [worse]))
    assert weak.energy > fresh.energy
    assert weak.swaps > fresh.swaps
