"""From a reading to the entries of an inventory."""

from typing import Final

from pavetwin.inventory.entry import Entry, entry_of
from pavetwin.inventory.merging import merged
from pavetwin.inventory.probability import with_probabilities
from pavetwin.inventory.reading import Reading

CONFIDENCE: Final = 0.25
"""The least of what counts, unless given."""


def entries_of(reading: Reading, confidence: float = CONFIDENCE) -> list[Entry]:
    """One entry for each defect that a reading shows with at least this confidence.

    Raises:
        PaveTwinError: the confidence is not from 0 to 1.
    """
    kept = reading.confident(confidence)
    entries = [entry_of(number, kept[group]) for number, group in enumerate(merged(kept), 1)]
    return entries if reading.entry_model is None else with_probabilities(entries, reading.entry_model)
