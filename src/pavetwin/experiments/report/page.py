"""The page of a study's report: its answer, its sections, its method and how to repeat it."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl
import yaml

from pavetwin.config import load_settings
from pavetwin.config.settings import ALIASES
from pavetwin.defects import DefectOptions
from pavetwin.experiments.metrics import FACTORS, FAILED, STATUS, metric_named
from pavetwin.experiments.report import study_sections, tables
from pavetwin.experiments.report.figures import overview
from pavetwin.experiments.report.proposals import ANSWER, answer_section, findings_section
from pavetwin.experiments.report.results import group_builders
from pavetwin.experiments.report.study import AXES, METRIC, Group, Study, constants, missions_of, replicates
from pavetwin.experiments.report.tables import defects_under
from pavetwin.experiments.statistics import Objective
from pavetwin.experiments.words import amount, factor_text, factors_text, level_name, level_text
from pavetwin.files import writing
from pavetwin.reports.blocks import Section
from pavetwin.reports.canvas import vector
from pavetwin.reports.page import block_numbers, figure_files, render
from pavetwin.reports.words import counted, listed, percent

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


MOST_WHOLE, MOST_GROUPS = 4, 16
"""Largest numbers of combinations of the other factors with figures, and with tables; the files hold all."""


def write_report(
    study: Study, folder: Path, on_progress: Callable[[float], None] | None = None, *, figures: bool = False
) -> list[Path]:
    """Write `report.html`, `table.csv`, `table.md`, `table.tex` and, where something is compared in pairs,
    `differences.csv` into `folder`. The same study gives the same bytes.

    Args:
        on_progress: called with the share done.
        figures: write each figure also as a file of its own, `figures/figure-N.svg`; maps as PNG.

    Returns:
        The files.

    Raises:
        PaveTwinError: a file cannot be written; it is then unchanged.
    """
    report = on_progress or (lambda _: None)
    sections = sections_of(study, report)
    files = {
        "report.html": page(study, sections).encode(),
        "table.csv": tables.csv(study.summary).encode(),
        "table.md": tables.markdown(study).encode(),
        "table.tex": tables.latex(study).encode(),
    }
    if study.comparisons:
        files["differences.csv"] = tables.differences_csv(study).encode()
    if figures:
        files |= figure_files(sections)
    for name, content in files.items():
        with writing(folder / name) as temporary:
            temporary.write_bytes(content)
    report(1.0)
    return [folder / name for name in files]


def page(study: Study, sections: Sequence[Section]) -> str:
    """The text of `report.html`. Needs no network, no script and no installed font."""
    return render(
        "pavetwin.experiments.report",
        "study.html.jinja",
        title=study.title,
        study=study,
        question=question(study),
        answers=[(each.assumption, each.sentences) for each in study.advice],
        limited=any(each.recommendation.limits.named for each in study.advice),
        changed=changed_settings(study.design),
        presets=listed(list(study.design.get("presets") or ())),
        answer=[section for section in sections if section.anchor == ANSWER],
        overview=[section for section in sections if section.anchor == OVERVIEW],
        summary=design_words(study),
        facts=facts(study),
        sections=[section for section in sections if section.anchor not in (ANSWER, OVERVIEW)],
        numbers=block_numbers(sections),
        design=design_text(study.design),
        metrics={metric.name for metric in study.metrics},
        compared=bool(study.comparisons),
        explained=bool(study.effects.height),
    )


def design_words(study: Study) -> str:
    varied = [name for name in (*AXES, *study.others) if name in study.table and len(study.levels(name)) > 1]
    parts = [
        f"{counted(len(study.levels(name)), factor_text(name).lower(), factors_text(name))} ({_levels(study, name)})"
        for name in varied
    ]
    design = " × ".join([*parts, counted(replicates(study), "replicate")])
    planned = study.design.get("replicates")
    result = replicates(study)
    so_far = f" Of {planned} replicates {result} are flown so far." if planned and planned > result else ""
    fixed = [f"{factor_text(name).lower()} {level_text(name, level)}" for name, level in constants(study).items()]
    same = f" The same throughout: {', '.join(fixed)}." if fixed else ""
    streets = study.design.get("streets")
    drawn = f" {placed}" if (placed := defect_words(study.design)) else ""
    drawn += f" Segments are drawn from {listed(streets)} alone." if streets else ""
    has = "traffic, defects and an order of the segments" if study.tours else "a street segment, traffic and defects"
    if study.tours and study.design.get("order") == "near":
        has = "traffic and defects"
    return (
        f"{_missions_words(study)}: {design}.{so_far}{same}{drawn} A replicate has {has} of its own, and every "
        "combination was flown over the same ones, so that policies and altitudes are compared in pairs. "
        f"{grounds(study)}"
    ).strip()


def _missions_words(study: Study) -> str:
    """Number of missions, and of rows if one inspects several segments."""
    missions = counted(missions_of(study), "mission")
    rows = study.rows.height or study.table.height
    if study.tours:
        return f"{missions}, each a tour judged as a whole ({counted(rows, 'segment mission')} in the table)"
    if rows == missions_of(study):
        return counted(rows, "segment mission")
    return f"{missions} over several segments each, which makes {counted(rows, 'segment mission')}"


def grounds(study: Study) -> str:
    """Flown share of each world."""
    parts = []
    for name, world in study.worlds.items():
        flown = set(study.by_segment.filter(world=name)["segment"].to_list())
        area_m2 = sum(segment.area_m2 for segment in world.segments if segment.id in flown)
        share = percent(area_m2 / sum(segment.area_m2 for segment in world.segments))
        there = counted(len(world.segments), "segment")
        parts.append(f"{len(flown)} of the {there} of {name} ({share} of their area)")
    return f"The numbers rest on {listed(parts)}." if parts else ""


def defect_words(design: Mapping[str, Any]) -> str:
    """Number and classes of the placed defects, and the user's own files; empty if the design states neither."""
    placing, sentences = design.get("defects"), []
    if placing == "world":
        sentences.append("Defects are those of the world.")
    elif placing == "placed":
        sentences.append("Defects are placed in each replicate, as densely and of the classes as in the world.")
    elif isinstance(placing, Mapping):
        options = DefectOptions.model_validate(placing)
        density = options.density()
        varied = " on average, varying by street and segment" if density.street_sigma or density.segment_sigma else ""
        per_area = f"{density.per_100_m2:g} per 100 m²{varied}" if density.per_100_m2 is not None else ""
        number = per_area or f"{density.per_segment:g} a segment"
        shares = [f"{name} {weight:g}" for name, weight in sorted(options.mix.items())]
        mix = f"of the classes {listed(shares)} (weights), " if shares else ""
        of = Path(options.population).name
        sentences.append(f"Defects are placed in each replicate: {number}, {mix}by the damage population {of}.")
    if sentences and placing != "world":
        sentences.append("They are placed by the program, not surveyed.")
    hashes = design.get("files") or {}
    if own := [f"{Path(path).name} ({content})" for path, content in hashes.items()]:
        sentences.append(f"Files of your own, with the beginning of their SHA-256: {listed(own)}.")
    return " ".join(sentences)


