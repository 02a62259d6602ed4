"""A dataset's camera from a file of the user's own: its content is part of the dataset, its place is not."""

from pathlib import Path

import pytest

from pavetwin.capture.context import check
from pavetwin.capture.images import write_yaml
from pavetwin.capture.settings import FILE, CaptureSettings, check_same, description
from pavetwin.errors import PaveTwinError
from pavetwin.mission.versions import software_versions
from pavetwin.uav import find_camera
from scenes import tiny

CAMERAS = """
wide: {title: Wide, image_px: [640, 480], vertical_fov_deg: 60}
far: {title: Far, image_px: [640, 480], vertical_fov_deg: 30}
"""


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with `mine/cameras.yaml` and an empty folder `elsewhere`."""
    for name in ("mine", "elsewhere"):
        (tmp_path / name).mkdir()
    (tmp_path / "mine" / "cameras.yaml").write_text(CAMERAS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def settings(camera: str, images: int = 2) -> CaptureSettings:
    chosen = CaptureSettings(platforms=("uav",), images=images, altitudes_m=(6.0,), camera=camera)
    check(chosen)
    return chosen


def is_begun(folder: Path, chosen: CaptureSettings) -> bool:
    return check_same(folder, description(chosen, tiny.straight(), software_versions(images=True, adapter="a card")))


@pytest.fixture
def dataset(place: Path) -> Path:
    """As `capture` leaves it, without its images."""
    folder = place / "dataset"
    (folder / "images").mkdir(parents=True)
    versions = software_versions(images=True, adapter="a card")
    write_yaml(folder / FILE, description(settings("mine/cameras.yaml:wide"), tiny.straight(), versions))
    return folder


def test_it_is_found_from_every_folder_that_works_on_the_dataset(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = settings("mine/cameras.yaml:wide")
    monkeypatch.chdir(place / "elsewhere")
    assert find_camera(chosen.camera).title == "Wide"


def test_a_dataset_is_extended_from_another_folder(dataset: Path, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_begun(dataset, settings("mine/cameras.yaml:wide", images=4))
    monkeypatch.chdir(place / "elsewhere")
    assert is_begun(dataset, settings("../mine/cameras.yaml:wide", images=4))


def test_another_content_or_camera_is_refused(dataset: Path, place: Path) -> None:
    for camera, words in (
        ("mine/cameras.yaml:far", "with `camera` cameras.yaml:wide, not with `camera` cameras.yaml:far"),
        ("paper", "paper"),
    ):
        with pytest.raises(PaveTwinError, match=words):
            is_begun(dataset, settings(camera, images=4))
    (place / "mine" / "cameras.yaml").write_text(CAMERAS.replace("60", "30"))
    with pytest.raises(PaveTwinError, match=r"begun with another `camera` than '.*cameras\.yaml:wide' holds now"):
        is_begun(dataset, settings("mine/cameras.yaml:wide", images=4))
