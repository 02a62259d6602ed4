"""The losses against the same sums written out one anchor at a time, without torch."""

from math import atan, exp, log, pi

import pytest
import torch

from pavetwin.training.network.architecture import Architecture
from pavetwin.training.network.losses import (
    Losses,
    Targets,
    assign,
    detection_losses,
    mask_loss,
    no_targets,
    subtype_loss,
    uncounted,
)
from pavetwin.training.network.network import Anchors, DetectorNetwork, Encoded
from pavetwin.training.trainer.options import LossWeights

STRIDES = (8, 16, 32)
SIZE = (64, 96)
"""Rows and columns of the image in pixels."""


def grid() -> list[tuple[float, float, int]]:
    """Column, row and stride of every anchor, by hand."""
    return [
        ((column + 0.5) * stride, (row + 0.5) * stride, stride)
        for stride in STRIDES
        for row in range(SIZE[0] // stride)
        for column in range(SIZE[1] // stride)
    ]


def made(seed: int = 0, images: int = 1) -> Encoded:
    """What a network might say."""
    random = torch.Generator().manual_seed(seed)
    cells = grid()
    anchors = Anchors(torch.tensor([cell[:2] for cell in cells]), torch.tensor([float(cell[2]) for cell in cells]))
    distances = 2 * torch.randn(images, len(cells), 4, 16, generator=random)
    scores = torch.randn(images, len(cells), 3, generator=random)
    return Encoded(distances, scores, anchors, torch.zeros(images, 1, 1, 1))


def labels(
    *objects: tuple[tuple[float, float, float, float], int, bool], known: tuple[bool, ...] = (True,) * 3
) -> Targets:
    """Of one image: box, coarse class, and whether it is ignored."""
    empty = no_targets(1, 3, 28)
    return Targets(
        boxes=torch.tensor([box for box, _, _ in objects]).reshape(-1, 4),
        classes=torch.tensor([number for _, number, _ in objects], dtype=torch.int64),
        images=torch.zeros(len(objects), dtype=torch.int64),
        ignored=torch.tensor([ignored for _, _, ignored in objects], dtype=torch.bool),
        known=torch.tensor([known]),
        regions=empty.regions,
        subtypes=empty.subtypes,
        masks=empty.masks,
        has_mask=empty.has_mask,
    )


OBJECTS = (
    ((10.0, 6.0, 60.0, 40.0), 0, False),
    ((30.0, 20.0, 80.0, 60.0), 2, False),  # shares anchors with the first
    ((5.0, 48.0, 37.0, 50.0), 0, False),  # a crack thinner than any stride
    ((64.0, 0.0, 96.0, 24.0), 1, True),  # ignored: a person
)


def softmax(values: list[float]) -> list[float]:
    top = max(values)
    parts = [exp(value - top) for value in values]
    return [part / sum(parts) for part in parts]


def overlap(one: list[float], other: list[float]) -> float:
    across = min(one[2], other[2]) - max(one[0], other[0])
    down = min(one[3], other[3]) - max(one[1], other[1])
    inner = max(across, 0.0) * max(down, 0.0)
    area = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (one, other))
    return inner / (area - inner)


def by_hand(encoded: Encoded, objects: tuple) -> tuple[float, float, float]:
    """Box, class and distribution loss of one image, with loops and no tensors."""
    cells = grid()
    distances = encoded.distances[0].tolist()
    scores = encoded.scores[0].tolist()
    boxes = []
    for (x, y, stride), sides in zip(cells, distances, strict=True):
        reach = [stride * sum(bin_ * share for bin_, share in enumerate(softmax(side))) for side in sides]
        boxes.append([x - reach[0], y - reach[1], x + reach[2], y + reach[3]])
    real = [(list(box), number) for box, number, ignored in objects if not ignored]

    def is_inside(cell: tuple[float, float, int], box: list[float]) -> bool:
        x, y, stride = cell
        for at, low, high in ((x, box[0], box[2]), (y, box[1], box[3])):
            if abs(at - (low + high) / 2) > max(high - low, stride) / 2:
                return False
        return True

    alignment, chosen = {}, {}
    for index, (box, number) in enumerate(real):
        inside = [a for a, cell in enumerate(cells) if is_inside(cell, box)]
        for a in inside:
            score = 1 / (1 + exp(-scores[a][number]))
            alignment[index, a] = score**0.5 * overlap(boxes[a], box) ** 6
        for a in sorted(inside, key=lambda a: -alignment[index, a])[:10]:
            chosen.setdefault(a, []).append(index)
    owner = {a: max(those, key=lambda index: overlap(boxes[a], real[index][0])) for a, those in chosen.items()}
    target = {}
    for a, index in owner.items():
        mine = [other for other, its in owner.items() if its == index]
        strongest = max(alignment[index, other] for other in mine)
        greatest = max(overlap(boxes[other], real[index][0]) for other in mine)
        target[a] = alignment[index, a] / strongest * greatest
    weight = max(sum(target.values()), 1.0)

    classes = box_loss = distribution = 0.0
    for a, cell in enumerate(cells):
        for number in range(3):
            mine = a in owner and real[owner[a]][1] == number
            is_hidden = any(ignored and n == number and is_inside(cell, list(b)) for b, n, ignored in objects)
            if is_hidden and not mine:
                continue
            wanted = target[a] if mine else 0.0
            probability = 1 / (1 + exp(-scores[a][number]))
            classes -= wanted * log(probability) + (1 - wanted) * log(1 - probability)
    for a, index in owner.items():
        (x, y, stride), goal = cells[a], real[index][0]
        found = boxes[a]
        width, height = max(found[2], goal[2]) - min(found[0], goal[0]), max(found[3], goal[3]) - min(found[1], goal[1])
        apart = ((found[0] + found[2] - goal[0] - goal[2]) ** 2 + (found[1] + found[3] - goal[1] - goal[3]) ** 2) / 4
        angles = [atan((box[2] - box[0]) / (box[3] - box[1])) for box in (goal, found)]
        aspect = 4 / pi**2 * (angles[0] - angles[1]) ** 2
        shared = overlap(found, goal)
        complete = shared - apart / (width**2 + height**2) - aspect**2 / (1 - shared + aspect)
        box_loss += (1 - complete) * target[a]
        spread = 0.0
        for side, reach in zip(distances[a], (x - goal[0], y - goal[1], goal[2] - x, goal[3] - y), strict=True):
            reach = min(max(reach / stride, 0.0), 14.99)
            share = softmax(side)
            spread -= (1 - reach % 1) * log(share[int(reach)]) + reach % 1 * log(share[int(reach) + 1])
        distribution += spread / 4 * target[a]
    return box_loss / weight, classes / weight, distribution / weight


@pytest.mark.parametrize("seed", [0, 1])
def test_the_losses_of_one_image_are_those_by_hand(seed: int) -> None:
    encoded = made(seed)
    found = [float(each) for each in detection_losses(encoded, labels(*OBJECTS))]
    assert found == pytest.approx(by_hand(encoded, OBJECTS), rel=1e-4)


def test_images_of_a_batch_do_not_mix() -> None:
    """The anchors of an image are those that it has alone, wherever it stands and however many objects others show."""
    one, two = labels(*OBJECTS[:1]), labels(*OBJECTS[1:3])
    both = made(5, images=2)
    joined = labels(*OBJECTS[1:3], *OBJECTS[:1])
    images = torch.tensor([1, 1, 0])
    batch = Targets(
        **{name: getattr(joined, name) for name in Targets.__slots__ if name not in ("images", "known")},
        images=images,
        known=torch.ones(2, 3, dtype=torch.bool),
    )
    found = assign(both.scores.sigmoid(), both.boxes, both.anchors, batch)
    for image, alone, rows in ((0, one, [2]), (1, two, [0, 1])):
        single = assign(both.scores[image : image + 1].sigmoid(), both.boxes[image : image + 1], both.anchors, alone)
        named = torch.tensor([*rows, -1])[single.objects[0]]  # −1 picks the last
        assert found.objects[image].tolist() == named.tolist()
        torch.testing.assert_close(found.scores[image], single.scores[0])


def test_a_small_object_has_a_share_of_the_loss_from_the_first_step_on() -> None:
    """Of what an untrained network says, a thing of 15 px has at least a tenth of the target of one of 44 px, the size
    that the finest boxes begin with."""
    encoded = DetectorNetwork(Architecture(width=0.125)).eval()(torch.zeros(1, 3, *SIZE))
    small, fitting = ((10.0, 10.0, 25.0, 25.0), 0, False), ((38.0, 10.0, 82.0, 54.0), 2, False)
    assigned = assign(encoded.scores.sigmoid(), encoded.boxes, encoded.anchors, labels(small, fitting))
    targets = [float(assigned.scores[assigned.objects == at].max()) for at in range(2)]
    assert targets[0] > 0.1 * targets[1] > 0.08


def test_an_ignored_region_has_neither_loss_nor_reward() -> None:
    """Whatever is said of a person there changes nothing; of a car there it does."""
    region = ((64.0, 0.0, 96.0, 24.0), 1, True)
    encoded = made()
    inside = (encoded.anchors.centres >= torch.tensor([64.0, 0.0])).all(1) & (encoded.anchors.centres[:, 1] <= 24)
    losses = {}
    for number in (1, 2):
        scores = encoded.scores.clone()
        scores[0, inside, number] += 5.0
        said = Encoded(encoded.distances, scores, encoded.anchors, encoded.maps)
        for targets in (labels(OBJECTS[0], region), labels(OBJECTS[0])):
            losses[number, len(targets.boxes)] = float(detection_losses(said, targets)[1])
    unsaid = float(detection_losses(encoded, labels(OBJECTS[0], region))[1])
    assert losses[1, 2] == pytest.approx(unsaid)
    assert losses[1, 1] > unsaid + 1
    assert losses[2, 2] > unsaid + 1


def test_an_object_in_an_ignored_region_is_still_learned() -> None:
    encoded, crowd = made(), ((0.0, 0.0, 96.0, 64.0), 0, True)
    hidden = uncounted(encoded.anchors, labels(crowd))
    assert hidden[0, :, 0].all()
    assert not hidden[0, :, 1:].any()
    scores = encoded.scores.clone().requires_grad_()
    said = Encoded(encoded.distances, scores, encoded.anchors, encoded.maps)
    detection_losses(said, labels(OBJECTS[0], crowd))[1].backward()
    assert int((scores.grad[0, :, 0] != 0).sum()) == 10


def test_a_class_that_is_not_labelled_there_has_no_loss() -> None:
    encoded = made()
    scores = encoded.scores.clone().requires_grad_()
    said = Encoded(encoded.distances, scores, encoded.anchors, encoded.maps)
    detection_losses(said, labels(OBJECTS[0], known=(True, False, True)))[1].backward()
    assert scores.grad[0, :, 1].abs().max() == 0
    assert (scores.grad[0, :, 2] != 0).all()


def test_images_without_objects_have_the_loss_of_background() -> None:
    encoded = made()
    box, classes, distribution = detection_losses(encoded, labels())
    assert float(box) == float(distribution) == 0
    assert float(classes) == pytest.approx(float(torch.nn.functional.softplus(encoded.scores).sum()), rel=1e-5)


def test_the_subtype_loss_looks_at_regions_of_known_subtype_only() -> None:
    logits = torch.tensor([[2.0, 0.0, -1.0], [9.0, -9.0, 0.0], [0.0, 1.0, 0.5]])
    wanted = [-log(softmax(row)[at]) for row, at in (([2.0, 0.0, -1.0], 0), ([0.0, 1.0, 0.5], 2))]
    assert float(subtype_loss(logits, torch.tensor([0, -1, 2]))) == pytest.approx(sum(wanted) / 2)
    assert float(subtype_loss(logits, torch.tensor([-1, -1, -1]))) == 0


def test_the_mask_loss_looks_at_regions_with_a_mask_only() -> None:
    logits = torch.tensor([[[1.0, -2.0], [0.5, 3.0]], [[9.0, 9.0], [9.0, 9.0]]])
    masks = torch.tensor([[[1.0, 0.0], [0.25, 1.0]], [[0.0, 0.0], [0.0, 0.0]]])
    pairs = list(zip(logits[0].flatten().tolist(), masks[0].flatten().tolist(), strict=True))
    shares = [1 / (1 + exp(-value)) for value, _ in pairs]
    entropy = -sum(m * log(p) + (1 - m) * log(1 - p) for p, (_, m) in zip(shares, pairs, strict=True)) / 4
    dice = 2 * sum(p * m for p, (_, m) in zip(shares, pairs, strict=True)) / (sum(shares) + 2.25 + 1)
    assert float(mask_loss(logits, masks, torch.tensor([True, False]))) == pytest.approx(entropy + 1 - dice)
    assert float(mask_loss(logits, masks, torch.tensor([False, False]))) == 0


def test_the_total_is_the_weighted_sum() -> None:
    parts = dict(zip(("box", "classes", "distribution", "subtype", "mask"), torch.arange(1.0, 6.0), strict=True))
    assert float(Losses(**parts).total(LossWeights())) == pytest.approx(7.5 + 1.0 + 4.5 + 4.0 + 5.0)
    assert float(Losses(**parts).total(LossWeights(subtype=2.0, mask=0.0))) == pytest.approx(7.5 + 1.0 + 4.5 + 8.0)
