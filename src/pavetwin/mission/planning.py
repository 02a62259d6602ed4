"""Planning of missions: from a user's choices to the specification, its segments, reach and folder."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import pairwise
from math import atan2, cos, hypot, isfinite, sin
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from shapely import Point

from pavetwin._core import Battery, FlightSettings, Limits
from pavetwin.arrays import Float64Array
from pavetwin.config import MissionSettings, load_settings
from pavetwin.config.options import options_of_one
from pavetwin.defects import DefectOptions
from pavetwin.errors import PaveTwinError, about
from pavetwin.mission.airspace import load_airspace
from pavetwin.mission.environment import MissionEnvironment, flight_settings, prepare, window_m
from pavetwin.mission.inputs import defects_of
from pavetwin.mission.spec import DefectInput, FileInput, MissionSpec, PolicyInput, TrafficInput, WorldInput
from pavetwin.navigation.patterns import PATTERNS, passes
from pavetwin.navigation.take_off import parse_base
from pavetwin.policies import load_policy, policy_class, policy_names
from pavetwin.seeds import Stream, child
from pavetwin.sensing import load_sensor
from pavetwin.traffic.demand import DEFAULT_TRAFFIC, Density, density_named, own_demand
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.recording_file import load_recording
from pavetwin.uav import aircraft_of, camera_of, energy_curve
from pavetwin.uav.wind import check_wind
from pavetwin.world.model import World
from pavetwin.world.store import load_record


@dataclass(frozen=True, slots=True)
class WayOut:
    """The way to the point of a segment that takes the most energy, and back, with one set of batteries."""

    segment: int
    """Index of the segment."""
    distance_m: float
    """One way, along the NavMesh."""
    needed: float
    """Least share of the usable energy: climb, way out and back, and landing, without turns, inspection and waiting."""


def ways_out(environment: MissionEnvironment, settings: MissionSettings, targets: Sequence[int]) -> Iterator[WayOut]:
    """For each segment, the way to the point of its passes that takes the most energy to reach and return from.

    Ways run along the NavMesh, each leg in its wind. A flight with full batteries from the base and back to it reaches
    every point of a pass.
    """
    flight = flight_settings(settings)
    start = environment.mesh.nearest(environment.world.base.x, environment.world.base.y)
    across_m = window_m(settings)[0]
    for target in targets:
        lines = passes(environment.world.segments[target], across_m, settings.pattern)
        points = np.unique(np.concatenate(lines), axis=0).tolist()
        ways = [environment.mesh.path(start, environment.mesh.nearest(*point)) for point in points]
        needed = [sum(_flown(line, flight.transit, flight.battery) for line in (way, way[::-1])) for way in ways]
        most = int(np.argmax(needed))
        yield WayOut(target, _length_m(ways[most]), needed[most] + _up_and_down(flight))


def check_reach(environment: MissionEnvironment, settings: MissionSettings, targets: Sequence[int]) -> None:
    """Refuse segments out of reach of one set of batteries.

    Raises:
        PaveTwinError: one set does not bring the UAV to a segment and back; the message names a remedy.
    """
    usable = 1.0 - settings.energy.reserve
    beyond = [way for way in ways_out(environment, settings, targets) if way.needed > usable]
    if not beyond:
        return
    farthest = max(beyond, key=lambda way: way.needed)
    segment = environment.world.segments[farthest.segment]
    profile, wind_mps = aircraft_of(settings), settings.conditions.wind_mps
    flyer = f"a {profile.title}" if profile else "this UAV"
    several = f"One battery is too small for {len(beyond)} of {len(targets)} segments, the farthest of them"
    what = several if len(beyond) > 1 else "One battery is too small for"
    wind = f" in a wind of {wind_mps:g} m/s" if wind_mps else ""
    help_wind = "wait for less wind, " if wind_mps else ""
    raise PaveTwinError(
        f"{what} '{segment.id}': {farthest.distance_m:.0f} m out and as far back at {settings.altitude_m:g} m{wind} "
        f"take {flyer} at least {100 * farthest.needed:.0f} % of its usable energy, and a flight may use "
        f"{100 * usable:.0f} %. Take off nearer to it (`base`), {help_wind}leave it out, fly another "
        "`aircraft` or with more energy (energy.capacity_wh, energy.reserve)."
    )


def _flown(way: Float64Array, limits: Limits, battery: Battery) -> float:
    """Share of the batteries for flying along a way, at the speeds that the wind leaves."""
    total = 0.0
    for (x0, y0), (x1, y1) in pairwise(way.tolist()):
        length_m, yaw = hypot(x1 - x0, y1 - y0), atan2(y1 - y0, x1 - x0)
        speed = limits.speed_towards(yaw)
        velocity = (speed * cos(yaw), speed * sin(yaw))
        total += battery.drained(velocity, seconds=length_m / speed)
    return total


def _up_and_down(flight: FlightSettings) -> float:
    """Share of the batteries for the climb to the altitude and the landing."""
    seconds = flight.altitude_m / flight.climb_speed_mps
    hover = (0.0, 0.0)
    climb = flight.battery.drained(hover, climb_mps=flight.climb_speed_mps, seconds=seconds)
    return climb + flight.battery.drained(hover, seconds=seconds)


def _length_m(way: Float64Array) -> float:
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


ORDERS = ("random", "near")


def choose_targets(
    environment: MissionEnvironment,
    *,
    count: int | None = None,
    names: Sequence[str] = (),
    order: str = "random",
    seed: int = 0,
) -> list[int]:
    """Indices of the segments to inspect.

    Args:
        count: number of segments; by default all that can be reached.
        names: inspect exactly these, in this order if `order` is random: ids of segments, or names of streets, which
            stand for all their segments.
        order: `random` for a randomised sequence, or `near` for a short tour from the base.

    Raises:
        PaveTwinError: a segment does not exist or cannot be reached, or the count does not fit.
    """
    if order not in ORDERS:
        raise PaveTwinError(f"`order` {order}: known are {', '.join(ORDERS)}.")
    world = environment.world
    if names:
        named = _named(environment, names)
        return named if order == "random" else short_tour(world, named)
    reachable = [index for index in range(len(world.segments)) if environment.reachable(index)]
    if not reachable:
        raise PaveTwinError(
            f"No segment of '{world.name}' can be reached from the base at {environment.altitude_m:g} m; "
            "choose another altitude, or another `base`."
        )
    if count is not None and count < 1:
        raise PaveTwinError(f"`count` {count}: at least one segment must be inspected.")
    if count is not None and count > len(reachable):
        there_are = (
            f"'{world.name}' has only {len(reachable)}"
            if len(reachable) == len(world.segments)
            else f"only {len(reachable)} of the {len(world.segments)} segments of '{world.name}' can be reached at "
            f"{environment.altitude_m:g} m"
        )
        raise PaveTwinError(f"`count` {count}: {there_are}; choose fewer, or all.")
    if order == "near":
        return short_tour(world, reachable)[:count]
    drawn = child(seed, Stream.ORDER).permutation(len(reachable))
    return [reachable[index] for index in drawn[:count]]


def _named(environment: MissionEnvironment, names: Sequence[str]) -> list[int]:
    index = {segment.id: number for number, segment in enumerate(environment.world.segments)}
    chosen = []
    for name in names:
        with about("names"):
            segments = environment.world.segments_named(name)
        for segment in segments:
            number = index[segment.id]
            what = name if name == segment.id else f"{name}, {segment.id}"
            if not environment.reachable(number):
                raise PaveTwinError(
                    f"`names` {what}: no way leads there from the base at {environment.altitude_m:g} m; "
                    "`pavetwin world navmesh` shows where one can fly. Choose another altitude or segment."
                )
            if number in chosen:
                raise PaveTwinError(f"`names` {what}: given more than once; a mission inspects a segment once.")
            chosen.append(number)
    return chosen


def short_tour(world: World, chosen: Sequence[int]) -> list[int]:
    """A short open tour from the base: nearest neighbour, then 2-opt.

    Args:
        chosen: indices of the segments to inspect.
    """
    middles = [world.segments[index].centre_line.interpolate(0.5, normalized=True) for index in chosen]
    places = np.vstack([[(world.base.x, world.base.y)], shapely.get_coordinates(middles)])
    distance = np.hypot(*np.moveaxis(places[:, None] - places[None], -1, 0))
    tour, left = [0], set(range(1, len(places)))
    while left:
        tour.append(min(left, key=lambda place: (float(distance[tour[-1], place]), place)))
        left.remove(tour[-1])
    return [chosen[place - 1] for place in _two_opt(tour, distance)[1:]]


def _two_opt(tour: list[int], distance: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> list[int]:
    improved = True
    while improved:
        improved = False
        for i in range(1, len(tour) - 1):
            for j in range(i + 1, len(tour)):
                before = distance[tour[i - 1], tour[i]]
                after = distance[tour[i - 1], tour[j]]
                if j + 1 < len(tour):
                    before += distance[tour[j], tour[j + 1]]
                    after += distance[tour[i], tour[j + 1]]
                if after < before - 1e-9:
                    tour[i : j + 1] = tour[i : j + 1][::-1]
                    improved = True
    return tour


ALL: Final = "all"
"""Stands for every registered policy."""


def plan_mission(
    world: World,
    settings: MissionSettings | None = None,
    *,
    density: Density | str | None = None,
    mix: str = "",
    routes: Sequence[Path | str] = (),
    recording: Path | str | None = None,
    traffic_seed: int | None = None,
    take_off_s: float | None = None,
    segments: int | Sequence[str] | None = 8,
    order: str = "random",
    policy: str = "hover",
    seed: int = 0,
    defect_seed: int | None = None,
    airspace: Path | str | None = None,
    base: tuple[float, float] | str | None = None,
    environment: MissionEnvironment | None = None,
) -> MissionSpec:
    """Specify a mission completely; nothing is flown or recorded yet.

    Args:
        settings: by default the preset `default`.
        density: of the traffic: a name (`los-C`, `hour-08`, `high`) or numbers; ignored if `routes` or a `recording`
            are given. By default level of service C, or the nearest that the world can reach.
        mix: mix of vehicles, if the density names none.
        routes: SUMO route files, driven as they are.
        recording: a file of recorded traffic.
        traffic_seed: seed of traffic and parked vehicles; by default `seed`.
        take_off_s: time of take-off in the recording; by default 0 for a density, and after a warm-up for a user's own
            demand (`OwnDemand.warm_up_s`).
        segments: number of segments to inspect (None: all that can be reached), or their ids.
        order: `random`, or `near` for a short tour.
        seed: seed of traffic, parked vehicles, order and sensor.
        defect_seed: seed for other defects, placed with the world's options.
        airspace: a CSV file of other aircraft's tracks.
        base: place of take-off: (x, y) in metres of the world's frame, or a text for `parse_base`; by default according
            to `settings.uav.base`.
        environment: the result of `prepare` for these settings and defects, if it exists already.

    Raises:
        PaveTwinError: a name does not exist, or a segment is out of reach: no way leads there, or it takes more than
            one set of batteries.
    """
    return plan_missions(
        world,
        settings or load_settings(),
        [policy],
        density=density,
        mix=mix,
        routes=routes,
        recording=recording,
        traffic_seed=traffic_seed,
        take_off_s=take_off_s,
        segments=segments,
        order=order,
        seed=seed,
        defect_seed=defect_seed,
        airspace=airspace,
        base=base,
        environment=environment,
    )[0][0]


def plan_missions(
    world: World,
    settings: MissionSettings,
    policies: Sequence[str],
    *,
    density: Density | str | None = None,
    mix: str = "",
    routes: Sequence[Path | str] = (),
    recording: Path | str | None = None,
    traffic_seed: int | None = None,
    take_off_s: float | None = None,
    segments: int | Sequence[str] | None = 8,
    order: str = "random",
    seed: int = 0,
    defect_seed: int | None = None,
    airspace: Path | str | None = None,
    base: tuple[float, float] | str | None = None,
    environment: MissionEnvironment | None = None,
) -> tuple[list[MissionSpec], MissionEnvironment]:
    """Specify missions that differ only in their policy, and return them with their common environment.

    Args and Raises: as `plan_mission`.
    """
    check_names(settings, policies, seed)
    if airspace is not None:
        with about("airspace"):
            load_airspace(Path(airspace))
    source = defect_input(world, defect_seed)
    street_seed = seed if traffic_seed is None else traffic_seed
    traffic = traffic_input(world, density, routes, recording, street_seed, take_off_s, mix)
    ready = environment or prepare(
        world,
        settings,
        defects_of(world, source),
        base=base_point(base, world),
        parking_seed=street_seed,
        parking_mix=traffic.mix,
    )
    count = segments if isinstance(segments, int) or segments is None else None
    names = () if isinstance(segments, int) or segments is None else segments
    targets = choose_targets(ready, count=count, names=names, order=order, seed=seed)
    check_reach(ready, settings, targets)
    if recording is not None:
        with about("recording"):
            _check_area(recording, world, targets)
    own = [settings_under(name, policies, settings) for name in policies]
    spec = MissionSpec.of(
        world=WorldInput.of(world),
        defects=source.model_copy(update={"content_hash": ready.defects_hash}),
        traffic=traffic,
        aircraft=FileInput.of(airspace) if airspace is not None else None,
        base=(ready.world.base.x, ready.world.base.y),
        targets=tuple(world.segments[index].id for index in targets),
        policy=PolicyInput.of(policies[0]),
        seed=seed,
        parking_seed=ready.parking.seed,
        parking_mix=ready.parking.mix,
        settings=own[0],
    )
    return [spec.with_policy(name, its) for name, its in zip(policies, own, strict=True)], ready


def _check_area(recording: Path | str, world: World, targets: Sequence[int]) -> None:
    """Raises:
    PaveTwinError: the recording has no traffic on a target.
    """
    area = load_recording(recording, world).origin.area
    if area is not None and (missed := area.misses(world.segments[index] for index in targets)):
        raise PaveTwinError(
            f"'{recording}' has no traffic on {missed[0]}: it holds the streets within {area.distance_m:g} m of other "
            "segments. Inspect those, or give a density."
        )


def policies_named(given: Iterable[str]) -> list[str]:
    """Unique names of policies; `all` stands for every registered one."""
    return list(dict.fromkeys(name for each in given for name in (policy_names() if each == ALL else [each])))


def settings_under(policy: str, policies: Iterable[str], settings: MissionSettings) -> MissionSettings:
    """The settings for one of several policies: of the common options it gets those that it has.

    Raises:
        PaveTwinError: none of the policies has an option, or a policy is unknown.
    """
    options = settings.policy.options
    if not options or [*policies] == [policy]:
        return settings
    has = {name: policy_class(name).default_options for name in policies}
    own = options_of_one(policy, has, options, key="policy.options", owners="policy of these missions")
    return settings.model_copy(update={"policy": settings.policy.model_copy(update={"options": own})})


def check_names(settings: MissionSettings, policies: Iterable[str], seed: int) -> dict[str, str]:
    """Check every name of a mission before anything takes time.

    Returns:
        The name of each policy, by the text given for it.

    Raises:
        PaveTwinError: a name is unknown; the message names the nearest.
    """
    if seed < 0:
        raise PaveTwinError(f"`seed` {seed}: seeds are whole numbers from 0.")
    given = list(policies)
    names = {policy: load_policy(policy, settings_under(policy, given, settings).policy).name for policy in given}
    check_distinct(names)
    PATTERNS.get(settings.pattern.kind)
    load_sensor(settings.sensing, seed)
    camera_of(settings)
    energy_curve(settings)
    check_wind(settings)
    return names


def check_distinct(names: Mapping[str, str]) -> None:
    """Check that policies have distinct names.

    Args:
        names: the name of each policy, by the text given for it.

    Raises:
        PaveTwinError: two names are the same.
    """
    for policy, name in names.items():
        first = next(other for other, its in names.items() if its == name)
        if first != policy:
            raise PaveTwinError(f"`policy`: '{first}' and '{policy}' are both named '{name}'; rename one of them.")


def base_point(base: tuple[float, float] | str | None, world: World) -> Point | None:
    """The `base` of `plan_mission` as a point of the world's frame."""
    return parse_base(base, world) if isinstance(base, str) else None if base is None else Point(base)


