"""The body of a car as an implicit function: a lower body and a greenhouse, joined."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from assets.models.common import Floats
from assets.models.fields import curve, smooth_max, smooth_min

Knots = Sequence[tuple[float, float]]
Spot = tuple[float, float]


@dataclass(frozen=True, slots=True)
class CarShape:
    """Curves of a car, in metres: x forward from the middle, z from the ground, half widths from the middle plane."""

    deck: Knots
    """(x, z): bonnet, belt and boot in the middle plane."""
    plan: Knots
    """(x, half width) of the lower body."""
    nose: Knots
    """(z, x) of the front in the middle plane."""
    tail: Knots
    """(z, x) of the rear."""
    roof: Knots
    """(x, z) of the roof in the middle plane."""
    cabin: Knots
    """(x, half width) of the greenhouse at the belt."""
    windscreen: tuple[Spot, Spot]
    """(x, z) at its foot and at its head, in the middle plane."""
    backlight: tuple[Spot, Spot]
    """(x, z) of the rear window at its foot and its head."""
    belt_m: float
    """Height the greenhouse's sides start from."""
    tumblehome: float = 0.30
    """How far the sides lean in, a metre of height."""
    nose_bow_m: float = 0.42
    tail_bow_m: float = 0.24
    """How much further back the corners are than the middle."""
    glass_bow: float = 0.28
    """Curvature of the windscreen in plan, metres a square metre of half width."""
    crown_m: float = 0.06
    """How much lower the deck is at the shoulders than in the middle."""
    roof_crown: float = 0.10
    """The same for the roof, a square metre of half width."""
    shoulder_m: float = 0.09
    """Rounding between deck and sides, and between nose and deck."""
    rail_m: float = 0.13
    """Rounding between roof and sides."""
    sill_m: float = 0.19
    section: Knots = ((0.15, 0.09), (0.26, 0.025), (0.45, 0.0), (0.66, 0.002), (0.95, 0.05))
    """(z, inset) of the lower body's sides."""
    crease: tuple[Spot, Spot] = ((-2.0, 0.76), (2.0, 0.70))
    """(x, z) of two points on the line along the doors."""
    dome: tuple[float, float] = (0.014, 0.62)
    """Height of the bonnet's raised middle, in metres, and its half width as a share of the car's."""
    axles: tuple[float, float] = (1.3, -1.3)
    arch_m: float = 0.36
    """Radius of the wheel arches."""
    wheel_m: float = 0.31
    """Radius of the wheels."""

    @property
    def half_width(self) -> float:
        return max(width for _, width in self.plan)

    def field(self, points: Floats) -> Floats:
        """About the distance (n,) to the body, negative inside."""
        return smooth_min(self.lower(points), self.greenhouse(points), 0.035)

    def deck_at(self, points: Floats) -> Floats:
        """Height of the lower body's top."""
        x, y = points[:, 0], np.abs(points[:, 1])
        share = np.minimum(y / self.half_width, 1.1)
        height, half = self.dome
        edge = half * self.half_width * (1.0 - 0.12 * np.clip(x - self.windscreen[0][0], 0.0, 2.0))
        front = 1.0 / (1.0 + np.exp(-(x - self.windscreen[0][0]) / 0.08))
        dome = height * front / (1.0 + np.exp((y - edge) / 0.018))
        return np.asarray(curve(self.deck, x) - self.crown_m * share**2 - 0.35 * self.crown_m * share**6 + dome)

    def half_at(self, points: Floats) -> Floats:
        """Half width of the lower body at the points' x and z, with creases and flared arches."""
        x, z = points[:, 0], points[:, 2]
        (x0, z0), (x1, z1) = self.crease
        line = z0 + (z1 - z0) * (x - x0) / (x1 - x0)
        below = 0.010 / (1.0 + np.exp((z - line) / 0.010))
        flare = np.zeros(len(x))
        for axle in self.axles:
            away = np.hypot(x - axle, z - self.wheel_m) - self.arch_m
            flare += 0.016 * np.exp(-((away / 0.07) ** 2))
        return np.asarray(curve(self.plan, x) - curve(self.section, z) - below + flare - 0.006)

    def side(self, points: Floats) -> Floats:
        return np.asarray(np.abs(points[:, 1]) - self.half_at(points))

    def front(self, points: Floats) -> Floats:
        return _end(points[:, 0] - curve(self.nose, points[:, 2]), points[:, 1], self.nose_bow_m, self.half_width)

    def rear(self, points: Floats) -> Floats:
        return _end(curve(self.tail, points[:, 2]) - points[:, 0], points[:, 1], self.tail_bow_m, self.half_width)

    def lower(self, points: Floats) -> Floats:
        top = (points[:, 2] - self.deck_at(points)) * 0.98
        ends = smooth_max(self.front(points), self.rear(points), 0.05)
        body = smooth_max(smooth_max(top, self.side(points), self.shoulder_m), ends, self.shoulder_m)
        return smooth_max(body, self.sill_m - points[:, 2], 0.04)

    def screen(self, points: Floats) -> Floats:
        """Distance before the windscreen's surface."""
        return _pane(points[:, 0], points[:, 1], points[:, 2], self.windscreen, self.glass_bow)

    def back(self, points: Floats) -> Floats:
        """Distance behind the rear window's surface."""
        (x0, z0), (x1, z1) = self.backlight
        return _pane(-points[:, 0], points[:, 1], points[:, 2], ((-x0, z0), (-x1, z1)), 0.6 * self.glass_bow)

    def cabin_side(self, points: Floats) -> Floats:
        rise = points[:, 2] - self.belt_m
        inset = self.tumblehome * rise + 0.10 * np.maximum(rise, 0.0) ** 2
        return np.asarray((np.abs(points[:, 1]) - curve(self.cabin, points[:, 0]) + inset) * 0.95)

    def over(self, points: Floats) -> Floats:
        """Height above the roof's surface."""
        return np.asarray(points[:, 2] - curve(self.roof, points[:, 0]) + self.roof_crown * points[:, 1] ** 2)

    def greenhouse(self, points: Floats) -> Floats:
        ends = smooth_max(self.screen(points), self.back(points), 0.05)
        top = smooth_max(self.over(points), ends, 0.10)
        body = smooth_max(top, self.cabin_side(points), self.rail_m)
        return np.maximum(body, self.belt_m - 0.08 - points[:, 2])  # below, it would only widen


def _end(beyond: Floats, y: Floats, bow: float, half: float) -> Floats:
    """A bumper's surface: `beyond` in the middle plane, its corners `bow` further back, as the fourth power of y."""
    share = np.minimum(np.abs(y) / half, 1.15)
    slope = 4.0 * bow * share**3 / half
    return np.asarray((beyond + bow * share**4) / np.sqrt(1.0 + slope**2))


def _pane(x: Floats, y: Floats, z: Floats, line: tuple[Spot, Spot], bow: float) -> Floats:
    """Distance before a leaning pane, curved in plan and slightly along its height."""
    (x0, z0), (x1, z1) = line
    length = float(np.hypot(x1 - x0, z1 - z0))
    back, up = (x0 - x1) / length, (z1 - z0) / length
    ahead = x + bow * y**2 - x0
    along = -ahead * back + (z - z0) * up
    return np.asarray(ahead * up + (z - z0) * back + 0.10 * (along - length / 2.0) ** 2 - 0.10 * length**2 / 4.0)
