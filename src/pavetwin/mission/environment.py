"""The environment of missions: a world at one altitude with its parked vehicles, ready for the kernel."""

import datetime as dt
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date, time
from functools import cached_property
from math import ceil, radians
from typing import TYPE_CHECKING, Final, Self

import numpy as np
import shapely
from shapely import Point

from pavetwin._core import Battery, Flight, FlightSettings, Ground, Limits, NadirCamera, NavMesh, Trace
from pavetwin.arrays import Float64Array
from pavetwin.config import MissionSettings
from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import VERTICAL_CLEARANCE_M, CameraSettings, ParkingSettings, PatternSettings, UavSettings
from pavetwin.defects import sample_points
from pavetwin.navigation.navmesh import navmesh, segments_in_reach
from pavetwin.navigation.patterns import Pass, passes
from pavetwin.navigation.take_off import check_base, roadside
from pavetwin.pci import Survey, sample_units
from pavetwin.scene.light import sun_elevation_deg
from pavetwin.sensing.frame import Sighting
from pavetwin.sensing.resolution import orientations_of, smallest_extent_m
from pavetwin.traffic.demand import DEFAULT_MIX
from pavetwin.traffic.parked import ParkedVehicles, parked_vehicles
from pavetwin.twin import Agent
from pavetwin.twin.state import agents_of
from pavetwin.uav import AircraftProfile, Camera, aircraft_of, camera_of, energy_curve
from pavetwin.uav.energy import CURVE_STEP_MPS
from pavetwin.uav.wind import check_wind
from pavetwin.world.model import Defect, Segment, Surface, World, defects_hash
from pavetwin.world.solids import SolidKind, Solids, parked_boxes, solids

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns

FIRST_ID: Final = 2**31
"""Ids of parked vehicles as agents begin here; those of recorded traffic are lower."""

SAMPLE_M: Final = 0.5
"""Viewpoints along a pass by which `permanently_hidden` is found are at most this far apart."""


@dataclass(frozen=True, slots=True)
class ParkingInput:
    """The choices that determine which vehicles are parked where in a world."""

    settings: ParkingSettings
    date: date
    time: time
    seed: int
    mix: str = DEFAULT_MIX
    """Name of the mix of vehicles."""

    @classmethod
    def of(cls, settings: MissionSettings, seed: int, mix: str = DEFAULT_MIX) -> Self:
        """The choices of a mission: its settings, and the seed and mix of its parked vehicles."""
        return cls(settings.parking, settings.conditions.date, settings.conditions.time, seed, mix)

    def vehicles(self, world: World) -> ParkedVehicles:
        """The vehicles in the world's parking places."""
        conditions = Conditions(date=self.date, time=self.time)
        return parked_vehicles(world, self.settings, conditions, self.seed, self.mix)

    def is_as(self, other: Self, world: World) -> bool:
        """True if both park the same vehicles in a world."""
        none = not world.parking or not (self.settings.enabled or other.settings.enabled)
        return none or self == other


def parked_columns(parked: ParkedVehicles) -> "PoseColumns":
    """Parked vehicles as agents that stand still, one array per column, to be drawn and labelled like recorded
    agents."""
    still = np.zeros(len(parked))
    return {
        "agent": (FIRST_ID + parked.place).astype(np.uint32),
        "x_m": parked.x,
        "y_m": parked.y,
        "yaw_rad": parked.yaw_rad,
        "east_mps": still,
        "north_mps": still,
        "length_m": parked.length_m,
        "width_m": parked.width_m,
        "height_m": parked.height_m,
        "is_pedestrian": np.zeros(len(parked), dtype=np.bool_),
    }


def parked_agents(parked: ParkedVehicles) -> tuple[Agent, ...]:
    """Parked vehicles as `Agent` values."""
    return tuple(replace(agent, is_parked=True) for agent in agents_of(parked_columns(parked)))


def parked_solids(parked: ParkedVehicles) -> Solids:
    """Boxes of parked vehicles, which hide the ground."""
    xy = np.column_stack([parked.x, parked.y])
    return parked_boxes(xy, parked.yaw_rad, parked.length_m, parked.width_m, parked.height_m)