def defect_input(world: World, seed: int | None) -> DefectInput:
    """The world's own defects, or others placed under a seed with the same options.

    Raises:
        PaveTwinError: the record of the world's folder is invalid.
    """
    if seed is None:
        return DefectInput()
    if world.folder is None:
        return DefectInput(seed=seed)
    return DefectInput(seed=seed, options=DefectOptions.of_record(load_record(world.folder)))


def traffic_input(
    world: World,
    density: Density | str | None,
    routes: Sequence[Path | str],
    recording: Path | str | None,
    seed: int,
    take_off_s: float | None = None,
    mix: str = "",
) -> TrafficInput:
    """The source of a mission's traffic; see `plan_mission`.

    Raises:
        PaveTwinError: there is no such density or file, or the recording is of another world.
    """
    if take_off_s is not None and not (isfinite(take_off_s) and take_off_s >= 0):
        raise PaveTwinError(f"`take_off_s` {take_off_s:g}: expected seconds from 0 up.")
    if recording is not None:
        with about("recording"):
            recorded = load_recording(recording, world)
        origin, begin_s = recorded.origin, recorded.warm_up_s if take_off_s is None else take_off_s
        return TrafficInput.of(origin.asked, origin.seed, routes=routes, recording=Path(recording), take_off_s=begin_s)
    if routes:
        Inputs.of(world, None, seed, routes)
        begin_s = own_demand(routes).warm_up_s if take_off_s is None else take_off_s
        return TrafficInput.of(None, seed, routes=routes, take_off_s=begin_s)
    given = DEFAULT_TRAFFIC if density is None else density
    asked = density_named(given, mix) if isinstance(given, str) else given
    return TrafficInput.of(asked, seed, take_off_s=take_off_s or 0.0, or_nearest=density is None)


