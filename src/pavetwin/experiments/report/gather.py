"""A study from its table: every statistic that its report shows, and what the levels of a factor are compared with."""

from collections.abc import Mapping, Sequence
from typing import Any

import polars as pl

from pavetwin.config import load_settings
from pavetwin.config.settings import ALIASES
from pavetwin.experiments.advice import advise
from pavetwin.experiments.metrics import EVERY_PAIR, FACTORS, REFERENCE, REPLICATE, metrics_in
from pavetwin.experiments.report.study import Study
from pavetwin.experiments.statistics import (
    Comparison,
    MissionLimits,
    Objective,
    conclusions,
    differences,
    effects,
    every_pair,
    key_findings,
    summarise,
)
from pavetwin.experiments.statistics.cells import levels_of
from pavetwin.experiments.tours import by_mission, is_by_mission
from pavetwin.world.model import World

_MOST_TRAFFICS = 6
"""With more kinds of traffic there is no recommendation for each."""


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
    sentences = conclusions(summary, compared, explained, tours=is_by_mission(table))
    within = limits or MissionLimits()
    traffics = levels["traffic"] if 1 < len(levels["traffic"]) <= _MOST_TRAFFICS else []
    asked: dict[str, Any] = {"objective": objective, "seed": seed, "design": design}
    advice_in = {name: advise(table.filter(traffic=name), within, **asked) for name in traffics}
    return Study(
        *(title, design, factors, table, summary, compared, explained, sentences, worlds),
        rows=rows,
        findings=key_findings(compared),
        advice=advise(table, within, **asked),
        advice_in=advice_in,
    )


def references(levels: Mapping[str, Sequence[Any]], design: Mapping[str, Any]) -> dict[str, tuple[Any, str]]:
    """For policies and every swept setting, where there are several: its reference, and why it is that one.

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
