"""The images, one function each; every function gives a image for a web page of some 1300 pixels' width."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final

import numpy as np
from shapely import Polygon

from gallery.places import busy_street, drive, shown_best, street_ahead
from gallery.renderer import LOW_SUN, MORNING, OVERCAST, GalleryRenderer, Picture
from gallery.sheet import captioned, grid
from gallery.streets import streets
from pavetwin.capture.platforms.car import FRONT, REAR, Mount
from pavetwin.draw.animation_frame import DefectMark, MissionState
from pavetwin.draw.animation_frame import MapView as MapView
from pavetwin.draw.ground_raster import GroundRaster
from pavetwin.draw.mission_style import agent_group
from pavetwin.scene.agents import quadrotor
from pavetwin.scene.view import View, look, nadir
from pavetwin.twin import Mode, UavState
from pavetwin.world.model import Defect

SEVERITIES: Final = ("low", "medium", "high")
ALTITUDES_M: Final = (6.0, 10.0, 15.0)

CLOSE_UP_M: Final = {"single_crack": 2.4, "crocodile_crack": 3.8, "pothole": 2.0}
"""Height of the ground that a image of a defect shows [m]."""

HIGH_M: Final = 120.0
_HIGH_FOV: Final = math.radians(46.0)

_CELL: Final = (640, 640)
_NARROW_FOV: Final = math.radians(30.0)


def defects_above(renderer: GalleryRenderer) -> Picture:
    """The three classes at three severities, straight from above."""

    def view(defect: Defect) -> View:
        height = CLOSE_UP_M[defect.kind] / (2 * math.tan(_NARROW_FOV / 2))
        place = defect.polygon.centroid if defect.kind != "single_crack" else defect.centre
        return look(
            (place.x, place.y, height),
            yaw_rad=defect.yaw_rad,
            pitch_rad=-math.pi / 2,
            size_px=_CELL,
            vertical_fov_rad=_NARROW_FOV,
        )

    return _defects(renderer, view)


def defects_side(renderer: GalleryRenderer) -> Picture:
    """The same defects, seen by a pedestrian at the kerb."""

    def view(defect: Defect) -> View:
        away = 0.62 * CLOSE_UP_M[defect.kind] + 0.4
        yaw = defect.yaw_rad + math.radians(35.0)
        x, y = defect.centre.x - away * math.cos(yaw), defect.centre.y - away * math.sin(yaw)
        return look(
            (x, y, 0.62 * away),
            yaw_rad=yaw,
            pitch_rad=-math.atan2(0.62 * away, away),
            size_px=_CELL,
            vertical_fov_rad=math.radians(48.0),
        )

    return _defects(renderer, view)


def uav(renderer: GalleryRenderer) -> Picture:
    """What the UAV sees from 6, 10 and 15 m, without and with traffic."""
    placement = busy_street(renderer)
    rows = []
    for time_s, what in ((None, "empty street"), (placement.time_s, "high traffic")):
        for altitude_m in ALTITUDES_M:
            view = nadir(
                renderer.camera,
                (placement.x_m, placement.y_m, altitude_m),
                yaw_rad=placement.yaw_rad,
                size_px=(640, 480),
            )
            resolution = renderer.camera.footprint_m(altitude_m)[1] / 480 * 1000
            caption = f"{altitude_m:g} m   {resolution:.0f} mm a pixel   {what}"
            rows.append(captioned(renderer.take(view, MORNING, time_s=time_s), caption, height_px=320))
    return grid(rows, columns=3)


def light(renderer: GalleryRenderer) -> Picture:
    """One street under three skies."""
    placement = busy_street(renderer)
    view = nadir(renderer.camera, (placement.x_m, placement.y_m, 12.0), yaw_rad=placement.yaw_rad, size_px=(640, 640))
    skies = (("morning sun", MORNING), ("low sun", LOW_SUN), ("overcast", OVERCAST))
    taken = [(name, renderer.take(view, sky, time_s=placement.time_s)) for name, sky in skies]
    return grid([captioned(picture, name, height_px=426) for name, picture in taken], columns=3)


def car(renderer: GalleryRenderer) -> Picture:
    """What a hatchback's front and rear cameras see in the recorded traffic."""
    placement = drive(renderer)

    def picture(mount: Mount, size_px: tuple[int, int]) -> Picture:
        place = (
            placement.x_m + mount.x_m * math.cos(placement.yaw_rad),
            placement.y_m + mount.x_m * math.sin(placement.yaw_rad),
            mount.z_m,
        )
        view = look(
            place,
            yaw_rad=placement.yaw_rad,
            pitch_rad=mount.pitch_rad,
            size_px=size_px,
            vertical_fov_rad=mount.camera.fov_rad,
        )
        return renderer.take(view, MORNING, time_s=placement.time_s, without=placement.agent)

    level = Mount("level", 0.55, FRONT.z_m, -8.0, 48.0)
    ahead = captioned(picture(level, (1290, 726)), "through the windscreen", height_px=726)
    below = [
        captioned(picture(FRONT, (960, 640)), "front camera, 1.3 m high, pitched to the road", height_px=500),
        captioned(picture(REAR, (676, 640)), "rear camera, straight down", height_px=500),
    ]
    return grid([ahead, grid(below, columns=2)], columns=1)


