"""What a task process does for the page: read a world for its map, estimate, fly, play what was flown, build.

Each takes plain values and returns plain values; large results are files in the session's folder. What takes long once
is kept for the next task: the world, and the environment at the altitude that was asked for last.
"""

import gzip
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, Protocol

from pavetwin.app.flight_request import PRESET, FlightRequest
from pavetwin.app.map_limits import LARGEST_KM2
from pavetwin.app.requests import KINDS, LARGEST_BYTES
from pavetwin.config import load_settings
from pavetwin.config.altitude import CEILING_M, LOWEST_M
from pavetwin.config.mission import UavSettings
from pavetwin.defects.registry import kinds
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.mission.again import MISSION, check_replaceable, read_mission
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.estimate import estimate
from pavetwin.mission.fly import MissionResult, fly
from pavetwin.mission.inputs import MissionInputs, defects_of, load_inputs
from pavetwin.mission.naming import mission_folder
from pavetwin.mission.plan import defect_input, plan_missions, traffic_input
from pavetwin.mission.reach import check_reach
from pavetwin.mission.results import check_mission_folder, save_mission, save_missions
from pavetwin.mission.spec import MissionSpec
from pavetwin.mission.targets import ORDERS, choose_targets
from pavetwin.policies import policy_names
from pavetwin.sensing.registered import sensor_names
from pavetwin.traffic.demand import DEFAULT_TRAFFIC, DENSITIES
from pavetwin.traffic.mix import DEFAULT_MIX, mix_names
from pavetwin.uav import AIRCRAFT
from pavetwin.world.folder import DESCRIPTION
from pavetwin.world.model import World
from pavetwin.world.parking.rule import NO_RULE, rule_names
from pavetwin.world.store import load_world


class TaskReport(Protocol):
    """Who is told how far a task is."""

    def __call__(self, share: float, what: str, /) -> None:
        """The share done, 0 … 1, and what is being done."""

    def ready(self, values: Mapping[str, Any], /) -> None:
        """What can be used already, while the task goes on."""

    def live(self, values: Mapping[str, Any], /) -> None:
        """What is now, in a task that goes on with the clock."""

    def said(self) -> list[Mapping[str, Any]]:
        """What was said to the task since, in its order."""
        ...


LISTED: Final = 40
"""Missions of a world that the page lists, the latest first."""


