"""The curves of a training on the terminal, as they grow."""

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
    ("taught", "photographs"),
    ("map50", "mAP@0.5"),
    ("map", "mAP@0.5:0.95"),
)
"""Column of the curves, and what it is called."""

BLOCKS: Final = "▁▂▃▄▅▆▇█"
WIDTH: Final = 48
"""Epochs in a line; of more, the last."""

STEP_S: Final = 0.2
"""Between two drawings within an epoch."""


class LiveCurves:
    """A line for each loss and precision, with a bar for the epoch."""

    def __init__(self, live: "Live") -> None:
        self._live = live
        self._curves: Curves = []
        self._drawn_s = 0.0

    def on_start(self, where: str) -> None:
        """The steps begin."""
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
    """A row for each curve: its shape, its last value and its best."""
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
    """A curve as one line of blocks, from its least to its greatest value."""
    low, high = min(values), max(values)
    steps = len(BLOCKS) - 1
    return "".join(BLOCKS[round(steps * (value - low) / (high - low)) if high > low else 0] for value in values)
