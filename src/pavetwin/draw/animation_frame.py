"""One frame of the animation: moving objects and hidden ground, drawn over the raster of the static world."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import cos, hypot, pi, sin
from typing import TYPE_CHECKING, cast

import numpy as np
import shapely
from PIL import Image

from pavetwin.arrays import AnyArray, Float64Array, GeometryArray
from pavetwin.draw import style
from pavetwin.draw.ground_raster import SMOOTHING, GroundRaster, Pen
from pavetwin.draw.mission_marks import DefectOutcome, rectangles
from pavetwin.draw.mission_style import (
    AGENT_COLOURS,
    HIDDEN,
    OPEN_DEFECT,
    SEEN,
    SMALLEST_VEHICLE_M,
    UAV,
    Rgb,
    rgb,
    visibility_rgb,
)
from pavetwin.mission.environment import window_m
from pavetwin.mission.timeline import Timeline
from pavetwin.twin import Place, UavState

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns


LOWEST_M = 0.1  # An agent as tall as the camera is high is cut this far below it: its shadow is then long, but finite
TOLERANCE_M = 0.05  # Outlines of the seen pavement are simplified by this much


def bodies(agents: "PoseColumns") -> Float64Array:
    """(n, 4, 2) the agents' outlines on the ground."""
    return rectangles(agents["x_m"], agents["y_m"], agents["yaw_rad"], agents["width_m"], agents["length_m"])


def columns_near(agents: "PoseColumns", place: tuple[float, float], radius_m: float) -> "PoseColumns":
    """Agents whose body may reach into a disc."""
    reach_m = radius_m + np.hypot(agents["length_m"], agents["width_m"]) / 2
    near = np.hypot(agents["x_m"] - place[0], agents["y_m"] - place[1]) <= reach_m
    return cast("PoseColumns", {name: column[near] for name, column in cast("dict[str, AnyArray]", agents).items()})


def shadows(agents: "PoseColumns", camera: tuple[float, float, float]) -> GeometryArray:
    """Polygons of ground that the agents on it hide from a camera at (east, north, height above the ground)."""
    standing = agents["is_pedestrian"] | (agents["length_m"] >= SMALLEST_VEHICLE_M)
    base = bodies(agents)[standing]
    eye, height_m = np.array(camera[:2]), camera[2]
    top_m = np.minimum(agents["height_m"][standing], height_m - LOWEST_M)
    top = eye + (base - eye) * (height_m / (height_m - top_m))[:, None, None]
    return np.asarray(shapely.convex_hull(shapely.multipoints(np.concatenate([base, top], axis=1))))


@dataclass
class SeenSurface:
    """The pavement of the inspected segments that the captures have seen, up to a time that only moves on."""

    timeline: Timeline
    concerns: Callable[[float, float], bool] = lambda _east, _north: True
    """Whether a capture at this place can come into the image; the others are left out."""
    _done: int = field(default=0, init=False)
    _seen: shapely.Geometry = field(default_factory=shapely.Polygon, init=False)

    def until(self, time_s: float) -> shapely.Geometry:
        """Everything seen by captures up to `time_s`."""
        captures, count = self.timeline.captures, self.timeline.capture_count(time_s)
        news = [
            self._seen_by(number)
            for number in range(self._done, count)
            if self.concerns(float(captures["x_m"][number]), float(captures["y_m"][number]))
        ]
        self._done = max(self._done, count)
        if news:
            self._seen = shapely.simplify(shapely.union_all([self._seen, *news]), TOLERANCE_M)
        return self._seen

    def _seen_by(self, capture: int) -> shapely.Geometry:
        captures, size = self.timeline.captures, window_m(self.timeline.settings)
        east, north, yaw, time = (float(captures[name][capture]) for name in ("x_m", "y_m", "yaw_rad", "t_s"))
        window = shapely.Polygon(rectangles(east, north, yaw, *size))
        agents = self.timeline.trace.agents_near(east, north, hypot(*size) / 2 + 1, time)
        segment = self.timeline.environment.world.segments[int(captures["segment"][capture])]
        seen = shapely.intersection(window, segment.polygon)
        eye = (east, north, self.timeline.settings.altitude_m)
        parked = columns_near(self.timeline.parked, (east, north), hypot(*size) / 2 + 1)
        hidden = [*shadows(agents, eye), *shadows(parked, eye)]
        return shapely.difference(seen, shapely.union_all(hidden)) if hidden else seen


