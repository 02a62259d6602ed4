"""A frame like each of several photographs: of its ground resolution, subject and lightness, over many streets."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image

from gallery.matched import SEEN, Pair, Photograph, darkness, flight_view, stored
from gallery.renderer import GREY, MORNING, OVERCAST, GalleryRenderer
from gallery.texture import SIDE_PX
from pavetwin.capture.daylight import MOST_COMPENSATION_EV
from pavetwin.defects.measures import extents_m
from pavetwin.errors import PaveTwinError
from pavetwin.training.datasets.markings import painted_lines
from pavetwin.world.model import Defect

SUNNY: Final = 8
"""One frame in so many is in the sun, the others are overcast: of 96 photographs of RDD2022's China drone subset that
were looked at, about ten show cast shadows."""

TRIES: Final = 16
"""Places at which damage that can be seen is looked for, with a painted line where the photograph has one."""
OF_STREET: Final = 3
"""Most of them on one street."""
FRAMES_OF_STREET: Final = 2
"""A street is in a third frame only where all others with such damage are in two."""
LEAST_WIDTH_PX: Final = 0.7
LEAST_LENGTH_PX: Final = 64.0
"""Widest opening and length of damage beside a labelled photograph, where the town has any: people label what they
see."""
SMALLEST: Final = 0.5
"""Damage of less than this share of them is taken last."""
INSIDE: Final = 0.8
"""Share of the half image within which what is to be seen lies."""
GREY_CODE: Final = 158.0
CODE_POWER: Final = 0.37
"""Grey level of a pavement of `GREY` in the open that is exposed for it, and how levels grow with the reflectance: of
40 places in the town with reflectances of 0.06 to 0.23, levels were 113 to 198."""

Place = tuple[float, float]
"""Easting and northing [m]."""


class FrameMatcher:
    """Takes a frame like each of several photographs."""

    def __init__(self, renderer: GalleryRenderer) -> None:
        self.renderer = renderer
        self._shown: dict[str, list[int]] = defaultdict(list)
        """The defects that frames were taken over, by street."""

    def frame_like(self, photograph: Photograph, index: int) -> Image.Image:
        """A frame of a photograph's ground resolution and size, over damage of its kind that can be seen, with a
        painted line if it has one (of `TRIES` places the first that fits, else that which fits best), stored as
        photographs are. Places on pavements nearest in lightness come first; what is left of the difference is made
        up by the exposure, as far as datasets vary it.

        Args:
            photograph: what is to be matched.
            index: another one gives another direction, speed and sky.

        Raises:
            PaveTwinError: the town has no damage of its kind.
        """
        light = OVERCAST if index % SUNNY else MORNING
        wanted = like_reflectance(photograph.picture)
        tried = []
        for defect, at in self._places(photograph, wanted):
            view = flight_view(self.renderer, defect, at, photograph.gsd_m, index, SIDE_PX)
            stops = math.log2(wanted / self._reflectance(defect))
            exposure = self.renderer.grey_card(light, min(max(stops, -MOST_COMPENSATION_EV), MOST_COMPENSATION_EV))
            frame = stored(Image.fromarray(self.renderer.take(view, light, exposure=exposure)))
            is_like = bool(painted_lines(np.asarray(frame))) == photograph.has_line
            contrast = SEEN if photograph.kind is None else min(SEEN, darkness(frame, view.project(_outline(defect))))
            tried.append(((is_like, contrast), defect, frame))
            if is_like and contrast >= SEEN:
                break
        if not tried:
            raise PaveTwinError(
                f"The town has no {photograph.kind or 'damage'} that a frame like {photograph.name} shows."
            )
        _, defect, frame = max(tried, key=lambda each: each[0])
        self._shown[self._street(defect)].append(defect.id)
        return frame

    def pairs(self, photographs: Iterable[Photograph]) -> list[Pair]:
        """Photographs with their frames."""
        return [(each, self.frame_like(each, index)) for index, each in enumerate(photographs)]

    def _places(self, photograph: Photograph, wanted: float) -> list[tuple[Defect, Place]]:
        """Where to try, best first: damage not shown yet, large enough, of streets shown least, on pavements nearest
        in reflectance; `OF_STREET` of a street at most."""
        half_m = 0.5 * SIDE_PX * photograph.gsd_m
        ranked = []
        for defect in self.renderer.world.defects:
            at = _aim(self.renderer, defect, half_m, with_line=photograph.has_line)
            if photograph.kind not in (None, defect.kind) or at is None:
                continue
            size = 1.0 if photograph.kind is None else _size(defect, photograph.gsd_m)
            shown = self._shown[self._street(defect)]
            stops = abs(math.log2(wanted / self._reflectance(defect)))
            rank = (defect.id in shown, size < SMALLEST, len(shown) // FRAMES_OF_STREET, size < 1, stops, -size)
            ranked.append((*rank, defect.id, defect, at))
        of_street: Counter[str] = Counter()
        places: list[tuple[Defect, Place]] = []
        for *_, defect, at in sorted(ranked, key=lambda each: each[:-2]):
            street = self._street(defect)
            of_street[street] += 1
            if of_street[street] <= OF_STREET:
                places.append((defect, at))
        return places[:TRIES]

    def _street(self, defect: Defect) -> str:
        return self.renderer.world.segment(defect.segment).street

    def _reflectance(self, defect: Defect) -> float:
        """Of the pavement around a defect."""
        return self.renderer.plan.paved_at(defect.centre.x, defect.centre.y).reflectance


def like_reflectance(picture: Image.Image) -> float:
    """The reflectance of a pavement that, exposed for `GREY`, comes out as light as half of a picture."""
    level = max(float(np.median(np.asarray(picture.convert("L")))), 1.0)
    return float(GREY * (level / GREY_CODE) ** (1 / CODE_POWER))


def _size(defect: Defect, gsd_m: float) -> float:
    """Whether damage is wide and long enough to be labelled in a photograph: 1, where it just is."""
    length_m = extents_m(defect.polygon)[0]
    return min(defect.width_m / (LEAST_WIDTH_PX * gsd_m), length_m / (LEAST_LENGTH_PX * gsd_m))


def _outline(defect: Defect) -> npt.NDArray[np.float64]:
    """Corners (n, 3) of a defect's outline, world frame."""
    corners = shapely.get_coordinates(defect.polygon.exterior)
    return np.column_stack([corners, np.zeros(len(corners))])


def _aim(renderer: GalleryRenderer, defect: Defect, half_m: float, *, with_line: bool) -> tuple[float, float] | None:
    """Where a camera sees a defect and, if it is to, the middle of its street; None where it cannot."""
    x, y = defect.centre.x, defect.centre.y
    if not with_line:
        return x, y
    line = renderer.world.segment(defect.segment).centre_line
    middle = line.interpolate(line.project(defect.centre))
    away = math.dist((x, y), (middle.x, middle.y))
    if away > 2 * INSIDE * half_m:
        return None
    share = min(0.5, INSIDE * half_m / max(away, 1e-9))
    return x + share * (middle.x - x), y + share * (middle.y - y)
