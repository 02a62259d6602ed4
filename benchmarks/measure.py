"""Timing, and one line of the table."""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import inf
from typing import Any


class Kind(Enum):
    """What a number measures, and how it is compared with its target."""

    SECONDS = "s"
    REAL_TIME = "× real time"
    PER_SECOND = "/s"
    RATIO = "ratio"
    MEBIBYTES = "MiB"
    COUNT = ""

    @property
    def more_is_better(self) -> bool:
        return self in (Kind.REAL_TIME, Kind.PER_SECOND)

    def shown(self, value: float) -> str:
        match self:
            case Kind.SECONDS:
                unit, factor = next(
                    (unit, factor)
                    for unit, factor, least in (("s", 1, 1.0), ("ms", 1e3, 1e-3), ("µs", 1e6, -inf))
                    if value >= least
                )
                return f"{value * factor:.3g} {unit}"
            case Kind.REAL_TIME:
                return f"{value:,.0f} ×"
            case Kind.PER_SECOND:
                return f"{value:,.0f} a second"
            case Kind.RATIO:
                return f"{value:.2f} times"
            case Kind.MEBIBYTES:
                return f"{value:,.0f} MiB" if value >= 10 else f"{value:.1f} MiB"
            case Kind.COUNT:
                return f"{value:,.0f}"


@dataclass(frozen=True)
class Size:
    """The extent of the measurement."""

    segments: int
    """Inspected by a mission."""
    runs: int
    """Of which the median counts."""
    recorded_s: float
    """Traffic of the missions, and of the frames."""
    crowd_s: float
    """Traffic of the crowd."""
    few: int = 3
    """Segments of a short command."""
    mapped: int = 100
    """Segments on the map whose drawing is measured."""
    survey: int = 40
    """Segments of a long mission."""
    images: int = 60
    """Labelled images of a dataset."""
    crowd: int = 600
    """Vehicles, and as many pedestrians."""
    shapes: int = 40
    """Defects that are generated."""
    places: int = 9
    """Of frames: over streets, evenly along their whole length, each at another time of the recording."""
    frame_px: tuple[int, int] = (640, 640)
    photographs: int = 600
    """That are imported."""
    batch: int = 16
    """Views of a step of training."""
    copies: int = 10
    """Of the town, east and north, for the city that is larger."""
    streets_m: tuple[float, ...] = (1000.0,)
    """Sides of the squares of made-up streets: of the first all is measured, of the others one path query."""
    study: Mapping[str, Any] = field(default_factory=dict)
    """What is not as in the paper's design; without anything its times have targets."""


@dataclass(frozen=True)
class Line:
    """One measurement and its target."""

    what: str
    value: float | None
    """None where this machine has not what is to be measured."""
    kind: Kind
    target: float | None = None
    """None where the design names none."""
    took_s: float | None = None
    """What one run took, where the value is a ratio to real time."""
    note: str = ""

    @property
    def reached(self) -> bool | None:
        if self.target is None or self.value is None:
            return None
        return self.value >= self.target if self.kind.more_is_better else self.value <= self.target

    def measured(self) -> str:
        """The value, and the time behind it."""
        shown = "not here" if self.value is None else self.kind.shown(self.value)
        return shown if self.took_s is None else f"{Kind.SECONDS.shown(self.took_s)}, {shown}"

    def asked(self) -> str:
        """The target with its comparison."""
        if self.target is None:
            return ""
        return f"{'≥' if self.kind.more_is_better else '≤'} {self.kind.shown(self.target)}"


def median_s(call: Callable[[], object], runs: int, warm_up: int = 1) -> float:
    """The median wall-clock time of `call` over `runs` runs, after some that do not count."""
    for _ in range(warm_up):
        call()
    times = []
    for _ in range(runs):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return statistics.median(times)
