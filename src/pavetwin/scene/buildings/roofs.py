"""Roofs: gables over rectangles, hips over any other shape, and flat roofs with a parapet and equipment.

A building's height is its highest point: a ridge, a chimney, a parapet. So nothing exceeds its solid, except eaves and
equipment on large flat roofs, which is behind the parapet.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from pavetwin.arrays import Float64Array
from pavetwin.scene.buildings.faces import Faces
from pavetwin.scene.buildings.layers import FacadeTexture
from pavetwin.scene.buildings.styles import TOWER, FacadeStyle, HouseDetail, Roof
from pavetwin.scene.meshes import corners_of
from pavetwin.scene.palettes import Colour

STEP_M: Final = 0.35
"""Hipped roofs are cut into contours this far apart in plan; their ridge is flat over at most twice this."""

MOST_STEPS: Final = 40
BLANK_STEP_M: Final = 1.4
"""The same of a roof in the coarsest detail."""

FASCIA_M: Final = 0.14
OVERHANG_M: Final = 0.30
CORNER_M: Final = 0.25
"""A footprint that misses more than this share of its bounding rectangle is not a rectangle."""

PARAPET_M: Final = (0.35, 0.95)  # Parapet heights of small and of large flat roofs; the latter hide the equipment
LARGE_M2: Final = 260.0
PARAPET_THICK_M: Final = 0.28
CHIMNEY_M: Final = 0.6
"""A chimney stands this much above the ridge."""

Joined = tuple[bool, bool, bool, bool]
NOT_JOINED: Final[Joined] = (False, False, False, False)
METAL: Colour = (0.42, 0.43, 0.44)
LEAST_RISE_M: Final = 0.8


@dataclass(frozen=True, slots=True)
class RoofPlan:
    """The parameters of a building's roof."""

    kind: Roof
    footprint: Polygon
    """Anticlockwise."""
    eaves_m: float
    """Height at which the walls end."""
    ridge_m: float
    chimney_m: float
    """How far a chimney stands above the ridge; 0 for none."""
    rectangle: Float64Array | None
    """(4, 2) corners for a gable, its ridge along the first side; None for a hip."""
    joined: Joined = NOT_JOINED
    """Sides of a gable that touch another building, and have no eaves."""


def plan_roof(
    footprint: Polygon, height_m: float, style: FacadeStyle, touching: Float64Array, rng: np.random.Generator
) -> RoofPlan:
    """Choose a roof.

    Args:
        height_m: its highest point.
        touching: (n, 2) points on the footprint's boundary where another building stands against it.
    """
    footprint = orient(footprint, 1.0)
    if style.roof is Roof.FLAT:
        return RoofPlan(Roof.FLAT, footprint, height_m, height_m, 0.0, None)
    tower = height_m > TOWER * math.sqrt(footprint.area)
    rectangle, joined = (None, NOT_JOINED) if tower else _rectangle(footprint, touching)
    chimney = CHIMNEY_M if rng.random() < 0.75 and not tower else 0.0
    span = float(np.hypot(*(rectangle[2] - rectangle[1]))) if rectangle is not None else 2 * _inradius(footprint)
    rise = span / 2 * math.tan(style.pitch_rad)
    rise = min(rise, 0.45 * height_m)
    if rise < LEAST_RISE_M:
        return RoofPlan(Roof.FLAT, footprint, height_m, height_m, 0.0, None)
    ridge = height_m - chimney
    return RoofPlan(Roof.PITCHED, footprint, ridge - rise, ridge, chimney, rectangle, joined)


def build_roof(faces: Faces, plan: RoofPlan, style: FacadeStyle, rng: np.random.Generator, detail: HouseDetail) -> None:
    """Add a roof, with chimneys and all."""
    if plan.kind is Roof.FLAT:
        _flat(faces, plan, style, rng, detail)
    elif plan.rectangle is not None:
        _gable(faces, plan, style, detail)
    else:
        _hip(faces, plan, style, detail)
    if plan.chimney_m > 0:
        _chimney(faces, plan, rng)


