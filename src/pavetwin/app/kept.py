"""What a task process keeps for the next task: the world, and the environment that was asked for last."""

from functools import lru_cache
from pathlib import Path
from typing import Any

from pavetwin.app.flight_request import FlightRequest
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.inputs import defects_of
from pavetwin.mission.planning import defect_input, traffic_input
from pavetwin.world.folder import DESCRIPTION
from pavetwin.world.model import World
from pavetwin.world.store import load_world


def kept_world(folder: Path) -> World:
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


def kept_environment(request: FlightRequest, world: World) -> MissionEnvironment:
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
