"""Summaries of missions for readers: tables of text cells, and sentences, for the command line and the page."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from pavetwin.defects.placement import PLACED
from pavetwin.mission.inspected_defects import missed_words
from pavetwin.mission.metrics import SegmentMetrics, Totals, found_share, totals
from pavetwin.mission.result import MissionResult
from pavetwin.world.segments import outside_words

ON_RETURN: Final = "found\non\nreturn\n%"
"""Heading of the share of defects that were found only on a revisit."""

AT_MOST: Final = "of at\nmost %"
"""Heading of the share of the surface that parked vehicles do not hide."""


@dataclass(frozen=True, slots=True)
class TableColumn:
    """A column of a table, as text."""

    heading: str
    """On one or several lines."""
    cells: tuple[str, ...]
    total: str = ""
    """Below the cells; empty where there is none."""
    is_name: bool = False
    """The cells are names, which may be shortened if space is short; others are numbers or ids."""
    is_left: bool = False
    best: frozenset[int] = frozenset()
    """Rows with the best value, if values differ and one is better."""


def segment_columns(result: MissionResult) -> tuple[TableColumn, ...]:
    """Table of segments with totals, without columns that are zero throughout."""
    sums, rows = totals(result), result.rows
    columns: list[tuple[str, str, Callable[[SegmentMetrics], str]]] = [
        ("segment", f"{sums.segments}", lambda row: row.segment),
        ("street", "", lambda row: row.street),
        ("length\nm", f"{sum(row.length_m for row in rows):.0f}", lambda row: f"{row.length_m:.0f}"),
        ("defects\nfound", f"{sums.confirmed}/{sums.defects}", lambda row: f"{row.confirmed}/{row.defects}"),
        ("found\n%", _percent(sums.coverage), lambda row: _percent(row.coverage)),
        (ON_RETURN, _percent(sums.recovery), lambda row: _percent(row.recovery)),
        ("surface\nseen %", _percent(sums.surface_coverage), lambda row: _percent(row.surface_coverage)),
        (AT_MOST, _percent(_reachable(sums)), lambda row: _percent(_reachable(row))),
        ("false\nalarms", f"{sums.false_alarms}", lambda row: f"{row.false_alarms}"),
        ("hidden\ntimes", f"{sums.occlusions}", lambda row: f"{row.occlusions}"),
        ("waited\ns", f"{sums.wait_s:.0f}", lambda row: f"{row.wait_s:.0f}"),
        ("time\ns", f"{sum(row.time_s for row in rows):.0f}", lambda row: f"{row.time_s:.0f}"),
        ("battery\n%", f"{100 * sum(row.energy for row in rows):.1f}", lambda row: f"{100 * row.energy:.1f}"),
    ]
    idle = {ON_RETURN} if not sums.revisits else set()
    idle |= {"waited\ns"} if not sums.wait_s else set()
    idle |= {"false\nalarms"} if not sums.false_alarms else set()
    idle |= {AT_MOST} if not sums.permanently_hidden else set()
    return tuple(
        TableColumn(
            heading,
            tuple(map(text, rows)),
            total,
            is_name=heading == "street",
            is_left=heading in ("segment", "street"),
        )
        for heading, total, text in columns
        if heading not in idle
    )


def comparison_columns(results: Sequence[MissionResult]) -> tuple[TableColumn, ...]:
    """Table of policies."""
    sums = [totals(mission) for mission in results]
    measures: list[tuple[str, Callable[[Totals], float | None], str, int]] = [
        (f"found of\n{sums[0].defects}\ndefects", lambda t: t.confirmed, "{:.0f}", 1),
        ("found\n%", lambda t: _hundred(t.coverage), "{:.1f}", 1),
        ("found of\nwhat the\ncamera\npassed %", lambda t: _hundred(t.swath_coverage), "{:.1f}", 1),
        (ON_RETURN, lambda t: _hundred(t.recovery), "{:.1f}", 0),
        ("surface\nseen %", lambda t: _hundred(t.surface_coverage), "{:.1f}", 1),
        ("waited\ns", lambda t: t.wait_s, "{:.0f}", 0),
        ("time\nmin", lambda t: t.time_s / 60, "{:.1f}", -1),
        ("battery\n%", lambda t: 100 * t.energy, "{:.1f}", -1),
        ("flown\nkm", lambda t: t.distance_m / 1000, "{:.2f}", -1),
    ]
    if any(each.permanently_hidden for each in sums):
        measures.insert(5, (AT_MOST, lambda t: _hundred(_reachable(t)), "{:.1f}", 0))
    if any(each.swaps for each in sums):
        measures[-2] = ("batteries\nto bring", lambda t: t.batteries, "{:.0f}", -1)
    if any(each.false_alarms for each in sums):
        measures.insert(1, ("false\nalarms", lambda t: t.false_alarms, "{:.0f}", -1))
    policies = TableColumn("policy", tuple(mission.policy for mission in results), is_name=True, is_left=True)
    return (policies, *(_compared(heading, value, form, better, sums) for heading, value, form, better in measures))


def _compared(
    heading: str, value: Callable[[Totals], float | None], form: str, better: int, sums: Sequence[Totals]
) -> TableColumn:
    """Args:
    better: 1 where the largest value is the best, −1 for the smallest, 0 where none is.
    """
    values = [value(sum_) for sum_ in sums]
    texts = ["–" if number is None else form.format(number) for number in values]
    known = [number * better for number in values if number is not None]
    best = form.format(max(known) * better) if better and known and len(set(texts)) > 1 else None
    return TableColumn(
        heading, tuple(texts), best=frozenset(row for row, text in enumerate(texts) if text == best and best)
    )


def street_columns(results: Sequence[MissionResult]) -> tuple[TableColumn, ...]:
    """One row per street, with the share of its defects that each policy found; for a single policy also what it
    saw."""
    names = list(dict.fromkeys(row.street for row in results[0].rows))
    by_street = [[[row for row in mission.rows if row.street == name] for name in names] for mission in results]
    first = by_street[0]
    columns = [
        ("segments", [f"{len(rows)}" for rows in first]),
        ("length\nm", [f"{sum(row.length_m for row in rows):.0f}" for rows in first]),
        ("area\nm²", [f"{sum(row.area_m2 for row in rows):.0f}" for rows in first]),
        ("defects", [f"{sum(row.defects for row in rows)}" for rows in first]),
    ]
    for mission, streets in zip(results, by_street, strict=True):
        whose = f"{mission.policy}\n" if len(results) > 1 else ""
        columns.append((f"{whose}found %", [_percent(_found(rows)) for rows in streets]))
    if len(results) == 1:
        columns.append(("surface\nseen %", [_percent(_seen(rows)) for rows in first]))
        columns.append(("time\ns", [f"{sum(row.time_s for row in rows):.0f}" for rows in first]))
    named = TableColumn("street", tuple(names), is_name=True, is_left=True)
    return (named, *(TableColumn(heading, tuple(cells)) for heading, cells in columns))


def has_street_table(results: Sequence[MissionResult]) -> bool:
    """True if the table of streets adds to those of segments and policies."""
    return len(results) > 1 or 1 < len({row.street for row in results[0].rows}) < len(results[0].rows)


def _found(rows: Sequence[SegmentMetrics]) -> float | None:
    defects = sum(row.defects for row in rows)
    return sum(row.confirmed for row in rows) / defects if defects else None


def _seen(rows: Sequence[SegmentMetrics]) -> float:
    return sum(row.surface_coverage * row.area_m2 for row in rows) / sum(row.area_m2 for row in rows)


def sentence(results: Sequence[MissionResult]) -> str:
    """The result in one sentence."""
    if len(results) == 1:
        sums = totals(results[0])
        found = f"{sums.confirmed} of {sums.defects} defects found" if sums.defects else "No defects to find"
        found += _as_far_as_known(results[0].rows)
        if sums.false_alarms:
            found += f", {sums.false_alarms} false alarm{'s' if sums.false_alarms != 1 else ''}"
        surface = f"{_percent(sums.surface_coverage)} % of the surface seen"
        if sums.permanently_hidden:
            surface += f" (of at most {_percent(_reachable(sums))} % next to parked vehicles)"
        minutes = f"{sums.time_s / 60:.1f} min"
        if sums.swaps:
            changes = f"{sums.swaps} battery change{'s' if sums.swaps != 1 else ''}"
            return f"{found}, {surface}, in {minutes} with {changes}: bring {sums.batteries} batteries."
        return f"{found}, {surface}, in {minutes} with {100 * sums.energy:.0f} % of a battery."
    return (
        f"{_found_by_policy(results)}. One mission each, over the same traffic, defects and order and with the same "
        "sensor seed: no statistics yet."
    )


def _found_by_policy(results: Sequence[MissionResult]) -> str:
    """`Of 97 defects hover found 12 in 1.2 min, baseline 11 in 1.1 min`; without defects the surface that was seen."""
    sums = [totals(result) for result in results]
    whole = f"Of {sums[0].defects} defects" if sums[0].defects else "Of the surface, without defects to find,"
    verb = "found" if sums[0].defects else "saw"
    parts: list[str] = []
    for result, each in zip(results, sums, strict=True):
        much = f"{each.confirmed}" if each.defects else f"{_percent(each.surface_coverage)} %"
        parts.append(f"{result.policy} {f'{verb} ' if not parts else ''}{much} in {each.time_s / 60:.1f} min")
    return f"{whole} {', '.join(parts)}"


def _as_far_as_known(rows: Sequence[SegmentMetrics]) -> str:
    """` (83 %; 45 to 98 % on streets like these)`; empty without defects."""
    known = found_share([row.confirmed for row in rows], [row.defects for row in rows])
    if known is None:
        return ""
    share, low, high = (f"{100 * value:.0f}" for value in (known.share, known.low, known.high))
    return f" ({share} %; {low} to {high} % on streets like these)"


def remarks(results: Sequence[MissionResult]) -> list[str]:
    """The lines below the sentence: missed defects and why, segments without defects, and the limits of the numbers."""
    limits = f"Defects are {PLACED}; not inspected: {outside_words(results[0].environment.world)}."
    return [*unprovoked(results), *missed_lines(results), *without_defects(results[0].rows), limits]


def unprovoked(results: Sequence[MissionResult]) -> list[str]:
    """A line if several policies flew alike because nothing hid the road."""
    if len(results) == 1 or any(totals(result).occlusions for result in results):
        return []
    least = results[0].spec.settings.visibility.threshold
    return [f"Visibility never fell below {least:g}: no policy had to react. They differ in denser traffic."]


def missed_lines(results: Sequence[MissionResult]) -> list[str]:
    """A line for each mission that missed defects: how many and why."""
    lines = []
    for result in results:
        reasons = Counter(outcome.reason for outcome in result.inspected_defects)
        found = reasons.pop(None, 0)
        if missed := reasons.total():
            whose = f"{result.policy} missed" if len(results) > 1 else "Missed"
            lines.append(f"{whose} {missed} of {missed + found}: {missed_words(reasons)}.")
    return lines


def without_defects(rows: Sequence[SegmentMetrics]) -> list[str]:
    """A line if some of several segments have no defects."""
    empty = sum(not row.defects for row in rows)
    if not 0 < empty < len(rows):
        return []
    which = "1 of the segments has" if empty == 1 else f"{empty} of the segments have"
    return [f"{which} no defects: what is found there is no share, neither 0 nor 100 %."]


def _reachable(measured: SegmentMetrics | Totals) -> float | None:
    """Share of the surface that parked vehicles do not hide."""
    return None if measured.permanently_hidden is None else 1 - measured.permanently_hidden


def _hundred(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"
