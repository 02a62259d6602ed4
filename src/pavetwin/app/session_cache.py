"""Values and folders that tasks of a session share: worlds, environments, played missions."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from pavetwin.app.flight_request import FlightRequest
from pavetwin.errors import PaveTwinError
from pavetwin.files import staging_folder, working_in
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
        raise PaveTwinError(f"The world '{folder}' no longer exists.") from error
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


WAITING_S: Final = 0.1
"""Between two looks whether another task is still at work in a folder."""


@contextmanager
def made_once(target: Path) -> Iterator[Path]:
    """A temporary folder of this task's own, which becomes `target` at the end of the block.

    The name of `target` identifies its content: a folder that another task has made meanwhile stays.

    Raises:
        PaveTwinError: it cannot be written. Nothing is left behind.
    """
    with staging_folder(target) as made:
        yield made
        try:
            made.replace(target)
        except OSError:
            if not target.is_dir():
                raise


@contextmanager
def alone_in(folder: Path, session: Path, report: Callable[[float, str], None]) -> Iterator[None]:
    """While the block runs, no other task of the session that asks the same works in a folder of missions.

    Args:
        session: its folder, which gets the lock: a cancelled task leaves nothing next to the missions.
        report: called while the task waits for another one.
    """
    name = session / f"mission-{sha256(str(folder.absolute()).encode()).hexdigest()[:20]}"
    with ExitStack() as held:
        while True:
            try:
                held.enter_context(working_in(name))
                break
            except PaveTwinError as error:
                if not isinstance(error.__cause__, TimeoutError):
                    raise
            report(0.0, "Waiting for another page with the same mission")
            time.sleep(WAITING_S)
        yield
