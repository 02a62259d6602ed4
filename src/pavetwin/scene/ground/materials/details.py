"""The detail textures of every kind of ground, made on first use from a fixed seed: the same in every world."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from os import cpu_count
from types import MappingProxyType
from typing import Final

import numpy as np

from pavetwin.memory import give_back
from pavetwin.scene.ground.materials.asphalt import asphalt, chip_seal
from pavetwin.scene.ground.materials.hardscape import concrete, kerb, paving, slabs
from pavetwin.scene.ground.materials.softscape import earth, grass
from pavetwin.scene.model import Detail, GroundKind
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
}

_SEED: Final = 1


@cache
def details() -> Mapping[GroundKind, Detail]:
    """The detail textures of all kinds of ground; about two seconds the first time in a process."""
    with ThreadPoolExecutor(max_workers=min(len(MAKERS), cpu_count() or 1)) as pool:
        made = {kind: pool.submit(make, child(_SEED, Stream.SCENE, int(kind))) for kind, make in MAKERS.items()}
        found = MappingProxyType({kind: task.result() for kind, task in made.items()})
    give_back()
    return found
