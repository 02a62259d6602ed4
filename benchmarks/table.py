"""The table on the terminal, the same as JSON, and a plot of what was reached."""

from pathlib import Path
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


def plot(lines: list[Line], path: Path) -> None:
    """Draw each measurement relative to its target: left of 1 the target is reached.

    Args:
        lines: lines without a target are left out.
        path: the image, `.svg` or `.png`.
    """
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator, NullLocator

    shown = [line for line in lines if line.target and line.value]
    shares = [line.target / line.value if line.kind.more_is_better else line.value / line.target for line in shown]
    figure, axes = plt.subplots(figsize=(9, 0.26 * len(shown) + 0.8), layout="constrained")
    colours = ["#4c8c6b" if line.reached else "#b5533c" for line in shown]
    axes.hlines(range(len(shown)), 1.0, shares, color=colours, linewidth=5)
    axes.axvline(1.0, color="black", linewidth=1)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(lambda share, _: f"{share:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(range(len(shown)), [f"{line.what}: {line.measured()}" for line in shown], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("cost relative to the target (log scale); left of 1 the target is reached")
    with plt.rc_context({"svg.fonttype": "none"}):
        figure.savefig(path)
    plt.close(figure)
