"""The marking standard of a place, and the paints of markings as maps hold them."""

from typing import Final

from pavetwin.scene.ground.looks.mark import PaintName
from pavetwin.scene.ground.looks.marking_standard import MarkingStandard, marking_standard, standard_names
from pavetwin.scene.ground.materials.compose import PAINTS
from pavetwin.world.model import World

FALLBACK: Final = "germany"
"""Where no standard's country lies."""


def paint(colour: PaintName) -> float:
    """The place of a colour among the paints, 0 … 1, as maps hold it."""
    return list(PAINTS).index(colour) / (len(PAINTS) - 1)


def standard_at(longitude: float, latitude: float) -> MarkingStandard:
    """The standard of a place (WGS 84, degrees)."""
    standards = map(marking_standard, standard_names())
    return next((each for each in standards if each.holds_at(longitude, latitude)), marking_standard(FALLBACK))


def standard_of(world: World) -> MarkingStandard:
    """The standard of a world's place."""
    if not world.segments:
        return marking_standard(FALLBACK)
    return standard_at(*world.georeference.to_wgs84(world.segments[0].centre_line.coords[0]))
