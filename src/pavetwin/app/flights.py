"""Missions of the page in a task process: flown, flown again, listed, and written as what the browser plays."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from pavetwin.app.flight_request import PRESET, FlightRequest
from pavetwin.app.session_cache import alone_in, kept_environment, kept_world, made_once
from pavetwin.app.task_process import TaskReport
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing_folder
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.fly import fly
from pavetwin.mission.folder import MissionFolder, check_replaceable
from pavetwin.mission.inputs import MissionInputs, OnProgress, load_inputs
from pavetwin.mission.planning import mission_folder, plan_missions
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import MISSION, check_mission_folder, save_mission, save_missions
from pavetwin.mission.spec import MissionSpec
from pavetwin.world.model import World

LISTED: Final = 40
"""Missions of a world that the page lists, the latest first."""


def listed_missions(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:  # noqa: ARG001 - as every task
    """The missions of a world, the latest first."""
    return {"missions": [path.name for path in _mission_folders(Path(task["world"]))[:LISTED]]}


def _mission_folders(world: Path) -> list[Path]:
    place = world / "missions"
    found = [path for path in place.iterdir() if _is_shown(path) and descriptions(path)] if place.is_dir() else []
    return sorted(found, key=_changed_ns, reverse=True)


def _is_shown(path: Path) -> bool:
    """Whether a folder is whole: unfinished ones have a hidden name."""
    return not path.name.startswith(".")


def _changed_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:  # it is being replaced at this moment
        return time.time_ns()


def descriptions(folder: Path) -> list[Path]:
    """The descriptions of a mission, or of missions under several policies."""
    own = folder / MISSION
    return [own] if own.is_file() else sorted(folder.glob(f"*/{MISSION}"))


def planned(
    request: FlightRequest, world: World, policies: Sequence[str]
) -> tuple[list[MissionSpec], MissionEnvironment]:
    """The missions of a request, one for each policy, in the environment that is kept for the next task."""
    return plan_missions(
        world,
        request.settings(),
        policies,
        density=request.density,
        mix=request.mix or "",
        segments=request.segments or request.count,
        order=request.order,
        seed=request.seed,
        environment=kept_environment(request, world),
    )


def fly_request(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """Fly the missions of a request, write them where the command line does, and what plays them."""
    request, world = FlightRequest.of(task["request"]), kept_world(Path(task["world"]))
    report(0.0, "Preparing the flight domain")
    names = request.names
    specs, environment = planned(request, world, names)
    inputs = load_inputs(specs[0], world=world, environment=environment, on_progress=report)
    specs = [inputs.flown(spec) for spec in specs]
    folder = mission_folder(specs[0], names, PRESET, usual_targets=request.is_usual)
    return _flown_into(folder, specs, inputs, Path(task["folder"]), report)


def fly_missed(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """Fly a mission again over the segments on which it missed a defect, as `fly --again … --only-missed` does."""
    world = kept_world(Path(task["world"]))
    former = MissionFolder(task["mission"])
    spec = former.planned(world, targets=former.missed_segments())
    inputs = load_inputs(spec, world=world, on_progress=report)
    return _flown_into(former.folder_of_missed, [inputs.flown(spec)], inputs, Path(task["folder"]), report)


def _flown_into(
    folder: Path, specs: list[MissionSpec], inputs: MissionInputs, session: Path, report: TaskReport
) -> Mapping[str, Any]:
    """Fly missions, and write them once all are flown. From `ready` on they are whole except for the images."""
    with alone_in(folder, session, report):
        check_mission_folder(folder)
        check_replaceable(folder, specs)
        with inputs.replay:
            results = [_one(spec, inputs, report) for spec in specs]
            played = {**_written(results, inputs, session, report), "results": str(folder)}
        _save(results, folder)
        report.ready({**played, "names": _file_names(folder, results)})
        _draw(results, folder, report)
        return {**played, "names": _file_names(folder, results)}


def _save(results: list[MissionResult], folder: Path) -> None:
    if len(results) == 1:
        save_mission(results[0], folder)
        return
    with writing_folder(folder, replace=True) as temporary:
        save_missions(results, temporary)


def play_mission(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """Fly a mission of the world again, to play it; nothing of it is written again."""
    world, session = kept_world(Path(task["world"])), Path(task["folder"])
    folders = {folder.name: folder for folder in _mission_folders(Path(task["world"]))}
    folder = folders.get(str(task["mission"]))
    if folder is None:
        raise PaveTwinError(f"`mission`: '{str(task['mission'])[:80]}' is not a mission of '{world.name}'.")
    with alone_in(folder, session, report):
        results, inputs = again(descriptions(folder), world, report)
        played = _written(results, inputs, session, report)
        return {**played, "results": str(folder), "names": _file_names(folder, results)}


def again(files: Sequence[Path], world: World, report: OnProgress) -> tuple[list[MissionResult], MissionInputs]:
    """Missions over the same traffic, flown again from their descriptions; nothing is written.

    Raises:
        PaveTwinError: one cannot be read, or its inputs have changed.
    """
    specs = [MissionFolder(file).planned(world) for file in files]
    inputs = load_inputs(specs[0], world=world, on_progress=report)
    with inputs.replay:
        return [_one(spec, inputs, report) for spec in specs], inputs


def _one(spec: MissionSpec, inputs: MissionInputs, report: OnProgress) -> MissionResult:
    from pavetwin.capture.mission_images import MissionImages

    def reporting(what: str) -> Callable[[float], None]:
        return lambda share: report(share, what)

    inputs.on_extend(reporting("Recording more traffic"))
    environment = inputs.environment
    images = MissionImages(environment.inspected_world, inputs.replay, spec.seed, environment.parked)
    return fly(
        spec,
        inputs=inputs,
        image_source=images,
        on_progress=reporting(f"Flying {spec.policy.name}"),
        on_look=reporting("Rendering the captures and searching them"),
    )


def write_played(results: Sequence[MissionResult], inputs: MissionInputs, folder: Path) -> None:
    """Write what the browser plays of missions over the same traffic into a folder that exists."""
    from pavetwin.app.playback import write_playback

    write_playback(results, folder, step_s=inputs.replay.recording.step_s)


def _written(results: list[MissionResult], inputs: MissionInputs, session: Path, report: TaskReport) -> dict[str, Any]:
    """Write the played data of missions into a folder named by their hash."""
    from pavetwin.app.frame_source import write_frame_source

    report(1.0, "Preparing to play")
    specs = json.dumps([result.spec.as_values() for result in results], sort_keys=True)
    key = sha256(specs.encode()).hexdigest()[:20]
    target = session / key
    if not target.is_dir():
        with made_once(target) as made:
            write_played(results, inputs, made)
            write_frame_source(results, made)
    captures, policies = [len(result.captures["t_s"]) for result in results], [result.policy for result in results]
    return {"key": key, "captures": captures, "policies": policies}


def _draw(results: list[MissionResult], folder: Path, report: TaskReport) -> None:
    """The maps that the command line draws."""
    from pavetwin.draw.mission_map import save_comparison_map, save_mission_map

    for result in results:
        report(1.0, f"Drawing the map: {result.policy}")
        save_mission_map(result, (folder / result.policy if len(results) > 1 else folder) / "map.png")
    if len(results) > 1:
        save_comparison_map(results, folder / "comparison.png")


def _file_names(folder: Path, results: list[MissionResult]) -> list[str]:
    """The files of a result, by their paths within its folder."""
    inner = [Path(result.policy) for result in results] if len(results) > 1 else []
    return [
        str(place / path.name)
        for place in (Path(), *inner)
        for path in sorted((folder / place).iterdir())
        if _is_shown(path) and path.is_file()
    ]