def _rectangle(footprint: Polygon, touching: Float64Array) -> tuple[Float64Array | None, Joined]:
    """The corners of a footprint that is a rectangle, to within 6 % of its area, its ridge along the first side."""
    box = footprint.minimum_rotated_rectangle
    if not isinstance(box, Polygon) or footprint.area < 0.94 * box.area:
        return None, NOT_JOINED
    corners = np.asarray(orient(box, 1.0).exterior.coords)[:-1]
    if shapely.distance(footprint, shapely.points(corners)).max() > CORNER_M:
        return None, NOT_JOINED
    sides = [shapely.LineString([corners[k], corners[(k + 1) % 4]]) for k in range(4)]
    points = np.array(shapely.points(touching.reshape(-1, 2)), dtype=object)
    touched = tuple((shapely.distance(side, points) < 0.3).sum() * 0.5 > 0.3 * side.length for side in sides)
    first, second = sides[0].length, sides[1].length
    # Rows have their ridge from house to house; others along their longer side.
    across = touched[0] or touched[2]
    turned = across if across != (touched[1] or touched[3]) else first < second
    if turned:
        corners = np.roll(corners, -1, axis=0)
        touched = (*touched[1:], touched[0])
    return corners, (touched[0], touched[1], touched[2], touched[3])


def _inradius(footprint: Polygon) -> float:
    return float(shapely.maximum_inscribed_circle(footprint, tolerance=0.2).length)


def _gable(faces: Faces, plan: RoofPlan, style: FacadeStyle, detail: HouseDetail) -> None:
    assert plan.rectangle is not None
    a, b, c, d = plan.rectangle
    along, across = (b - a) / np.hypot(*(b - a)), (d - a) / np.hypot(*(d - a))
    half = float(np.hypot(*(d - a))) / 2
    slope = (plan.ridge_m - plan.eaves_m) / half
    verge = [0.0 if touched else 0.18 for touched in (plan.joined[3], plan.joined[1])]
    start, end = (a + d) / 2 - verge[0] * along, (b + c) / 2 + verge[1] * along
    length = float(np.hypot(*(end - start)))
    for side, touched in ((-1.0, plan.joined[0]), (1.0, plan.joined[2])):
        reach = half + (0.0 if touched else OVERHANG_M)
        foot = plan.ridge_m - reach * slope
        p, q = start + side * reach * across, end + side * reach * across
        up = math.hypot(reach, reach * slope)
        ring = [(*p, foot), (*q, foot), (*end, plan.ridge_m), (*start, plan.ridge_m)]
        uv = np.array([(0, 0), (length, 0), (length, up), (0, up)])
        order = slice(None) if side < 0 else slice(None, None, -1)
        faces.quads(style.covering, np.array(ring)[order], style.covering_colour, uv=uv[None, order], roughness=0.85)
        if detail is HouseDetail.FULL:
            _edge(faces, np.array(ring)[order])
    for middle, (left, right) in (((b + c) / 2, (b, c)), ((a + d) / 2, (d, a))):
        triangle = np.array(
            [(*left, plan.eaves_m), (*right, plan.eaves_m), (*middle, plan.ridge_m), (*middle, plan.ridge_m)]
        )
        width = float(np.hypot(*(right - left)))
        uv = np.array([(0, plan.eaves_m), (width, plan.eaves_m), (width / 2, plan.ridge_m), (width / 2, plan.ridge_m)])
        faces.quads(style.wall, triangle, style.colour, uv=uv[None], roughness=0.9)
    if detail is HouseDetail.FULL:
        _ridge(faces, [start, end], plan.ridge_m, style)


def _edge(faces: Faces, ring: Float64Array) -> None:
    """Fascia boards below a roof's edges, and its underside."""
    low = ring - np.array([0, 0, FASCIA_M])
    following = np.roll(ring, -1, axis=0)
    sides = np.stack([low, np.roll(low, -1, axis=0), following, ring], axis=1)
    faces.quads(FacadeTexture.PLAIN, sides, (0.22, 0.215, 0.20), roughness=0.8)
    faces.quads(FacadeTexture.PLAIN, low[None, ::-1], (0.20, 0.19, 0.175), roughness=0.9)


