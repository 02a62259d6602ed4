"""Placed defects, kept in the cache between runs: a study over a town that it knows does not place them again."""

from collections.abc import Sequence
from functools import partial
from typing import Final

from pavetwin.defects.placement import DefectOptions, place
from pavetwin.world.cache import placed_folder
from pavetwin.world.kept import ValueStore, made_by, short_sha256
from pavetwin.world.model import Defect, Segment, Severity, World

MADE_BY: Final = ("defects", "world")
"""The folders of the package whose code and data decide where defects lie."""

_STORE: Final = ValueStore("placed defects", (Defect, Severity))


def placed_on(
    world: World,
    segments: Sequence[Segment],
    seed: int,
    options: DefectOptions | None = None,
    threads: int | None = None,
) -> tuple[Defect, ...]:
    """As `place`, from the cache where the same were placed before.

    Nothing is kept of a world without a content hash, which was never built, nor with classes of a user's own, whose
    code may change unseen.

    Args:
        segments: of the world, in its order.

    Raises:
        PaveTwinError: as `place`.
    """
    make = partial(place, segments, seed, options, threads=threads)
    whole = (options or DefectOptions()).effective()
    if not world.content_hash or not all(kind.ships for kind, _ in whole.shares()):
        return make()
    inputs = (world.content_hash, [segment.id for segment in segments], seed, whole.model_dump_json())
    return _STORE.kept(placed_folder() / short_sha256(f"{inputs!r} {made_by(*MADE_BY)}"), make)