def run(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """Do a task by its name.

    Raises:
        PaveTwinError: it cannot be done, in words for who asked for it.
    """
    tasks: dict[str, Callable[[Mapping[str, Any], TaskReport], Mapping[str, Any]]] = {
        "choices": _choices,
        "map": _map,
        "missions": _missions,
        "estimate": _estimate,
        "fly": _fly,
        "play": _play,
        "build": _build,
        "show": _show,
        "pilot": _pilot,
        "town": _town,
        "frame": _frame,
    }
    return tasks[task["do"]](task, tell)


def _choices(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:  # noqa: ARG001 - as every task
    """The names that a request may give, and what is flown where it gives none."""
    usual = load_settings(PRESET)
    return {
        "policies": policy_names(),
        "sensors": sensor_names(),
        "aircraft": AIRCRAFT.names(),
        "mixes": mix_names(),
        "densities": list(DENSITIES),
        "orders": list(ORDERS),
        "usual": {
            **FlightRequest().model_dump(mode="json"),
            "traffic": DEFAULT_TRAFFIC,
            "mix": DEFAULT_MIX,
            "sensor": usual.sensing.sensor,
            "aircraft": usual.aircraft,
            "date": usual.conditions.date.isoformat(),
            "time": usual.conditions.time.isoformat("minutes"),
        },
        "altitudes_m": [LOWEST_M, CEILING_M],
        "parking_rules": [*rule_names(), NO_RULE],
        "maps": {"kinds": KINDS, "largest_bytes": LARGEST_BYTES, "largest_km2": LARGEST_KM2},
        "threshold": usual.visibility.threshold,
    }


def _missions(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:  # noqa: ARG001 - as every task
    """The missions of a world, the latest first."""
    return {"missions": [path.name for path in _mission_folders(Path(task["world"]))[:LISTED]]}


def _mission_folders(world: Path) -> list[Path]:
    place = world / "missions"
    found = [path for path in place.iterdir() if _files_of(path)] if place.is_dir() else []
    return sorted(found, key=lambda path: path.stat().st_mtime_ns, reverse=True)


def _files_of(folder: Path) -> list[Path]:
    """The descriptions of a mission, or of missions under several policies."""
    own = folder / MISSION
    return [own] if own.is_file() else sorted(folder.glob(f"*/{MISSION}"))


def _map(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """The map of a world, as a file."""
    from pavetwin.app.street_map import colours, street_map

    tell(0.0, "Reading the town")
    world = _world(Path(task["world"]))
    values = street_map(world, UavSettings().radius_m) | {"colours": colours(kind.name for kind in kinds())}
    content = json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    with writing(Path(task["file"])) as temporary:
        temporary.write_bytes(gzip.compress(content, 6, mtime=0))
    return {}


def _pilot(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """A flight by hand, with the traffic, sensor and settings of a request."""
    from pavetwin.app.piloting import fly_by_hand

    request, world = FlightRequest.of(task["request"]), _world(Path(task["world"]))
    tell(0.0, "Preparing the flight domain")
    (spec,), environment = plan_missions(
        world,
        request.settings(),
        request.names[:1],
        density=request.density,
        mix=request.mix or "",
        segments=request.segments or request.count,
        order=request.order,
        seed=request.seed,
        environment=_environment(request, world),
    )
    inputs = load_inputs(spec, world=world, environment=environment, on_progress=tell)
    with inputs.replay:
        return fly_by_hand(inputs.flown(spec), inputs, Path(task["folder"]), tell)


def _show(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """The report of a study, or the contact sheet of a dataset."""
    from pavetwin.app.exhibits import ExhibitKind, show_exhibit

    return show_exhibit(Path(task["exhibit"]), ExhibitKind(task["kind"]), Path(task["folder"]), tell)


def _build(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """A town from a map that a browser sent."""
    from pavetwin.app.town_build import build_town

    build_town(Path(task["source"]), Path(task["folder"]), task["options"], tell)
    return {}


def _town(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:  # noqa: ARG001 - as every task
    """A file of the town in 3-D."""
    from pavetwin.app.town_file import town_file

    return town_file(_world(Path(task["world"])), task["name"], Path(task["folder"]))


def _estimate(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """What the mission of a request takes and shows at best, and the segments that it inspects."""
    request, world = FlightRequest.of(task["request"]), _world(Path(task["world"]))
    settings = request.settings()
    tell(0.0, "Preparing the flight domain")
    environment = _environment(request, world)
    targets = choose_targets(
        environment,
        count=None if request.segments else request.count,
        names=request.segments,
        order=request.order,
        seed=request.seed,
    )
    check_reach(environment, settings, targets)
    known = asdict(estimate(environment, settings, targets))
    return {**known, "targets": [world.segments[index].id for index in targets]}


def _fly(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """Fly the missions of a request, write them where the command line does, and what plays them."""
    request, world = FlightRequest.of(task["request"]), _world(Path(task["world"]))
    tell(0.0, "Preparing the flight domain")
    names = request.names
    specs, environment = plan_missions(
        world,
        request.settings(),
        names,
        density=request.density,
        mix=request.mix or "",
        segments=request.segments or request.count,
        order=request.order,
        seed=request.seed,
        environment=_environment(request, world),
    )
    inputs = load_inputs(specs[0], world=world, environment=environment, on_progress=tell)
    specs = [inputs.flown(spec) for spec in specs]
    folder = mission_folder(specs[0], names, PRESET, usual_targets=request.is_usual)
    check_mission_folder(folder)
    check_replaceable(folder, specs)
    with inputs.replay:
        results = list(_flown(specs, inputs, folder, tell))
        played = {**_written(results, inputs, Path(task["folder"]), tell), "results": str(folder)}
    tell.ready({**played, "names": _file_names(folder, results)})
    _draw(results, folder, tell)
    return {**played, "names": _file_names(folder, results)}


def _play(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:
    """Fly a mission of the world again, to play it; nothing of it is written again."""
    world = _world(Path(task["world"]))
    folders = {folder.name: folder for folder in _mission_folders(Path(task["world"]))}
    folder = folders.get(str(task["mission"]))
    if folder is None:
        raise PaveTwinError(f"`mission`: '{str(task['mission'])[:80]}' is no mission of '{world.name}'.")
    specs = [read_mission(file).planned(world) for file in _files_of(folder)]
    inputs = load_inputs(specs[0], world=world, on_progress=tell)
    with inputs.replay:
        results = [_one(spec, inputs, tell) for spec in specs]
        played = _written(results, inputs, Path(task["folder"]), tell)
    return {**played, "results": str(folder), "names": _file_names(folder, results)}


def _frame(task: Mapping[str, Any], tell: TaskReport) -> Mapping[str, Any]:  # noqa: ARG001 - as every task
    """The rendered frame of a capture."""
    from pavetwin.app.frame_source import shown_frame

    return shown_frame(Path(task["folder"]), task["mission"], task["capture"], search=task["search"])


def _flown(specs: list[MissionSpec], inputs: MissionInputs, folder: Path, tell: TaskReport) -> Iterator[MissionResult]:
    """Fly, and write each mission as soon as it is flown."""
    flown: list[MissionResult] = []

    def missions() -> Iterator[MissionResult]:
        for spec in specs:
            flown.append(_one(spec, inputs, tell))
            yield flown[-1]

    if len(specs) > 1:
        save_missions(missions(), folder)
    else:
        for result in missions():
            save_mission(result, folder)
    yield from flown


def _one(spec: MissionSpec, inputs: MissionInputs, tell: TaskReport) -> MissionResult:
    from pavetwin.capture.mission_images import MissionImages

    def said(what: str) -> Callable[[float], None]:
        return partial(_told, tell, what)

    inputs.on_extend(said("Recording more traffic"))
    environment = inputs.environment
    images = MissionImages(environment.inspected_world, inputs.replay, spec.seed, environment.parked)
    return fly(
        spec,
        inputs=inputs,
        image_source=images,
        on_progress=said(f"Flying {spec.policy.name}"),
        on_look=said("Rendering the captures and searching them"),
    )


def _told(tell: TaskReport, what: str, share: float) -> None:
    tell(share, what)


def _written(results: list[MissionResult], inputs: MissionInputs, session: Path, tell: TaskReport) -> dict[str, Any]:
    """What plays missions, in a folder that is named by what they are."""
    from pavetwin.app.frame_source import write_frame_source
    from pavetwin.app.playback import write_playback

    tell(1.0, "Preparing to play")
    specs = json.dumps([result.spec.as_values() for result in results], sort_keys=True)
    key = sha256(specs.encode()).hexdigest()[:20]
    target, made = session / key, session / f"{key}.part"
    if not target.is_dir():
        shutil.rmtree(made, ignore_errors=True)
        made.mkdir(parents=True)
        write_playback(results, made, step_s=inputs.replay.recording.step_s)
        write_frame_source(results, made)
        made.replace(target)
    return {"key": key, "captures": [len(result.captures["t_s"]) for result in results]}


def _draw(results: list[MissionResult], folder: Path, tell: TaskReport) -> None:
    """The maps that the command line draws."""
    from pavetwin.draw.mission_map import save_comparison_map, save_mission_map

    for result in results:
        tell(1.0, f"Drawing the map: {result.policy}")
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
        if path.is_file()
    ]


def _world(folder: Path) -> World:
    """The world of a folder; read again when it was built again."""
    try:
        changed_ns = (folder / DESCRIPTION).stat().st_mtime_ns
    except OSError as error:
        raise PaveTwinError(f"The world '{folder}' is not there any more.") from error
    return _loaded(folder, changed_ns)


@lru_cache(maxsize=1)
def _loaded(folder: Path, changed_ns: int) -> World:  # noqa: ARG001 - a part of the cache's key
    return load_world(folder)


_kept: dict[str, Any] = {}
"""The last environment, and what it was made for."""


def _environment(request: FlightRequest, world: World) -> MissionEnvironment:
    """The environment of a request's missions, as `plan_missions` makes it."""
    settings = request.settings()
    mix = traffic_input(world, request.density, (), None, request.seed, mix=request.mix or "").mix
    made_for = (world.folder, world.content_hash, settings.model_dump_json(), request.seed, mix)
    if _kept.get("for") != made_for:
        defects = defects_of(world, defect_input(world, None))
        _kept["is"] = prepare(world, settings, defects, parking_seed=request.seed, parking_mix=mix)
        _kept["for"] = made_for
    environment: MissionEnvironment = _kept["is"]
    return environment
