"""The choices that a `mission.yaml` makes, as the page's form has them. The text comes from a browser: nothing in it is
taken as a path, loaded, or opened; what the form has no field for is named and left out.
"""

from collections.abc import Mapping
from datetime import date
from math import hypot
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import TypeAdapter, ValidationError

from pavetwin.app.flight_request import FlightRequest
from pavetwin.app.session_cache import kept_world
from pavetwin.config.text import parse_yaml
from pavetwin.errors import PaveTwinError
from pavetwin.files import check_format
from pavetwin.navigation.take_off import with_roadside_base
from pavetwin.traffic.demand import DEFAULT_TRAFFIC, MIXED
from pavetwin.world.folder import read_description
from pavetwin.world.model import World

WHERE: Final = "the mission.yaml"

LARGEST: Final = 100_000
"""Characters."""

_DEEPEST: Final = 32
"""Lists and mappings within each other: a mission.yaml has a few, and reading many takes minutes."""

_LARGEST: Final = 10**18
"""Whole numbers only."""

_SAME_M: Final = 0.01


def choices_of(task: Mapping[str, Any]) -> dict[str, Any]:
    """Choices in a `mission.yaml`.

    Args:
        task: its `text`, and `worlds`, the folders that the page shows by their keys.

    Returns:
        `world`, the key of its town; `values` for the form; `segments`; and `left_out`, what the page does not take.

    Raises:
        PaveTwinError: it is none, its town is not shown here, or it names code of the user's own.
    """
    values = _parsed(task["text"])
    settings, traffic = _part(values, "settings"), _part(values, "traffic")
    key, folder = _world_of(_part(values, "world"), task["worlds"])
    world = kept_world(Path(folder))
    segments = _known_segments(values.get("targets"), world)
    density, _, mix = _text(traffic.get("density")).partition(MIXED)
    request = FlightRequest.of(
        _without_none(
            {
                "segments": segments,
                "altitude_m": settings.get("altitude_m"),
                "policies": [_plain_name(_part(values, "policy").get("name"), "policy")],
                "traffic": None if traffic.get("instead_of") == DEFAULT_TRAFFIC else density or None,
                "mix": mix or None,
                "sensor": _plain_name(_part(settings, "sensing").get("sensor"), "sensor"),
                "aircraft": _plain_name(settings.get("aircraft"), "aircraft"),
                "seed": values.get("seed"),
                **_conditions(_part(settings, "conditions")),
            }
        )
    )
    chosen = request.model_dump(mode="json", exclude={"segments", "count", "order", "policies"}, exclude_none=True)
    return {
        "world": key,
        "values": {**chosen, "policy": request.policies[0]},
        "segments": list(segments),
        "left_out": _left_out(values, request, world),
    }


def _parsed(text: Any) -> Mapping[str, Any]:
    if not isinstance(text, str) or len(text) > LARGEST:
        raise PaveTwinError(f"{WHERE} is a text of up to {LARGEST} characters.")
    try:
        _check_plain(text)
        values = parse_yaml(text, WHERE)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise PaveTwinError("This is not a mission.yaml: it cannot be read.") from error
    _check_numbers(values)
    if not isinstance(values, Mapping):
        raise PaveTwinError("This is not a mission.yaml.")
    check_format(values.get("format"), "This mission.yaml")
    return values


def _check_plain(text: str) -> None:
    """Refuse what a few characters can make endless, before anything is made of the text.

    Raises:
        PaveTwinError: it repeats a part by an anchor and aliases, or is nested too deeply.
        yaml.YAMLError: it is not valid YAML.
    """
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader):
        if isinstance(event, yaml.NodeEvent) and event.anchor is not None:
            raise PaveTwinError(f"This is not a mission.yaml: it repeats a part by its name, '{event.anchor[:40]}'.")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise PaveTwinError("This is not a mission.yaml: it is nested too deeply.")


