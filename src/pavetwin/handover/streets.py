"""What a study recommends for each street.

A street has far fewer missions than the study, so that the best mean there is often the best by chance. The study's own
recommendation therefore holds for a street unless the missions over that street separate another option from it: p, in
pairs, below 0.05 over the number of streets that were compared (Bonferroni).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.advice import Advice, advise
from pavetwin.experiments.metrics import REPLICATE
from pavetwin.experiments.statistics import MissionLimits, Objective, Recommendation, recommend
from pavetwin.experiments.statistics.summary import FEW
from pavetwin.experiments.words import level_text, setting
from pavetwin.reports.words import listed

CHOSEN: Final = ("world", "traffic", "sensor", "preset")
"""Columns of which a handover has one level each: where, when, and how missions are judged."""

SHOWN: Final = 0.05
"""Below this p, divided among the streets, a difference counts as shown."""


@dataclass(frozen=True)
class StreetAdvice:
    """The recommendation of a study in one world, traffic, sensor and preset, and that of each street."""

    study: str
    levels: Mapping[str, str]
    """Of `CHOSEN`."""
    overall: Advice
    table: pl.DataFrame
    """A row a street: `street`, `fly` (what to fly, in words), `replicates` (with a coverage), `expected_coverage` (the
    mean there of what to fly; null without one) and `from` (why: `the study` or `this street`)."""
    segments: tuple[str, ...]
    """Ids of the segments that the study flew over, in the order of their first mission."""
    content: str = ""
    """Shortened hash of the world in the study (`pavetwin.experiments.units.content_of`); empty if unknown."""
    of_defects: bool = False
    """True if the study flew over the world's own defects; `content` then covers them."""

    @property
    def world(self) -> str:
        return self.levels["world"]

    @property
    def option(self) -> Mapping[str, Any]:
        """The levels to fly: altitude, policy and what else the study varied."""
        best = self.overall.recommendation.best
        assert best is not None
        return {name: best[name] for name in self.overall.recommendation.by}


def street_advice(
    study: str,
    table: pl.DataFrame,
    design: Mapping[str, Any],
    levels: Mapping[str, str | None],
    limits: MissionLimits,
    *,
    objective: Objective = Objective.MOST_FOUND,
    seed: int = 0,
) -> StreetAdvice:
    """What a study recommends, for all and for each street.

    Args:
        study: its name.
        table: with a row a segment mission.
        design: plain values of `design.yaml`.
        levels: of `CHOSEN`; None where the study has one alone.
        limits, objective: as `advise` takes them. Of a street only the least coverage is judged: limits of time and
            energy are of whole missions.

    Raises:
        PaveTwinError: a level is ambiguous or unknown, or no option keeps the limits.
    """
    chosen = {name: _level(table, name, levels.get(name)) for name in CHOSEN}
    table = table.filter(pl.col(name) == level for name, level in chosen.items())
    (overall,) = advise(table, limits, objective=objective, seed=seed, design=design)
    if overall.recommendation.best is None:
        raise PaveTwinError(f"The study '{study}' recommends nothing to hand over: {overall.sentences[0]}")
    streets = table["street"].unique(maintain_order=True).to_list()
    own = MissionLimits(min_coverage=limits.min_coverage)
    rows = [
        _row(street, table.filter(street=street), overall.recommendation, own, objective, seed, len(streets))
        for street in streets
    ]
    schema = {
        **{"street": pl.String, "fly": pl.String, "from": pl.String},
        **{"replicates": pl.Int64, "expected_coverage": pl.Float64},
    }
    segments = tuple(table["segment"].unique(maintain_order=True).to_list())
    return StreetAdvice(study, chosen, overall, pl.DataFrame(rows, schema=schema), segments)


def _level(table: pl.DataFrame, name: str, asked: str | None) -> str:
    """Raises:
    PaveTwinError: the study has several levels and none is asked for, or not the one that is.
    """
    levels = table[name].unique(maintain_order=True).to_list()
    if asked is None and len(levels) > 1:
        raise PaveTwinError(f"`{name}`: the study has {listed(levels)}, and a handover is for one; name it.")
    if asked is not None and asked not in levels:
        raise PaveTwinError(f"`{name}` {asked}: the study has {listed(levels)}.")
    return str(asked or levels[0])


def _row(
    street: str,
    table: pl.DataFrame,
    overall: Recommendation,
    limits: MissionLimits,
    objective: Objective,
    seed: int,
    streets: int,
) -> dict[str, Any]:
    by, replicates = list(overall.by), table.filter(pl.col("coverage").is_not_null())[REPLICATE].n_unique()
    assert overall.best is not None
    usual = {name: overall.best[name] for name in by}
    option, source = usual, "the study"
    if replicates >= FEW:
        here = recommend(table, limits, by, objective=objective, seed=seed)
        if here.best is not None and _is_separate(here, usual, SHOWN / streets):
            option, source = {name: here.best[name] for name in by}, "this street"
    of_option = table.filter(pl.col(name).eq_missing(level) for name, level in option.items())
    return {
        "street": street,
        "fly": option_words(option, by),
        "from": source,
        "replicates": replicates,
        "expected_coverage": of_option["coverage"].mean(),
    }


def _is_separate(here: Recommendation, usual: Mapping[str, Any], least: float) -> bool:
    """Whether missions over a street show that its best option is better than the study's."""
    rows = here.options.filter(pl.col(name).eq_missing(level) for name, level in usual.items()).to_dicts()
    return any(row["p"] is not None and row["p"] < least and not row["same"] for row in rows)


def option_words(option: Mapping[str, Any], by: Sequence[str]) -> str:
    """`hover at 10 m`."""
    rest = [name for name in by if name not in ("policy", "altitude_m")]
    words = f"{option['policy']} at {level_text('altitude_m', option['altitude_m'])}"
    return f"{words} {setting(option, rest)}" if rest else words
