"""Batches for training and validation, and average precision on validation images.

A view depends on (seed, phase, epoch, index) only: it is the same in any process and after any interruption."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, default_collate

from pavetwin.arrays import Float64Array, UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import FloatBox
from pavetwin.labels.class_names import CLASSES, COARSE, NO_SUBTYPE, ROAD_DEFECT, class_of, coarse_of_classes
from pavetwin.seeds import Stream, child
from pavetwin.training.datasets.examples import TrueObject
from pavetwin.training.evaluation.matching import coco_row, judged, precision_of
from pavetwin.training.network.losses import Targets
from pavetwin.training.network.network import DetectLimits, DetectorNetwork, detect
from pavetwin.training.trainer.pictures import Drawing, PictureRows, drawing_of, drawn_together, images_of
from pavetwin.training.trainer.views import (
    ImagePart,
    Member,
    ViewLabels,
    ViewOptions,
    fitted,
    labels_of,
    mask_of,
    planned_view,
    random_view,
    tiles,
    view_of,
)

REGION_JITTER: Final = 0.05
"""Standard deviation of the edges of a training region, as a share of its sides, since regions in use are predicted."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Images and their targets."""

    images: Tensor | Drawing
    """(batch, 3, height, width) uint8, or instructions for drawing them on the device that holds the images."""
    targets: Targets
    final: Tensor
    """(objects,) int64 index into `CLASSES` of each of the targets' objects; −1 for a defect of unknown subtype."""


@dataclass(frozen=True, slots=True)
class Labelled:
    """Image and targets of one view, as in `Batch`."""

    image: Tensor | Drawing
    """(3, height, width) uint8, or drawing instructions."""
    boxes: Tensor
    classes: Tensor
    final: Tensor
    ignored: Tensor
    known: Tensor
    regions: Tensor
    """(regions, 4)"""
    region_subtypes: Tensor
    masks: Tensor
    has_mask: Tensor


class TrainingViews(Dataset[Labelled]):
    """Views of one epoch."""

    def __init__(
        self,
        members: Sequence[Member],
        order: Sequence[int],
        known: Mapping[str, frozenset[int]],
        options: ViewOptions,
        mask_px: int,
        key: tuple[int, ...],
        held: PictureRows | None = None,
    ) -> None:
        """Args:
        order: indices of the members in the order of the epoch.
        key: seed, phase and epoch.
        held: rows of the images on the device, if views are drawn there.
        """
        self._members, self._order, self._known = members, order, known
        self._options, self._mask_px, self._key, self._held = options, mask_px, key, held

    def __len__(self) -> int:
        return len(self._order)

    def __getitem__(self, index: int) -> Labelled:
        seed, *keys = self._key
        rng = child(seed, Stream.TRAINING, *keys, index)
        member = self._members[self._order[index]]
        if self._held is not None:
            plan = planned_view(member, self._members, self._options, rng)
            drawing = drawing_of(plan, self._held, self._options.size_px)
            return labelled(drawing, labels_of(plan.parts), self._known, self._mask_px, rng)
        view = random_view(member, self._members, self._options, rng)
        return labelled(tensor_of(view.pixels), view.labels, self._known, self._mask_px, rng)


class ValidationViews(Dataset[Labelled]):
    """Whole images or all of their tiles, without randomness."""

    def __init__(
        self, members: Sequence[Member], known: Mapping[str, frozenset[int]], options: ViewOptions, mask_px: int
    ) -> None:
        size = options.size_px
        self._parts: list[ImagePart] = []
        for data, example in members:
            is_cut = options.native and max(example.size_px) > size
            self._parts += tiles(data, example, size) if is_cut else [fitted(data, example, size)]
        self._known, self._size, self._mask_px = known, size, mask_px

    def __len__(self) -> int:
        return len(self._parts)

    def __getitem__(self, index: int) -> Labelled:
        view = view_of([self._parts[index]], self._size)
        return labelled(tensor_of(view.pixels), view.labels, self._known, self._mask_px, None)


def labelled(
    image: Tensor | Drawing,
    labels: ViewLabels,
    known: Mapping[str, frozenset[int]],
    mask_px: int,
    rng: np.random.Generator | None,
) -> Labelled:
    """Image and targets of a view.

    Args:
        known: source → coarse classes that it labels. A class counts in a view if all its sources label it.
        rng: varies the regions; without it they equal the boxes.
    """
    objects = labels.objects
    defects = [each for each in objects if each.true.coarse == ROAD_DEFECT and not each.is_ignored]
    regions = [_jittered(each.box, rng) for each in defects]
    masks = [mask_of(each, region, mask_px) for each, region in zip(defects, regions, strict=True)]
    blank = np.zeros((mask_px, mask_px), dtype=np.float32)
    sources = labels.sources
    return Labelled(
        image=image,
        boxes=_floats([each.box for each in objects], 4),
        classes=_whole([each.true.coarse for each in objects]),
        final=_whole([_final(each.true) for each in objects]),
        ignored=torch.tensor([each.is_ignored for each in objects], dtype=torch.bool),
        known=torch.tensor([all(at in known[source] for source in sources) for at in range(len(COARSE))]),
        regions=_floats(regions, 4),
        region_subtypes=_whole([each.true.subtype for each in defects]),
        masks=torch.from_numpy(
            np.array([blank if each is None else each for each in masks]).reshape(-1, mask_px, mask_px)
        ),
        has_mask=torch.tensor([each is not None for each in masks], dtype=torch.bool),
    )


