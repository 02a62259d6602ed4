"""Detections drawn by hand, a record of one row each, and what the inventory makes of several."""

from collections.abc import Sequence

from shapely import Polygon

from pavetwin.detections import Detections
from pavetwin.inventory import entry, merging


def observed(
    class_name: str,
    confidence: float,
    image: str,
    footprint: Polygon | None,
    *,
    pixel_m: float = float("nan"),
    severity: str = "",
    position_error_m: float = 0.0,
    is_cut: bool = False,
    **sizes: float,
) -> Detections:
    """One detection in an image."""
    return Detections(
        [class_name],
        confidence,
        image=[image],
        footprint=[footprint],
        pixel_mm=[1000 * pixel_m],
        severity=[severity],
        position_error_m=[position_error_m],
        is_cut=[is_cut],
        **{name: [size] for name, size in sizes.items()},
    )


def merged(rows: Sequence[Detections]) -> list[list[int]]:
    """The groups of detections."""
    return merging.merged(Detections.concatenated(rows))


def entry_of(number: int, rows: Sequence[Detections]) -> entry.Entry:
    """The entry of the detections of one defect."""
    return entry.entry_of(number, Detections.concatenated(rows))
