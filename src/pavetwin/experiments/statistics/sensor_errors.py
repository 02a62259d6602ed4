"""What the uncertainty of a fitted sensor adds to that of a study's means.

Replicates share the sensor: more of them do not make its parameters surer. So each mission tells its expected coverage
in draws of the parameters (`pavetwin.sensing.Sensor.found_by_draws`), the same draws in all missions, and how far a
cell's mean changes from draw to draw is added to what replicates tell.
"""

import numpy as np
import polars as pl

from pavetwin.arrays import Float64Array
from pavetwin.experiments.metrics import COVERAGE_DRAWS
from pavetwin.experiments.statistics.bootstrap import centres
from pavetwin.experiments.statistics.cells import Layout, values_of


def sensor_errors(table: pl.DataFrame, cells: Layout) -> Float64Array | None:
    """(cells, draws) by how much each draw of the sensor's parameters changes a cell's mean coverage.

    Returns:
        None where no sensor was fitted; 0 in cells of other sensors.
    """
    if any(name not in table.columns for name in COVERAGE_DRAWS):
        return None
    means = np.stack([centres(cells.means(values_of(table, name))) for name in COVERAGE_DRAWS], axis=1)
    return np.asarray(np.nan_to_num(means - means.mean(axis=1, keepdims=True)))


def widened(options: pl.DataFrame, errors: Float64Array | None) -> pl.DataFrame:
    """Options whose interval of coverage also has the sensor's error, as if both were normal; kept within 0 and 1."""
    if errors is None:
        return options
    error = pl.Series(1.96 * errors.std(axis=1, ddof=1))
    mean, low, high = (pl.col(name) for name in ("coverage", "coverage_low", "coverage_high"))
    return options.with_columns(
        (mean - ((mean - low) ** 2 + error**2).sqrt()).clip(0.0, 1.0).alias("coverage_low"),
        (mean + ((high - mean) ** 2 + error**2).sqrt()).clip(0.0, 1.0).alias("coverage_high"),
    )
