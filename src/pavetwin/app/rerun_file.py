"""A mission as a recording for the viewer rerun (`.rrd`), where the package rerun-sdk is installed.

It is no dependency: its wheel has 170 MB and its viewer asks other hosts. It is imported when a recording is written.
What is recorded is read from `Timeline` alone. World frame: metres, east, north, up.
"""

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.draw.marks import outcomes
from pavetwin.draw.mission_style import AGENT_COLOURS, agent_group
from pavetwin.draw.style import OUTCOME_COLOURS
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.result import MissionResult
from pavetwin.mission.timeline import Timeline

PACKAGE: Final = "rerun-sdk"

EVERY_S: Final = 0.5
"""Between two moments that are recorded."""

CLOCK: Final = "mission"
"""The timeline of rerun on which everything lies: seconds since take-off."""


def is_installed() -> bool:
    """Whether recordings can be written here."""
    return find_spec("rerun") is not None


def check_installed() -> None:
    """Raises:
    PaveTwinError: rerun is not installed.
    """
    if not is_installed():
        raise PaveTwinError(f"Recordings for rerun (.rrd) need its package: `pip install {PACKAGE}`.")


def write_rerun(results: Sequence[MissionResult], path: Path) -> None:
    """Write missions over the same traffic as one recording: the streets, the traffic, and of each policy the UAV, its
    track, visibility, battery, and the defects by what became of them.

    Raises:
        PaveTwinError: rerun is not installed, or the file cannot be written.
    """
    check_installed()
    rerun = import_module("rerun")
    recording = rerun.RecordingStream("pavetwin")
    with writing(path) as temporary:
        recording.save(str(temporary))
        _write_town(rerun, recording, results[0].environment)
        longest = max(results, key=lambda result: result.duration_s)
        _write_traffic(rerun, recording, longest)
        for result in results:
            _write_mission(rerun, recording, result)
        recording.flush()
        del recording  # closes the file


def _write_town(rerun: Any, recording: Any, environment: MissionEnvironment) -> None:
    world = environment.world
    lines = [_level(part.exterior.coords) for part in _polygons(world.carriageway)]
    recording.log("town/carriageway", rerun.LineStrips3D(lines), static=True)
    roofs = [
        _level(part.exterior.coords, building.height_m)
        for building in world.buildings
        for part in _polygons(building.polygon)
    ]
    recording.log("town/roofs", rerun.LineStrips3D(roofs), static=True)
    parked = environment.parked_agents
    recording.log(
        "town/parked",
        _boxes(
            rerun,
            np.array([[*agent.position, agent.yaw_rad] for agent in parked]).reshape(-1, 3),
            np.array([[agent.length_m, agent.width_m, agent.height_m] for agent in parked]).reshape(-1, 3),
            [AGENT_COLOURS["parked"]] * len(parked),
        ),
        static=True,
    )


def _write_traffic(rerun: Any, recording: Any, result: MissionResult) -> None:
    trace = result.trace
    for time_s in np.arange(0.0, min(result.duration_s, trace.duration_s), EVERY_S).tolist():
        poses = trace.agents_at(time_s)
        sizes = np.column_stack([poses["length_m"], poses["width_m"], poses["height_m"]]).astype(np.float64)
        groups = [
            agent_group(length, height, bool(walks))
            for (length, _, height), walks in zip(sizes.tolist(), poses["is_pedestrian"].tolist(), strict=True)
        ]
        places = np.column_stack([poses["x_m"], poses["y_m"], poses["yaw_rad"]])
        recording.set_time(CLOCK, duration=time_s)
        recording.log("traffic", _boxes(rerun, places, sizes, [AGENT_COLOURS[group] for group in groups]))


def _write_mission(rerun: Any, recording: Any, result: MissionResult) -> None:
    timeline, name = Timeline(result), result.policy
    track = timeline.track
    line = np.column_stack([track["x_m"], track["y_m"], track["altitude_m"]])
    recording.log(f"{name}/track", rerun.LineStrips3D([line]), static=True)
    for time_s in np.arange(0.0, timeline.duration_s, EVERY_S).tolist():
        state = timeline.at(time_s)
        recording.set_time(CLOCK, duration=time_s)
        recording.log(f"{name}/uav", rerun.Points3D([[*state.uav.position, state.uav.altitude_m]], radii=[0.4]))
        recording.log(f"{name}/battery", rerun.Scalars(state.uav.battery))
        recording.log(f"{name}/found", rerun.Scalars(float(len(state.found))))
        if state.visibility is not None:
            recording.log(f"{name}/visibility", rerun.Scalars(state.visibility))
    judged = outcomes(result)
    defects = [result.environment.defects[number] for number in judged]
    recording.log(
        f"{name}/defects",
        rerun.Points3D(
            [[defect.centre.x, defect.centre.y, 0.0] for defect in defects],
            colors=[OUTCOME_COLOURS[outcome.value] for outcome in judged.values()],
            labels=[f"{defect.kind} {defect.id}: {judged[defect.id].value}" for defect in defects],
            show_labels=False,
            radii=0.3,
        ),
        static=True,
    )


def _boxes(rerun: Any, places: Float64Array, sizes: Float64Array, colours: list[str]) -> Any:
    """Bodies that stand on the ground.

    Args:
        places: (n, 3) east, north, yaw.
        sizes: (n, 3) length, width, height.
    """
    zero = np.zeros(len(places))
    centres = np.column_stack([places[:, 0], places[:, 1], sizes[:, 2] / 2])
    turns = np.column_stack([zero, zero, np.sin(places[:, 2] / 2), np.cos(places[:, 2] / 2)])
    return rerun.Boxes3D(centers=centres, half_sizes=sizes / 2, quaternions=turns, colors=colours)


def _polygons(shape: Any) -> list[Any]:
    return [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]


def _level(points: Any, height_m: float = 0.0) -> Float64Array:
    flat = np.asarray(points, dtype=np.float64)[:, :2]
    return np.column_stack([flat, np.full(len(flat), height_m)])
