"""All façade textures as one array."""

import numpy as np

from pavetwin.arrays import UInt8Array
from pavetwin.scene.buildings import openings, surfaces
from pavetwin.scene.buildings.layers import FacadeTexture
from pavetwin.scene.ground.materials.sampling import srgb_of_linear
from pavetwin.scene.texture_cache import kept
from pavetwin.seeds import Stream, child

KEY = 3
"""Key of this module's child of the scene's random stream."""

MAKERS = {
    FacadeTexture.RENDER: surfaces.render,
    FacadeTexture.BRICK: surfaces.brick,
    FacadeTexture.CONCRETE: surfaces.concrete,
    FacadeTexture.STONE: surfaces.stone,
    FacadeTexture.CLADDING: surfaces.cladding,
    FacadeTexture.TILES: surfaces.tiles,
    FacadeTexture.SLATE: surfaces.slate,
    FacadeTexture.SEAMS: surfaces.seams,
    FacadeTexture.GRAVEL: surfaces.gravel,
    FacadeTexture.FELT: surfaces.felt,
    FacadeTexture.WINDOWS: openings.windows,
    FacadeTexture.GLAZING: openings.glazing,
    FacadeTexture.DOORS: openings.doors,
}


def facade_textures(seed: int) -> UInt8Array:
    """(layers, k, k, 4): sRGB-coded reflectance and roughness; row 0 is v = 0. From the cache."""
    return kept("facades", lambda: {"layers": _made(seed)}, seed)["layers"]


def _made(seed: int) -> UInt8Array:
    layers = []
    for layer in FacadeTexture:
        if layer is not FacadeTexture.PLAIN:
            drawn = MAKERS[layer](child(seed, Stream.SCENE, KEY, int(layer)))
            drawn[..., :3] = srgb_of_linear(drawn[..., :3])
            layers.append(np.round(255 * np.clip(drawn, 0, 1)).astype(np.uint8))
    return np.stack(layers)
