"""What a training depends on, as a value; and what only the machine decides."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from math import inf
from typing import Any, Final, Self

from pavetwin.errors import PaveTwinError, nearest_name, no_such
from pavetwin.perception.classes import COARSE, SUBTYPES
from pavetwin.training.trainer.architecture import Architecture, variant
from pavetwin.training.trainer.augment import ViewOptions

ORDERS: Final = ("real-synthetic", "synthetic-real", "mixed", "real", "synthetic")
"""Stages of the detector: photographs and then synthetic images with some photographs among them, the other way round,
both together with the same share of photographs, or one of them alone."""


VIEWS: Final = ("processor", "device")
"""Where training views are drawn."""


@dataclass(frozen=True, slots=True)
class LossWeights:
    """Of the parts; the first three are those of the published YOLOv8."""

    box: float = 7.5
    classes: float = 0.5
    distribution: float = 1.5
    subtype: float = 1.0
    """α"""
    mask: float = 1.0
    """μ; 0 trains no masks."""


def _about(text: str, default: Any, low: float | None = None, high: float | None = None) -> Any:
    return field(default=default, metadata={"about": text, "low": low, "high": high})


@dataclass(frozen=True, slots=True)
class TrainingOptions:
    """Two runs with the same options, data and hardware have the same result."""

    size: str = _about("Published size: n, s, m or l.", "n")
    depth: float = _about("Multiple of the numbers of blocks; 0 takes that of the size.", 0.0, 0, 2)
    width: float = _about("Multiple of the numbers of channels; 0 takes that of the size.", 0.0, 0, 2)
    p2: bool = _about("A fourth detection level of stride 4, for small objects.", default=False)
    activation: str = _about("silu or relu.", "silu")
    masks: bool = _about("Whether there is a mask head.", default=True)
    mask_points: int = _about("Sampling points along each side of a region: 7, 14 or 28.", 14)
    image_px: int = _about("Side of the images that the network sees.", 640, 64, 2048)
    native: bool = _about("Crops at native resolution from larger images, instead of the whole image.", default=False)
    order: str = _about("Stages: " + ", ".join(ORDERS) + ".", "real-synthetic")
    replay: float = _about(
        "Share of the other kind's images in an epoch of the second stage, or of `mixed`.", 0.25, 0, 0.9
    )
    skip_first: bool = _about("Leave the first of two stages out; for weights that have had it.", default=False)
    without: str = _about("Classes that the data need not have, with commas.", "")
    epochs: int = _about("Of the detector, in each stage.", 40, 0, 10_000)
    repeats: int = _about("How often an epoch shows each image.", 1, 1, 10_000)
    classifier_epochs: int = _about("Of the subtype and mask heads alone, afterwards.", 10, 0, 10_000)
    batch: int = _about("Images of a step.", 16, 1, 4096)
    rate: float = _about("Greatest learning rate; the default suits a batch of 16.", 1e-3, 0, 1)
    final_rate: float = _about("Last learning rate, as a share of the greatest.", 0.01, 0, 1)
    warmup_epochs: float = _about("Epochs in which the rate rises.", 3.0, 0, 100)
    weight_decay: float = _about("Of AdamW, for weights of convolutions.", 5e-4, 0, 1)
    ema_decay: float = _about("Of the moving average of the weights, in the end.", 0.9999, 0, 1)
    ema_steps: int = _about("Steps over which that decay is reached.", 2000, 1, 1_000_000)
    patience: int = _about("Epochs without a better result after which a phase ends.", 20, 1, 10_000)
    mosaic: float = _about("Share of views made of four images.", 1.0, 0, 1)
    mosaic_off: int = _about("Last epochs of each stage without mosaics.", 10, 0, 10_000)
    scale: float = _about("Scales vary from 1 − this to 1 + this.", 0.5, 0, 0.9)
    mirror: float = _about("Share of images with left and right exchanged.", 0.5, 0, 1)
    upside_down: float = _about("Share of images with top and bottom exchanged, but for those from a car.", 0.0, 0, 1)
    hue: float = _about("Hues turn by at most this share of a circle.", 0.015, 0, 0.5)
    saturation: float = _about("Saturations vary by at most this share.", 0.7, 0, 1)
    brightness: float = _about("Brightnesses vary by at most this share.", 0.4, 0, 1)
    distractors: int = _about("Random shapes tried for each view, where nothing is labelled.", 0, 0, 64)
    subtype_weight: float = _about("α of L_total.", 1.0, 0, 100)
    mask_weight: float = _about("Of the mask loss; 0 trains no masks.", 1.0, 0, 100)
    freeze: bool = _about("Train only the level that `p2` adds to what `start` has.", default=False)
    seed: int = _about("Random seed; 0 is a seed too.", 0, 0, 2**31)
    fourier: float = _about("β of Fourier amplitude transfer from photographs; 0: none.", 0.0, 0, 0.5)
    appearance: float = _about("Share of synthetic images moved to photographs' colours, noise, blur.", 0.0, 0, 1)
    teacher_weight: float = _about("Of the loss on photographs that the mean teacher labels; 0: none.", 0.0, 0, 100)
    teacher_photographs: int = _about("Unlabelled photographs of a step.", 8, 1, 4096)
    teacher_confidence: float = _about("From which the teacher's detections are objects.", 0.6, 0, 1)
    teacher_doubt: float = _about("From which they are neither objects nor background.", 0.2, 0, 1)
    teacher_after: int = _about("Epochs of the first stage without a teacher.", 5, 0, 10_000)

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
        if self.teacher_doubt > self.teacher_confidence:
            raise PaveTwinError(
                f"`teacher_doubt` {self.teacher_doubt:g}: it is at most `teacher_confidence` "
                f"({self.teacher_confidence:g})."
            )
        if self.image_px % 32:
            raise PaveTwinError(f"`image_px` {self.image_px}: it must be a multiple of 32.")
        known = (*SUBTYPES, *COARSE[1:])
        for name in self.without_classes:
            if name not in known:
                raise PaveTwinError(no_such("class", name, known, key="`without`"))
        _ = self.architecture

    @property
    def architecture(self) -> Architecture:
        """Of the network."""
        given = {"depth": self.depth, "width": self.width}
        others = {name: value for name, value in given.items() if value}
        return variant(
            self.size,
            p2=self.p2,
            activation=self.activation,
            masks=self.masks,
            mask_points=self.mask_points,
            **others,
        )

    @property
    def without_classes(self) -> frozenset[str]:
        """Classes that the data need not have."""
        return frozenset(filter(None, (name.strip() for name in self.without.split(","))))

    @property
    def weights(self) -> LossWeights:
        """Of the losses."""
        return LossWeights(subtype=self.subtype_weight, mask=self.mask_weight)

    @property
    def adaptations(self) -> tuple[str, ...]:
        """The settings, other than 0, that need unlabelled photographs."""
        return tuple(name for name in ("fourier", "appearance", "teacher_weight") if getattr(self, name))

    def views(self, *, mosaic: bool) -> ViewOptions:
        """How training images vary."""
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
        """As JSON and checkpoints hold it."""
        return asdict(self)

    @classmethod
    def parse(cls, values: Iterable[str] | Mapping[str, Any]) -> Self:
        """From `name=value` texts, or from names and values.

        Raises:
            PaveTwinError: a name is not known, or a value is not what it takes.
        """
        if not isinstance(values, Mapping):
            pairs = [text.partition("=") for text in values]
            for name, equals, _ in pairs:
                if not equals:
                    raise PaveTwinError(f"`overrides`: '{name}' is no setting; give name=value, such as epochs=20.")
            values = {name.strip(): text.strip() for name, _, text in pairs}
        kinds = {each.name: type(each.default) for each in fields(cls)}
        for name in values:
            if name not in kinds:
                raise PaveTwinError(
                    f"`overrides`: no setting '{name}'{nearest_name(name, kinds)}; known are {', '.join(kinds)}."
                )
        return cls(**{name: _value(name, value, kinds[name]) for name, value in values.items()})


def _value(name: str, value: Any, kind: type) -> Any:
    """A text as the type of its setting."""
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
    """How this machine trains; not part of what a run is."""

    device: str = ""
    """`cpu`, `cuda` or another of torch's; empty takes a graphics card where there is one."""
    workers: int = 0
    """Processes that make views; 0 makes them in the main process."""
    held_gb: float = 2.0
    """Decoded pictures of each dataset that are kept in memory, in 10⁹ bytes: 2 are about 2,500 of 512 × 512."""
    views: str = ""
    """Where views are drawn: `processor`, or `device`, which then holds all training pictures; empty takes a graphics
    card that has room for them."""
    compiled: bool = False
    """The network by `torch.compile`, which takes a minute at first."""
    half: bool = True
    """Mixed precision (bfloat16) on graphics cards that have it, and on processors with AMX or AVX-512 BF16."""

    def __post_init__(self) -> None:
        """Raises:
        PaveTwinError: the memory is negative or not finite, or there is no such place for views.
        """
        if not 0 <= self.held_gb < inf:
            raise PaveTwinError(f"`held_gb` {self.held_gb:g}: it must be 0 or more, and finite.")
        if self.views not in ("", *VIEWS):
            raise PaveTwinError(no_such("place", self.views, VIEWS, key="`views`"))
