"""A spec made from values is honest: it holds or hashes them, and other inputs than those it names are refused."""

from pathlib import Path

import numpy as np
import pytest
from shapely import box

from pavetwin.errors import PaveTwinError
from pavetwin.mission import fly_over
from pavetwin.mission.airspace import Aircraft
from pavetwin.mission.fly import fly
from pavetwin.mission.inputs import MissionInputs, aircraft_of
from pavetwin.mission.replay import Replay
from pavetwin.mission.spec import AircraftTrack, MissionSpec
from pavetwin.perception.shipped import DEFAULT
from pavetwin.sensing.detector import DetectorSensor
from scenes.recordings import recording
from scenes.spots import fly_over_spots
from scenes.tiny import Scene, straight

EMPTY = recording(("van",), lambda *_: (20.0, 40.0, 0.0, 0.0), frames=1200)
OTHER = Aircraft("other", np.array([0.0, 60.0]), np.array([[0.0, 50.0], [40.0, 50.0]]), 10.0)


def flown(aircraft: tuple[Aircraft, ...]) -> tuple[MissionSpec, MissionInputs]:
    scene = Scene(straight(), altitude_m=10.0)
    settings = scene.settings()
    environment, replay = scene.environment(settings), Replay(scene.world, EMPTY, aircraft=aircraft)
    return fly_over(environment, replay, settings, [0], "baseline").spec, MissionInputs(environment, replay)


def test_aircraft_given_as_values_are_in_the_spec() -> None:
    spec, inputs = flown((OTHER,))
    assert spec.aircraft == (AircraftTrack.of(OTHER),)
    assert MissionSpec.parse(spec.as_values(), where="it") == spec
    (track,) = aircraft_of(MissionSpec.parse(spec.as_values(), where="it"))
    assert (track.name, track.altitude_m) == ("other", 10.0)
    np.testing.assert_array_equal(track.t_s, OTHER.t_s)
    np.testing.assert_array_equal(track.xy_m, OTHER.xy_m)
    assert fly(spec, inputs=inputs).spec == spec
    assert flown(())[0].aircraft is None


@pytest.mark.parametrize("what", ["world", "defects", "traffic", "aircraft"])
def test_inputs_that_the_spec_does_not_name_are_refused(what: str) -> None:
    spec, inputs = flown((OTHER,))
    changes = {
        "world": {"world": spec.world.model_copy(update={"content_hash": "another"})},
        "defects": {"defects": spec.defects.model_copy(update={"content_hash": "another"})},
        "traffic": {"traffic": spec.traffic.model_copy(update={"take_off_s": 5.0})},
        "aircraft": {"aircraft": None},
    }
    with pytest.raises(PaveTwinError, match=f"`inputs`: the {what} differs"):
        fly(spec.model_copy(update=changes[what]), inputs=inputs)


def test_the_renderers_version_is_named_where_images_were_taken(tmp_path: Path) -> None:
    sensor = tmp_path / "looking.py"
    sensor.write_text(
        "from pavetwin.sensing import Ideal\n"
        "class Looking(Ideal):\n"
        "    every_capture = True\n"
        "    def detect(self, frame):\n"
        "        if frame.source is not None:\n"
        "            frame.image()\n"
        "        return super().detect(frame)\n"
    )
    scene = Scene(straight(), altitude_m=10.0)
    for name, named in ((f"{sensor}:Looking", True), ("ideal", False)):
        settings = scene.settings(f"sensing.sensor={name}")
        result = fly_over(
            scene.environment(settings),
            scene.traffic(),
            settings,
            [0],
            "baseline",
            image_source=lambda frame: np.zeros((*frame.camera.image_px[::-1], 3), dtype=np.uint8),
        )
        assert ("wgpu" in result.spec.versions) is named


def test_a_spec_names_the_model_that_its_sensor_has_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a mission stays one of the detector that looked, when another one becomes the default."""
    wall = box(30, 0, 31, 1)
    result, _ = fly_over_spots(Scene(straight((30, 0))), [("Pothole", wall)], aboard=False)
    assert result.spec.settings.sensing.options == {"aboard": False, "model": DetectorSensor.default_options["model"]}
    assert result.spec.with_policy("baseline", result.settings).settings.sensing.options["model"] == DEFAULT
    scene = Scene(straight(), altitude_m=10.0)
    for sensor, options in (("calibrated", {"fitted": DEFAULT}), ("recall", {})):
        settings = scene.settings(f"sensing.sensor={sensor}")
        assert settings.sensing.options == {}
        spec = fly_over(scene.environment(settings), scene.traffic(), settings, [0], "baseline").spec
        assert spec.settings.sensing.options == options
    other = {**DetectorSensor.default_options, "model": "photographs"}
    monkeypatch.setattr(DetectorSensor, "default_options", other)
    read = MissionSpec.parse(result.spec.as_values(), where="it")
    assert read == result.spec
