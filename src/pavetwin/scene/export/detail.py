"""Levels of detail of an exported scene, and what each costs in bytes and seconds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.scene.values import TILE_M

FINEST_TEXEL_M, COARSEST_TEXEL_M = 0.005, 0.5

PATCH_FINER: Final = 0.2
"""Texels of defects are this share of the ground's, down to those of their maps."""

DEFECT_M2: Final = 5.2  # Mean texture area of a defect: its maps' rectangle


@dataclass(frozen=True)
class LevelOfDetail:
    """How finely a scene is exported."""

    name: str
    texel_m: float
    """Texel size of the ground's images, unless they would be too many."""
    texels: float
    """Most texels of the ground's images, over all tiles."""
    has_normals: bool
    """Whether ground and defects have normal maps, which need tangents."""
    has_fine_defects: bool
    """Whether defects have their fine mesh; otherwise the coarse one."""
    quality: int
    """JPEG quality."""
    subsampling: str
    """JPEG chroma subsampling."""
    bytes_a_texel: float
    bytes_a_defect: int
    """Bytes of a defect's mesh. This and the following are measured over a generated town."""

    def texel_of(self, tiles: int) -> float:
        """Side of a texel for a number of tiles [m]: coarser where images would hold too many."""
        least = math.sqrt(tiles * TILE_M**2 / self.texels)
        return max(self.texel_m, math.ceil(least / 0.005 - 1e-9) * 0.005)


LEVELS: Final[Mapping[str, LevelOfDetail]] = {
    level.name: level
    for level in (
        LevelOfDetail("low", 0.08, 25e6, False, False, 75, "4:2:0", 0.10, 10_500),
        LevelOfDetail("medium", 0.03, 70e6, False, False, 80, "4:2:0", 0.10, 10_500),
        LevelOfDetail("high", 0.02, 200e6, True, True, 86, "4:4:4", 0.24, 30_000),
    )
}
USUAL: Final = "medium"

_BYTES_A_TILE, _BYTES_OF_MODELS = 100_000, 2_000_000
"""Bytes of a tile's ground and houses, and of all models."""

_S_AT_FIRST, _S_A_TILE, _S_A_DEFECT, _S_A_TEXEL = 12.0, 0.5, 0.045, 0.8e-6
"""Seconds of one core at 2.5 GHz: what is made once for a world, each tile, defect and texel."""


@dataclass(frozen=True)
class Estimate:
    """What an export takes, before it is begun."""

    bytes: int
    seconds: float


def level_named(name: str) -> LevelOfDetail:
    """A level by its name.

    Raises:
        PaveTwinError: there is none of that name.
    """
    if name not in LEVELS:
        raise PaveTwinError(
            f"`detail`: no level of detail '{name}'{nearest_name(name, LEVELS)}. There are {', '.join(LEVELS)}."
        )
    return LEVELS[name]


def estimated(level: LevelOfDetail, texel_m: float, tiles: int, defects: int, jobs: int) -> Estimate:
    """Size and time of an export by `jobs` processes.

    Raises:
        PaveTwinError: the texel size is out of range.
    """
    if not FINEST_TEXEL_M <= texel_m <= COARSEST_TEXEL_M:
        raise PaveTwinError(f"A texel of {texel_m:g} m is not within {FINEST_TEXEL_M} … {COARSEST_TEXEL_M} m.")
    texels = tiles * (TILE_M / texel_m) ** 2 + defects * DEFECT_M2 / (texel_m * PATCH_FINER) ** 2
    meshes = defects * level.bytes_a_defect + tiles * _BYTES_A_TILE + _BYTES_OF_MODELS
    work_s = tiles * _S_A_TILE + defects * _S_A_DEFECT + texels * _S_A_TEXEL
    return Estimate(round(texels * level.bytes_a_texel + meshes), _S_AT_FIRST + work_s / jobs)
