"""24 streets of several towns from the air: generated ones and, where there are maps, real ones."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image

from gallery.renderer import LOW_SUN, MORNING, OVERCAST, GalleryRenderer, Picture
from gallery.sheet import captioned, grid
from pavetwin.cli.demo import TOWN_SEED
from pavetwin.scene.ground import GroundPlan
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.markings.placement import markings
from pavetwin.scene.ground.styles import mark
from pavetwin.scene.view import look
from pavetwin.world.build import BuildOptions
from pavetwin.world.segments import direction_at

STREETS: Final = 24
ALTITUDE_M: Final = 40.0
SHOWN_M: Final = (24.0, 18.0)
"""Of each street, along and across."""
TAKEN_PX: Final = (960, 720)
CELL_PX: Final = (320, 240)
IN_SIGHT_M: Final = (8.0, 6.0)
"""Half of the part, along and across, in which a marking is seen whole or nearly so."""
EVERY_M: Final = 4.0
"""Between places along a street that are chosen from."""
ON_ROAD_M: Final = 7.0
"""So far ahead and behind there is carriageway: at the border of a map a street ends in a lawn."""
SHORTEST_M: Final = 40.0
"""Streets below are mostly stubs at the border of a map."""
LEAST_WIDTH_M: Final = 0.03
"""Of damage that counts between places that show the same: narrower cracks are not seen at 75 mm a pixel."""
MARKS: Final = ("bus_stop", "bicycle")
"""Painted marks that are to be shown."""
RULES: Final = ("hatching", "box", "rumble")
"""Parts of a marking standard that are to be shown."""

Float = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Town:
    """A town of the sheet."""

    renderer: GalleryRenderer
    streets: int
    """Cells that it has."""


def towns(renderer: GalleryRenderer) -> list[Town]:
    """Two generated towns under two marking standards; half of the streets are real where there are maps: Seattle, and
    Berlin as it is and with traffic that keeps left."""
    folder, maps = renderer.folder, renderer.maps
    share = 5 if maps else 12
    china = GalleryRenderer.with_markings(folder / "china", "china")
    china.options = BuildOptions(seed=TOWN_SEED + 1)
    found = [
        Town(renderer, share),
        Town(china, share),
    ]
    if not maps:
        return found
    berlin, seattle = maps / "berlin_neukoelln.osm", maps / "seattle_roosevelt.osm"
    left = GalleryRenderer.with_markings(folder / "berlin-left", "united_kingdom")
    left.source, left.options = berlin, BuildOptions(left_hand=True)
    rule = BuildOptions(parking_rule="north_america")
    return [
        *found,
        Town(GalleryRenderer(folder / "seattle", source=seattle, options=rule), 6),
        Town(GalleryRenderer(folder / "berlin", source=berlin, options=BuildOptions()), 4),
        Town(left, 4),
    ]


@dataclass(frozen=True)
class Place:
    """What a camera looks down on, its image's long side along the street."""

    town: int
    street: str
    x_m: float
    y_m: float
    yaw_rad: float
    """Of the street."""
    pavement: str
    standard: str
    markings: frozenset[str]
    """Kinds of markings in sight."""
    damage_m2: float
    """Area of wide damage in sight."""

    @property
    def title(self) -> str:
        return f"{self.pavement}, {self.standard}"


def streets(renderer: GalleryRenderer) -> Picture:
    """Streets of several towns as the UAV sees them: every pavement and kind of marking that the towns have before any
    is shown twice, then where most damage is. Skies change; each has one exposure, so that pale streets are pale and
    dark ones dark."""
    found = towns(renderer)
    places = [place for town, each in enumerate(found) for place in places_of(each.renderer, town)]
    chosen = varied(places, [each.streets for each in found])
    cells = [_cell(found[place.town].renderer, place, index) for index, place in enumerate(chosen)]
    note = f"Each {SHOWN_M[0]:.0f} by {SHOWN_M[1]:.0f} m: pavement, standard of the markings."
    if renderer.maps:
        note += " Maps of Seattle and Berlin: © OpenStreetMap contributors, ODbL (openstreetmap.org/copyright)"
    whole = grid(cells, columns=4)
    return captioned(whole, note, height_px=whole.shape[0])


