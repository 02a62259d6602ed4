"""From a car's shape to its model: panes, gaps, lamps and plates cut into the body, wheels and small things added."""

from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np

from assets.models.car_parts import aerial, arch_liner, handle, mirror, roof_rail, underbody, wipers
from assets.models.car_shape import CarShape, Spot
from assets.models.common import Floats, Ints, Model, Part
from assets.models.fields import polygon_distance, rounded, smooth_max
from assets.models.finish import fit
from assets.models.implicit import Field, Skin, mesh
from assets.models.simplify import simplify
from assets.models.wheels import wheel

LABELS: Final = (
    "paint", "glass", "trim", "paint", "plastic", "lamp_front", "lamp_rear", "lamp_indicator", "plate", "chrome",
    "glass", "glass", "paint",
)  # fmt: skip
"""The material of each label: glass is there as it is, over the dashboard and over the seats; paint as it is, and
about things on a roof, so that there are vertices to hold their shade, and darker in the gaps between panels."""
PAINT, GLASS, TRIM, GAP, PLASTIC, LAMP_FRONT, LAMP_REAR, LAMP_INDICATOR, PLATE, CHROME, DASH, SEAT, SHADED = range(13)
GAP_M: Final = 0.012
"""Gaps between panels, 4 to 5 mm in truth. A black line thinner than a pixel is drawn as dashes, so it is as wide here
as a pixel from 10 m above, and paint as dark as line and panels beside it are together."""
TINTS: Final = {GLASS: 0.6, DASH: 0.36, GAP: 0.5}
Outline = list[tuple[float, ...]]


@dataclass(frozen=True, slots=True)
class CarDetails:
    """What is drawn on the body. Outlines (corners, radius if wanted): sides (x, z), ends (|y|, z), top (x, |y|)."""

    doors: list[Outline]
    pillars: list[tuple[Spot, Spot, float]]
    """Two points (x, z) of each dark pillar between the side windows, and its half width."""
    quarter: tuple[Spot, Spot]
    """Two points (x, z) of the side windows' rear edge, the lower first."""
    headlamp: Outline
    tail_lamp: Outline
    front: list[tuple[Outline, int]]
    rear: list[tuple[Outline, int]]
    headlamp_reach_m: float = 0.42
    tail_lamp_reach_m: float = 0.26
    bonnet_front: tuple[float, float] = (0.0, 0.25)
    """x of the bonnet's front edge in the middle, and how much further back its corners are."""
    bonnet_inset_m: float = 0.12
    boot: Outline = field(default_factory=list)
    tailgate: Outline = field(default_factory=list)
    cladding_m: float = 0.0
    """Width of the dark strips about the wheel arches."""
    sill_top_m: float = 0.0
    """Height up to which the sills are dark plastic."""
    sunroof: Outline = field(default_factory=list)
    side_lines: list[Outline] = field(default_factory=list)
    """Further outlines on the sides that are gaps."""
    rails: tuple[float, float] | None = None
    """From and to which x roof rails run."""
    mirror: tuple[float, float, float] = (0.72, 0.86, 0.94)
    """Where the left mirror's foot is."""
    mirror_size: float = 1.0
    handles: list[Spot] = field(default_factory=list)
    """Middles (x, z) of the door handles."""
    aerial_x: float | None = None
    spokes: int = 5


def gate(shape: Floats, *limits: Floats) -> Floats:
    """A shape only where the limits are negative."""
    for limit in limits:
        shape = np.maximum(shape, limit)
    return shape


