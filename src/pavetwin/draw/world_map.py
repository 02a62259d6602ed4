"""The map of a world: what stands still, drawn as a city plan. Other pictures are drawn on top of it."""

from collections.abc import Collection, Iterable, Sequence
from enum import StrEnum
from pathlib import Path

import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PathCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.path import Path as Outline
from shapely import Geometry

from pavetwin.draw import style
from pavetwin.draw.style import Bounds
from pavetwin.world.model import FurnitureKind, LaneKind, World

ABOVE_WORLD = 50
"""The lowest zorder above everything that `draw_world` draws."""

MARGIN_M = 12.0


class Layer(StrEnum):
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


EVERYTHING = frozenset(Layer)

_HEIGHTS = LinearSegmentedColormap.from_list("heights", [style.BUILDING_LOW, style.BUILDING_HIGH])
_TALL_M = 30.0


def world_bounds(world: World, margin_m: float = MARGIN_M) -> Bounds:
    """What a map of the whole world shows: its streets and buildings and a margin, in metres."""
    shapes = [segment.polygon for segment in world.segments] + [building.polygon for building in world.buildings]
    west, south, east, north = (float(value) for value in shapely.total_bounds(shapes))
    return west - margin_m, south - margin_m, east + margin_m, north + margin_m


def draw_world(
    axes: Axes,
    world: World,
    *,
    bounds: Bounds | None = None,
    layers: Collection[Layer] = EVERYTHING,
    names: bool = False,
    defects: bool = True,
    muted: bool = False,
) -> None:
    """Draw a world into `axes`, which becomes a map in metres of the world frame.

    Args:
        bounds: what the map shows; the whole world when not given.
        names: segment ids and boundaries.
        defects: a small mark for each, by class; their outlines where the scale allows.
        muted: paler, as a ground for other things.
    """
    style.frame_axes(axes, bounds if bounds is not None else world_bounds(world))
    alpha = 0.55 if muted else 1.0
    if Layer.PARKS in layers:
        _fill(axes, world.parks, 1, style.PARK, style.PARK_EDGE, 0.4, alpha)
    if Layer.SIDEWALKS in layers:
        walks = [
            lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane in world.lanes_of(LaneKind.SIDEWALK)
        ]
        _fill(axes, walks, 2, style.SIDEWALK, style.SIDEWALK_EDGE, 0.3, alpha)
    if Layer.CARRIAGEWAYS in layers:
        roads: list[Geometry] = [segment.polygon for segment in world.segments]
        roads += [junction.polygon for junction in world.junctions]
        whole = shapely.union_all(shapely.buffer(roads, 0.05))
        _fill(axes, [whole], 3, style.CARRIAGEWAY, style.CASING, 0.6, alpha)
    if Layer.BUILDINGS in layers:
        heights = np.array([building.height_m for building in world.buildings])
        colours = _HEIGHTS(np.clip(heights / _TALL_M, 0, 1))
        _fill(axes, [b.polygon for b in world.buildings], 5, colours, style.BUILDING_EDGE, 0.35, alpha)
    if Layer.TREES in layers:
        trees = [thing for thing in world.furniture if thing.kind is FurnitureKind.TREE]
        _discs(axes, [(t.position.x, t.position.y) for t in trees], [t.radius_m for t in trees], 7, style.TREE, alpha)
    if defects:
        for kind, colour in style.DEFECT_COLOURS.items():
            spots = np.array([(d.centre.x, d.centre.y) for d in world.defects if d.kind is kind]).reshape(-1, 2)
            axes.scatter(
                spots[:, 0], spots[:, 1], s=2.5, marker=style.DEFECT_MARKERS[kind], color=colour, linewidths=0.4,
                alpha=alpha, zorder=10,
            )  # fmt: skip
    if names:
        for segment in world.segments:
            middle = segment.centre_line.interpolate(0.5, normalized=True)
            text = axes.text(middle.x, middle.y, segment.id, fontsize=4.5, ha="center", va="center", zorder=45)
            text.set_path_effects(style.halo())
    if Layer.BASE in layers:
        base_symbol(axes, world)


def base_symbol(axes: Axes, world: World, zorder: float = ABOVE_WORLD - 1) -> None:
    """The landing pad: an H in a disc."""
    axes.plot(world.base.x, world.base.y, "o", ms=9, mfc=style.BASE, mec=style.PAPER, mew=0.8, zorder=zorder)
    axes.plot(
        world.base.x, world.base.y, marker="$H$", ms=4.5, mfc=style.PAPER, mec=style.PAPER, mew=0.3, zorder=zorder
    )


def save_world_map(world: World, path: Path, *, names: bool = False) -> None:
    """Write the map of a whole world as a picture.

    Raises:
        PaveTwinError: it cannot be written.
    """
    with style.styled():
        bounds = world_bounds(world)
        sheet = style.map_sheet(bounds, title=world.name)
        draw_world(sheet.axes, world, bounds=bounds, names=names)
    style.save_figure(sheet.figure, path)


def outline(shape: Geometry) -> Outline:
    """A polygon, or several, with their holes, as one path."""
    rings = [
        np.asarray(ring.coords)[:, :2]
        for part in shapely.get_parts(shape)
        if isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    return Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings if len(ring)))


def _fill(
    axes: Axes,
    shapes: Sequence[Geometry],
    zorder: float,
    face: str | npt.NDArray[np.float64],
    edge: str,
    width_pt: float,
    alpha: float,
) -> None:
    paths = [outline(shape) for shape in shapes]
    axes.add_collection(
        PathCollection(paths, facecolors=face, edgecolors=edge, linewidths=width_pt, alpha=alpha, zorder=zorder),
        autolim=False,
    )


def _discs(
    axes: Axes, centres: Iterable[tuple[float, float]], radii: Iterable[float], zorder: float, face: str, alpha: float
) -> None:
    sizes = 2 * np.fromiter(radii, dtype=np.float64)
    axes.add_collection(
        EllipseCollection(
            sizes, sizes, np.zeros_like(sizes), units="xy", offsets=np.array(list(centres)).reshape(-1, 2),
            offset_transform=axes.transData, facecolors=face, linewidths=0, alpha=0.8 * alpha, zorder=zorder,
        ),
        autolim=False,
    )  # fmt: skip


def _lines(axes: Axes, lines: Sequence[npt.ArrayLike], zorder: float, colour: str, width_pt: float) -> None:
    axes.add_collection(LineCollection(list(lines), colors=colour, linewidths=width_pt, zorder=zorder), autolim=False)
