"""How likely each entry of an inventory shows a defect.

A fitted sensor knows it for entries like those that it was fitted to (`pavetwin.sensing.fitted_sensor`), of which a
certain share were defects. On a sound road most entries are false alarms, on a ruined one few. That share is therefore
estimated from the inventory itself, by expectation and maximisation: the odds of all entries are scaled until the share
is the mean of their probabilities (Saerens, Latinne and Decaestecker 2002, Neural Computation 14). `PSEUDO_ENTRIES` of
the share that the sensor was fitted to count beside them, so that few entries change it little.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import sqrt
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError, about
from pavetwin.inventory.entry import Entry
from pavetwin.sensing.fitted_sensor import EntryModel, SensorModel
from pavetwin.sensing.shipped import sensor_of, sensor_path

PSEUDO_ENTRIES: Final = 1.0
"""Our assumption: with 5 and 15 the condition indices of usual roads were further from the truth."""

_ROUNDS: Final = 500
_CLOSE: Final = 1e-9


def entry_model(detector: str | None, fitted: str | None = None) -> EntryModel | None:
    """What a fitted sensor knows of entries; None where there is no such sensor, or it knows nothing of them.

    Args:
        detector: SHA-256 of the model file that looked at the images; None where it is not known.
        fitted: a sensor that ships, or its file; the one that ships for the detector unless given.

    Raises:
        PaveTwinError: there is no such sensor, it is damaged, was fitted for another detector, or tells nothing of
            entries.
    """
    if fitted is None:
        file = None if detector is None else sensor_of(detector)
        return None if file is None else SensorModel.read(file).entries
    with about("fitted"):
        model = SensorModel.read(sensor_path(fitted))
    if detector is None:
        raise PaveTwinError(f"`fitted` '{fitted}': no detector looked at these images; leave it out.")
    if model.detector.sha256 != detector:
        raise PaveTwinError(f"`fitted` '{fitted}' was fitted for another detector than that of these images.")
    if model.entries is None:
        raise PaveTwinError(
            f"`fitted` '{fitted}' tells nothing of entries; fit it to missions of the sensor 'detector' with "
            "`pavetwin sensor fit MISSIONS --output sensor.json`."
        )
    return model.entries


def size_px_of(entry: Entry) -> float | None:
    """Root of the area of the outline in pixels; None where its place or its pixels are not known."""
    pixel_mm = float(entry.best.pixel_mm[0])
    if entry.outline is None or np.isnan(pixel_mm):
        return None
    return sqrt(entry.outline.area) / (pixel_mm / 1000)


def with_probabilities(entries: Sequence[Entry], model: EntryModel) -> list[Entry]:
    """Entries with their `probability`; those of which the model cannot tell stay without."""
    sizes = [size_px_of(entry) for entry in entries]
    chances = [
        None if size is None else model.chance(entry.class_name, entry.confidence, entry.looks, size)
        for entry, size in zip(entries, sizes, strict=True)
    ]
    known = np.array([chance for chance in chances if chance is not None])
    shifted = iter(_shifted(known, model.defect_share).tolist())
    return [
        entry if chance is None else replace(entry, probability=next(shifted))
        for entry, chance in zip(entries, chances, strict=True)
    ]


def _shifted(chances: Float64Array, share: float) -> Float64Array:
    """Probabilities under the share of defects that these entries have.

    Args:
        chances: (n,) under the share that the model was fitted to.
        share: that one.
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
