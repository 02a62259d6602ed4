"""Targets, their assignment to anchors, and losses: L_total = L_det + α · L_subtype + μ · L_mask.

L_det is a weighted sum of three parts, each a sum over anchors divided by the sum of target scores:
complete IoU (Zheng et al. 2020) and distribution focal loss (Li et al. 2020) of the anchors that learn an object, and
binary cross-entropy of the class scores of all anchors. L_subtype is the cross-entropy over regions of defects only.
L_mask is binary cross-entropy plus Dice loss over the regions whose mask is known."""

from dataclasses import dataclass, fields, replace
from math import pi
from typing import Final, Self

import torch
from torch import Tensor
from torch.nn import functional

from pavetwin.training.network.architecture import REG_MAX, LossWeights
from pavetwin.training.network.network import Anchors, Encoded


@dataclass(frozen=True, slots=True)
class Targets:
    """Labels of a batch. Boxes are left, top, right, bottom in pixels of the images."""

    boxes: Tensor
    """(objects, 4) float32."""
    classes: Tensor
    """(objects,) int64 coarse class."""
    images: Tensor
    """(objects,) int64 index of the image in the batch."""
    ignored: Tensor
    """(objects,) bool: counts neither as an object of its class nor as background."""
    known: Tensor
    """(batch, classes) bool: whether the image's source labels the class."""
    regions: Tensor
    """(regions, 5) float32: index of the image, and a box near a defect's own."""
    subtypes: Tensor
    """(regions,) int64; −1 where unknown."""
    masks: Tensor
    """(regions, pixels, pixels) float32 in 0 … 1: share of each pixel of the region that the defect covers."""
    has_mask: Tensor
    """(regions,) bool."""

    def to(self, device: torch.device) -> Self:
        moved = {each.name: getattr(self, each.name).to(device, non_blocking=True) for each in fields(self)}
        return replace(self, **moved)


def no_targets(images: int, classes: int, mask_px: int) -> Targets:
    """Targets of images without labelled objects."""
    return Targets(
        boxes=torch.zeros(0, 4),
        classes=torch.zeros(0, dtype=torch.int64),
        images=torch.zeros(0, dtype=torch.int64),
        ignored=torch.zeros(0, dtype=torch.bool),
        known=torch.ones(images, classes, dtype=torch.bool),
        regions=torch.zeros(0, 5),
        subtypes=torch.zeros(0, dtype=torch.int64),
        masks=torch.zeros(0, mask_px, mask_px),
        has_mask=torch.zeros(0, dtype=torch.bool),
    )


MOST_ANCHORS: Final = 10  # Maximum anchors that learn one object
ALPHA: Final = 0.5
BETA: Final = 6.0

_TINY: Final = 1e-30


@dataclass(frozen=True, slots=True)
class Assignment:
    """Target of each anchor."""

    objects: Tensor
    """(batch, anchors) int64 row of `Targets.boxes`; −1 for background."""
    scores: Tensor
    """(batch, anchors) float32 target score of the object's class; 0 for background."""


@torch.no_grad()
def assign(scores: Tensor, boxes: Tensor, anchors: Anchors, targets: Targets) -> Assignment:
    """Assign anchors to objects (task-aligned assignment; Feng et al. 2021, TOOD).

    The alignment of an anchor with an object is s^α · u^β, with s the score of the object's class and u the IoU of the
    anchor's predicted box. The best-aligned anchors inside an object learn it. Their target score is their alignment,
    scaled within the object so that the greatest equals the object's greatest IoU. Ignored objects get no anchors.

    Args:
        scores: (batch, anchors, classes) in 0 … 1.
        boxes: (batch, anchors, 4) predicted, in pixels.
    """
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
    # An anchor chosen by several objects learns the one with the greatest overlap.
    contested = torch.where(chosen, overlap, -1.0)
    greatest, owner = contested.max(dim=1)
    is_object = greatest >= 0
    own = torch.zeros_like(chosen).scatter_(1, owner[:, None], is_object[:, None])
    strongest = torch.where(own, alignment, 0.0).amax(dim=2, keepdim=True)
    reached = torch.where(own, overlap, 0.0).amax(dim=2, keepdim=True)
    target = torch.where(own, alignment * (reached / strongest.clamp(min=_TINY)), 0.0).sum(dim=1)
    return Assignment(torch.where(is_object, rows.gather(1, owner), -1), target)