def _ridge(faces: Faces, ends: list[Float64Array], height_m: float, style: FacadeStyle) -> None:
    """A row of ridge tiles."""
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    left = np.array([-along[1], along[0]])
    colour = (0.20, 0.085, 0.055) if style.covering is FacadeTexture.TILES else (0.09, 0.09, 0.095)
    tops = [(*ends[0], height_m + 0.05), (*ends[1], height_m + 0.05)]
    for side in (-1.0, 1.0):
        feet = [(*(end + side * 0.16 * left), height_m - 0.08) for end in ends]
        quad = np.array([feet[0], feet[1], tops[1], tops[0]])
        faces.quads(FacadeTexture.PLAIN, quad if side < 0 else quad[::-1], colour, roughness=0.85)


def _hip(faces: Faces, plan: RoofPlan, style: FacadeStyle, detail: HouseDetail) -> None:
    """Contours ever further inside the footprint, each higher by the slope; the strips between them are the roof."""
    inradius = max(_inradius(plan.footprint), 0.1)
    slope = (plan.ridge_m - plan.eaves_m) / inradius
    step = max(BLANK_STEP_M if detail is HouseDetail.BLANK else STEP_M, inradius / MOST_STEPS)
    depths = step * np.arange(math.ceil(inradius / step) + 1)
    contours = np.array(shapely.buffer(plan.footprint, -depths, join_style="mitre", mitre_limit=8.0), dtype=object)
    strips = shapely.difference(contours[:-1], contours[1:])
    parts, number = shapely.get_parts(shapely.constrained_delaunay_triangles(strips), return_index=True)
    corners = corners_of(parts)
    on_inner = shapely.distance(shapely.points(corners), contours[number + 1][:, None]) < 1e-6
    inside = np.where(on_inner, depths[number + 1][:, None], depths[number][:, None])
    uv = _slope_uv(plan.footprint, corners, inside, slope)
    faces.slopes(style.covering, corners, plan.eaves_m + slope * inside, style.covering_colour, 0.85, uv)
    ring = np.asarray(plan.footprint.exterior.coords)[:-1]
    if detail is HouseDetail.FULL:
        faces.walls(FacadeTexture.PLAIN, ring, plan.eaves_m - FASCIA_M, plan.eaves_m, (0.22, 0.215, 0.20), 0.8)


def _slope_uv(footprint: Polygon, corners: Float64Array, inside: Float64Array, slope: float) -> Float64Array:
    """(n, 3, 2): along the eaves nearest to each triangle, and up the roof."""
    ring = np.asarray(footprint.exterior.coords)
    legs = np.array(shapely.linestrings(np.stack([ring[:-1], ring[1:]], axis=1)), dtype=object)
    middles = np.array(shapely.points(corners.mean(axis=1)), dtype=object)
    leg = np.argmin(shapely.distance(legs[None, :], middles[:, None]), axis=1)
    direction = np.diff(ring, axis=0)
    direction /= np.maximum(np.hypot(*direction.T), 1e-9)[:, None]
    along = np.einsum("nkc,nc->nk", corners - ring[leg][:, None], direction[leg])
    return np.stack([along, inside * math.hypot(1.0, slope)], axis=-1)


def _flat(faces: Faces, plan: RoofPlan, style: FacadeStyle, rng: np.random.Generator, detail: HouseDetail) -> None:
    large = plan.footprint.area > LARGE_M2
    parapet = PARAPET_M[1] if large else PARAPET_M[0]
    deck_m = plan.ridge_m - parapet
    inner = plan.footprint.buffer(-PARAPET_THICK_M, join_style="mitre", mitre_limit=4.0)
    if inner.is_empty:
        faces.level(style.covering, plan.footprint, plan.ridge_m, style.covering_colour)
        return
    decks = _polygons(inner)
    rim = plan.footprint.difference(shapely.MultiPolygon(decks))
    faces.level(FacadeTexture.PLAIN, shapely.MultiPolygon(_polygons(rim)), plan.ridge_m, METAL, 0.45)
    for part in decks:
        faces.level(style.covering, part, deck_m, style.covering_colour)
        for ring in (part.exterior, *part.interiors):
            faces.walls(FacadeTexture.PLAIN, np.asarray(ring.coords)[:0:-1], deck_m, plan.ridge_m, (0.33, 0.32, 0.30))
        if detail is not HouseDetail.BLANK:
            _equipment(faces, part, deck_m, large, rng)


