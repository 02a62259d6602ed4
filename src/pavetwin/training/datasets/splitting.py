"""Train, val and test: stratified by the instances of every class, scenes undivided.

The counts of a scene are shares of each class's instances over the dataset, so a rare class weighs as much as a common
one. Scenes are assigned from the largest to the smallest, each to the split where the squared distance to the wanted
shares becomes least (the idea of iterative stratification: Sechidis, Tsoumakas and Vlahavas 2011), then moved one by
one while that helps. Where few scenes hold most of a class, that is not enough: so each of the largest is also moved
although it does not help, and the others of the largest after it, and what came of it is kept where it is better.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.labels import CUT_OUT, SPLITS
from pavetwin.labels.common_form import AnnotatedImage, class_names, read_description, read_images
from pavetwin.seeds import Stream, child
from pavetwin.training.datasets.report import FILE as REPORT
from pavetwin.training.datasets.report import Finding, Report

LISTS: Final = Path("ImageSets") / "Main"
"""Folder where VOC keeps the names of each split's images."""

PASSES: Final = 20  # Over all scenes, at most
LEAST_GAIN: Final = 1e-12  # Least decrease of the squared distance; less is rounding
LARGEST: Final = 50  # Scenes that are moved together; more take long

KEPT: Final = "split"
"""Attribute of images whose split is given: captures are split by streets already, and composites before they are
made."""

USUAL_SHARES: Final = (0.7, 0.2, 0.1)
"""Shares of train, val and test."""


@dataclass(frozen=True)
class SplitShares:
    """Splits of scenes, and the resulting shares of each class."""

    splits: Mapping[str, str]
    """Scene → split."""
    shares: Mapping[str, tuple[float, ...]]
    """Class, or `images` → the share of its instances in each of `SPLITS`; classes without any are left out."""
    report: Report
    """Images that are not in the split that was given to them, because they show one place with those of another."""


def split_groups(images: Iterable[AnnotatedImage], shares: Sequence[float], seed: int) -> SplitShares:
    """The split of every scene.

    Args:
        shares: of train, val and test, which sum to 1; one of 0 gets no scene but those to which it was given.

    Raises:
        PaveTwinError: the shares do not sum to 1, there are fewer scenes than splits, or an image with objects of
            others, or one of those, would leave the split that was given to it.
    """
    if len(shares) != len(SPLITS) or min(shares) < 0 or abs(sum(shares) - 1) > 1e-6:
        raise PaveTwinError(f"`shares`: train, val and test must sum to 100 % (got {sum(shares):.0%}).")
    columns = {name: at for at, name in enumerate((*class_names(), "images"))}
    tallies: dict[str, Float64Array] = defaultdict(lambda: np.zeros(len(columns)))
    own: dict[str, Counter[str]] = defaultdict(Counter)
    bound = _Bound()
    for image in images:
        tally = tallies[image.group]
        tally[columns["images"]] += 1
        for each in image.labelled:
            assert each.category is not None
            tally[columns[each.category]] += 1
        if (split := image.attributes.get(KEPT)) in SPLITS:
            own[image.group][split] += 1
            bound.add(image, split)
    report = Report()
    given = {group: _given(group, of_scene, report) for group, of_scene in sorted(own.items())}
    bound.check(given)
    groups = sorted(tallies)
    free = [at for at, group in enumerate(groups) if group not in given]
    if len(groups) < np.count_nonzero(shares):
        raise PaveTwinError(f"The dataset has {len(groups)} scenes, too few for `shares` of three splits.")
    counts = np.array([tallies[group] for group in groups])
    totals = counts.sum(axis=0)
    weights = counts / np.maximum(totals, 1.0)
    chosen = np.array([SPLITS.index(given.get(group, SPLITS[0])) for group in groups], dtype=np.intp)
    _assign(weights, chosen, np.array(free, dtype=np.intp), np.array(shares), child(seed, Stream.DATASET))
    reached = np.array([counts[chosen == at].sum(axis=0) for at in range(len(SPLITS))]) / np.maximum(totals, 1.0)
    resulting = {name: tuple(reached[:, at].tolist()) for name, at in columns.items() if totals[at]}
    splits = {group: SPLITS[at] for group, at in zip(groups, chosen.tolist(), strict=True)}
    return SplitShares(splits, resulting, report)


class _Bound:
    """Images that must stay where they are, since the same object is seen on them: composites, and what was cut."""

    def __init__(self) -> None:
        self._given: dict[str, tuple[str, str]] = {}
        self._names: set[str] = set()

    def add(self, image: AnnotatedImage, split: str) -> None:
        """An image to which a split was given."""
        self._given[image.name] = (image.group, split)
        cut_outs = [each.attributes[CUT_OUT] for each in image.annotations if CUT_OUT in each.attributes]
        if cut_outs:
            # A cut-out is named by its image, and a number.
            self._names |= {image.name, *(name.rpartition("-")[0] for name in cut_outs)}

    def check(self, splits: Mapping[str, str]) -> None:
        """Raises:
        PaveTwinError: scenes were joined later, and one of these images with others of another split.
        """
        for name in sorted(self._names & self._given.keys()):
            group, split = self._given[name]
            if splits[group] != split:
                raise PaveTwinError(
                    f"'{name}' shares an object with other images in {split}, but shows one place with images given "
                    f"to {splits[group]}; merge all datasets first, then run `pavetwin data composite`."
                )


