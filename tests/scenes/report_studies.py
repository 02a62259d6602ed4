"""Small studies with made-up results, for tests of reports: seeded tables, and statistics taken the plainest way."""

from collections.abc import Mapping, Sequence
from html.parser import HTMLParser
from itertools import combinations, product
from typing import Any
from unittest.mock import patch

import numpy as np
import polars as pl

from pavetwin.experiments.metrics import FAILED, FLOWN, METRICS
from pavetwin.experiments.report.page import page, sections_of
from pavetwin.experiments.report.study import Study
from pavetwin.experiments.statistics import Comparison
from pavetwin.reports import canvas
from pavetwin.reports.blocks import ReportFigure
from pavetwin.world.model import World
from scenes import tiny


class Outline(HTMLParser):
    """A page as a parser sees it."""

    VOID = frozenset({"meta", "img", "br", "link", "input"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        assert self.open == [], "every element is closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]

    @property
    def anchors(self) -> list[str]:
        return [attributes["id"] or "" for _, attributes in self.tags if "id" in attributes]


def small_study(**design: object) -> Study:
    return study_of(table_of(SMALL, 4), worlds={"tiny": tiny.bent()}, **design)


def sections(text: str) -> set[str]:
    return {anchor for anchor in Outline(text).anchors if not anchor.startswith(("figure", "table"))}


Factors = Mapping[str, Sequence[Any]]

PAPER: Factors = {
    "traffic": ("low", "medium", "high"),
    "altitude_m": (6.0, 10.0, 15.0),
    "policy": ("baseline", "hover", "micro", "skip"),
}
SMALL: Factors = {"traffic": ("low", "high"), "altitude_m": (6.0, 10.0), "policy": ("baseline", "hover", "skip")}

_USUAL: Factors = {
    "world": ("tiny",),
    "traffic": ("low",),
    "altitude_m": (6.0,),
    "policy": ("baseline",),
    "sensor": ("recall",),
    "preset": ("paper",),
}
_HIDDEN = {"low": 0.1, "medium": 0.25, "high": 0.45}
_PLACES = (("street", 60.0), ("side", 46.0), ("ahead", 48.0))
_COMPARED = ("mean", "low", "high", "p", "p_corrected", "dz")


def page_of(study: Study, *, drawn: bool = False) -> str:
    """The page of a study's report. Drawing takes most of its time: its figures are blank unless they are `drawn`."""
    if drawn:
        return page(study, sections_of(study))
    with patch.object(canvas, "_embedded", _blank):
        return page(study, sections_of(study))


def _blank(_figure: object, caption: str, alt: str, suffix: str) -> ReportFigure:
    return ReportFigure(caption, alt, b"<svg/>", suffix, 1, 1)


def table_of(factors: Factors, replicates: int = 3, *, segments: Sequence[tuple[str, float]] = _PLACES) -> pl.DataFrame:
    """The table of a study that varies these factors: one row a mission, hover with heavy tails, seeded by the cell."""
    levels = {**_USUAL, **factors}
    rows = []
    for world, replicate in product(levels["world"], range(replicates)):
        segment, length_m = segments[replicate % len(segments)]
        ease = np.random.default_rng([replicate, len(str(world))]).normal(0, 0.07)
        for cell in product(*(levels[name] for name in levels if name != "world")):
            row = {"world": world, **dict(zip([name for name in levels if name != "world"], cell, strict=True))}
            seeds = dict.fromkeys(("seed", "traffic_seed", "defect_seed", "sensing_seed"), replicate)
            where = {"segment": segment, "street": f"{segment} road", "length_m": length_m, "area_m2": 7 * length_m}
            status = {"version": "0.0.0", "status": FLOWN, "reason": None}
            draw = np.random.default_rng([replicate, *str(row).encode()])
            rows.append({**row, "replicate": replicate, **seeds, **where, **status, **_measured(row, ease, draw)})
    return pl.DataFrame(rows, schema_overrides={"reason": pl.String}, infer_schema_length=None)


def _measured(row: Mapping[str, Any], ease: float, draw: np.random.Generator) -> dict[str, Any]:
    hidden = _HIDDEN.get(row["traffic"], 0.2) * (1 + 0.02 * (row["altitude_m"] - 6))
    policy, tau = row["policy"], float(row.get("tau_o", 0.7))
    gain = {"baseline": 0.0, "hover": 0.55, "micro": 0.15, "skip": 0.35}.get(policy, 0.25) * hidden * (0.6 + 0.57 * tau)
    seen = float(np.clip(0.82 * (1 - hidden) + gain + ease + draw.normal(0, 0.06), 0, 1))
    wait_s = float(draw.lognormal(2.3 + 3 * hidden, 0.9)) if policy == "hover" else 0.0
    time_s = 30 + 1.2 * row["altitude_m"] + wait_s + (12 * hidden * 4 if policy == "skip" else 0) + draw.gamma(2, 2)
    return {
        "coverage": seen,
        "swath_coverage": min(1.0, seen + 0.06),
        "recovery": float(draw.uniform(0, 0.3) * hidden) if policy == "skip" else 0.0,
        "surface_coverage": min(1.0, seen + 0.1),
        "time_s": time_s,
        "energy": time_s / 1800 * (1 + draw.normal(0, 0.02)),
        "wait_s": wait_s,
        "distance_m": 150.0,
        "occlusions": int(draw.poisson(12 * hidden)),
        "pci_error": 10.0 * (1 - seen),
        "revisits": 0,
        "swaps": 0,
        "defects": 10,
        "swept": 9,
        "confirmed": round(10 * seen),
        "recovered": 0,
        "inspected": seen > 0.8,
    }


def with_failures(table: pl.DataFrame, every: int, reason: str = "SUMO ended early") -> pl.DataFrame:
    """Every so-manieth mission failed."""
    failed = pl.int_range(pl.len()) % every == 0
    nothing = [pl.when(failed).then(None).otherwise(pl.col(m.name)).alias(m.name) for m in METRICS]
    status = pl.when(failed).then(pl.lit(FAILED)).otherwise("status").alias("status")
    return table.with_columns(*nothing, status, pl.when(failed).then(pl.lit(reason)).otherwise(None).alias("reason"))


def summary_of(table: pl.DataFrame, by: Sequence[str]) -> pl.DataFrame:
    """Columns as `statistics.summarise` has them; the interval is mean ± 2 standard errors."""
    parts = []
    for metric in METRICS:
        column = pl.col(metric.name)
        half = 2 * column.std() / column.count().sqrt()
        parts.append(
            table.group_by(by, maintain_order=True).agg(
                pl.lit(metric.name).alias("metric"),
                column.count().cast(pl.Int64).alias("n"),
                ((pl.col("status") == FLOWN) & column.is_null()).sum().cast(pl.Int64).alias("undefined"),
                (pl.col("status") == FAILED).sum().cast(pl.Int64).alias("failed"),
                (pl.col(metric.of).sum() if metric.of else pl.lit(None, pl.Int64)).alias("defects"),
                column.mean().cast(pl.Float64).alias("mean"),
                column.std().alias("sd"),
                (column.mean() - half).alias("low"),
                (column.mean() + half).alias("high"),
                column.median().cast(pl.Float64).alias("median"),
                column.quantile(0.95).cast(pl.Float64).alias("p95"),
                column.max().cast(pl.Float64).alias("maximum"),
            )
        )
    return pl.concat(parts)


def comparisons_of(table: pl.DataFrame, by: Sequence[str]) -> list[Comparison]:
    """Policies with baseline, and every swept setting with its first value."""
    swept = [(name, table[name][0]) for name in by if name not in _USUAL and table[name].n_unique() > 1]
    found = [
        Comparison(factor, reference, "", differences_of(table, by, factor, reference))
        for factor, reference in [("policy", "baseline"), *swept]
        if factor in by
    ]
    return [comparison for comparison in found if comparison.differences.height]


def differences_of(table: pl.DataFrame, by: Sequence[str], factor: str, reference: Any) -> pl.DataFrame:
    """Columns as `statistics.differences` has them; p is 0.01 where the interval excludes 0, else 0.4."""
    schema = {name: table.schema[name] for name in by} | {"metric": pl.String, "pairs": pl.Int64, "undefined": pl.Int64}
    rows = []
    pairing = [name for name in by if name != factor] + ["replicate"]
    base = table.filter(pl.col(factor) == reference)
    for cell, part in table.filter(pl.col(factor) != reference).group_by(by, maintain_order=True):
        both = part.join(base, on=list(dict.fromkeys([*pairing, "world"])), suffix="_base")
        for metric in METRICS if both.height else ():
            d = (both[metric.name] - both[f"{metric.name}_base"]).drop_nulls().cast(pl.Float64)
            rows.append(dict(zip(by, cell, strict=True)) | _difference(metric.name, d, both.height))
    return pl.DataFrame(rows, schema=schema | dict.fromkeys(_COMPARED, pl.Float64))


def _difference(metric: str, d: pl.Series, pairs: int) -> dict[str, Any]:
    known = {"metric": metric, "pairs": len(d), "undefined": pairs - len(d)}
    if len(d) < 2:
        return known | dict.fromkeys(_COMPARED)
    mean, sd = float(np.mean(d.to_numpy())), float(np.std(d.to_numpy(), ddof=1))
    half = 2 * sd / len(d) ** 0.5
    p = 0.01 if abs(mean) > half else 0.4
    return known | dict(zip(_COMPARED, (mean, mean - half, mean + half, p, p, mean / sd if sd else None), strict=True))


def effects_of(factors: Sequence[str]) -> pl.DataFrame:
    """Columns as `statistics.effects` has them, with made-up shares."""
    terms = [*factors, *(" × ".join(pair) for pair in combinations(factors, 2)), "replicate"]
    rows = [
        {"metric": metric.name, "term": term, "df": 2, "ss": 1.0, "f": 3.0 / (at + 1), "p": 0.0004 * 6**at}
        | {"eta2": 0.3 / (at + 1), "omega2": 0.28 / (at + 1) - 0.05}
        for metric in METRICS
        for at, term in enumerate(terms)
    ]
    return pl.DataFrame(rows)


def study_of(
    table: pl.DataFrame, *, worlds: Mapping[str, World] | None = None, sparse: bool = False, **design: Any
) -> Study:
    """The study of a table; its factors are what varies in it.

    Args:
        sparse: its statistics have no columns of what does not vary.
    """
    names = [*_USUAL, *(name for name in table.columns[: table.columns.index("replicate")] if name not in _USUAL)]
    factors = tuple(name for name in names if table[name].n_unique() > 1)
    by = factors if sparse else names
    swept = {name: table[name].unique(maintain_order=True).to_list() for name in factors if name not in _USUAL}
    plain = {"worlds": table["world"].unique(maintain_order=True).to_list(), "seed": 0, "version": "0.0.0"}
    return Study(
        title=design.pop("title", "A small study"),
        design={**plain, "sweep": swept, **design},
        factors=factors,
        table=table,
        summary=summary_of(table, by),
        comparisons=comparisons_of(table, by),
        effects=effects_of(factors) if factors else pl.DataFrame(),
        worlds=worlds or {},
    )
