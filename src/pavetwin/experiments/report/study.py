"""A study as its report shows it: the table, its statistics, and the groups of cells."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import polars as pl

from pavetwin.config import load_settings
from pavetwin.config.settings import ALIASES
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.advice import Advice, advise
from pavetwin.experiments.design import IN_DESIGN, Design
from pavetwin.experiments.metrics import (
    EVERY_METRIC,
    EVERY_PAIR,
    FACTORS,
    FLOWN,
    REFERENCE,
    REPLICATE,
    STATUS,
    Metric,
    metrics_in,
)
from pavetwin.experiments.statistics import (
    Comparison,
    MissionLimits,
    Objective,
    differences,
    effects,
    every_pair,
    summarise,
)
from pavetwin.experiments.statistics.cells import failed_alone, levels_of
from pavetwin.experiments.store import Store
from pavetwin.experiments.tours import by_mission, is_by_mission
from pavetwin.experiments.words import factor_text, level_text
from pavetwin.reports.words import listed
from pavetwin.world.model import World
from pavetwin.world.store import load_world

AXES: Final = ("traffic", "altitude_m", "policy")
"""The factors that one table or plot shows together: density and altitude down the side, policies across."""

METRIC: Final = "metric"
"""The column of the summary before which the columns of the cell stand."""

Row = Mapping[str, Any]

_KNOWN_ORDER: Final = (REFERENCE, "low", "medium", "high")


@dataclass(frozen=True)
class Study:
    """Everything that a report shows; nothing in it is computed here."""

    title: str
    design: Mapping[str, Any]
    """Plain values of `design.yaml`."""
    factors: tuple[str, ...]
    table: pl.DataFrame
    """One row a segment mission, or one a mission where missions are tours; see `pavetwin.experiments.metrics`."""
    summary: pl.DataFrame
    comparisons: Sequence[Comparison]
    """Paired differences of policies, then of altitudes, each with every lower one, then of each swept setting; those
    with nothing to compare are left out."""
    effects: pl.DataFrame
    """Shares of variation by factor; empty if nothing varies."""
    worlds: Mapping[str, World]
    """Keyed by the names in the table; missing worlds get no map."""
    advice: Sequence[Advice] = ()
    """Recommendations, one for each combination of the assumptions."""
    advice_in: Mapping[str, Sequence[Advice]] = field(default_factory=dict)
    """Recommendations in each traffic, if there are several."""

    rows: pl.DataFrame = field(default_factory=pl.DataFrame)
    """The table with one row per segment mission; empty if `table` is that."""

    @property
    def tours(self) -> bool:
        """True if missions are judged as a whole instead of by segment."""
        return is_by_mission(self.table)

    @property
    def by_segment(self) -> pl.DataFrame:
        """The flown rows, one per segment mission."""
        rows = self.rows if self.rows.height else self.table
        return rows.filter(pl.col(STATUS) == FLOWN)

    @cached_property
    def others(self) -> tuple[str, ...]:
        """The factors that vary and are not among `AXES`."""
        known = set(self.summary.columns) - set(AXES)
        return tuple(name for name in self.factors if name in known and len(levels_of(self.table, name)) > 1)

    @property
    def apart(self) -> tuple[str, ...]:
        """Other factors whose combinations have a section each."""
        return tuple(name for name in self.others if name in FACTORS)

    @property
    def swept(self) -> tuple[str, ...]:
        """Other factors that are settings: shown together, as further rows of tables and along an axis."""
        return tuple(name for name in self.others if name not in FACTORS)

    def compared(self, factor: str) -> list[Comparison]:
        """The comparisons of a factor's levels, one a reference."""
        return [found for found in self.comparisons if found.factor == factor]

    @cached_property
    def usual(self) -> Mapping[str, Any]:
        """The reference level of each swept setting, at which everything else is drawn."""
        compared = {found.factor: found.reference for found in self.comparisons}
        return {name: compared.get(name, self.levels(name)[0]) for name in self.swept}

    @cached_property
    def metrics(self) -> tuple[Metric, ...]:
        """Metrics with a defined value anywhere."""
        defined = self.summary.filter(pl.col("mean").is_not_null())[METRIC].unique().to_list()
        return tuple(metric for metric in EVERY_METRIC if metric.name in defined)

    @cached_property
    def result(self) -> pl.DataFrame:
        return self.table.filter(pl.col(STATUS) == FLOWN)

    def levels(self, factor: str) -> list[Any]:
        """The levels of a factor: in the design's order, those it does not name after them."""
        found = levels_of(self.table, factor)
        swept = self.design.get("sweep") or {}
        known = IN_DESIGN.get(factor)
        requested = self.design.get(known) if known else swept.get(factor, swept.get(factor.removesuffix("_set")))
        named = [level for level in requested if level in found] if isinstance(requested, list | tuple) else []
        return [*dict.fromkeys(named), *sorted((level for level in found if level not in named), key=_order)]

    def groups(self) -> Iterator["Group"]:
        """One for each combination of the factors that stand apart, in the order of their levels."""
        for key in self.combinations(self.apart):
            yield Group(self, key)

    def combinations(self, names: Sequence[str]) -> list[dict[str, Any]]:
        """Flown combinations of levels of other factors, in order; a single empty one without factors.

        Policies without a swept setting make no combination of their own if those that have it can show them.
        """
        cells = self.summary.select(names).unique() if names else pl.DataFrame({"": [0]})
        keys = [{name: row[name] for name in names} for row in cells.iter_rows(named=True)]
        shown = [key for key in keys if not (None in key.values() and any(_holds(other, key) for other in keys))]
        return sorted(shown, key=self.place)

    def place(self, key: Mapping[str, Any]) -> list[int]:
        """Sort key of a combination of levels among others of the same factors; missing levels come first."""
        return [self._places[name].get(level, -1) for name, level in key.items()]

    @cached_property
    def _places(self) -> dict[str, dict[Any, int]]:
        names = {*AXES, *self.summary.columns[: self.summary.columns.index(METRIC)]}
        return {name: {level: at for at, level in enumerate(self.levels(name))} for name in names}