def permanently_hidden(
    ground: Ground, segment: int, passes: list[Pass], camera: NadirCamera, altitude_m: float
) -> float:
    """Share of a segment's cells that no capture along its passes can see because of parked vehicles.

    A cell counts if it lies in the inspection window of some viewpoint with nothing built or grown in front of it, and
    no viewpoint sees it. Viewpoints are on the passes as planned, at both ends and `SAMPLE_M` or less apart, turned
    along the pass. Moving agents are left out.
    """
    places, yaws = zip(*(_viewpoints(line) for line in passes), strict=True)
    reach = ground.reach(segment, camera, altitude_m, np.concatenate(places), np.concatenate(yaws))
    return reach["permanently_hidden"] / reach["cells"]


def _viewpoints(line: Pass) -> tuple[Float64Array, Float64Array]:
    """Places (n, 2) along a pass and the yaws (n,) there."""
    path = shapely.LineString(line)
    at = np.linspace(0.0, path.length, max(2, int(np.ceil(path.length / SAMPLE_M)) + 1))
    places = shapely.get_coordinates(shapely.line_interpolate_point(path, at))
    legs = np.diff(line, axis=0)
    ends = np.cumsum(np.hypot(*legs.T))
    ahead = legs[np.minimum(np.searchsorted(ends, at), len(legs) - 1)]
    return places, np.arctan2(ahead[:, 1], ahead[:, 0])


INSPECT_MPS: Final = 5.0
"""Default speed of inspection, where the camera keeps up: the paper's."""


@dataclass(frozen=True)
class MissionEnvironment:
    """A world at one altitude, ready for the kernel. Shared by all missions with the same altitude and cells."""

    world: World
    """With the base that missions take off from."""
    defects: tuple[Defect, ...]
    altitude_m: float
    ground: Ground
    mesh: NavMesh
    """The NavMesh of the flight domain."""
    segments_in_reach: tuple[bool, ...]
    """For each segment, True if a way leads from the base to its middle."""
    parking: ParkingInput
    """The choices behind `parked`."""
    parked: ParkedVehicles
    _hidden: dict[tuple[int, CameraSettings, PatternSettings], float] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _sightings: dict[int, Sighting] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Sightings of whole defects by id: the part that does not depend on the capture."""
    _surveys: dict[str, Survey] = field(default_factory=dict, init=False, repr=False, compare=False)
    _suns_deg: dict[tuple[dt.date, dt.time], float] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def parked_agents(self) -> tuple[Agent, ...]:
        """The parked vehicles as agents."""
        return parked_agents(self.parked)

    def permanently_hidden(self, index: int, settings: MissionSettings) -> float:
        """Share of a segment's cells that no capture of its planned passes can see because of parked vehicles."""
        if not len(self.parked):
            return 0.0
        key = (index, settings.camera, settings.pattern)
        if key not in self._hidden:
            camera = nadir_camera(camera_of(settings), settings.camera)
            lines = passes(self.world.segments[index], camera.window_m(self.altitude_m)[0], settings.pattern)
            self._hidden[key] = permanently_hidden(self.ground, index, lines, camera, self.altitude_m)
        return self._hidden[key]

    def survey_of(self, segment: Segment) -> Survey:
        """The sample units of a segment with its defects, for its condition index."""
        if segment.id not in self._surveys:
            here = [self.defects[number] for number in self.defects_by_segment.get(segment.id, ())]
            self._surveys[segment.id] = Survey(sample_units([segment]), here)
        return self._surveys[segment.id]

    def sun_elevation_deg(self, conditions: Conditions) -> float:
        """Elevation of the sun over the world when a mission begins."""
        moment = conditions.date, conditions.time
        if moment not in self._suns_deg:
            self._suns_deg[moment] = sun_elevation_deg(conditions, self.world)
        return self._suns_deg[moment]

    @property
    def inspected_world(self) -> World:
        """The world with the defects that are looked for."""
        return replace(self.world, defects=self.defects)

    @cached_property
    def defects_hash(self) -> str:
        """SHA-256 over the defects."""
        return defects_hash(self.defects)

    def sighting(self, number: int, visible_fraction: float, attempt: int) -> Sighting:
        """The sighting of a defect, by its id, in a frame."""
        whole = self._sightings.get(number)
        if whole is None:
            defect = self.defects[number]
            whole = Sighting(defect, 1.0, 0, smallest_extent_m(defect), orientations_of(defect))
            self._sightings[number] = whole
        return Sighting(whole.defect, visible_fraction, attempt, whole.across_m, whole.orientations)

    @cached_property
    def defects_by_segment(self) -> Mapping[str, Sequence[int]]:
        """Ids of the defects by segment, for segments with defects."""
        found: dict[str, list[int]] = {}
        for defect in self.defects:
            found.setdefault(defect.segment, []).append(defect.id)
        return found

    def reachable(self, index: int) -> bool:
        """True if a segment, by its index, can be reached from the base."""
        return self.segments_in_reach[index]


