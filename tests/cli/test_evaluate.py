"""`pavetwin evaluate` and `pavetwin compare`: their tables and files, and refused input."""

import csv
import json
from pathlib import Path

import pytest
from PIL import Image

from pavetwin.perception.detector import Detector
from pavetwin.training.evaluation import comparison
from pavetwin.training.evaluation.labelled import read_split
from scenes.command_line import pavetwin, plain_refusal
from scenes.detections import CAR, CRACK, CROCODILE, FAR, POTHOLE, said, true, write_detections, write_labels
from scenes.drawn_detector import FILE, SIDE_PX, drawn
from scenes.drawn_roads import drawn_roads


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three images of a test split, one of them empty, one of val; a car is missed, a crack taken for a net of them."""
    folder = tmp_path_factory.mktemp("evaluate")
    facts = [{"camera": {"altitude_m": altitude}} for altitude in (6.0, 10.0, 10.0)]
    write_labels(folder / "town", [[true(CRACK), true(POTHOLE, FAR)], [true(CAR)], []], facts=facts)
    write_labels(folder / "town", [[true(POTHOLE)]], split="val")
    (folder / "town" / "images" / "test").mkdir(parents=True)
    for number in (1, 2, 3):
        Image.new("RGB", (200, 200), (120, 120, 120)).save(folder / "town" / "images" / "test" / f"{number:03}.png")
    write_labels(folder / "bare", [[true(CRACK)], [], []])
    write_labels(folder / "bare", [[]], split="val")
    rows = [said(1, CROCODILE), said(1, POTHOLE, FAR), said(3, CAR, FAR, det=0.6), said(501, POTHOLE, det=0.7)]
    write_detections(folder / "found.json", rows)
    write_detections(folder / "better.json", [*rows, said(2, CAR)])
    regions = [{"annotation_id": 10_000, "category_id": CRACK}, {"annotation_id": 10_001, "category_id": POTHOLE}]
    write_detections(folder / "regions.json", regions)
    write_detections(folder / "wrong.json", [said(77, CAR)])
    return folder


def test_a_report_is_written(place: Path) -> None:
    more = ("--against", "found.json", "--against", "found.json", "--regions", "regions.json", "--resamples", "20")
    done = pavetwin("evaluate", "better.json", "town", "-o", "report", *more, cwd=place)
    assert done.returncode == 0, done.stderr
    lines = {line.split("  ")[0]: line.split() for line in done.stdout.splitlines() if line}
    assert lines["Pothole"][1:] == ["1", "100.0", "100.0", "100.0", "100.0", "100.0"]
    assert lines["Single Crack"][2:] == ["1", "0.0", "0.0", "–", "0.0", "0.0"]
    assert lines["Car"][1:3] == ["1", "100.0"]
    assert lines["macro F1 at 0.700, best of the split val"][-1] == "66.7"
    assert lines["subtype macro F1 on true regions"][-1] == "100.0"
    assert "3 images, 1 of them empty." in done.stdout
    reported = json.loads((place / "report" / "metrics.json").read_text())
    assert reported["differences"]["recall"]["value"] == pytest.approx(1 / 3)
    assert [run["recall"] for run in reported["runs"]["others"]] == pytest.approx([1 / 3, 1 / 3])
    assert "Means of 1 and 2 runs" in done.stdout
    assert reported["confusion"]["counts"][0][1] == 1
    assert reported["at_best_of_validation"]["confidence"] == pytest.approx(0.7)
    page = (place / "report" / "report.html").read_text()
    for heading in ("Metrics", "Against the other detections", "What is taken for what", "The worst errors"):
        assert f"<h2>{heading}</h2>" in page
    files = {path.name for path in (place / "report").iterdir()}
    assert files >= {"classes.csv", "confusion.csv", "breakdowns.csv", "calibration.csv", "intervals.csv"}
    with (place / "report" / "classes.csv").open() as file:
        (row,) = (row for row in csv.DictReader(file) if row["class"] == "Pothole")
    assert (row["objects"], row["hits"], row["false_alarms"], row["f1"]) == ("1", "1", "0", "1.0")
    sheets = sorted((place / "report" / "figures").glob("*.jpg"))
    assert len(sheets) == 2
    with Image.open(sheets[0]) as sheet:
        assert sheet.width > 400


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("found.json", "town"), "Error: Missing option '--output'"),
        (("best.pt", "town", "-o", "n"), "Error: Evaluating weights needs PyTorch, which is an extra; install it with"),
        (("nosuch.json", "town", "-o", "n"), "Error: 'nosuch.json' cannot be read (No such file or directory)."),
        (("render", "town", "-o", "n"), "Error: There is no model 'render': name one that ships"),
        (("nosuch.onnx", "town", "-o", "n"), "Error: There is no model 'nosuch.onnx': name one that ships"),
        (("wrong.json", "town", "-o", "n"), "Error: 'wrong.json': entry 1 is of image 77, which is not in test"),
        (("found.json", ".", "-o", "n"), "Error: '.' holds no annotations/instances_test.json; make one with"),
        (("found.json", "town", "-o", "n", "--split", "tset"), "Error: --split: no split 'tset' (did you mean"),
        (("found.json", "town", "-o", "n", "--confidence", "25"), "Error: --confidence 25: it must be above 0 and"),
        (("rendered", "bare", "-o", "n", "--confidence", "25"), "Error: --confidence 25: it must be above 0 and below"),
        (("rendered", "bare", "-o", "n", "--seed", "-3"), "Error: --seed -3: it must be 0 or more."),
        (("rendered", "bare", "-o", "found.json"), "Error: --output: 'found.json' is a file, so that nothing can"),
        (("found.json", "town", "-o", "n", "--overview"), "Error: --overview: 'found.json' is a file of detections"),
        (("found.json", "town", "-o", "n", "--against", "no.json"), "Error: --against: 'no.json' cannot be read"),
        (("found.json", "town", "-o", "n", "--run", "no.json"), "Error: --run: further runs are for differences"),
        (
            ("found.json", "town", "-o", "n", "--against", "found.json", "--run", "no.json"),
            "Error: --run: 'no.json' cannot be read",
        ),
        (("found.json", "town", "-o", "n", "--regions", "found.json"), "Error: --regions: 'found.json': entry 1"),
        (("rendered", "bare", "-o", "n", "--true-regions"), "Error: Classifying true regions needs PyTorch, which is"),
        (("found.json", "town", "-o", "n", "--true-regions"), "Error: --true-regions: a file of detections"),
        (("a.onnx", "town", "-o", "n", "--true-regions", "--regions", "b.json"), "Error: --regions and --true"),
        (("found.json", "bare", "-o", "n"), "Error: The picture of '001.png' in 'bare' cannot be"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(place: Path, arguments: tuple[str, ...], line: str) -> None:
    refused = plain_refusal(pavetwin("evaluate", *arguments, cwd=place))
    assert refused.startswith(line), refused
    assert not (place / "n").exists()


def test_a_shipped_detector_is_evaluated_by_name(tmp_path: Path) -> None:
    town = drawn_roads(tmp_path / "town", {"test": 1}, size=(64, 64))
    words = ("-o", tmp_path / "report", "--against", "photographs", "--resamples", 0)
    done = pavetwin("evaluate", "rendered", town, *words)
    assert done.returncode == 0, done.stderr
    reported = json.loads((tmp_path / "report" / "metrics.json").read_text())
    assert len(reported["runs"]["others"]) == len(reported["runs"]["these"]) == 1
    refused = plain_refusal(pavetwin("evaluate", "synthetic-none", town, "-o", tmp_path / "other"))
    assert "synthetic-none" in refused


@pytest.fixture(scope="module")
def streets(tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def test_accuracy_stands_where_it_was_measured(streets: Path) -> None:
    """Of two potholes and a car one pothole is missed: recall (0.5 + 1) / 2, and nothing false."""
    done = pavetwin("compare", f"drawn={FILE}", "--dataset", "town", "--frames", "1", "-o", "models.csv", cwd=streets)
    assert done.returncode == 0, done.stderr
    (row,) = rows_of(streets / "models.csv")
    assert (row["model"], row["precision"], row["recall"]) == ("drawn", "100.0", "75.0")
    assert 50 < float(row["mAP@0.5"]) < 100
    assert float(row["size, MB"]) == pytest.approx(FILE.stat().st_size / 1e6, abs=0.05)
    assert float(row["FPS"]) > 0


def test_speed_is_that_of_the_size_that_accuracy_is_of(streets: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    timed: list[Detector] = []
    monkeypatch.setattr(comparison, "frames_per_s", lambda detector, _frames: timed.append(detector) or 1.0)
    judged: list[Detector] = []
    monkeypatch.setattr(comparison, "found_by", lambda detector, _splits: judged.append(detector) or iter(()))
    split = read_split(streets / "town", "test")
    comparison.compared("drawn", FILE, split=split, frames=1, threads=1, count=None)
    assert [each.image_px for each in timed] == [each.image_px for each in judged] == [SIDE_PX]
    assert [each.tiled for each in timed] == [each.tiled for each in judged]


def test_a_cell_that_was_not_measured_is_empty(streets: Path) -> None:
    done = pavetwin("compare", str(FILE), "--frames", "1", "-o", "bare.csv", cwd=streets)
    assert done.returncode == 0, done.stderr
    (row,) = rows_of(streets / "bare.csv")
    assert row["model"] == "rectangles"
    assert [row[name] for name in ("mAP@0.5", "mAP@0.5:0.95", "precision", "recall", "GFLOPs")] == [""] * 5
    assert done.stdout.splitlines()[0].split()[:2] == ["model", "mAP@0.5"]


def test_a_shipped_detector_is_compared_by_name(streets: Path) -> None:
    done = pavetwin("compare", "rendered", "--frames", "1", "-o", "shipped.csv", cwd=streets)
    assert done.returncode == 0, done.stderr
    (row,) = rows_of(streets / "shipped.csv")
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
def test_a_comparison_refuses_wrong_models(streets: Path, arguments: tuple[str, ...], line: str) -> None:
    before = sorted(streets.iterdir())
    reported = plain_refusal(pavetwin("compare", *arguments, cwd=streets))
    assert reported.startswith(line), reported
    assert sorted(streets.iterdir()) == before