def _by_image(targets: Targets, images: int) -> Tensor:
    """(batch, greatest number of objects in an image) rows of objects that are not ignored, padded with −1."""
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

    Boxes narrower than the stride count as one stride wide, so that every object has a cell on every level.
    """
    middles = (boxes[..., None, :2] + boxes[..., None, 2:]) / 2
    halves = torch.maximum((boxes[..., None, 2:] - boxes[..., None, :2]) / 2, anchors.strides[:, None] / 2)
    return ((anchors.centres - middles).abs() <= halves).all(dim=-1)


@torch.no_grad()
def uncounted(anchors: Anchors, targets: Targets) -> Tensor:
    """(batch, anchors, classes) bool: scores without a loss, unless an object is assigned.

    These lie in ignored regions of the class, and in images whose source does not label the class.
    """
    batch, classes = targets.known.shape
    rows = targets.ignored
    inside = _centred(targets.boxes[rows], anchors).float()
    covered = torch.zeros(batch * classes, len(anchors.strides), device=inside.device)
    covered.index_add_(0, targets.images[rows] * classes + targets.classes[rows], inside)
    ignored = (covered > 0).view(batch, classes, -1).transpose(1, 2)
    return ignored | ~targets.known[:, None, :]


def iou(boxes: Tensor, others: Tensor) -> Tensor:
    """Intersection over union of boxes (…, 4), broadcast against each other."""
    inner = intersection(boxes, others)
    return inner / (area(boxes) + area(others) - inner).clamp(min=_TINY)


def intersection(boxes: Tensor, others: Tensor) -> Tensor:
    """Shared area of boxes (…, 4)."""
    low = torch.maximum(boxes[..., :2], others[..., :2])
    high = torch.minimum(boxes[..., 2:], others[..., 2:])
    return (high - low).clamp(min=0).prod(dim=-1)


def area(boxes: Tensor) -> Tensor:
    """Area of boxes (…, 4)."""
    return (boxes[..., 2:] - boxes[..., :2]).clamp(min=0).prod(dim=-1)


_EPS: Final = 1e-7


@dataclass(frozen=True, slots=True)
class Losses:
    """Unweighted parts of the loss, each a scalar."""

    box: Tensor
    classes: Tensor
    distribution: Tensor
    subtype: Tensor
    mask: Tensor

    def total(self, weights: LossWeights) -> Tensor:
        return (
            weights.box * self.box
            + weights.classes * self.classes
            + weights.distribution * self.distribution
            + weights.subtype * self.subtype
            + weights.mask * self.mask
        )


def detection_losses(encoded: Encoded, targets: Targets) -> tuple[Tensor, Tensor, Tensor]:
    """Box, class and distribution parts of L_det."""
    scores, boxes, anchors = encoded.scores.float(), encoded.boxes, encoded.anchors
    assigned = assign(scores.sigmoid(), boxes, anchors, targets)
    weight = assigned.scores.sum().clamp(min=1.0)
    is_object = assigned.objects >= 0
    image, anchor = torch.nonzero(is_object, as_tuple=True)
    rows = assigned.objects[image, anchor]
    share = assigned.scores[image, anchor]

    wanted = torch.zeros_like(scores)
    wanted[image, anchor, targets.classes[rows]] = share
    counted = ~uncounted(anchors, targets)
    counted[image, anchor, targets.classes[rows]] = True
    each = functional.binary_cross_entropy_with_logits(scores, wanted, reduction="none")
    classes = (each * counted).sum() / weight

    found, goal = boxes[image, anchor], targets.boxes[rows]
    box = ((1 - complete_iou(found, goal)) * share).sum() / weight
    spread = distribution_loss(encoded.distances[image, anchor].float(), _reach(anchors, anchor, goal))
    return box, classes, (spread * share).sum() / weight


def _reach(anchors: Anchors, anchor: Tensor, boxes: Tensor) -> Tensor:
    """(n, 4) distances from anchors to the sides of boxes, in strides."""
    centres, strides = anchors.centres[anchor], anchors.strides[anchor][:, None]
    return torch.cat([centres - boxes[:, :2], boxes[:, 2:] - centres], dim=1) / strides


def distribution_loss(logits: Tensor, reach: Tensor) -> Tensor:
    """Distribution focal loss: cross-entropy with the two bins next to the true distance, weighted by proximity.

    Args:
        logits: (n, 4, `REG_MAX`).
        reach: (n, 4) in strides, clipped to the range of the bins.

    Returns:
        (n,) mean over the four sides.
    """
    reach = reach.clamp(0, REG_MAX - 1 - 0.01)
    below = reach.floor()
    share = reach - below
    logs = logits.log_softmax(dim=-1)
    low = logs.gather(-1, below.long().unsqueeze(-1)).squeeze(-1)
    high = logs.gather(-1, below.long().unsqueeze(-1) + 1).squeeze(-1)
    return -(low * (1 - share) + high * share).mean(dim=-1)


def complete_iou(boxes: Tensor, goals: Tensor) -> Tensor:
    """Complete IoU of boxes (n, 4): IoU minus the squared distance of the centres, as a share of the enclosing box's
    squared diagonal, minus the difference of the aspect ratios (Zheng et al. 2020).

    The gradient of torchvision's version is NaN where a predicted box has no height.
    """
    overlap = iou(boxes, goals)
    low, high = torch.minimum(boxes[:, :2], goals[:, :2]), torch.maximum(boxes[:, 2:], goals[:, 2:])
    diagonal = (high - low).square().sum(dim=1) + _EPS
    apart = (boxes[:, :2] + boxes[:, 2:] - goals[:, :2] - goals[:, 2:]).square().sum(dim=1) / 4
    aspect = (4 / pi**2) * (_aspect(goals) - _aspect(boxes)).square()
    with torch.no_grad():
        weight = aspect / (1 - overlap + aspect + _EPS)
    return overlap - apart / diagonal - weight * aspect


def _aspect(boxes: Tensor) -> Tensor:
    """Angle between a box's diagonal and the vertical, in radians."""
    width, height = (boxes[:, 2:] - boxes[:, :2]).unbind(dim=1)
    return torch.atan(width / (height + _EPS))


def subtype_loss(logits: Tensor, subtypes: Tensor) -> Tensor:
    """Mean cross-entropy over the regions with a known subtype; 0 without any.

    Args:
        logits: (regions, subtypes).
        subtypes: (regions,), −1 where unknown.
    """
    known = subtypes >= 0
    if not known.any():
        return logits.sum() * 0.0
    return functional.cross_entropy(logits[known].float(), subtypes[known])


def mask_loss(logits: Tensor, masks: Tensor, has_mask: Tensor) -> Tensor:
    """Binary cross-entropy plus 1 − Dice coefficient, mean over the regions with a mask; 0 without any.

    Args:
        logits: (regions, pixels, pixels).
        masks: of the same shape, in 0 … 1.
        has_mask: (regions,) bool.
    """
    if not has_mask.any():
        return logits.sum() * 0.0
    logits, masks = logits[has_mask].float(), masks[has_mask]
    entropy = functional.binary_cross_entropy_with_logits(logits, masks)
    shares = logits.sigmoid().flatten(1)
    wanted = masks.flatten(1)
    dice = 2 * (shares * wanted).sum(dim=1) / (shares.sum(dim=1) + wanted.sum(dim=1) + 1.0)
    return entropy + (1 - dice).mean()