@dataclass(frozen=True)
class Surroundings:
    """The static surroundings of flights at one altitude, independent of defects and cells."""

    base: Point
    """Where the UAV takes off."""
    solids: Solids
    mesh: NavMesh
    segments_in_reach: tuple[bool, ...]

    @classmethod
    def of(
        cls,
        world: World,
        altitude_m: float,
        uav: UavSettings,
        base: Point | None = None,
        standing: Solids | None = None,
    ) -> Self:
        """Bake or read the NavMesh, and choose the base if none is given.

        Args:
            standing: the solids of the world, the same at all altitudes; computed if not given.

        Raises:
            PaveTwinError: no flight domain is left at this altitude, or no UAV can take off from the base.
        """
        standing = solids(world) if standing is None else standing
        if base is not None:
            check_base(world, base, altitude_m, uav.radius_m, standing)
        elif uav.base == "roadside":
            base = roadside(world, uav.radius_m, standing)
        else:
            base = world.base
        mesh = navmesh(world, altitude_m, uav.radius_m, standing)
        return cls(base, standing, mesh, segments_in_reach(replace(world, base=base), mesh))


def prepare(
    world: World,
    settings: MissionSettings,
    defects: Sequence[Defect] | None = None,
    surroundings: Surroundings | None = None,
    *,
    base: Point | None = None,
    points_of: Callable[[int], Float64Array] | None = None,
    parking_seed: int = 0,
    parking_mix: str = DEFAULT_MIX,
) -> MissionEnvironment:
    """Bake the flight domain, grid the segments' surfaces, and pass both to the kernel with all static objects.

    Vehicles are parked according to the settings, at the date and time of their conditions.

    Args:
        defects: the defects to look for, ids 0 … n−1 in order; by default those of the world.
        surroundings: the surroundings of this world at this altitude; computed if not given.
        base: place of take-off; by default according to the settings.
        points_of: `sample_points` of a defect by its id, if several environments share them.
        parking_seed: seed of the parked vehicles.
        parking_mix: name of their mix, usually that of the traffic.

    Raises:
        PaveTwinError: no flight domain is left at this altitude, or no UAV can take off from the base.
    """
    chosen = tuple(world.defects if defects is None else defects)
    around = surroundings or Surroundings.of(world, settings.altitude_m, settings.uav, base)
    parking = ParkingInput.of(settings, parking_seed, parking_mix)
    parked = parking.vehicles(world)
    boxes = parked_solids(parked)
    if base is not None:
        check_base(world, around.base, settings.altitude_m, settings.uav.radius_m, boxes)
    standing = around.solids.with_others(boxes)
    index = {segment.id: number for number, segment in enumerate(world.segments)}
    ground = Ground(
        around.mesh,
        cell_m=settings.visibility.cell_m,
        surface_rings=[_rings(segment.polygon) for segment in world.segments],
        solid_offsets=standing.offsets.astype(np.uint32),
        solid_xy=standing.xy,
        solid_z0=standing.z0,
        solid_z1=standing.z1,
        solid_is_parked=standing.kind == SolidKind.PARKED_VEHICLE,
        defect_centres=np.array([(d.centre.x, d.centre.y) for d in chosen], dtype=np.float64).reshape(-1, 2),
        defect_segments=np.array([index[defect.segment] for defect in chosen], dtype=np.uint32),
        defect_points=points_of or (lambda number: sample_points(chosen[number])),
    )
    flown = replace(world, base=around.base)
    return MissionEnvironment(
        flown,
        chosen,
        settings.altitude_m,
        ground,
        around.mesh,
        around.segments_in_reach,
        parking=parking,
        parked=parked,
    )


def new_flight(
    environment: MissionEnvironment, trace: Trace, settings: MissionSettings, *, every_capture: bool = False
) -> Flight:
    """A UAV on the ground at the base, at the beginning of the recording.

    Args:
        every_capture: stop at every capture, not only at those that show a wanted defect.
    """
    base = (environment.world.base.x, environment.world.base.y)
    return Flight(environment.ground, trace, flight_settings(settings, every_capture=every_capture), base=base)


