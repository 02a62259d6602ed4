"""From what a user asks for to the `MissionSpec` that answers it."""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Final

from shapely import Point

from pavetwin.config import MissionSettings, load_settings
from pavetwin.config.options import options_of_one
from pavetwin.defects import DefectOptions
from pavetwin.errors import PaveTwinError, about
from pavetwin.mission.airspace import load_airspace
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.inputs import defects_of
from pavetwin.mission.reach import check_reach
from pavetwin.mission.spec import DefectInput, FileInput, MissionSpec, PolicyInput, TrafficInput, WorldInput
from pavetwin.mission.targets import choose_targets
from pavetwin.navigation.base import parse_base
from pavetwin.navigation.patterns import PATTERNS
from pavetwin.policies import load_policy, policy_class, policy_names
from pavetwin.sensing import load_sensor
from pavetwin.traffic.demand import DEFAULT_TRAFFIC, Density, density_named
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.own_demand import own_demand
from pavetwin.traffic.recording_file import load_recording
from pavetwin.uav import camera_of, energy_curve
from pavetwin.uav.wind import check_wind
from pavetwin.world.model import World
from pavetwin.world.store import load_record

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
    """Decide everything about a mission; nothing is flown or recorded yet.

    Args:
        settings: the preset `default` when not given.
        density: of the traffic: a name (`los-C`, `hour-08`, `high`) or numbers; ignored where `routes` or a `recording`
            are given. Level of service C when not given, or the nearest that the world can reach.
        mix: of the vehicles, where the density names none.
        routes: SUMO route files, driven as they are.
        recording: a file of recorded traffic.
        traffic_seed: of traffic and parked vehicles; `seed` when not given.
        take_off_s: when in the recording the mission begins; by default at once where a density is held, and after a
            warm-up over a user's own demand (`OwnDemand.warm_up_s`).
        segments: how many to inspect (None: all that can be reached), or the ids of those to inspect.
        order: `random`, or `near` for a short tour.
        seed: of traffic, parked vehicles, order and sensor.
        defect_seed: place the defects again under this seed, as those of the world were placed.
        airspace: a CSV file of other aircraft's tracks.
        base: where the UAV takes off: (x, y) in metres of the world's frame, or a text as `parse_base` reads it; as
            `settings.uav.base` says when not given.
        environment: the world as `prepare` made it for these settings and defects, where that is done already.

    Raises:
        PaveTwinError: something that is named does not exist, or a segment cannot be reached: there is no way, or none
            that one set of batteries flies and comes back.
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
    """Decide everything about missions that differ in their policy alone; and the environment that they share.

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
    """Policies by their names, each once; `all` stands for every registered one."""
    return list(dict.fromkeys(name for each in given for name in (policy_names() if each == ALL else [each])))


def settings_under(policy: str, policies: Iterable[str], settings: MissionSettings) -> MissionSettings:
    """The settings of one of several policies that are flown with the same: of their options it gets those it has.

    Raises:
        PaveTwinError: none of the policies has an option, or one of them is not known.
    """
    options = settings.policy.options
    if not options or [*policies] == [policy]:
        return settings
    has = {name: policy_class(name).default_options for name in policies}
    own = options_of_one(policy, has, options, key="policy.options", owners="policy of these missions")
    return settings.model_copy(update={"policy": settings.policy.model_copy(update={"options": own})})


def check_names(settings: MissionSettings, policies: Iterable[str], seed: int) -> dict[str, str]:
    """Whether all that a mission names is there, before anything takes time.

    Returns:
        The name that each policy has, by what was given for it.

    Raises:
        PaveTwinError: it is not; the message names the nearest.
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
    """Whether policies can be told apart by their names.

    Args:
        names: the name that each policy has, by what was given for it.

    Raises:
        PaveTwinError: two have the same.
    """
    for policy, name in names.items():
        first = next(other for other, its in names.items() if its == name)
        if first != policy:
            raise PaveTwinError(f"`policy`: '{first}' and '{policy}' are both named '{name}'; rename one of them.")


def base_point(base: tuple[float, float] | str | None, world: World) -> Point | None:
    """A base as given to `plan_mission`, as a point of the world's frame."""
    return parse_base(base, world) if isinstance(base, str) else None if base is None else Point(base)


def defect_input(world: World, seed: int | None) -> DefectInput:
    """The world's own defects, or others placed under a seed as those were.

    Raises:
        PaveTwinError: the record of the world's folder does not fit.
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
    """What the traffic of a mission is made from; see `plan_mission`.

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
