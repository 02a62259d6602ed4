"""The map of a world as one HTML file with pan, zoom and tooltips. It loads nothing from the network."""

from collections import Counter
from collections.abc import Iterable
from html import escape
from pathlib import Path

import numpy as np
import shapely
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.colors import to_hex
from shapely import Geometry, Polygon

from pavetwin.draw import lettering, shapes, style
from pavetwin.draw.extent import credit, lane_lines, sidewalks, world_bounds
from pavetwin.draw.world_map import TALL_M, defect_words, legend, subtitle
from pavetwin.files import writing
from pavetwin.world.model import FurnitureKind, World

_STEPS = 6  # Number of shades of buildings by height, one path each
_NAMED_AGAIN_M = 90.0  # A street's name stands on its longest segment, and on every other one that is longer than this
_FINE_M = 0.03  # Tolerance of the simplified outlines of defects
_MASTS = {FurnitureKind.STREET_LIGHT: style.LAMP, FurnitureKind.SIGNAL: style.SIGNAL, FurnitureKind.SIGN: style.SIGN}


def save_world_html(world: World, path: Path) -> None:
    """Write the interactive map of a world.

    Raises:
        PaveTwinError: it cannot be written. Nothing is left behind.
    """
    page = world_page(world)
    with writing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def world_page(world: World) -> str:
    west, south, east, north = world_bounds(world)
    flip = _Flip(west, north)
    environment = Environment(
        loader=PackageLoader("pavetwin.draw", "."),
        autoescape=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
    )
    return environment.get_template("world_map.html").render(
        title=world.name,
        subtitle=subtitle(world),
        credit=credit(world) or "",
        view=f"0 0 {east - west:.1f} {north - south:.1f}",
        layers="\n".join(_layers(world, flip)),
        legend=legend(world),
        origin=[west, north],
        ground=style.GROUND,
        ink=style.INK,
        accent=style.BASE,
    )


class _Flip:
    """World coordinates to the page's: metres from the upper left corner, y down, in decimetres' precision."""

    def __init__(self, west: float, north: float) -> None:
        self._west, self._north = west, north

    def point(self, x: float, y: float) -> tuple[str, str]:
        return _number(x - self._west), _number(self._north - y)

    def path(self, surface: Geometry) -> str:
        """The `d` of a path for polygons with their holes, or for lines, in metres."""
        written = []
        for part in shapely.get_parts(surface):
            for ring in (part.exterior, *part.interiors) if isinstance(part, Polygon) else (part,):
                points = shapely.get_coordinates(ring)
                closed = isinstance(part, Polygon)
                steps = (" ".join(self.point(x, y)) for x, y in (points[:-1] if closed else points))
                written.append("M" + "L".join(steps) + ("Z" if closed else ""))
        return "".join(written)

    def outline_cm(self, polygon: Polygon) -> str:
        """The `d` of a small polygon in whole centimetres, as short as it goes."""
        points = shapely.get_coordinates(polygon.exterior)[:-1]
        rounded = np.rint((points - (self._west, self._north)) * (100, -100)).astype(int)
        steps = "l".join(f"{x} {y}" for x, y in np.diff(rounded, axis=0))
        return f"M{rounded[0, 0]} {rounded[0, 1]}l{steps}z".replace(" -", "-")


def _layers(world: World, flip: _Flip) -> Iterable[str]:
    """The map from the ground up, one group per layer."""
    parks = shapely.union_all(shapely.buffer(world.parks, 0.05)) if world.parks else Polygon()
    yield _shape(flip.path(parks), style.PARK, style.PARK_EDGE, 0.4)
    yield _shape(flip.path(sidewalks(world)), style.SIDEWALK, style.SIDEWALK_EDGE, 0.25)
    yield _shape(flip.path(world.carriageway), style.CARRIAGEWAY, style.CASING, 0.35)
    bars = [shapely.LineString(bar) for c in world.crossings for bar in shapes.stripes(c.polygon, 0.5, 0.5)]
    yield f"<path d='{flip.path(shapely.MultiLineString(bars))}' stroke='{style.ZEBRA}' stroke-width='.5' fill='none'/>"
    dashes = shapely.MultiLineString([shapely.LineString(line) for line in lane_lines(world)])
    pattern = "stroke-width='.15' stroke-dasharray='3 3' fill='none'"
    yield f"<path d='{flip.path(dashes)}' stroke='{style.MARKING}' {pattern}/>"
    yield from _buildings(world, flip)
    yield from _segments(world, flip)
    yield from _defects(world, flip)
    yield from _furniture(world, flip)
    yield from _lettering(world, flip)
    x, y = flip.point(world.base.x, world.base.y)
    yield (
        f"<g class='base' data-tip='base' transform='translate({x} {y})'><circle r='4' fill='{style.BASE}'/>"
        "<path d='M-1.4 -2V2M1.4 -2V2M-1.4 0H1.4' stroke='#fff' stroke-width='.8' fill='none'/></g>"
    )


