"""Map labels: names that follow their streets, ids on their segments, without overlaps.

Positions are metres of the world frame; sizes of type are points of paper.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import product
from math import ceil, hypot

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.path import Path as Outline
from matplotlib.textpath import TextPath
from matplotlib.transforms import Affine2D
from shapely import Geometry, LineString, Polygon, affinity

from pavetwin.arrays import Float64Array
from pavetwin.draw import style
from pavetwin.draw.fonts import font_properties, joins, runs_left, shown_names
from pavetwin.draw.shapes import fill, points_per_m
from pavetwin.world.model import Segment, World

SMALLEST_PT, LARGEST_PT = 4.4, 8.0
"""Height of a street's name."""

_ID_PT = 4.4
_FROM_END_PT = 2.0
"""Between the end of a segment and the plate of its id."""

_GAP_M = 45.0  # Parts of one street farther apart than this are labelled separately
_MAX_TURN = np.radians(75)
_MAX_TURN_AT_ONCE = np.radians(11)
_STEEP = np.radians(80)
"""Steeper than this, all lettering reads upwards."""

_REPEAT_PT = 420.0


class OccupiedSpace:
    """The parts of the map that labels have taken already."""

    def __init__(self) -> None:
        self.taken: list[Geometry] = []

    def free(self, shape: Polygon) -> bool:
        return not self.taken or not bool(shapely.intersects(np.array(self.taken, dtype=object), shape).any())

    def take(self, shape: Geometry) -> None:
        self.taken.append(shape)


def segment_ids(axes: Axes, segments: Iterable[Segment], occupied: OccupiedSpace) -> list[str]:
    """Write the id of each segment on it, in a small plate near one of its ends, which leaves room for a street's name.

    Returns:
        Those that did not fit.
    """
    per_m = points_per_m(axes)
    left_out = []
    for segment in segments:
        half_w = (style.text_width_pt(segment.id, _ID_PT, bold=True) / 2 + 1.4) / per_m
        half_h = (_ID_PT / 2 + 1.2) / per_m
        end = (half_w + _FROM_END_PT / per_m) / segment.length_m
        for share in (end, 1 - end, 0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8):
            x, y, angle = _upright_pose(segment.centre_line, share * segment.length_m)
            level = shapely.box(x - half_w, y - half_h, x + half_w, y + half_h)
            plate = affinity.rotate(level, angle, use_radians=True)
            if _inside(axes, plate) and occupied.free(plate):
                occupied.take(plate.buffer(0.8 / per_m))
                _plate(axes, segment.id, x, y, np.degrees(angle))
                break
        else:
            left_out.append(segment.id)
    return left_out


def write_street_names(
    axes: Axes,
    world: World,
    segments: Sequence[Segment],
    occupied: OccupiedSpace,
    colour: str = style.INK,
    zorder: float = 40,
) -> list[str]:
    """Write the name of each street of some segments along it, repeated on a long one, where it fits.

    Returns:
        The names that did not fit, as they would be written (`shown_names`).
    """
    per_m = points_per_m(axes)
    glyphs: list[Outline] = []
    spines: list[Polygon] = []
    left_out = []
    for name, pieces in streets(segments, shown_names(world)).items():
        width_m = min(segment.width_m for segment in pieces)
        size = float(np.clip(0.72 * width_m * per_m, SMALLEST_PT, LARGEST_PT))
        before = len(glyphs)
        for line in chains([segment.centre_line for segment in pieces]):
            for letters, spine in _along(axes, line, name, size, per_m, occupied):
                glyphs += letters
                spines.append(spine.buffer(min(0.4 * size / per_m, 0.4 * width_m), cap_style="flat"))
        if len(glyphs) == before:
            left_out.append(name)
    # Lane lines between two words would read as hyphens.
    fill(axes, spines, 4.5, style.CARRIAGEWAY)
    for face, edge, width in ((style.PAPER, style.PAPER, 1.5), (colour, "none", 0.0)):
        fill(axes, glyphs, zorder, face, edge, width, alpha=0.9)
    return left_out


def streets(segments: Iterable[Segment], names: Mapping[str, str]) -> dict[str, list[Segment]]:
    """The segments of each street that has a name, by the name that `names` gives each segment's id; the longest
    street first."""
    found: dict[str, list[Segment]] = {}
    for segment in segments:
        if segment.has_street_name and any(letter.isalpha() for letter in segment.street):
            found.setdefault(names[segment.id], []).append(segment)
    lengths = {name: sum(segment.length_m for segment in pieces) for name, pieces in found.items()}
    return {name: found[name] for name in sorted(found, key=lambda name: (-lengths[name], name))}


def chains(lines: Iterable[LineString]) -> list[LineString]:
    """Lines joined across junctions where one continues in about the direction of the other."""
    open_ends = [shapely.get_coordinates(line) for line in lines]
    joined = []
    while open_ends:
        line = open_ends.pop(0)
        while (best := _continuation(line, open_ends)) is not None:
            index, line, other = best
            open_ends.pop(index)
            line = np.concatenate([line, other])
        joined.append(LineString(line))
    return sorted(joined, key=lambda chain: -chain.length)


