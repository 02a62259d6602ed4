"""Buildings from footprint and height: façades with openings, roofs, and the textures of both."""

from pavetwin.scene.buildings.buildings import Buildings
from pavetwin.scene.buildings.layers import FACADE_PX, FACADE_REPEAT_M, FacadeTexture
from pavetwin.scene.buildings.styles import HouseDetail
from pavetwin.scene.buildings.textures import facade_textures

__all__ = ["FACADE_PX", "FACADE_REPEAT_M", "Buildings", "FacadeTexture", "HouseDetail", "facade_textures"]