def _buildings(world: World, flip: _Flip) -> Iterable[str]:
    steps = [min(_STEPS - 1, int(building.height_m / TALL_M * _STEPS)) for building in world.buildings]
    for step in sorted(set(steps)):
        bases = [building.polygon for building, own in zip(world.buildings, steps, strict=True) if own == step]
        shade = to_hex(shapes.mix(style.BUILDING_LOW, style.BUILDING_HIGH, (step + 0.5) / _STEPS))
        yield _shape("".join(flip.path(base) for base in bases), shade, style.BUILDING_EDGE, 0.2)


def _segments(world: World, flip: _Flip) -> Iterable[str]:
    counts = Counter(defect.segment for defect in world.defects)
    yield "<g class='segments'>"
    for segment in world.segments:
        lanes = "1 lane" if segment.lanes == 1 else f"{segment.lanes} lanes"
        latin = world.latin_name_of(segment)
        other = f" ({latin})" if latin != segment.street else ""
        tip = (
            f"{segment.label}{other}\n{segment.length_m:.0f} m × {segment.width_m:.1f} m, {lanes}, "
            f"{segment.area_m2:.0f} m²\n{counts[segment.id]} defects"
        )
        yield f"<path d='{flip.path(segment.polygon)}' data-tip='{_attribute(tip)}'/>"
    yield "</g>"


def _defects(world: World, flip: _Flip) -> Iterable[str]:
    """One group per class; the page takes the words from the group and the numbers from the mark."""
    yield "<g class='defects'>"
    for kind, colour, _ in style.defect_styles(defect.kind for defect in world.defects):
        yield f"<g transform='scale(.01)' fill='{colour}' stroke='{colour}' data-kind='{defect_words(kind)}'>"
        for defect in world.defects:
            if defect.kind == kind:
                shape = flip.outline_cm(shapely.simplify(defect.polygon, _FINE_M))
                yield f"<path d='{shape}' data-d='{defect.id},{_attribute(defect.segment)}'/>"
        yield "</g>"
    yield "</g>"


def _furniture(world: World, flip: _Flip) -> Iterable[str]:
    yield f"<g fill='{style.TREE}' fill-opacity='.75' stroke='{style.TREE_EDGE}' stroke-width='.2'>"
    masts = []
    for item in world.furniture:
        x, y = flip.point(item.position.x, item.position.y)
        if item.kind is FurnitureKind.TREE:
            yield f"<circle cx='{x}' cy='{y}' r='{_number(item.radius_m)}'/>"
            continue
        reach = item.arm_m * np.array([np.cos(item.yaw_rad), -np.sin(item.yaw_rad)])
        arm = f"<path d='M{x} {y}l{_number(reach[0])} {_number(reach[1])}'/>" if item.arm_m > 0 else ""
        tip = f"{item.kind.value.replace('_', ' ')}, {item.height_m:.1f} m"
        colour = _MASTS.get(item.kind, style.POLE)
        masts.append(f"{arm}<circle cx='{x}' cy='{y}' r='.6' fill='{colour}' data-tip='{tip}'/>")
    yield "</g><g class='masts'>"
    yield from masts
    yield "</g>"


def _lettering(world: World, flip: _Flip) -> Iterable[str]:
    """Street names along their streets, and ids next to them."""
    yield "<g class='streets'>"
    number = 0
    for name, pieces in lettering.streets(world.segments, {s.id: s.street for s in world.segments}).items():
        ordered = sorted(pieces, key=lambda segment: -segment.length_m)
        for segment in (s for place, s in enumerate(ordered) if place == 0 or s.length_m > _NAMED_AGAIN_M):
            size = min(4.5, 0.7 * segment.width_m)
            if style.text_width_pt(name, size) * 1.1 > segment.length_m:
                continue
            points = shapely.get_coordinates(segment.centre_line)
            line = segment.centre_line.reverse() if points[-1, 0] < points[0, 0] else segment.centre_line
            yield f"<path id='street{number}' d='{flip.path(line)}' fill='none'/>"
            yield (
                f"<text style='--size:{_number(size)}px' dy='.35em'><textPath href='#street{number}' "
                f"startOffset='50%'>{escape(name)}</textPath></text>"
            )
            number += 1
    yield "</g><g class='ids'>"
    for segment in world.segments:
        place = segment.centre_line.interpolate(0.2, normalized=True)
        x, y = flip.point(place.x, place.y)
        yield f"<text x='{x}' y='{y}'>{escape(segment.id)}</text>"
    yield "</g>"


def _shape(path: str, fill: str, stroke: str, width_m: float) -> str:
    return f"<path d='{path}' fill='{fill}' fill-rule='evenodd' stroke='{stroke}' stroke-width='{width_m}'/>"


def _attribute(text: str) -> str:
    return escape(text, quote=True).replace("\n", "&#10;")


def _number(value: float) -> str:
    """A number to a decimetre, without needless zeros."""
    text = f"{value:.1f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text
