"""Plans of flown missions, and of selected segments that need no mission."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby, pairwise
from math import atan2, degrees, hypot
from typing import Any, Final

import polars as pl
import shapely
from shapely import Point

from pavetwin._core import NavMesh
from pavetwin.config import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.flightplan.flight_plan import LEAST_LEG_M, FlightPlan, PlannedFlight, Trigger, WayHome, Waypoint
from pavetwin.mission.environment import capture_interval_s, inspect_speed_mps, prepare
from pavetwin.mission.estimate import EmptyStreets
from pavetwin.mission.fly import fly_over
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.planning import check_reach, choose_targets
from pavetwin.mission.saving import TRACK, track_table
from pavetwin.navigation.navmesh import navmesh
from pavetwin.twin import Mode
from pavetwin.world.georeference import DEFAULT_ANCHOR_DEG, GeoReference, anchored, from_wgs84
from pavetwin.world.model import World
from pavetwin.world.solids import solids

COLUMNS: Final = ("x_m", "y_m", "altitude_m", "mode", "segment")
"""Columns of the track that a plan needs."""

TOLERANCE_M: Final = 0.05
"""Largest distance of the simplified path from the track."""

PASSED_DEG: Final = 45.0
"""The aircraft stops at waypoints with a sharper turn, and passes the others."""

MOST_CORNER_M: Final = 1.0
"""The largest distance from a waypoint at which the turn begins; the inspected strip is some metres wide."""

_ROUTE: Final = (Mode.TRANSIT, Mode.INSPECT, Mode.REVISIT, Mode.HOME)
"""Modes that a plan keeps. Waiting, displacements and giving way to aircraft react to the traffic of the moment. So do
revisits, but the rest of the way begins at the last of them."""


@dataclass(frozen=True, slots=True)
class _Sample:
    """A row of the track in the world frame, with the columns of a plan."""

    x_m: float
    y_m: float
    height_m: float
    photographs: bool
    segment: str | None

    def distance_m(self, other: "_Sample") -> float:
        return hypot(other.x_m - self.x_m, other.y_m - self.y_m)


def plan_of(mission: MissionFolder, world: World, *, trigger: Trigger = Trigger.DISTANCE) -> FlightPlan:
    """The plan of a mission, from the track in its folder.

    Args:
        world: the world of the mission.

    Raises:
        PaveTwinError: the world is not georeferenced, or the track is missing or damaged.
    """
    check_place(world)
    try:
        plan = plan_of_track(mission.track, mission.spec.settings, world, name=mission.name, trigger=trigger)
    except pl.exceptions.PolarsError as error:
        raise PaveTwinError(f"'{mission.folder / TRACK}' is damaged; fly the mission again: {error}") from error
    if not plan.flights:
        raise PaveTwinError(f"'{mission.folder / TRACK}' holds no flight.")
    return plan


def plan_of_track(
    track: pl.DataFrame, settings: MissionSettings, world: World, *, name: str, trigger: Trigger
) -> FlightPlan:
    """The plan of a track, as `track_table` makes it."""
    rows = track.select(COLUMNS).cast({"mode": pl.String}).to_dicts()
    inspect_mps = inspect_speed_mps(settings)
    speeds = {True: inspect_mps, False: settings.uav.transit_speed_mps}
    made = [_flight(each, speeds, world.georeference) for each in _flights(rows)]
    flights = tuple(each for each in made if each.distance_m >= LEAST_LEG_M)
    interval_s = capture_interval_s(settings)
    return FlightPlan(
        name=name,
        aircraft=settings.aircraft,
        flights=flights,
        interval_s=interval_s,
        spacing_m=inspect_mps * interval_s,
        trigger=trigger,
        remarks=tuple(_remarks(rows)),
        flown_at=settings.conditions.utc(flights[0].home.longitude if flights else 0.0),
        way_home=_way_home(world, settings),
    )


def _way_home(world: World, settings: MissionSettings) -> WayHome:
    """Shortest ways within the flight domain of the mission, read at the first request."""

    @cache
    def mesh() -> NavMesh:
        return navmesh(world, settings.altitude_m, settings.uav.radius_m, solids(world))

    def way(here: Waypoint, home: Waypoint) -> Sequence[tuple[float, float]]:
        places = [(here.longitude, here.latitude), (home.longitude, home.latitude)]
        start, goal = (mesh().nearest(*xy) for xy in from_wgs84(world.georeference, places).tolist())
        corners = world.georeference.to_wgs84(mesh().path(start, goal))
        return [(round(longitude, 8), round(latitude, 8)) for longitude, latitude in corners.tolist()]

    return way


def check_place(world: World) -> None:
    """Check that a world is georeferenced.

    Raises:
        PaveTwinError: it has no georeference of its own.
    """
    if world.georeference == anchored(*DEFAULT_ANCHOR_DEG):
        raise PaveTwinError(
            f"The world '{world.name}' is not georeferenced, so no drone can fly there; build it with a place, as in "
            "`pavetwin world build SOURCE --anchor 52.47,13.44`, or from a map."
        )


def _flights(rows: Sequence[Mapping[str, Any]]) -> Iterator[list[_Sample]]:
    """Samples on the route, per set of batteries: each set begins with a climb."""
    number, numbers = 0, []
    for before, row in pairwise([{"mode": None}, *rows]):
        number += row["mode"] == Mode.CLIMB and before["mode"] != Mode.CLIMB
        numbers.append(number)
    for _, group in groupby(zip(numbers, rows, strict=True), key=lambda each: each[0]):
        route = [_sample(row) for _, row in group if row["mode"] in _ROUTE]
        if len(route) > 1:  # the end is above the take-off point
            yield [*route, replace(route[0], height_m=route[-1].height_m, photographs=False, segment=None)]


def _sample(row: Mapping[str, Any]) -> _Sample:
    return _Sample(
        x_m=row["x_m"],
        y_m=row["y_m"],
        height_m=row["altitude_m"],
        photographs=row["mode"] == Mode.INSPECT,
        segment=row["segment"],
    )


def _flight(samples: Sequence[_Sample], speeds: Mapping[bool, float], place: GeoReference) -> PlannedFlight:
    kept = _without_short_legs([sample for part in _parts(samples) for sample in part])
    lonlat = place.to_wgs84([(each.x_m, each.y_m) for each in kept])
    corners = _corners(kept)
    return PlannedFlight(
        tuple(
            Waypoint(
                longitude=round(float(longitude), 8),
                latitude=round(float(latitude), 8),
                height_m=round(each.height_m, 2),
                speed_mps=round(speeds[each.photographs], 2),
                photographs=each.photographs,
                corner_m=round(corner, 2),
                segment=each.segment if each.photographs else None,
            )
            for each, corner, (longitude, latitude) in zip(kept, corners, lonlat, strict=True)
        )
    )


def _parts(samples: Sequence[_Sample]) -> Iterator[list[_Sample]]:
    """Simplified stretches with the same settings, each without its end, which begins the next one."""
    edges = [0] + [i for i in range(1, len(samples)) if _kind(samples[i]) != _kind(samples[i - 1])] + [len(samples) - 1]
    for first, last in pairwise(dict.fromkeys(edges)):
        part = samples[first : last + 1]
        line = shapely.LineString([(each.x_m, each.y_m, number) for number, each in enumerate(part)])
        kept = shapely.get_coordinates(line.simplify(TOLERANCE_M, preserve_topology=False), include_z=True)[:-1, 2]
        yield [part[int(number)] for number in kept] or [part[0]]
    yield [samples[-1]]


def _kind(sample: _Sample) -> tuple[bool, str | None, float]:
    return sample.photographs, sample.segment, sample.height_m


def _without_short_legs(samples: Sequence[_Sample]) -> list[_Sample]:
    """Samples without legs below `LEAST_LEG_M`. The first, the last and those that switch the camera are kept; only the
    first leg may be shorter."""
    kept = [samples[0]]
    for each in samples[1:]:
        changes = each.photographs != kept[-1].photographs or each is samples[-1]
        if not changes and kept[-1].distance_m(each) < LEAST_LEG_M:
            continue
        while len(kept) > 1 and kept[-1].distance_m(each) < LEAST_LEG_M:
            kept.pop()
        kept.append(each)
    return kept


def _corners(samples: Sequence[_Sample]) -> list[float]:
    """For each sample, the distance at which the turn begins: 0 if the aircraft stops."""
    corners = [0.0]
    for before, here, after in zip(samples, samples[1:], samples[2:], strict=False):
        shorter_m = min(before.distance_m(here), here.distance_m(after))
        stops = before.photographs != here.photographs or _turn_deg(before, here, after) > PASSED_DEG
        corners.append(0.0 if stops else min(MOST_CORNER_M, 0.4 * shorter_m))
    return [*corners, 0.0]


def _turn_deg(before: _Sample, here: _Sample, after: _Sample) -> float:
    come = atan2(here.y_m - before.y_m, here.x_m - before.x_m)
    go = atan2(after.y_m - here.y_m, after.x_m - here.x_m)
    return abs((degrees(go - come) + 180.0) % 360.0 - 180.0)


def _remarks(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    modes = {row["mode"] for row in rows}
    left_out = {Mode.WAIT: "waiting", Mode.DISPLACE: "displacements", Mode.AVOID: "giving way to aircraft"}
    words = [name for mode, name in left_out.items() if mode in modes]
    if words:
        yield f"Not in the plan, as reactions to the simulated traffic: {', '.join(words)}."
    if Mode.REVISIT in modes:
        yield (
            "The ways to revisited places are kept without stops and photographs, since other traffic hides other "
            "places; the policy baseline has none."
        )


def plan_of_selection(
    world: World,
    settings: MissionSettings,
    *,
    segments: Sequence[str] = (),
    order: str = "near",
    base: Point | None = None,
    trigger: Trigger = Trigger.DISTANCE,
    on_progress: Callable[[float], None] | None = None,
) -> FlightPlan:
    """Plan the inspection of segments.

    Args:
        segments: ids or street names; all reachable ones by default.
        order: see `choose_targets`.
        base: take-off point; that of the settings by default.
        on_progress: called with the share done.

    Raises:
        PaveTwinError: the world is not georeferenced, a segment does not exist or cannot be reached, or the
            settings do not fit.
    """
    check_place(world)
    bare = settings.model_copy(update={"parking": settings.parking.model_copy(update={"enabled": False})})
    environment = prepare(world, bare, defects=(), base=base)
    targets = choose_targets(environment, names=segments, order=order)
    check_reach(environment, bare, targets)
    flown = fly_over(environment, EmptyStreets(), bare, targets, "baseline", on_progress=on_progress)
    return plan_of_track(track_table(flown), settings, world, name=world.name, trigger=trigger)