def facts(study: Study) -> list[tuple[str, str]]:
    """The numbers that a reader looks for first."""
    failed = study.table.filter(pl.col(STATUS) == FAILED).height
    cells = study.table.select(name for name in study.table.columns if name in {*FACTORS, *study.factors}).n_unique()
    numbers = {
        "Missions": f"{missions_of(study):,}".replace(",", "\u2009"),
        "Cells": cells,
        "Replicates": replicates(study),
        "Failed": failed,
        "Seed": study.design.get("seed"),
        "PaveTwin": study.design.get("version"),
    }
    return [(name, f"{value}") for name, value in numbers.items() if value is not None]


def design_text(design: Mapping[str, Any]) -> str:
    """The design as YAML, without what it was flown with, which is not part of the file."""
    values = {key: value for key, value in design.items() if key not in {"version", "made_with", "files"}}
    plain = json.loads(json.dumps(values, default=str))
    return yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, allow_unicode=True, width=100).rstrip()


def sections_of(study: Study, on_progress: Callable[[float], None] = lambda _: None) -> list[Section]:
    """The sections of the page, with every figure drawn.

    Args:
        on_progress: called with the share done.
    """
    every = list(study.groups())
    groups = every[:MOST_GROUPS]
    builders = (
        study_sections.traffic_section,
        study_sections.effects_section,
        study_sections.streets_section,
        study_sections.failures_section,
    )
    parts = [group_builders(group, brief=at > MOST_WHOLE) for at, group in enumerate(groups, start=1)]
    # Of the table's files and the page, which take as long as a section.
    total, done = len(builders) + sum(map(len, parts)) + 5, 0

    def made(build: Callable[[], Section]) -> list[Section]:
        nonlocal done
        section, done = build(), done + 1
        on_progress(done / total)
        return [] if section.empty else [section]

    first = (answer_section, overview_section, findings_section, study_sections.across_section)
    sections = [section for build in first for section in made(partial(build, study))]
    for at, (group, part) in enumerate(zip(groups, parts, strict=True), start=1):
        prefix = f"results-{at}-" if group.key else ""
        inner = [section for build in part for section in made(partial(build, prefix))]
        whole_group = Section(f"results-{at}", f"Results: {group.title}", (), inner)
        sections += inner if not group.key else [] if whole_group.empty else [whole_group]
    if len(every) > len(groups):
        rest = counted(len(every) - len(groups), "more combination")
        words = f"{rest} of the other factors: see table.csv, table.md and table.tex."
        sections.append(Section("more", "Further results", [words]))
    return sections + [section for build in builders for section in made(partial(build, study))]


def _levels(study: Study, name: str) -> str:
    levels = [level_text(name, level) for level in study.levels(name)]
    return listed(levels) if len(levels) <= 12 else f"{', '.join(levels[:10])} … {levels[-1]}"


def question(study: Study) -> str:
    """The question that the study answers, under the limits of its recommendation."""
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