def _equipment(faces: Faces, deck: Polygon, deck_m: float, large: bool, rng: np.random.Generator) -> None:
    """Hatches, skylights, vents; equipment on large roofs. None touches the edge or another one."""
    usable = deck.buffer(-1.0)
    box = deck.minimum_rotated_rectangle
    if usable.is_empty or not isinstance(box, Polygon):
        return
    along = _direction(np.asarray(box.exterior.coords))
    taken: list[Polygon] = []
    for length, width, height, colour in _things(deck.area, large, rng):
        for _ in range(8):
            low_x, low_y, high_x, high_y = usable.bounds
            at = np.array([rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)])
            base = _ring(at, along, length, width)
            shape = Polygon(base)
            if usable.contains(shape) and not any(shape.distance(other) < 0.6 for other in taken):
                taken.append(shape)
                faces.box(FacadeTexture.PLAIN, base, deck_m, deck_m + height, colour, 0.5)
                break


def _things(area_m2: float, large: bool, rng: np.random.Generator) -> Iterator[tuple[float, float, float, Colour]]:
    """Length, width, height [m] and colour of equipment for a flat roof of a size."""
    yield 0.9, 0.9, 0.3, METAL
    for _ in range(int(rng.poisson(area_m2 / 60))):
        yield 0.25, 0.25, 0.28, (0.30, 0.30, 0.30)
    if not large:
        return
    for _ in range(int(rng.poisson(area_m2 / 110))):
        length, width, height = (float(rng.uniform(*limits)) for limits in ((1.1, 2.2), (0.8, 1.3), (0.8, 1.3)))
        yield length, width, height, (0.55, 0.55, 0.53)
    for _ in range(int(rng.poisson(area_m2 / 160))):
        yield 1.6, 1.6, 0.35, (0.50, 0.56, 0.60)


def _chimney(faces: Faces, plan: RoofPlan, rng: np.random.Generator) -> None:
    """A stack near the ridge, with its pot; it ends where the building does."""
    core = plan.footprint.buffer(-0.64 * _inradius(plan.footprint))
    if core.is_empty:
        return
    part = max(_polygons(core) or [plan.footprint], key=lambda each: each.area)
    spots = shapely.get_coordinates(part.minimum_rotated_rectangle)
    along = _direction(shapely.get_coordinates(plan.footprint.minimum_rotated_rectangle))
    wanted = shapely.Point(spots[0] + (spots[2] - spots[0]) * float(rng.uniform(0.2, 0.8)))
    # The rectangle around a bent part reaches out of it.
    at = shapely.get_coordinates(shapely.shortest_line(part, wanted))[0]
    top = plan.ridge_m + plan.chimney_m
    stack = _ring(at, along, float(rng.uniform(0.5, 0.9)), 0.5)
    faces.box(FacadeTexture.BRICK, stack, plan.eaves_m, top - 0.1, (0.9, 0.9, 0.9))
    faces.box(FacadeTexture.PLAIN, _ring(at, along, 0.35, 0.3), top - 0.1, top, (0.10, 0.06, 0.045))


def _direction(ring: Float64Array) -> Float64Array:
    """(2,) unit, of a ring's first side."""
    side = ring[1] - ring[0]
    return np.asarray(side / max(float(np.hypot(*side)), 1e-9))


def _ring(at: Float64Array, along: Float64Array, length: float, width: float) -> Float64Array:
    left = np.array([-along[1], along[0]]) * width / 2
    ahead = along * length / 2
    return np.stack([at - ahead - left, at + ahead - left, at + ahead + left, at - ahead + left])


def _polygons(shape: BaseGeometry) -> list[Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, Polygon) and part.area > 1e-6]
