"""One defect of the inventory, from all its detections: place, class, severity, sizes and probability.

Errors are standard deviations. A single look has the error of the pixels: half a pixel at each of the edges that a size
runs between, and for areas half a pixel along the edge. Looks are weighted by their errors. Scatter beyond these widens
the error of the mean (the Birge ratio of metrology); a systematic error of the detector, which all looks share, is not
in it.

A fitted sensor gives the probability that an entry shows a defect, for entries like those that it was fitted to
(`pavetwin.sensing.fitted_sensor`), of which a certain share were defects. On a sound road most entries are false
alarms, on a ruined one few. That share is therefore estimated from the inventory itself by expectation maximisation:
the odds of all entries are scaled until the share is the mean of their probabilities (Saerens, Latinne and Decaestecker
2002, Neural Computation 14). `PSEUDO_ENTRIES` of the share that the sensor was fitted to are added, so that few entries
change it little.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, pi, sqrt
from typing import Final

import numpy as np
import shapely
from shapely import Point, Polygon

from pavetwin.arrays import Float64Array
from pavetwin.detections import SEVERITY_RANGE, SIZES, Detections, possible_severities
from pavetwin.errors import PaveTwinError, about
from pavetwin.inventory.merging import looks_of
from pavetwin.sensing.fitted_sensor import EntryModel, SensorModel, sensor_of, sensor_path
from pavetwin.world.model import Severity
from pavetwin.world.rectangles import smallest_rectangle

SEVERITIES: Final = tuple(each.value for each in Severity)

LIKELY: Final = 0.5
"""Probability from which an entry counts as a defect."""

_EVEN: Final = (1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class SizeEstimate:
    """A value and its standard deviation."""

    value: float
    error: float


@dataclass(frozen=True)
class Entry:
    """One defect."""

    number: int
    """From 1."""
    class_name: str
    place: Point | None
    """East and north; None where no image states its place."""
    place_error_m: float | None
    """Standard deviation of the place, east and north each."""
    outline: Polygon | None
    """Outline in the best look."""
    severity: str
    """Severity or range that most looks allow; empty where the images show none."""
    sizes: Mapping[str, SizeEstimate]
    """Measured sizes by name in `SIZES`."""
    is_cut: bool
    """Whether no image shows it whole: its sizes are the least that they can be."""
    confidence: float
    """Confidence of the best look. Looks are not independent, so more of them do not raise it."""
    looks: int
    """Number of images that show it."""
    best: Detections
    """Its most confident detection, a whole one where there is any: a record of one row."""
    probability: float | None = None
    """Probability that it shows a defect; None without a fitted sensor for it."""
    severity_weights: tuple[float, float, float] = _EVEN
    """Frequencies of low, medium and high among defects of its class, for a severity that its images leave open."""

    @property
    def is_likely(self) -> bool:
        """Whether it counts as a defect, as it does where its probability is not known."""
        return self.probability is None or self.probability >= LIKELY

    @property
    def size_px(self) -> float | None:
        """Root of the area of the outline in pixels; None where its place or its pixels are not known."""
        pixel_mm = float(self.best.pixel_mm[0])
        if self.outline is None or np.isnan(pixel_mm):
            return None
        return sqrt(self.outline.area) / (pixel_mm / 1000)

    @property
    def severities(self) -> Mapping[Severity, float]:
        """The severities that its images allow, each with the part of the entry that counts under it."""
        ranks = possible_severities(self.severity) or range(len(SEVERITIES))
        weights = [self.severity_weights[rank] for rank in ranks]
        if not sum(weights):
            weights = [1.0] * len(weights)
        return {tuple(Severity)[rank]: weight / sum(weights) for rank, weight in zip(ranks, weights, strict=True)}

    @property
    def area_m2(self) -> float:
        """Measured area, or else that of the outline."""
        return self._size("area_m2", self.outline.area if self.outline is not None else 0.0)

    @property
    def length_m(self) -> float:
        """Measured length, or else the longer side of the smallest rectangle around the outline."""
        around = None if self.outline is None else smallest_rectangle(self.outline)
        return self._size("length_m", 0.0 if around is None else around.length)

    @property
    def width_m(self) -> float:
        """Measured diameter, or else that of a disc of its area."""
        if "diameter_mm" in self.sizes:
            return self.sizes["diameter_mm"].value / 1000
        return 2 * sqrt(self.area_m2 / pi)

    def _size(self, name: str, otherwise: float) -> float:
        return self.sizes[name].value if name in self.sizes else otherwise


def entry_of(number: int, detections: Detections) -> Entry:
    """The entry of the detections of one defect, at least one; pieces in one image count as one look."""
    looks = looks_of(detections)
    whole = looks[~looks.is_cut]
    used = whole if len(whole) else looks
    best = used[[int(np.argmax(used.confidence))]]
    place, place_error_m = _place(used)
    return Entry(
        number=number,
        class_name=best.class_name[0],
        place=place,
        place_error_m=place_error_m,
        outline=best.footprint[0],
        severity=_severity(used),
        sizes=_sizes(used, is_cut=not len(whole)),
        is_cut=not len(whole),
        confidence=float(detections.confidence.max()),
        looks=len(looks),
        best=best,
    )


def _place(looks: Detections) -> tuple[Point | None, float | None]:
    placed = looks[[outline is not None for outline in looks.footprint]]
    if not len(placed):
        return None, None
    centres = shapely.get_coordinates(shapely.centroid(placed.footprint))
    pixels_m = np.nan_to_num(placed.pixel_mm / 1000)
    errors = np.array(
        [hypot(error, pixel) or _LEAST_M for error, pixel in zip(placed.position_error_m, pixels_m, strict=True)]
    )
    sides = [_combined(centres[:, axis], errors) for axis in (0, 1)]
    return Point(sides[0].value, sides[1].value), max(side.error for side in sides)


_LEAST_M: Final = 0.01
"""Error of a place whose pixel is not known."""


def _sizes(looks: Detections, *, is_cut: bool) -> Mapping[str, SizeEstimate]:
    found = {}
    for name in SIZES:
        rows = np.flatnonzero(~np.isnan(getattr(looks, name)))
        if not len(rows):
            continue
        values = getattr(looks, name)[rows]
        errors = np.array([_size_error(looks, row, name) for row in rows.tolist()])
        largest = int(values.argmax())
        cut = SizeEstimate(float(values[largest]), float(errors[largest]))
        found[name] = cut if is_cut else _combined(values, errors)
    return found


def _size_error(looks: Detections, row: int, name: str) -> float:
    """Standard deviation in the unit of the size."""
    pixel_mm = float(looks.pixel_mm[row])
    pixel_m = _LEAST_M if np.isnan(pixel_mm) else pixel_mm / 1000
    if name != "area_m2":
        return pixel_m / sqrt(2) * (1000.0 if name.endswith("_mm") else 1.0)
    length = float(looks.length_m[row])
    edge_m = 4 * sqrt(looks.area_m2[row]) if np.isnan(length) or not length else 2 * length
    return 0.5 * pixel_m * edge_m


def _combined(values: np.ndarray, errors: np.ndarray) -> SizeEstimate:
    """The mean weighted by the inverse variances, its error times the Birge ratio where that is above 1."""
    weights = 1 / errors**2
    mean = float((weights * values).sum() / weights.sum())
    error = 1 / sqrt(float(weights.sum()))
    if len(values) > 1:
        chi2 = float((weights * (values - mean) ** 2).sum())
        error *= max(1.0, sqrt(chi2 / (len(values) - 1)))
    return SizeEstimate(mean, error)


def _severity(looks: Detections) -> str:
    """The range of severities that most looks allow; empty where all are possible."""
    votes: Counter[str] = Counter()
    for each in looks.severity:
        votes.update(SEVERITIES[rank] for rank in possible_severities(each) or ())
    if not votes:
        return ""
    most = max(votes.values())
    allowed = [severity for severity in SEVERITIES if votes[severity] == most]
    if allowed[0] == SEVERITIES[0] and allowed[-1] == SEVERITIES[-1]:
        return ""
    return allowed[0] if len(allowed) == 1 else f"{allowed[0]}{SEVERITY_RANGE}{allowed[-1]}"


PSEUDO_ENTRIES: Final = 1.0
"""Our assumption: 5 and 15 give condition indices of usual roads that are further from the truth."""

_ROUNDS: Final = 500
_CLOSE: Final = 1e-9


def entry_model(detector: str | None, fitted: str | None = None) -> EntryModel | None:
    """The model of entries in a fitted sensor; None where there is no such sensor, or it has none.

    Args:
        detector: SHA-256 of the model file that searched the images; None where it is not known.
        fitted: name of a shipped sensor, or a file; by default the shipped sensor of the detector.

    Raises:
        PaveTwinError: there is no such sensor, it is damaged, was fitted for another detector, or has no model of
            entries.
    """
    if fitted is None:
        file = None if detector is None else sensor_of(detector)
        return None if file is None else SensorModel.read(file).entries
    with about("fitted"):
        model = SensorModel.read(sensor_path(fitted))
    if detector is None:
        raise PaveTwinError(f"`fitted` '{fitted}': no detector searched these images; leave it out.")
    if model.detector.sha256 != detector:
        raise PaveTwinError(f"`fitted` '{fitted}' was fitted for another detector than that of these images.")
    if model.entries is None:
        raise PaveTwinError(
            f"`fitted` '{fitted}' has no model of entries; fit it to missions of the sensor 'detector' with "
            "`pavetwin sensor fit MISSIONS --output sensor.json`."
        )
    return model.entries


def with_probabilities(entries: Sequence[Entry], model: EntryModel) -> list[Entry]:
    """Entries with `severity_weights`, and with their `probability` where the model covers them."""
    chances = [
        None if (size := entry.size_px) is None else model.chance(entry.class_name, entry.confidence, entry.looks, size)
        for entry in entries
    ]
    known = np.array([chance for chance in chances if chance is not None])
    shifted = iter(_shifted(known, model.defect_share).tolist())
    return [
        replace(
            entry,
            probability=None if chance is None else next(shifted),
            severity_weights=model.severities.get(entry.class_name, _EVEN),
        )
        for entry, chance in zip(entries, chances, strict=True)
    ]


def _shifted(chances: Float64Array, share: float) -> Float64Array:
    """Probabilities under the share of defects among these entries.

    Args:
        chances: (n,) probabilities under the share that the model was fitted to.
        share: the share that the model was fitted to.
    """
    if not len(chances):
        return chances
    odds = chances / np.maximum(1.0 - chances, 1e-12)
    here, shifted = share, chances
    for _ in range(_ROUNDS):
        scaled = odds * (here / (1.0 - here)) / (share / (1.0 - share))
        shifted = scaled / (1.0 + scaled)
        new = float(shifted.sum() + PSEUDO_ENTRIES * share) / (len(chances) + PSEUDO_ENTRIES)
        if abs(new - here) < _CLOSE:
            break
        here = new
    return shifted
