"""24 streets of several towns from the air: generated ones and, where there are maps, real ones."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from PIL import Image

from gallery.renderer import LOW_SUN, MORNING, OVERCAST, GalleryRenderer, Picture
from gallery.sheet import captioned, grid
from pavetwin.scene.view import look
from pavetwin.world.build import BuildOptions
from pavetwin.world.model import Segment
from pavetwin.world.segments import direction_at

STREETS: Final = 24
ALTITUDE_M: Final = 10.0
SHOWN_M: Final = (9.6, 7.2)
"""Of each street, across and along."""
TAKEN_PX: Final = (640, 480)
CELL_PX: Final = (320, 240)
IN_SIGHT_M: Final = 3.0
"""Half of what is shown along a street, less a margin."""
SHORTEST_M: Final = 40.0
"""Streets below are mostly stubs at the border of a map."""
FROM_END_M: Final = 5.0
"""Of the places before junctions, where most markings are."""


@dataclass(frozen=True)
class Town:
    """A town of the sheet."""

    title: str
    renderer: GalleryRenderer
    streets: int
    phase: float = 0.25
    """Which of its streets, 0 … 1: two towns of one map show different ones."""


def towns(renderer: GalleryRenderer) -> list[Town]:
    """The demo's town under two marking standards; half of the streets are real where there are maps: Seattle, and
    Berlin as it is and with traffic that keeps left."""
    folder, maps = renderer.folder, renderer.maps
    share = 5 if maps else 12
    found = [
        Town("generated, markings of Germany", renderer, share),
        Town("generated, markings of China", renderer.with_markings(folder, "china"), share, 0.75),
    ]
    if not maps:
        return found
    berlin, seattle = maps / "berlin_neukoelln.osm", maps / "seattle_roosevelt.osm"
    left = GalleryRenderer.with_markings(folder / "berlin-left", "united_kingdom")
    left.source, left.options = berlin, BuildOptions(left_hand=True)
    rule = BuildOptions(parking_rule="north_america")
    return [
        *found,
        Town("Seattle", GalleryRenderer(folder / "seattle", source=seattle, options=rule), 6),
        Town("Berlin", GalleryRenderer(folder / "berlin", source=berlin, options=BuildOptions()), 4),
        Town("Berlin, keeping left, markings of the UK", left, 4, 0.75),
    ]


def streets(renderer: GalleryRenderer) -> Picture:
    """Streets of several towns as the UAV sees them, half of them where damage is largest, half before a junction,
    under changing skies; each sky has one exposure, so that pale streets are pale and dark ones dark."""
    whole = grid([cell for town in towns(renderer) for cell in _cells(town)], columns=4)
    note = f"{1000 * SHOWN_M[0] / CELL_PX[0]:.0f} mm a pixel."
    if renderer.maps:
        note += " Maps of Seattle and Berlin: © OpenStreetMap contributors, ODbL (openstreetmap.org/copyright)"
    return captioned(whole, note, height_px=whole.shape[0])


def _cells(town: Town) -> Iterator[Picture]:
    renderer = town.renderer
    long = [each for each in renderer.world.segments if each.length_m >= SHORTEST_M]
    names = sorted({each.street for each in long})
    for index in range(min(town.streets, len(names))):
        name = names[int((index + town.phase) * len(names) / town.streets)]
        choose = _before_junction if index % 2 else _most_damaged
        on_street = [(each, *choose(renderer, each)) for each in long if each.street == name]
        segment, station, _ = max(on_street, key=lambda found: (found[2], found[0].id))
        place, (dx, dy) = segment.centre_line.interpolate(station), direction_at(segment.centre_line, station)
        view = look(
            (place.x, place.y, ALTITUDE_M),
            yaw_rad=math.atan2(dy, dx),
            pitch_rad=-math.pi / 2,
            size_px=TAKEN_PX,
            vertical_fov_rad=2 * math.atan(SHOWN_M[1] / 2 / ALTITUDE_M),
        )
        light = (OVERCAST, MORNING, OVERCAST, LOW_SUN, MORNING)[index % 5]
        taken = Image.fromarray(renderer.take(view, light, exposure=renderer.grey_card(light)))
        cell = np.asarray(taken.resize(CELL_PX, Image.Resampling.LANCZOS))
        yield captioned(cell, town.title, height_px=CELL_PX[1])


def _before_junction(renderer: GalleryRenderer, segment: Segment) -> tuple[float, float]:
    """Before the end of a segment with more damage in sight [m], and that damage's area [m²]."""
    ends = (FROM_END_M, segment.length_m - FROM_END_M)
    return max(((station, _damage_m2(renderer, segment, station)) for station in ends), key=lambda found: found[1])


def _most_damaged(renderer: GalleryRenderer, segment: Segment) -> tuple[float, float]:
    """Where on a segment damage covers most of what is in sight [m], and that area [m²]; its middle without damage."""
    line = segment.centre_line
    stations = [line.project(each.centre) for each in renderer.world.defects_of(segment.id)] or [line.length / 2]
    return max(((station, _damage_m2(renderer, segment, station)) for station in stations), key=lambda found: found[1])


def _damage_m2(renderer: GalleryRenderer, segment: Segment, station: float) -> float:
    """Area of the damage in sight there."""
    line = segment.centre_line
    return sum(
        each.area_m2
        for each in renderer.world.defects_of(segment.id)
        if abs(line.project(each.centre) - station) < IN_SIGHT_M
    )