def _continuation(line: Float64Array, others: Sequence[Float64Array]) -> tuple[int, Float64Array, Float64Array] | None:
    """The nearest line that continues an end of `line`: its index, and both lines, reversed where needed."""
    best, nearest = None, _GAP_M
    for index, other in enumerate(others):
        for a, b in product((line, line[::-1]), (other, other[::-1])):
            gap, ahead = hypot(*(b[0] - a[-1])), a[-1] - a[-2]
            straight = gap < 4 or abs(_turn(ahead, b[0] - a[-1])) < np.radians(20)
            if gap < nearest and straight and abs(_turn(ahead, b[1] - b[0])) < np.radians(40):
                best, nearest = (index, a, b), gap
    return best


def _along(
    axes: Axes, line: LineString, name: str, size: float, per_m: float, occupied: OccupiedSpace
) -> list[tuple[list[Outline], LineString]]:
    """A name along a line, as often as it is long: its glyphs and the line that they stand on."""
    spaced = size * 0.08
    pieces = _pieces(name)
    ends = range(len(pieces) + 1)
    advances = np.array([style.text_width_pt("".join(pieces[:end]), size) + spaced * end for end in ends]) / per_m
    length = float(advances[-1])
    if line.length < length * 1.05:
        return []
    found = []
    times = max(1, round(line.length * per_m / _REPEAT_PT))
    for number in range(times):
        centred = (number + 0.5) / times * line.length - length / 2
        reach = line.length / times / 2
        for shift in sorted(np.linspace(-reach, reach, max(3, ceil(reach / 3)) | 1), key=abs):
            start = centred + float(shift)
            if start < 0 or start + length > line.length:
                continue
            written = _write(axes, line, pieces, size / per_m, advances, start, occupied)
            if written is not None:
                found.append(written)
                break
    return found


def _write(
    axes: Axes,
    line: LineString,
    pieces: Sequence[str],
    size_m: float,
    advances: Float64Array,
    start: float,
    occupied: OccupiedSpace,
) -> tuple[list[Outline], LineString] | None:
    """The name from `start` metres along the line, or nothing where that bends too much or is taken."""
    length = float(advances[-1])
    first, last = line.interpolate(start), line.interpolate(start + length)
    level = abs(last.x - first.x) > length * np.cos(_STEEP)
    backwards = last.x < first.x if level else last.y < first.y
    middles = (advances[:-1] + advances[1:]) / 2
    spots = start + (length - middles if backwards else middles)
    places, directions = _poses(line, spots, size_m * 1.2)
    angles = np.unwrap(directions + (np.pi if backwards else 0.0))
    turns = np.abs(np.diff(angles))
    if np.ptp(angles) > _MAX_TURN or (len(turns) and turns.max() > _MAX_TURN_AT_ONCE):
        return None
    # A single piece has one pose, which makes no line.
    spine = LineString(places if len(places) > 1 else [first, last])
    strip = spine.buffer(0.62 * size_m)
    if not _inside(axes, strip) or not occupied.free(strip):
        return None
    occupied.take(strip)
    glyphs = []
    for piece, (x, y), angle, left, middle in zip(pieces, places, angles, advances[:-1], middles, strict=True):
        if piece != " ":
            place = Affine2D().scale(size_m).translate(left - middle, -0.36 * size_m).rotate(angle).translate(x, y)
            glyphs.append(_outline(piece).transformed(place))
    return glyphs, spine


def _pieces(name: str) -> list[str]:
    """Units of a name that are placed as a whole, from left to right: letters, or words where letters join."""
    if not joins(name):
        return list(name)
    pieces = re.split("( )", name)
    return pieces[::-1] if runs_left(name) else pieces


def _poses(line: LineString, at_m: Float64Array, window_m: float) -> tuple[Float64Array, Float64Array]:
    """Positions (n, 2) and directions (n,) of a line (radians, counter-clockwise from east), smoothed over a window.

    Args:
        at_m: (n,) along the line.
    """
    spots = np.clip(at_m[:, None] + np.linspace(-1, 1, 5) * window_m, 0, line.length)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, spots)).reshape(-1, 5, 2)
    ahead = points[:, -1] - points[:, 0]
    return points.mean(axis=1), np.arctan2(ahead[:, 1], ahead[:, 0])


def _upright_pose(line: LineString, at_m: float) -> tuple[float, float, float]:
    """Position and direction of a line, as of `_poses`, in which a text does not stand on its head."""
    places, directions = _poses(line, np.array([at_m]), 6.0)
    (x, y), angle = places[0].tolist(), float(directions[0])
    if not -_STEEP < angle <= np.pi - _STEEP:
        angle += np.pi if angle <= 0 else -np.pi
    return x, y, angle


def _turn(a: Float64Array, b: Float64Array) -> float:
    return float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b))


def _inside(axes: Axes, shape: Polygon) -> bool:
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return bool(shapely.box(west, south, east, north).contains(shape))


def _plate(axes: Axes, text: str, x: float, y: float, angle_deg: float) -> None:
    axes.text(
        x, y, text, fontsize=_ID_PT, fontweight="bold", color=style.BASE, rotation=angle_deg, rotation_mode="anchor",
        ha="center", va="center_baseline", zorder=45,
        bbox={"boxstyle": "round,pad=0.22,rounding_size=0.5", "fc": style.PAPER, "ec": style.BASE, "lw": 0.35},
    )  # fmt: skip


@cache
def _outline(piece: str) -> Outline:
    """A letter or word one unit high, from its own left edge on the base line."""
    path = TextPath((0, 0), piece, size=100, prop=font_properties(piece))
    return Outline(path.vertices / 100, path.codes)
