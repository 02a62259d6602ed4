"""Batches for training and validation.

What a view shows depends on (seed, phase, epoch, index) alone, so that it is the same whichever process makes it and
wherever a run was stopped.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, default_collate

from pavetwin.arrays import UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import FloatBox
from pavetwin.perception.classes import COARSE, NO_SUBTYPE, ROAD_DEFECT, class_of
from pavetwin.seeds import Stream, child
from pavetwin.training.datasets.examples import TrueObject
from pavetwin.training.trainer.augment import Member, Photometric, ViewOptions, planned_view, random_view
from pavetwin.training.trainer.device_pictures import Drawing, PictureRows, drawing_of, drawn_together
from pavetwin.training.trainer.targets import Targets
from pavetwin.training.trainer.views import ImagePart, ViewLabels, fitted, labels_of, mask_of, tiles, view_of

REGION_JITTER: Final = 0.05
"""Standard deviation of the edges of a region, as a share of its sides: in use it is a predicted box."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Images and what they should give."""

    images: Tensor | Drawing
    """(batch, 3, height, width) uint8; or how they are drawn on the device that holds the pictures."""
    targets: Targets
    final: Tensor
    """(objects,) int64 number in `CLASSES` of each of the targets' objects; −1 for a defect of no known subtype."""


@dataclass(frozen=True, slots=True)
class Labelled:
    """A view as numbers."""

    image: Tensor | Drawing
    """(3, height, width) uint8; or how it is drawn."""
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
    """The views of one epoch."""

    def __init__(
        self,
        members: Sequence[Member],
        order: Sequence[int],
        known: Mapping[str, frozenset[int]],
        options: ViewOptions,
        mask_px: int,
        key: tuple[int, ...],
        photometric: Sequence[Photometric] = (),
        held: PictureRows | None = None,
    ) -> None:
        """Args:
        order: the members in the order of the epoch.
        key: seed, phase and epoch.
        held: where the device holds the pictures; then views are drawn there, and `photometric` is empty.
        """
        self._members, self._order, self._known = members, order, known
        self._options, self._mask_px, self._key, self._photometric = options, mask_px, key, photometric
        self._held = held

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
        view = random_view(member, self._members, self._options, rng, self._photometric)
        return labelled(tensor_of(view.pixels), view.labels, self._known, self._mask_px, rng)


class ValidationViews(Dataset[Labelled]):
    """Whole images, or all tiles of them; nothing is random."""

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
    """A view as numbers.

    Args:
        known: source → coarse classes that it labels. A class counts in a view if all its images label it.
        rng: varies the regions; without it they are the boxes.
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
    """Views as a batch."""
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
    # In a process that makes views, this puts them where the training process reads them, without another copy.
    return default_collate(list(images))


def batches(
    views: Dataset[Labelled], size: int, *, first: int = 0, workers: int = 0, whole: bool = True
) -> Iterator[Batch]:
    """The batches of an epoch, from the `first` on.

    Args:
        workers: processes that make views; 0 makes them here.
        whole: leave out a last batch that is not full, unless it is the only one.
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
    yield from read(loader)


def read(loader: Iterable[Any]) -> Iterator[Any]:
    """What a loader gives; an error that one of its processes meets is told as here, without its traceback."""
    try:
        yield from loader
    except PaveTwinError as error:
        # The message of the process ends with the name and the message of its error.
        told = str(error).rstrip().rpartition(f"{PaveTwinError.__name__}: ")[2]
        raise PaveTwinError(told) from error
