"""`pavetwin compare`: what stands in its table, which cells stay empty, and what it refuses."""

import csv
from pathlib import Path

import pytest

from pavetwin.perception.detector import Detector
from pavetwin.training.evaluation import comparison
from pavetwin.training.evaluation.labelled import read_split
from scenes.command_line import pavetwin, plain_refusal
from scenes.detections import CAR, POTHOLE, true, write_labels
from scenes.drawn_detector import FILE, SIDE_PX, drawn


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two images: a pothole and a car that the drawn detector finds, and a pothole that is not there."""
    folder = tmp_path_factory.mktemp("compare")
    objects = [[true(POTHOLE, (10, 8, 30, 40)), true(CAR, (60, 12, 30, 44))], [true(POTHOLE, (10, 8, 30, 40))]]
    write_labels(folder / "town", objects, facts=[{"width": SIDE_PX, "height": 64}] * 2)
    (folder / "town" / "images" / "test").mkdir(parents=True)
    street = drawn((SIDE_PX, 64), ("pothole", (10, 8, 40, 48)), ("car", (60, 12, 90, 56)))
    street.save(folder / "town" / "images" / "test" / "001.png")
    drawn((SIDE_PX, 64)).save(folder / "town" / "images" / "test" / "002.png")
    return folder


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_accuracy_stands_where_it_was_measured(place: Path) -> None:
    """Of two potholes and a car one pothole is missed: recall (0.5 + 1) / 2, and nothing false."""
    done = pavetwin("compare", f"drawn={FILE}", "--dataset", "town", "--frames", "1", "-o", "models.csv", cwd=place)
    assert done.returncode == 0, done.stderr
    (row,) = rows_of(place / "models.csv")
    assert (row["model"], row["precision"], row["recall"]) == ("drawn", "100.0", "75.0")
    assert 50 < float(row["mAP@0.5"]) < 100
    assert float(row["size, MB"]) == pytest.approx(FILE.stat().st_size / 1e6, abs=0.05)
    assert float(row["FPS"]) > 0


def test_speed_is_that_of_the_size_that_accuracy_is_of(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    timed: list[Detector] = []
    monkeypatch.setattr(comparison, "frames_per_s", lambda detector, _frames: timed.append(detector) or 1.0)
    judged: list[Detector] = []
    monkeypatch.setattr(comparison, "found_by", lambda detector, _splits: judged.append(detector) or iter(()))
    split = read_split(place / "town", "test")
    comparison.compared("drawn", FILE, split=split, frames=1, threads=1, count=None)
    assert [each.image_px for each in timed] == [each.image_px for each in judged] == [SIDE_PX]
    assert [each.tiled for each in timed] == [each.tiled for each in judged]


def test_a_cell_that_was_not_measured_is_empty(place: Path) -> None:
    done = pavetwin("compare", str(FILE), "--frames", "1", "-o", "bare.csv", cwd=place)
    assert done.returncode == 0, done.stderr
    (row,) = rows_of(place / "bare.csv")
    assert row["model"] == "rectangles"
    assert [row[name] for name in ("mAP@0.5", "mAP@0.5:0.95", "precision", "recall", "GFLOPs")] == [""] * 5
    assert done.stdout.splitlines()[0].split()[:2] == ["model", "mAP@0.5"]


def test_what_ships_is_compared_by_name(place: Path) -> None:
    done = pavetwin("compare", "rendered", "--frames", "1", "-o", "shipped.csv", cwd=place)
    assert done.returncode == 0, done.stderr
    (row,) = rows_of(place / "shipped.csv")
    assert (row["model"], row["size, MB"]) == ("rendered", "6.3")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ((), "Error: Name models to compare, or --sizes of untrained networks"),
        (("--ultralytics", "yolo11x"), "Error: --ultralytics: no network 'yolo11x' (did you mean"),
        (("--ultralytics", "yolo11n"), "Error: Ultralytics is not installed. It is not part of PaveTwin"),
        (("--weights", "a=gone.pt"), "Error: --weights: there is no file 'gone.pt'."),
        (("--sizes", "n,x"), "Error: --sizes: no size 'x'; known are n, s, m, l."),
        (("--sizes", "n"), "Error: Untrained networks need PyTorch, an extra; install it with `pip install"),
        (("nosuch.onnx",), "Error: There is no"),
        ((str(FILE), "--threads", "999"), "Error: --threads 999: this machine has"),
        ((str(FILE), "-o", "."), "Error: --output: '.' is a folder; name a file in it."),
        ((str(FILE), "-o", f"{FILE}/a.csv"), f"Error: --output: '{FILE}' is a file, so that nothing can be written"),
        ((str(FILE), "--dataset", "."), "Error: --dataset: '.' holds no annotations/instances_test.json"),
    ],
)
def test_what_it_refuses(place: Path, arguments: tuple[str, ...], line: str) -> None:
    before = sorted(place.iterdir())
    told = plain_refusal(pavetwin("compare", *arguments, cwd=place))
    assert told.startswith(line), told
    assert sorted(place.iterdir()) == before
