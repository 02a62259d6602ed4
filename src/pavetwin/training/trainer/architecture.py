"""What a network is made of, as a value: it names the network in run folders and checkpoints."""

from dataclasses import asdict, dataclass, fields
from math import ceil
from typing import Any, Final

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.perception.classes import COARSE

REG_MAX: Final = 16
"""Bins of the distribution of each side's distance; a box reaches at most 15 strides from its anchor."""

FINE_STRIDE: Final = 4
"""Of the level that `p2` adds."""

ACTIVATIONS: Final = ("silu", "relu")

_CHANNEL_STEP: Final = 8
"""Numbers of channels are multiples of it."""


@dataclass(frozen=True, slots=True)
class Architecture:
    """Width, depth and parts of a network of the YOLOv8 family."""

    depth: float = 0.33
    """Multiple of the numbers of blocks."""
    width: float = 0.25
    """Multiple of the numbers of channels."""
    most_channels: int = 1024
    """Of any map, before the multiple of `width`."""
    p2: bool = False
    """A fourth detection level of stride 4, for what is small: thin cracks, and persons far ahead of a car."""
    activation: str = "silu"
    """`silu`, or `relu`, which int8 runs faster."""
    masks: bool = True
    """Whether there is a mask head."""
    mask_points: int = 14
    """Sampling points of ROIAlign along each side of a box: 14, or 7 as the subtype head alone needs. The mask has
    twice as many pixels."""
    classes: int = len(COARSE)
    """Of the detection head."""

    def __post_init__(self) -> None:
        """Raises:
        PaveTwinError: a value is out of its range.
        """
        if self.activation not in ACTIVATIONS:
            raise PaveTwinError(no_such("activation", self.activation, ACTIVATIONS, key="`activation`"))
        for name, low, high in (("depth", 0.01, 2.0), ("width", 0.03, 2.0), ("most_channels", 64, 2048)):
            value = getattr(self, name)
            if not low <= value <= high:
                raise PaveTwinError(f"`{name}` {value}: it must be from {low} to {high}.")
        if self.mask_points not in (7, 14, 28):
            raise PaveTwinError(f"`mask_points` {self.mask_points}: it must be 7, 14 or 28.")

    @property
    def strides(self) -> tuple[int, ...]:
        """Of the detection levels, in pixels. Stride 4 is last, so that the others' weights are named as without it."""
        return (8, 16, 32, FINE_STRIDE) if self.p2 else (8, 16, 32)

    @property
    def mask_px(self) -> int:
        """Side of a mask."""
        return 2 * self.mask_points

    def channels(self, base: int) -> int:
        """Channels of a map that has `base` at width 1."""
        return ceil(min(base, self.most_channels) * self.width / _CHANNEL_STEP) * _CHANNEL_STEP

    def blocks(self, base: int) -> int:
        """Number of blocks where there are `base` at depth 1."""
        return max(round(base * self.depth), 1)

    def as_mapping(self) -> dict[str, Any]:
        """As JSON and checkpoints hold it."""
        return asdict(self)

    def difference(self, other: "Architecture") -> str:
        """The first value in which two architectures differ, as `width 0.25, not 0.5`; empty where none does."""
        for field in fields(self):
            mine, others = getattr(self, field.name), getattr(other, field.name)
            if mine != others:
                return f"{field.name} {mine}, not {others}"
        return ""


VARIANTS: Final = {
    "n": {"depth": 0.33, "width": 0.25, "most_channels": 1024},
    "s": {"depth": 0.33, "width": 0.50, "most_channels": 1024},
    "m": {"depth": 0.67, "width": 0.75, "most_channels": 768},
    "l": {"depth": 1.0, "width": 1.00, "most_channels": 512},
}
"""The published sizes."""


def variant(name: str, **others: Any) -> Architecture:
    """A published size, with other values than its defaults.

    Raises:
        PaveTwinError: there is no such size, or a value is out of its range.
    """
    if name not in VARIANTS:
        raise PaveTwinError(no_such("size", name, VARIANTS, key="`size`"))
    return Architecture(**{**VARIANTS[name], **others})
