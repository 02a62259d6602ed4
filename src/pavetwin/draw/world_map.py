"""The map of the static world, drawn as a city plan. Other figures are drawn on top of it."""

from collections.abc import Collection, Sequence
from enum import StrEnum
from math import cos, sin
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.path import Path as MarkerPath
from matplotlib.typing import ColorType

from pavetwin.arrays import Float64Array
from pavetwin.draw import lettering, shapes, style
from pavetwin.draw.extent import credit, lane_lines, sidewalks, world_bounds
from pavetwin.draw.style import LegendEntry
from pavetwin.world.ground import Bounds
from pavetwin.world.model import Furniture, FurnitureKind, LaneKind, World

ABOVE_WORLD = 50
"""The lowest zorder above everything that `draw_world` draws."""


SHADOW_EAST, SHADOW_SOUTH, SHADOW_LONGEST_M = 0.16, 0.22, 5.0
"""Metres of shadow a metre of height; light comes from the north-west, as maps have it."""

TALL_M = 30.0
"""Buildings of this height and above have the darkest colour."""


_LETTER_H: Final = MarkerPath(
    [(-9, -10), (-9, 10), (-4, 10), (-4, 2.5), (4, 2.5), (4, 10), (9, 10), (9, -10), (4, -10), (4, -2.5), (-4, -2.5)]
    + [(-4, -10), (-9, -10)],
    closed=True,
)
"""A bold H, as on a pad. As text it would load Matplotlib's mathematics, a tenth of what a map takes."""


class MapLayer(StrEnum):
    """Layers of a map, from the ground up; base and names come last."""

    PARKS = "parks"
    BUILDINGS = "buildings"
    SIDEWALKS = "sidewalks"
    CARRIAGEWAYS = "carriageways"
    CROSSINGS = "crossings"
    MARKINGS = "markings"
    TREES = "trees"
    FURNITURE = "furniture"
    BASE = "base"
    STREET_NAMES = "street_names"


EVERYTHING = frozenset(MapLayer)


def draw_world(
    axes: Axes,
    world: World,
    *,
    bounds: Bounds | None = None,
    layers: Collection[MapLayer] = EVERYTHING,
    ids: bool = False,
    defects: bool = True,
    muted: bool = False,
) -> list[str]:
    """Draw a world into `axes`, which becomes a map in metres of the world frame.

    Finer details (lane lines, zebra crossings, masts, outlines of defects) depend on the scale. Everything has a zorder
    below `ABOVE_WORLD`.

    Args:
        bounds: what the map shows; the whole world when not given.
        ids: those of the segments, and where segments end.
        defects: a small mark for each, by class; their outlines where the scale allows.
        muted: paler, as a background.

    Returns:
        The ids that did not fit.
    """
    style.frame_axes(axes, bounds if bounds is not None else world_bounds(world))
    plan = _Plan(axes, world, muted)
    drawings = (plan.parks, plan.buildings, plan.sidewalks, plan.carriageways, plan.crossings, plan.markings)
    for layer, draw in zip(MapLayer, (*drawings, plan.trees, plan.furniture), strict=False):
        if layer in layers:
            draw()
    if defects:
        plan.defects()
    occupied, left_out = lettering.OccupiedSpace(), list[str]()
    if MapLayer.BASE in layers:
        base_symbol(axes, world)
        occupied.take(world.base.buffer(6.0 / plan.per_m))
    if ids:
        boundaries = [tick for s in world.segments for tick in shapes.ticks(s.centre_line, s.width_m / 2 + 0.6)]
        shapes.strokes(axes, boundaries, 38, style.BASE, 0.7)
        left_out = lettering.segment_ids(axes, world.segments, occupied)
    if MapLayer.STREET_NAMES in layers:
        if plan.per_m > 1.2:
            for crossing in world.crossings:
                occupied.take(crossing.polygon)
        lettering.write_street_names(axes, world, world.segments, occupied, style.INK_SOFT if muted else style.INK)
    return left_out


