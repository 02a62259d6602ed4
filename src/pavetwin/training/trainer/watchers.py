"""Progress reports of a training."""

import sys
import time
from typing import Protocol

from pavetwin.training.trainer.run_folder import Curves
from pavetwin.training.trainer.schedule import Phase

LINE_S = 30.0
"""Seconds between two lines within an epoch."""


class Watcher(Protocol):
    """Receiver of progress reports."""

    def on_start(self, where: str) -> None:
        """Training starts; `where` is a sentence on the device, its precision, and the place where views are drawn."""

    def on_step(self, phase: Phase, epoch: int, step: int, steps: int, total: float) -> None:
        """A step is done. `epoch` counts from 0, `step` from 1; `total` is the loss."""

    def on_epoch(self, curves: Curves) -> None:
        """An epoch is done; its row is the last of the curves."""


class Silent:
    """A watcher that ignores all reports."""

    def on_start(self, where: str) -> None:
        """Training starts."""

    def on_step(self, phase: Phase, epoch: int, step: int, steps: int, total: float) -> None:
        """A step is done."""

    def on_epoch(self, curves: Curves) -> None:
        """An epoch is done."""


class PlainLines:
    """Lines on the error stream, for each epoch and every half minute."""

    def __init__(self) -> None:
        self._last_s = self._began_s = time.monotonic()

    def on_start(self, where: str) -> None:
        """Training starts."""
        self._write(where)

    def on_step(self, phase: Phase, epoch: int, step: int, steps: int, total: float) -> None:
        """A step is done."""
        if time.monotonic() > self._last_s + LINE_S:
            self._write(f"{phase.name}: epoch {epoch + 1}/{phase.epochs}, step {step}/{steps}, loss {total:.3f}")

    def on_epoch(self, curves: Curves) -> None:
        """An epoch is done."""
        self._write(line_of(curves))

    def _write(self, text: str) -> None:
        self._last_s = time.monotonic()
        sys.stderr.write(f"{self._last_s - self._began_s:7.0f} s  {text}\n")
        sys.stderr.flush()


def line_of(curves: Curves) -> str:
    """Summary of the last epoch in one line."""
    row = curves[-1]
    return (
        f"{row['phase']}: epoch {row['epoch']}, loss {row['total']:.3f}, "
        f"mAP@0.5 {row['map50']:.3f}, mAP@0.5:0.95 {row['map']:.3f}"
    )
