"""The effects as Markdown tables, for docs/limits.md."""

from collections.abc import Sequence

import polars as pl

from benchmarks.effects.catalogue import Kind
from benchmarks.effects.sizes import FLIGHT, MEASURED, Effect, Option, compared, option_text, proposed, ranked
from benchmarks.effects.tour import Tour
from benchmarks.effects.words import gap, markdown
from pavetwin.experiments.statistics import MissionLimits
from pavetwin.experiments.words import shown
from pavetwin.reports.words import MISSING, number, percent

COVERAGE, SEEN, HIDDEN, _WAITING, TIME, ENERGY = MEASURED
SHOWN = (COVERAGE, SEEN, TIME, ENERGY)
RELATIVE = (TIME, ENERGY)
"""Shown as shares of what they are without the change."""
CHOSEN = (COVERAGE, SEEN, _WAITING, TIME, ENERGY)
HEADINGS = {
    "coverage": "found, points",
    "surface_coverage": "surface seen, points",
    "wait_s": "waiting, s",
    "time_s": "time, s",
    "energy": "battery, points",
}
SECTIONS = {
    Kind.LEFT_OUT: "What the twin knows: as if it did not",
    Kind.CONDITION: "What depends on the day",
    Kind.ASSUMPTION: "What is assumed or chosen",
    Kind.CHANCE: "Chance alone",
}


def default_line(default: pl.DataFrame, limits: MissionLimits) -> str:
    """How the default flies: what the changes of the tables are changes of."""
    flight = default.filter(altitude_m=FLIGHT[0], policy=FLIGHT[1])
    own = {row["metric"]: row["before"] for row in compared({"one": flight, "same": flight}).iter_rows(named=True)}
    replicates, worlds = default["replicate"].n_unique(), default["world"].n_unique()
    return (
        f"As it is now, {option_text(FLIGHT)}, a segment: found {shown(COVERAGE, own['coverage'])} %, surface seen "
        f"{shown(SEEN, own['surface_coverage'])} of {shown(HIDDEN, 1 - own['permanently_hidden'])} %, waiting "
        f"{shown(_WAITING, own['wait_s'])} s, time {shown(TIME, own['time_s'])} s, {shown(ENERGY, own['energy'])} % of "
        f"a battery; proposed: {option_text(proposed(default, limits))}. {replicates} replicates in each of {worlds} "
        f"worlds, {number(float(flight.select(pl.col('defects').mean()).item()), 0)} defects a segment."
    )


def effects_table(found: Sequence[Effect], kind: Kind) -> str:
    """The changes of a kind over all worlds together, the largest first. Bold is what the interval tells from 0."""
    rows = []
    for effect in ranked(found):
        if effect.variant.kind is kind:
            gaps = [gap(effect.flight, metric, relative=metric in RELATIVE) for metric in SHOWN]
            lost = "same" if effect.decision is None else gap(effect.decision, COVERAGE)
            rows.append([effect.variant.title, *gaps, option_text(effect.options[1]), lost])
    head = [
        "found, points",
        "surface seen, points",
        "time, %",
        "battery, %",
        "proposed",
        "lost by the decision, points",
    ]
    return markdown(["", *head], rows)


def proposals_table(default: pl.DataFrame, found: Sequence[Effect], limits: MissionLimits) -> str:
    """What is proposed for each world."""
    worlds = default["world"].unique(maintain_order=True).to_list()
    rows = [["**as it is now**", *(option_text(proposed(default.filter(world=world), limits)) for world in worlds)]]
    for effect in ranked(found):
        of = {each.scope: each for each in found if each.variant == effect.variant}
        rows.append([effect.variant.title, *(_proposal(of[world]) for world in worlds)])
    return markdown(["proposed", *worlds], rows)


def _proposal(effect: Effect) -> str:
    """`baseline, 30 m: −3.9 (−9.5 to +0.8)`."""
    if effect.decision is None:
        return "same"
    return f"{option_text(effect.options[1])}: {gap(effect.decision, COVERAGE)}"


def choices_table(default: pl.DataFrame) -> str:
    """What another policy or altitude changes, which is what one decides about."""
    reference = default.filter(altitude_m=FLIGHT[0], policy=FLIGHT[1])
    others: list[Option] = [(FLIGHT[0], name) for name in default["policy"].unique(maintain_order=True).to_list()]
    others += [(altitude_m, FLIGHT[1]) for altitude_m in default["altitude_m"].unique(maintain_order=True).to_list()]
    rows = []
    for altitude_m, policy in others:
        if (altitude_m, policy) != FLIGHT:
            other = default.filter(altitude_m=altitude_m, policy=policy)
            gaps = compared({"usual": reference, "other": other})
            rows.append([option_text((altitude_m, policy)), *(gap(gaps, metric) for metric in CHOSEN)])
    head = f"instead of {option_text(FLIGHT)}"
    return markdown([head, *(HEADINGS[metric.name] for metric in CHOSEN)], rows)


def tours_table(found: Sequence[Tour], segments: int) -> str:
    """Before and after, and their difference, for each world: of missions over so many segments.

    "Before" has today's worlds and networks, parking lanes included: nothing else would be a pair.
    """
    rows = []
    for tour in found:
        values = {row["metric"]: row for row in tour.missions.iter_rows(named=True)}
        for side, told in (("before", tour.before), ("after", tour.after)):
            row = {name: values[name][side] for name in values}
            most = shown(HIDDEN, 1 - row["permanently_hidden"])
            sure = MISSING if told.certainty is None else percent(told.certainty)
            measured = [shown(metric, row[metric.name]) for metric in CHOSEN[2:]]
            seen = f"{shown(SEEN, row[SEEN.name])} of {most}"
            found_share = shown(COVERAGE, row[COVERAGE.name])
            bring = [] if told.batteries is None else [str(told.batteries)]
            rows.append([tour.world, side, option_text(told.option), sure, found_share, seen, *measured, *bring])
        gaps = [gap(tour.missions, metric) for metric in CHOSEN]
        rows.append([tour.world, "difference", "", "", *gaps, *([] if tour.after.batteries is None else [""])])
    head = ["world", "", "proposed", "best with", "found, %", "surface seen, % of at most", "waiting, s", "time, s"]
    bring = [] if found[0].after.batteries is None else ["batteries to bring"]
    of = "1 segment" if segments == 1 else f"{segments} segments"
    length_m, defects = (sum(getattr(tour, name) for tour in found) / len(found) for name in ("length_m", "defects"))
    lead = (
        f"{of} in one mission: {number(length_m, 0)} m of street and {number(defects, 0)} defects on average. Both "
        "sides fly over today's worlds and road networks:"
    )
    return f"{lead}\n\n" + markdown([*head, "% of a battery", *bring], rows)
