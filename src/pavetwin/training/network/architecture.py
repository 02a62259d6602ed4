"""Architecture of the network, as stored in run folders, checkpoints and exported models, and weights of its losses."""

from dataclasses import asdict, dataclass, fields
from math import ceil
from typing import Any, Final

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.labels.class_names import COARSE

REG_MAX: Final = 16
"""Bins of the distribution of each side's distance; a box reaches at most 15 strides from its anchor."""

ACTIVATIONS: Final = ("silu", "relu")

_CHANNEL_STEP: Final = 8  # Channel counts are multiples of this number

STRIDES: Final = (8, 16, 32)
"""Strides of the detection levels, in pixels."""


@dataclass(frozen=True, slots=True)
class Architecture:
    """Width, depth and parts of a network of the YOLOv8 family."""

    depth: float = 0.33
    """Multiplier of the numbers of blocks."""
    width: float = 0.25
    """Multiplier of the numbers of channels."""
    most_channels: int = 1024
    """Maximum channels of a map, before multiplication by `width`."""
    activation: str = "silu"
    """`silu` or `relu`."""
    masks: bool = True
    """True with a mask head."""
    mask_points: int = 14
    """Sampling points of ROIAlign along each side of a box: 14 or 28, or 7, which is enough without masks. A mask has
    twice as many pixels along a side."""
    classes: int = len(COARSE)
    """Classes of the detection head."""

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
    def mask_px(self) -> int:
        """Side of a mask, in pixels."""
        return 2 * self.mask_points

    def channels(self, base: int) -> int:
        """Channels of a map with `base` channels at width 1."""
        return ceil(min(base, self.most_channels) * self.width / _CHANNEL_STEP) * _CHANNEL_STEP

    def blocks(self, base: int) -> int:
        """Blocks of a stage with `base` blocks at depth 1."""
        return max(round(base * self.depth), 1)

    def as_mapping(self) -> dict[str, Any]:
        return asdict(self)

    def difference(self, other: "Architecture") -> str:
        """The first field in which two architectures differ, as `width 0.25, not 0.5`; empty if they are equal."""
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
    """A published size with some values replaced.

    Raises:
        PaveTwinError: there is no such size, or a value is out of its range.
    """
    if name not in VARIANTS:
        raise PaveTwinError(no_such("size", name, VARIANTS, key="`size`"))
    return Architecture(**{**VARIANTS[name], **others})


@dataclass(frozen=True, slots=True)
class LossWeights:
    """Weights of the parts; the first three are those published for YOLOv8."""

    box: float = 7.5
    classes: float = 0.5
    distribution: float = 1.5
    subtype: float = 1.0
    """α"""
    mask: float = 1.0
    """μ; 0 trains no masks."""
