"""Behaviour of each policy in tiny named scenes with a known answer."""

from collections.abc import Callable
from math import dist
from typing import TYPE_CHECKING

import numpy as np
import pytest

from pavetwin._core import Captured, Occluded, Trace
from pavetwin.config import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.fly import fly_over
from pavetwin.mission.mission import Mission
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import MODES
from pavetwin.policies import Displace, Revisit, load_policy, policy_names
from pavetwin.sensing import Detections
from pavetwin.twin import Mode, Note, Snapshot
from scenes.tiny import SCENES, Scene, TinyTraffic, car_that_leaves, queue_at_light, result

if TYPE_CHECKING:
    from pavetwin._core import TrackColumns

POLICIES = policy_names()
SHORT_WAIT = "policy.max_wait_s=20"


def in_mode(track: "TrackColumns", mode: Mode) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return track["mode"] == MODES.index(mode)


def places(track: "TrackColumns") -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.stack([track["x_m"], track["y_m"]], axis=1)


def flown_with(
    scene: Scene, policy: str, settings: MissionSettings, reported: Callable[[Mission, Snapshot], None]
) -> Mission:
    """A mission flown event by event; `reported` receives every snapshot that the policy is asked about."""
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0], policy=policy)
    decides = load_policy(policy, settings.policy)
    for event in mission:
        match event:
            case Captured():
                mission.confirm(Detections.of_defects(sighting.defect for sighting in mission.frame(event).sightings))
            case Occluded():
                snapshot = mission.snapshot(event)
                reported(mission, snapshot)
                mission.act(decides.decide(snapshot))
    return mission


# Every scene is worth its name: without traffic everything is found, and with it the baseline misses something.


@pytest.mark.parametrize("policy", POLICIES)
def test_in_an_empty_street_every_policy_flies_the_same_and_finds_everything(policy: str) -> None:
    ours, baseline = result("empty_street", policy), result("empty_street", "baseline")
    for column in ours.track:
        assert np.array_equal(ours.track[column], baseline.track[column], equal_nan=True)
    assert ours.rows[0].coverage == 1.0
    assert ours.rows[0].surface_coverage == 1.0
    assert ours.rows[0].occlusions == 0
    assert not ours.actions


@pytest.mark.parametrize(
    "scene", ["parked_car_over_defect", "car_that_leaves", "truck_beside_defects", "queue_at_light"]
)
def test_the_baseline_misses_what_is_hidden(scene: str) -> None:
    row = result(scene, "baseline").rows[0]
    assert row.occlusions >= 1
    assert row.confirmed == 0
    assert row.swept == row.defects > 0
    assert row.surface_coverage < 1.0


@pytest.mark.parametrize("scene", SCENES)
def test_the_baseline_never_reacts(scene: str) -> None:
    """Its track is that of the empty street, bit for bit."""
    ours, empty = result(scene, "baseline"), SCENES[scene]().emptied().fly("baseline")
    for column in set(ours.track) - {"visibility"}:
        assert np.array_equal(ours.track[column], empty.track[column])  # type: ignore[literal-required]
    assert not ours.actions
    assert ours.rows[0].wait_s == 0.0
    assert ours.duration_s == empty.duration_s


# Hover.


def test_hover_waits_and_goes_on_after_max_wait() -> None:
    ours = result("parked_car_over_defect", "hover", SHORT_WAIT)
    row = ours.rows[0]
    assert row.wait_s == pytest.approx(20.0, abs=0.051)
    assert row.confirmed == 0
    waits = [place for place in ours.actions if place.action == "wait"]
    assert len(waits) == 10  # two seconds each
    assert np.diff([wait.time_s for wait in waits]) == pytest.approx(2.0, abs=0.051)
    # It stands where braking from 5 m/s ended, 1.56 m after the first decision.
    assert all(wait.position == pytest.approx(waits[1].position) for wait in waits[1:])
    assert waits[1].position[0] - waits[0].position[0] == pytest.approx(25 / 16, abs=0.3)
    # Then it flies the whole street.
    assert ours.duration_s == pytest.approx(result("parked_car_over_defect", "baseline").duration_s + 20, abs=2)
    assert places(ours.track)[in_mode(ours.track, Mode.INSPECT), 0].max() == pytest.approx(59.0, abs=0.6)


