"""A world with its defects from a source, written to its folder: what `pavetwin world build` does."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from pavetwin.defects import placement
from pavetwin.defects.placement import DefectOptions, add_defects
from pavetwin.workers import cores, may_start, started
from pavetwin.world.build import BuildOptions, BuildRecord, build_world
from pavetwin.world.folder import check_target
from pavetwin.world.generate import NetworkKind
from pavetwin.world.model import World
from pavetwin.world.store import save_world

MOST_PLACERS: Final = 8
"""Processes that place defects at most."""


def build_folder(
    source: Path | NetworkKind,
    folder: Path,
    options: BuildOptions | None = None,
    defects: DefectOptions | None = None,
    *,
    force: bool = False,
    jobs: int | None = 1,
    on_progress: Callable[[float, str], None] = lambda _share, _what: None,
) -> tuple[World, BuildRecord]:
    """Build a world, place its defects, and write it.

    Args:
        force: replace a world that is there.
        jobs: number of processes that place defects; 1 takes threads of this one. None: one per core, 8 at most. They
            import the caller's main module, which must be made for that, as `multiprocessing` says.
        on_progress: told the share done, 0 … 1, and the step.

    Returns:
        The world, and what it was made from.

    Raises:
        PaveTwinError: as `build_world`, `add_defects` and `save_world`.
    """
    damage = defects or DefectOptions()
    damage.effective()
    check_target(folder, force=force)
    # Placing defects takes as long as all that is before it, for which one core is enough.
    with started(_placers(jobs), placement.__name__) as waiting:
        built = build_world(source, options, lambda what, share: on_progress(0.25 * share, what))
        damaged = add_defects(built, damage, lambda share: on_progress(0.25 + 0.7 * share, "defects"), waiting)
    world = save_world(damaged, folder, force=force)
    on_progress(1.0, "world")
    return world, built.record


def _placers(jobs: int | None) -> int:
    """How many processes place defects; none where one would be the only one, or none may be started."""
    most = min(cores(), MOST_PLACERS) if jobs is None else jobs
    return most if most > 1 and may_start() else 0
