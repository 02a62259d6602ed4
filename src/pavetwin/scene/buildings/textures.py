"""All façade textures as one array."""

import numpy as np

from pavetwin.arrays import UInt8Array
from pavetwin.scene.buildings import openings, surfaces
from pavetwin.scene.buildings.layers import Layer
from pavetwin.scene.ground.sampling import srgb_of_linear
from pavetwin.seeds import Stream, child

KEY = 3
"""This file's child of the scene's stream."""

MAKERS = {
    Layer.RENDER: surfaces.render,
    Layer.BRICK: surfaces.brick,
    Layer.CONCRETE: surfaces.concrete,
    Layer.STONE: surfaces.stone,
    Layer.CLADDING: surfaces.cladding,
    Layer.TILES: surfaces.tiles,
    Layer.SLATE: surfaces.slate,
    Layer.SEAMS: surfaces.seams,
    Layer.GRAVEL: surfaces.gravel,
    Layer.FELT: surfaces.felt,
    Layer.WINDOWS: openings.windows,
    Layer.GLAZING: openings.glazing,
    Layer.DOORS: openings.doors,
}


def facade_textures(seed: int) -> UInt8Array:
    """(layers, k, k, 4): sRGB-coded reflectance and roughness; row 0 is v = 0."""
    layers = []
    for layer in Layer:
        if layer is not Layer.PLAIN:
            drawn = MAKERS[layer](child(seed, Stream.SCENE, KEY, int(layer)))
            drawn[..., :3] = srgb_of_linear(drawn[..., :3])
            layers.append(np.round(255 * np.clip(drawn, 0, 1)).astype(np.uint8))
    return np.stack(layers)
