"""A whole training: eight images are learned by heart, and weights are exported, evaluated and served."""

import csv
import json
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
import pytest
import torch
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval
from torchvision.ops import box_iou

from pavetwin.labels.class_names import ROAD_DEFECT, SUBTYPES
from pavetwin.training.datasets.examples import read_coco
from pavetwin.training.network.network import DetectLimits, ImageDetections, detect
from pavetwin.training.trainer.batches import Batch, ValidationViews, batches
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.run_folder import load_network
from pavetwin.training.trainer.trainer import Silent, Trainer
from scenes.command_line import command, pavetwin
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow

SIZE = 96


def test_eight_images_are_learned_by_heart(tmp_path: Path) -> None:
    drawn = drawn_roads(tmp_path / "data", {"train": 8, "val": 8}, size=(SIZE, SIZE), repeats=8)
    data = read_coco(drawn, ("train", "val"))
    options = TrainingOptions(
        width=0.125, image_px=SIZE, epochs=40, classifier_epochs=2, batch=8, rate=4e-3, warmup_epochs=1,
        mosaic=0, mosaic_off=0, scale=0, mirror=0, hue=0, saturation=0, brightness=0,
    )  # fmt: skip
    trainer = Trainer([data], tmp_path / "run", options, TrainingMachine(device="cpu"), Silent())
    assert trainer.run()

    network, _ = load_network(tmp_path / "run" / "best.pt")
    truth = COCO(str(tmp_path / "data" / "annotations" / "instances_val.json"))
    members = [(data, example) for example in data.examples if example.split == "val"]
    known = {members[0][1].source: frozenset(range(3))}
    views = ValidationViews(members, known, options.views(mosaic=False), options.architecture.mask_px)
    rows: list[dict[str, object]] = []
    shares: dict[str, list[float]] = {name: [] for name in SUBTYPES}
    (batch,) = batches(views, 8, whole=False)
    for image, found in enumerate(detect(network, batch.images.float() / 255, DetectLimits(confidence=0.001))):
        for box, number, confidence in zip(found.boxes, found.classes, found.confidence, strict=True):
            left, top, right, bottom = box.tolist()
            rows.append(
                {
                    "image_id": image,
                    "category_id": int(number) + 1,
                    "bbox": [left, top, right - left, bottom - top],
                    "score": float(confidence),
                }
            )
        for subtype, overlap in _mask_overlaps(found, batch, image):
            shares[SUBTYPES[subtype]].append(overlap)
    judge = COCOeval(truth, truth.loadRes(rows), "bbox")
    judge.evaluate()
    judge.accumulate()
    judge.summarize()
    precision, strict = judge.stats[1], judge.stats[0]
    assert precision >= 0.99
    told = max(trainer.curves, key=lambda row: 0.1 * row["map50"] + 0.9 * row["map"])
    assert told["map50"] == pytest.approx(precision, abs=1e-3)
    assert told["map"] == pytest.approx(strict, abs=1e-3)
    # Not the lattices: their meshes are as wide as a cell of the map, which tells no place within a cell.
    assert np.mean(shares["Single Crack"] + shares["Pothole"]) >= 0.7


def _mask_overlaps(found: ImageDetections, batch: Batch, image: int) -> Iterator[tuple[int, float]]:
    """Subtype of each true defect, and IoU of its mask with that of the most confident detection of it."""
    targets = batch.targets
    for region, subtype, mask in zip(targets.regions, targets.subtypes, targets.masks, strict=True):
        if int(region[0]) != image:
            continue
        matches = (found.coarse == ROAD_DEFECT) & (box_iou(found.boxes, region[None, 1:])[:, 0] >= 0.5)
        guess, true = found.masks[torch.nonzero(matches)[0, 0]] > 0.5, mask > 0.5
        yield int(subtype), float((guess & true).sum() / (guess | true).sum())


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
