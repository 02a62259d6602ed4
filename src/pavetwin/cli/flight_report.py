"""Progress, tables, sentences and images of flown missions."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import yaml
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from pavetwin.cli.console import Bar, Lines, err, note_fonts, out, progress
from pavetwin.errors import PaveTwinError
from pavetwin.memory import give_back
from pavetwin.mission.environment import INSPECT_MPS, capture_interval_s, inspect_speed_mps, window_m
from pavetwin.mission.events import MissionEvent, ProgressMade
from pavetwin.mission.replay import Replay, grown_s
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
from pavetwin.reports.words import counted
from pavetwin.traffic.demand import density_named

if TYPE_CHECKING:
    from pavetwin.capture.mission_images import MissionImages
    from pavetwin.config import MissionSettings
    from pavetwin.mission.folder import MissionFolder
    from pavetwin.mission.inputs import MissionInputs, OnProgress
    from pavetwin.mission.result import MissionResult
    from pavetwin.mission.spec import MissionSpec
    from pavetwin.traffic.area import TrafficArea
    from pavetwin.world.model import World


CITY_KM: Final = 15.0
"""Length of lanes up to which a whole town is recorded quickly."""

STATED_AREA_M: Final = 200.0
"""The distance that agrees with the traffic of whole towns: docs/explanation/traffic.md, "Area"."""

LEAST_GAP_M: Final = 0.05
"""Smaller gaps between captures are not reported."""


def settings_text(settings: "MissionSettings") -> str:
    """All settings as YAML, ready for `--set`."""
    return yaml.safe_dump(settings.model_dump(mode="json"), sort_keys=False).rstrip()


def instead_line(spec: "MissionSpec") -> str:
    """A note if the level of service is not the usual one; otherwise empty."""
    traffic = spec.traffic
    if traffic.instead_of is None or traffic.density is None:
        return ""
    return nearest_line(traffic.instead_of, traffic.density, spec.world.name)


def area_line(area: "TrafficArea | None", world: "World") -> str:
    """A note on the streets with traffic; empty if all streets have it."""
    if area is None:
        return ""
    return (
        f"Traffic on {area.length_km(world):.1f} km of lanes, those within {area.distance_m:g} m of the inspected "
        "segments; --traffic-area all simulates it everywhere."
    )


def reporting_whole_towns(report: "OnProgress", spec: "MissionSpec", world: "World") -> "OnProgress":
    """A progress callback that prints one line when the recording of a whole large town begins."""
    from pavetwin.mission.inputs import RECORDING

    lines = [whole_town_line(world, spec.targets)] if spec.area(world) is None else []

    def reported(share: float, what: str) -> None:
        if what == RECORDING and lines and (line := lines.pop()):
            err.line(line)
        report(share, what)

    return reported


def whole_town_line(world: "World", targets: Sequence[str]) -> str:
    """A note that the traffic of a whole large town is recorded, and how much smaller an area would be; empty for a
    small town, and where the area would be most of it."""
    from pavetwin.traffic.area import TrafficArea
    from pavetwin.world.model import LaneKind

    whole_km = world.length_km(LaneKind.DRIVING)
    if whole_km < CITY_KM or (area := TrafficArea.around(world, targets, STATED_AREA_M)) is None:
        return ""
    return (
        f"Recording the traffic of all {whole_km:.0f} km of lanes. --traffic-area {STATED_AREA_M:g} records only the "
        f"{area.length_km(world):.1f} km around the inspected segments, which is faster and slightly less accurate."
    )


def nearest_line(usual: str, nearest: str, world: str) -> str:
    """A note that a world cannot reach the usual level of service, and the level used instead, by the names of the
    traffic."""
    missed, instead = (density_named(name).level for name in (usual, nearest))
    return (
        f"Level of service {missed}, the usual one, cannot be reached in '{world}'; using {instead}, the nearest one. "
        "Choose another with --los."
    )


def print_start(spec: "MissionSpec", inputs: "MissionInputs", world: "World") -> None:
    """Print the circumstances of a mission: parked vehicles, traffic at take-off, pace, area and flow."""
    from pavetwin.traffic.flow import flow_of

    replay = inputs.replay
    if parked := len(inputs.environment.parked):
        out.line(f"{counted(parked, 'vehicle')} parked in {counted(len(world.parking), 'place')}.")
    vehicles, pedestrians = replay.recording.agents_at(spec.traffic.take_off_s)
    out.line(
        f"Take-off {spec.traffic.take_off_s:g} s after the traffic begins, with {counted(vehicles, 'vehicle')} and "
        f"{counted(pedestrians, 'pedestrian')} on the streets."
    )
    for line in (pace_line(spec.settings), instead_line(spec), area_line(replay.area, world)):
        if line:
            out.line(line)
    flow = flow_of(replay.recording)
    out.line(f"Traffic {replay.recording.name}: {flow.sentence} {flow.removals_sentence}")


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


def print_results(results: Sequence["MissionResult"], inputs: "MissionInputs", former: "MissionFolder | None") -> None:
    """Print the results, and how they compare with an earlier flight of the same mission."""
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
    """One row per segment, and the sums."""
    return _table(segment_columns(result), show_footer=True)


def comparison_table(results: Sequence["MissionResult"]) -> Table:
    """One row per policy, the best of each column in bold."""
    return _table(comparison_columns(results))


def streets_table(results: Sequence["MissionResult"]) -> Table:
    """One row per street."""
    return _table(street_columns(results))


def _table(columns: Sequence[TableColumn], *, show_footer: bool = False) -> Table:
    """A table that shortens names, never numbers, where space is short."""
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
            f"Inspection speed {speed_mps:.1f} m/s: the camera takes an image every {interval_s:g} s, and a higher "
            "speed would leave gaps. To override it: --set uav.inspect_speed_mps=5."
        )
    gap_m = speed_mps * interval_s - along_m
    if gap_m < LEAST_GAP_M:
        return ""
    return (
        f"Captures every {interval_s:g} s at {speed_mps:g} m/s leave gaps of {gap_m:.1f} m between their windows of "
        f"{along_m:.1f} m."
    )


MISSION_FILES = (
    "streets.csv, defects.gpkg, defects.csv, captures.geojson, "
    "mission.parquet, track.parquet, detections.parquet, mission.yaml"
)

SHEET = "detections.jpg"

Drawing = Callable[["MissionResult", Path], None]
"""Draws a mission into a file, whole or not at all."""


def draw(
    results: Sequence["MissionResult"],
    folder: Path,
    *,
    several: bool,
    maps: bool = True,
    animated: Callable[["MissionResult"], bool] = lambda _: False,
    frames: Drawing | None = None,
    sheet: Drawing | None = None,
    title: str = "Drawing",
) -> None:
    """Draw missions into the folder of their numbers.

    Args:
        several: there is a folder for each policy, and a comparison of the maps.
        animated: whether a mission is shown moving as well.
        frames: takes the frames of a mission's captures; none are saved unless given.
        sheet: draws what the sensor found, missed and reported falsely.

    Raises:
        PaveTwinError: an image failed; the first failure is reported after all others are drawn.
    """
    drawings: list[tuple[str, Callable[[MissionResult], bool], Drawing]] = []
    if maps:
        drawings.append(("map.png", lambda _: True, partial(_draw_map, title)))
    drawings.append(("mission.gif", animated, partial(_draw_animation, title)))
    if frames is not None:
        drawings.append(("frames", lambda _: True, frames))
    if sheet is not None:
        drawings.append((SHEET, lambda _: True, sheet))
    failures: list[PaveTwinError] = []
    give_back()  # what recording traffic took; drawing takes as much
    for result in results:
        place = folder / result.policy if several else folder
        for name, wanted, drawing in drawings:
            if wanted(result):
                failures += _failures(partial(drawing, result), place / name)
    if several and maps:
        failures += _failures(partial(_draw_comparison, results), folder / "comparison.png")
    if failures:
        raise failures[0]


def drawing_sheet(images: "MissionImages") -> Drawing:
    """Draws the contact sheet of a mission whose sensor looked at images."""

    def draw_sheet(mission: "MissionResult", path: Path) -> None:
        from pavetwin.capture.sheets import save_mission_sheet
        from pavetwin.sensing import load_sensor

        with progress(f"Drawing what was found: {mission.policy}"):
            sensor = load_sensor(mission.settings.sensing, mission.seed)
            save_mission_sheet(mission, images, sensor, path)

    return draw_sheet


def saving_frames(images: "MissionImages", *, every: bool) -> Drawing:
    """Takes the frames of a mission's captures.

    Args:
        every: of all; else of those that confirmed a defect.

    Raises:
        PaveTwinError: there is no adapter to draw with.
    """
    from pavetwin.capture.mission_frames import save_frames
    from pavetwin.render.adapter import find_adapter

    adapter = str(find_adapter())

    def take(mission: "MissionResult", path: Path) -> None:
        with progress(f"Taking frames: {mission.policy}") as show:
            save_frames(mission, images, path.parent, every=every, adapter=adapter, on_progress=show)

    return take


def print_files(
    results: Sequence["MissionResult"], folder: Path, *, maps: bool, animate: bool, frames: bool, sheet: bool = False
) -> None:
    """Print the written files, and the missing font package where an image could not show names."""
    pictures = {"map.png": maps, "mission.gif": animate, "frames/": frames, SHEET: sheet}
    if any(pictures.values()):
        note_fonts(results[0].environment.world)
    each = ", ".join([*(name for name, drawn in pictures.items() if drawn), MISSION_FILES])
    if len(results) > 1:
        comparison = "comparison.png, " if maps else ""
        each = f"{comparison}mission.parquet, streets.csv, and a folder for each policy with {each}"
    out.print(f"Results in {folder}/: {each}", markup=False, soft_wrap=True)


def _draw_map(title: str, result: "MissionResult", path: Path) -> None:
    with progress(f"{title}: {result.policy}"):
        from pavetwin.draw.mission_map import save_mission_map

        save_mission_map(result, path)


def _draw_animation(title: str, result: "MissionResult", path: Path) -> None:
    from pavetwin.draw.animation import save_animation

    with progress(f"{title}: {result.policy}, moving") as show:
        save_animation(result, path, on_progress=show)


def _draw_comparison(results: Sequence["MissionResult"], path: Path) -> None:
    from pavetwin.draw.mission_map import save_comparison_map

    save_comparison_map(results, path)


def _failures(draw: Callable[[Path], None], path: Path) -> list[PaveTwinError]:
    """Draw one image; an error is reported and does not prevent the next one."""
    try:
        draw(path)
    except PaveTwinError as error:
        return [PaveTwinError(f"'{path}' was not drawn: {error} The numbers are in '{path.parent}'.")]
    except Exception as error:
        failure = PaveTwinError(
            f"'{path}' could not be drawn ({type(error).__name__}: {error}); the numbers are in '{path.parent}'. "
            "Please report this."
        )
        failure.__cause__ = error
        return [failure]
    return []


AGENT_S = 2e-5
"""Real seconds that SUMO takes for a second of an agent."""


class FlightProgress:
    """An observer of a mission that moves a bar.

    What is left is estimated from three rates: flown seconds a share of the mission, and real seconds a flown second
    and a simulated one. Traffic is recorded in the steps of `grown_s`.
    """

    def __init__(
        self, show: Bar | Lines, what: str, traffic: Replay, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._show, self._what, self._traffic, self._clock = show, what, traffic, clock
        self._share, self._flown_s = 0.0, 0.0
        self._first_pace = _pace_of(traffic)
        self._last = clock()
        self._flying_s = self._recording_s = self._simulated_s = 0.0
        self._extension: float | None = None
        """When the one in progress began."""
        self._extending_s = self._extended = 0.0
        """The seconds that it simulates, and the share of them that is done."""

    def __call__(self, event: MissionEvent) -> None:
        """Observe an event of the mission."""
        if not isinstance(event, ProgressMade):
            return
        now = self._clock()
        self._end_extension()
        self._flying_s += now - self._last
        self._last, self._share, self._flown_s = now, event.share, event.time_s
        self._show(self._share, self._what, self.remaining_s(0.0, 0.0))

    def extended(self, share: float) -> None:
        """Observe the progress of an extension of the recorded traffic."""
        now = self._clock()
        if share <= self._extended:
            self._end_extension()  # another one has begun
        if self._extension is None:
            self._extension = self._last
        self._last, self._extending_s, self._extended = now, self._traffic.extending_s, share
        begun_s = now - self._extension
        left_s = begun_s * (1 - share) / share if share > 0 else 0.0
        self._show(self._share, f"{self._what}, recording more traffic", self.remaining_s(left_s, begun_s, share))

    def _end_extension(self) -> None:
        if self._extension is not None:
            self._recording_s += self._last - self._extension
            self._simulated_s += self._extending_s
        self._extension, self._extended = None, 0.0

    def remaining_s(self, extension_s: float, begun_s: float, share: float = 0.0) -> float | None:
        """Seconds to the end of the mission; None where nothing is known yet.

        Args:
            extension_s: that the extension in progress still takes.
            begun_s: that it has taken.
            share: of it that is done.
        """
        if not self._share or not self._flown_s:
            return None
        whole_s = self._flown_s / self._share
        left_s = self._flying_s * (1 - self._share) / self._share + extension_s
        known_s = self._traffic.recording.duration_s - self._traffic.start_s
        if self._extension is not None:
            known_s = grown_s(known_s)
        longest_s = known_s
        while longest_s < whole_s:
            longest_s = grown_s(longest_s)
        simulated_s = self._simulated_s + share * (self._extending_s if self._extension is not None else 0.0)
        pace = (self._recording_s + begun_s) / simulated_s if simulated_s > 0 else self._first_pace
        return left_s + (longest_s - known_s) * pace


def _pace_of(traffic: Replay) -> float:
    """Real seconds that a second of a recording takes: as it did just now, else as its agents take on one core."""
    if traffic.recorder is not None and traffic.recorder.pace is not None:
        return traffic.recorder.pace
    numbers = traffic.recording.tracks.numbers
    return AGENT_S * float((numbers.vehicles + numbers.pedestrians).mean())
