"""An exported model can be trained on: its network says the same, normalises again, and is refused where it cannot."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from onnx import TensorProto, helper
from torch import Tensor, nn

from pavetwin.errors import PaveTwinError
from pavetwin.perception.model_file import ModelFacts, start_path
from pavetwin.training.datasets.examples import ExampleSet
from pavetwin.training.network.architecture import Architecture, variant
from pavetwin.training.network.losses import no_targets
from pavetwin.training.network.network import DetectorNetwork
from pavetwin.training.trainer.batches import Batch
from pavetwin.training.trainer.export import onnx_model
from pavetwin.training.trainer.exported import exported_model, measure_normalisations
from pavetwin.training.trainer.options import TrainingMachine, TrainingOptions
from pavetwin.training.trainer.run_folder import load_network
from pavetwin.training.trainer.trainer import Silent, Trainer
from scenes.command_line import pavetwin, plain_refusal
from scenes.drawn_roads import drawn_roads

pytestmark = pytest.mark.slow

TINY = TrainingOptions(width=0.03, depth=0.01, image_px=64, epochs=2, classifier_epochs=1, batch=4, mosaic=0.5, seed=3)
CPU = TrainingMachine(device="cpu")
REGIONS = torch.tensor([[0.0, 8.0, 8.0, 50.0, 40.0], [1.0, 20.0, 4.0, 60.0, 60.0], [1.0, 0.0, 0.0, 30.0, 30.0]])


def trained_network(architecture: Architecture) -> DetectorNetwork:
    """Random weights and random statistics, as training leaves them."""
    torch.manual_seed(4)
    network = DetectorNetwork(architecture).eval()
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.normal_(module.running_mean, 0.0, 0.3)
            nn.init.uniform_(module.running_var, 0.3, 3.0)
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.normal_(module.bias, 0.0, 0.3)
    return network


def written(architecture: Architecture, path: Path, *, half: bool = False) -> Path:
    facts = ModelFacts(
        mask_px=architecture.mask_px if architecture.masks else 0, architecture=architecture.as_mapping()
    )
    path.write_bytes(onnx_model(trained_network(architecture), facts, half=half).SerializeToString())
    return path


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(TINY.architecture, tmp_path_factory.mktemp("model") / "tiny.onnx")


def shown(count: int) -> Tensor:
    """(count, 3, 64, 96) uint8."""
    coarse = np.random.default_rng(count).integers(0, 255, (count, 3, 8, 12))
    return torch.from_numpy(coarse.repeat(8, 2).repeat(8, 3).astype(np.uint8))


def batch_of(images: Tensor, mask_px: int, regions: Tensor = REGIONS) -> Batch:
    targets = replace(no_targets(len(images), 3, mask_px), regions=regions)
    return Batch(images, targets, torch.zeros(0, dtype=torch.int64))


@torch.no_grad()
def said(network: DetectorNetwork, images: Tensor) -> list[Tensor]:
    """Scores, boxes, and of three regions the subtypes, and masks where there are some."""
    encoded = network(images.float() / 255)
    subtypes, masks = network.regions(encoded.maps, REGIONS)
    answers = [encoded.scores.sigmoid(), encoded.boxes, subtypes.softmax(dim=1)]
    return answers if masks is None else [*answers, masks.sigmoid()]


def said_by_model(path: Path, images: Tensor) -> tuple[Tensor, Tensor]:
    """Scores and boxes of every place, before duplicates are dropped."""
    model = onnx.load(path)
    values = ("scores", "all_boxes")
    model.graph.output.extend(helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in values)
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    session = onnxruntime.InferenceSession(model.SerializeToString(), options)
    scores, boxes = session.run(values, {"images": images.permute(0, 2, 3, 1).contiguous().numpy()})
    return torch.from_numpy(scores), torch.from_numpy(boxes)


def away(one: Sequence[Tensor], other: Sequence[Tensor]) -> float:
    return max(float((a - b).abs().max()) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(
    ("architecture", "half"),
    [
        (None, True),
        (variant("n", width=0.0625, depth=0.1, activation="relu", masks=False), False),
    ],
    ids=["a shipped model", "ReLU, no masks"],
)
def test_the_network_says_what_the_model_says(architecture: Architecture | None, half: bool, tmp_path: Path) -> None:
    """Before its normalisations are measured, and afterwards."""
    path = start_path("rendered")
    if architecture is not None:
        path = written(architecture, tmp_path / "model.onnx", half=half)
    network, images = exported_model(path)[0], shown(4)
    scores, boxes = said_by_model(path, images)
    limit = torch.tensor([96.0, 64.0, 96.0, 64.0])
    before = said(network, images)
    assert float((before[0] - scores).abs().max()) < 1e-4
    assert float((before[1].clamp(min=0).minimum(limit) - boxes).abs().max()) < 0.2
    measure_normalisations(network, [batch_of(shown(6), 1), batch_of(shown(5), 1)])
    after = said(network, images)
    assert away(before[:1] + before[2:], after[:1] + after[2:]) < 1e-3
    assert away(before[1:2], after[1:2]) < 0.2
    assert len(before) == len(after) == (4 if network.regions.mask is not None else 3)


def test_normalisations_have_the_statistics_of_what_they_see(tiny: Path) -> None:
    """On the images they were measured on, normalising by the batch changes nothing."""
    network, images = exported_model(tiny)[0], shown(6)
    measure_normalisations(network, [batch_of(images, 1)])
    assert not network.training
    stored = said(network, images)
    by_batch = said(network.train(), images)
    assert away(stored[:1] + stored[2:], by_batch[:1] + by_batch[2:]) < 1e-3
    norms = [each for each in network.modules() if isinstance(each, nn.BatchNorm2d)]
    assert all(float(each.running_mean.abs().max()) > 0 for each in norms)
    one, other = exported_model(tiny)[0], exported_model(tiny)[0]
    measure_normalisations(one, [batch_of(images, 1)])
    measure_normalisations(other, [batch_of(images[:2], 1), batch_of(images[2:], 1, REGIONS[:0])])
    assert torch.allclose(one.backbone.stem.norm.running_var, other.backbone.stem.norm.running_var, rtol=1e-5)


def test_heads_of_regions_that_nothing_is_shown_to_stay_as_they_are(tiny: Path) -> None:
    network, images = exported_model(tiny)[0], shown(4)
    before = said(network, images)
    measure_normalisations(network, [batch_of(images, 1, REGIONS[:0])])
    assert float(network.regions.subtype[0].norm.running_mean.abs().max()) == 0
    assert away(before, said(network, images)) < 0.2


def test_a_training_begins_with_an_exported_model_and_goes_on(
    tiny: Path, data: list[ExampleSet], tmp_path: Path
) -> None:
    """In chunks it is the same run, whose first epoch knows what the model knew."""
    begun = Trainer(data, tmp_path / "begun", TINY, CPU, Silent(), tiny)
    network = begun.network.eval()
    scores, _ = said_by_model(tiny, shown(4))
    assert float((said(network, shown(4))[0] - scores).abs().max()) < 1e-3
    assert float(network.backbone.stem.norm.running_mean.abs().max()) > 0
    for name in ("whole", "chunks"):
        while not Trainer(data, tmp_path / name, TINY, CPU, Silent(), tiny).run(0.0 if name == "chunks" else None):
            pass
    assert (tmp_path / "whole" / "curves.csv").read_bytes() == (tmp_path / "chunks" / "curves.csv").read_bytes()
    assert json.loads((tmp_path / "whole" / "run.json").read_text())["start"] == "tiny.onnx"
    ended, started = load_network(tmp_path / "whole" / "best.pt")[0].state_dict(), network.state_dict()
    assert any(not torch.equal(ended[name], value) for name, value in started.items())


def refusal(start: Path, data: list[ExampleSet], run: Path, options: TrainingOptions = TINY) -> str:
    with pytest.raises(PaveTwinError) as refused:
        Trainer(data, run, options, CPU, Silent(), start)
    assert not run.exists()
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_models_that_cannot_be_begun_with_are_refused(tiny: Path, data: list[ExampleSet], tmp_path: Path) -> None:
    run = tmp_path / "run"
    other = replace(TINY, width=0.125)
    assert "is of another architecture: width 0.03, not 0.125; use its settings" in refusal(tiny, data, run, other)
    (tmp_path / "damaged.onnx").write_bytes(tiny.read_bytes()[:-2000])
    assert "is damaged, or not an ONNX model" in refusal(tmp_path / "damaged.onnx", data, run)

    def changed(name: str, change: Any) -> str:
        model = onnx.load(tiny)
        change(model)
        onnx.save(model, tmp_path / name)
        return refusal(tmp_path / name, data, run)

    assert "not a detector of" in changed("other.onnx", lambda model: model.ClearField("metadata_props"))

    def renamed(model: Any) -> None:
        weight = next(each for each in model.graph.initializer if each.name.endswith("stem.conv.weight"))
        node = next(each for each in model.graph.node if weight.name in each.input)
        weight.name = node.input[1] = "another"

    assert "holds no weights of a detector of this version" in changed("renamed.onnx", renamed)


def test_the_command_takes_what_ships_by_name(tmp_path: Path) -> None:
    folder = drawn_roads(tmp_path / "roads", {"train": 8, "val": 2}, size=(64, 64))
    words = ("train", folder, "-o", tmp_path / "run", "--image", 64, "--batch", 4, "--epochs", 1, "--device", "cpu")
    done = pavetwin(*words, "--start", "rendered", "--set", "classifier_epochs=0")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "run" / "run.json").read_text())["start"] == "rendered.onnx"
    refused = plain_refusal(pavetwin(*words[:3], tmp_path / "other", "--start", "synthetic-none"))
    assert refused.startswith("Error: --start: there is no file of weights 'synthetic-none'; name the best.pt of a run")
    assert "rendered" in refused
