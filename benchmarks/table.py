"""The table on the terminal, and the same as JSON."""

from typing import Any

from rich.table import Table

from benchmarks.measure import Line

MARKS = {True: "[green]yes[/]", False: "[bold red]no[/]", None: ""}


def table(lines: list[Line]) -> Table:
    """One row a measurement."""
    made = Table(title="PaveTwin's speeds (median; × is times real time)", title_justify="left", header_style="bold")
    made.add_column("what")
    made.add_column("measured", justify="right")
    made.add_column("asked", justify="right")
    made.add_column("reached")
    for number, line in enumerate(lines, start=1):
        what = f"{line.what} [dim]\\[{number}][/]" if line.note else line.what
        made.add_row(what, line.measured(), line.asked(), MARKS[line.reached])
    return made


def notes(lines: list[Line]) -> list[str]:
    """Notes on the rows, by number."""
    return [f"[{number}] {line.note}" for number, line in enumerate(lines, start=1) if line.note]


def as_json(machine: dict[str, str], lines: list[Line]) -> dict[str, Any]:
    """Plain values: what, value and its unit, target, whether it was reached."""
    rows = [
        {
            "what": line.what,
            "value": line.value,
            "unit": line.kind.value,
            "target": line.target,
            "reached": line.reached,
            "took_s": line.took_s,
            "note": line.note,
        }
        for line in lines
    ]
    return {"machine": machine, "lines": rows}
