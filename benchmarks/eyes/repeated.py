"""Many looks at the same defects, from several heights and in several lights, beside the fitted sensor.

A mission looks at a defect two or three times, which does not tell a fitted correlation from looks that are drawn each
by itself. Missions over the same street from six heights, each in its own light, look more than ten times.
"""

from collections.abc import Sequence
from math import sqrt
from pathlib import Path

import numpy as np
import polars as pl
from scipy.special import logsumexp, ndtr, ndtri

from benchmarks.eyes.agreement import read_grid
from pavetwin.draw.sensor_figure import most_repeated, save_sensor_figure
from pavetwin.mission.folder import MissionFolder
from pavetwin.sensing.fit.fitting import RepeatedLooks, chances_of, fit_sensor, repeated_looks
from pavetwin.sensing.fit.tables import GROUP, LookSource
from pavetwin.sensing.sensor_model import SensorModel
from pavetwin.sensing.shipped import sensor_path


def compare(missions: Path, fitted: str, picture: Path | None) -> str:
    """A table of defects by how many of their looks found them, as text.

    Args:
        missions: folders of missions of the detector that the sensor was fitted to, by town.
        fitted: one that ships, by name, or a file; not fitted to these missions.
        image: where the figure goes.

    Raises:
        PaveTwinError: a mission cannot be read, or has too few looks.
    """
    model = SensorModel.read(sensor_path(fitted))
    sources = [MissionFolder(folder).looks() for _, folder in read_grid(missions)]
    looks = pl.concat([each.looks for each in sources])
    count = most_repeated(looks)
    if picture is not None:
        save_sensor_figure(model, sources, picture, are_others=True)
    return markdown(model, repeated_looks(model, looks, count), sources)


def likelihood(model: SensorModel, looks: pl.DataFrame, spread: float) -> float:
    """The logarithm of the chance of what all looks at all defects found.

    Args:
        looks: as `LookSource.looks`.
        spread: standard deviation of what a defect keeps from look to look, in place of the model's; 0 where each look
            is by itself. The chances of single looks are the model's with each.
    """
    chance, found = chances_of(model, looks), looks["found"].to_numpy()
    nodes, weights = np.polynomial.hermite_e.hermegauss(61)
    level = ndtri(np.clip(chance, 1e-9, 1 - 1e-9)) * sqrt(1 + spread**2)
    hit = np.clip(ndtr(level[:, np.newaxis] + spread * nodes), 1e-12, 1 - 1e-12)
    names, of = np.unique(looks[GROUP].to_list(), return_inverse=True)
    given = np.zeros((len(names), len(nodes)))
    np.add.at(given, of, np.log(np.where(found[:, np.newaxis], hit, 1 - hit)))
    return float(logsumexp(given, axis=1, b=weights / weights.sum()).sum())


def markdown(model: SensorModel, seen: RepeatedLooks, sources: Sequence[LookSource]) -> str:
    """The counts, how well each model explains them and all looks, and the correlation that these looks alone give."""
    total = seen.observed.sum()
    rows = [
        "| looks that found it | defects | fitted | each look by itself |",
        "|---|---|---|---|",
        *(
            f"| {at} of {seen.looks} | {observed:.0f} | {fitted:.1f} | {alone:.1f} |"
            for at, (observed, fitted, alone) in enumerate(
                zip(seen.observed, seen.fitted, seen.independent, strict=True)
            )
        ),
    ]
    likely = {
        name: float((seen.observed * np.log(np.maximum(expected, 1e-12) / total)).sum())
        for name, expected in (("fitted", seen.fitted), ("by itself", seen.independent))
    }
    looks = pl.concat([each.looks for each in sources])
    of_all = [likelihood(model, looks, spread) for spread in (model.spread, 0.0)]
    own = fit_sensor(sources)
    low, high = _interval(own)
    told = [
        f"{total:.0f} defects. Logarithm of the likelihood of the counts: fitted {likely['fitted']:.1f}, each look by "
        f"itself {likely['by itself']:.1f}.",
        f"Of all {looks.height} looks: fitted {of_all[0]:.1f}, each look by itself {of_all[1]:.1f}.",
        f"Correlation of the sensor that ships: {model.correlation:.2f}; fitted to these looks alone: "
        f"{own.correlation:.2f} ({low:.2f} to {high:.2f}).",
    ]
    return "\n".join([*rows, "", *told])


def _interval(model: SensorModel) -> tuple[float, float]:
    """95 % of the correlation, from the error of the logarithm of the spread."""
    number = model.log_spread
    spreads = np.exp(number.estimate + np.array([-1.96, 1.96]) * number.standard_error)
    low, high = (spreads**2 / (1 + spreads**2)).tolist()
    return float(low), float(high)