def test_hover_confirms_a_defect_once_the_car_has_left() -> None:
    ours = result("car_that_leaves", "hover")
    assert ours.rows[0].confirmed == 1
    assert ours.rows[0].recovered == 0
    assert ours.detections.time_s[0] > 40.0
    assert not ours.detections.on_revisit[0]
    # From when it came to the car until the first look after it had left.
    first = ours.actions[0].time_s
    assert ours.rows[0].wait_s == pytest.approx(40.0 - first, abs=2.05)


def test_hover_waits_max_wait_in_a_row_and_not_for_every_car_of_a_queue() -> None:
    """Visibility never comes back between the cars, so the whole queue is one episode."""
    row = result("queue_at_light", "hover", SHORT_WAIT).rows[0]
    assert row.wait_s == pytest.approx(20.0, abs=0.051)
    assert row.occlusions == 1


def test_hover_sees_all_of_a_queue_that_leaves() -> None:
    assert result("queue_that_leaves", "hover").rows[0].confirmed == 7
    assert result("queue_that_leaves", "baseline").rows[0].confirmed == 0


# Micro.


def test_micro_finds_the_side_from_which_the_defects_are_seen() -> None:
    ours, baseline = result("truck_beside_defects", "micro"), result("truck_beside_defects", "baseline")
    assert ours.rows[0].confirmed >= 3
    assert baseline.rows[0].confirmed == 0
    assert ours.rows[0].wait_s == 0.0


@pytest.mark.parametrize("most_m", [3.0, 1.2])
@pytest.mark.parametrize("scene", ["truck_beside_defects", "queue_at_light"])
def test_micro_moves_aside_at_most_d_max_and_comes_back_to_its_route(scene: str, most_m: float) -> None:
    ours = result(scene, "micro", f"policy.max_displacement_m={most_m}", "visibility.interval_s=0.05")
    track, at = ours.track, places(ours.track)
    aside = in_mode(track, Mode.DISPLACE)
    assert aside.any()
    assert {action.action for action in ours.actions} == {"displace"}
    edges = np.flatnonzero(np.diff(aside.astype(int)))
    begins, ends = edges[::2], edges[1::2]
    assert len(begins) == len(ends) == len(ours.actions)
    for begin, end in zip(begins, ends, strict=True):
        braked = begin + int(np.argmax(track["speed_mps"][begin : end + 1] == 0.0))
        stretch = slice(braked, end + 1)
        rest = at[end]
        assert rest == pytest.approx(at[braked])  # back where braking ended
        assert rest[1] == pytest.approx(0.0)  # which is on the route, the x axis
        reach = np.hypot(*(at[stretch] - rest).T)
        assert 0.3 * most_m < reach.max() <= most_m + 1e-6
        assert np.ptp(np.unwrap(track["yaw_rad"][stretch])) < 1e-9  # without turning


def test_micro_takes_the_capture_that_it_moved_for() -> None:
    ours = result("truck_beside_defects", "micro")
    norths = np.array([frame.position[1] for frame in ours.log.frames.values()])
    off_route = norths[np.abs(norths) > 0.5]
    assert len(off_route)
    assert off_route == pytest.approx(3.0, abs=0.3)  # towards the side that the truck hid


def test_micro_does_not_move_where_nothing_is_gained() -> None:
    """A car over the whole width of a strip hides it from everywhere within a hand's breadth."""
    ours = result("parked_car_over_defect", "micro", "policy.max_displacement_m=0.05")
    assert not ours.actions


# Skip.


