"""Eight images are learned by heart: network, assignment, losses, batches and training together."""

from collections.abc import Iterator
from pathlib import Path

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
from pavetwin.training.trainer.trainer import Trainer
from pavetwin.training.trainer.watchers import Silent
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
