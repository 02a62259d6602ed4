"""Task-aligned assignment (Feng et al. 2021, TOOD): which anchors learn which object, and how strongly.

The alignment of an anchor with an object is s^α · u^β, with s the score of the object's class and u the IoU of the
anchor's predicted box. The best-aligned anchors inside an object learn it. Their target score is their alignment,
scaled within the object so that the greatest equals the object's greatest IoU.

Anchors of stride 4 learn small objects alone, by an assignment of their own. In one assignment they would learn next
to nothing beside levels that were trained before: target scores go with the sixth power of the boxes' overlap.
"""

from dataclasses import dataclass, replace
from typing import Final

import torch
from torch import Tensor

from pavetwin.training.trainer.architecture import FINE_STRIDE
from pavetwin.training.trainer.network import Anchors
from pavetwin.training.trainer.targets import Targets

MOST_ANCHORS: Final = 10
"""That learn one object."""
ALPHA: Final = 0.5
BETA: Final = 6.0

SMALL_PX2: Final = 32.0**2
"""Area below which an object is small, as the evaluation of COCO has it."""

_TINY: Final = 1e-30


@dataclass(frozen=True, slots=True)
class Assignment:
    """For each anchor, what it learns."""

    objects: Tensor
    """(batch, anchors) int64 row of `Targets.boxes`; −1 for background."""
    scores: Tensor
    """(batch, anchors) float32 target score of the object's class; 0 for background."""


@torch.no_grad()
def assign(scores: Tensor, boxes: Tensor, anchors: Anchors, targets: Targets) -> Assignment:
    """The anchors of each object that is not ignored.

    Args:
        scores: (batch, anchors, classes) in 0 … 1.
        boxes: (batch, anchors, 4) predicted, in pixels.
    """
    coarse = int((anchors.strides > FINE_STRIDE).sum())
    if coarse == len(anchors.strides):
        return _assign(scores, boxes, anchors, targets)
    small = replace(targets, ignored=targets.ignored | (area(targets.boxes) >= SMALL_PX2))
    parts = [
        _assign(scores[:, which], boxes[:, which], Anchors(anchors.centres[which], anchors.strides[which]), learned)
        for which, learned in ((slice(0, coarse), targets), (slice(coarse, None), small))
    ]
    return Assignment(
        torch.cat([each.objects for each in parts], dim=1), torch.cat([each.scores for each in parts], dim=1)
    )


def _assign(scores: Tensor, boxes: Tensor, anchors: Anchors, targets: Targets) -> Assignment:
    rows = _by_image(targets, len(scores))  # (batch, objects), −1 where an image has fewer
    if not rows.numel():
        nothing = torch.full(scores.shape[:2], -1, dtype=torch.int64, device=scores.device)
        return Assignment(nothing, torch.zeros_like(nothing, dtype=torch.float32))
    is_there = (rows >= 0)[..., None]
    wanted, classes = targets.boxes[rows.clamp(min=0)], targets.classes[rows.clamp(min=0)]
    overlap = iou(wanted[:, :, None], boxes[:, None].float())  # (batch, objects, anchors)
    of_class = scores.float().transpose(1, 2).gather(1, classes[..., None].expand(-1, -1, scores.shape[1]))
    alignment = of_class.pow(ALPHA) * overlap.pow(BETA)
    candidates = torch.where(_centred(wanted, anchors) & is_there, alignment, -1.0)
    best = candidates.topk(min(MOST_ANCHORS, candidates.shape[2]), dim=2)
    chosen = torch.zeros_like(candidates, dtype=torch.bool).scatter_(2, best.indices, best.values >= 0)
    # An anchor that several objects have chosen learns the one that it overlaps most.
    contested = torch.where(chosen, overlap, -1.0)
    greatest, owner = contested.max(dim=1)
    is_object = greatest >= 0
    own = torch.zeros_like(chosen).scatter_(1, owner[:, None], is_object[:, None])
    strongest = torch.where(own, alignment, 0.0).amax(dim=2, keepdim=True)
    reached = torch.where(own, overlap, 0.0).amax(dim=2, keepdim=True)
    target = torch.where(own, alignment * (reached / strongest.clamp(min=_TINY)), 0.0).sum(dim=1)
    return Assignment(torch.where(is_object, rows.gather(1, owner), -1), target)


def _by_image(targets: Targets, images: int) -> Tensor:
    """(batch, most objects of an image) rows of the objects that are not ignored, −1 behind an image's last."""
    rows = torch.nonzero(~targets.ignored).squeeze(1)
    rows = rows[torch.argsort(targets.images[rows], stable=True)]
    of_image = targets.images[rows]
    counts = torch.bincount(of_image, minlength=images)
    place = torch.arange(len(rows), device=rows.device) - (counts.cumsum(0) - counts)[of_image]
    found = torch.full((images, int(counts.max())), -1, dtype=torch.int64, device=rows.device)
    found[of_image, place] = rows
    return found


def _centred(boxes: Tensor, anchors: Anchors) -> Tensor:
    """(…, boxes, anchors) whether an anchor's centre lies in a box (…, boxes, 4).

    A box narrower than the stride counts as wide as the stride: every object, a thin crack too, has a cell on every
    level.
    """
    middles = (boxes[..., None, :2] + boxes[..., None, 2:]) / 2
    halves = torch.maximum((boxes[..., None, 2:] - boxes[..., None, :2]) / 2, anchors.strides[:, None] / 2)
    return ((anchors.centres - middles).abs() <= halves).all(dim=-1)


@torch.no_grad()
def uncounted(anchors: Anchors, targets: Targets) -> Tensor:
    """(batch, anchors, classes) bool: where a class's score has neither loss nor reward, unless an object is assigned.

    That is in ignored regions of the class, and in images in which objects of the class are not labelled.
    """
    batch, classes = targets.known.shape
    rows = targets.ignored
    inside = _centred(targets.boxes[rows], anchors).float()
    covered = torch.zeros(batch * classes, len(anchors.strides), device=inside.device)
    covered.index_add_(0, targets.images[rows] * classes + targets.classes[rows], inside)
    ignored = (covered > 0).view(batch, classes, -1).transpose(1, 2)
    return ignored | ~targets.known[:, None, :]


def iou(boxes: Tensor, others: Tensor) -> Tensor:
    """Intersection over union of boxes (…, 4), which are broadcast against each other."""
    inner = intersection(boxes, others)
    return inner / (area(boxes) + area(others) - inner).clamp(min=_TINY)


def intersection(boxes: Tensor, others: Tensor) -> Tensor:
    """Area that boxes (…, 4) share."""
    low = torch.maximum(boxes[..., :2], others[..., :2])
    high = torch.minimum(boxes[..., 2:], others[..., 2:])
    return (high - low).clamp(min=0).prod(dim=-1)


def area(boxes: Tensor) -> Tensor:
    """Of boxes (…, 4)."""
    return (boxes[..., 2:] - boxes[..., :2]).clamp(min=0).prod(dim=-1)
