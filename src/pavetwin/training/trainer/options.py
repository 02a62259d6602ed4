"""Options of a training, and settings of the machine that do not affect its result."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from math import inf
from typing import Any, Final, Self

from pavetwin.errors import PaveTwinError, nearest_name, no_such
from pavetwin.labels.class_names import COARSE_LABELS, SUBTYPE_LABELS
from pavetwin.training.network.architecture import Architecture, LossWeights, variant
from pavetwin.training.trainer.views import ViewOptions

ORDERS: Final = ("real-synthetic", "synthetic-real", "mixed", "real", "synthetic")
"""Stages of the detector: photographs, then synthetic images with some photographs; the reverse; both together with the
same share of photographs; or one of them alone."""


VIEWS: Final = ("processor", "device")  # Places where training views are drawn


def _about(text: str, default: Any, low: float | None = None, high: float | None = None) -> Any:
    return field(default=default, metadata={"about": text, "low": low, "high": high})


@dataclass(frozen=True, slots=True)
class TrainingOptions:
    """Options of a run: equal options, data and hardware give the same result."""

    size: str = _about("Published size: n, s, m or l.", "n")
    depth: float = _about("Multiplier of the numbers of blocks; 0: as the size.", 0.0, 0, 2)
    width: float = _about("Multiplier of the numbers of channels; 0: as the size.", 0.0, 0, 2)
    activation: str = _about("silu or relu.", "silu")
    masks: bool = _about("Whether there is a mask head.", default=True)
    mask_points: int = _about("Sampling points along each side of a region: 7, 14 or 28.", 14)
    image_px: int = _about("Side of the images that the network sees.", 640, 64, 2048)
    native: bool = _about("Crops at native resolution from larger images, instead of the whole image.", default=False)
    order: str = _about("Stages: " + ", ".join(ORDERS) + ".", "real-synthetic")
    replay: float = _about(
        "Share of the other kind's images in an epoch of the second stage, or of `mixed`.", 0.25, 0, 0.9
    )
    skip_first: bool = _about("Skip the first of two stages, for weights that have been through it.", default=False)
    without: str = _about("Classes that may be missing from the data, separated by commas.", "")
    epochs: int = _about("Epochs of the detector in each stage.", 40, 0, 10_000)
    repeats: int = _about("Views of each image in an epoch.", 1, 1, 10_000)
    classifier_epochs: int = _about("Final epochs of the subtype and mask heads alone.", 10, 0, 10_000)
    batch: int = _about("Images of a step.", 16, 1, 4096)
    rate: float = _about("Greatest learning rate; the default suits a batch of 16.", 1e-3, 0, 1)
    final_rate: float = _about("Last learning rate, as a share of the greatest.", 0.01, 0, 1)
    warmup_epochs: float = _about("Epochs in which the rate rises.", 3.0, 0, 100)
    weight_decay: float = _about("Weight decay of AdamW, for convolutions.", 5e-4, 0, 1)
    ema_decay: float = _about("Final decay of the moving average of the weights.", 0.9999, 0, 1)
    ema_steps: int = _about("Time constant of that decay, in steps.", 2000, 1, 1_000_000)
    patience: int = _about("Epochs without a better result after which a phase ends.", 20, 1, 10_000)
    mosaic: float = _about("Share of views made of four images.", 1.0, 0, 1)
    mosaic_off: int = _about("Last epochs of each stage without mosaics.", 10, 0, 10_000)
    scale: float = _about("Scales vary from 1 − this to 1 + this.", 0.5, 0, 0.9)
    mirror: float = _about("Share of images mirrored left to right.", 0.5, 0, 1)
    upside_down: float = _about("Share of images mirrored top to bottom, except those from a car.", 0.0, 0, 1)
    hue: float = _about("Hues turn by at most this share of a circle.", 0.015, 0, 0.5)
    saturation: float = _about("Saturations vary by at most this share.", 0.7, 0, 1)
    brightness: float = _about("Brightnesses vary by at most this share.", 0.4, 0, 1)
    subtype_weight: float = _about("α of L_total.", 1.0, 0, 100)
    mask_weight: float = _about("μ of L_total; 0 trains no masks.", 1.0, 0, 100)
    seed: int = _about("Random seed; 0 is valid.", 0, 0, 2**31)

    def __post_init__(self) -> None:
        """Raises:
        PaveTwinError: a value is out of its range.
        """
        for each in fields(self):
            low, high, value = each.metadata["low"], each.metadata["high"], getattr(self, each.name)
            if low is not None and not low <= value <= high:
                raise PaveTwinError(f"`{each.name}` {value:g}: it must be from {low:g} to {high:g}.")
        if self.order not in ORDERS:
            raise PaveTwinError(no_such("order", self.order, ORDERS, key="`order`"))
        if self.image_px % 32:
            raise PaveTwinError(f"`image_px` {self.image_px}: it must be a multiple of 32.")
        known = (*SUBTYPE_LABELS, *COARSE_LABELS[1:])
        for name in self.without_classes:
            if name not in known:
                raise PaveTwinError(no_such("class", name, known, key="`without`"))
        _ = self.architecture

    @property
    def architecture(self) -> Architecture:
        given = {"depth": self.depth, "width": self.width}
        others = {name: value for name, value in given.items() if value}
        return variant(
            self.size,
            activation=self.activation,
            masks=self.masks,
            mask_points=self.mask_points,
            **others,
        )

    @property
    def without_classes(self) -> frozenset[str]:
        return frozenset(filter(None, (name.strip() for name in self.without.split(","))))

    @property
    def weights(self) -> LossWeights:
        return LossWeights(subtype=self.subtype_weight, mask=self.mask_weight)

    def views(self, *, mosaic: bool) -> ViewOptions:
        """Augmentation of training images."""
        return ViewOptions(
            size_px=self.image_px,
            native=self.native,
            mosaic=self.mosaic if mosaic else 0.0,
            scale=self.scale,
            mirror=self.mirror,
            upside_down=self.upside_down,
            hue=self.hue,
            saturation=self.saturation,
            brightness=self.brightness,
        )

    def as_mapping(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def parse(cls, values: Iterable[str] | Mapping[str, Any]) -> Self:
        """Options from `name=value` texts, or from a mapping.

        Raises:
            PaveTwinError: a name is unknown, or a value is invalid.
        """
        if not isinstance(values, Mapping):
            pairs = [text.partition("=") for text in values]
            for name, equals, _ in pairs:
                if not equals:
                    raise PaveTwinError(f"`overrides`: '{name}' is not a setting; give name=value, such as epochs=20.")
            values = {name.strip(): text.strip() for name, _, text in pairs}
        kinds = {each.name: type(each.default) for each in fields(cls)}
        for name in values:
            if name not in kinds:
                raise PaveTwinError(
                    f"`overrides`: no setting '{name}'{nearest_name(name, kinds)}; known are {', '.join(kinds)}."
                )
        return cls(**{name: _value(name, value, kinds[name]) for name, value in values.items()})


def _value(name: str, value: Any, kind: type) -> Any:
    """Convert a text to the type of its setting."""
    if not isinstance(value, str) or kind is str:
        return value
    if kind is bool:
        if value.lower() in ("true", "false"):
            return value.lower() == "true"
        raise PaveTwinError(f"`overrides`: {name} takes true or false (got '{value}').")
    try:
        return kind(value)
    except ValueError:
        what = "a whole number" if kind is int else "a number"
        raise PaveTwinError(f"`overrides`: {name} takes {what} (got '{value}').") from None


@dataclass(frozen=True, slots=True)
class TrainingMachine:
    """Settings of the machine, which do not belong to the identity of a run."""

    device: str = ""
    """`cpu`, `cuda` or another device of torch; empty: a graphics card if there is one."""
    workers: int = 0
    """Processes that make views; 0 makes them in the main process."""
    held_gb: float = 2.0
    """Decoded images of each dataset kept in memory, in 10⁹ bytes; 2 hold about 2,500 images of 512 × 512."""
    views: str = ""
    """Place where views are drawn: `processor`, or `device`, which then holds all training images; empty: a graphics
    card with enough memory, otherwise the processor."""
    compiled: bool = False
    """Compile the network with `torch.compile`, which takes a minute at first."""
    half: bool = True
    """Mixed precision (bfloat16) on graphics cards that support it, and on processors with AMX or AVX-512 BF16."""

    def __post_init__(self) -> None:
        """Raises:
        PaveTwinError: the memory is negative or not finite, or there is no such place for views.
        """
        if not 0 <= self.held_gb < inf:
            raise PaveTwinError(f"`held_gb` {self.held_gb:g}: it must be 0 or more, and finite.")
        if self.views not in ("", *VIEWS):
            raise PaveTwinError(no_such("place", self.views, VIEWS, key="`views`"))