def varied(places: Sequence[Place], shares: Sequence[int]) -> list[Place]:
    """Places that show as much as possible, by town: each time the one with most pavements and kinds of markings not
    shown yet, then one whose pavement is not shown under its standard, then the pavement shown least, then the one
    with most damage.

    Args:
        places: to choose from; of each street of a town one at most is taken.
        shares: how many of each town.
    """
    chosen: list[Place] = []
    shown: Counter[str] = Counter()
    free = list(places)
    while free:

        def novelty(place: Place) -> tuple[int, bool, int, float]:
            new = sum(not shown[each] for each in (place.pavement, *place.markings))
            return new, not shown[place.title], -shown[place.pavement], place.damage_m2

        best = max(free, key=novelty)
        chosen.append(best)
        shown.update((best.pavement, best.title, *best.markings))
        full = {town for town, share in enumerate(shares) if sum(each.town == town for each in chosen) >= share}
        taken = {(each.town, each.street) for each in chosen}
        free = [each for each in free if each.town not in full and (each.town, each.street) not in taken]
    return sorted(chosen, key=lambda each: each.town)


def places_of(renderer: GalleryRenderer, town: int) -> Iterator[Place]:
    """Places along the streets of a town, where they have the pavement that they had from the start."""
    plan, world = renderer.plan, renderer.world
    painted = markings_of(plan)
    shapely.prepare(plan.road)
    wide = [each for each in world.defects if each.width_m >= LEAST_WIDTH_M]
    damage = np.array([(each.centre.x, each.centre.y) for each in wide]).reshape(-1, 2)
    area_m2 = np.array([each.area_m2 for each in wide])
    for segment, street in plan.segments:
        if segment.length_m < SHORTEST_M:
            continue
        for station in np.arange(0.0, segment.length_m, EVERY_M).tolist():
            at = segment.centre_line.interpolate(station)
            if plan.paved_at(at.x, at.y).material != plan.surface_of(street).material:
                continue
            ahead = np.array(direction_at(segment.centre_line, station))
            here, yaw = np.array([at.x, at.y]), math.atan2(ahead[1], ahead[0])
            if not shapely.contains_xy(plan.road, [here + ON_ROAD_M * ahead, here - ON_ROAD_M * ahead]).all():
                continue
            yield Place(
                town,
                segment.street,
                at.x,
                at.y,
                yaw,
                plan.pavement(street).title,
                plan.standard.title,
                frozenset(kind for kind, points in painted.items() if _in_sight(points, here, yaw).any()),
                float(area_m2[_in_sight(damage, here, yaw)].sum()),
            )


def markings_of(plan: GroundPlan) -> dict[str, Float]:
    """Middles (n, 2) of the paint of each kind: marks told by the width of their strokes, which no other paint has, and
    what a standard without a rule does not paint."""
    bars = plan.paint.bars[~plan.paint.is_former]
    found = {name: bars[np.isclose(2 * bars[:, 4], mark(name).width_m, atol=1e-6), :2] for name in MARKS}
    every = _middles(markings(plan, plan.standard))
    for rule in RULES:
        others = {tuple(each) for each in _middles(markings(plan, plan.standard.model_copy(update={rule: None})))}
        found[rule] = np.array([each for each in every.tolist() if tuple(each) not in others]).reshape(-1, 2)
    crossings = shapely.union_all([each.polygon for each in plan.world.crossings])
    found["crossing"] = bars[shapely.contains_xy(crossings, bars[:, :2]), :2]
    return found


def _middles(paint: Paint) -> Float:
    """(n, 2): of bars, outlines, and grooves."""
    outlines = [ring.mean(axis=0) for ring in paint.outlines]
    return np.concatenate([paint.bars[~paint.is_former, :2], np.reshape(outlines, (-1, 2)), paint.scars[:, :2]])


def _in_sight(points: Float, here: Float, yaw_rad: float) -> npt.NDArray[np.bool_]:
    """Which of points (n, 2) are seen from a place along a street."""
    ahead = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
    away = points - here
    along, across = away @ ahead, away @ np.array([-ahead[1], ahead[0]])
    return np.asarray((np.abs(along) < IN_SIGHT_M[0]) & (np.abs(across) < IN_SIGHT_M[1]))


def _cell(renderer: GalleryRenderer, place: Place, index: int) -> Picture:
    view = look(
        (place.x_m, place.y_m, ALTITUDE_M),
        yaw_rad=place.yaw_rad + math.pi / 2,
        pitch_rad=-math.pi / 2,
        size_px=TAKEN_PX,
        vertical_fov_rad=2 * math.atan(SHOWN_M[1] / 2 / ALTITUDE_M),
    )
    light = (OVERCAST, MORNING, OVERCAST, LOW_SUN, MORNING)[index % 5]
    taken = Image.fromarray(renderer.take(view, light, exposure=renderer.grey_card(light)))
    cell = np.asarray(taken.resize(CELL_PX, Image.Resampling.LANCZOS))
    return captioned(cell, place.title, height_px=CELL_PX[1])
