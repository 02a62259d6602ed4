"""Tours: a table with one row per mission instead of one per segment."""

from typing import Final

import polars as pl

from pavetwin.experiments.metrics import BATTERIES, COVERAGE_DRAWS, DETECTED, FLOWN, REPLICATE, STATUS

MISSION_COLUMNS: Final = {
    **dict.fromkeys(("mission_time_s", "mission_energy", "mission_distance_m"), pl.Float64),
    "mission_batteries": pl.Int64,
}
"""Columns of tours: the whole flight from take-off to landing with battery changes, equal in all rows of a mission."""

SEGMENTS: Final = "segments"
"""Column of a mission: number of inspected segments."""

_SUMMED: Final = (
    *("length_m", "area_m2", "defects", "swept", "confirmed", "recovered", "wait_s", "occlusions", "revisits"),
    *("duplicates", "false_alarms"),
)

_BY_AREA: Final = ("surface_coverage", "permanently_hidden", "pci", "pci_found", "pci_error", *DETECTED)
"""Means weighted by the area of the segments; those of `DETECTED` in studies with a sensor that measures sizes."""


def is_by_mission(table: pl.DataFrame) -> bool:
    """True if a table has one row per mission, as `by_mission` makes it."""
    return SEGMENTS in table.columns


def by_mission(table: pl.DataFrame) -> pl.DataFrame:
    """A study's table with one row per mission if its missions are tours; any other table unchanged.

    Shares refer to all defects and the whole surface of a mission; time, energy and distance to the whole flight,
    including the way home; `batteries` counts full ones. All are null for a failed mission. A mean over segments is
    null if it is null for one of them.
    """
    if not set(MISSION_COLUMNS) <= set(table.columns):
        return table
    before = table.columns[: table.columns.index("order")]
    keys = before[: before.index(REPLICATE) + 1]
    by_area = [name for name in _BY_AREA if name in table.columns]
    drawn = [name for name in COVERAGE_DRAWS if name in table.columns]
    sums = [pl.col(name).sum() for name in _SUMMED]
    missions = table.group_by(keys, maintain_order=True).agg(
        *(pl.col(name).first() for name in before if name not in keys),
        pl.len().alias(SEGMENTS),
        *sums,
        *(_weighted(name, "area_m2").alias(f"_{name}_m2") for name in by_area),
        *(_weighted(name, "defects").alias(f"_{name}") for name in drawn),
        *(pl.col(name).first() for name in MISSION_COLUMNS),
    )
    matched, reported = (
        pl.col("confirmed") + pl.col("duplicates"),
        pl.col("confirmed") + pl.col("duplicates") + pl.col("false_alarms"),
    )
    measured: dict[str, pl.Expr] = {
        **{name: pl.col(name) for name in _SUMMED},
        "coverage": _share(pl.col("confirmed"), pl.col("defects")),
        "swath_coverage": _share(pl.col("confirmed"), pl.col("swept")),
        "recovery": _share(pl.col("recovered"), pl.col("swept")),
        **{name: _share(pl.col(f"_{name}_m2"), pl.col("area_m2")) for name in by_area},
        **{name: _share(pl.col(f"_{name}"), pl.col("defects")) for name in drawn},
        "time_s": pl.col("mission_time_s"),
        "energy": pl.col("mission_energy"),
        "distance_m": pl.col("mission_distance_m"),
        BATTERIES: pl.col("mission_batteries"),
        "precision": _share(matched, reported),
        "false_alarms_per_100_m2": 100 * _share(pl.col("false_alarms"), pl.col("_surface_coverage_m2")),
    }
    done = pl.col(STATUS) == FLOWN
    return missions.select(
        *before, SEGMENTS, *(pl.when(done).then(value).alias(name) for name, value in measured.items())
    )


def _weighted(name: str, weight: str) -> pl.Expr:
    """The weighted sum of a column; null if a segment with weight has no value."""
    missing = pl.col(name).is_null() & (pl.col(weight) > 0)
    return pl.when(~missing.any()).then((pl.col(name) * pl.col(weight)).sum())


def _share(part: pl.Expr, whole: pl.Expr) -> pl.Expr:
    """A share; null if the whole is 0."""
    return pl.when(whole > 0).then(part / whole)
