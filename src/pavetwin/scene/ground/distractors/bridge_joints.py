"""Joints at the ends of bridges: steel fingers or rubber profiles in modules, or plugs of asphalt and binder."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from shapely import Point

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.layout.lines import direction
from pavetwin.scene.ground.layout.streets import StreetPlan
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.looks.street_look import JointName
from pavetwin.scene.ground.looks.weights import pick

MODULE_M: Final = 0.5
"""Length of one module of a steel joint across the street."""

PLUG_HALF_M: Final = 0.25
"""Half the width of a plug joint. Ours."""

PLUG_TONE: Final = 0.55
"""Factor on the reflectance where it lies: much binder. Ours."""

END_M: Final = 2.0
"""A bridge that ends nearer to a junction has its joint in there, where none is drawn."""


def joints(plan: SurfaceLayout) -> Iterator[tuple[JointName, Float64Array, float, float]]:
    """Each joint: its kind, its middle (2,), the direction across the street [rad] and half its length [m]."""
    for street in plan.streets:
        line = street.street.centre_line
        for number, ends in enumerate(street.street.bridges):
            kind = pick(plan.look.bridge_joints, plan.chance(f"bridge {street.key} {number}"))
            for station in ends:
                if END_M < station < line.length - END_M:
                    at = line.interpolate(station)
                    dx, dy = direction(line, station)
                    yield kind, np.array([at.x, at.y]), float(np.arctan2(dx, -dy)), _half_width(street, at)


def modules(plan: SurfaceLayout) -> Iterator[tuple[str, float, float, float]]:
    """The modules of steel joints: model, middle x and y, direction of the street [rad]."""
    for kind, middle, across, half in joints(plan):
        if kind != "plug":
            count = int(2 * half / MODULE_M)
            for offset in (np.arange(count) - (count - 1) / 2) * MODULE_M:
                x, y = middle + offset * np.array([np.cos(across), np.sin(across)])
                yield kind, float(x), float(y), across - np.pi / 2


def plugs(plan: SurfaceLayout) -> Iterator[tuple[tuple[float, ...], list[Float64Array]]]:
    """Plug joints: a patch as `Repairs` holds them, and the lines of its two sealed edges."""
    for kind, middle, across, half in joints(plan):
        if kind == "plug":
            out = np.array([np.cos(across), np.sin(across)])
            aside = PLUG_HALF_M * np.array([-out[1], out[0]])
            ends = middle - half * out, middle + half * out
            edges = [np.array([end + side * aside for end in ends]) for side in (-1, 1)]
            yield (float(middle[0]), float(middle[1]), across, half, PLUG_HALF_M, PLUG_TONE), edges


def _half_width(street: StreetPlan, at: Point) -> float:
    """Half the carriageway's width at a point of a street."""
    nearest = min(street.segments, key=lambda segment: segment.centre_line.distance(at), default=None)
    return nearest.width_m / 2 if nearest is not None else 3.0
