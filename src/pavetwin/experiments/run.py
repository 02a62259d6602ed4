"""A study from its design to its table: flown in units, each written when it ends; an interrupted study is resumed."""

from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import polars as pl

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Engine, Listener
from pavetwin.experiments.metrics import FAILED, REASON, STATUS
from pavetwin.experiments.planning import load_worlds, plan, with_levels_in_reach
from pavetwin.experiments.store import FORMER, Store
from pavetwin.experiments.units import ImageSourceFactory, Plan, Unit, ownership_notes
from pavetwin.files import working_in
from pavetwin.mission.inputs import OnProgress
from pavetwin.reports.words import counted, listed
from pavetwin.traffic.demand import density_named
from pavetwin.traffic.demand_search import found
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.town_trips import observe
from pavetwin.world.model import World


@dataclass(frozen=True)
class Ran:
    plan: Plan
    table: pl.DataFrame
    missions_flown: int
    """Missions flown by this call; the others were flown before."""

    @property
    def failures(self) -> Counter[str]:
        """Number of failed rows by reason, the most frequent first."""
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
    on_notice: Callable[[str], None] = lambda _: None,
) -> Ran:
    """Fly what is not flown yet.

    Args:
        design: with absolute paths, as `read_design` gives it.
        image_source_factory: for sensors that look at images, such as `pavetwin.capture.mission_images.MissionImages`.
        retry: fly failed missions again.
        on_notice: called before anything is flown with the replaced levels of service, the changed files, and the
            missions that are flown again.

    Raises:
        PaveTwinError: the design does not fit its worlds, the folder holds another, or it cannot be written. Flown
            units are kept, and the same call resumes.
    """
    report = on_progress or (lambda _share, _what: None)
    with nullcontext() if folder.exists() else engine.started():  # in a folder there may be nothing left to fly
        store = Store(folder)
        worlds = load_worlds(design)
        design = with_levels_in_reach(design, worlds, report, on_notice)
        store.check_design(design)
        made = plan(design, worlds, lambda what: report(0.0, what))
        made = replace(made, image_source_factory=image_source_factory)
        with working_in(folder):
            store.check(made)
            missing = store.missing(made, failed=retry)
            flying = sum(len(made.cells_of(unit)) for unit in missing)
            if missing:
                store.check_models(made)
            done, recorded = made.missions - flying, 0
            if outdated := store.outdated(made):
                files = listed(store.changed_files(made)) or "A file"
                on_notice(
                    f"{files} changed since: {outdated} of {made.missions} missions are flown again; their former rows "
                    f"are kept in {folder / FORMER}."
                )

            if missing and made.owners:
                notes = ownership_notes(design, made.owners, made.policies)
                on_notice(f"{' '.join(notes)} That makes {counted(made.missions, 'mission')}.")

            def on_ready() -> None:
                store.begin(made)
                flown()

            def on_unit(unit: Unit, part: bytes) -> None:
                nonlocal done
                store.write(made, unit, part)
                done += len(made.cells_of(unit))
                flown()

            def on_recorded() -> None:
                nonlocal recorded
                recorded = min(recorded + 1, len(missing))  # that of a unit whose process died is recorded again
                flown()

            def flown() -> None:
                recording = (
                    f"Recording traffic {recorded}/{len(missing)}, flying" if recorded < len(missing) else "Flying"
                )
                report(done / made.missions, f"{recording} missions {done}/{made.missions}")

            for world, traffic in dict.fromkeys((unit.world, unit.traffic) for unit in missing):
                if traffic in design.traffics(world) and not design.worlds[world].traffics:
                    _find_demand(worlds[world], traffic, report, of_areas=made.traffic_area_m is not None)
            if missing:
                listener = Listener(on_ready, on_unit, lambda what: report(0.0, what), on_recorded)
                engine.fly(made, missing, listener)
            else:
                store.begin(made)
            return Ran(made, store.table(), flying)


def _find_demand(world: World, traffic: str, report: OnProgress, *, of_areas: bool) -> None:
    """Search for the density of a level of service or an hour once, before every worker process would.

    A world that cannot reach it does not fail the study; its units report it.
    """

    def on_search(_share: float) -> None:
        report(0.0, f"Finding the demand of {traffic} in {world.name}")

    asked = density_named(traffic)
    with suppress(PaveTwinError):
        if of_areas:
            observe(world, asked, on_search)
        else:
            found(Inputs.of(world, asked, 0), on_search)