class _Plan:
    def __init__(self, axes: Axes, world: World, muted: bool) -> None:
        self.axes, self.world = axes, world
        self.per_m = shapes.points_per_m(axes)
        self._pale = 0.5 if muted else 0.0

    def shade(self, colour: ColorType) -> ColorType:
        return shapes.mix(colour, style.PAPER, self._pale)

    def parks(self) -> None:
        green = [shapely.union_all(shapely.buffer(self.world.parks, 0.05))]
        shapes.fill(self.axes, green, 1, self.shade(style.PARK), self.shade(style.PARK_EDGE), 0.5)

    def carriageways(self) -> None:
        face, edge = self.shade(style.CARRIAGEWAY), self.shade(style.CASING)
        shapes.fill(self.axes, [self.world.carriageway], 4, face, edge, 0.55)

    def buildings(self) -> None:
        houses = [self.world.buildings[i] for i in shapes.seen(self.axes, [b.polygon for b in self.world.buildings])]
        heights = np.array([house.height_m for house in houses])
        bases = [house.polygon for house in houses]
        cast = shapes.shadow(bases, heights, SHADOW_EAST, SHADOW_SOUTH, SHADOW_LONGEST_M)
        shapes.fill(self.axes, [cast], 5, self.shade(style.SHADOW), alpha=0.22)
        faces: list[ColorType] = [
            self.shade(shapes.mix(style.BUILDING_LOW, style.BUILDING_HIGH, min(1.0, float(height) / TALL_M)))
            for height in heights
        ]
        shapes.fill(self.axes, bases, 6, faces, self.shade(style.BUILDING_EDGE), 0.35)

    def sidewalks(self) -> None:
        face, edge = self.shade(style.SIDEWALK), self.shade(style.SIDEWALK_EDGE)
        shapes.fill(self.axes, [sidewalks(self.world)], 3, face, edge, 0.35)

    def crossings(self) -> None:
        bar_m = 0.5 if self.per_m > 2.0 else 1.0
        chosen = shapes.seen(self.axes, [crossing.polygon for crossing in self.world.crossings])
        bars = [bar for i in chosen for bar in shapes.stripes(self.world.crossings[i].polygon, bar_m, bar_m)]
        shapes.strokes(self.axes, bars, 4.2, self.shade(style.ZEBRA), bar_m * self.per_m)

    def markings(self) -> None:
        if self.per_m > 0.8:
            dash = (3 * self.per_m, 3 * self.per_m)
            shapes.strokes(self.axes, lane_lines(self.world), 4.3, self.shade(style.MARKING), 0.5, dash)

    def trees(self) -> None:
        trees = self._of(FurnitureKind.TREE)
        if not trees:
            return
        centres, radii = _centres(trees), np.array([tree.radius_m for tree in trees])
        shapes.discs(self.axes, centres + (0.5, -0.7), radii, 5.1, self.shade(style.SHADOW), alpha=0.16)
        face, edge = self.shade(style.TREE), self.shade(style.TREE_EDGE)
        shapes.discs(self.axes, centres, radii, 7, face, edge, 0.25, alpha=0.78)
        shapes.discs(self.axes, centres + radii[:, None] * (-0.22, 0.25), 0.55 * radii, 7.1, style.PAPER, alpha=0.16)

    def furniture(self) -> None:
        if self.per_m < 0.55:
            return
        arms = [item for item in self.world.furniture if item.arm_m > 0] if self.per_m > 2.0 else []
        feet = _centres(arms)
        reach = np.array([(item.arm_m * cos(item.yaw_rad), item.arm_m * sin(item.yaw_rad)) for item in arms])
        lines = np.stack([feet, feet + reach.reshape(-1, 2)], axis=1)
        shapes.strokes(self.axes, list(lines), 8, self.shade(style.POLE), 0.6)
        for kind, colour, marker, size in (
            (FurnitureKind.POLE, style.POLE, "o", 2.0),
            (FurnitureKind.SIGN, style.SIGN, "D", 2.0),
            (FurnitureKind.STREET_LIGHT, style.LAMP, "o", 2.6),
            (FurnitureKind.SIGNAL, style.SIGNAL, "^", 4.4),
        ):
            grown = size * min(2.0, max(0.55, self.per_m / 2.0))
            x, y = _centres(self._of(kind)).T
            self.axes.scatter(x, y, s=grown**2, marker=marker, color=self.shade(colour), linewidths=0, zorder=8.1)

    def defects(self) -> None:
        outlined = self.per_m > 4.0
        for kind, colour, marker in style.defect_styles(defect.kind for defect in self.world.defects):
            chosen = [defect for defect in self.world.defects if defect.kind == kind]
            if outlined:
                face, edge = shapes.mix(colour, style.PAPER, 0.35), self.shade(colour)
                shapes.fill(self.axes, [defect.polygon for defect in chosen], 10, face, edge, 0.5)
                continue
            x, y = np.array([(d.centre.x, d.centre.y) for d in chosen]).reshape(-1, 2).T
            size, rim_pt = 1.5 * max(0.6, self.per_m) ** 2, 0.5 * min(1.0, self.per_m) if marker == "_" else 0.0
            self.axes.scatter(x, y, s=size, marker=marker, color=self.shade(colour), linewidths=rim_pt, zorder=10)

    def _of(self, kind: FurnitureKind) -> list[Furniture]:
        (west, east), (south, north) = self.axes.get_xlim(), self.axes.get_ylim()
        return [
            item
            for item in self.world.furniture
            if item.kind is kind and west < item.position.x < east and south < item.position.y < north
        ]


