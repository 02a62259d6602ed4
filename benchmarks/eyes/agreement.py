"""The fitted sensor compared with the detector in the same captures, by cells of density, altitude and policy.

A mission writes down what each capture showed. In the study's preset no policy reads what was found, so the flights of
both sensors are the same, and what the fitted sensor finds of them follows from these looks alone: of each defect the
probability that at least one look finds it. What it predicts of a town comes from a fit without that town.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
import yaml

from pavetwin.arrays import Float64Array
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.saving import LOOKS
from pavetwin.sensing.fit.fitting import fit_sensor, found_by_draws
from pavetwin.sensing.fit.look_tables import GROUP, LookSource
from pavetwin.sensing.fitted_sensor import SensorModel
from pavetwin.sensing.frame import Look

CELL: Final = ("traffic", "altitude_m", "policy")

CLOSE: Final = 0.02
"""Two points of coverage."""


@dataclass(frozen=True)
class Flown:
    """A mission of the sensor `detector`."""

    town: str
    traffic: str
    altitude_m: float
    policy: str
    source: LookSource
    row: Mapping[str, Any]
    """Of its one segment, as a study has it."""
    chances: Float64Array
    """(draws, defects) that the fitted sensor finds each defect of the segment, those that no capture saw included."""
    alarms: float
    """That the fitted sensor is expected to report falsely."""

    @property
    def where(self) -> dict[str, Any]:
        return {"traffic": self.traffic, "altitude_m": self.altitude_m, "policy": self.policy}


def read_grid(missions: Path) -> list[tuple[str, Path]]:
    """The town and the folder of every mission."""
    return [(path.parent.parent.name, path.parent) for path in sorted(missions.glob(f"*/*/{LOOKS}"))]


def predicted(missions: Path, sets: Sequence[LookSource]) -> tuple[list[Flown], Mapping[str, SensorModel]]:
    """Every mission with what a sensor predicts that was fitted to the other towns, and these sensors by town.

    Args:
        sets: looks from datasets, of towns without missions; each sensor is fitted to them as well.
    """
    folders = read_grid(missions)
    sources = {folder: MissionFolder(folder).looks() for _, folder in folders}
    models = {
        town: fit_sensor([*sets, *(sources[folder] for other, folder in folders if other != town)])
        for town in dict.fromkeys(town for town, _ in folders)
    }
    return [_flown(town, folder, sources[folder], models[town]) for town, folder in folders], models


def _flown(town: str, folder: Path, source: LookSource, model: SensorModel) -> Flown:
    said = yaml.safe_load((folder / "mission.yaml").read_text(encoding="utf-8"))
    (row,) = pl.read_parquet(folder / "mission.parquet").iter_rows(named=True)
    looks: dict[str, list[Look]] = {}
    for group, *values in source.looks.select(GROUP, *Look._fields).iter_rows():
        looks.setdefault(group, []).append(Look(*values))
    seen = found_by_draws(model, [*looks.values()])
    chances = np.zeros((len(seen), row["defects"]))
    chances[:, : seen.shape[1]] = seen
    areas, pixels = source.images["area_m2"].to_numpy(), source.images["pixel_mm"].to_numpy() / 1000
    alarms = sum(
        float(area * kind.per_m2(pixel))
        for kind in model.false_alarms.values()
        for area, pixel in zip(areas, pixels, strict=True)
    )
    return Flown(
        town=town,
        traffic=said["traffic"]["density"],
        altitude_m=said["settings"]["altitude_m"],
        policy=said["policy"]["name"],
        source=source,
        row=row,
        chances=chances,
        alarms=alarms,
    )


def cells(flown: Sequence[Flown], by: Sequence[str] = CELL) -> pl.DataFrame:
    """One row a cell: missions, defects, the detector's coverage, the fitted sensor's expected coverage and the
    standard deviation of the difference if the fitted sensor were right, and false alarms of both a mission.

    That deviation has two parts: which defects are found by chance, given their chances, and the sensor's parameters.
    """
    rows = []
    groups: dict[tuple[Any, ...], list[Flown]] = {}
    for each in flown:
        groups.setdefault(tuple(each.where[name] for name in by), []).append(each)
    for key, mine in groups.items():
        chances = np.hstack([each.chances for each in mine])
        # Missions over one street meet the same defects: what is left to chance there is not averaged away.
        means = chances.mean(axis=0)
        streets = len({(each.town, each.traffic) for each in mine})
        left = float((means * (1 - means)).sum()) / chances.shape[1] ** 2 * len(mine) / streets
        rows.append(
            {
                **dict(zip(by, key, strict=True)),
                "missions": len(mine),
                "defects": chances.shape[1],
                "detector": sum(each.row["confirmed"] for each in mine) / chances.shape[1],
                "calibrated": float(means.mean()),
                "deviation": float(np.sqrt(left + chances.mean(axis=1).var())),
                "alarms": float(np.mean([each.row["false_alarms"] for each in mine])),
                "calibrated_alarms": float(np.mean([each.alarms for each in mine])),
            }
        )
    return pl.DataFrame(rows).with_columns(difference=pl.col("calibrated") - pl.col("detector"))


def summary(table: pl.DataFrame) -> dict[str, float]:
    """How many cells agree: within two points, and within 1.96 deviations."""
    apart = table["difference"].abs()
    return {
        "cells": table.height,
        "close": int((apart <= CLOSE).sum()),
        "within": int((apart <= 1.96 * table["deviation"]).sum()),
        "mean_points": float(100 * apart.to_numpy().mean()),
        "bias_points": float(100 * table["difference"].to_numpy().mean()),
    }


def best(table: pl.DataFrame, column: str) -> pl.DataFrame:
    """Of each density the altitude and policy with the most coverage, by `detector` or `calibrated`; of equal ones the
    first of the table."""
    return table.sort(column, descending=True, maintain_order=True).group_by("traffic", maintain_order=True).first()


def markdown(table: pl.DataFrame) -> str:
    """The cells as a table, a row an altitude and policy, a column a density."""
    densities = table["traffic"].unique(maintain_order=True).to_list()
    lines = [
        "| altitude, policy | " + " | ".join(f"{name}: detector, calibrated (±)" for name in densities) + " |",
        "|---" * (len(densities) + 1) + "|",
    ]
    for (altitude_m, policy), part in table.group_by("altitude_m", "policy", maintain_order=True):
        found = {row["traffic"]: row for row in part.iter_rows(named=True)}
        texts = [
            f"{100 * row['detector']:.0f}, {100 * row['calibrated']:.0f} (±{196 * row['deviation']:.0f})"
            if (row := found.get(name))
            else "–"
            for name in densities
        ]
        lines.append(f"| {altitude_m:g} m, {policy} | {' | '.join(texts)} |")
    return "\n".join(lines)