class CarBody:
    """The half of a car's body at y ≥ 0 as it is being cut."""

    def __init__(self, shape: CarShape, details: CarDetails, triangles: int) -> None:
        self.shape, self.details = shape, details
        low = (min(x for _, x in shape.tail) - 0.15, -shape.half_width - 0.1, 0.05)
        high = (max(x for _, x in shape.nose) + 0.15, shape.half_width + 0.1, max(z for _, z in shape.roof) + 0.15)
        self.skin = mesh(shape.field, np.array(low), np.array(high), 0.035, triangles)
        self.skin.keep(self.skin.cut(lambda p: -p[:, 1]) < 0.0)
        self.skin.vertices[np.abs(self.skin.vertices[:, 1]) < 1e-4, 1] = 0.0
        self.front_x = max(x for _, x in shape.nose)
        self.rear_x = min(x for _, x in shape.tail)

    def drawn(self) -> Skin:
        """The body with everything on it."""
        self._glass()
        self._ends()
        self._gaps()
        self._plastic()
        self._openings()
        return self.skin

    def daylight(self, p: Floats) -> Floats:
        """The side windows' outline: negative inside."""
        s = self.shape
        (x0, z0), (x1, z1) = self.details.quarter
        length = float(np.hypot(x1 - x0, z1 - z0))
        behind = (-(p[:, 0] - x0) * (z1 - z0) + (p[:, 2] - z0) * (x1 - x0)) / length
        ahead = smooth_max(s.screen(p) + 0.075, s.over(p) + 0.075, 0.05)
        below = s.deck_at(p) + 0.022 - p[:, 2]
        return smooth_max(smooth_max(ahead, behind, 0.10), below, 0.04)

    def _glass(self) -> None:
        skin = self.skin
        skin.paint(self.daylight, TRIM)
        skin.paint(lambda p: self._between_pillars(p, self.daylight(p) + 0.018), GLASS)
        for pane in (self._screen_pane, self._back_pane):
            skin.paint(partial(pane, margin=0.0), TRIM)
            skin.paint(partial(pane, margin=0.028), GLASS)
        self._seen_through(self.shape)

    def _seen_through(self, s: CarShape) -> None:
        """What shows behind the windscreen: dashboard, seats, and the mirror's foot at its head."""
        (_, z0), (_, z1) = s.windscreen
        high: Field = lambda p: (p[:, 2] - z0) / (z1 - z0)  # noqa: E731
        dash: Field = lambda p: gate(p[:, 2] - s.deck_at(p) - 0.17, -s.screen(p) - 0.09)  # noqa: E731
        self.skin.paint(dash, DASH, (GLASS,))
        seat = rounded([(0.16, 0.56), (0.20, 0.86), (0.52, 0.86), (0.56, 0.56)], 0.12)
        share = 0.55 / (0.62 * s.half_width)

        def seats(p: np.ndarray) -> np.ndarray:
            return gate(polygon_distance(seat, p[:, 1] * share, high(p)), -s.screen(p) - 0.09)

        self.skin.paint(seats, SEAT, (GLASS,))
        foot = rounded([(-0.2, 0.83), (0.05, 0.83), (0.07, 1.2), (-0.2, 1.2)], 0.02)
        sensor: Field = lambda p: gate(polygon_distance(foot, p[:, 1], high(p)), -s.screen(p) - 0.09)  # noqa: E731
        self.skin.paint(sensor, TRIM, (GLASS, SEAT))

    def _between_pillars(self, p: Floats, panes: Floats) -> Floats:
        for (x0, z0), (x1, z1), half in self.details.pillars:
            middle = x0 + (p[:, 2] - z0) * (x1 - x0) / (z1 - z0)
            panes = smooth_max(panes, half - np.abs(p[:, 0] - middle), 0.02)
        return panes

    def _screen_pane(self, p: Floats, margin: float) -> Floats:
        s = self.shape
        inner = smooth_max(s.cabin_side(p) + 0.055 + margin, s.over(p) + 0.045 + margin, 0.05)
        return gate(smooth_max(inner, s.deck_at(p) + 0.012 + margin - p[:, 2], 0.05), -s.screen(p) - 0.09)

    def _back_pane(self, p: Floats, margin: float) -> Floats:
        s = self.shape
        inner = smooth_max(s.cabin_side(p) + 0.055 + margin, s.over(p) + 0.05 + margin, 0.05)
        return gate(smooth_max(inner, s.deck_at(p) + 0.05 + margin - p[:, 2], 0.05), -s.back(p) - 0.09)

    def _ends(self) -> None:
        d, skin = self.details, self.skin
        for outline, label in d.front:
            skin.paint(self._on_end(outline, 1.0, self.front_x - 0.55), label)
        for outline, label in d.rear:
            skin.paint(self._on_end(outline, -1.0, -self.rear_x - 0.40), label)
        for lamp, label in (
            (self._lamp(d.headlamp, 1.0, self.front_x - d.headlamp_reach_m), LAMP_FRONT),
            (self._lamp(d.tail_lamp, -1.0, -self.rear_x - d.tail_lamp_reach_m), LAMP_REAR),
        ):
            skin.paint(lamp, TRIM)
            skin.paint(partial(_inset, shape=lamp, by=0.010), label)
            if label == LAMP_FRONT:
                self._reflector(lamp)

    def _on_end(self, outline: Outline, ahead: float, from_x: float) -> Field:
        """An outline (|y|, z) on the front (`ahead` 1) or the rear (−1), no further in than `from_x` of that end."""
        curve = rounded(outline, 0.02)
        return lambda p: gate(polygon_distance(curve, p[:, 1], p[:, 2]), from_x - ahead * p[:, 0])

    def _lamp(self, outline: Outline, ahead: float, from_x: float) -> Field:
        """The same with rounder corners, where it ends on the side too."""
        curve = rounded(outline, 0.03)
        return lambda p: smooth_max(polygon_distance(curve, p[:, 1], p[:, 2]), from_x - ahead * p[:, 0], 0.03)

    def _reflector(self, lamp: Field) -> None:
        """A bright spot with a dark rim inside the headlamp, and the indicator at its outer end."""
        y, z = np.mean([corner[:2] for corner in self.details.headlamp], axis=0)
        spot: Field = lambda p: np.hypot((p[:, 1] - y + 0.02) / 1.2, p[:, 2] - z + 0.003) - 0.048  # noqa: E731
        self.skin.paint(lambda p: gate(spot(p), 0.7 - p[:, 0]), TRIM, (LAMP_FRONT,))
        self.skin.paint(lambda p: gate(spot(p) + 0.012, 0.7 - p[:, 0]), CHROME, (TRIM,))

        def outer(p: np.ndarray) -> np.ndarray:
            return gate(lamp(p) + 0.02, self.front_x - 0.40 - p[:, 0], p[:, 0] - self.front_x + 0.35)

        self.skin.paint(outer, LAMP_INDICATOR, (LAMP_FRONT,))

    def _gaps(self) -> None:
        s, d, skin = self.shape, self.details, self.skin
        painted = (PAINT,)
        for outline in d.doors + d.side_lines:
            skin.stroke(_outlined(outline, 0.06, (0, 2)), GAP_M, GAP, self._below_belt, painted)
        skin.stroke(self._bonnet, GAP_M, GAP, lambda p: np.abs(p[:, 2] - s.deck_at(p)) - 0.06, painted)
        skin.paint(self._cowl, PLASTIC, (PAINT, GAP))
        skin.stroke(lambda p: s.cabin_side(p) + 0.115, 0.012, GAP, self._on_roof, (PAINT,))
        if d.boot:
            skin.stroke(_outlined(d.boot, 0.08, (0, 1)), GAP_M, GAP, self._on_boot, painted)
        if d.tailgate:
            skin.stroke(_outlined(d.tailgate, 0.05, (1, 2)), GAP_M, GAP, self._on_tail, painted)
        if d.sunroof:
            panel = _outlined(d.sunroof, 0.06, (0, 1))
            skin.paint(lambda p: gate(panel(p), 1.2 - p[:, 2]), TRIM, (PAINT,))
            skin.paint(lambda p: gate(panel(p) + 0.012, 1.2 - p[:, 2]), GLASS, (TRIM,))

    def _below_belt(self, p: Floats) -> Floats:
        return np.maximum(p[:, 2] - self.shape.deck_at(p) - 0.03, 0.3 - p[:, 1])

    def _on_roof(self, p: Floats) -> Floats:
        return gate(-self.shape.over(p) - 0.05, self.shape.screen(p) + 0.02, self.shape.back(p) + 0.03)

    def _on_boot(self, p: Floats) -> Floats:
        return gate(self.shape.deck_at(p) - 0.08 - p[:, 2], p[:, 0] + 0.7)

    def _on_tail(self, p: Floats) -> Floats:
        over = p[:, 2] - self.shape.deck_at(p)
        end = p[:, 0] - self.rear_x - 0.55
        if self.details.boot:
            return gate(end, over + 0.03)
        return gate(end, np.where(over > 0.0, -self.shape.back(p) - 0.04, -1.0))  # not along the pillars

    def _bonnet(self, p: Floats) -> Floats:
        s, d = self.shape, self.details
        x_front, back = d.bonnet_front
        share = p[:, 1] / s.half_width
        edge = p[:, 1] - (s.half_at(p) - d.bonnet_inset_m)
        ahead = p[:, 0] - x_front + back * share**4
        return smooth_max(smooth_max(edge, ahead, 0.10), s.screen(p) * -1.0 + 0.03, 0.02)

    def _cowl(self, p: Floats) -> Floats:
        s = self.shape
        inside = smooth_max(s.screen(p) - 0.06, p[:, 1] - s.half_at(p) + 0.13, 0.05)
        return gate(inside, s.windscreen[1][0] - p[:, 0], np.abs(p[:, 2] - s.deck_at(p)) - 0.03)

    def _plastic(self) -> None:
        d, skin = self.details, self.skin
        painted = (PAINT, GAP)
        if d.sill_top_m:
            skin.paint(lambda p: p[:, 2] - d.sill_top_m, PLASTIC, painted)
        if d.cladding_m:
            for axle in self.shape.axles:
                skin.paint(partial(self._arch, axle=axle, wider=d.cladding_m, inner=0.5), PLASTIC, painted)

    def _arch(self, p: Floats, axle: float, wider: float, inner: float) -> Floats:
        """A wheel arch, `wider` by some metres, where |y| is more than `inner`."""
        away = np.hypot(p[:, 0] - axle, p[:, 2] - self.shape.wheel_m) - self.shape.arch_m
        return gate(away - wider, inner - p[:, 1])

    def _openings(self) -> None:
        s, skin = self.shape, self.skin
        for axle in s.axles:
            skin.paint(partial(self._arch, axle=axle, wider=0.0, inner=s.half_width - 0.32), -1)
        below = (skin.normals()[skin.triangles][:, :, 2].mean(axis=1) < -0.75) & (
            skin.centres()[:, 2] < s.sill_m + 0.12
        )
        skin.keep((skin.labels >= 0) & ~below)


