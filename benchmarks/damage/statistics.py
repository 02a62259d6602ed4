"""Distributions of placed damage, and of the boxes of photographs, so that they can be compared."""

import math
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
import polars as pl
from scipy import stats

from benchmarks.damage.placed import Placed
from benchmarks.damage.sources import CLASSES, Photographs
from pavetwin.arrays import Float64Array

NEAR_M: Final = 2.0
PAIRS_M: Final = np.arange(0.0, 10.25, 0.5)
"""Edges of the distances of pairs."""
ALONG_DEG: Final = 22.5
ACROSS_DEG: Final = 67.5
"""A crack turned by less than the first from its street lies along it, by more than the second across it."""
WHEEL_PATH_M: Final = (0.52, 1.12)
"""From the middle of a lane; a wheel path is 0.82 m from it."""
STRIPS_M: Final = {"to_joint_m": 0.25, "to_edge_m": 0.95}
"""How far cracks at joints and edges may be from them."""
GRID: Final = 200
"""Differences of place along and across a segment by which distances of random places are summed."""


@dataclass(frozen=True)
class Lognormal:
    """A fitted lognormal distribution."""

    median: float
    sigma: float
    """Standard deviation of the natural logarithm."""
    number: int


def fitted(sizes: Float64Array, cut: Float64Array | None = None) -> Lognormal:
    """The lognormal of greatest likelihood; of those that are `cut` only the least size is known."""
    logs = np.log(sizes)
    known = (
        logs if cut is None else stats.CensoredData(uncensored=logs[~cut.astype(bool)], right=logs[cut.astype(bool)])
    )
    middle, sigma = stats.norm.fit(known)
    return Lognormal(math.exp(middle), float(sigma), len(sizes))


def mix(found: Placed) -> Float64Array:
    """(classes,) shares of all defects."""
    counts = np.array([found.of(kind).height for kind in CLASSES], dtype=np.float64)
    return counts / counts.sum()


def box_sizes(found: Placed, kind: str) -> Float64Array:
    """How photographs measure them: diagonals of cracks, longer sides of networks and potholes [m]."""
    return _sizes(found.of(kind)["along_m"].to_numpy(), found.of(kind)["across_m"].to_numpy(), kind)


def photograph_sizes(boxes: pl.DataFrame, kind: str) -> tuple[Float64Array, Float64Array]:
    """The same of boxes [pixels], and whether the border cuts them."""
    own = boxes.filter(pl.col("kind") == kind)
    across, along = (own[f"{name}max"].to_numpy() - own[f"{name}min"].to_numpy() for name in ("x", "y"))
    return _sizes(along, across, kind), own["cut"].to_numpy()


def _sizes(along: Float64Array, across: Float64Array, kind: str) -> Float64Array:
    return np.hypot(along, across) if kind == "single_crack" else np.maximum(along, across)


def photographed(found: Placed, seen: Photographs, kind: str) -> tuple[Float64Array, Float64Array]:
    """The same of the photographs' boxes [m]: of those of known ground resolution, or all at the fitted one."""
    own = seen.measured.filter(pl.col("kind") == kind)
    sizes, cut = photograph_sizes(own, kind)
    return sizes * own["pixel_m"].fill_null(pixel_m(found, seen)).to_numpy(), cut


def resolutions(found: Placed, seen: Photographs) -> str:
    """The known ground resolutions, or the fitted one: `7.8 and 11.0 mm`."""
    pixels_m = seen.known_pixels_m or [pixel_m(found, seen)]
    return " and ".join(f"{1000 * pixel:.1f}" for pixel in pixels_m) + " mm"


@cache
def pixel_m(found: Placed, seen: Photographs) -> float:
    """What a pixel of photographs covers [m] whose ground resolution is not known: the one resolution at which the
    medians of the three classes are, as a whole, what is placed. Of others, the finest."""
    if seen.known_pixels_m:
        return seen.known_pixels_m[0]
    ratios = [
        math.log(fitted(box_sizes(found, kind)).median / fitted(*photograph_sizes(seen.boxes, kind)).median)
        for kind in CLASSES
    ]
    return math.exp(sum(ratios) / len(ratios))


def directions(found: Placed) -> Float64Array:
    """(3,) shares of the cracks along the street, across it, and oblique."""
    turn = found.of("single_crack")["turn_deg"].to_numpy()
    along, across = float((turn < ALONG_DEG).mean()), float((turn > ACROSS_DEG).mean())
    return np.array([along, across, 1 - along - across])


