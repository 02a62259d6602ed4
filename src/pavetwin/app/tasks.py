"""Tasks of the page: read a world for its map, estimate, fly, play missions, build.

Each takes plain values and returns plain values; large results are files in the session's folder. What takes long once
is kept for the next task: the world, and the environment at the altitude requested last.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pavetwin.app.flight_request import PRESET, FlightRequest
from pavetwin.app.flights import fly_missed, fly_request, listed_missions, planned, play_mission
from pavetwin.app.requests import KINDS, LARGEST_BYTES, LARGEST_KM2, FramePart
from pavetwin.app.session_cache import kept_environment, kept_world
from pavetwin.app.task_process import TaskReport
from pavetwin.config import load_settings
from pavetwin.config.mission import CEILING_M, LOWEST_M
from pavetwin.files import writing
from pavetwin.mission.estimate import estimate
from pavetwin.mission.inputs import MissionInputs, load_inputs
from pavetwin.mission.planning import ORDERS, check_reach, choose_targets
from pavetwin.mission.spec import MissionSpec
from pavetwin.policies import policy_names
from pavetwin.sensing.sensor import sensor_names
from pavetwin.traffic.demand import DEFAULT_MIX, DEFAULT_TRAFFIC, DENSITIES, mix_names
from pavetwin.uav import AIRCRAFT
from pavetwin.world.parking.rule import NO_RULE, rule_names


def run(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """Run a task by name.

    Raises:
        PaveTwinError: the task failed; the message is for the requester.
    """
    tasks: dict[str, Callable[[Mapping[str, Any], TaskReport], Mapping[str, Any]]] = {
        "choices": _choices,
        "map": _map,
        "missions": listed_missions,
        "estimate": _estimate,
        "fly": fly_request,
        "fly_missed": fly_missed,
        "play": play_mission,
        "build": _build,
        "show": _show,
        "export": _export,
        "choose": _choose,
        "pilot": _pilot,
        "drive": _drive,
        "town": _town,
        "frame": _frame,
    }
    return tasks[task["do"]](task, report)


def _choices(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:  # noqa: ARG001 - as every task
    """The names that a request may give, and what is flown where it gives none."""
    from pavetwin.app.exports import exports

    usual = load_settings(PRESET)
    return {
        "exports": exports(),
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
            "clouds": usual.conditions.clouds,
            "wind_mps": usual.conditions.wind_mps,
            "wind_from_deg": usual.conditions.wind_from_deg,
            "date": usual.conditions.date.isoformat(),
            "time": usual.conditions.time.isoformat("minutes"),
        },
        "altitudes_m": [LOWEST_M, CEILING_M],
        "parking_rules": [*rule_names(), NO_RULE],
        "maps": {"kinds": KINDS, "largest_bytes": LARGEST_BYTES, "largest_km2": LARGEST_KM2},
        "threshold": usual.visibility.threshold,
    }


def _map(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """The map of a world, as a file."""
    from pavetwin.app.street_map import packed_map

    report(0.0, "Reading the town")
    content = packed_map(kept_world(Path(task["world"])))
    with writing(Path(task["file"])) as temporary:
        temporary.write_bytes(content)
    return {}


def _export(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """Make an export of a mission."""
    from pavetwin.app.exports import make_export

    return make_export(task, report)


def _choose(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:  # noqa: ARG001 - as every task
    """The choices that a mission.yaml makes."""
    from pavetwin.app.described import choices_of

    return choices_of(task)


def _pilot(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """A flight by hand, with the traffic, sensor and settings of a request."""
    from pavetwin.app.steering import fly_by_hand

    spec, inputs = _steered(task, report)
    with inputs.replay:
        return fly_by_hand(inputs.flown(spec), inputs, Path(task["folder"]), report)


def _drive(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """A drive by hand, with the same."""
    from pavetwin.app.steering import drive_by_hand

    spec, inputs = _steered(task, report)
    with inputs.replay:
        return drive_by_hand(inputs.flown(spec), inputs, Path(task["folder"]), report)


def _steered(task: Mapping[str, Any], report: TaskReport) -> tuple[MissionSpec, MissionInputs]:
    request, world = FlightRequest.of(task["request"]), kept_world(Path(task["world"]))
    report(0.0, "Preparing the flight domain")
    (spec,), environment = planned(request, world, request.names[:1])
    return spec, load_inputs(spec, world=world, environment=environment, on_progress=report)


def _show(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """The report of a study, or the contact sheet of a dataset."""
    from pavetwin.app.exhibits import ExhibitKind, show_exhibit

    return show_exhibit(Path(task["exhibit"]), ExhibitKind(task["kind"]), Path(task["folder"]), report)


def _build(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """A town from a map that a browser sent."""
    from pavetwin.app.town_build import build_town

    build_town(Path(task["source"]), Path(task["folder"]), task["options"], report)
    return {}


def _town(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:  # noqa: ARG001 - as every task
    """A file of the town in 3-D."""
    from pavetwin.app.town_file import town_file

    return town_file(kept_world(Path(task["world"])), task["name"], Path(task["folder"]))


def _estimate(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """Estimated cost and coverage of a requested mission, with its segments."""
    request, world = FlightRequest.of(task["request"]), kept_world(Path(task["world"]))
    settings = request.settings()
    report(0.0, "Preparing the flight domain")
    environment = kept_environment(request, world)
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


def _frame(task: Mapping[str, Any], report: TaskReport) -> Mapping[str, Any]:
    """The rendered frame of a capture; empty when a message arrives meanwhile, which requests another one."""
    from pavetwin.app.frame_source import GivenUpError, shown_frame

    part = FramePart(task["part"])
    try:
        return shown_frame(Path(task["folder"]), task["mission"], task["capture"], part, lambda: not report.messages())
    except GivenUpError:
        return {}
