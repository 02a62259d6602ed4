"""Which objects are to stand on which road picture: by split, ground resolution and size, none too often."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, UInt8Array
from pavetwin.labels import SPLITS
from pavetwin.training.datasets.annotated import AnnotatedImage
from pavetwin.training.datasets.cutout_library import StoredCutOut
from pavetwin.training.datasets.cutouts import cut_outs, ground_resolution
from pavetwin.training.datasets.markings import marking_gsd_mm
from pavetwin.training.datasets.report import Finding, Report
from pavetwin.training.datasets.splitting import KEPT

SMALLEST: Final = 0.15
"""A cut-out is scaled down to this at most: what is far finer than its place has been seen from much nearer."""

LARGEST: Final = 0.35
"""Of a picture's area: what an object may cover."""

UNKNOWN: Final = "its ground resolution is not known, and it shows nothing that tells it"
NONE_FITS: Final = "no cut-out has a ground resolution and a size that fit"


@dataclass(frozen=True, slots=True)
class CompositePlan:
    """What one road picture is to become."""

    image: AnnotatedImage
    gsd_mm: float = 0.0
    """Of the composite: of the picture, or coarser, where it is scaled down for what stands on it."""
    factor: float = 1.0
    """By which the picture is scaled, at most 1."""
    objects: tuple[StoredCutOut, ...] = ()
    reasons: Counter[str] = field(default_factory=Counter)
    """Why there is less than was drawn."""


def road_gsd_mm(image: AnnotatedImage, picture: UInt8Array, road: BoolArray) -> float | None:
    """Millimetres that a pixel of a road picture covers: as stated, else by its vehicles or its people, else by its
    lane lines."""
    if image.gsd_mm is not None:
        return image.gsd_mm
    by_objects = ground_resolution(image, list(cut_outs(image, picture)))
    return by_objects if by_objects is not None else marking_gsd_mm(picture, road)


class CompositePlanner:
    """Chooses objects for one road picture after the other; what it chooses depends on those before."""

    def __init__(
        self, library: Sequence[StoredCutOut], *, most: int, enlarge: float, reduce: float, repeat: int
    ) -> None:
        """Args:
        library: all with a ground resolution.
        most: objects on a picture.
        enlarge: an object is scaled up by this at most.
        reduce: a picture is scaled down by this at most.
        repeat: pictures that one object stands on, at most.
        """
        self._library = library
        self._most, self._enlarge, self._reduce, self._repeat = most, enlarge, reduce, repeat
        self._uses: Counter[str] = Counter()

    def plan(self, image: AnnotatedImage, gsd_mm: float | None, rng: np.random.Generator) -> CompositePlan:
        """What is to stand on a road picture of this ground resolution."""
        if gsd_mm is None:
            return CompositePlan(image, reasons=Counter([UNKNOWN]))
        fitting = [each for each in self._library if self._fits(each, image, gsd_mm)]
        if not fitting:
            return CompositePlan(image, reasons=Counter([NONE_FITS]))
        reasons: Counter[str] = Counter()
        chosen: list[StoredCutOut] = []
        categories = sorted({each.category for each in fitting})
        for _ in range(int(rng.integers(1, self._most + 1))):
            category = categories[int(rng.integers(len(categories)))]
            free = [each for each in fitting if each.category == category and each not in chosen]
            if not free:
                reasons[f"no other {category} fits"] += 1
                continue
            least = min(self._uses[each.name] for each in free)
            if least >= self._repeat:
                reasons[f"every {category} that fits stands on {self._repeat} images already"] += 1
                continue
            seldom = [each for each in free if self._uses[each.name] == least]
            chosen.append(seldom[int(rng.integers(len(seldom)))])
        self._uses.update(each.name for each in chosen)
        coarsest = max([gsd_mm, *(_known(each) / self._enlarge for each in chosen)])
        return CompositePlan(image, coarsest, gsd_mm / coarsest, tuple(chosen), reasons)

    def _fits(self, cut_out: StoredCutOut, image: AnnotatedImage, gsd_mm: float) -> bool:
        scale = _known(cut_out) / gsd_mm
        width, height = image.size_px
        return (
            SMALLEST <= scale <= self._enlarge * self._reduce
            and cut_out.length_px * scale < max(width, height)
            and cut_out.length_px * cut_out.width_px * scale**2 <= LARGEST * width * height
        )


class SplitPlanner:
    """Plans road pictures with the objects of their own split alone, so that none is in train and in test."""

    def __init__(
        self,
        library: Sequence[tuple[str, StoredCutOut]],
        splits: Mapping[str, str],
        *,
        most: int,
        enlarge: float,
        reduce: float,
        repeat: int,
    ) -> None:
        """Args:
        library: each with its scene.
        splits: scene → split.
        most, enlarge, reduce, repeat: as of `CompositePlanner`.
        """
        self._splits = splits
        self._libraries = {name: [each for scene, each in library if splits[scene] == name] for name in SPLITS}
        self._planners = {
            name: CompositePlanner(held, most=most, enlarge=enlarge, reduce=reduce, repeat=repeat)
            for name, held in self._libraries.items()
        }
        self._asked: Counter[str] = Counter()
        self._short: Counter[str] = Counter()

    def plan(self, image: AnnotatedImage, gsd_mm: float | None, rng: np.random.Generator) -> CompositePlan:
        """What is to stand on a road picture of this ground resolution; its split is given from now on."""
        split = self._splits[image.group]
        image = replace(image, attributes={**image.attributes, KEPT: split})
        plan = self._planners[split].plan(image, gsd_mm, rng)
        if gsd_mm is not None:
            self._asked[split] += 1
            self._short[split] += bool(plan.reasons)
        return plan

    def tell(self, report: Report) -> None:
        """Say of each split whose road pictures wanted more objects how many it has."""
        for split in (name for name in SPLITS if self._short[name]):
            held = Counter(each.category for each in self._libraries[split])
            told = ", ".join(f"{count} of {name}" for name, count in sorted(held.items())) or "none"
            words = f"{self._short[split]} of its {self._asked[split]} road images have fewer objects than drawn"
            report.add(Finding.NOTE, split, f"{words}; its own cut-outs: {told}, and those of other splits stay there")


def _known(cut_out: StoredCutOut) -> float:
    assert cut_out.gsd_mm is not None
    return cut_out.gsd_mm
