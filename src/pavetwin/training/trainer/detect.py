"""From what the network says to detections: suppression of duplicates, then subtype and mask of defects."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torchvision.ops import batched_nms

from pavetwin.perception.classes import ROAD_DEFECT, SUBTYPES
from pavetwin.training.trainer.network import DetectorNetwork, Encoded


@dataclass(frozen=True, slots=True)
class DetectLimits:
    """What is kept."""

    confidence: float = 0.25
    """The least score of the coarse class."""
    overlap: float = 0.7
    """IoU from which the less confident of two boxes of a coarse class is dropped."""
    candidates: int = 3000
    """Boxes of an image before duplicates are dropped, the most confident ones."""
    most: int = 300
    """Boxes of an image."""


@dataclass(frozen=True, slots=True)
class ImageDetections:
    """Of one image, the most confident first."""

    boxes: Tensor
    """(n, 4) left, top, right, bottom in pixels, within the image."""
    coarse: Tensor
    """(n,) int64."""
    detection: Tensor
    """(n,) score of the coarse class, 0 … 1."""
    subtypes: Tensor
    """(n, 3) probabilities of a defect's subtypes; 0 for others."""
    masks: Tensor | None
    """(n, pixels, pixels) probabilities within the box; 0 for what is no defect. None without a mask head, or where
    masks were not asked for."""

    @property
    def classes(self) -> Tensor:
        """(n,) the most probable number in `CLASSES`."""
        is_defect = self.coarse == ROAD_DEFECT
        return torch.where(is_defect, self.subtypes.argmax(dim=1), self.coarse + len(SUBTYPES) - 1)

    @property
    def confidence(self) -> Tensor:
        """(n,) detection × subtype confidence for defects, detection confidence for others."""
        return torch.where(self.coarse == ROAD_DEFECT, self.subtypes.amax(dim=1), 1.0) * self.detection


@torch.no_grad()
def detect(
    network: DetectorNetwork, images: Tensor, limits: DetectLimits, *, masks: bool = True
) -> list[ImageDetections]:
    """The detections of each image of a batch (batch, 3, height, width) in 0 … 1; the network is in `eval` mode.

    Args:
        masks: whether masks of defects are drawn, where there is a head for them.
    """
    encoded = network(images)
    size = torch.tensor([images.shape[3], images.shape[2]] * 2, device=images.device, dtype=torch.float32)
    return [_of_image(network, encoded, image, size, limits, masks=masks) for image in range(len(images))]


def _of_image(
    network: DetectorNetwork, encoded: Encoded, image: int, size: Tensor, limits: DetectLimits, *, masks: bool
) -> ImageDetections:
    boxes = encoded.boxes[image].clamp(min=0).minimum(size)
    scores = encoded.scores[image].float().sigmoid()
    anchor, coarse = torch.nonzero(scores >= limits.confidence, as_tuple=True)
    order = scores[anchor, coarse].argsort(descending=True, stable=True)[: limits.candidates]
    anchor, coarse = anchor[order], coarse[order]
    found, confident = boxes[anchor], scores[anchor, coarse]
    kept = batched_nms(found, confident, coarse, limits.overlap)[: limits.most]
    found, coarse, confident = found[kept], coarse[kept], confident[kept]
    defect = torch.nonzero(coarse == ROAD_DEFECT).squeeze(1)
    regions = torch.cat([torch.full_like(found[defect, :1], image), found[defect]], dim=1)
    logits, mask_logits = network.regions(encoded.maps, regions, masks=masks)
    subtypes = found.new_zeros(len(found), len(SUBTYPES))
    subtypes[defect] = logits.float().softmax(dim=1)
    drawn = None
    if mask_logits is not None:
        drawn = found.new_zeros(len(found), *mask_logits.shape[1:])
        drawn[defect] = mask_logits.float().sigmoid()
    return ImageDetections(found, coarse, confident, subtypes, drawn)