def severities(found: Placed, kind: str) -> Float64Array:
    """(3,) shares of low, medium and high severity."""
    own = found.of(kind)["severity"]
    return np.array([float((own == name).mean() or 0.0) for name in ("low", "medium", "high")])


def per_km(found: Placed, kind: str | None = None, by: str = "street") -> pl.DataFrame:
    """A row a street or town: `length_m`, `area_m2`, `number`, `per_km`, `per_100_m2`."""
    chosen = found.defects if kind is None else found.of(kind)
    counts = chosen.group_by("at").len("number")
    joined = found.segments.join(counts, on="at", how="left").with_columns(pl.col("number").fill_null(0))
    summed = joined.group_by(by, maintain_order=True).agg(pl.col("length_m", "area_m2", "number").sum())
    return summed.with_columns(
        per_km=1000 * pl.col("number") / pl.col("length_m"), per_100_m2=100 * pl.col("number") / pl.col("area_m2")
    )


def street_spread(found: Placed) -> float:
    """Standard deviation of the logarithm of the density between streets, without what small numbers add.

    Of numbers N with means λA: Var(N / A) = Var(λ) + E(λ) E(1 / A), and λ is lognormal.
    """
    streets = per_km(found)
    density, area = streets["per_100_m2"].to_numpy(), streets["area_m2"].to_numpy() / 100
    weights = area / area.sum()
    mean = float((weights * density).sum())
    variance = float((weights * (density - mean) ** 2).sum()) - mean * len(area) / float(area.sum())
    return math.sqrt(math.log(1 + max(variance, 0.0) / mean**2))


@dataclass(frozen=True)
class Pairs:
    """How often two defects are a distance apart, relative to random places."""

    distance_m: Float64Array
    """(bins,) middles."""
    on_streets: Float64Array
    """(bins,) relative to as many defects on each segment at random places."""
    over_all: Float64Array
    """(bins,) relative to the mean density on all segments at random places."""
    near: float
    """Mean number of other defects within `NEAR_M` of one."""
    near_random: float
    """The same at the mean density at random places."""


def pairs(found: Placed) -> Pairs:
    """The pair correlation function of all defects, over pairs on one segment."""
    seen, on_streets, over_all = (np.zeros(len(PAIRS_M) - 1) for _ in range(3))
    near = near_random = 0.0
    density = found.defects.height / found.segments["area_m2"].sum()
    places = {key[0]: part for key, part in found.defects.group_by("at")}
    for row in found.segments.iter_rows(named=True):
        below = random_distances(row["length_m"], row["width_m"], np.append(PAIRS_M, NEAR_M))
        shares = np.diff(below[:-1])
        expected = density * row["area_m2"]
        over_all += shares * expected**2 / 2
        near_random += float(below[-1]) * expected**2
        if row["at"] in places:
            own = _apart(places[row["at"]].select("station_m", "offset_m").to_numpy())
            seen += np.histogram(own, PAIRS_M)[0]
            on_streets += shares * len(own)
            near += 2 * float((own < NEAR_M).sum())
    middles = (PAIRS_M[:-1] + PAIRS_M[1:]) / 2
    number = found.defects.height
    return Pairs(middles, seen / on_streets, seen / over_all, near / number, near_random / number)


def random_distances(length_m: float, width_m: float, below_m: Float64Array) -> Float64Array:
    """The probabilities that two random places in a rectangle are less than these distances apart.

    Differences of uniform places along a side a have the density 2 (a − d) / a².
    """
    farthest = float(below_m.max())
    steps, shares = [], []
    for side in (length_m, width_m):
        step = min(side, farthest) / GRID
        middles = (np.arange(GRID) + 0.5) * step
        steps.append(middles)
        shares.append(2 * (side - middles) / side**2 * step)
    apart = np.hypot(steps[0][:, np.newaxis], steps[1]).ravel()
    order = np.argsort(apart)
    summed = np.concatenate([[0.0], np.cumsum(np.outer(*shares).ravel()[order])])
    return summed[np.searchsorted(apart[order], below_m)]


def _apart(points: Float64Array) -> Float64Array:
    """(pairs,) distances."""
    first, second = np.triu_indices(len(points), 1)
    return np.hypot(*(points[first] - points[second]).T)


