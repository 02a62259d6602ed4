"""The network: its published size, one encoding of an image, and what its heads look at."""

from math import exp, log

import pytest
import torch
from torchvision.ops import roi_align

from pavetwin.errors import PaveTwinError
from pavetwin.labels.class_names import COARSE
from pavetwin.training.network.architecture import Architecture, variant
from pavetwin.training.network.losses import no_targets
from pavetwin.training.network.network import (
    DetectLimits,
    DetectorNetwork,
    detect,
    gflops,
    parameters,
    pooled,
    sample_regions,
)
from pavetwin.training.trainer.batches import LIMITS, Batch, validate

TINY = Architecture(width=0.125)

PUBLISHED = {"n": (3_157_200, 8.7), "s": (11_166_560, 28.6), "m": (25_902_640, 78.9), "l": (43_691_520, 165.2)}
"""Parameters, which are 3.2, 11.2, 25.9 and 43.7 million, and billions of operations at 640 px, for 80 classes."""

COUNTED_OFFSETS = 16
"""Parameters that the published networks count and do not train: the numbers 0 to 15, whose mean gives a distance."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_published_sizes(name: str) -> None:
    network = DetectorNetwork(variant(name, classes=80))
    weights, operations = PUBLISHED[name]
    assert parameters(network) - parameters(network.regions) == weights - COUNTED_OFFSETS
    assert gflops(network) == pytest.approx(operations, rel=0.01)


def test_an_image_is_encoded_once() -> None:
    network = DetectorNetwork(TINY).eval()
    torch.nn.init.constant_(network.detection.classes[0][-1].bias, 5.0)  # everything is a defect
    calls = {"backbone": 0, "neck": 0, "regions": 0}
    for name in calls:

        def count(*_: object, name: str = name) -> None:
            calls[name] += 1

        getattr(network, name).register_forward_hook(count)
    (found,) = detect(network, torch.rand(1, 3, 64, 96), DetectLimits())
    assert len(found.boxes) > 3
    assert calls == {"backbone": 1, "neck": 1, "regions": 1}


@pytest.mark.parametrize(
    ("architecture", "anchors"),
    [
        (TINY, 12 * 8 + 6 * 4 + 3 * 2),
        (Architecture(width=0.125, depth=1.0, activation="relu", masks=False), 12 * 8 + 6 * 4 + 3 * 2),
    ],
    ids=["tiny", "relu without masks"],
)
def test_every_option_gives_boxes_and_regions(architecture: Architecture, anchors: int) -> None:
    network = DetectorNetwork(architecture).eval()
    found = network(torch.rand(2, 3, 64, 96))
    assert found.distances.shape == (2, anchors, 4, 16)
    assert found.scores.shape == (2, anchors, 3)
    assert found.maps.shape[-2:] == (8, 12)
    subtypes, masks = network.regions(found.maps, torch.tensor([[0, 8.0, 8.0, 40.0, 24.0], [1, 0.0, 0.0, 96.0, 64.0]]))
    assert subtypes.shape == (2, 3)
    assert (masks is None) == (not architecture.masks)
    assert masks is None or masks.shape == (2, 28, 28)
    kinds = {type(each) for each in network.modules()}
    assert (torch.nn.SiLU in kinds) == (architecture.activation == "silu")


def test_validation_draws_no_masks_and_finds_the_same() -> None:
    network = DetectorNetwork(TINY).eval()
    drawn = []
    mask_head = network.regions.mask
    assert mask_head is not None
    mask_head.register_forward_hook(lambda *_: drawn.append(1))
    images = torch.randint(0, 256, (1, 3, 64, 96), dtype=torch.uint8)
    validate(network, [Batch(images, no_targets(1, 3, 28), torch.zeros(0, dtype=torch.int64))], torch.device("cpu"))
    assert not drawn
    plain, whole = (detect(network, images.float() / 255, LIMITS, masks=masks)[0] for masks in (False, True))
    assert drawn
    assert plain.masks is None
    assert torch.equal(plain.boxes, whole.boxes)
    assert torch.equal(plain.subtypes, whole.subtypes)


def test_anchors_lie_in_the_middle_of_their_cells() -> None:
    anchors = DetectorNetwork(TINY).eval()(torch.rand(1, 3, 32, 64)).anchors
    assert anchors.centres[:3].tolist() == [[4, 4], [12, 4], [20, 4]]
    assert anchors.centres[-2:].tolist() == [[16, 16], [48, 16]]
    assert anchors.strides.tolist() == [8.0] * 32 + [16.0] * 8 + [32.0] * 2


def test_before_training_boxes_are_five_strides_wide_and_objects_are_rare() -> None:
    """A black image leaves the biases alone. The share of bin i of a distance is e^(−0.3 i), up to a factor."""
    said = DetectorNetwork(TINY).eval()(torch.zeros(1, 3, 64, 96))
    shares = [exp(-0.3 * each) for each in range(16)]
    reach = sum(each * share for each, share in enumerate(shares)) / sum(shares)
    sides = torch.cat([said.anchors.centres - said.boxes[0, :, :2], said.boxes[0, :, 2:] - said.anchors.centres], dim=1)
    torch.testing.assert_close(sides / said.anchors.strides[:, None], torch.full_like(sides, reach))
    assert 2 * reach == pytest.approx(5.45, abs=0.01)
    for stride in (8, 16, 32):
        expected = log(5 / len(COARSE) / (640 / stride) ** 2)
        assert said.scores[0, said.anchors.strides == stride].unique().tolist() == pytest.approx([expected])


def test_roi_align_reads_a_ramp_where_the_box_is() -> None:
    """A map whose cells hold their column and row: the points of a box are where they should be, in pixels / 8 less the
    half cell that `aligned` takes off."""
    rows, columns = torch.meshgrid(torch.arange(16.0), torch.arange(20.0), indexing="ij")
    maps = torch.stack([columns, rows])[None]
    left, top, right, bottom = 20.0, 30.0, 104.0, 86.0
    found = pooled(sample_regions(maps, torch.tensor([[0.0, left, top, right, bottom]]), 14))[0]
    share = (torch.arange(7) + 0.5) / 7
    assert found[0, 3].tolist() == pytest.approx(((left + share * (right - left)) / 8 - 0.5).tolist(), abs=1e-4)
    assert found[1, :, 2].tolist() == pytest.approx(((top + share * (bottom - top)) / 8 - 0.5).tolist(), abs=1e-4)


@pytest.mark.parametrize("points", [7, 14, 28])
def test_the_subtype_head_sees_roi_align_of_7_by_7(points: int) -> None:
    maps = torch.randn(2, 5, 12, 12, generator=torch.Generator().manual_seed(0))
    boxes = torch.tensor([[0.0, 3.0, 10.0, 71.0, 50.0], [1.0, 40.0, 2.0, 47.0, 90.0]])
    whole = roi_align(maps, boxes, (7, 7), spatial_scale=1 / 8, sampling_ratio=points // 7, aligned=True)
    torch.testing.assert_close(pooled(sample_regions(maps, boxes, points)), whole)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"width": 0.0}, "`width` 0.0: it must be from 0.03 to 2.0."),
        ({"activation": "sillu"}, "`activation`: no activation 'sillu' (did you mean 'silu'?); known are silu, relu."),
        ({"mask_points": 9}, "`mask_points` 9: it must be 7, 14 or 28."),
    ],
)
def test_an_architecture_out_of_range_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(PaveTwinError) as refused:
        Architecture(**values)
    assert str(refused.value) == message


def test_an_unknown_size_is_refused() -> None:
    with pytest.raises(PaveTwinError, match="`size`: no size 'xl'"):
        variant("xl")