def _given(group: str, own: Counter[str], report: Report) -> str:
    """The split of a scene whose images have splits of their own: that of most; of two with as many, the first."""
    split = max(SPLITS, key=lambda name: own[name])
    for other, count in own.items():
        if other != split:
            words = f"images given to {other} ({count}) are in {split}, with others that show the same place"
            report.add(Finding.NOTE, group, words)
    return split


def _assign(
    weights: Float64Array, chosen: IndexArray, free: IndexArray, shares: Float64Array, rng: np.random.Generator
) -> None:
    """Choose the split of the free scenes, in place.

    Args:
        weights: (scenes, classes) of each class's instances.
    """
    taken = np.ones(len(weights), dtype=np.bool_)
    taken[free] = False
    state = np.array([weights[taken & (chosen == at)].sum(axis=0) for at in range(len(shares))])
    state -= shares[:, None] * (weights.sum(axis=0) > 0)
    # A split that is asked for nothing gets nothing.
    scale = (1.0 / np.maximum(shares, 1e-12))[:, None]
    shuffled = rng.permutation(free)
    for scene in shuffled[np.argsort(-weights[shuffled].max(axis=1), kind="stable")]:
        chosen[scene] = _best(state, weights[scene], scale)
        state[chosen[scene]] += weights[scene]
    _improve(state, weights, chosen, shuffled, scale)
    largest = shuffled[np.argsort(-weights[shuffled].max(axis=1), kind="stable")[:LARGEST]]
    for _ in range(PASSES):
        if not _exchange(state, weights, chosen, largest, scale):
            return
        _improve(state, weights, chosen, shuffled, scale)


def _best(state: Float64Array, weight: Float64Array, scale: Float64Array) -> int:
    """The split to which adding a scene costs least.

    Args:
        state: (splits, classes) what each has, less what it should have.
    """
    return int(np.argmin(((2 * state * weight + weight**2) * scale).sum(axis=1)))


def _improve(
    state: Float64Array, weights: Float64Array, chosen: IndexArray, scenes: IndexArray, scale: Float64Array
) -> None:
    """Move the scene that gains most by it to another split, in place, until none gains."""
    each = weights[scenes, None]
    for _ in range(len(scenes) * PASSES):
        now = chosen[scenes]
        added = ((2 * state * each + each**2) * scale).sum(axis=2)
        costs = added + (((weights[scenes] - 2 * state[now]) * weights[scenes]) * scale[now]).sum(axis=1)[:, None]
        costs[np.arange(len(scenes)), now] = 0.0
        at, split = divmod(int(np.argmin(costs)), len(state))
        if costs[at, split] > -LEAST_GAIN:
            return
        state[now[at]] -= weights[scenes[at]]
        state[split] += weights[scenes[at]]
        chosen[scenes[at]] = split


def _exchange(
    state: Float64Array, weights: Float64Array, chosen: IndexArray, scenes: IndexArray, scale: Float64Array
) -> bool:
    """Move each scene to every other split and let the others follow, in place where that costs less in the end.
    Returns whether it did."""
    exchanged = False
    for scene in scenes:
        others = scenes[scenes != scene]
        for split in set(range(len(state))) - {int(chosen[scene])}:
            tried, placed = state.copy(), chosen.copy()
            tried[placed[scene]] -= weights[scene]
            tried[split] += weights[scene]
            placed[scene] = split
            _improve(tried, weights, placed, others, scale)
            if (scale * (tried**2 - state**2)).sum() < -LEAST_GAIN:
                state[:], chosen[:] = tried, placed
                exchanged = True
    return exchanged


def split_dataset(folder: Path, shares: Sequence[float], seed: int = 0) -> SplitShares:
    """Write the lists of a dataset's splits; its images stay where they are.

    Raises:
        PaveTwinError: it is not finished, the shares do not fit, or it cannot be written.
    """
    if not read_description(folder).get("complete"):
        raise PaveTwinError(f"'{folder}' is not finished; run the command that makes it again.")
    found = split_groups(read_images(folder), shares, seed)
    names: dict[str, list[str]] = {split: [] for split in SPLITS}
    for image in read_images(folder):
        names[found.splits[image.group]].append(image.name)
    for split, held in names.items():
        with writing(folder / LISTS / f"{split}.txt") as temporary:
            temporary.write_text("".join(f"{name}\n" for name in held), encoding="utf-8")
    found.report.save(folder / LISTS / REPORT)
    return found


def split_names(folder: Path) -> dict[str, list[str]]:
    """Split → the names of its images.

    Raises:
        PaveTwinError: the dataset is not split.
    """
    lists = {split: folder / LISTS / f"{split}.txt" for split in SPLITS}
    if not all(path.is_file() for path in lists.values()):
        raise PaveTwinError(f"'{folder}' is not split yet; do so with `pavetwin data split {folder}`.")
    return {split: path.read_text(encoding="utf-8").split() for split, path in lists.items()}