@pytest.mark.parametrize("leaves_at_s", [11.0, 14.0])
def test_skip_comes_back_and_recovers(leaves_at_s: float) -> None:
    scene = car_that_leaves(leaves_at_s)
    ours, baseline = scene.fly("skip"), scene.fly("baseline")
    row = ours.rows[0]
    assert baseline.rows[0].confirmed == 0
    assert (row.confirmed, row.recovered, row.revisits) == (1, 1, 1)
    assert row.recovery == row.coverage == row.swath_coverage == 1.0
    assert ours.detections.on_revisit[0]
    assert ours.memory.confirmed[0].on_revisit
    assert ours.memory.notes == ()


def test_skip_stays_five_seconds_over_each_place() -> None:
    ours = result("queue_at_light", "skip")
    captures = ours.captures
    times = captures["t_s"][captures["on_revisit"]]
    visits = np.split(times, np.flatnonzero(np.diff(times) > 0.7) + 1)
    assert len(visits) == ours.rows[0].revisits > 1
    for visit in visits:  # a capture at once and every 0.6 s of five seconds
        assert len(visit) == 9
        assert visit[-1] - visit[0] == pytest.approx(4.8)
    at = np.stack([captures["x_m"], captures["y_m"]], axis=1)[captures["on_revisit"]]
    along = [at[times == visit[0]][0][0] for visit in visits]
    assert all(np.ptp(at[np.isin(times, visit)], axis=0).max() < 1e-9 for visit in visits)
    assert along == sorted(along)  # in path order


def test_skip_stops_the_stopping_distance_before_the_place() -> None:
    scene, settings = queue_at_light(), queue_at_light().settings()
    notes: list[Note] = []
    mission = flown_with(scene, "skip", settings, lambda mission, _: notes.extend(mission.memory.notes))
    noted = sorted({note.place for note in notes})
    captures = mission.flight.captures()
    at = np.stack([captures["x_m"], captures["y_m"]], axis=1)[captures["on_revisit"]]
    for stay in at:
        assert min(dist(stay, place) for place in noted) <= settings.uav.stopping_distance_m + 0.05


@pytest.mark.parametrize(("spacing_m", "interval_s"), [(1.5, 2.0), (1.5, 0.0), (0.0, 1.0), (8.0, 0.0)])
def test_notes_keep_their_distance_in_space_and_time(spacing_m: float, interval_s: float) -> None:
    scene = queue_at_light()
    settings = scene.settings(f"policy.note_spacing_m={spacing_m}", f"policy.note_interval_s={interval_s}")
    seen: dict[Note, None] = {}
    asked: list[float] = []

    def listen(mission: Mission, snapshot: Snapshot) -> None:
        seen.update(dict.fromkeys(mission.memory.notes))
        asked.append(snapshot.time_s)

    flown_with(scene, "skip", settings, listen)
    notes = list(seen)
    assert len(notes) >= 3
    assert len(asked) > len(notes)
    assert min(np.diff([note.time_s for note in notes])) >= interval_s - 1e-9
    gaps = [dist(a.place, b.place) for k, a in enumerate(notes) for b in notes[:k]]
    assert min(gaps) >= spacing_m
    # And no longer: the limit that binds is nearly reached.
    loosest = min(min(gaps) - spacing_m, float(min(np.diff([note.time_s for note in notes]))) - interval_s)
    assert loosest < 1.6


# The twin does not disturb its world.


def test_nothing_in_the_traffic_changes_because_a_uav_flew() -> None:
    scene = SCENES["lively_street"]()
    settings = scene.settings(SHORT_WAIT)
    times = np.arange(0.0, 60.0, 0.35)
    traffic = scene.traffic()
    before = [traffic.trace().agents_at(time) for time in times]
    heard: dict[str, dict[float, object]] = {}
    for policy in POLICIES:
        mission = Mission(scene.environment(settings), traffic, settings, [0], policy=policy)
        decides = load_policy(policy, settings.policy)
        heard[policy] = {}
        for event in mission:
            if isinstance(event, Occluded):
                snapshot = mission.snapshot(event)
                heard[policy][snapshot.time_s] = snapshot.agents
                mission.act(decides.decide(snapshot))
    after = [traffic.trace().agents_at(time) for time in times]
    for was, now in zip(before, after, strict=True):
        assert all(np.array_equal(was[column], now[column]) for column in was)  # type: ignore[literal-required]
    first = min(heard["baseline"])
    assert all(min(answers) == first for answers in heard.values())
    for policy in POLICIES:
        for time in heard[policy].keys() & heard["baseline"].keys():
            assert heard[policy][time] == heard["baseline"][time]
    assert any(len(answers) > 3 for answers in heard.values())


