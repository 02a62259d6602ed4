"""Building a town from a map that a browser sent, in a process of its own that may use only so much."""

import resource
import signal
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, Final, NoReturn

from pavetwin.app.map_limits import check_map
from pavetwin.defects.placement import build_folder
from pavetwin.errors import PaveTwinError
from pavetwin.world.build import BuildOptions

MEMORY_BYTES: Final = 4 << 30
"""Address space of this process, and of each that it starts."""

PROCESSOR_S: Final = 600
"""Of this process, and of each that it starts."""

FILE_BYTES: Final = 2 << 30
"""The largest file that is written."""


def build_town(source: Path, folder: Path, options: dict[str, Any], tell: Callable[[float, str], None]) -> None:
    """Build a world as `pavetwin world build` does, within limits; this process is of no use afterwards.

    Args:
        source: the map, in a folder for temporary files.
        folder: of the new world.
        options: `left_hand` and `parking_rule`.

    Raises:
        PaveTwinError: the map is refused, or no world comes of it.
    """
    tempfile.tempdir = str(source.parent)
    _limit()
    tell(0.0, "Checking the map")
    try:
        check_map(source)
        chosen = BuildOptions.parse(options, where="the page")
        build_folder(source, folder, chosen, on_progress=lambda share, what: tell(share, f"Building the town: {what}"))
    except PaveTwinError as error:
        raise PaveTwinError(str(error).replace(f"{source.parent}/", "")) from error


def _limit() -> None:
    signal.signal(signal.SIGXCPU, _too_long)
    for what, most, beyond in (
        (resource.RLIMIT_AS, MEMORY_BYTES, 0),
        (resource.RLIMIT_CPU, PROCESSOR_S, 30),
        (resource.RLIMIT_FSIZE, FILE_BYTES, 0),
        (resource.RLIMIT_CORE, 0, 0),
    ):
        hard = resource.getrlimit(what)[1]
        is_lower = hard != resource.RLIM_INFINITY and hard < most + beyond
        resource.setrlimit(what, (min(most, hard) if is_lower else most, hard if is_lower else most + beyond))


def _too_long(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 - the signature of a handler
    raise PaveTwinError(
        f"Building it takes more than {PROCESSOR_S // 60} minutes of processor time; cut out a smaller area."
    )
