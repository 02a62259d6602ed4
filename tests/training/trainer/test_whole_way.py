"""From labelled pictures to answers, by the commands alone: train, export, evaluate, compare, detect, serve."""

import csv
import json
import re
import signal
import subprocess
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
import pytest

from scenes.command_line import command, pavetwin
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow

EXACT = [
    *("--set", "width=0.125", "--set", "rate=0.004", "--set", "warmup_epochs=1", "--set", "classifier_epochs=2"),
    *("--set", "mosaic=0", "--set", "mosaic_off=0", "--set", "scale=0", "--set", "mirror=0", "--set", "hue=0"),
    *("--set", "saturation=0", "--set", "brightness=0"),
]
"""A small network that learns its pictures by heart."""


def test_what_is_trained_is_exported_evaluated_and_answers(tmp_path: Path) -> None:
    roads = drawn_roads(tmp_path / "roads", {"train": 8, "val": 8, "test": 8}, size=(96, 96), repeats=8)
    run, model = tmp_path / "run", tmp_path / "model.onnx"
    words = ("--image", 96, "--epochs", 40, "--batch", 8, "--device", "cpu", *EXACT)
    for each in (
        ("train", roads, "-o", run, *words),
        ("export", run, "-o", model, "--licence", "Apache-2.0"),
        ("evaluate", model, roads, "-o", tmp_path / "report", "--resamples", 0),
        ("detect", roads / "images" / "test", "--model", model, "-o", tmp_path / "found"),
        ("compare", model, "--dataset", roads, "--frames", 1, "-o", tmp_path / "models.csv"),
    ):
        done = pavetwin(*each)
        assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "report" / "metrics.json").read_text())
    assert told["map50"] > 0.8
    (compared,) = csv.DictReader((tmp_path / "models.csv").open())
    assert float(compared["mAP@0.5"]) == pytest.approx(100 * told["map50"], abs=0.1)
    truth = json.loads((roads / "annotations" / "instances_test.json").read_text())
    rows = list(csv.DictReader((tmp_path / "found" / "detections.csv").open()))
    best = [best_overlap(each, truth, rows) for each in truth["annotations"]]
    assert np.mean([overlap >= 0.5 for overlap in best]) >= 0.9

    first = truth["images"][0]["file_name"]
    served = answer_to(roads / "images" / "test" / first, model)
    boxes = np.array([each["box"] for each in served["detections"]])
    mine = [row for row in rows if row["image"] == first]
    assert len(boxes) == len(mine) > 0
    written = np.array([[float(row[edge]) for edge in ("left", "top", "right", "bottom")] for row in mine])
    np.testing.assert_allclose(in_order(boxes), in_order(written), atol=0.1)


def in_order(boxes: np.ndarray) -> np.ndarray:
    """From left to right, and of one column from top to bottom."""
    return boxes[np.lexsort(np.round(boxes[:, ::-1].T))]


def best_overlap(
    true: dict[str, object], truth: dict[str, list[dict[str, object]]], rows: list[dict[str, str]]
) -> float:
    """Greatest IoU of a labelled box with what was found of its class in its picture."""
    names = {each["id"]: each["name"] for each in truth["categories"]}
    files = {each["id"]: each["file_name"] for each in truth["images"]}
    left, top, width, height = true["bbox"]  # type: ignore[misc]
    found = [0.0]
    for row in rows:
        if (row["image"], row["class"]) != (files[true["image_id"]], names[true["category_id"]]):
            continue
        box = [float(row[edge]) for edge in ("left", "top", "right", "bottom")]
        across = min(box[2], left + width) - max(box[0], left)
        down = min(box[3], top + height) - max(box[1], top)
        shared = max(0.0, across) * max(0.0, down)
        found.append(shared / (width * height + (box[2] - box[0]) * (box[3] - box[1]) - shared))
    return max(found)


def answer_to(picture: Path, model: Path) -> dict[str, list[dict[str, object]]]:
    """What `pavetwin serve` says of a picture."""
    words = command("serve", "--model", model, "--port", 0)
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://127\.0\.0\.1:\d+/", process.stdout.readline())
            assert found is not None
            head = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.png"\r\n\r\n'
            body = head + picture.read_bytes() + b"\r\n--x--\r\n"
            request = Request(f"{found[0]}predict", body, {"Content-Type": "multipart/form-data; boundary=x"})
            with urlopen(request, timeout=30) as answer:
                return json.load(answer)
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(20)