def quadrotor_over_street(renderer: GalleryRenderer) -> Picture:
    """The UAV at work, seen from another one behind it."""
    placement = street_ahead(renderer)
    along = np.array([math.cos(placement.yaw_rad), math.sin(placement.yaw_rad)])
    place = np.array([placement.x_m, placement.y_m])
    flier = quadrotor((*place.tolist(), 9.0), placement.yaw_rad)
    behind = place - 2.6 * along + 0.55 * np.array([-along[1], along[0]])
    view = look(
        (*behind.tolist(), 9.9),
        yaw_rad=placement.yaw_rad - math.radians(9.0),
        pitch_rad=math.radians(-27.0),
        size_px=(1280, 720),
        vertical_fov_rad=math.radians(52.0),
    )
    light = replace(MORNING, sun_elevation_deg=42.0)
    return renderer.take(view, light, time_s=placement.time_s, more=[flier])


def street(renderer: GalleryRenderer) -> Picture:
    """The town from above its roofs."""
    placement = street_ahead(renderer)
    x = placement.x_m - 34.0 * math.cos(placement.yaw_rad)
    y = placement.y_m - 34.0 * math.sin(placement.yaw_rad)
    view = look(
        (x, y, 26.0),
        yaw_rad=placement.yaw_rad,
        pitch_rad=math.radians(-33.0),
        size_px=(1280, 720),
        vertical_fov_rad=math.radians(50.0),
    )
    return renderer.take(view, MORNING, time_s=placement.time_s)


def map_view(renderer: GalleryRenderer) -> Picture:
    """The same time seen from high above the street, and on the animation's map."""
    placement = busy_street(renderer)
    across_m = 2 * HIGH_M * math.tan(_HIGH_FOV / 2)
    view = look(
        (placement.x_m, placement.y_m, HIGH_M),
        yaw_rad=math.pi / 2,
        pitch_rad=-math.pi / 2,
        size_px=_CELL,
        vertical_fov_rad=_HIGH_FOV,
    )
    agents = renderer.trace.agents_near(placement.x_m, placement.y_m, across_m, placement.time_s)
    marks = [
        DefectMark((defect.centre.x, defect.centre.y), None)
        for defect in renderer.world.defects
        if math.dist((defect.centre.x, defect.centre.y), (placement.x_m, placement.y_m)) < across_m
    ]
    scene = MissionState(
        time_s=placement.time_s,
        uav=UavState((placement.x_m, placement.y_m), 10.0, 0.0, 1.0, placement.yaw_rad, Mode.INSPECT),
        visibility=None,
        agents=agents,
        groups=[
            agent_group(float(length), float(height), pedestrian=bool(walks))
            for length, height, walks in zip(
                agents["length_m"], agents["height_m"], agents["is_pedestrian"], strict=True
            )
        ],
        parked={name: column[:0] for name, column in agents.items()},
        hidden=Polygon(),
        seen=Polygon(),
        defects=marks,
        trail=np.array([[placement.x_m, placement.y_m]] * 2),
    )
    raster = GroundRaster(renderer.world, _CELL[0] / across_m)
    drawn = MapView(raster, _CELL, window_m=(1.0, 1.0), footprint_m=(1.0, 1.0)).draw(scene, scene.uav.position)
    seen = renderer.take(view, MORNING, time_s=placement.time_s)
    return grid(
        [
            captioned(seen, f"seen from {HIGH_M:.0f} m", height_px=_CELL[1]),
            captioned(
                np.asarray(drawn.convert("RGB")), "on the map, with the UAV and every defect", height_px=_CELL[1]
            ),
        ],
        columns=2,
    )


def _defects(renderer: GalleryRenderer, view: Callable[[Defect], View]) -> Picture:
    cells = []
    for kind in CLOSE_UP_M:
        for severity in SEVERITIES:
            defect = shown_best(renderer.paper, kind, severity)
            name = kind.replace("_", " ")
            size = f"{defect.width_m * 1000:.0f} mm wide, {defect.depth_m * 1000:.0f} mm deep"
            cells.append(
                captioned(renderer.paper.take(view(defect), MORNING), f"{name}, {severity}   {size}", height_px=426)
            )
    return grid(cells, columns=3)


PICTURES: Final[Mapping[str, Callable[[GalleryRenderer], Picture]]] = MappingProxyType(
    {
        "defects_above": defects_above,
        "defects_side": defects_side,
        "uav": uav,
        "light": light,
        "car": car,
        "quadrotor": quadrotor_over_street,
        "street": street,
        "streets": streets,
        "map": map_view,
    }
)
