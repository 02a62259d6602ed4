"""The page: what the study was, what it found, its sections, how it was computed and how to repeat it."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl
import yaml

from pavetwin.defects import DefectOptions
from pavetwin.experiments.metrics import FACTORS, FAILED, STATUS
from pavetwin.experiments.report import front, traffic, whole
from pavetwin.experiments.report.results import group_builders
from pavetwin.experiments.report.study import AXES, Study, constants, missions_of, replicates
from pavetwin.experiments.words import factor_text, factors_text, level_text
from pavetwin.reports.blocks import Section
from pavetwin.reports.page import block_numbers, render
from pavetwin.reports.words import counted, listed, percent

MOST_WHOLE, MOST_GROUPS = 4, 16
"""Combinations of the other factors that have figures, and that have tables; all are in the files beside the page."""


def page(study: Study, sections: Sequence[Section]) -> str:
    """The text of `report.html`. Needs no network, no script and no installed font."""
    return render(
        "pavetwin.experiments.report",
        "study.html.jinja",
        title=study.title,
        study=study,
        question=front.question(study),
        answers=[(each.assumption, each.sentences) for each in study.advice],
        by_traffic=[
            (name, " ".join(" ".join(each.sentences) for each in advice)) for name, advice in study.advice_in.items()
        ],
        limited=any(each.recommendation.limits.named for each in study.advice),
        changed=front.changed_settings(study.design),
        presets=listed(list(study.design.get("presets") or ())),
        overview=[section for section in sections if section.anchor == front.OVERVIEW],
        summary=design_words(study),
        facts=facts(study),
        sections=[section for section in sections if section.anchor != front.OVERVIEW],
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
    """How many missions were flown, and how many rows that makes where one inspects several segments."""
    missions = counted(missions_of(study), "mission")
    rows = study.rows.height or study.table.height
    if study.tours:
        return f"{missions}, each a tour judged as a whole ({counted(rows, 'segment mission')} in the table)"
    if rows == missions_of(study):
        return counted(rows, "segment mission")
    return f"{missions} over several segments each, which makes {counted(rows, 'segment mission')}"


def grounds(study: Study) -> str:
    """On how much of each world the numbers rest."""
    parts = []
    for name, world in study.worlds.items():
        flown = set(study.by_segment.filter(world=name)["segment"].to_list())
        area_m2 = sum(segment.area_m2 for segment in world.segments if segment.id in flown)
        share = percent(area_m2 / sum(segment.area_m2 for segment in world.segments))
        there = counted(len(world.segments), "segment")
        parts.append(f"{len(flown)} of the {there} of {name} ({share} of their area)")
    return f"The numbers rest on {listed(parts)}." if parts else ""


def defect_words(design: Mapping[str, Any]) -> str:
    """How many defects of which classes were placed, and which files of the user's own were used; empty where the
    design does not say."""
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
    """What the page holds under its head, with every figure drawn.

    Args:
        on_progress: called with the share done.
    """
    every = list(study.groups())
    groups = every[:MOST_GROUPS]
    builders = (traffic.traffic_section, whole.effects_section, whole.streets_section, whole.failures_section)
    parts = [group_builders(group, brief=at > MOST_WHOLE) for at, group in enumerate(groups, start=1)]
    # Of the table's files and the page, which take as long as a section.
    total, done = len(builders) + sum(map(len, parts)) + 3, 0

    def made(build: Callable[[], Section]) -> list[Section]:
        nonlocal done
        section, done = build(), done + 1
        on_progress(done / total)
        return [] if section.empty else [section]

    sections = made(partial(front.overview_section, study)) + made(partial(whole.across_section, study))
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
