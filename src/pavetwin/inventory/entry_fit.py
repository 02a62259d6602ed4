"""Fit the model of entries in a fitted sensor to the inventories of missions, whose truth is known.

An entry shows a defect where at least half of its detections were matched to one. The regression has weak normal
priors, so that few entries give finite effects; standard errors are those of the inverse curvature.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.inventory.entry import SEVERITIES, entry_of
from pavetwin.inventory.merging import merged
from pavetwin.inventory.of_mission import flown
from pavetwin.labels.class_names import TRAFFIC
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.saving import DEFECTS
from pavetwin.sensing.fitted_sensor import OF_ENTRY, EntryModel, FittedNumber, entry_values

_LEVEL: Final = 0.015
_EFFECT: Final = 0.3
"""Precisions of the priors of the classes' levels and of the other effects."""

_ROUNDS: Final = 100


class JudgedEntry(NamedTuple):
    """An entry, and whether it shows a defect."""

    kind: str
    confidence: float
    looks: int
    size_px: float
    is_defect: bool


class JudgedInventory(NamedTuple):
    """The entries of a mission's inventory, and its true defects."""

    entries: tuple[JudgedEntry, ...]
    severities: tuple[tuple[str, str], ...]
    """Class and severity of each true defect."""


def judged_inventory(folder: Path) -> JudgedInventory:
    """The entries of a mission of the sensor `detector`, each compared with the truth.

    Raises:
        PaveTwinError: a file of the mission is missing or damaged.
    """
    mission = MissionFolder(folder)
    reading = flown(mission)
    try:
        table = mission.detections.filter(~pl.col("class").is_in(list(TRAFFIC)))
        is_matched = table["defect"].is_not_null().to_numpy()
        there = pl.read_csv(folder / DEFECTS, columns=["class", "severity"])
    except (OSError, pl.exceptions.PolarsError) as error:
        raise PaveTwinError(
            f"The defects of the mission '{folder}' cannot be read ({type(error).__name__}); fly it again."
        ) from error
    rows = []
    for group in merged(reading.detections):
        entry = entry_of(1, reading.detections[group])
        if (size_px := entry.size_px) is not None:
            is_defect = bool(is_matched[group].mean() >= 0.5)
            rows.append(JudgedEntry(entry.class_name, entry.confidence, entry.looks, size_px, is_defect))
    return JudgedInventory(tuple(rows), tuple(there.iter_rows()))


def fit_entries(inventories: Sequence[JudgedInventory]) -> EntryModel | None:
    """The model of all entries; those of missions whose entries are the same count once.

    Returns:
        None where no class has entries of both kinds.
    """
    different = list(dict.fromkeys(inventories))
    rows = [entry for each in different for entry in each.entries]
    kinds = sorted({each.kind for each in rows if each.is_defect} & {each.kind for each in rows if not each.is_defect})
    rows = [each for each in rows if each.kind in kinds]
    if not kinds:
        return None
    x = np.array(
        [
            [*(float(each.kind == kind) for kind in kinds), *entry_values(each.confidence, each.looks, each.size_px)]
            for each in rows
        ]
    )
    y = np.array([float(each.is_defect) for each in rows])
    precision = np.array([_LEVEL] * len(kinds) + [_EFFECT] * len(OF_ENTRY))
    beta, errors = _logistic(x, y, precision)
    return EntryModel(
        terms={
            name: FittedNumber(estimate=float(value), standard_error=float(error))
            for name, value, error in zip((*kinds, *OF_ENTRY), beta, errors, strict=True)
        },
        entries=len(rows),
        defect_share=float(y.mean()),
        severities={kind: _shares(kind, different) for kind in kinds},
    )


def _shares(kind: str, inventories: Sequence[JudgedInventory]) -> tuple[float, float, float]:
    """Shares of low, medium and high among the defects of a class, with one added to each count (Laplace)."""
    found = [severity for each in inventories for name, severity in each.severities if name == kind]
    low, medium, high = (found.count(severity) + 1 for severity in SEVERITIES)
    total = low + medium + high
    return low / total, medium / total, high / total


def _logistic(x: Float64Array, y: Float64Array, precision: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Penalised maximum likelihood by Newton's method: estimates and standard errors.

    Args:
        x: (n, terms).
        y: (n,) 0 or 1.
        precision: (terms,) of the normal priors around 0.
    """
    beta = np.zeros(x.shape[1])
    for _ in range(_ROUNDS):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ beta, -30, 30)))
        curvature = (x * (p * (1 - p))[:, None]).T @ x + np.diag(precision)
        step = np.linalg.solve(curvature, x.T @ (y - p) - precision * beta)
        beta = beta + np.clip(step, -2.0, 2.0)
        if np.abs(step).max() < 1e-10:
            break
    return beta, np.sqrt(np.diag(np.linalg.inv(curvature)))
