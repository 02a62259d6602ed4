"""The comparison as a Markdown table: what a population places, beside its sources."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np
import polars as pl

from benchmarks.damage import statistics as stats
from benchmarks.damage.placed import Placed
from benchmarks.damage.sources import CLASSES, COUNTS, DIRECTIONS, NAMES, POTHOLES_PER_KM, REPAIRED_M, Photographs
from benchmarks.damage.widths import crack_widths

Row = tuple[str, str, str]
"""What, what is placed, what the sources have."""

LEAST_BOXES: Final = 10
"""Of fewer no distribution is told."""


def table(found: Placed, photographs: Sequence[Photographs]) -> str:
    """All rows; of photographs where there are some."""
    lines = ["| what | placed | sources |", "|---|---|---|"]
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in rows(found, photographs)])


def rows(found: Placed, photographs: Sequence[Photographs]) -> Iterator[Row]:
    """One after the other."""
    yield (
        "cracks : networks : potholes, %",
        _percents(stats.mix(found)),
        _listed((name, _percents(_shares(counts))) for name, counts in COUNTS.items()),
    )
    yield (
        "cracks along : across : oblique to the street, %",
        _percents(stats.directions(found)),
        _listed((name, _percents(_shares(counts))) for name, counts in DIRECTIONS.items()),
    )
    yield from _sizes(found, photographs)
    widths = 1000 * found.of("single_crack")["width_m"].to_numpy()
    theirs = _listed((seen.name, _widths(found, seen)) for seen in photographs)
    yield "widths of cracks at their widest, mm: 5 %, median, 95 %", _quantiles(widths, 1), theirs or "–"
    for kind in CLASSES:
        yield f"{NAMES[kind]} of low : medium : high severity, %", _percents(stats.severities(found, kind)), "–"
    holes = found.of("pothole")
    deep = (holes["depth_m"] >= REPAIRED_M[0]) & (holes["width_m"] >= REPAIRED_M[1])
    which = f"potholes at least {1000 * REPAIRED_M[0]:.0f} mm deep and {100 * REPAIRED_M[1]:.0f} cm wide, %"
    yield which, f"{100 * float(deep.mean() or 0):.0f}", "from here a council repairs them (Suffolk)"
    yield from _densities(found)
    yield from _places(found, photographs)
    for seen in photographs[:1]:
        side_m = seen.side_px * stats.pixel_m(found, seen)
        yield (
            f"squares of {side_m:.1f} m with 1 : 2 : 3 : 4 : more boxes, of those with any, %",
            _percents(stats.boxes_in_view(found, side_m)),
            f"{seen.name} {_percents(stats.boxes_in_photographs(seen))}",
        )


def _sizes(found: Placed, photographs: Sequence[Photographs]) -> Iterator[Row]:
    for kind in CLASSES:
        own, theirs = stats.fitted(stats.box_sizes(found, kind)), []
        for seen in photographs:
            boxes = stats.photographed(found, seen, kind)
            if len(boxes[0]) >= LEAST_BOXES:
                fit = stats.fitted(*boxes)
                theirs.append((seen.name, f"{fit.median:.2f} m, σ {fit.sigma:.2f} ({fit.number})"))
        what = "diagonal" if kind == "single_crack" else "longer side"
        yield (
            f"box of {NAMES[kind]}, {what}: median, σ (number)",
            f"{own.median:.2f} m, σ {own.sigma:.2f} ({own.number})",
            _listed(theirs) or "–",
        )
    networks = found.of("crocodile_crack")
    slender = networks.select(pl.min_horizontal("across_m", "along_m") / pl.max_horizontal("across_m", "along_m"))
    yield (
        "networks: shorter over longer side, median",
        f"{slender.to_series().median():.2f}",
        _listed((seen.name, f"{stats.slenderness(seen.boxes):.2f}") for seen in photographs) or "–",
    )


def _widths(found: Placed, seen: Photographs) -> str:
    """The median and what 95 % stay below, of which noise is a part."""
    middle, most = 1000 * np.quantile(crack_widths(seen, stats.pixel_m(found, seen)), [0.5, 0.95])
    return f"median {middle:.1f}, 95 % {most:.0f} at {stats.resolutions(found, seen)} a pixel"


def _densities(found: Placed) -> Iterator[Row]:
    streets, towns = stats.per_km(found), stats.per_km(found, "pothole", by="town")
    total = 100 * found.defects.height / found.segments["area_m2"].sum()
    by_town = stats.per_km(found, by="town")["per_100_m2"]
    yield "defects on 100 m²", f"{total:.2f} ({by_town.min():.1f} to {by_town.max():.1f} by town)", "–"
    yield "defects a kilometre, by street: 5 %, median, 95 %", _quantiles(streets["per_km"].to_numpy(), 0), "–"
    with_any = streets.filter(pl.col("number") > 0)["per_km"].to_numpy()
    yield (
        "σ of the logarithm of the density between streets: without what small numbers add : with it, as plotted",
        f"{stats.street_spread(found):.2f} : {stats.fitted(with_any).sigma:.2f}",
        "–",
    )
    holes = towns["number"].sum() / towns["length_m"].sum() * 1000
    ends = f"{towns['per_km'].min():.1f} to {towns['per_km'].max():.1f} by town"
    theirs = _listed((name, f"{value:.1f}") for name, value in POTHOLES_PER_KM.items())
    yield "potholes a kilometre", f"{holes:.1f} ({ends})", theirs


def _places(found: Placed, seen: Sequence[Photographs]) -> Iterator[Row]:
    near, lanes = stats.pairs(found), stats.from_lane_centres(found)
    ratio = near.near / near.near_random
    yield (
        f"other defects within {stats.NEAR_M:g} m of one",
        f"{near.near:.1f}, {ratio:.1f} times as many as at random",
        "–",
    )
    worn = stats.worn_share(found)
    yield "share of networks and potholes on the worst fifth of the area, %", _percents(worn), _LONDON
    touching = [(each.name, *stats.touching_networks(each)) for each in seen]
    yield (
        "potholes within a network : with one within 50 cm, %",
        f"{100 * stats.within_networks(found):.0f} : {100 * stats.beside_networks(found):.0f}",
        "; ".join(f"{name} {some} of {all_} touch one's box" for name, some, all_ in touching if all_ > 9) or "–",
    )
    paths = float(lanes["from_centre_m"].is_between(*stats.WHEEL_PATH_M).mean() or 0)
    joints, edges = (float((lanes[name] < limit).mean() or 0) for name, limit in stats.STRIPS_M.items())
    yield (
        "cracks along streets: in wheel paths : at joints : at edges, %",
        _percents(np.array([paths, joints, edges])),
        "–",
    )


_LONDON = "concentrated where the pavement has deteriorated (London, TRR 2023)"


def _shares(counts: tuple[int, ...]) -> np.ndarray:
    return np.array(counts) / sum(counts)


def _percents(shares: np.ndarray) -> str:
    """`87 : 10 : 3`; with a decimal below 10 %."""
    return " : ".join(f"{100 * share:.1f}" if 0 < share < 0.0995 else f"{100 * share:.0f}" for share in shares)


def _quantiles(values: np.ndarray, digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in np.quantile(values, [0.05, 0.5, 0.95]))


def _listed(named: Iterable[tuple[str, str]]) -> str:
    return "; ".join(f"{name} {value}" for name, value in named)
