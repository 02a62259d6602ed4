"""Decoded pictures, kept in memory from epoch to epoch: decoding is most of the work of making a view."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_start_method
from typing import Final, Self

import numpy as np
from PIL import Image

from pavetwin.arrays import UInt8Array
from pavetwin.training.datasets.examples import SPLITS_USED, Example, ExampleSet

GIGABYTE: Final = 10**9


def is_inherited() -> bool:
    """Whether processes that are started here share what is in memory, instead of getting copies of it."""
    return get_start_method() == "fork"


@dataclass(frozen=True)
class HeldExampleSet(ExampleSet):
    """A dataset that decodes each picture once, as far as there is room.

    The pictures that came first stay. To drop the one used longest ago would keep none of use where every epoch shows
    each picture once and not all have room.
    """

    most_bytes: int
    splits: tuple[str, ...] = SPLITS_USED
    """Of the pictures that `hold` decodes."""
    _held: dict[str | tuple[int, int], UInt8Array] = field(default_factory=dict, compare=False, repr=False)

    @classmethod
    def of(cls, data: ExampleSet, most_bytes: int, splits: Sequence[str] = SPLITS_USED) -> Self:
        """The same dataset."""
        return cls(data.path, data.fingerprint, data.examples, most_bytes, tuple(splits))

    @property
    def held_bytes(self) -> int:
        """Room that the pictures take."""
        return sum(each.nbytes for each in self._held.values())

    def picture(self, example: Example) -> Image.Image:
        """The picture, in RGB.

        Raises:
            PaveTwinError: it cannot be read, or is not as large as its labels say.
        """
        if (known := self._held.get(example.place)) is not None:
            return Image.fromarray(known)
        picture = super().picture(example)
        if self.held_bytes + 3 * picture.width * picture.height <= self.most_bytes:
            self._held[example.place] = np.asarray(picture)
        return picture

    def hold(self, threads: int) -> None:
        """Decode what there is room for now, so that processes that are forked from here have it.

        Raises:
            PaveTwinError: as `picture`.
        """
        room, chosen = self.most_bytes, []
        for example in self.examples:
            if example.split not in self.splits:
                continue
            room -= 3 * example.size_px[0] * example.size_px[1]
            if room < 0:
                break
            chosen.append(example)
        with ThreadPoolExecutor(threads) as pool:
            for example, picture in zip(chosen, pool.map(super().picture, chosen), strict=True):
                self._held[example.place] = np.asarray(picture)
