"""Data that the browser plays: a flight, its events, and the positions of agents in minutes."""

import gzip
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from math import ceil, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pavetwin._core import Trace
from pavetwin.arrays import BoolArray, Float64Array, Int64Array
from pavetwin.config import MissionSettings
from pavetwin.draw.mission_marks import DefectOutcome, outcomes
from pavetwin.draw.mission_style import AGENT_COLOURS, agent_group
from pavetwin.draw.readings import DOING
from pavetwin.mission.environment import MissionEnvironment, parked_columns, window_m
from pavetwin.mission.events import (
    ActionTaken,
    BatteryRanLow,
    BatterySwapped,
    DefectsConfirmed,
    MissionEvent,
    NoteVisited,
    OcclusionStarted,
    SegmentFinished,
    SegmentStarted,
)
from pavetwin.mission.inspected_defects import InspectedDefect
from pavetwin.mission.metrics import totals
from pavetwin.mission.result import MissionResult
from pavetwin.mission.summary import (
    TableColumn,
    comparison_columns,
    has_street_table,
    remarks,
    segment_columns,
    sentence,
    street_columns,
)
from pavetwin.mission.timeline import Timeline
from pavetwin.mission.track import MODES
from pavetwin.policies import Displace, Revisit, Wait
from pavetwin.traffic.tracks import TELEPORT_MPS
from pavetwin.uav import camera_of
from pavetwin.world.model import Defect, World

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns


MAGIC: Final = int.from_bytes(b"PTA1", "little")

MINUTE_S: Final = 60.0

_PER_M: Final = 100.0
"""Centimetres."""

_PER_RAD: Final = 1e4

_STRAIGHT_M: Final = 0.02
"""An agent is moved between two steps where its velocity leads this close to where it is next."""


def minutes(trace: Trace, step_s: float, until_s: float) -> Iterator[bytes]:
    """The minutes of a trace from its beginning.

    Args:
        step_s: between two steps of the trace; a minute is a whole number of steps.
        until_s: the last moment that is played.
    """
    for number in range(max(1, ceil(until_s / MINUTE_S - 1e-9))):
        yield minute(trace, step_s, number)


def minute(trace: Trace, step_s: float, number: int) -> bytes:
    """One minute of a trace, or what there is of it."""
    steps = round(MINUTE_S / step_s)
    first, last = number * steps, int(trace.duration_s / step_s + 1e-6)
    frames = [trace.agents_at(step * step_s) for step in range(first, min(first + steps, last) + 1)]
    return _encoded(frames, step_s)


