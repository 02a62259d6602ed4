"""A study from its design to its table: flown in units, each written when it ends; an interrupted study is resumed."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import polars as pl

from pavetwin.experiments.design import Design
from pavetwin.experiments.engines import Engine
from pavetwin.experiments.metrics import FAILED, REASON, STATUS
from pavetwin.experiments.plan import ImageSourceFactory, Plan, Unit, load_worlds, plan
from pavetwin.experiments.store import Store
from pavetwin.files import working_in

OnProgress = Callable[[float, str], None]
"""Told the share done, and what is being done."""


@dataclass(frozen=True)
class Ran:
    plan: Plan
    table: pl.DataFrame
    missions_flown: int
    """Missions flown by this call; the others were flown before."""

    @property
    def failures(self) -> Counter[str]:
        """How many rows failed, by reason; the most frequent first."""
        reasons = self.table.filter(pl.col(STATUS) == FAILED)[REASON].to_list()
        return Counter(dict(Counter(reasons).most_common()))


def run(
    design: Design,
    folder: Path,
    engine: Engine,
    *,
    image_source_factory: ImageSourceFactory | None = None,
    retry: bool = False,
    on_progress: OnProgress | None = None,
) -> Ran:
    """Fly what is not flown yet.

    Args:
        design: with absolute paths, as `read_design` gives it.
        image_source_factory: for sensors that look at images, such as `pavetwin.capture.mission_images.MissionImages`.
        retry: fly those units again of which a mission failed.

    Raises:
        PaveTwinError: the design does not fit its worlds, the folder holds another, or it cannot be written. Flown
            units are kept, and the same call resumes.
    """
    tell = on_progress or (lambda _share, _what: None)
    store = Store(folder)
    store.check_design(design)
    made = plan(design, load_worlds(design), lambda what: tell(0.0, what))
    made = replace(made, image_source_factory=image_source_factory)
    with working_in(folder):
        store.check(made, retry=retry)
        missing = store.missing(made.units, failed=retry)
        cells, done = len(made.cells), made.missions - len(missing) * len(made.cells)

        def on_ready() -> None:
            store.begin(made, retry=retry)
            flown()

        def on_unit(unit: Unit, part: bytes) -> None:
            nonlocal done
            store.write(unit, part)
            done += cells
            flown()

        def flown() -> None:
            tell(done / made.missions, f"Flying missions {done}/{made.missions}")

        if missing:
            engine.fly(made, missing, on_ready, on_unit, lambda what: tell(0.0, what))
        else:
            store.begin(made)
        return Ran(made, store.table(), len(missing) * cells)
