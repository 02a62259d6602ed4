"""The ONNX file of a network says what the network says, on any number of images of any size."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest
import torch
from torch import nn
from torchvision.ops import box_iou

from pavetwin.errors import PaveTwinError
from pavetwin.perception.detector import Detector
from pavetwin.perception.model_file import DEFAULT, ModelFacts, model_path
from pavetwin.training.network.architecture import variant
from pavetwin.training.network.network import DetectLimits, DetectorNetwork, ImageDetections, detect
from pavetwin.training.trainer.export import export, onnx_model
from pavetwin.training.trainer.weights_detector import WeightsDetector
from scenes.command_line import pavetwin, plain_refusal
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow


def lively_network(**others: object) -> DetectorNetwork:
    """Random weights, normalised on noise: scores, boxes and subtypes vary as those of a trained network do."""
    torch.manual_seed(5)
    network = DetectorNetwork(variant("n", width=0.0625, depth=0.1, **others))
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = None  # the statistics of all that it was shown
    for branch in network.detection.boxes:
        nn.init.normal_(branch[-1].weight, 0.0, 0.15)
    nn.init.normal_(network.regions.subtype[-1].weight, 0.0, 1.5)
    images = torch.from_numpy(images_of(4, (96, 128), np.random.default_rng(3)))
    with torch.no_grad():
        encoded = network.train()(images.permute(0, 3, 1, 2).float() / 255)
        network.regions(encoded.maps, torch.tensor([[at, 8.0, 8.0, 60.0 + 20 * at, 60.0] for at in range(4)]))
        logits = network.eval()(images.permute(0, 3, 1, 2).float() / 255).scores.flatten(0, 1)
        middle = logits.mean(dim=0)
        slope = 1.2 / (logits.amax(dim=0) - middle)
        for branch in network.detection.classes:
            branch[-1].weight *= slope[:, None, None, None]
            branch[-1].bias.copy_(slope * (branch[-1].bias - middle) - 1.0)
        shown = network(images.permute(0, 3, 1, 2).float() / 255)
        regions = [[at, left, 8.0, left + 40.0, 60.0] for at in range(4) for left in (0.0, 30.0, 60.0, 85.0)]
        subtypes, _ = network.regions(shown.maps, torch.tensor(regions))
        network.regions.subtype[-1].bias -= subtypes.mean(dim=0)
    return network


def images_of(count: int, size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """(count, rows, columns, 3): patches of colours over noise."""
    coarse = rng.integers(0, 255, (count, size[0] // 16, size[1] // 16, 3)).repeat(16, 1).repeat(16, 2)
    return np.clip(coarse + rng.normal(0, 12, (count, *size, 3)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("others", "limits"),
    [
        ({}, DetectLimits(confidence=0.35, most=8)),
        ({"masks": False, "activation": "relu"}, DetectLimits(confidence=0.35, candidates=60)),
    ],
)
def test_the_file_says_what_the_network_says(others: dict[str, object], limits: DetectLimits) -> None:
    network = lively_network(**others)
    facts = ModelFacts(mask_px=28 if network.architecture.masks else 0)
    session = session_of(onnx_model(network, facts, limits=limits))
    names = [each.name for each in session.get_outputs()]
    rng = np.random.default_rng(3)
    tally = Tally(limits)
    for batch, rows, columns in ((50, 96, 128), (40, 64, 64), (60, 128, 96), (49, 32, 160), (1, 480, 640)):
        images = images_of(batch, (rows, columns), rng)
        given = {"images": images, "confidence": np.float32([limits.confidence]), "overlap": np.float32([0.7])}
        told = dict(zip(names, session.run(names, given), strict=True))
        shown = torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255
        with torch.no_grad():
            scores = network(shown).scores.sigmoid().flatten(1).sort(descending=True).values
        last = scores[:, min(limits.candidates, scores.shape[1]) - 1]
        for at, each in enumerate(detect(network, shown, limits)):
            tally.compare(each, {name: values[told["image"] == at] for name, values in told.items()}, float(last[at]))
    assert tally.images == 200
    assert (tally.same > 20).sum() >= 4, tally.same  # classes among what was compared
    assert tally.full > 5 or limits.most == 300  # images with more than the file may say of one
    assert tally.borderline <= 0.01 * tally.same.sum(), tally.borderline
    if facts.mask_px:
        # Convolutions add in another order, which these weights amplify in a few pixels.
        away = np.concatenate(tally.masks_away)
        assert np.quantile(away, 0.999) < 1e-3
        assert away.max() < 0.05


def session_of(model: Any) -> Any:
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(model.SerializeToString(), options)


class Tally:
    """What two sides agree on, image by image; a difference that no rounding explains fails.

    A detection of one side alone may be explained by a value within 1e-3 of what decides: its score of the threshold,
    of the last candidate or of the last one that an image may have, the IoU with a more confident box of the limit of
    suppression, or the best two subtypes of each other.
    """

    def __init__(self, limits: DetectLimits) -> None:
        self.limits = limits
        self.last_candidate = 0.0
        self.images = self.borderline = self.full = 0
        self.same = np.zeros(5, dtype=int)
        self.masks_away: list[np.ndarray] = []

    def compare(self, wanted: ImageDetections, told: dict[str, np.ndarray], last_candidate: float) -> None:
        """Args:
        last_candidate: score of the last one of this image that suppression looks at.
        """
        self.last_candidate = last_candidate
        boxes, classes = wanted.boxes.numpy(), wanted.classes.numpy()
        scores = wanted.detection.numpy()
        assert (np.diff(told["detection"]) <= 0).all()
        free = np.ones(len(told["boxes"]), dtype=bool)
        for row in range(len(boxes)):
            away = np.abs(told["boxes"] - boxes[row]).max(axis=1, initial=0) + 1e3 * ~free
            away += 1e3 * (told["classes"] != classes[row])
            away += 1e3 * (np.abs(told["detection"] - scores[row]) > 1e-3)
            best = int(np.argmin(away)) if len(away) else -1
            if best < 0 or away[best] > 0.5:
                rivals = wanted.subtypes[row].sort().values[-2:]
                undecided = int(wanted.coarse[row]) == 0 and float(rivals[1] - rivals[0]) < 1e-3
                self._explain(boxes, scores, boxes[row], scores[row], undecided)
                continue
            free[best] = False
            final = float(told["detection"][best] * told["subtype"][best])
            assert final == pytest.approx(float(wanted.confidence[row]), abs=1e-3)
            self.same[classes[row]] += 1
            if wanted.masks is not None:
                self.masks_away.append(np.abs(told["masks"][best] - wanted.masks[row].numpy()).ravel())
        for row in np.flatnonzero(free):
            self._explain(boxes, scores, told["boxes"][row], told["detection"][row], False)
        self.images += 1
        self.full += len(boxes) == self.limits.most

    def _explain(self, boxes: np.ndarray, scores: np.ndarray, box: np.ndarray, score: float, known: bool) -> None:
        self.borderline += 1
        last = scores[-1] if len(scores) == self.limits.most else self.limits.confidence
        overlaps = box_iou(torch.from_numpy(boxes), torch.from_numpy(box)[None]).numpy()
        known |= min(abs(score - last), abs(score - self.last_candidate)) < 1e-3 or bool(
            (np.abs(overlaps - self.limits.overlap) < 1e-3).any()
        )
        assert known, (box, score, last)


def saved(network: DetectorNetwork, run: Path) -> Path:
    run.mkdir()
    weights = {"format": 1, "architecture": network.architecture.as_mapping(), "weights": network.state_dict()}
    torch.save({**weights, "options": {"image_px": 96, "native": True}}, run / "best.pt")
    (run / "run.json").write_text("{}")
    return run


def test_the_file_knows_what_it_is_and_runs_without_torch(tmp_path: Path) -> None:
    network = lively_network()
    run = saved(network, tmp_path / "run")
    done = pavetwin("export", run, "-o", tmp_path / "whole.onnx", "--licence", "Apache-2.0")
    assert (done.returncode, done.stdout.count("MB, with masks, for images of 96 px")) == (0, 1), done.stderr
    export(run, tmp_path / "half.onnx", half=True)
    facts = Detector(tmp_path / "whole.onnx").facts
    assert (facts.image_px, facts.native, facts.mask_px, facts.licence) == (96, True, 28, "Apache-2.0")
    assert facts.architecture["width"] == 0.0625
    assert len(facts.recipe) == 64
    assert (tmp_path / "half.onnx").stat().st_size < 0.6 * (tmp_path / "whole.onnx").stat().st_size
    image = images_of(1, (96, 96), np.random.default_rng(1))[0]
    found = [Detector(tmp_path / f"{name}.onnx", confidence=0.05).detect([image])[0] for name in ("whole", "half")]
    assert len(found[0]) > 0
    assert abs(len(found[0]) - len(found[1])) <= 2
    text = (tmp_path / "whole.onnx").read_bytes()
    assert str(Path(__file__).parents[3]).encode() not in text  # no path of this machine


def test_an_exported_model_is_stored_otherwise_and_says_the_same(tmp_path: Path) -> None:
    """As a user has it who holds the file of a model alone, such as one that ships."""
    export(saved(lively_network(), tmp_path / "run"), tmp_path / "whole.onnx", licence="CC0-1.0")
    again, half = (tmp_path / f"{name}.onnx" for name in ("again", "half"))
    assert export(tmp_path / "whole.onnx", again) == Detector(tmp_path / "whole.onnx").facts
    assert export(again, again, half=True, licence="MIT").licence == "MIT"  # in place
    shown = images_of(1, (96, 96), np.random.default_rng(1))
    done = pavetwin("export", tmp_path / "whole.onnx", "-o", half, "--half")
    assert done.returncode == 0, done.stderr
    one, other = (Detector(file, confidence=0.3) for file in (tmp_path / "whole.onnx", half))
    assert one.facts == other.facts
    assert (len(one.facts.recipe), one.facts.licence) == (64, "CC0-1.0")
    assert half.stat().st_size < 0.6 * (tmp_path / "whole.onnx").stat().st_size
    found, said = one.detect([shown[0]])[0], other.detect([shown[0]])[0]
    assert len(found) > 0
    assert abs(len(found) - len(said)) <= 1
    assert float(box_iou(torch.tensor(found.boxes), torch.tensor(said.boxes)).amax(dim=1).median()) > 0.98

    refused = plain_refusal(pavetwin("export", tmp_path / "whole.onnx", "-o", tmp_path / "model.txt"))
    assert "model.txt': the name of a model ends in .onnx" in refused
    refused = plain_refusal(pavetwin("export", "none", "-o", half))
    assert "There is no run 'none', and no model of this name ships" in refused
    assert DEFAULT in refused


def test_weights_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    network = lively_network()
    with torch.no_grad():
        network.regions.subtype[-1].bias[0] = float("nan")
    run = saved(network, tmp_path / "run")
    with pytest.raises(PaveTwinError, match="not finite"):
        export(run, tmp_path / "model.onnx")
    assert not (tmp_path / "model.onnx").exists()


def test_weights_say_what_their_file_says_and_are_asked_of_regions(tmp_path: Path) -> None:
    """In tiles, and the subtypes of their own boxes are those that they gave them."""
    network = lively_network()
    corners = np.random.default_rng(0).uniform(0, 60, (40, 2))
    regions = torch.from_numpy(np.hstack([np.zeros((40, 1)), corners, corners + 36])).float()
    shown = torch.from_numpy(images_of(1, (96, 96), np.random.default_rng(1))).permute(0, 3, 1, 2).float() / 255
    with torch.no_grad():
        logits, _ = network.regions(network(shown).maps, regions)
        network.regions.subtype[-1].bias -= logits.mean(dim=0)  # so that each subtype is said of some region
    run = saved(network, tmp_path / "run")
    export(run, tmp_path / "model.onnx")
    weights = WeightsDetector(run / "best.pt", confidence=0.3)
    image = images_of(1, (128, 160), np.random.default_rng(1))[0]
    mine, theirs = weights.detect([image])[0], Detector(tmp_path / "model.onnx", confidence=0.3).detect([image])[0]
    assert len(mine) > 10
    assert abs(len(mine) - len(theirs)) <= 1
    boxes, others = torch.from_numpy(mine.boxes), torch.from_numpy(theirs.boxes)
    assert (box_iou(boxes, others).amax(dim=1) > 0.98).float().mean() > 0.95
    whole = WeightsDetector(run / "best.pt", confidence=0.3, tiled=False)
    (found,) = whole.detect([image])
    rows = np.flatnonzero(found.is_defect)
    said = whole.subtypes_at(image, [found.box(at) for at in rows])
    assert len(set(said)) > 1
    assert said == found.classes[rows].tolist()
    boxes_asked = [(100.0, 70.0, 150.0, 120.0), (2.0, 2.0, 60.0, 50.0)]
    asked = weights.subtypes_at(image, boxes_asked)
    assert WeightsDetector(tmp_path / "model.onnx", confidence=0.3).subtypes_at(image, boxes_asked) == asked
    alone = [weights.subtypes_at(each, [box])[0] for each, box in (
        (image[32:128, 64:160], (36.0, 38.0, 86.0, 88.0)), (image[:96, :96], (2.0, 2.0, 60.0, 50.0))
    )]  # fmt: skip
    assert asked == alone


def test_weights_are_evaluated_without_an_export(tmp_path: Path) -> None:
    """With the subtypes of true regions, which no detection has to match."""
    run = saved(lively_network(), tmp_path / "run")
    data = drawn_roads(tmp_path / "roads", {"test": 3})
    done = pavetwin("evaluate", run / "best.pt", data, "-o", tmp_path / "report", "--resamples", 0)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "report" / "metrics.json").read_text())
    rows = json.loads((data / "annotations" / "instances_test.json").read_text())["annotations"]
    assert told["subtypes_on_true_regions"]["regions"] == sum(row["category_id"] <= 3 for row in rows) > 0
    export(run, tmp_path / "model.onnx")
    asked = ("--true-regions", "--resamples", 0)
    done = pavetwin("evaluate", tmp_path / "model.onnx", data, "-o", tmp_path / "exported", *asked)
    assert done.returncode == 0, done.stderr
    same = json.loads((tmp_path / "exported" / "metrics.json").read_text())
    assert same["subtypes_on_true_regions"] == told["subtypes_on_true_regions"]
    (tmp_path / "best.pt").write_bytes(b"this is text")
    refused = plain_refusal(pavetwin("evaluate", tmp_path / "best.pt", data, "-o", tmp_path / "other"))
    assert refused.startswith("Error: '")
    assert "is damaged, or not a file of weights" in refused


@pytest.mark.parametrize("name", [DEFAULT, "photographs"])
def test_a_shipped_model_finds_the_same_in_pytorch(name: str) -> None:
    pictures = sorted((Path(__file__).resolve().parents[3] / "docs/gallery").glob("*.jpg"))
    told, shown = Detector(name, threads=1), WeightsDetector(model_path(Path(name)), threads=1)
    assert (told.facts, told.image_px) == (shown.facts, shown.image_px)
    found = 0
    for one, other in zip(told.each(pictures), shown.each(pictures), strict=True):
        assert one.class_name.tolist() == other.class_name.tolist()
        np.testing.assert_allclose(one.box_px, other.box_px, atol=0.5)
        np.testing.assert_allclose(one.confidence, other.confidence, atol=1e-3)
        found += len(one)
    assert found > 20
