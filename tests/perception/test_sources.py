"""Which pictures of a folder are looked at."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.perception import images as pictures
from pavetwin.perception.detect_folder import detect_source
from pavetwin.perception.detector import Detector
from pavetwin.perception.images import opened, pixels_of, source_images
from scenes.drawn_detector import FILE, drawn


def test_annotated_pictures_are_no_photographs(tmp_path: Path) -> None:
    drawn((96, 96), ("pothole", (30, 10, 60, 90))).save(tmp_path / "a.png")
    (tmp_path / "pictures").mkdir()
    drawn((96, 96)).save(tmp_path / "pictures" / "b.png")
    assert [each.name for each in source_images(tmp_path)] == ["a.png", "pictures/b.png"], "a folder of that name"
    detect_source(Detector(FILE), tmp_path, tmp_path / "found")
    assert list(tmp_path.glob("found/pictures/**/*.jpg"))
    assert [each.name for each in source_images(tmp_path)] == ["a.png", "pictures/b.png"]


def test_progress_is_told_for_each_image_and_within_a_large_one(tmp_path: Path) -> None:
    drawn((96, 96)).save(tmp_path / "a.png")
    drawn((500, 96), ("pothole", (30, 10, 60, 90))).save(tmp_path / "b.png")
    reported: list[tuple[float, str]] = []
    detect_source(
        Detector(FILE, tiled=True),
        tmp_path,
        tmp_path / "found",
        pictures=False,
        report=lambda share, message: reported.append((share, message)),
    )
    assert [share for share, words in reported if words == "Detecting in image 1"] == [0.0, 0.0]
    second = [share for share, words in reported if words == "Detecting in image 2"]
    assert second[0] == 0.5
    assert second == sorted(second)
    assert 0.5 < second[-1] < 1.0


@pytest.fixture(scope="module")
def orthophoto(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of 200 million pixels, more than Pillow takes unless reported otherwise."""
    file = tmp_path_factory.mktemp("pictures") / "orthophoto.png"
    Image.new("1", (20_000, 10_000)).save(file)
    return file


def test_an_orthophoto_is_opened_without_a_warning_and_pillow_s_limit_stays(orthophoto: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with opened(orthophoto) as held:
            assert held.size == (20_000, 10_000)
    with pytest.raises(Image.DecompressionBombError):
        Image.open(orthophoto)


def test_what_is_larger_still_is_refused_before_its_pixels_are_read(
    orthophoto: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pictures, "LARGEST_PX", 199_000_000)
    with pytest.raises(PaveTwinError, match=r"has 20000 × 10000 pixels; at most 199 million are read; split it\.$"):
        pixels_of(orthophoto)


@pytest.mark.parametrize("array", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)])
def test_an_array_that_is_no_picture_is_refused(array: np.ndarray) -> None:
    with pytest.raises(PaveTwinError, match="red, green, blue"):
        pixels_of(array)