@dataclass(frozen=True)
class Group:
    """The cells of one combination of some other factors: densities by altitudes by policies, by what is swept."""

    study: Study
    key: Mapping[str, Any]
    """The levels of those factors; empty where there are none."""

    @property
    def title(self) -> str:
        """`world town, tau_o 0.5`; empty where the key is."""
        return ", ".join(f"{factor_text(name).lower()} {level_text(name, level)}" for name, level in self.key.items())

    @cached_property
    def summary(self) -> pl.DataFrame:
        return self._placed(self.study.summary)

    @property
    def swept(self) -> tuple[str, ...]:
        """The settings that vary within the group."""
        free = (name for name in self.study.swept if name not in self.key)
        return tuple(name for name in free if levels_of(self.summary, name))

    def at(self, levels: Mapping[str, Any]) -> "Group":
        """The cells with these levels of other factors."""
        return Group(self.study, {**self.key, **levels})

    @cached_property
    def parts(self) -> list["Group"]:
        """One for each combination of what is swept."""
        return [self.at(levels) for levels in self.study.combinations(self.swept)] if self.swept else [self]

    @property
    def usual(self) -> "Group":
        """Its part at the usual level of all that is swept."""
        return self.at({name: self.study.usual[name] for name in self.swept})

    def differences(self, comparison: Comparison) -> pl.DataFrame:
        """The rows of a comparison in this group."""
        return self._placed(comparison.differences)

    @cached_property
    def result(self) -> pl.DataFrame:
        return self._chosen(self.study.result)

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

    def failed_alone(self, traffic: Any, altitude_m: Any, policy: Any) -> int:
        """Number of failed missions of a cell that another option in the same traffic flew."""
        return self._failed_alone.get((traffic, altitude_m, policy), 0)

    def without(self, factor: str) -> str:
        """`baseline and skip`: the policies without a factor; empty if all have it."""
        have_not = set(self.summary.filter(pl.col(factor).is_null())["policy"].to_list())
        return listed([level_text("policy", policy) for policy in self.policies if policy in have_not])

    @cached_property
    def _failed_alone(self) -> Counter[tuple[Any, ...]]:
        table = self._chosen(self.study.table)
        return Counter(table.filter(failed_alone(table, AXES[1:])).select(AXES).rows())

    def _levels(self, axis: str) -> list[Any]:
        found = set(self.summary[axis].to_list())
        return [level for level in (*self.study.levels(axis), None) if level in found]

    def _chosen(self, frame: pl.DataFrame) -> pl.DataFrame:
        same = [
            pl.col(name).is_null() | pl.col(name).eq_missing(level)
            for name, level in self.key.items()
            if name in frame.columns
        ]
        return frame.filter(*same) if same else frame

    def _placed(self, frame: pl.DataFrame) -> pl.DataFrame:
        """Rows of this group with all axes: a missing one takes its only level, or null for all together."""
        lacking = {axis: self.study.levels(axis) for axis in AXES if axis not in frame.columns}
        only = [pl.lit(levels[0] if len(levels) == 1 else None).alias(axis) for axis, levels in lacking.items()]
        return self._chosen(frame).with_columns(only)


