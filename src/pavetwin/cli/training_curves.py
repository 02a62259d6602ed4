"""Live curves of a training on the terminal."""

import time
from typing import TYPE_CHECKING, Final

from rich.console import Group
from rich.progress_bar import ProgressBar
from rich.table import Table

if TYPE_CHECKING:
    from rich.live import Live

    from pavetwin.training.trainer.run_folder import Curves
    from pavetwin.training.trainer.schedule import Phase

SHOWN: Final = (
    ("total", "loss"),
    ("box", "box"),
    ("classes", "classes"),
    ("subtype", "subtype"),
    ("mask", "mask"),
    ("map50", "mAP@0.5"),
    ("map", "mAP@0.5:0.95"),
)
"""Columns of the curves and their display names."""

BLOCKS: Final = "▁▂▃▄▅▆▇█"
WIDTH: Final = 48
"""Number of last epochs in a line."""

STEP_S: Final = 0.2
"""Seconds between two updates within an epoch."""


class LiveCurves:
    """Watcher with a line for each loss and precision, and a progress bar of the epoch."""

    def __init__(self, live: "Live") -> None:
        self._live = live
        self._curves: Curves = []
        self._drawn_s = 0.0

    def on_start(self, where: str) -> None:
        """Training starts."""
        self._live.console.print(where, highlight=False)

    def on_step(self, phase: "Phase", epoch: int, step: int, steps: int, total: float) -> None:
        """A step is done."""
        now = time.monotonic()
        if now > self._drawn_s + STEP_S:
            self._drawn_s = now
            head = f"{phase.name}: epoch {epoch + 1} of {phase.epochs}, step {step} of {steps}, loss {total:.3f}"
            bar = ProgressBar(total=steps, completed=step, width=WIDTH)
            self._live.update(Group(head, bar, curves_table(self._curves)))

    def on_epoch(self, curves: "Curves") -> None:
        """An epoch is done."""
        self._curves = list(curves)
        self._live.update(curves_table(self._curves))


def curves_table(curves: "Curves") -> Table:
    """Table with shape, last value and best value of each curve."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column(f"{len(curves)} epochs")
    table.add_column("", no_wrap=True)
    table.add_column("now", justify="right")
    table.add_column("best", justify="right")
    for key, name in SHOWN:
        values = [float(row.get(key) or 0) for row in curves]
        if any(values):
            best = max(values) if key.startswith("map") else min(value for value in values if value)
            table.add_row(name, sparkline(values[-WIDTH:]), f"{values[-1]:.3f}", f"{best:.3f}")
    return table


def sparkline(values: list[float]) -> str:
    """A curve as one line of blocks, scaled from its minimum to its maximum."""
    low, high = min(values), max(values)
    steps = len(BLOCKS) - 1
    return "".join(BLOCKS[round(steps * (value - low) / (high - low)) if high > low else 0] for value in values)
