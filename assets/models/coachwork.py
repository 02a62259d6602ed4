"""Bodies that are boxes with rounded edges: truck cabs and buses, and what is painted on them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from assets.models.car_build import GAP, GAP_M, PAINT, SHADED, TRIM, gate
from assets.models.common import Floats
from assets.models.fields import polygon_distance, rounded, smooth_max
from assets.models.implicit import Field, Skin, mesh


@dataclass(frozen=True, slots=True)
class Coach:
    """A box between x0 and x1 and between two heights, in metres, its front leaning back above `brow_m`."""

    rear_x: float
    front_x: float
    half_m: float
    floor_m: float
    top_m: float
    brow_m: float
    lean: float
    """How far the front goes back, a metre of height above the brow."""
    front_bow_m: float = 0.16
    rear_bow_m: float = 0.05
    tumblehome: float = 0.03
    crown: float = 0.03
    corner_m: float = 0.16
    """Rounding of the upright edges."""
    rail_m: float = 0.22
    """Rounding between roof and sides."""
    arches: Sequence[tuple[float, float, float]] = ()
    """(x, z, radius) of the wheel arches."""

    def front(self, p: Floats) -> Floats:
        """Distance before the front."""
        rise = smooth_max(p[:, 2] - self.brow_m, np.zeros(len(p)), 0.25)
        share = np.minimum(np.abs(p[:, 1]) / self.half_m, 1.1)
        return np.asarray(
            (p[:, 0] - self.front_x + self.lean * rise + self.front_bow_m * share**4) / np.hypot(1.0, self.lean)
        )

    def side(self, p: Floats) -> Floats:
        return np.asarray(np.abs(p[:, 1]) - self.half_m + self.tumblehome * np.maximum(p[:, 2] - self.brow_m, 0.0))

    def over(self, p: Floats) -> Floats:
        return np.asarray(p[:, 2] - self.top_m + self.crown * p[:, 1] ** 2)

    def field(self, p: Floats) -> Floats:
        share = np.minimum(np.abs(p[:, 1]) / self.half_m, 1.1)
        rear = self.rear_x - p[:, 0] + self.rear_bow_m * share**4
        around = smooth_max(smooth_max(self.front(p), rear, 0.1), self.side(p), self.corner_m)
        return smooth_max(smooth_max(around, self.over(p), self.rail_m), self.floor_m - p[:, 2], 0.05)


class CoachBody:
    """One half (y ≥ 0) of a coach as it is being painted. Outlines are polygons with rounded corners."""

    def __init__(self, shape: Coach, triangles: int, cell_m: float = 0.06) -> None:
        self.shape = shape
        low = np.array([shape.rear_x - 0.2, -shape.half_m - 0.2, shape.floor_m - 0.2])
        high = np.array([shape.front_x + 0.2, shape.half_m + 0.2, shape.top_m + 0.2])
        self.skin: Skin = mesh(shape.field, low, high, cell_m, triangles)
        self.skin.keep(self.skin.cut(lambda p: -p[:, 1]) < 0.0)
        self.skin.vertices[np.abs(self.skin.vertices[:, 1]) < 1e-4, 1] = 0.0

    def on_side(
        self, outline: Sequence[Sequence[float]], label: int, radius: float = 0.05, frame_m: float = 0.0
    ) -> None:
        """Fills (x, z) on the side; with `frame_m`, a dark frame about it."""
        self._fill(self._shape(outline, radius, (0, 2), self._beside), label, frame_m)

    def on_front(
        self, outline: Sequence[Sequence[float]], label: int, radius: float = 0.05, frame_m: float = 0.0
    ) -> None:
        """Fills (|y|, z) on the front."""
        self._fill(self._shape(outline, radius, (1, 2), self._before), label, frame_m)

    def on_rear(
        self, outline: Sequence[Sequence[float]], label: int, radius: float = 0.05, frame_m: float = 0.0
    ) -> None:
        """Fills (|y|, z) on the rear."""
        self._fill(self._shape(outline, radius, (1, 2), self._behind), label, frame_m)

    def gaps_on_side(self, *outlines: Sequence[Sequence[float]], radius: float = 0.05) -> None:
        for outline in outlines:
            self._gap(self._shape(outline, radius, (0, 2), None), self._beside)

    def gaps_on_front(self, *outlines: Sequence[Sequence[float]], radius: float = 0.05) -> None:
        for outline in outlines:
            self._gap(self._shape(outline, radius, (1, 2), None), self._before)

    def gaps_on_rear(self, *outlines: Sequence[Sequence[float]], radius: float = 0.05) -> None:
        for outline in outlines:
            self._gap(self._shape(outline, radius, (1, 2), None), self._behind)

    def panes_on_side(self, spans: Sequence[tuple[float, float]], low: float, high: float, label: int) -> None:
        """Fills rectangles on the side, each from one x to another and all between two heights, their corners sharp.

        Cut along planes: many rounded outlines at once would take many times the triangles.
        """
        for x in sorted({x for span in spans for x in span}):
            self.skin.cut(partial(_beyond, axis=0, at=x))
        for z in (low, high):
            self.skin.cut(partial(_beyond, axis=2, at=z))
        middles = self.skin.centres()
        inside = (middles[:, 2] > low) & (middles[:, 2] < high) & (self._beside(middles) < 0.0)
        within = np.any([(middles[:, 0] > start) & (middles[:, 0] < end) for start, end in spans], axis=0)
        self.skin.labels[inside & within] = label

    def covered_on_roof(self, outlines: Sequence[Sequence[Sequence[float]]], about_m: float = 0.16) -> None:
        """Takes the roof away under things of outlines (x, |y|), and cuts it `about_m` around them."""
        shapes = [self._shape(outline, 0.03, (0, 1), lambda p: -self.shape.over(p) - 0.12) for outline in outlines]
        for margin, label in ((about_m, SHADED), (-0.02, -1)):
            self.skin.paint(partial(_union, shapes=shapes, margin=margin), label, (0, SHADED))

    def seams_on_roof(self, places: Sequence[float]) -> None:
        """Seams across the roof at each x."""
        for x in places:
            self._gap(partial(_beyond, axis=0, at=x), lambda p: -self.shape.over(p) - 0.12)

    def opened(self) -> Skin:
        """The skin without its wheel arches and without what looks down."""
        shape, skin = self.shape, self.skin
        for x, z, radius in shape.arches:
            skin.paint(partial(self._arch, x=x, z=z, radius=radius), -1)
        down = skin.normals()[skin.triangles][:, :, 2].mean(axis=1) < -0.7
        skin.keep((skin.labels >= 0) & ~(down & (skin.centres()[:, 2] < shape.floor_m + 0.1)))
        return skin

    def _arch(self, p: Floats, x: float, z: float, radius: float) -> Floats:
        return gate(np.hypot(p[:, 0] - x, p[:, 2] - z) - radius, self.shape.half_m - 0.5 - p[:, 1])

    def _beside(self, p: Floats) -> Floats:
        return -self.shape.side(p) - 0.10

    def _before(self, p: Floats) -> Floats:
        return -self.shape.front(p) - 0.10

    def _behind(self, p: Floats) -> Floats:
        return np.asarray(p[:, 0] - self.shape.rear_x - 0.25)

    def _shape(
        self, outline: Sequence[Sequence[float]], radius: float, axes: tuple[int, int], limit: Field | None
    ) -> Callable[[Floats], Floats]:
        curve = rounded(outline, radius)

        def shape(p: Floats) -> Floats:
            distance = polygon_distance(curve, p[:, axes[0]], p[:, axes[1]])
            return gate(distance, limit(p)) if limit else distance

        return shape

    def _fill(self, shape: Field, label: int, frame_m: float) -> None:
        if frame_m:
            self.skin.paint(shape, TRIM)
        self.skin.paint(lambda p: shape(p) + frame_m, label)

    def _gap(self, shape: Field, where: Field) -> None:
        self.skin.stroke(shape, GAP_M, GAP, where, (PAINT, SHADED))


def _beyond(p: Floats, axis: int, at: float) -> Floats:
    return p[:, axis] - at


def _union(p: Floats, shapes: Sequence[Field], margin: float = 0.0) -> Floats:
    """Several shapes as one, wider by `margin`."""
    return np.asarray(np.min([shape(p) for shape in shapes], axis=0) - margin)


def box_outline(a0: float, a1: float, b0: float, b1: float) -> list[tuple[float, float]]:
    """The outline of a rectangle."""
    return [(a0, b0), (a1, b0), (a1, b1), (a0, b1)]