def tensor_of(pixels: UInt8Array) -> Tensor:
    """Pixels (height, width, 3) as (3, height, width)."""
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1)))


def _final(true: TrueObject) -> int:
    found = class_of(true.coarse, true.subtype)
    return NO_SUBTYPE if found is None else found


def _jittered(box: FloatBox, rng: np.random.Generator | None) -> FloatBox:
    if rng is None:
        return box
    width, height = box[2] - box[0], box[3] - box[1]
    moved = np.array(box) + REGION_JITTER * rng.standard_normal(4) * (width, height, width, height)
    return float(moved[0]), float(moved[1]), float(max(moved[2], moved[0] + 1)), float(max(moved[3], moved[1] + 1))


def _floats(rows: Sequence[FloatBox], columns: int) -> Tensor:
    return torch.tensor(rows, dtype=torch.float32).reshape(-1, columns)


def _whole(values: Sequence[int]) -> Tensor:
    return torch.tensor(values, dtype=torch.int64)


def collated(views: Sequence[Labelled]) -> Batch:
    """Collate views into a batch."""
    counts = torch.tensor([len(each.boxes) for each in views])
    regions = [
        torch.cat([torch.full((len(each.regions), 1), float(at)), each.regions], dim=1) for at, each in enumerate(views)
    ]
    targets = Targets(
        boxes=torch.cat([each.boxes for each in views]),
        classes=torch.cat([each.classes for each in views]),
        images=torch.repeat_interleave(torch.arange(len(views)), counts),
        ignored=torch.cat([each.ignored for each in views]),
        known=torch.stack([each.known for each in views]),
        regions=torch.cat(regions),
        subtypes=torch.cat([each.region_subtypes for each in views]),
        masks=torch.cat([each.masks for each in views]),
        has_mask=torch.cat([each.has_mask for each in views]),
    )
    return Batch(_together([each.image for each in views]), targets, torch.cat([each.final for each in views]))


def _together(images: Sequence[Tensor | Drawing]) -> Tensor | Drawing:
    drawings = [each for each in images if isinstance(each, Drawing)]
    if drawings:
        return drawn_together(drawings)
    # In a worker process, this collates into shared memory without another copy.
    return default_collate(list(images))


def batches(
    views: Dataset[Labelled], size: int, *, first: int = 0, workers: int = 0, whole: bool = True
) -> Iterator[Batch]:
    """Batches of an epoch, from the `first` on.

    Args:
        workers: processes that make views; 0 makes them in this process.
        whole: omit an incomplete last batch, unless it is the only one.

    Raises:
        PaveTwinError: an image cannot be read, here or in a worker.
    """
    count = len(views)
    starts = range(0, count, size)
    groups = [list(range(start, min(start + size, count))) for start in starts]
    if whole and len(groups) > 1 and len(groups[-1]) < size:
        groups.pop()
    loader = DataLoader(
        views,
        batch_sampler=groups[first:],
        num_workers=workers,
        collate_fn=collated,
        pin_memory=torch.cuda.is_available(),
    )
    try:
        yield from loader
    except PaveTwinError as error:
        # The traceback of a worker ends with the name and the message of its error.
        raise PaveTwinError(str(error).rstrip().rpartition(f"{PaveTwinError.__name__}: ")[2]) from error


LIMITS = DetectLimits(confidence=0.001)
"""Limits of validation: average precision reads the whole curve."""


def validate(network: DetectorNetwork, batches: Iterable[Batch], device: torch.device) -> Float64Array:
    """(five classes, thresholds) average precision by the COCO protocol; NaN for a class without objects.

    Detections of classes that an image's source does not label are left out.
    """
    truth: list[dict[str, Any]] = []
    found: list[dict[str, Any]] = []
    images = 0
    for batch in batches:
        for at, each in enumerate(detect(network, images_of(batch.images, device), LIMITS, masks=False)):
            classes = each.classes.cpu().numpy()
            counted = batch.targets.known[at].numpy()[coarse_of_classes(classes)]
            rows = zip(classes.tolist(), each.boxes.double().tolist(), each.confidence.double().tolist(), strict=True)
            for is_counted, (number, box, confidence) in zip(counted.tolist(), rows, strict=True):
                if is_counted:
                    found.append({**coco_row(len(found) + 1, images, number, box), "score": confidence})
            for row in torch.nonzero(batch.targets.images == at).squeeze(1).tolist():
                number, box = int(batch.final[row]), batch.targets.boxes[row].double().tolist()
                is_ignored = bool(batch.targets.ignored[row])
                truth.append(coco_row(len(truth) + 1, images, number, box, is_ignored=is_ignored))
            images += 1
    judge = judged(truth, found, images, len(CLASSES))
    return precision_of(judge).T
