"""Writing a plan: a file for each flight and format."""

from collections.abc import Collection, Sequence
from pathlib import Path
from re import escape, fullmatch

from pavetwin.errors import PaveTwinError
from pavetwin.files import unwritable, writing
from pavetwin.flightplan.formats import PLAN_FORMATS, PlanFormat
from pavetwin.flightplan.model import FlightPlan
from pavetwin.flightplan.parts import parts_of


def save_plan(plan: FlightPlan, folder: Path, formats: Sequence[PlanFormat]) -> list[Path]:
    """Write `flight-1.plan`, `flight-2.plan` and so on; parts of a flight are `flight-1-part-1` and so on.

    Nothing is written where a format cannot hold the plan. Files of an earlier export into the folder, in any format,
    are removed: nobody should fly flight 3 of a plan that has two.

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
    """What a pilot must know where flights are in parts, as a sentence; None where none is."""
    count = sum("-part-" in path.name for path in files)
    if not count:
        return None
    return (
        f"{count} files are parts of a flight. Each takes off and lands at the base, on the shortest ways there and "
        "back among buildings, and is no longer than the flight: land, charge or change batteries, and fly the next."
    )


def check_folder(folder: Path) -> None:
    """Raises:
    PaveTwinError: a file is in the place of the folder.
    """
    if folder.exists() and not folder.is_dir():
        raise PaveTwinError(f"`output` {folder}: it is a file; name a folder.")


def _remove_earlier(folder: Path, names: Collection[str]) -> None:
    """Remove the files of plans that are not named, and no other files."""
    suffixes = "|".join(escape(PLAN_FORMATS.get(name).suffix) for name in PLAN_FORMATS.names())
    for path in folder.glob("flight-*"):
        if path.name not in names and fullmatch(rf"flight-\d+(-part-\d+)?({suffixes})", path.name):
            try:
                path.unlink()
            except OSError as error:
                raise unwritable(path, error) from error