def _encoded(frames: list["PoseColumns"], step_s: float) -> bytes:
    counts = [len(frame["agent"]) for frame in frames]
    step: Int64Array = np.repeat(np.arange(len(frames)), counts)
    columns = {
        name: np.concatenate([np.asarray(frame[name], dtype=np.float64) for frame in frames])
        for name in ("agent", "x_m", "y_m", "yaw_rad", "east_mps", "north_mps")
    }
    order = np.lexsort((step, columns["agent"]))
    step, columns = step[order], {name: values[order] for name, values in columns.items()}
    starts = _starts(step, columns, step_s)
    first = np.flatnonzero(starts)
    lengths = np.diff(np.append(first, len(step)))
    x, y = (np.rint(columns[name] * _PER_M).astype(np.int64) for name in ("x_m", "y_m"))
    yaw = np.rint(columns["yaw_rad"] * _PER_RAD).astype(np.int64)
    turn = round(2 * pi * _PER_RAD)
    turned = (_differences(yaw, starts) + turn // 2) % turn - turn // 2
    parts = [
        np.array([MAGIC, len(first), len(step)], dtype="<u4"),
        columns["agent"][first].astype("<u4"),
        *(values[first].astype("<i4") for values in (x, y)),
        step[first].astype("<u2"),
        lengths.astype("<u2"),
        np.clip(yaw[first], -32767, 32767).astype("<i2"),
        *(_differences(values, starts).astype("<i2") for values in (x, y)),
        np.where(starts, 0, turned).astype("<i2"),
    ]
    return b"".join(part.tobytes() for part in parts)


def _starts(step: Int64Array, columns: dict[str, Float64Array], step_s: float) -> BoolArray:
    """(n,) whether a pose begins a run: another agent, a gap, or a step over which the trace does not move it.

    The trace holds the velocity towards the next pose where it moves an agent there, and that of its heading elsewhere.
    """
    if not len(step):
        return np.zeros(0, dtype=np.bool_)
    led = [
        columns[place][:-1] + columns[speed][:-1] * step_s - columns[place][1:]
        for place, speed in (("x_m", "east_mps"), ("y_m", "north_mps"))
    ]
    moved = np.hypot(np.diff(columns["x_m"]), np.diff(columns["y_m"]))
    linked = (
        (np.diff(columns["agent"]) == 0)
        & (np.diff(step) == 1)
        & (np.hypot(*led) < _STRAIGHT_M)
        & (moved <= 2 * TELEPORT_MPS * step_s)
    )
    return np.concatenate([[True], ~linked])


def _differences(values: Int64Array, starts: BoolArray) -> Int64Array:
    """(n,) from the value before; 0 where a run begins."""
    return np.where(starts, 0, np.diff(values, prepend=values[:1]))


FLIGHT: Final = "flight.json.gz"

GROUPS: Final = tuple(AGENT_COLOURS)


def minute_file(number: int) -> str:
    """The name of a minute of agents."""
    return f"agents-{number:04d}.bin.gz"


def write_playback(results: Sequence[MissionResult], folder: Path, *, step_s: float) -> None:
    """Write what the browser plays of missions over the same traffic.

    Args:
        folder: exists.
        step_s: of the traffic's trace.
    """
    longest = max(results, key=lambda result: result.duration_s)
    flight = {
        **write_agents(longest.trace, folder, step_s=step_s, until_s=longest.duration_s),
        "missions": [mission_values(result) for result in results],
        "tables": tables(results),
        "sentence": sentence(results),
        "remarks": remarks(results),
    }
    write_flight(flight, folder)


def write_agents(trace: Trace, folder: Path, *, step_s: float, until_s: float) -> dict[str, Any]:
    """Write the agents of each minute. Returns their entry in `FLIGHT`."""
    written = 0
    for number, content in enumerate(minutes(trace, step_s, until_s)):
        (folder / minute_file(number)).write_bytes(gzip.compress(content, 6, mtime=0))
        written = number + 1
    return {"step_s": step_s, "minutes": written, "agents": bodies(trace, step_s, until_s)}


def write_flight(values: Mapping[str, Any], folder: Path, *, level: int = 6) -> None:
    """Write what the browser plays of missions, agents aside.

    Args:
        level: of the compression.
    """
    text = json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    (folder / FLIGHT).write_bytes(gzip.compress(text.encode(), level, mtime=0))


def tables(results: Sequence[MissionResult]) -> list[dict[str, Any]]:
    """The tables of the command line, by column."""
    first = comparison_columns(results) if len(results) > 1 else segment_columns(results[0])
    shown: list[tuple[str, tuple[TableColumn, ...]]] = [("policies" if len(results) > 1 else "segments", first)]
    if has_street_table(results):
        shown.append(("streets", street_columns(results)))
    return [
        {"of": of, "columns": [asdict(column) | {"best": sorted(column.best)} for column in columns]}
        for of, columns in shown
    ]


def mission_values(result: MissionResult) -> dict[str, Any]:
    """A mission over time, and what came out of it."""
    timeline, settings, environment = Timeline(result), result.settings, result.environment
    track, captures = timeline.track, timeline.captures
    return {
        **still_values(environment, settings, result.policy, result.sensor),
        "duration_s": round(result.duration_s, 3),
        "targets": list(result.spec.targets),
        "totals": asdict(totals(result)),
        "track": {
            **{name: rounded(track[name], 3) for name in ("t_s", "x_m", "y_m", "altitude_m", "speed_mps")},
            "yaw_rad": rounded(timeline.yaw_rad, 4),
            "battery": rounded(track["battery"], 5),
            "visibility": rounded(track["visibility"], 4),
            "mode": timeline.activity.tolist(),
            "segment": track["segment"].tolist(),
        },
        "captures": {
            **{name: rounded(captures[name], 3) for name in ("t_s", "x_m", "y_m", "visibility")},
            "yaw_rad": rounded(captures["yaw_rad"], 4),
            "segment": captures["segment"].tolist(),
        },
        "events": [
            {"t_s": round(event.time_s, 3), **values}
            for event in timeline.events()
            if (values := _event_values(event, environment.world))
        ],
        "defects": _defects(result),
    }


def still_values(
    environment: MissionEnvironment, settings: MissionSettings, policy: str, sensor: str
) -> dict[str, Any]:
    """Constant data of a mission."""
    return {
        "policy": policy,
        "sensor": sensor,
        "altitude_m": settings.altitude_m,
        "threshold": settings.visibility.threshold,
        "window_m": [round(each, 3) for each in window_m(settings)],
        "footprint_m": [round(each, 3) for each in camera_of(settings).footprint_m(settings.altitude_m)],
        "modes": [{"name": mode.value, "words": DOING[mode]} for mode in MODES],
        **standing_values(environment),
    }


def standing_values(environment: MissionEnvironment) -> dict[str, Any]:
    """Parked vehicles, and the ids of the segments by their index."""
    parked = parked_columns(environment.parked)
    return {
        "parked": {
            **{name: rounded(parked[name], 3) for name in ("x_m", "y_m", "yaw_rad", "length_m", "width_m")},
            "height_m": rounded(parked["height_m"], 2),
        },
        "segments": [segment.id for segment in environment.world.segments],
    }


def _event_values(event: MissionEvent, world: World) -> Mapping[str, Any]:
    """An event in plain values; empty for those that the page does not show."""
    match event:
        case OcclusionStarted(segment=segment, visibility=visibility):
            return {
                "kind": "occlusion",
                "segment": world.segments[segment].id,
                "visibility": round(visibility, 4),
            }
        case ActionTaken(position=position, action=action):
            seconds = action.seconds if isinstance(action, Wait) else 0.0
            if isinstance(action, Displace | Revisit):
                seconds = action.stay_s
            return {"kind": type(action).__name__.lower(), "place_m": _place(position), "seconds": round(seconds, 2)}
        case DefectsConfirmed(defects=defects, on_revisit=on_revisit):
            return {"kind": "found", "defects": list(defects), "on_revisit": on_revisit}
        case NoteVisited(note=note):
            return {"kind": "return", "place_m": _place(note.place)}
        case BatteryRanLow(position=position):
            return {"kind": "battery", "place_m": _place(position)}
        case BatterySwapped():
            return {"kind": "swap"}
        case SegmentStarted(segment=segment):
            return {"kind": "start", "segment": world.segments[segment].id}
        case SegmentFinished(segment=segment):
            return {"kind": "finish", "segment": world.segments[segment].id}
    return {}


def _defects(result: MissionResult) -> list[dict[str, Any]]:
    """Every defect of the inspected segments, and those found elsewhere in passing."""
    judged = {outcome.defect.id: outcome for outcome in result.inspected_defects}
    confirmed = result.memory.confirmed
    shown = []
    for number, outcome in outcomes(result).items():
        defect, inspected = result.environment.defects[number], judged.get(number)
        shown.append(
            {
                **defect_values(defect),
                "outcome": outcome.value,
                "found_s": round(confirmed[number].time_s, 3) if number in confirmed else None,
                **({} if inspected is None else _why(inspected)),
            }
        )
    return shown


def defect_values(defect: Defect) -> dict[str, Any]:
    """A defect, whatever became of it."""
    return {
        "id": defect.id,
        "segment": defect.segment,
        "class": defect.kind,
        "severity": defect.severity.value,
        "length_m": round(defect.length_m, 3),
        "width_m": round(defect.width_m, 4),
        "area_m2": round(defect.area_m2, 4),
        "place_m": _place((defect.centre.x, defect.centre.y)),
    }


def found_values(defect: Defect, found_s: float) -> dict[str, Any]:
    """A defect that was found while somebody steers."""
    return {**defect_values(defect), "outcome": DefectOutcome.CONFIRMED.value, "found_s": round(found_s, 3)}


def _why(inspected: InspectedDefect) -> dict[str, Any]:
    """Why a defect was found or missed."""
    hidden = inspected.hidden_by or {}
    return {
        "reason": None if inspected.reason is None else inspected.reason.words,
        "captures": inspected.captures,
        "time_s": _number(inspected.time_s, 3),
        "visible": _number(inspected.visible_fraction, 3),
        "hidden_by": {reason.words: round(share, 3) for reason, share in hidden.items() if share > 0},
        "responses": [response.value for response in inspected.responses],
    }


AgentSizes = dict[int, tuple[float, float, float, bool]]
"""Length, width and height in metres, and whether it is a pedestrian, by the agent's number."""


def bodies(
    trace: Trace, step_s: float, until_s: float, *, from_s: float = 0.0, known: AgentSizes | None = None
) -> dict[str, Any]:
    """The size of each agent that is there at some step, and its group; by its number, 0 for those that are not.

    Args:
        known: of agents that were there before, to which those that come are added.
    """
    sizes = {} if known is None else known
    for time_s in np.arange(from_s, min(until_s, trace.duration_s) + step_s / 2, step_s):
        poses = trace.agents_at(min(float(time_s), trace.duration_s))
        unknown = [row for row, agent in enumerate(poses["agent"].tolist()) if agent not in sizes]
        for row in unknown:
            size = (float(poses[name][row]) for name in ("length_m", "width_m", "height_m"))
            length_m, width_m, height_m = size
            sizes[int(poses["agent"][row])] = (length_m, width_m, height_m, bool(poses["is_pedestrian"][row]))
    count = max(sizes, default=-1) + 1
    rows = [sizes.get(agent) for agent in range(count)]
    groups = [0 if row is None else GROUPS.index(agent_group(row[0], row[2], row[3])) for row in rows]
    names = ("length_m", "width_m", "height_m")
    columns = {name: [0 if row is None else round(float(row[at]), 2) for row in rows] for at, name in enumerate(names)}
    return {"groups": list(GROUPS), "group": groups, **columns}


def _place(place: Sequence[float]) -> list[float]:
    return [round(float(place[0]), 3), round(float(place[1]), 3)]


def _number(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def rounded(values: Any, digits: int) -> list[float | None]:
    """A column; None where a value is not defined."""
    rounded = np.round(np.asarray(values, dtype=np.float64), digits)
    listed: list[float | None] = rounded.tolist()
    return listed if np.isfinite(rounded).all() else [None if each != each else each for each in listed]
