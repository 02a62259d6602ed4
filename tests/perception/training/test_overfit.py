"""Eight images are learned by heart: network, assignment, losses, batches and training together."""

from pathlib import Path

import numpy as np
import pytest
import torch
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from pavetwin.perception.examples.coco import read_coco
from pavetwin.perception.training.batches import ValidationViews, batches
from pavetwin.perception.training.detect import DetectLimits, detect
from pavetwin.perception.training.options import TrainingMachine, TrainingOptions
from pavetwin.perception.training.run_folder import load_network
from pavetwin.perception.training.trainer import Trainer
from pavetwin.perception.training.watchers import Silent
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow

SIZE = 96


def test_eight_images_are_learned_by_heart(tmp_path: Path) -> None:
    drawn = drawn_roads(tmp_path / "data", {"train": 8, "val": 8}, size=(SIZE, SIZE), repeats=8)
    data = read_coco(drawn, ("train", "val"))
    options = TrainingOptions(
        width=0.125, image_px=SIZE, epochs=20, classifier_epochs=2, batch=8, rate=4e-3, warmup_epochs=1,
        mosaic=0, mosaic_off=0, scale=0, mirror=0, hue=0, saturation=0, brightness=0,
    )  # fmt: skip
    trainer = Trainer([data], tmp_path / "run", options, TrainingMachine(device="cpu"), Silent())
    assert trainer.run()

    network, _ = load_network(tmp_path / "run" / "best.pt")
    truth = COCO(str(tmp_path / "data" / "annotations" / "instances_val.json"))
    members = [(data, example) for example in data.examples if example.split == "val"]
    known = {members[0][1].source: frozenset(range(3))}
    views = ValidationViews(members, known, options.views(mosaic=False), options.architecture.mask_px)
    rows, shares = [], []
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
        shares += _mask_overlaps(found, batch, image)
    judge = COCOeval(truth, truth.loadRes(rows), "bbox")
    judge.evaluate()
    judge.accumulate()
    judge.summarize()
    precision, strict = judge.stats[1], judge.stats[0]
    assert precision >= 0.99
    told = max(trainer.curves, key=lambda row: 0.1 * row["map50"] + 0.9 * row["map"])
    assert told["map50"] == pytest.approx(precision, abs=1e-3)
    assert told["map"] == pytest.approx(strict, abs=1e-3)
    filled = float(batch.targets.masks.mean())  # what a mask that fills every box would reach
    assert np.mean(shares) > filled + 0.15, (np.mean(shares), filled)


def _mask_overlaps(found: object, batch: object, image: int) -> list[float]:
    """IoU of the masks of the most confident defects with the true ones, where the boxes agree."""
    overlaps = []
    targets = batch.targets
    for region, mask in zip(targets.regions, targets.masks, strict=True):
        if int(region[0]) != image:
            continue
        away = (found.boxes - region[1:]).abs().amax(dim=1)
        if away.min() < 3:
            guess = found.masks[away.argmin()] > 0.5
            overlaps.append(float((guess & (mask > 0.5)).sum() / torch.logical_or(guess, mask > 0.5).sum()))
    return overlaps
