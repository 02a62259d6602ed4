"""L_total = L_det + α · L_subtype + μ · L_mask.

L_det is a weighted sum of three parts, each a sum over anchors divided by the sum of target scores:
complete IoU (Zheng et al. 2020) and distribution focal loss (Li et al. 2020) of the anchors that learn an object, and
binary cross-entropy of the class scores of all anchors. L_subtype is the cross-entropy over regions of defects only.
L_mask is binary cross-entropy plus Dice loss over the regions whose mask is known.
"""

from dataclasses import dataclass
from math import pi
from typing import Final

import torch
from torch import Tensor
from torch.nn import functional

from pavetwin.training.trainer.architecture import REG_MAX
from pavetwin.training.trainer.assignment import assign, iou, uncounted
from pavetwin.training.trainer.network import Anchors, Encoded
from pavetwin.training.trainer.options import LossWeights
from pavetwin.training.trainer.targets import Targets

_EPS: Final = 1e-7


@dataclass(frozen=True, slots=True)
class Losses:
    """The parts, not weighted yet; each a scalar."""

    box: Tensor
    classes: Tensor
    distribution: Tensor
    subtype: Tensor
    mask: Tensor

    def total(self, weights: LossWeights) -> Tensor:
        """L_total."""
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
    """Distribution focal loss: cross-entropy with the two bins beside the true distance, by their nearness to it.

    Args:
        logits: (n, 4, `REG_MAX`).
        reach: (n, 4) in strides; what is out of the bins' reach is clipped.

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
    """IoU less the squared distance of the centres, as a share of the enclosing box's squared diagonal, and less the
    difference of the aspect ratios (Zheng et al. 2020). Boxes are (n, 4).

    Not that of torchvision, whose gradient is not a number where a predicted box has no height.
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
    """Angle of a box's diagonal, from vertical."""
    width, height = (boxes[:, 2:] - boxes[:, :2]).unbind(dim=1)
    return torch.atan(width / (height + _EPS))


def subtype_loss(logits: Tensor, subtypes: Tensor) -> Tensor:
    """Mean cross-entropy over the regions whose subtype is known; 0 where there is none.

    Args:
        logits: (regions, subtypes).
        subtypes: (regions,), −1 where it is not known.
    """
    known = subtypes >= 0
    if not known.any():
        return logits.sum() * 0.0
    return functional.cross_entropy(logits[known].float(), subtypes[known])


def mask_loss(logits: Tensor, masks: Tensor, has_mask: Tensor) -> Tensor:
    """Mean over the regions with a mask of binary cross-entropy plus 1 − Dice coefficient; 0 where there is none.

    Args:
        logits: (regions, pixels, pixels).
        masks: as large, in 0 … 1.
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
