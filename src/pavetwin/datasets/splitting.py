"""Train, val and test: stratified by the instances of every class, scenes undivided.

The counts of a scene are shares of each class's instances over the dataset, so a rare class weighs as much as a common
one. Scenes are assigned from the largest to the smallest, each to the split where the squared distance to the wanted
shares becomes least (the idea of iterative stratification: Sechidis, Tsoumakas and Vlahavas 2011), then moved one by
one while that helps.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.datasets.annotated import AnnotatedImage, class_names
from pavetwin.datasets.common_form import read_description, read_images
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.labels import SPLITS
from pavetwin.seeds import Stream, child

LISTS: Final = Path("ImageSets") / "Main"
"""Where VOC keeps the names of each split's images."""

PASSES: Final = 20
"""Over all scenes, at most."""

KEPT: Final = "split"
"""Attribute of images whose split is given: captures are split by streets already."""


@dataclass(frozen=True)
class SplitShares:
    """What became of each class."""

    splits: Mapping[str, str]
    """Scene → split."""
    shares: Mapping[str, tuple[float, ...]]
    """Class, or `images` → the share of its instances in each of `SPLITS`; classes without any are left out."""


def split_groups(images: Iterable[AnnotatedImage], shares: Sequence[float], seed: int) -> SplitShares:
    """The split of every scene.

    Args:
        shares: of train, val and test, which sum to 1; one of 0 gets no scene but those of captures that have it.

    Raises:
        PaveTwinError: the shares do not sum to 1, or there are fewer scenes than splits.
    """
    if len(shares) != len(SPLITS) or min(shares) < 0 or abs(sum(shares) - 1) > 1e-6:
        raise PaveTwinError(f"`shares`: train, val and test must sum to 100 % (got {sum(shares):.0%}).")
    columns = {name: at for at, name in enumerate((*class_names(), "images"))}
    tallies: dict[str, Float64Array] = defaultdict(lambda: np.zeros(len(columns)))
    given: dict[str, str] = {}
    for image in images:
        tally = tallies[image.group]
        tally[columns["images"]] += 1
        for each in image.labelled:
            assert each.category is not None
            tally[columns[each.category]] += 1
        if (split := image.attributes.get(KEPT)) in SPLITS:
            given[image.group] = split
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
    told = {name: tuple(reached[:, at].tolist()) for name, at in columns.items() if totals[at]}
    return SplitShares({group: SPLITS[at] for group, at in zip(groups, chosen.tolist(), strict=True)}, told)


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
    for _ in range(PASSES):
        moved = False
        for scene in shuffled:
            before = chosen[scene]
            state[before] -= weights[scene]
            chosen[scene] = _best(state, weights[scene], scale, before)
            state[chosen[scene]] += weights[scene]
            moved |= bool(chosen[scene] != before)
        if not moved:
            return


def _best(state: Float64Array, weight: Float64Array, scale: Float64Array, now: int | None = None) -> int:
    """The split to which adding a scene costs least; `now` where none is better.

    Args:
        state: (splits, classes) what each has, less what it should have.
    """
    cost = ((2 * state * weight + weight**2) * scale).sum(axis=1)
    best = int(np.argmin(cost))
    return best if now is None or cost[best] < cost[now] - 1e-15 else now


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