FLASH_S = 0.8  # Duration of the flash of a confirmation, in the animation's own time
ARM_M, ROTOR_M = 0.95, 0.55
"""The UAV's symbol; larger than the airframe, so that it can be seen."""

DASH_M = 0.55
SEEN_OPACITY, HIDDEN_OPACITY = 150, 120

WHITE: Rgb = (255, 255, 255)


@dataclass(frozen=True)
class DefectMark:
    position: Place
    outcome: DefectOutcome | None
    """None while it is open."""
    age_s: float = 0.0
    """Since its confirmation, in the animation's own time."""


@dataclass(frozen=True)
class MissionState:
    """The state of a mission at one time: UAV, agents, defects. World frame, metres."""

    time_s: float
    uav: UavState
    visibility: float | None
    """o; None while nothing is under inspection."""
    agents: "PoseColumns"
    groups: Sequence[str]
    """For each agent, its key of `AGENT_COLOURS`."""
    parked: "PoseColumns"
    hidden: shapely.Geometry
    """The part of the inspection window that agents and parked vehicles hide."""
    seen: shapely.Geometry
    """Pavement seen by the captures so far."""
    defects: Sequence[DefectMark]
    trail: Float64Array
    """(n, 2) the UAV's recent track."""


@dataclass(frozen=True)
class MapView:
    """Draws a mission's state on the map around a place."""

    ground: GroundRaster
    size_px: tuple[int, int]
    window_m: tuple[float, float]
    """The inspection window, across and along the track."""
    footprint_m: tuple[float, float]

    def corner_px(self, centre: Place) -> tuple[int, int]:
        """The raster's pixel in the upper left of a frame around `centre`."""
        x, y = self.ground.pixel(*centre)
        return x - self.size_px[0] // 2, y - self.size_px[1] // 2

    def draw(self, scene: MissionState, centre: Place) -> Image.Image:
        """The frame around `centre`."""
        corner = self.corner_px(centre)
        still = self.ground.crop(*corner, self.size_px)
        large = (self.size_px[0] * SMOOTHING, self.size_px[1] * SMOOTHING)
        pen = Pen(still.resize(large, Image.Resampling.NEAREST), self.ground.scale, corner)
        pen.area(scene.seen, (*rgb(SEEN), SEEN_OPACITY))
        pen.line(scene.trail, (*rgb(UAV), 110), 1.2)
        for mark in scene.defects:
            _draw_defect(pen, mark)
        if scene.visibility is not None:
            pen.fill(_around(scene, self.window_m), (*visibility_rgb(scene.visibility), 70))
            pen.area(scene.hidden, (*rgb(HIDDEN), HIDDEN_OPACITY))
        for outline in bodies(scene.parked):
            _draw_vehicle(pen, outline, rgb(AGENT_COLOURS["parked"]), "parked")
        _draw_agents(pen, scene)
        if scene.visibility is not None:
            colour = visibility_rgb(scene.visibility)
            _draw_dashed(pen, _around(scene, self.footprint_m), (*rgb(style.INK_SOFT), 200))
            pen.line(_around(scene, self.window_m), WHITE, 4.5, closed=True)
            pen.line(_around(scene, self.window_m), colour, 2.8, closed=True)
        for mark in scene.defects:
            _draw_flash(pen, mark)
        _draw_uav(pen, scene)
        return pen.finished()


def _around(scene: MissionState, size_m: tuple[float, float]) -> Float64Array:
    """(4, 2) corners of a rectangle under the UAV, given as (across, along)."""
    return rectangles(*scene.uav.position, scene.uav.yaw_rad, *size_m)


def _draw_defect(pen: Pen, mark: DefectMark) -> None:
    if mark.outcome is None:
        pen.disc(mark.position, 3.6, None, rgb(OPEN_DEFECT), 1.6)
    else:
        pen.disc(mark.position, 4.2, rgb(style.OUTCOME_COLOURS[mark.outcome]), WHITE, 1.0)


def _draw_flash(pen: Pen, mark: DefectMark) -> None:
    if mark.outcome is not None and mark.age_s < FLASH_S:
        share = mark.age_s / FLASH_S
        colour = rgb(style.OUTCOME_COLOURS[mark.outcome])
        pen.disc(mark.position, 5 + 12 * share, None, (*colour, round(255 * (1 - 0.7 * share))), 2.4)
        pen.disc(mark.position, 4.6, colour, WHITE, 1.2)