def _inset(p: Floats, shape: Field, by: float) -> Floats:
    return shape(p) + by


def _outlined(outline: Outline, radius: float, axes: tuple[int, int]) -> Field:
    """The distance to an outline in two of the three axes."""
    curve = rounded(outline, radius)
    return lambda p: polygon_distance(curve, p[:, axes[0]], p[:, axes[1]])


def skin_parts(skin: Skin) -> list[Part]:
    """One part a label, with the field's normals."""
    normals = skin.normals()
    out = []
    for label, name in enumerate(LABELS):
        triangles: Ints = skin.triangles[skin.labels == label]
        if len(triangles):
            used, inverse = np.unique(triangles, return_inverse=True)
            out.append(
                Part(
                    name,
                    skin.vertices[used],
                    inverse.reshape(-1, 3),
                    normals[used],
                    np.full((len(used), 3), TINTS.get(label, 1.0)),
                )
            )
    return out


def car(name: str, shape: CarShape, details: CarDetails, triangles: int = 3200) -> Model:
    """The model of a car."""
    made = Model(name)
    skin = CarBody(shape, details, triangles).drawn()
    simplify(skin, 0.0018)
    made.add_both_sides(*skin_parts(skin))
    made.add(
        underbody(shape), *wipers(shape.field, shape.windscreen[0][1], shape.windscreen[0][0], 0.62 * shape.half_width)
    )
    for axle in shape.axles:
        made.add_both_sides(arch_liner(shape, axle))
        tyre = wheel(shape.wheel_m, 0.2, spokes=details.spokes)
        made.add_both_sides(*(one.moved((axle, shape.half_width - 0.035, shape.wheel_m)) for one in tyre))
    made.add_both_sides(*mirror(*details.mirror, details.mirror_size))
    made.add_both_sides(*(handle(shape, *spot) for spot in details.handles))
    if details.rails:
        made.add_both_sides(roof_rail(shape, details.rails))
    if details.aerial_x is not None:
        made.add(aerial(shape, details.aerial_x))
    return fit(made)
