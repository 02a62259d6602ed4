"""The detail textures of every kind of ground, made from a fixed seed: the same in every world."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from os import cpu_count
from types import MappingProxyType
from typing import Final

import numpy as np

from pavetwin.arrays import AnyArray
from pavetwin.memory import give_back
from pavetwin.scene.ground.materials.asphalt import asphalt, chip_seal
from pavetwin.scene.ground.materials.blocks import blocks, setts, tiles
from pavetwin.scene.ground.materials.hardscape import concrete, kerb, paving, slabs
from pavetwin.scene.ground.materials.softscape import earth, grass
from pavetwin.scene.model import Detail, GroundKind
from pavetwin.scene.texture_cache import kept
from pavetwin.seeds import Stream, child

MAKERS: Final[Mapping[GroundKind, Callable[[np.random.Generator], Detail]]] = {
    GroundKind.ASPHALT: asphalt,
    GroundKind.CONCRETE: concrete,
    GroundKind.PAVING: paving,
    GroundKind.KERB: kerb,
    GroundKind.GRASS: grass,
    GroundKind.EARTH: earth,
    GroundKind.CHIP_SEAL: chip_seal,
    GroundKind.SLABS: slabs,
    GroundKind.BLOCKS: blocks,
    GroundKind.TILES: tiles,
    GroundKind.SETTS: setts,
}

_SEED: Final = 1


@cache
def details() -> Mapping[GroundKind, Detail]:
    """The detail textures of all kinds of ground, from the cache; some six seconds of a processor to make them."""
    found = kept("ground", _made)
    names = {kind: _names(kind) for kind in MAKERS}
    return MappingProxyType({kind: Detail(found[m].item(), found[r], found[h]) for kind, (m, r, h) in names.items()})


def _made() -> dict[str, AnyArray]:
    with ThreadPoolExecutor(max_workers=min(len(MAKERS), cpu_count() or 1)) as pool:
        tasks = {kind: pool.submit(make, child(_SEED, Stream.SCENE, int(kind))) for kind, make in MAKERS.items()}
        made = {kind: task.result() for kind, task in tasks.items()}
    give_back()
    columns: dict[str, AnyArray] = {
        name: column
        for kind, each in made.items()
        for name, column in zip(_names(kind), (np.array(each.size_m), each.reflectance, each.relief), strict=True)
    }
    return columns


def _names(kind: GroundKind) -> tuple[str, str, str]:
    return f"{kind.name}-size", f"{kind.name}-reflectance", f"{kind.name}-relief"
