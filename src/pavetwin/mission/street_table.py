"""A mission by street: what an agency plans by."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import polars as pl

from pavetwin.mission.fly import MissionResult
from pavetwin.mission.inspected_defects import HIDDEN, MissReason
from pavetwin.mission.metrics import SegmentMetrics

STREETS: Final = "streets.csv"


def street_table(result: MissionResult, reasons: pl.DataFrame) -> pl.DataFrame:
    """One row a street, in the order of inspection.

    Columns: `policy`, `street`, `segments` (ids), `length_m`, `area_m2`, `defects`, `found`, `coverage` (share of the
    defects), `surface_coverage` (by area), `hidden`, `not_recognised`, `other_missed`, `time_s`,
    `pci` and `pci_found` (of the segments, by area).

    Args:
        reasons: `segment` and `reason` of each inspected defect, as in `defects.csv`; null where it was found.
    """
    grouped: dict[str, list[SegmentMetrics]] = {}
    for row in result.rows:
        grouped.setdefault(row.street, []).append(row)
    missed: dict[str, list[str]] = {}
    for segment, reason in reasons.select("segment", "reason").rows():
        if reason:
            missed.setdefault(segment, []).append(reason)
    return pl.DataFrame(
        [{"policy": result.policy, **_street(name, rows, missed)} for name, rows in grouped.items()],
        infer_schema_length=None,
    )


def _street(name: str, rows: Sequence[SegmentMetrics], missed: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    reasons = [reason for row in rows for reason in missed.get(row.segment, ())]
    hidden, unseen = sum(reason in HIDDEN for reason in reasons), reasons.count(MissReason.NOT_RECOGNISED)
    area_m2, defects = sum(row.area_m2 for row in rows), sum(row.defects for row in rows)
    found = sum(row.confirmed for row in rows)
    return {
        "street": name,
        "segments": " ".join(row.segment for row in rows),
        "length_m": round(sum(row.length_m for row in rows), 1),
        "area_m2": round(area_m2, 1),
        "defects": defects,
        "found": found,
        "coverage": round(found / defects, 4) if defects else None,
        "surface_coverage": round(sum(row.surface_coverage * row.area_m2 for row in rows) / area_m2, 4),
        "hidden": hidden,
        "not_recognised": unseen,
        "other_missed": len(reasons) - hidden - unseen,
        "time_s": round(sum(row.time_s for row in rows), 1),
        "pci": round(sum(row.pci * row.area_m2 for row in rows) / area_m2, 1),
        "pci_found": round(sum(row.pci_found * row.area_m2 for row in rows) / area_m2, 1),
    }
