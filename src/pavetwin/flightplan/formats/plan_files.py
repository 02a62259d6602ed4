"""Plan formats, their registry, and writing a plan: one file per flight and format."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from pathlib import Path
from re import escape, fullmatch
from typing import ClassVar

from pavetwin.errors import PaveTwinError
from pavetwin.files import unwritable, writing
from pavetwin.flightplan.flight_plan import FlightPlan, PlannedFlight, Waypoint, parts_of
from pavetwin.registry import Registry


class PlanFormat(ABC):
    """A file format of plans: one file per flight, or several for a flight with too many waypoints for one."""

    suffix: ClassVar[str]
    """End of the file name, with its dot."""
    most_waypoints: ClassVar[int | None] = None
    """Largest number of waypoints per file; a longer flight is written in parts."""

    def __init__(self, drone: str | None = None) -> None:
        """Args:
        drone: name of the aircraft, for formats that state it.
        """
        self.drone = drone

    @abstractmethod
    def write(self, plan: FlightPlan, flight: PlannedFlight) -> bytes:
        """Content of the file of one flight with at most `most_waypoints` waypoints."""


PLAN_FORMATS: Registry[type[PlanFormat]] = Registry(
    "format of flight plans", key="format", group="pavetwin.plan_formats", home="pavetwin.flightplan.formats"
)
plan_format = PLAN_FORMATS.register
"""Register a format under a name for `pavetwin plan export --format`."""


def number_text(value: float) -> str:
    """A number without exponent and trailing zeros."""
    return f"{value:.8f}".rstrip("0").rstrip(".")


def is_last(flight: PlannedFlight, waypoint: Waypoint) -> bool:
    """True for the last waypoint of a flight."""
    return waypoint is flight.waypoints[-1]


def save_plan(plan: FlightPlan, folder: Path, formats: Sequence[PlanFormat]) -> list[Path]:
    """Write `flight-1.plan`, `flight-2.plan` and so on; parts of a flight are `flight-1-part-1` and so on.

    Nothing is written if a format cannot hold the plan. Files of an earlier export into the folder, in any format, are
    removed, so that no old flight 3 remains next to a plan of two flights.

    Returns:
        The files.

    Raises:
        PaveTwinError: a format cannot hold the plan, or the folder is a file or cannot be written.
    """
    check_folder(folder)
    contents: dict[str, bytes] = {}
    for each in formats:
        for number, flight in enumerate(plan.flights, 1):
            parts = parts_of(plan, flight, each.most_waypoints)
            for part, piece in enumerate(parts, 1):
                ending = f"-part-{part}" if len(parts) > 1 else ""
                contents[f"flight-{number}{ending}{each.suffix}"] = each.write(plan, piece)
    _remove_earlier(folder, contents.keys())
    for name, content in contents.items():
        with writing(folder / name) as path:
            path.write_bytes(content)
    return [folder / name for name in contents]


def remark_on_parts(files: Sequence[Path]) -> str | None:
    """A sentence for the pilot about flights in parts; None if there are none."""
    count = sum("-part-" in path.name for path in files)
    if not count:
        return None
    return (
        f"{count} files are parts of a flight. Each takes off and lands at the base, on the shortest ways there and "
        "back among buildings, and is no longer than the flight: land, charge or change batteries, and fly the next."
    )


def check_folder(folder: Path) -> None:
    """Raises:
    PaveTwinError: the path is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise PaveTwinError(f"`output` {folder}: it is a file; name a folder.")


def _remove_earlier(folder: Path, names: Collection[str]) -> None:
    """Remove all files of plans but the named ones."""
    suffixes = "|".join(escape(PLAN_FORMATS.get(name).suffix) for name in PLAN_FORMATS.names())
    for path in folder.glob("flight-*"):
        if path.name not in names and fullmatch(rf"flight-\d+(-part-\d+)?({suffixes})", path.name):
            try:
                path.unlink()
            except OSError as error:
                raise unwritable(path, error) from error
