"""Who is told how a training goes, where there is no terminal to draw on."""

import sys
import time

from pavetwin.training.trainer.run_folder import Curves
from pavetwin.training.trainer.schedule import Phase

LINE_S = 30.0
"""Between two lines within an epoch."""


class Silent:
    """Says nothing."""

    def on_start(self, where: str) -> None:
        """The steps begin."""

    def on_step(self, phase: Phase, epoch: int, step: int, steps: int, total: float) -> None:
        """A step is done."""

    def on_epoch(self, curves: Curves) -> None:
        """An epoch is done."""


class PlainLines:
    """A line for each epoch, and every half minute, on the error stream."""

    def __init__(self) -> None:
        self._said = self._began = time.monotonic()

    def on_start(self, where: str) -> None:
        """The steps begin."""
        self._say(where)

    def on_step(self, phase: Phase, epoch: int, step: int, steps: int, total: float) -> None:
        """A step is done."""
        if time.monotonic() > self._said + LINE_S:
            self._say(f"{phase.name}: epoch {epoch + 1}/{phase.epochs}, step {step}/{steps}, loss {total:.3f}")

    def on_epoch(self, curves: Curves) -> None:
        """An epoch is done."""
        self._say(line_of(curves))

    def _say(self, text: str) -> None:
        self._said = time.monotonic()
        sys.stderr.write(f"{self._said - self._began:7.0f} s  {text}\n")
        sys.stderr.flush()


def line_of(curves: Curves) -> str:
    """The last epoch in words."""
    row = curves[-1]
    return (
        f"{row['phase']}: epoch {row['epoch']}, loss {row['total']:.3f}, "
        f"mAP@0.5 {row['map50']:.3f}, mAP@0.5:0.95 {row['map']:.3f}"
    )