def _draw_agents(pen: Pen, scene: MissionState) -> None:
    outlines = bodies(scene.agents)
    for index in np.argsort(scene.agents["height_m"], kind="stable"):
        colour = rgb(AGENT_COLOURS[scene.groups[index]])
        place = (scene.agents["x_m"][index], scene.agents["y_m"][index])
        if scene.agents["is_pedestrian"][index]:
            pen.disc(place, 3.4, colour, WHITE, 0.8)
        elif scene.groups[index] == "aircraft":
            pen.disc(place, 7.0, WHITE, colour, 2.4)
        else:
            _draw_vehicle(pen, outlines[index], colour, scene.groups[index])


def _draw_vehicle(pen: Pen, corners: Float64Array, colour: Rgb, group: str) -> None:
    """A body with cut corners, a windscreen and, except for trucks and buses, a rear window. Front: corners 0 and 1."""
    front_left, front_right, _, back_left = corners
    right, back = front_right - front_left, back_left - front_left
    length, width = float(np.hypot(*back)), float(np.hypot(*right))

    def at(along_m: float, across: float) -> Float64Array:
        return np.asarray(front_left + back * (along_m / length) + right * across)

    cut, side = 0.35, 0.35 / max(width, 0.5) * 0.6
    edge = [at(cut, 0), at(0, side), at(0, 1 - side), at(cut, 1), at(length - cut, 1), at(length - cut / 2, 1 - side)]
    edge += [at(length - cut / 2, side), at(length - cut, 0)]
    dark = tuple(round(0.55 * part) for part in colour)
    pen.fill([corner + (0.12, -0.12) for corner in edge], (60, 55, 50, 60))
    pen.fill(edge, colour)
    pen.line(edge, dark, 0.8, closed=True)
    if group == "motorcycle":
        pen.disc(at(length * 0.55, 0.5), 2.6, dark)
        return
    start = 0.25 if group in ("bus", "truck") else 0.25 * length
    pen.fill([at(start, 0.16), at(start, 0.84), at(start + 0.7, 0.76), at(start + 0.7, 0.24)], dark)
    if group == "truck":
        pen.line([at(2.2, 0.02), at(2.2, 0.98)], dark, 1.2)
    elif group != "bus":
        rear = 0.84 * length
        pen.fill([at(rear - 0.4, 0.26), at(rear - 0.4, 0.74), at(rear, 0.8), at(rear, 0.2)], dark)


def _draw_dashed(pen: Pen, corners: Float64Array, colour: tuple[int, ...]) -> None:
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(1, round(float(np.hypot(*(end - start))) / (2 * DASH_M)))
        for number in range(count):
            share = np.array([[number / count], [(number + 0.5) / count]])
            pen.line(start + share * (end - start), colour, 1.2)


def _draw_uav(pen: Pen, scene: MissionState) -> None:
    """Four rotors on arms, a body, and an arrowhead in the direction of the camera's top edge."""
    centre, ink = np.array(scene.uav.position), rgb(UAV)

    def at(ahead_m: float, left_m: float) -> Float64Array:
        c, s = cos(scene.uav.yaw_rad), sin(scene.uav.yaw_rad)
        return centre + (c * ahead_m - s * left_m, s * ahead_m + c * left_m)

    radius_px = ROTOR_M * pen.scale / SMOOTHING
    rotors = [at(ARM_M * cos(turn), ARM_M * sin(turn)) for turn in (pi / 4, 3 * pi / 4, 5 * pi / 4, 7 * pi / 4)]
    for pair in (rotors[::2], rotors[1::2]):
        pen.line(pair, WHITE, 4.5)
    for rotor in rotors:
        pen.disc(rotor, radius_px + 1, (255, 255, 255, 190), ink, 1.6)
    for pair in (rotors[::2], rotors[1::2]):
        pen.line(pair, ink, 2.2)
    arrow = [at(2.25, 0), at(1.35, 0.5), at(1.35, -0.5)]
    pen.line(arrow, WHITE, 3.0, closed=True)
    pen.fill(arrow, ink)
    pen.disc(centre, 5.0, ink, WHITE, 1.2)