def from_lane_centres(found: Placed) -> pl.DataFrame:
    """The cracks along streets: `from_centre_m` of their lane, `to_joint_m`, `to_edge_m`."""
    cracks = found.of("single_crack").filter(pl.col("turn_deg") < ALONG_DEG).join(found.segments, on="at", suffix="_of")
    lane = pl.col("width_m_of") / pl.col("lanes")
    left = pl.col("offset_m") + pl.col("width_m_of") / 2
    inside = left - (left / lane).floor().clip(0, pl.col("lanes") - 1) * lane
    return cracks.select(
        from_centre_m=(inside - lane / 2).abs(),
        to_joint_m=pl.min_horizontal(inside, lane - inside),
        to_edge_m=pl.min_horizontal(left, pl.col("width_m_of") - left),
    )


def beside_networks(found: Placed, within_m: float = 0.5) -> float:
    """The share of potholes whose box is within a distance of that of a network."""
    networks = {key[0]: part for key, part in found.of("crocodile_crack").group_by("at")}
    hits = 0
    for hole in found.of("pothole").iter_rows(named=True):
        own = networks.get(hole["at"])
        if own is not None:
            gaps = [
                (own[place] - hole[place]).abs().to_numpy() - (own[size].to_numpy() + hole[size]) / 2
                for place, size in (("station_m", "along_m"), ("offset_m", "across_m"))
            ]
            hits += bool((np.hypot(*np.maximum(gaps, 0.0)) < within_m).any())
    return hits / max(found.of("pothole").height, 1)


def within_networks(found: Placed) -> float:
    """The share of potholes that lie within a network, which lost the part there."""
    return int(found.of("crocodile_crack")["is_notched"].sum()) / max(found.of("pothole").height, 1)


def touching_networks(seen: Photographs) -> tuple[int, int]:
    """Of the potholes in photographs those whose box touches that of a network, and all."""
    holes, networks = (seen.boxes.filter(pl.col("kind") == kind) for kind in ("pothole", "crocodile_crack"))
    both = holes.with_row_index().join(networks, on="image", suffix="_of_network")
    touched = both.filter(
        *(pl.col(f"{side}min") < pl.col(f"{side}max_of_network") for side in "xy"),
        *(pl.col(f"{side}max") > pl.col(f"{side}min_of_network") for side in "xy"),
    )
    return touched["index"].n_unique(), holes.height


def boxes_in_view(found: Placed, side_m: float) -> Float64Array:
    """(5,) shares of squares along the streets with 1, 2, 3, 4, and 5 or more boxes, of those that show any."""
    counts: list[int] = []
    for key, own in found.defects.group_by("at"):
        row = found.segments.row(int(key[0]), named=True)  # type: ignore[call-overload]
        rows = max(1, round(row["width_m"] / side_m))
        across = (np.arange(rows) - (rows - 1) / 2) * side_m
        for along in np.arange(side_m / 2, row["length_m"], side_m):
            near_along = (own["station_m"] - along).abs() < (own["along_m"] + side_m) / 2
            for offset in across:
                near_across = (own["offset_m"] - float(offset)).abs() < (own["across_m"] + side_m) / 2
                counts.append(int((near_along & near_across).sum()))
    return shares_of_counts(np.array(counts))


def boxes_in_photographs(seen: Photographs) -> Float64Array:
    """The same of photographs."""
    return shares_of_counts(seen.boxes.group_by("image").len()["len"].to_numpy())


def shares_of_counts(counts: Float64Array) -> Float64Array:
    """(5,) shares of 1, 2, 3, 4, and 5 or more, of those above 0."""
    some = np.minimum(counts[counts > 0], 5).astype(int)
    return np.bincount(some, minlength=6)[1:] / len(some)


def worn_share(found: Placed, area: float = 0.2) -> Float64Array:
    """(2,) shares of the networks and of the potholes on that share of the area that has most cracks."""
    worst = per_km(found, "single_crack", by="at").sort("per_100_m2", descending=True)
    whole = worst["area_m2"].sum()
    chosen = worst.filter(pl.col("area_m2").cum_sum() <= area * whole)["at"].implode()
    shares = [found.of(kind)["at"].is_in(chosen).mean() for kind in CLASSES[1:]]
    return np.array([float(share or 0.0) for share in shares])  # type: ignore[arg-type]


def slenderness(boxes: pl.DataFrame) -> float:
    """The median of the shorter over the longer side of the networks that are seen whole."""
    whole = boxes.filter(pl.col("kind") == "crocodile_crack", ~pl.col("cut"))
    sides = np.stack([whole[f"{name}max"].to_numpy() - whole[f"{name}min"].to_numpy() for name in ("x", "y")])
    return float(np.median(sides.min(axis=0) / sides.max(axis=0)))
