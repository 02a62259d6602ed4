"""A model on a dataset, and detections read from a file; wrong entries are refused by one line."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.perception.detector import Detector
from pavetwin.training.evaluation.detections import LEAST_CONFIDENCE, found_by
from pavetwin.training.evaluation.evaluate import evaluate
from pavetwin.training.evaluation.labelled import read_split
from scenes.command_line import pavetwin
from scenes.detections import CAR, CRACK, POTHOLE, RUT, said, scene, true, write_labels
from scenes.drawn_detector import FILE, SIDE_PX, drawn

WHOLE = {"visible_fraction": 1.0, "inside_fraction": 1.0}


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A pothole of 30 × 40 px and a car at 10 mm a pixel; a crack where the ground resolution is not known."""
    objects = [
        [true(POTHOLE, (10, 8, 30, 40), area_m2=0.12, **WHOLE), true(CAR, (60, 12, 30, 44))],
        [true(CRACK, (6, 4, 20, 56), area_m2=1.0, length_m=1.0, **WHOLE)],
    ]
    facts = [{"gsd_mm": 10.0, "width": SIDE_PX, "height": 64}, {"width": SIDE_PX, "height": 64}]
    folder = write_labels(tmp_path / "town", objects, facts=facts)
    (folder / "images" / "test").mkdir(parents=True)
    street = drawn((SIDE_PX, 64), ("pothole", (10, 8, 40, 48)), ("car", (60, 12, 90, 56)))
    street.save(folder / "images" / "test" / "001.png")
    drawn((SIDE_PX, 64), ("single_crack", (6, 4, 26, 60))).save(folder / "images" / "test" / "002.png")
    return folder


def test_sizes_of_masks_are_held_against_the_truth(dataset: Path) -> None:
    split = read_split(dataset, "test")
    found = found_by(Detector(FILE, confidence=LEAST_CONFIDENCE, threads=1), (split,))
    result = evaluate(split, found, resamples=0)
    assert all(each.average_precision[0] == pytest.approx(1) for each in result.five.classes if each.objects)
    rows = {(row.size, row.name): row for row in result.sizes}
    assert rows.keys() == {("area_m2", "Pothole"), ("diameter_mm", "Pothole")}, "no size without a ground resolution"
    (pothole,) = (each for each in found if each.sizes)
    assert pothole.sizes["diameter_mm"] == pytest.approx(2000 * np.sqrt(pothole.sizes["area_m2"] / np.pi), abs=1)
    area = rows["area_m2", "Pothole"]
    assert area.bias_percentage == pytest.approx(100 * (pothole.sizes["area_m2"] / 0.12 - 1))
    assert area.mean_absolute_percentage < 15


def test_a_missing_picture_is_one_line(dataset: Path) -> None:
    (dataset / "images" / "test" / "002.png").write_bytes(b"no picture")
    with pytest.raises(PaveTwinError, match=r"^The picture of '.*' cannot be read as an image [^\n]*$"):
        found_by(Detector(FILE, threads=1), (read_split(dataset, "test"),))


def test_the_command_runs_a_model(dataset: Path) -> None:
    done = pavetwin("evaluate", str(FILE), "town", "-o", "report", "--resamples", "0", cwd=dataset.parent)
    assert done.returncode == 0, done.stderr
    lines = {line.split("  ")[0]: line.split() for line in done.stdout.splitlines() if line}
    assert lines["Pothole"][1:3] == ["1", "100.0"]
    assert "diameter_mm,Pothole,1," in (dataset.parent / "report" / "sizes.csv").read_text()