def base_symbol(axes: Axes, world: World, zorder: float = ABOVE_WORLD - 1) -> None:
    x, y = world.base.x, world.base.y
    axes.plot(x, y, "o", ms=9, mfc=style.BASE, mec=style.PAPER, mew=0.8, zorder=zorder)
    axes.plot(x, y, marker=_LETTER_H, ms=4.6, mfc=style.PAPER, mec="none", zorder=zorder)


def save_world_map(world: World, path: Path, *, ids: bool = False) -> list[str]:
    """Write the map of a world as an image. Returns the ids that did not fit.

    Raises:
        PaveTwinError: it cannot be written.
    """
    with style.styled():
        bounds, about = world_bounds(world), subtitle(world)
        figure_ = style.map_figure(bounds, title=world.name, subtitle=about, credit=credit(world), legend=legend(world))
        left_out = draw_world(figure_.axes, world, bounds=bounds, ids=ids)
        style.save_figure(figure_.figure, path)
    return left_out


def subtitle(world: World) -> str:
    length_km = sum(segment.length_m for segment in world.segments) / 1000
    return (
        f"{len(world.segments)} segments, {length_km:.1f} km  ·  {len(world.buildings)} buildings  ·  "
        f"{len(world.defects)} defects"
    )


def legend(world: World) -> list[LegendEntry]:
    """Legend of the marks on the map of this world; only those that are on it."""
    found = {item.kind for item in world.furniture}
    classes = {defect.kind for defect in world.defects}
    entries = (
        (True, LegendEntry("carriageway", "patch", style.CARRIAGEWAY, style.CASING)),
        (world.lanes_of(LaneKind.SIDEWALK), LegendEntry("sidewalk", "patch", style.SIDEWALK, style.SIDEWALK_EDGE)),
        (world.buildings, LegendEntry("building", "patch", style.BUILDING, style.BUILDING_EDGE)),
        (world.parks, LegendEntry("park, green", "patch", style.PARK, style.PARK_EDGE)),
        (FurnitureKind.TREE in found, LegendEntry("tree", "o", style.TREE, style.TREE_EDGE, 6)),
        (FurnitureKind.STREET_LIGHT in found, LegendEntry("street light", "o", style.LAMP, size_pt=2.2)),
        (FurnitureKind.SIGNAL in found, LegendEntry("traffic signal", "^", style.SIGNAL, size_pt=3.6)),
        (True, LegendEntry("base", "o", style.BASE, size_pt=5.5)),
    )
    marks = [
        LegendEntry(defect_words(kind), marker, colour, size_pt=3.2)
        for kind, colour, marker in style.defect_styles(classes)
        if kind in classes
    ]
    return [entry for shown, entry in entries if shown] + marks


def defect_words(kind: str) -> str:
    """`single crack` for `single_crack`."""
    return kind.replace("_", " ")


def _centres(items: Sequence[Furniture]) -> Float64Array:
    return np.array([(item.position.x, item.position.y) for item in items], dtype=np.float64).reshape(-1, 2)
