"""The specification of a mission: its inputs, the models of its sensor, and the recorded versions of software."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from shapely import box

from pavetwin.capture.context import check, packages_in_use
from pavetwin.capture.formats import FORMATS
from pavetwin.capture.images import write_yaml
from pavetwin.capture.settings import FILE, CaptureSettings, check_same, description
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.planning import plan
from pavetwin.experiments.store import PARTS, Store
from pavetwin.experiments.units import Plan
from pavetwin.mission import fly_over, versions
from pavetwin.mission.airspace import Aircraft
from pavetwin.mission.fly import fly
from pavetwin.mission.inputs import MissionInputs, aircraft_of
from pavetwin.mission.replay import Replay
from pavetwin.mission.spec import AircraftTrack, MissionSpec
from pavetwin.mission.versions import software_versions, version_changes
from pavetwin.perception.model_file import DEFAULT
from pavetwin.policies import POLICIES
from pavetwin.sensing.detector import DetectorSensor
from scenes import tiny
from scenes.recordings import recording
from scenes.spots import fly_over_spots
from scenes.tiny import Scene, straight

MODULE = """
from pavetwin.capture.formats import Format
from pavetwin.policies import GoOn, Policy

class Lazy(Policy):
    def decide(self, snapshot):
        return GoOn()

class Bare(Format):
    pass
"""


def release(folder: Path, version: str) -> None:
    """Install a version of the package in place of the one that is there."""
    (folder / "lazy_things.py").write_text(MODULE)
    info = folder / "lazy_things.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: lazy-things\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(
        "[pavetwin.policies]\nlazy = lazy_things:Lazy\n[pavetwin.formats]\nbare = lazy_things:Bare\n"
    )
    versions._version.cache_clear()


@contextmanager
def installed(folder: Path) -> Iterator[None]:
    """Version 1.0 of the package is there, and nothing of it was asked for yet."""
    with pytest.MonkeyPatch.context() as patch:
        for registry in (POLICIES, FORMATS):
            registry.names()  # before the package is there: its entry points must not stay
        release(folder, "1.0")
        patch.syspath_prepend(str(folder))
        for registry in (POLICIES, FORMATS):
            patch.setattr(registry, "_entries", dict(registry._entries))
            patch.setattr(registry, "_has_installed", False)
        yield
    versions._version.cache_clear()


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
    result, _ = fly_over_spots(Scene(straight((30, 0))), [("pothole", wall)], aboard=False)
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


@pytest.fixture
def packages(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "site").mkdir()
    with installed(tmp_path / "site"):
        yield tmp_path / "site"


def study(policy: str) -> Plan:
    values = {"worlds": ["town"], "policies": [policy], "altitudes_m": [10], "densities": ["low"], "replicates": 1}
    return plan(Design.parse(values, where="the design"), [tiny.straight()])


def test_a_mission_names_the_package_of_its_policy_and_what_version_it_has_now(packages: Path) -> None:
    scene = Scene(straight(), altitude_m=10.0)
    settings = scene.settings()
    environment, traffic = scene.environment(settings), scene.traffic()
    spec = fly_over(environment, traffic, settings, [0], "lazy").spec
    assert spec.versions["lazy-things"] == "1.0"
    assert "lazy-things" not in spec.with_policy("hover").versions
    assert version_changes(spec.versions) == []
    release(packages, "2.0")
    assert version_changes(spec.versions) == ["lazy-things 1.0 (now 2.0)"]


def test_a_study_is_not_resumed_with_another_version_of_a_package_or_library(
    packages: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, store = study("lazy"), Store(tmp_path / "study")
    store.begin(made)
    store.check(made)
    assert store.description()["versions"]["lazy-things"] == "1.0"
    release(packages, "2.0")
    with pytest.raises(PaveTwinError, match=r"begun with lazy-things 1\.0 \(now 2\.0\); choose another folder"):
        store.check(made)
    release(packages, "1.0")
    monkeypatch.setattr("pavetwin.mission.versions._version", lambda name: {"numpy": "0.9"}.get(name, "1.0"))
    with pytest.raises(PaveTwinError, match=r"numpy \S+ \(now 0\.9\)"):
        store.check(made)


def test_a_study_with_images_is_not_resumed_with_what_draws_others(tmp_path: Path) -> None:
    made, store = study("baseline"), Store(tmp_path / "study")
    store.begin(made)
    (tmp_path / "study" / PARTS).mkdir()
    part = tmp_path / "study" / PARTS / f"{made.units[0].name}.parquet"
    now = software_versions(images=True)
    ours = f"wgpu {now['wgpu']}, {now['adapter']}"
    for renderer in (None, ours):
        pl.DataFrame({"renderer": [None, renderer]}, schema={"renderer": pl.String}).write_parquet(part)
        store.check(made)
    pl.DataFrame({"renderer": [None, "wgpu 0.1, a card"]}).write_parquet(part)
    with pytest.raises(PaveTwinError, match=r"begun with wgpu 0\.1, a card \(now wgpu "):
        store.check(made)


def test_a_dataset_is_not_resumed_with_another_version_of_a_package(packages: Path, tmp_path: Path) -> None:
    settings = CaptureSettings(platforms=("uav",), images=2, altitudes_m=(6.0,), formats=("bare",))
    world = tiny.straight()
    check(settings)

    def described() -> dict[str, object]:
        versions = software_versions(images=True, adapter="a card", packages=packages_in_use(settings, world))
        return description(settings, world, versions)

    folder = tmp_path / "dataset"
    folder.mkdir()
    write_yaml(folder / FILE, described())
    (folder / "images").mkdir()
    assert check_same(folder, described())
    release(packages, "2.0")
    with pytest.raises(PaveTwinError, match=r"begun with lazy-things 1\.0 \(now 2\.0\), whose pictures may differ"):
        check_same(folder, described())
