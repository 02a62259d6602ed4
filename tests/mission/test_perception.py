"""Missions and sensors: captures as events, the content of frames, and the count of detections."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from shapely import Point

from pavetwin.config import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.mission import MissionInputs
from pavetwin.mission.events import MissionEvent
from pavetwin.mission.fly import fly, fly_over
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import detections_table
from pavetwin.policies import load_policy
from pavetwin.sensing import SENSORS, Detections, Frame, Outcome, Sensor, check_sensor, sensor
from scenes.tiny import SCENES, Scene, straight


@pytest.fixture
def registered() -> Iterator[None]:
    """Takes away what a test registers."""
    before = set(SENSORS.names())
    yield
    for name in set(SENSORS.names()) - before:
        SENSORS.restore(name, None)


def fly_with(scene: Scene, kind: type[Sensor], *overrides: str, **how: object) -> MissionResult:
    sensor("trial")(kind)
    settings = scene.settings("sensing.sensor=trial", *overrides)
    return fly_over(scene.environment(settings), scene.traffic(), settings, [0], "baseline", **how)


@pytest.mark.usefixtures("registered")
def test_a_sensor_may_see_every_capture() -> None:
    numbers: list[int] = []

    class Watching(Sensor):
        every_capture = True

        def detect(self, frame: Frame) -> Detections:
            numbers.append(frame.number)
            return Detections()

    result = fly_with(Scene(straight((30, 0))), Watching)
    assert numbers == list(range(len(result.captures["t_s"])))
    assert result.rows[0].confirmed == 0


@pytest.mark.usefixtures("registered")
def test_a_frame_carries_pose_camera_light_and_motion() -> None:
    frames: list[Frame] = []

    class Watching(Sensor):
        every_capture = True

        def detect(self, frame: Frame) -> Detections:
            frames.append(frame)
            return Detections()

    scene = Scene(straight((30, 0)), altitude_m=10.0)
    dusk = ("conditions.date=2026-11-02", "conditions.time=16:30", "conditions.clouds=0.7", "conditions.wind_mps=2")
    result = fly_with(scene, Watching, *dusk)
    captures = result.captures
    assert [frame.time_s for frame in frames] == captures["t_s"].tolist()
    assert np.array([frame.position for frame in frames]) == pytest.approx(
        np.column_stack([captures["x_m"], captures["y_m"]])
    )
    assert {frame.altitude_m for frame in frames} == {10.0}
    fastest = max(frames, key=lambda frame: np.hypot(*frame.velocity_mps))
    assert np.hypot(*fastest.velocity_mps) == pytest.approx(5.0)
    assert np.arctan2(*fastest.velocity_mps[::-1]) == pytest.approx(fastest.yaw_rad)
    assert frames[0].camera.image_px == (1270, 950)
    assert frames[0].conditions == scene.settings(*dusk).conditions != Conditions()
    seen = [frame for frame in frames if frame.sightings]
    assert seen
    assert all(frame.footprint.contains(frame.sightings[0].defect.centre) for frame in seen)


@pytest.mark.usefixtures("registered")
def test_hits_duplicates_false_alarms_and_what_is_ignored_are_counted_apart() -> None:
    """In every capture: each sighted defect twice, a pothole in the middle of nowhere, and a car."""

    class Eager(Sensor):
        every_capture = True

        def detect(self, frame: Frame) -> Detections:
            sighted = Detections.of_defects([sighting.defect for sighting in frame.sightings] * 2, 0.9)
            ghost = Detections(["pothole"], 0.4, footprint=[Point(frame.position[0], 2.9).buffer(0.1)])
            car = Detections(["car"], 0.8, footprint=[Point(frame.position).buffer(2.0)])
            return Detections.concatenated([sighted, ghost, car])

    result = fly_with(Scene(straight((30, 0), (40, 0))), Eager)
    row, captures = result.rows[0], len(result.captures["t_s"])
    assert row.confirmed == 2
    assert row.duplicates == 2  # once confirmed, a defect is sighted no more
    assert row.false_alarms == captures
    assert row.precision == pytest.approx(4 / (4 + captures))
    assert row.false_alarms_per_100_m2 == pytest.approx(100 * captures / (row.surface_coverage * row.area_m2))
    outcomes = result.detections.outcome.tolist()
    assert outcomes.count(Outcome.IGNORED) == captures
    assert result.confirmed.defect.tolist() == [0, 1]
    assert all(footprint is not None for footprint in result.detections.footprint)


@pytest.mark.usefixtures("registered")
def test_a_detection_of_a_defect_outside_the_window_is_neither_right_nor_wrong() -> None:
    """The sensor knows where defect 0 is and reports it from afar, in every capture."""

    class Farsighted(Sensor):
        every_capture = True

        def detect(self, frame: Frame) -> Detections:
            place = Point(30, 0).buffer(0.2, cap_style="square")
            return Detections(["pothole"], 0.9, footprint=[place]) if frame.footprint.contains(place) else Detections()

    scene = Scene(straight((30, 0)), altitude_m=15.0)
    result = fly_with(scene, Farsighted)
    outcomes = result.detections.outcome.tolist()
    assert outcomes[0] is Outcome.IGNORED
    assert outcomes.count(Outcome.CONFIRMED) == 1
    assert Outcome.FALSE_ALARM not in outcomes
    assert result.rows[0].precision == 1.0


@pytest.mark.usefixtures("registered")
def test_a_second_detection_of_a_defect_is_a_duplicate_only_once_the_defect_is_confirmed() -> None:
    """Defect 0 is reported twice in every capture that shows it, the more certain detection last."""

    class Twice(Sensor):
        every_capture = True

        def detect(self, frame: Frame) -> Detections:
            place = Point(30, 0).buffer(0.2, cap_style="square")
            if not frame.footprint.contains(place):
                return Detections()
            return Detections(["pothole", "pothole"], [0.5, 0.9], footprint=[place, place])

    result = fly_with(Scene(straight((30, 0)), altitude_m=15.0), Twice)
    outcomes = result.detections.outcome.tolist()
    found = outcomes.index(Outcome.CONFIRMED)
    assert found > 2
    assert set(outcomes[: found - 1]) == {Outcome.IGNORED}
    assert set(outcomes[found - 1 : found] + outcomes[found + 1 :]) == {Outcome.DUPLICATE}
    assert result.rows[0].duplicates == len(outcomes) - found


@pytest.mark.usefixtures("registered")
def test_an_image_is_taken_only_when_it_is_asked_for() -> None:
    taken: list[int] = []

    class Looking(Sensor):
        every_capture = True

        def detect(self, frame: Frame) -> Detections:
            return Detections.of_defects(sighting.defect for sighting in frame.sightings if frame.image().mean() == 7)

    def source(frame: Frame) -> np.ndarray:
        taken.append(frame.number)
        return np.full((950, 1270, 3), 7, dtype=np.uint8)

    scene = Scene(straight((30, 0)))
    result = fly_with(scene, Looking, image_source=source)
    assert result.rows[0].confirmed == 1
    assert len(taken) == 1 < len(result.captures["t_s"])
    settings = scene.settings("sensing.sensor=trial")
    with pytest.raises(PaveTwinError, match="image_source"):
        fly_over(scene.environment(settings), scene.traffic(), settings, [0], "baseline")


@pytest.mark.usefixtures("registered")
def test_a_sensor_that_fails_in_flight_is_named_with_its_line() -> None:
    class Brittle(Sensor):
        def detect(self, frame: Frame) -> Detections:
            return [{}[frame.number]]

    with pytest.raises(PaveTwinError, match=r"The sensor 'trial' failed .* KeyError: \d+ \(test_perception.py"):
        fly_with(Scene(straight((30, 0))), Brittle)


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize("policy", ["hover", "skip"])
@pytest.mark.parametrize("attempts", ["every_capture", "first_capture"])
@pytest.mark.parametrize(("every", "again"), [(False, False), (True, False), (True, True)])
def test_a_sensor_after_landing_gives_the_result_of_one_in_flight(
    every: bool, again: bool, attempts: str, policy: str
) -> None:
    class Aboard(Sensor):
        every_capture, sees_confirmed = every, again

        def detect(self, frame: Frame) -> Detections:
            seen = Detections.of_defects(s.defect for s in frame.sightings if (s.defect.id + s.attempt) % 3)
            ghost = Detections(["pothole"], 0.4, footprint=[frame.footprint.centroid.buffer(0.1)])
            return Detections.concatenated([seen, ghost]) if frame.number % 17 == 3 else seen

    class Landed(Aboard):
        after_landing = True

    scene = SCENES["queue_that_leaves"]()
    settings = scene.settings(f"sensing.attempts={attempts}")
    observed: list[MissionEvent] = []
    environment, traffic = scene.environment(settings), scene.traffic()
    ours = fly_over(environment, traffic, settings, [0], policy, sensor=Aboard(settings.sensing, 0))
    other = fly_over(
        environment, traffic, settings, [0], policy, sensor=Landed(settings.sensing, 0), observer=observed.append
    )
    for name in ("rows", "memory", "events", "sighted", "detections", "inspected_defects"):
        assert getattr(ours, name) == getattr(other, name), name
    assert Counter(map(repr, observed)) == Counter(map(repr, ours.events))


class Naming(Sensor):
    """Reports every sighting under a name of its own."""

    called = "Pothole"

    @classmethod
    def calling(cls, called: str, *others: str) -> type["Naming"]:
        return type("Calling", (cls,), {"called": called, "other_classes": frozenset(others)})

    def detect(self, frame: Frame) -> Detections:
        outlines = [sighting.defect.polygon for sighting in frame.sightings]
        return Detections([self.called] * len(outlines), 0.9, footprint=outlines)


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize(
    ("called", "near"),
    [
        ("Pothole", "pothole"),
        ("POTHOLE", "pothole"),
        ("Single Crack", "single_crack"),
        ("crocodile", "crocodile_crack"),
    ],
)
def test_a_misspelt_class_is_an_error_that_names_sensor_class_and_the_nearest(called: str, near: str) -> None:
    with pytest.raises(PaveTwinError) as caught:
        fly_with(Scene(straight((30, 0))), Naming.calling(called))
    reported = str(caught.value)
    assert (
        f"sensor 'trial' reports the class '{called}', which is not a class of defects (did you mean '{near}'?)"
        in reported
    )
    assert "known are crocodile_crack, pothole, single_crack" in reported
    assert "`other_classes`" in reported


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize(
    ("called", "others"), [("person", ()), ("car", ()), ("manhole", ("manhole",)), ("Pothole", ("Pothole",))]
)
def test_a_class_that_is_no_defect_is_ignored(called: str, others: tuple[str, ...]) -> None:
    kind = Naming.calling(called, *others)
    result = fly_with(Scene(straight((30, 0))), kind)
    assert set(result.detections.outcome) == {Outcome.IGNORED}
    assert (result.rows[0].confirmed, result.rows[0].false_alarms) == (0, 0)
    assert check_sensor(kind) == []


@pytest.mark.usefixtures("registered")
def test_a_class_that_only_the_worlds_own_defects_have_is_known() -> None:
    scene = Scene(straight((30, 0)))
    defects = tuple(replace(defect, kind="frost_heave") for defect in scene.world.defects)
    result = fly_with(replace(scene, world=replace(scene.world, defects=defects)), Naming.calling("frost_heave"))
    assert result.rows[0].confirmed == 1


@pytest.mark.usefixtures("registered")
def test_where_a_false_alarm_is_stands_in_the_table_of_detections() -> None:
    class Inventive(Sensor):
        every_capture = True

        def detect(self, frame: Frame) -> Detections:
            found = Detections.of_defects(sighting.defect for sighting in frame.sightings)
            ghost = Detections(["pothole"], 0.4, footprint=[Point(10.0, 2.9).buffer(0.1)])
            return Detections.concatenated([found, ghost]) if frame.number == 3 else found

    result = fly_with(Scene(straight((30, 0))), Inventive)
    table = detections_table(result)
    assert table["outcome"].to_list().count("false_alarm") == result.rows[0].false_alarms == 1
    (ghost,) = table.filter(outcome="false_alarm").iter_rows(named=True)
    assert (ghost["class"], ghost["confidence"], ghost["defect"], ghost["capture"]) == ("pothole", 0.4, None, 3)
    place = result.environment.world.georeference.to_wgs84((10.0, 2.9))
    assert (ghost["longitude"], ghost["latitude"]) == pytest.approx(tuple(place), abs=1e-9)


def test_a_policy_handed_in_as_a_value_is_not_named_as_a_registered_one() -> None:
    """Otherwise another mission would be repeated in its place."""
    scene = SCENES["empty_street"]()
    settings = scene.settings()
    hover = load_policy("hover", settings.policy)
    result = fly_over(scene.environment(settings), scene.traffic(), settings, [0], hover)
    assert result.policy == "hover"
    with pytest.raises(PaveTwinError, match="handed in as a value"):
        fly(result.spec, inputs=MissionInputs(scene.environment(settings), scene.traffic()))
    high = scene.settings("altitude_m=12")
    with pytest.raises(PaveTwinError, match="was made for 12 m"):
        fly(result.spec, inputs=MissionInputs(scene.environment(high), scene.traffic()), policy=hover)


@pytest.mark.parametrize("scene", ["lively_street", "queue_that_leaves"])
def test_the_abstract_sensors_raise_no_false_alarm(scene: str) -> None:
    for name in ("ideal", "recall"):
        row = SCENES[scene]().fly("hover", f"sensing.sensor={name}").rows[0]
        assert (row.duplicates, row.false_alarms, row.precision, row.false_alarms_per_100_m2) == (0, 0, 1.0, 0.0)
