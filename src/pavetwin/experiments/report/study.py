"""What a report is made of: a study with its table and statistics, and the parts that it is told in."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any, Final

import polars as pl

from pavetwin.experiments.metrics import FACTORS, FLOWN, METRICS, REFERENCE, REPLICATE, STATUS, Metric
from pavetwin.experiments.report.words import factor_text, level_text
from pavetwin.world.model import World

AXES: Final = ("traffic", "altitude_m", "policy")
"""The factors that one table or plot shows together: density and altitude down the side, policies across."""

METRIC: Final = "metric"
"""The column of the summary before which the columns of the cell stand."""

Row = Mapping[str, Any]

_IN_DESIGN: Mapping[str, str] = {
    "world": "worlds",
    "traffic": "densities",
    "altitude_m": "altitudes_m",
    "policy": "policies",
    "sensor": "sensors",
    "preset": "presets",
}
_KNOWN_ORDER: Final = (REFERENCE, "low", "medium", "high")


@dataclass(frozen=True)
class Study:
    """Everything that a report shows; nothing in it is computed here."""

    title: str
    design: Mapping[str, Any]
    """Plain values of `design.yaml`."""
    factors: tuple[str, ...]
    """Columns of the table that vary."""
    table: pl.DataFrame
    """One row a segment mission; see `pavetwin.experiments.metrics`."""
    summary: pl.DataFrame
    """One row a cell and metric."""
    differences: pl.DataFrame
    """Paired differences of each policy to the reference; empty where nothing was compared."""
    effects: pl.DataFrame
    """Which factor explains how much; empty where nothing varies."""
    conclusions: Sequence[str]
    worlds: Mapping[str, World]
    """By the names in the table; worlds that are not here get no map."""

    @cached_property
    def others(self) -> tuple[str, ...]:
        """The factors that vary and are not among `AXES`: each of their combinations has a section of its own."""
        known = self.summary.columns
        return tuple(name for name in self.factors if name in known and name not in AXES and self._varies(name))

    @cached_property
    def metrics(self) -> tuple[Metric, ...]:
        """Those with a defined value anywhere."""
        defined = self.summary.filter(pl.col("mean").is_not_null())[METRIC].unique().to_list()
        return tuple(metric for metric in METRICS if metric.name in defined)

    @cached_property
    def flown(self) -> pl.DataFrame:
        """The table without the missions that failed."""
        return self.table.filter(pl.col(STATUS) == FLOWN)

    def levels(self, factor: str) -> list[Any]:
        """The levels of a factor: in the design's order, those it does not name after them."""
        found = self.table[factor].unique(maintain_order=True).to_list()
        swept = self.design.get("sweep") or {}
        known = _IN_DESIGN.get(factor)
        wished = self.design.get(known) if known else swept.get(factor, swept.get(factor.removesuffix("_set")))
        named = [level for level in wished if level in found] if isinstance(wished, list | tuple) else []
        return [*dict.fromkeys(named), *sorted((level for level in found if level not in named), key=_order)]

    def groups(self) -> Iterator["Group"]:
        """One for each combination of the other factors, in the order of their levels."""
        cells = self.summary.select(self.others).unique() if self.others else pl.DataFrame({"": [0]})
        keys = [{name: row[name] for name in self.others} for row in cells.iter_rows(named=True)]
        places = {name: {level: at for at, level in enumerate(self.levels(name))} for name in self.others}
        for key in sorted(keys, key=lambda key: [places[name][level] for name, level in key.items()]):
            yield Group(self, key)

    def _varies(self, factor: str) -> bool:
        return self.table[factor].n_unique() > 1


@dataclass(frozen=True)
class Group:
    """The cells of one combination of the other factors: densities by altitudes by policies."""

    study: Study
    key: Mapping[str, Any]
    """The levels of the other factors; empty where there are none."""

    @property
    def title(self) -> str:
        """`world town, tau_o 0.5`; empty where nothing else varies."""
        return ", ".join(f"{factor_text(name).lower()} {level_text(name, level)}" for name, level in self.key.items())

    @cached_property
    def summary(self) -> pl.DataFrame:
        return self._placed(self.study.summary)

    @cached_property
    def differences(self) -> pl.DataFrame:
        return self._placed(self.study.differences)

    @cached_property
    def flown(self) -> pl.DataFrame:
        return self._chosen(self.study.flown)

    @cached_property
    def traffics(self) -> list[Any]:
        return self._levels("traffic")

    @cached_property
    def altitudes(self) -> list[Any]:
        return self._levels("altitude_m")

    @cached_property
    def policies(self) -> list[Any]:
        return self._levels("policy")

    def cell(self, metric: str, traffic: Any, altitude_m: Any, policy: Any) -> Row | None:
        """The row of the summary, if that cell was flown."""
        return self._cells.get((metric, traffic, altitude_m, policy))

    @cached_property
    def _cells(self) -> dict[tuple[Any, ...], Row]:
        return {(row[METRIC], *(row[axis] for axis in AXES)): row for row in self.summary.iter_rows(named=True)}

    def _levels(self, axis: str) -> list[Any]:
        found = set(self.summary[axis].to_list())
        return [level for level in (*self.study.levels(axis), None) if level in found]

    def _chosen(self, frame: pl.DataFrame) -> pl.DataFrame:
        same = [pl.col(name).eq_missing(level) for name, level in self.key.items() if name in frame.columns]
        return frame.filter(*same) if same else frame

    def _placed(self, frame: pl.DataFrame) -> pl.DataFrame:
        """Of this group, with all axes: one that the frame lacks takes its only level, or null for all together."""
        lacking = {axis: self.study.levels(axis) for axis in AXES if axis not in frame.columns}
        only = [pl.lit(levels[0] if len(levels) == 1 else None).alias(axis) for axis, levels in lacking.items()]
        return self._chosen(frame).with_columns(only)


def shown_groups(study: Study, most: int) -> tuple[list[Group], int]:
    """The first `most` groups, and how many there are."""
    groups = list(study.groups())
    return list(islice(groups, most)), len(groups)


def replicates(study: Study) -> int:
    """How many replicates a world has, at most."""
    return study.table[REPLICATE].n_unique() if study.table.height else 0


def constants(study: Study) -> dict[str, Any]:
    """The factors that have one level in the whole study."""
    return {name: study.table[name][0] for name in FACTORS if name in study.table and study.table[name].n_unique() == 1}


def _order(level: Any) -> tuple[int, Any]:
    """Known names in their order, then truth values and numbers by size, then other names as they come."""
    if isinstance(level, str):
        return (0, _KNOWN_ORDER.index(level)) if level in _KNOWN_ORDER else (2, 0)
    return (1, float(level)) if level is not None else (3, 0)
