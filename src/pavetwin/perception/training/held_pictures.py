"""Decoded pictures, kept in memory from epoch to epoch: decoding is most of the work of making a view."""

from dataclasses import dataclass, field
from typing import Final, Self

import numpy as np
from PIL import Image

from pavetwin.arrays import UInt8Array
from pavetwin.perception.examples.example import Example, ExampleSet

MOST_BYTES: Final = 2 * 10**9
"""Of the pictures of one dataset that are kept: about 2,500 of 512 × 512."""


@dataclass(frozen=True)
class HeldExampleSet(ExampleSet):
    """A dataset that decodes each picture once, as far as there is room.

    The pictures that came first stay. To drop the one used longest ago would keep none of use where every epoch shows
    each picture once and not all have room.
    """

    most_bytes: int = MOST_BYTES
    _held: dict[str | tuple[int, int], UInt8Array] = field(default_factory=dict, compare=False, repr=False)

    @classmethod
    def of(cls, data: ExampleSet) -> Self:
        """The same dataset."""
        return cls(data.path, data.fingerprint, data.examples)

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
