"""Writing a plan: a file for each flight and format."""

from collections.abc import Sequence
from pathlib import Path

from pavetwin.files import writing
from pavetwin.flightplan.formats import PlanFormat
from pavetwin.flightplan.model import FlightPlan


def save_plan(plan: FlightPlan, folder: Path, formats: Sequence[PlanFormat]) -> list[Path]:
    """Write `flight-1.plan`, `flight-2.plan` and so on; parts of a flight are `flight-1-part-1` and so on.

    Nothing is written where a format cannot hold the plan.

    Returns:
        The files.

    Raises:
        PaveTwinError: a format cannot hold the plan, or the folder cannot be written.
    """
    contents: dict[str, bytes] = {}
    for each in formats:
        for number, flight in enumerate(plan.flights, 1):
            parts = each.parts(flight)
            for part, piece in enumerate(parts, 1):
                ending = f"-part-{part}" if len(parts) > 1 else ""
                contents[f"flight-{number}{ending}{each.suffix}"] = each.write(plan, piece)
    for name, content in contents.items():
        with writing(folder / name) as path:
            path.write_bytes(content)
    return [folder / name for name in contents]
