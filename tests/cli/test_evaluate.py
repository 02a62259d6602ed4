"""`pavetwin evaluate`: what it prints and writes, and what it refuses."""

import csv
import json
from pathlib import Path

import pytest
from PIL import Image

from scenes.command_line import pavetwin, plain_refusal
from scenes.detections import CAR, CRACK, CROCODILE, FAR, POTHOLE, said, true, write_detections, write_labels
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
    told = json.loads((place / "report" / "metrics.json").read_text())
    assert told["differences"]["recall"]["value"] == pytest.approx(1 / 3)
    assert [run["recall"] for run in told["runs"]["others"]] == pytest.approx([1 / 3, 1 / 3])
    assert "Means of 1 and 2 runs; the intervals hold the spread between runs too." in done.stdout
    assert told["confusion"]["counts"][0][1] == 1
    assert told["at_best_of_validation"]["confidence"] == pytest.approx(0.7)
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
        (("found.json", "town"), "Missing option '--output'"),
        (("best.pt", "town", "-o", "n"), "Error: Evaluating weights needs PyTorch, which is an extra; install it with"),
        (("nosuch.json", "town", "-o", "n"), "Error: 'nosuch.json' cannot be read (No such file or directory)."),
        (("render", "town", "-o", "n"), "Error: There is no model 'render': name one that ships"),
        (("nosuch.onnx", "town", "-o", "n"), "Error: There is no model 'nosuch.onnx': name one that ships"),
        (("wrong.json", "town", "-o", "n"), "Error: 'wrong.json': entry 1 is of image 77, which is not in test"),
        (("found.json", ".", "-o", "n"), "Error: '.' holds no annotations/instances_test.json; make one with"),
        (("found.json", "town", "-o", "n", "--split", "tset"), "Error: --split: no split 'tset' (did you mean"),
        (("found.json", "town", "-o", "n", "--confidence", "25"), "Error: --confidence 25: it is above 0 and below 1."),
        (("rendered", "bare", "-o", "n", "--confidence", "25"), "Error: --confidence 25: it is above 0 and below"),
        (("rendered", "bare", "-o", "n", "--seed", "-3"), "Error: --seed -3: it is 0 or more."),
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


def test_what_ships_is_evaluated_by_name(tmp_path: Path) -> None:
    town = drawn_roads(tmp_path / "town", {"test": 1}, size=(64, 64))
    words = ("-o", tmp_path / "report", "--against", "photographs", "--resamples", 0)
    done = pavetwin("evaluate", "rendered", town, *words)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "report" / "metrics.json").read_text())
    assert len(told["runs"]["others"]) == len(told["runs"]["these"]) == 1
    refused = plain_refusal(pavetwin("evaluate", "synthetic-none", town, "-o", tmp_path / "other"))
    assert "synthetic-none" in refused
