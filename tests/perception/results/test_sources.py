"""Which pictures of a folder are looked at."""

from pathlib import Path

from pavetwin.perception.detect_folder import detect_source
from pavetwin.perception.detector import Detector
from pavetwin.perception.images import source_images
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
    told: list[tuple[float, str]] = []
    detect_source(
        Detector(FILE, tiled=True),
        tmp_path,
        tmp_path / "found",
        pictures=False,
        tell=lambda share, words: told.append((share, words)),
    )
    assert [share for share, words in told if words == "Detecting in image 1"] == [0.0, 0.0]
    second = [share for share, words in told if words == "Detecting in image 2"]
    assert second[0] == 0.5
    assert second == sorted(second)
    assert 0.5 < second[-1] < 1.0
