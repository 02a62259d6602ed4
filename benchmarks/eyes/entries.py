"""How likely entries are defects, and the condition index by them, over towns that the regression was not fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from pavetwin.inventory.condition import with_detected
from pavetwin.inventory.entry_fit import JudgedInventory, fit_entries, judged_inventory
from pavetwin.inventory.listing import entries_of
from pavetwin.inventory.of_mission import flown
from pavetwin.mission.condition import condition_of_mission
from pavetwin.mission.folder import MissionFolder

BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
DRAWS = 4000


@dataclass(frozen=True)
class Judged:
    """A mission, judged by a regression over the other towns."""

    folder: Path
    probabilities: tuple[float, ...]
    is_defect: tuple[bool, ...]
    """Of the entries with a probability."""
    pci: float
    pci_all: float
    """By all entries."""
    pci_likely: float
    """By those that are more likely a defect than not."""

    @property
    def town(self) -> str:
        return self.folder.parent.name


def judged(folders: Sequence[Path]) -> list[Judged]:
    """Every mission; towns are the names of the folders that hold them."""
    read = {folder: judged_inventory(folder) for folder in folders}
    return [_judged(folder, read[folder], _others(folder, read)) for folder in folders]


def _others(folder: Path, read: dict[Path, JudgedInventory]) -> list[JudgedInventory]:
    return [inventory for other, inventory in read.items() if other.parent.name != folder.parent.name]


def _judged(folder: Path, inventory: JudgedInventory, others: Sequence[JudgedInventory]) -> Judged:
    reading = replace(flown(folder), entry_model=fit_entries(others))
    report = condition_of_mission(MissionFolder(folder / "mission.yaml"))
    indices = [with_detected(report, each).pci_detected for each in (replace(reading, entry_model=None), reading)]
    told = [
        (each.probability, truth.is_defect)
        for each, truth in zip(entries_of(reading), inventory.entries, strict=True)
        if each.probability is not None
    ]
    return Judged(
        folder,
        tuple(chance for chance, _ in told),
        tuple(is_defect for _, is_defect in told),
        report.pci,
        *(report.pci if index is None else index for index in indices),
    )


def markdown(missions: Sequence[Judged]) -> str:
    """The error of the index with 95 % intervals over towns, and how often entries of each probability are defects."""
    lines = [
        "| index by | missions | mean error (95 % over towns) | mean difference |",
        "|---" * 4 + "|",
    ]
    for name, column in (("all entries", "pci_all"), ("likely ones", "pci_likely")):
        apart = {each: getattr(each, column) - each.pci for each in missions}
        errors = [[abs(apart[each]) for each in missions if each.town == town] for town in {e.town for e in missions}]
        rng = np.random.default_rng(0)
        means = [
            np.mean(np.concatenate([errors[at] for at in rng.integers(len(errors), size=len(errors))]))
            for _ in range(DRAWS)
        ]
        low, high = np.quantile(means, [0.025, 0.975])
        mean, bias = np.mean(np.abs([*apart.values()])), np.mean([*apart.values()])
        lines.append(f"| {name} | {len(missions)} | {mean:.1f} ({low:.1f} to {high:.1f}) | {bias:+.1f} |")
    chances = np.concatenate([each.probabilities for each in missions])
    truth = np.concatenate([each.is_defect for each in missions])
    lines += ["", "| probability | entries | mean | defects |", "|---" * 4 + "|"]
    for low, high in pairwise(BINS):
        inside = (chances >= low) & ((chances < high) | (high == BINS[-1]))
        if inside.any():
            shares = f"{chances[inside].mean():.2f} | {truth[inside].mean():.2f}"
            lines.append(f"| {low:g} to {high:g} | {inside.sum()} | {shares} |")
    return "\n".join(lines)
