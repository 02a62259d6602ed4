"""The first page of a report: the question, what differs from the preset, and the figure that a reader meets first."""

from collections.abc import Mapping
from typing import Any

from pavetwin.config import load_settings
from pavetwin.config.settings import ALIASES
from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.report.figures import overview
from pavetwin.experiments.report.headline import defects_under
from pavetwin.experiments.report.study import METRIC, Group, Study
from pavetwin.experiments.statistics import Objective
from pavetwin.experiments.words import amount, factor_text, level_name, level_text
from pavetwin.reports.blocks import Section
from pavetwin.reports.canvas import vector
from pavetwin.reports.words import listed

OVERVIEW = "overview"
"""Anchor of the section with that figure."""

_MOST_PANELS = 4

_ASKED = {
    Objective.MOST_FOUND: "finds most of the pavement's defects",
    Objective.HIGHEST: "flies highest",
    Objective.FASTEST: "is the fastest",
    Objective.LEAST_ENERGY: "takes the least energy",
    Objective.MOST_ACCURATE_INDEX: "gives the most accurate condition index",
}


def question(study: Study) -> str:
    """What the study was flown to answer, under the limits of its recommendation."""
    choices = [
        factor_text(name).lower() for name in ("altitude_m", "policy", *study.swept) if len(study.levels(name)) > 1
    ]
    asked = study.advice[0].recommendation if study.advice else None
    limits, objective = (asked.limits.named, asked.objective) if asked else ({}, Objective.MOST_FOUND)
    words = {"coverage": "at least {} coverage", "time_s": "at most {} of time", "energy": "at most {}"}
    named = [words[name].format(amount(metric_named(name), limit)) for name, limit in limits.items()]
    within = f" with {listed(named)} a {_unit(study)}" if named else ""
    traffic = [level_text("traffic", level) for level in study.levels("traffic")]
    where = f"in {listed(traffic)} traffic" if len(traffic) <= _MOST_PANELS else f"in {len(traffic)} kinds of traffic"
    if not choices:
        return f"How many of the pavement's defects are found {where}{within}, and what does it cost?"
    return f"Which {listed(choices)} {_ASKED[objective]} {where}{within}?"


def _unit(study: Study) -> str:
    return "mission" if study.tours else "segment"


def changed_settings(design: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Setting, the value of the preset, and the values of the study, for each that differs from a preset of it.

    Altitudes and policies are what a study compares, and are left out.
    """
    given = {key: [value] for key, value in (design.get("set") or {}).items()} | dict(design.get("sweep") or {})
    given |= {"sensing.sensor": list(design["sensors"])} if design.get("sensors") else {}
    presets = list(design.get("presets") or ())
    changed = []
    for key, values in given.items():
        usual = [_of_preset(preset, ALIASES.get(key, key)) for preset in presets]
        if any(list(values) != [value] for value in usual):
            before = [_text(value) for value in usual]
            same = f"{before[0]}" if len(set(before)) == 1 else listed(
                [f"{text} ({preset})" for text, preset in zip(before, presets, strict=True)]
            )  # fmt: skip
            changed.append((key, same, ", ".join(map(_text, values))))
    return changed


def overview_section(study: Study) -> Section:
    """Coverage against time of every altitude and policy, for the first group of a study."""
    gain, cost = metric_named("coverage"), metric_named("time_s")
    group = next(iter(study.groups()), None)
    if group is None or not {gain, cost} <= set(study.metrics):
        return Section(OVERVIEW, "", [])
    group = group.usual
    if len(group.altitudes) * len(group.policies) < 2:
        return Section(OVERVIEW, "", [])
    of = f" ({group.title})" if group.title else ""
    picture = vector(
        overview(group, gain, cost, group.traffics[:_MOST_PANELS]),
        f"Mean coverage against mean time of a {_unit(study)}{of}, with 95 % intervals{_rests_on(group)}. The "
        "shape of a mark is the policy, its filling the altitude: the darker, the higher. Up and to the left is "
        "better.",
        "Scatter of mean coverage over mean time with intervals, a panel for each traffic density, by policy and "
        "altitude.",
    )
    return Section(OVERVIEW, "", [picture])


def _rests_on(group: Group) -> str:
    words = defects_under(row for row in group.summary.iter_rows(named=True) if row[METRIC] == "coverage")
    return f"; each coverage rests on {words}" if words else ""


def _of_preset(preset: str, setting: str) -> Any:
    value: Any = load_settings(preset).model_dump(mode="json")
    for name in setting.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


def _text(value: Any) -> str:
    return "none" if value is None else level_name(value)
