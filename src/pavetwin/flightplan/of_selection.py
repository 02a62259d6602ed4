"""The flight plan of a selection of segments that nobody has flown over: the track of a mission over empty streets.

It is that of the policy baseline in any traffic, since that policy never reacts.
"""

from collections.abc import Callable, Sequence

import polars as pl
from shapely import Point

from pavetwin.config import MissionSettings
from pavetwin.flightplan.model import FlightPlan, Trigger
from pavetwin.flightplan.of_mission import COLUMNS, check_place, plan_of_track
from pavetwin.mission.environment import prepare
from pavetwin.mission.estimate import EmptyStreets
from pavetwin.mission.fly import fly_over
from pavetwin.mission.planning import check_reach, choose_targets
from pavetwin.mission.saving import track_table
from pavetwin.world.model import World


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
        segments: their ids, or names of streets; all that can be reached unless given.
        order: as `choose_targets` takes it.
        base: where to take off; as the settings say unless given.
        on_progress: told the share done.

    Raises:
        PaveTwinError: the world has no place on the earth, a segment does not exist or cannot be reached, or the
            settings do not fit.
    """
    check_place(world)
    bare = settings.model_copy(update={"parking": settings.parking.model_copy(update={"enabled": False})})
    environment = prepare(world, bare, defects=(), base=base)
    targets = choose_targets(environment, names=segments, order=order)
    check_reach(environment, bare, targets)
    flown = fly_over(environment, EmptyStreets(), bare, targets, "baseline", on_progress=on_progress)
    rows = track_table(flown).select(COLUMNS).cast({"mode": pl.String}).to_dicts()
    return plan_of_track(rows, settings, world, name=world.name, trigger=trigger)
