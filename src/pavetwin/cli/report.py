"""What `fly` prints and writes of numbers: tables, a sentence, files."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import yaml
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from pavetwin.cli.console import err, out
from pavetwin.mission.environment import INSPECT_MPS, capture_interval_s, inspect_speed_mps, window_m
from pavetwin.mission.saving import save_mission, save_missions
from pavetwin.mission.summary import (
    TableColumn,
    comparison_columns,
    has_street_table,
    remarks,
    segment_columns,
    sentence,
    street_columns,
)
from pavetwin.traffic.demand import density_named

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings
    from pavetwin.mission.folder import MissionFolder
    from pavetwin.mission.inputs import MissionInputs, OnProgress
    from pavetwin.mission.result import MissionResult
    from pavetwin.mission.spec import MissionSpec
    from pavetwin.traffic.area import TrafficArea
    from pavetwin.world.model import World


CITY_KM: Final = 15.0
"""Of lanes: towns with fewer are recorded soon enough as a whole."""

STATED_AREA_M: Final = 200.0
"""The distance that agrees with the traffic of whole towns: docs/explanation/traffic.md, "Area"."""

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


def telling_of_areas(tell: "OnProgress", spec: "MissionSpec", world: "World") -> "OnProgress":
    """As `tell`, and says once that the whole of a large town is recorded, where that begins."""
    from pavetwin.mission.inputs import RECORDING

    words = [whole_town_line(world, spec.targets)] if spec.area(world) is None else []

    def told(share: float, what: str) -> None:
        if what == RECORDING and words and (line := words.pop()):
            err.line(line)
        tell(share, what)

    return told


def whole_town_line(world: "World", targets: Sequence[str]) -> str:
    """That the traffic of a large town is recorded as a whole, and how much less an area would be; empty for a small
    one, and where the area would be most of it."""
    from pavetwin.traffic.area import TrafficArea
    from pavetwin.world.model import LaneKind

    whole_km = world.length_km(LaneKind.DRIVING)
    if whole_km < CITY_KM or (area := TrafficArea.around(world, targets, STATED_AREA_M)) is None:
        return ""
    return (
        f"Recording the traffic of all {whole_km:.0f} km of lanes. With --traffic-area {STATED_AREA_M:g} it is that of "
        f"{area.length_km(world):.1f} km around what is inspected, which takes less time and is a little less exact."
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


def tell(results: Sequence["MissionResult"], inputs: "MissionInputs", former: "MissionFolder | None") -> None:
    """Print what came out, and how it compares with a former flight of the same mission."""
    recorder = inputs.replay.recorder
    for path in recorder.damaged if recorder is not None else ():
        out.print(
            f"[yellow]Note:[/] '{path}' was damaged or of another version; it was recorded again.", soft_wrap=True
        )
    for remark in inputs.replay.recording.remarks:
        out.print(f"[yellow]Note:[/] {remark}")
    out.print(segments_table(results[0]) if len(results) == 1 else comparison_table(results))
    if has_street_table(results):
        out.print(streets_table(results))
    for line in (sentence(results), *remarks(results)):
        out.line(line)
    if former is not None:
        if changes := former.version_changes():
            out.print(f"[yellow]Note:[/] flown before with {', '.join(changes)}.", soft_wrap=True)
        out.print(former.verdict(results[0]), markup=False, soft_wrap=True)


def segments_table(result: "MissionResult") -> Table:
    """One row a segment, and the sums."""
    return _table(segment_columns(result), show_footer=True)


def comparison_table(results: Sequence["MissionResult"]) -> Table:
    """One row a policy, the best of each column in bold."""
    return _table(comparison_columns(results))


def streets_table(results: Sequence["MissionResult"]) -> Table:
    """One row a street."""
    return _table(street_columns(results))


def _table(columns: Sequence[TableColumn], *, show_footer: bool = False) -> Table:
    """A table whose names are shortened where space is short, and nothing else: half a number is a wrong number."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold", show_footer=show_footer)
    for column in columns:
        if column.is_name:
            table.add_column(column.heading, column.total, vertical="bottom")
            continue
        width = max(cell_len(line) for line in (*column.heading.split("\n"), *column.cells, column.total))
        justify: Literal["left", "right"] = "left" if column.is_left else "right"
        table.add_column(
            column.heading,
            column.total,
            justify=justify,
            vertical="bottom",
            footer_style="bold",
            no_wrap=True,
            min_width=width,
        )
    for row in range(len(columns[0].cells)):
        table.add_row(*(_cell(column, row) for column in columns))
    return table


def _cell(column: TableColumn, row: int) -> str | Text:
    """A cell; brackets in a name are not markup."""
    text = column.cells[row]
    if column.is_name:
        return Text(text, no_wrap=True, overflow="ellipsis")
    return Text(text, style="bold") if row in column.best else text


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
