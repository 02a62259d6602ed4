"""The surface that a camera has seen, cell by cell, as the kernel judges it."""

from typing import Final

import numpy as np

from pavetwin._core import Ground, NadirCamera, Trace, Viewpoint

UNIT_M: Final = 0.001
"""Places of cells are told apart to this, which is far below a cell's side."""


class SeenCells:
    """Which cells of each segment were visible in at least one capture."""

    def __init__(self, ground: Ground, camera: NadirCamera, height_m: float) -> None:
        """Args:
        camera: looks straight down; what is in its inspection window counts.
        height_m: of the camera above the ground.
        """
        self._ground, self._camera, self._height_m = ground, camera, height_m
        self._cells: dict[int, set[tuple[int, int]]] = {}
        self._counts: dict[int, int] = {}

    @property
    def targets(self) -> list[int]:
        """Indices of the segments of which something was in a capture, in the order of the first."""
        return list(self._cells)

    def share(self, segment: int) -> float:
        """Of a segment's cells, those seen."""
        if segment not in self._counts:
            nowhere, north = np.zeros((0, 2)), np.zeros(0)
            self._counts[segment] = self._ground.reach(segment, self._camera, self._height_m, nowhere, north)["cells"]
        return len(self._cells.get(segment, ())) / max(1, self._counts[segment])

    def look(
        self, segments: list[int], trace: Trace, time_s: float, viewpoint: Viewpoint, *, counts: bool
    ) -> float | None:
        """Look at segments.

        Args:
            counts: whether it is a capture, so that what is visible counts as seen.

        Returns:
            o, the visible share of their cells in the window that nothing which stands still hides; None where there
            are none.
        """
        candidates = visible = 0
        for segment in segments:
            look = self._ground.observe(segment, trace, time_s, self._camera, viewpoint)
            candidates += len(look["candidates"])
            visible += len(look["visible"])
            if counts and len(look["candidates"]):
                cells = np.round(look["visible"] / UNIT_M).astype(np.int64)
                self._cells.setdefault(segment, set()).update(map(tuple, cells.tolist()))
        return visible / candidates if candidates else None
