"""Versions that missions, studies and datasets name: installed packages, and what draws images."""

from collections.abc import Iterator
from pathlib import Path

import polars as pl
import pytest

from pavetwin.capture.context import check, packages_in_use
from pavetwin.capture.settings import FILE, CaptureSettings, check_same, description
from pavetwin.capture.store import write_yaml
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.planning import plan
from pavetwin.experiments.store import PARTS, Store
from pavetwin.experiments.units import Plan
from pavetwin.mission import fly_over
from pavetwin.mission.versions import software_versions, version_changes
from scenes import tiny
from scenes.packages import installed, release
from scenes.tiny import Scene, straight


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
