"""How large an effect is: on the same flight, and on what is decided.

- On the same flight: hovering at 10 m over the same segments, with what is changed less without, in pairs by replicate.
- On the decision: what `recommend` proposes with it and without, and what the proposal loses of coverage that was made
  without knowing, where the truth is known: in pairs by replicate, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from benchmarks.effects.catalogue import Kind, Variant
from pavetwin.experiments.advice import advise
from pavetwin.experiments.metrics import REPLICATE, STATUS, Metric, metric_named
from pavetwin.experiments.statistics import MissionLimits, differences
from pavetwin.experiments.statistics.bootstrap import centres
from pavetwin.experiments.statistics.cells import layout, nullable, values_of

MEASURED: Final = tuple(
    map(metric_named, ("coverage", "surface_coverage", "permanently_hidden", "wait_s", "time_s", "energy"))
)
ALL: Final = "all"
"""The scope of all worlds together."""

Option = tuple[float, str]
"""Altitude and policy."""

FLIGHT: Final[Option] = (10.0, "hover")

_SIDE: Final = "side"


@dataclass(frozen=True)
class Effect:
    """What one variant changes in one world, or in all together."""

    variant: Variant
    scope: str
    options: tuple[Option, Option]
    """What is proposed without the change, and with it."""
    flight: pl.DataFrame
    """A row a metric of `MEASURED`: `metric`, `pairs`, `before` and `after` (means), `mean` (of the differences),
    `low`, `high` (their simultaneous 95 % interval), `p` (corrected)."""
    decision: pl.DataFrame | None
    """The same of the proposal that was made without knowing what is true, less the one that was made knowing it; None
    where the two are the same."""

    @property
    def size(self) -> float:
        """The largest change, as a share of what it is without: of what is found, seen, flown and used on the same
        flight, or of what the decision loses."""
        changes = [share(self.flight, name) for name in ("coverage", "surface_coverage", "time_s", "energy")]
        return max(*changes, 0.0 if self.decision is None else share(self.decision, "coverage"))


def share(frame: pl.DataFrame, metric: str) -> float:
    """How large a mean difference is, as a share of the mean that it is a difference to."""
    before = value(frame, metric, "before")
    return abs(value(frame, metric, "mean")) / before if before else 0.0


def value(frame: pl.DataFrame, metric: str, column: str) -> float:
    """One number of an effect; 0 where it is undefined."""
    return float(frame.filter(metric=metric)[column][0] or 0.0)


def proposed(table: pl.DataFrame, limits: MissionLimits) -> Option:
    """The option that `recommend` proposes over a table; the nearest one where none keeps the limits."""
    (advice,) = advise(table, limits)
    option = advice.recommendation.best or advice.recommendation.nearest
    assert option is not None, "every study has missions with a coverage"
    return float(option["altitude_m"]), str(option["policy"])


def effects(variant: Variant, reference: pl.DataFrame, table: pl.DataFrame, limits: MissionLimits) -> list[Effect]:
    """Of a variant in each world and in all together.

    Args:
        reference: the study that it is compared with; a row a segment mission, as `table`.
    """
    if variant.kind is not Kind.CHANCE:
        reference, table = same_ground(reference, table), same_ground(table, reference)
    scopes: list[str] = [*reference["world"].unique(maintain_order=True).to_list(), ALL]
    found = []
    for scope in scopes:
        sides = within(reference, scope), within(table, scope)
        options = proposed(sides[0], limits), proposed(sides[1], limits)
        found.append(_effect(variant, scope, *sides, options))
    return found


def same_ground(table: pl.DataFrame, other: pl.DataFrame) -> pl.DataFrame:
    """The rows of replicates that inspect the same segments in both, so that they are pairs."""
    keys = ["world", REPLICATE, "segment"]
    return table.join(other.select(keys).unique(), on=keys, how="semi", maintain_order="left")


def compared(sides: Mapping[str, pl.DataFrame], metrics: Sequence[Metric] = MEASURED) -> pl.DataFrame:
    """A row a metric: the second of two tables less the first, over the replicates of all their worlds."""
    first, second = sides
    columns = [REPLICATE, STATUS, *(metric.name for metric in metrics)]
    table = pl.concat([part.select("world", pl.lit(side).alias(_SIDE), *columns) for side, part in sides.items()])
    gaps = differences(table, [_SIDE], metrics, factor=_SIDE, reference=first)
    cells = layout(table, [_SIDE])
    means = np.array([centres(cells.means(values_of(table, metric.name))) for metric in metrics])
    return gaps.select(
        "metric",
        "pairs",
        *(
            nullable(means[:, cells.keys.index((side,))]).alias(name)
            for side, name in ((first, "before"), (second, "after"))
        ),
        "mean",
        "low",
        "high",
        pl.col("p_corrected").alias("p"),
    )


def _effect(
    variant: Variant, scope: str, reference: pl.DataFrame, table: pl.DataFrame, options: tuple[Option, Option]
) -> Effect:
    known, unknown = options if variant.kind is Kind.LEFT_OUT else options[::-1]
    truth = reference if variant.kind is Kind.LEFT_OUT else table
    flight = compared({"without": _flown(reference, FLIGHT), "with": _flown(table, FLIGHT)})
    decision = None
    if known != unknown:
        decision = compared({"knowing": _flown(truth, known), "not knowing": _flown(truth, unknown)})
    return Effect(variant, scope, options, flight, decision)


def _flown(table: pl.DataFrame, option: Option) -> pl.DataFrame:
    return table.filter(altitude_m=option[0], policy=option[1])


def within(table: pl.DataFrame, scope: str) -> pl.DataFrame:
    """The rows of one world, or of all."""
    return table if scope == ALL else table.filter(world=scope)


def ranked(found: Sequence[Effect]) -> list[Effect]:
    """The effects over all worlds together, the largest first."""
    return sorted((effect for effect in found if effect.scope == ALL), key=lambda effect: effect.size, reverse=True)


def as_table(found: Sequence[Effect]) -> pl.DataFrame:
    """Everything as one tidy table."""
    parts = [
        frame.select(
            pl.lit(effect.variant.name).alias("variant"),
            pl.lit(str(effect.variant.kind)).alias("kind"),
            pl.lit(effect.scope).alias("world"),
            pl.lit(option_text(effect.options[0])).alias("proposed_without"),
            pl.lit(option_text(effect.options[1])).alias("proposed_with"),
            pl.lit(what).alias("of"),
            pl.all(),
        )
        for effect in found
        for what, frame in (("the same flight", effect.flight), ("the decision", effect.decision))
        if frame is not None
    ]
    return pl.concat(parts)


def option_text(option: Option) -> str:
    """`hover, 10 m`."""
    return f"{option[1]}, {option[0]:g}\u00a0m"
