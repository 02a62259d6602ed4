"""What `fly` prints and writes of numbers: tables, a sentence, files."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import yaml
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from pavetwin.cli.console import out
from pavetwin.mission.environment import INSPECT_MPS, capture_interval_s, inspect_speed_mps, window_m
from pavetwin.mission.found_share import found_share
from pavetwin.mission.inspected_defects import PLACED, missed_words
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.results import Totals, save_mission, save_missions, totals
from pavetwin.traffic.demand import density_named

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings
    from pavetwin.mission.again import FormerMission
    from pavetwin.mission.fly import MissionResult
    from pavetwin.mission.inputs import MissionInputs
    from pavetwin.mission.spec import MissionSpec
    from pavetwin.traffic.area import TrafficArea
    from pavetwin.world.model import World


LEAST_GAP_M: Final = 0.05
"""Smaller gaps between captures are not worth a word."""


def settings_text(settings: "MissionSettings") -> str:
    """All settings as YAML, ready for `--set`."""
    return yaml.safe_dump(settings.model_dump(mode="json"), sort_keys=False).rstrip()


def instead_line(spec: "MissionSpec") -> str:
    """That another level of service is flown than the usual one; empty where it is not."""
    traffic = spec.traffic
    if traffic.instead_of is None or traffic.density is None:
        return ""
    return nearest_line(traffic.instead_of, traffic.density, spec.world.name)


def area_line(area: "TrafficArea | None", world: "World") -> str:
    """On which streets there is traffic; empty where it is on all."""
    if area is None:
        return ""
    return (
        f"Traffic on {area.length_km(world):.1f} km of lanes, those within {area.distance_m:g} m of what is inspected; "
        "--traffic-area all has it everywhere."
    )


def nearest_line(usual: str, nearest: str, world: str) -> str:
    """That a world cannot reach the usual level of service, and which it has instead; by the names of the traffic."""
    missed, instead = (density_named(name).level for name in (usual, nearest))
    return (
        f"Level of service {missed}, the usual one, is out of reach in '{world}': its traffic is {instead}, the "
        "nearest that it reaches. --los asks for another."
    )


def save(missions: Iterable["MissionResult"], folder: Path, *, several: bool) -> list["MissionResult"]:
    """Write the numbers of missions into `folder`, each as it comes. Returns the missions.

    Args:
        several: a folder for each policy.
    """
    result: list[MissionResult] = []

    def flown() -> Iterator["MissionResult"]:
        for mission in missions:
            result.append(mission)
            yield mission

    if several:
        save_missions(flown(), folder)
    else:
        for mission in flown():
            save_mission(mission, folder)
    return result


def tell(results: Sequence["MissionResult"], inputs: "MissionInputs", former: "FormerMission | None") -> None:
    """Print what came out, and how it compares with a former flight of the same mission."""
    for remark in inputs.replay.recording.remarks:
        out.print(f"[yellow]Note:[/] {remark}")
    out.print(segments_table(results[0]) if len(results) == 1 else comparison_table(results))
    if len(results) > 1 or 1 < len({row.street for row in results[0].rows}) < len(results[0].rows):
        out.print(streets_table(results))
    out.print(sentence(results), markup=False, soft_wrap=True)
    for line in [*missed_lines(results), *without_defects(results[0].rows)]:
        out.print(line, markup=False, soft_wrap=True)
    out.line(limits_line(inputs))
    if former is not None:
        if changes := former.version_changes():
            out.print(f"[yellow]Note:[/] flown before with {', '.join(changes)}.", soft_wrap=True)
        out.print(former.verdict(results[0]), markup=False, soft_wrap=True)


def outside_words(world: "World") -> str:
    """How much of the carriageway belongs to no segment."""
    outside_m2, whole_m2 = world.outside_segments_m2, world.carriageway.area
    return f"{outside_m2:.0f} m² of junctions and crossings, {100 * outside_m2 / whole_m2:.0f} % of the carriageway"


def limits_line(inputs: "MissionInputs") -> str:
    """What the numbers are not of."""
    return f"Defects are {PLACED}; not inspected: {outside_words(inputs.environment.world)}."


ON_RETURN: Final = "found\non\nreturn\n%"
"""Heading of the share of defects that were found only on a revisit."""

AT_MOST: Final = "of at\nmost %"
"""Heading of the share of the surface that parked vehicles leave to be seen; where there are some."""


def segments_table(result: "MissionResult") -> Table:
    """One row a segment, and the sums."""
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
    shown = [column for column in columns if column[0] not in idle]
    table = _table(show_footer=True)
    for heading, footer, text in shown:
        if heading == "street":
            table.add_column(heading, vertical="bottom")
        else:
            _add_rigid(table, heading, [text(row) for row in rows], footer, left=heading == "segment")
    for row in rows:
        table.add_row(*(_name(text(row)) if heading == "street" else text(row) for heading, _, text in shown))
    return table


def comparison_table(result: Sequence["MissionResult"]) -> Table:
    """One row a policy, the best of each column in bold."""
    sums = [totals(mission) for mission in result]
    table = _table()
    table.add_column("policy", vertical="bottom")
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
    columns = [_cells(value, form, better, sums) for _, value, form, better in measures]
    for (heading, *_), cells in zip(measures, columns, strict=True):
        _add_rigid(table, heading, [cell.plain for cell in cells])
    for mission, *cells in zip(result, *columns, strict=True):
        table.add_row(_name(mission.policy), *cells)
    return table


def streets_table(result: Sequence["MissionResult"]) -> Table:
    """One row a street, with the share of its defects that each policy found; of one policy also what it saw."""
    table = _table()
    table.add_column("street", vertical="bottom")
    names = list(dict.fromkeys(row.street for row in result[0].rows))
    by_street = [[[row for row in mission.rows if row.street == name] for name in names] for mission in result]
    first = by_street[0]
    columns = [
        ("segments", [f"{len(rows)}" for rows in first]),
        ("length\nm", [f"{sum(row.length_m for row in rows):.0f}" for rows in first]),
        ("area\nm²", [f"{sum(row.area_m2 for row in rows):.0f}" for rows in first]),
        ("defects", [f"{sum(row.defects for row in rows)}" for rows in first]),
    ]
    for mission, streets in zip(result, by_street, strict=True):
        whose = f"{mission.policy}\n" if len(result) > 1 else ""
        columns.append((f"{whose}found %", [_percent(_found(rows)) for rows in streets]))
    if len(result) == 1:
        columns.append(("surface\nseen %", [_percent(_seen(rows)) for rows in first]))
        columns.append(("time\ns", [f"{sum(row.time_s for row in rows):.0f}" for rows in first]))
    for heading, cells in columns:
        _add_rigid(table, heading, cells)
    for name, *cells in zip(names, *(cells for _, cells in columns), strict=True):
        table.add_row(_name(name), *cells)
    return table


def _found(rows: Sequence[SegmentMetrics]) -> float | None:
    defects = sum(row.defects for row in rows)
    return sum(row.confirmed for row in rows) / defects if defects else None


def _seen(rows: Sequence[SegmentMetrics]) -> float:
    return sum(row.surface_coverage * row.area_m2 for row in rows) / sum(row.area_m2 for row in rows)


def _table(*, show_footer: bool = False) -> Table:
    return Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold", show_footer=show_footer)


def _add_rigid(table: Table, heading: str, cells: Sequence[str], footer: str = "", *, left: bool = False) -> None:
    """A column that is never shortened: half a number is a wrong number."""
    width = max(cell_len(line) for line in (*heading.split("\n"), *cells, footer))
    justify: Literal["left", "right"] = "left" if left else "right"
    table.add_column(
        heading, footer, justify=justify, vertical="bottom", footer_style="bold", no_wrap=True, min_width=width
    )


def _name(text: str) -> Text:
    """A cell that is shortened where space is short; brackets in a name are not markup."""
    return Text(text, no_wrap=True, overflow="ellipsis")


def _cells(value: Callable[[Totals], float | None], form: str, better: int, sums: Sequence[Totals]) -> list[Text]:
    """One column, its best in bold where one is better (1: the largest, −1: the smallest) and they differ."""
    values = [value(sum_) for sum_ in sums]
    texts = ["–" if number is None else form.format(number) for number in values]
    known = [number * better for number in values if number is not None]
    differ = bool(better and known and len(set(texts)) > 1)
    best = form.format(max(known) * better) if differ else None
    return [Text(text, style="bold" if text == best else "") for text in texts]


def sentence(result: Sequence["MissionResult"]) -> str:
    """The result in one sentence."""
    if len(result) == 1:
        sums = totals(result[0])
        found = f"{sums.confirmed} of {sums.defects} defects found" if sums.defects else "No defects to find"
        found += _as_far_as_known(result[0].rows)
        if sums.false_alarms:
            found += f", {sums.false_alarms} false alarm{'s' if sums.false_alarms != 1 else ''}"
        surface = f"{_percent(sums.surface_coverage)} % of the surface seen"
        if sums.permanently_hidden:
            surface += f" (of at most {_percent(_reachable(sums))} % beside parked vehicles)"
        minutes = f"{sums.time_s / 60:.1f} min"
        if sums.swaps:
            changes = f"{sums.swaps} battery change{'s' if sums.swaps != 1 else ''}"
            return f"{found}, {surface}, in {minutes} with {changes}: bring {sums.batteries} batteries."
        return f"{found}, {surface}, in {minutes} with {100 * sums.energy:.0f} % of a battery."
    return "The same traffic, defects, order and sensor seed for every policy; one mission each, so no statistics yet."


def _as_far_as_known(rows: Sequence[SegmentMetrics]) -> str:
    """` (83 %; 45 to 98 % on streets like these)`; empty without defects."""
    known = found_share([row.confirmed for row in rows], [row.defects for row in rows])
    if known is None:
        return ""
    share, low, high = (f"{100 * value:.0f}" for value in (known.share, known.low, known.high))
    return f" ({share} %; {low} to {high} % on streets like these)"


def pace_line(settings: "MissionSettings") -> str:
    """How the camera's interval limits the speed of inspection, or what a given speed leaves out; empty for neither."""
    speed_mps, interval_s, along_m = inspect_speed_mps(settings), capture_interval_s(settings), window_m(settings)[1]
    if settings.uav.inspect_speed_mps is None and speed_mps < INSPECT_MPS:
        return (
            f"Inspects at {speed_mps:.1f} m/s: its camera takes a picture every {interval_s:g} s, and faster would "
            "leave gaps. A speed of your own: --set uav.inspect_speed_mps=5."
        )
    gap_m = speed_mps * interval_s - along_m
    if gap_m < LEAST_GAP_M:
        return ""
    return (
        f"Captures every {interval_s:g} s at {speed_mps:g} m/s leave gaps of {gap_m:.1f} m between their windows of "
        f"{along_m:.1f} m."
    )


def missed_lines(results: Sequence["MissionResult"]) -> list[str]:
    """For each mission that missed something, how many defects and why."""
    lines = []
    for result in results:
        reasons = Counter(outcome.reason for outcome in result.inspected_defects)
        found = reasons.pop(None, 0)
        if missed := reasons.total():
            whose = f"{result.policy} missed" if len(results) > 1 else "Missed"
            lines.append(f"{whose} {missed} of {missed + found}: {missed_words(reasons)}.")
    return lines


def without_defects(rows: Sequence[SegmentMetrics]) -> list[str]:
    """How many of several segments have no defects, if any."""
    empty = sum(not row.defects for row in rows)
    if not 0 < empty < len(rows):
        return []
    which = "1 of the segments has" if empty == 1 else f"{empty} of the segments have"
    return [f"{which} no defects: what is found there is no share, neither 0 nor 100 %."]


def _reachable(measured: SegmentMetrics | Totals) -> float | None:
    """The share of the surface that parked vehicles leave to be seen."""
    return None if measured.permanently_hidden is None else 1 - measured.permanently_hidden


def _hundred(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"