def mission_folder(
    spec: MissionSpec, policies: Sequence[str], preset: str, *, usual_targets: bool, usual_base: bool = True
) -> Path:
    """Default folder of a mission, such as `hover-high-1-10m-default-seed1-3f2a9c`.

    It lies in the world's folder `missions`, or in `missions/WORLD` of the working directory if that is read-only. The
    name has the main choices, and a short hash of all others that differ from their defaults.

    Args:
        policies: one policy, or several flown over the same inputs.
        usual_targets: the targets follow from the seed alone.
        usual_base: the base follows from the settings.
    """
    unusual: dict[str, object] = {}
    if not usual_targets:
        unusual["targets"] = spec.targets
    if not usual_base:
        unusual["base"] = spec.base
    if spec.defects.seed is not None:
        unusual["defect_seed"] = spec.defects.seed
    if spec.aircraft is not None:
        unusual["aircraft"] = (
            spec.aircraft.sha256
            if isinstance(spec.aircraft, FileInput)
            else [track.model_dump(mode="json") for track in spec.aircraft]
        )
    if spec.settings != load_settings(preset, altitude_m=spec.settings.altitude_m):
        unusual["settings"] = spec.settings.model_dump(mode="json")
    traffic = spec.traffic
    if traffic.routes or traffic.recording or traffic.take_off_s:
        recording = traffic.recording.sha256 if traffic.recording else ""
        unusual["traffic"] = [recording, traffic.take_off_s, *(route.sha256 for route in traffic.routes)]
    files = [*spec.plugins, *(file for name in policies for file in PolicyInput.of(name).files)]
    if files:
        unusual["files"] = [file.sha256 for file in files]
    every = len(policies) > 1 and set(policies) == set(policy_names())
    name = ALL if every else "+".join(name.rpartition(":")[2] for name in policies)
    plain = f"{name}-{traffic.name}-{spec.settings.altitude_m:g}m-{preset}-seed{spec.seed}"
    mark = sha256(json.dumps(unusual, sort_keys=True).encode()).hexdigest()[:6]
    world = Path(spec.world.path)
    place = world / "missions" if os.access(world, os.W_OK) else Path("missions") / spec.world.name
    return place / (f"{plain}-{mark}" if unusual else plain)