def _check_numbers(values: Any) -> None:
    """Refuse whole numbers that are longer than Python writes.

    Raises:
        PaveTwinError: there is one.
    """
    waiting = [values]
    while waiting:
        value = waiting.pop()
        if isinstance(value, Mapping):
            waiting += [*value.keys(), *value.values()]
        elif isinstance(value, list | tuple | set):
            waiting += value
        elif isinstance(value, int) and abs(value) > _LARGEST:
            raise PaveTwinError(f"This is not a mission.yaml: a number in it is above {_LARGEST:.0e}.")


def _part(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    part = values.get(name)
    return part if isinstance(part, Mapping) else {}


def _plain_name(name: Any, what: str) -> Any:
    """Return a name after a check that it is not a file.

    Raises:
        PaveTwinError: it is a file.
    """
    if isinstance(name, str) and (":" in name or "/" in name):
        raise PaveTwinError(
            f"{WHERE} has a {what} of a file, '{Path(name).name[:60]}', which the page does not take; fly it "
            "again from the command line."
        )
    return name


def _world_of(named: Mapping[str, Any], worlds: Mapping[str, str]) -> tuple[str, str]:
    """The town by its content, or else by its name."""
    contents = {key: read_description(Path(folder)).get("content_hash") for key, folder in worlds.items()}
    same = [key for key, content in contents.items() if content == named.get("content_hash")]
    alike = [key for key, folder in worlds.items() if Path(folder).name == named.get("name")]
    if not same + alike:
        raise PaveTwinError(f"{WHERE} is of the town '{_text(named.get('name'))[:60]}', which the page does not show.")
    key = (same + alike)[0]
    return key, worlds[key]


def _known_segments(targets: Any, world: World) -> list[str]:
    try:
        names = TypeAdapter(list[str]).validate_python(targets)
    except ValidationError as error:
        raise PaveTwinError(f"{WHERE} has no list of `targets`.") from error
    known = {segment.id for segment in world.segments}
    if unknown := [name for name in names if name not in known]:
        raise PaveTwinError(f"{WHERE} inspects '{unknown[0][:60]}', which the town '{world.name}' does not have.")
    return names


def _conditions(given: Mapping[str, Any]) -> dict[str, Any]:
    texts = {name: _text(given[name]).removesuffix(":00") for name in ("date", "time") if name in given}
    return texts | {name: given[name] for name in ("clouds", "wind_mps", "wind_from_deg") if name in given}


def _text(value: Any) -> str:
    """A text or a date; of anything else, however long it would be, only that it is something else."""
    if isinstance(value, str | date):
        return str(value)
    return "" if value is None else "?"


def _without_none(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _left_out(values: Mapping[str, Any], request: FlightRequest, world: World) -> list[str]:
    """Settings of a mission that the page has no field for."""
    traffic, base = _part(values, "traffic"), values.get("base")
    left = [name for name in ("routes", "recording", "take_off_s") if traffic.get(name)]
    left += [name for name in ("aircraft", "plugins") if values.get(name)]
    if _part(values, "defects").get("seed") is not None:
        left.append("defects.seed")
    if any(seed != request.seed for seed in (traffic.get("seed"), values.get("parking_seed"))):
        left.append("seeds of traffic or parking")
    settings = request.settings()
    own = with_roadside_base(world, settings.uav.radius_m).base
    if not _is_at(base, own.x, own.y):
        left.append("base")
    return left + sorted(_differing(_part(values, "settings"), settings.model_dump(mode="json"), "settings"))


def _is_at(place: Any, x_m: float, y_m: float) -> bool:
    is_place = isinstance(place, list) and len(place) == 2 and all(isinstance(each, int | float) for each in place)
    return is_place and hypot(place[0] - x_m, place[1] - y_m) < _SAME_M


def _differing(given: Any, own: Any, place: str) -> list[str]:
    """The keys whose values differ, as `settings.visibility.threshold`."""
    if isinstance(given, Mapping) and isinstance(own, Mapping):
        return [
            inner
            for name in given.keys() | own.keys()
            for inner in _differing(given.get(name), own.get(name), f"{place}.{name}")
        ]
    return [] if given == own else [place]
