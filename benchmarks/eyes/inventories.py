"""Inventories of the detector's missions beside what is there: entries doubled and joined, places, lengths, the index.

Which defect a detection shows is judged twice: by the mission's matching, in which each defect is found once a capture
and a second detection of it may be given to a neighbour; and by place, as the defect of its class on which most of it
lies.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
import shapely
from shapely import Polygon

from benchmarks.eyes.joined import HoldsTwo, holding_two
from benchmarks.eyes.joined import markdown as of_joined
from pavetwin.inventory.condition import with_detected
from pavetwin.inventory.entry import entry_of
from pavetwin.inventory.merging import merged
from pavetwin.inventory.observation import Observation
from pavetwin.inventory.of_mission import TABLE, flown
from pavetwin.inventory.reading import Reading
from pavetwin.labels.classes import label_name
from pavetwin.mission.condition import ConditionReport, condition_of_mission
from pavetwin.mission.folder import MissionFolder
from pavetwin.sensing import OTHER_CLASSES
from pavetwin.world.georeference import from_wgs84

AROUND_M: Final = 0.1
"""Outlines are widened by this before they are compared: cracks are a few centimetres wide."""

LEAST_SHARED: Final = 0.5
"""Of the smaller one; what shares less with every defect is a false alarm."""


@dataclass(frozen=True)
class There:
    """A defect that is there, in the frame of the observations."""

    kind: str
    """As label files write it."""
    outline: Polygon
    length_m: float


def inventories(missions: Sequence[Path]) -> tuple[pl.DataFrame, pl.DataFrame, list[HoldsTwo]]:
    """One row a mission and judgement, one row an entry of one defect, whole in an image: how far it is off, and the
    entries that hold several."""
    rows, entries = [], []
    joined: list[HoldsTwo] = []
    for folder in missions:
        reading = flown(folder)
        report = condition_of_mission(MissionFolder(folder / "mission.yaml"))
        there = _there(report, reading)
        table = pl.read_parquet(folder / TABLE).filter(~pl.col("class").is_in(list(OTHER_CLASSES)))
        groups = merged(reading.observations)
        of = {"matching": table["defect"].to_list(), "place": list(shown(reading.observations, there))}
        compared = with_detected(report, reading)
        errors = (
            [0.0]
            if compared.detected is None
            else [abs(detected.pci - true.pci) for detected, true in zip(compared.detected, compared.true, strict=True)]
        )
        name = {"town": folder.parent.name, "mission": folder.name}
        for judged, defects in of.items():
            rows.append({**name, "judged": judged, **tally(groups, defects), "pci_error": float(np.mean(errors))})
        entries += [{**name, **each} for each in _entries(reading, groups, of["place"], there)]
        outlines = {number: each.outline for number, each in there.items()}
        joined += holding_two(reading.observations, groups, of, outlines, AROUND_M)
    return pl.DataFrame(rows), pl.DataFrame(entries), joined


def tally(groups: Sequence[Sequence[int]], defects: Sequence[int | None]) -> dict[str, int]:
    """Of the entries that show a defect: how many there are, those beyond one a defect, those that hold several, and
    detected defects that no entry is mainly of.

    Args:
        groups: of detections, one an entry.
        defects: that each detection shows.
    """
    mains: Counter[int] = Counter()
    joined = 0
    for group in groups:
        mine = Counter(number for at in group if (number := defects[at]) is not None)
        if mine:
            mains[mine.most_common(1)[0][0]] += 1
            joined += len(mine) > 1
    seen = {number for number in defects if number is not None}
    doubled = sum(count - 1 for count in mains.values())
    return {
        "entries": mains.total(),
        "doubled": doubled,
        "joined": joined,
        "lost": len(seen - set(mains)),
        "seen": len(seen),
    }


def shown(observations: Sequence[Observation], there: Mapping[int, There]) -> Iterator[int | None]:
    """The defect of its class on which most of each observation lies; None for a false alarm."""
    wide = {number: each.outline.buffer(AROUND_M) for number, each in there.items()}
    for each in observations:
        assert each.footprint is not None
        mine = each.footprint.buffer(AROUND_M)
        areas = {number: wide[number].intersection(mine).area for number, it in there.items() if it.kind == each.kind}
        best = max(areas, key=lambda number: areas[number], default=None)
        is_there = best is not None and areas[best] >= LEAST_SHARED * min(wide[best].area, mine.area)
        yield best if is_there else None


def _there(report: ConditionReport, reading: Reading) -> dict[int, There]:
    frame, place = reading.frame, report.world.georeference
    assert frame is not None
    return {
        each.id: There(
            label_name(each.kind),
            shapely.transform(each.polygon, lambda xy: from_wgs84(frame, place.to_wgs84(xy))),
            each.length_m,
        )
        for each in report.defects
    }


def _entries(
    reading: Reading, groups: Sequence[Sequence[int]], defects: Sequence[int | None], there: Mapping[int, There]
) -> Iterator[dict[str, object]]:
    for group in groups:
        mine = {number for at in group if (number := defects[at]) is not None}
        entry = entry_of(1, [reading.observations[at] for at in group])
        if len(mine) != 1 or entry.is_cut or entry.place is None:
            continue
        true = there[mine.pop()]
        length = entry.sizes.get("length_m")
        yield {
            "kind": true.kind,
            "away_m": entry.place.distance(true.outline.centroid),
            "length_error": None if length is None else length.value / true.length_m - 1,
        }


def markdown(rows: pl.DataFrame, entries: pl.DataFrame, joined: Sequence[HoldsTwo]) -> str:
    """All three tables in Markdown."""
    lines = ["| judged by | entries | doubled | joined wrongly | defects lost | PCI error |", "|---" * 6 + "|"]
    for (judged,), part in rows.group_by("judged", maintain_order=True):
        total = part.select("entries", "doubled", "joined", "lost", "seen").sum().row(0, named=True)
        shares = [f"{100 * total[name] / total['entries']:.1f} %" for name in ("doubled", "joined")]
        lost = f"{total['lost']} of {total['seen']}"
        lines.append(
            f"| {judged} | {total['entries']} | {' | '.join(shares)} | {lost} | {part['pci_error'].mean():.1f} |"
        )
    lines += ["", "| class | entries | from its middle, median | length, median error |", "|---" * 4 + "|"]
    for kind in [*entries["kind"].unique().sort(), None]:
        part = entries if kind is None else entries.filter(kind=kind)
        length = part["length_error"].median()
        told = "–" if length is None else f"{100 * length:+.0f} %"  # type: ignore[operator]
        lines.append(f"| {kind or 'all'} | {part.height} | {part['away_m'].median():.2f} m | {told} |")
    return "\n".join([*lines, "", of_joined(joined)])