def flight_settings(settings: MissionSettings, *, every_capture: bool = False) -> FlightSettings:
    """The settings for the kernel: limits, drain curve, camera, and intervals in time steps.

    Raises:
        PaveTwinError: there is no such aircraft, camera or energy model, or the wind is above the aircraft's limit.
    """
    check_wind(settings)
    uav, step_s, profile = settings.uav, settings.time_step_s, aircraft_of(settings)
    climb_mps = (
        (uav.climb_speed_mps,) if profile is None else (uav.climb_speed_mps, profile.climb_mps, profile.descent_mps)
    )
    return FlightSettings(
        altitude_m=settings.altitude_m,
        time_step_s=step_s,
        radius_m=uav.radius_m,
        clearance_m=VERTICAL_CLEARANCE_M,
        inspect=_limits(settings, profile, inspect_speed_mps(settings)),
        transit=_limits(settings, profile, uav.transit_speed_mps),
        stopping_distance_m=uav.stopping_distance_m,
        climb_speed_mps=min(climb_mps),
        camera=nadir_camera(camera_of(settings), settings.camera),
        look_steps=round(settings.visibility.interval_s / step_s),
        capture_steps=round(capture_interval_s(settings) / step_s),
        threshold=settings.visibility.threshold,
        min_visible_fraction=settings.sensing.min_visible_fraction,
        battery=_battery(settings),
        every_capture=every_capture,
    )


def nadir_camera(camera: Camera, settings: CameraSettings) -> NadirCamera:
    """A camera with the inspection window of the settings."""
    return NadirCamera(
        image_px=camera.image_px,
        vertical_fov_rad=camera.fov_rad,
        window_rows=settings.window_rows,
        window_columns=settings.window_columns,
        window_across_per_altitude=settings.window_across_per_altitude,
    )


def shutter_s(settings: MissionSettings) -> float:
    """Shutter time of captures: the setting, or the camera's shortest if that is longer."""
    return max(settings.camera.exposure_s, camera_of(settings).shortest_exposure_s or 0.0)


def capture_interval_s(settings: MissionSettings) -> float:
    """Time between captures: the setting, or the camera's shortest if that is longer; a whole number of time steps."""
    shortest_steps = ceil((camera_of(settings).shortest_interval_s or 0.0) / settings.time_step_s - 1e-6)
    return max(settings.camera.capture_interval_s, shortest_steps * settings.time_step_s)


def inspect_speed_mps(settings: MissionSettings) -> float:
    """Speed of inspection over the ground: the setting, or else `INSPECT_MPS`, limited to the fastest speed at which
    the windows of captures touch at the camera's shortest interval."""
    if settings.uav.inspect_speed_mps is not None:
        return settings.uav.inspect_speed_mps
    shortest_s = camera_of(settings).shortest_interval_s
    return INSPECT_MPS if shortest_s is None else min(INSPECT_MPS, window_m(settings)[1] / shortest_s)


def window_m(settings: MissionSettings) -> tuple[float, float]:
    """The inspection window (across the track, along it) at the mission's altitude, in metres."""
    return nadir_camera(camera_of(settings), settings.camera).window_m(settings.altitude_m)


def _limits(settings: MissionSettings, profile: AircraftProfile | None, speed_mps: float) -> Limits:
    return Limits(
        speed_mps=speed_mps,
        acceleration_mps2=settings.uav.acceleration_mps2,
        yaw_rate_rad_s=radians(settings.uav.yaw_rate_deg_s),
        airspeed_mps=None if profile is None else profile.top_speed_mps,
        wind_mps=settings.conditions.wind_velocity_mps,
    )


def _battery(settings: MissionSettings) -> Battery:
    curve = energy_curve(settings)
    return Battery(
        drain_per_s=curve.drain_per_s - curve.lift_per_s,
        lift_per_s=curve.lift_per_s,
        drain_step_mps=CURVE_STEP_MPS,
        drain_per_m_climbed=curve.drain_per_m_climbed,
        wind_mps=settings.conditions.wind_velocity_mps,
        reserve=settings.energy.reserve,
    )


def _rings(surface: Surface) -> list[Float64Array]:
    return [
        shapely.get_coordinates(ring)
        for part in shapely.get_parts(surface)
        for ring in (part.exterior, *part.interiors)
    ]