@pytest.mark.parametrize("scene", ["lively_street", "queue_that_leaves"])
@pytest.mark.parametrize("policy", POLICIES)
def test_the_same_mission_twice_is_the_same(scene: str, policy: str) -> None:
    ours, again = result(scene, policy), SCENES[scene]().fly(policy)
    for columns in ("track", "captures"):
        for name, column in getattr(ours, columns).items():
            assert np.array_equal(column, getattr(again, columns)[name], equal_nan=column.dtype == np.float64)
    assert ours.rows == again.rows
    assert ours.detections == again.detections
    assert ours.actions == again.actions


def test_a_mission_that_outlasts_its_recording_goes_on_in_a_longer_one() -> None:
    scene = SCENES["car_that_leaves"]()
    settings = scene.settings()
    whole = scene.fly("hover")
    short = TinyTraffic(scene.movers, duration_s=7.0)
    pieced = _fly(scene, short, settings)
    assert len(short.extended) >= 3
    assert pieced.rows == whole.rows
    assert np.array_equal(pieced.track["x_m"], whole.track["x_m"])


def _fly(scene: Scene, traffic: TinyTraffic, settings: MissionSettings) -> MissionResult:
    return fly_over(scene.environment(settings), traffic, settings, [0], "hover")


def test_traffic_that_cannot_be_extended_is_one_plain_error() -> None:
    class Ended(TinyTraffic):
        def extend(self, needed_s: float) -> Trace:
            self.extended.append(needed_s)
            return self.trace()

    scene = SCENES["car_that_leaves"]()
    with pytest.raises(PaveTwinError, match=r"ends after 7 s"):
        _fly(scene, Ended(scene.movers, duration_s=7.0), scene.settings())


def test_another_recording_is_refused() -> None:
    class Swapped(TinyTraffic):
        def extend(self, needed_s: float) -> Trace:
            return TinyTraffic(SCENES["lively_street"]().movers, needed_s + 100).trace()

    scene = SCENES["car_that_leaves"]()
    with pytest.raises(PaveTwinError, match="does not begin with the present one"):
        _fly(scene, Swapped(scene.movers, duration_s=7.0), scene.settings())


def test_a_displacement_that_would_leave_the_domain_is_cut_short() -> None:
    scene = SCENES["truck_beside_defects"]()
    settings = scene.settings("visibility.interval_s=0.05")
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0])
    done = False
    for event in mission:
        if isinstance(event, Occluded) and not done:
            done = True
            mission.act(Displace(0.0, 50.0))
    at = places(mission.flight.track())
    # The corridor reaches 4 m beyond the street's 3.5 m, less the UAV's radius; 50 m are shared out in tenths.
    assert done
    assert 4.5 < at[:, 1].max() <= 7.0 + 0.25


def test_an_answer_that_is_no_action_is_one_plain_error() -> None:
    scene = SCENES["parked_car_over_defect"]()
    settings = scene.settings()
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0], policy="odd")
    with pytest.raises(PaveTwinError, match="The policy 'odd' answered 'left'"):
        mission.act("left")  # type: ignore[arg-type]


def test_a_place_that_cannot_be_reached_is_revisited_from_as_near_as_can_be() -> None:
    scene = SCENES["parked_car_over_defect"]()
    settings = scene.settings()
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0])
    noted = False
    for event in mission:
        if isinstance(event, Occluded) and not noted:
            noted = True
            mission.act(Revisit((30.0, 500.0)))
    captures = mission.flight.captures()
    on_revisit = captures["on_revisit"]
    assert on_revisit.any()
    north = captures["y_m"][on_revisit]
    assert captures["x_m"][on_revisit][0] == pytest.approx(30.0, abs=1.5)
    assert (north > 3.0).all()
