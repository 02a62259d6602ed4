"""What a batch of images should give: boxes, regions whose subtype and mask are known, and what does not count."""

from dataclasses import dataclass, fields, replace
from typing import Self

import torch
from torch import Tensor


@dataclass(frozen=True, slots=True)
class Targets:
    """The labels of a batch. Boxes are left, top, right, bottom in pixels of the images."""

    boxes: Tensor
    """(objects, 4) float32."""
    classes: Tensor
    """(objects,) int64, coarse."""
    images: Tensor
    """(objects,) int64 index of the image in the batch."""
    ignored: Tensor
    """(objects,) bool: neither an object of its class nor background."""
    known: Tensor
    """(batch, classes) bool: whether objects of the class are labelled in the image at all."""
    regions: Tensor
    """(regions, 5) float32: index of the image, and a box near a defect's own."""
    subtypes: Tensor
    """(regions,) int64; −1 where it is not known."""
    masks: Tensor
    """(regions, pixels, pixels) float32 in 0 … 1: the share of each pixel that the defect covers, in the region."""
    has_mask: Tensor
    """(regions,) bool."""

    def to(self, device: torch.device) -> Self:
        """On another device."""
        moved = {each.name: getattr(self, each.name).to(device, non_blocking=True) for each in fields(self)}
        return replace(self, **moved)


def no_targets(images: int, classes: int, mask_px: int) -> Targets:
    """Of images that show nothing."""
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