def _holds(key: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """True if a combination has all levels of another, and more."""
    return key != other and all(level in (None, key[name]) for name, level in other.items())


def replicates(study: Study) -> int:
    """Largest number of replicates of a world."""
    return study.table[REPLICATE].n_unique() if study.table.height else 0


def missions_of(study: Study) -> int:
    """Number of missions, flown or failed; one over several segments is several segment missions."""
    table = study.table
    return table.select(table.columns[: table.columns.index(REPLICATE) + 1]).n_unique()


def constants(study: Study) -> dict[str, Any]:
    """The factors that have one level in the whole study."""
    return {name: study.table[name][0] for name in FACTORS if name in study.table and study.table[name].n_unique() == 1}


def _order(level: Any) -> tuple[int, Any]:
    """Known names in their order, then truth values and numbers by size, then other names as they come."""
    if isinstance(level, str):
        return (0, _KNOWN_ORDER.index(level)) if level in _KNOWN_ORDER else (2, 0)
    return (1, float(level)) if level is not None else (3, 0)


_MOST_TRAFFICS = 6  # More kinds of traffic have no recommendation of their own


def gather(
    title: str,
    design: Mapping[str, Any],
    table: pl.DataFrame,
    worlds: Mapping[str, World],
    *,
    limits: MissionLimits | None = None,
    objective: Objective = Objective.MOST_FOUND,
    seed: int = 0,
) -> Study:
    """The statistics of a table over everything that it varies.

    Args:
        design: plain values of `design.yaml`, and the `version` that flew it.
        worlds: by the names in the table; those that are not here get no map.
        limits, objective: of the recommendation.
        seed: of the resamples.
    """
    rows, table = table, by_mission(table)
    by = table.columns[: table.columns.index(REPLICATE)]
    levels = {name: levels_of(table, name) for name in by}
    factors = tuple(name for name in by if len(levels[name]) > 1)
    summary = summarise(table, by, metrics_in(table), seed=seed)
    compared: list[Comparison] = []
    for factor, (reference, reason) in references(levels, design).items():
        if factor == "policy" and design.get("compare") == EVERY_PAIR:
            compared += every_pair(table, by, levels[factor], factor=factor, seed=seed)
        else:
            found = differences(table, by, factor=factor, reference=reference, seed=seed)
            compared.append(Comparison(factor, reference, reason, found))
    after_policies = sum(found.factor == "policy" for found in compared)
    heights = sorted(levels["altitude_m"])
    compared[after_policies:after_policies] = every_pair(table, by, heights, factor="altitude_m", seed=seed)
    explained = effects(table, factors)
    within = limits or MissionLimits()
    traffics = levels["traffic"] if 1 < len(levels["traffic"]) <= _MOST_TRAFFICS else []
    asked: dict[str, Any] = {"objective": objective, "seed": seed, "design": design}
    advice_in = {name: advise(table.filter(traffic=name), within, **asked) for name in traffics}
    return Study(
        *(title, design, factors, table, summary, compared, explained, worlds),
        rows=rows,
        advice=advise(table, within, **asked),
        advice_in=advice_in,
    )


def references(levels: Mapping[str, Sequence[Any]], design: Mapping[str, Any]) -> dict[str, tuple[Any, str]]:
    """The reference of policies and of every swept setting with several levels, and the reason for it.

    Args:
        levels: of each factor, in the design's order.
        design: plain values of `design.yaml`.
    """
    compared = [factor for factor in levels if factor == "policy" or factor not in FACTORS]
    return {factor: _reference(factor, list(levels[factor]), design) for factor in compared if len(levels[factor]) > 1}


def _reference(factor: str, levels: list[Any], design: Mapping[str, Any]) -> tuple[Any, str]:
    wanted = design.get("compare", REFERENCE)
    if factor == "policy" and wanted in levels:
        return wanted, "" if wanted == REFERENCE else "as the design has it"
    if factor not in FACTORS:
        usual = _of_presets(factor, design)
        if len(usual) == 1 and usual[0] in levels:
            return usual[0], "as the preset has it"
    absent = f", as {REFERENCE} is not among them" if factor == "policy" else ""
    return levels[0], f"the first that the design names{absent}"


def _of_presets(column: str, design: Mapping[str, Any]) -> list[Any]:
    """The values that the design's presets have for a swept setting, each once; as the table writes them."""
    keys = [key for key in design.get("sweep", {}) if column in (key, f"{key}_set")]
    found: list[Any] = []
    for key in keys:
        texts = {type(value) for value in design["sweep"][key]} - {int, float}
        for preset in design.get("presets", ()):
            value: Any = load_settings(preset)
            for name in ALIASES.get(key, key).split("."):
                value = getattr(value, name, None)
            value = str(value) if texts and texts != {bool} else value
            found += [value] if value not in found else []
    return found


def gather_folder(
    store: Store, *, limits: MissionLimits | None = None, objective: Objective = Objective.MOST_FOUND
) -> Study:
    """The statistics of what was flown so far.

    Args:
        limits, objective: of the recommendation.

    Raises:
        PaveTwinError: the folder holds no study, nothing of it is flown, or a file is damaged.
    """
    description, table, design = store.description(), store.table(), store.design()
    return gather(
        design.name, _plain(description), table, _worlds(design), limits=limits, objective=objective, seed=design.seed
    )


def _plain(description: dict[str, Any]) -> dict[str, Any]:
    """The design and the versions it was flown with, as a report shows them."""
    return {
        **description["design"],
        "version": description["versions"]["pavetwin"],
        "files": description.get("files") or {},
        "made_with": {
            "SUMO": description["versions"]["libsumo"],
            **{f"world {name}": content for name, content in description["worlds"].items()},
        },
        "worlds": [
            world if world["routes"] or world["recordings"] or world.get("nearest") else world["path"]
            for world in description["design"]["worlds"]
        ],
    }


def _worlds(design: Design) -> dict[str, World]:
    """Worlds that can still be read; the others get no map."""
    found = {}
    for entry in design.worlds:
        try:
            world = load_world(Path(entry.path))
        except PaveTwinError:
            continue
        found[world.name] = world
    return found