def test_a_model_may_be_measured_in_tiles_and_as_a_whole_and_the_report_says_so(tmp_path: Path) -> None:
    """Of a size that it sees as a whole by default; other confidences are those of other looks."""
    size = (SIDE_PX + 48, 64)
    facts = [{"width": size[0], "height": size[1]}]
    folder = write_labels(tmp_path / "town", [[true(POTHOLE, (10, 8, 30, 40))]], facts=facts)
    (folder / "images" / "test").mkdir(parents=True)
    drawn(size, ("pothole", (10, 8, 40, 48))).save(folder / "images" / "test" / "001.png")
    told = []
    for name, words in (("usual", ()), ("both", ("--overview",))):
        done = pavetwin("evaluate", str(FILE), "town", "-o", name, "--resamples", "0", *words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        told.append((tmp_path / name / "calibration.csv").read_text(encoding="utf-8"))
        assert ("in tiles and as a whole" in (tmp_path / name / "report.html").read_text(encoding="utf-8")) == bool(
            words
        )
    assert told[0] != told[1]


def test_splits_that_number_their_images_alike_are_kept_apart(dataset: Path) -> None:
    """As captures do: image 1 of the validation split shows a car where image 1 of the test split shows none."""
    test = dataset / "annotations" / "instances_test.json"
    content = json.loads(test.read_text(encoding="utf-8"))
    content["annotations"] = [each for each in content["annotations"] if each["category_id"] != CAR]
    val = dataset / "annotations" / "instances_val.json"
    val.write_text(test.read_text(encoding="utf-8"), encoding="utf-8")
    shutil.copytree(dataset / "images" / "test", dataset / "images" / "val")
    test.write_text(json.dumps(content), encoding="utf-8")
    drawn((SIDE_PX, 64), ("pothole", (10, 8, 40, 48))).save(dataset / "images" / "test" / "001.png")
    done = pavetwin("evaluate", str(FILE), "town", "-o", "report", "--resamples", "0", cwd=dataset.parent)
    assert done.returncode == 0, done.stderr
    told = json.loads((dataset.parent / "report" / "metrics.json").read_text(encoding="utf-8"))
    assert told["at_stated"]["classes"]["Car"]["false_alarms"] == 0
    assert told["at_stated"]["classes"]["Pothole"]["false_alarms"] == 0
    assert told["at_best_of_validation"]["confidence"] is not None


NAN = float("nan")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (said(9, CAR), "is of image 9, which is not in test of the dataset"),
        (said(1, RUT), "has category 6, which is not one of the detector's five classes"),
        (said(1, 17), "has category 17, which the dataset does not have"),
        (said(1, CAR, (1, 2, 3)), "has no `bbox` of left, top, width and height"),
        (said(1, CAR, (1, 2, -3, 4)), "has a `bbox` of negative width or height"),
        (said(1, CAR, (1, 2, NAN, 4)), "has a `bbox` that is not of finite numbers"),
        (said(1, CAR, det=1.2), "is not within 0 and 1"),
        (said(1, CAR) | {"score": NAN}, "has no finite number as `score`"),
        (said(1, CRACK, det=0.9, cls=0.5) | {"score": 0.9}, "has the score 0.9, and its parts make 0.45"),
        (said(1, CRACK) | {"attributes": {"det_conf": 0.9}}, "and has no attribute `cls_conf`"),
        (said(1, CAR) | {"score": "high"}, "has no finite number as `score`"),
        ({"image_id": 1, "category_id": 5, "bbox": [1, 2, 3, 4]}, "has neither `score` nor"),
        (said(1, CAR) | {"attributes": [1]}, "has `attributes` that are not a mapping"),
        (said(1, CRACK, area_m2=0.0), "has `area_m2` 0, which is not above 0"),
        ({"bbox": [1, 2, 3, 4]}, "has no finite number as `image_id`"),
        (7, "is not a mapping"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, row: Any, message: str) -> None:
    with pytest.raises(PaveTwinError) as refused:
        scene(tmp_path, [[true(CAR)]], [said(1, CAR), row])
    assert str(refused.value).startswith(f"'{tmp_path / 'found.json'}': entry 2 ")
    assert message in str(refused.value)


def test_the_score_alone_is_the_final_confidence(tmp_path: Path) -> None:
    row = said(1, CRACK, det=0.9, cls=0.5)
    del row["attributes"]
    _, (box,) = scene(tmp_path, [[true(CRACK)]], [row])
    assert (box.detection, box.confidence) == (0.45, 0.45)
    assert box.box == (10.0, 10.0, 50.0, 40.0)


@pytest.mark.parametrize(
    ("content", "message"),
    [("{}", "is not a list of detections"), ("[", "cannot be read as JSON"), (None, "cannot be")],
)
def test_a_file_of_another_kind_is_refused(tmp_path: Path, content: str | None, message: str) -> None:
    from pavetwin.training.evaluation.detections import read_detections

    split, _ = scene(tmp_path, [[true(CAR)]], [])
    path = tmp_path / "other.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(PaveTwinError, match=message):
        read_detections(path, (split,))
