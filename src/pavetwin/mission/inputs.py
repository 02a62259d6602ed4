"""The inputs of a mission, read from its specification and checked: environment and traffic."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from shapely import Point

from pavetwin.defects import placed_on
from pavetwin.errors import PaveTwinError
from pavetwin.mission.airspace import Aircraft, load_airspace
from pavetwin.mission.environment import MissionEnvironment, ParkingInput, prepare
from pavetwin.mission.mission import Traffic
from pavetwin.mission.replay import FIRST_DURATION_S, FIRST_PER_TARGET_S, Replay, replay_of
from pavetwin.mission.spec import HANDED_IN, DefectInput, FileInput, MissionSpec, TrafficInput, WorldInput
from pavetwin.mission.versions import packages_in_use, software_versions
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand_search import within_reach
from pavetwin.traffic.recording_file import load_recording
from pavetwin.world.model import Defect, World
from pavetwin.world.store import load_world

OnProgress = Callable[[float, str], None]
"""Receives the share done and the name of the step."""


RECORDING: Final = "Recording traffic"
"""Name of the step while SUMO records."""


@dataclass(frozen=True)
class MissionInputs:
    """The environment and traffic of a spec. Missions that differ only in policy, sensor or seed share them."""

    environment: MissionEnvironment
    traffic: Traffic

    @property
    def replay(self) -> Replay:
        """The traffic as a replay of a recording, as `load_inputs` gives it.

        Raises:
            TypeError: the traffic was handed in as something else.
        """
        if not isinstance(self.traffic, Replay):
            raise TypeError(f"the traffic is {type(self.traffic).__name__}, not a Replay")
        return self.traffic

    def flown(self, spec: MissionSpec, *, images: bool = False) -> MissionSpec:
        """The spec of the mission that is flown: with the recorded traffic and the present versions.

        The recorded traffic differs from the spec's where that allows the nearest, or the whole town for an area.

        Args:
            images: the sensor looked at images.
        """
        kinds = {defect.kind for defect in self.environment.defects}
        packages = packages_in_use(spec.settings, spec.policy.name, kinds)
        changes: dict[str, Any] = {"versions": software_versions(images=images, packages=packages)}
        if isinstance(self.traffic, Replay):
            changes["traffic"] = self.traffic.source()
            if self.traffic.area is None and spec.area(self.environment.world) is not None:
                changes["settings"] = spec.settings.model_copy(update={"traffic_area_m": None})
        return spec.model_copy(update=changes)

    def on_extend(self, report: Callable[[float], None]) -> None:
        """Report the progress of extending the recording, if a mission takes longer than it."""
        if isinstance(self.traffic, Replay):
            self.traffic.on_extend = report

    def check(self, spec: MissionSpec) -> None:
        """Check that these are the inputs of a spec.

        Raises:
            PaveTwinError: an input differs; the message names it.
        """
        environment, replay = self.environment, self.traffic if isinstance(self.traffic, Replay) else None
        if environment.altitude_m != spec.settings.altitude_m:
            raise PaveTwinError(
                f"`inputs`: the environment was made for {environment.altitude_m:g} m, and the mission is to be "
                f"flown at {spec.settings.altitude_m:g} m."
            )
        for what, differs in (
            ("world", environment.world.content_hash != spec.world.content_hash),
            ("defects", spec.defects.content_hash not in ("", environment.defects_hash)),
            ("base", spec.base not in (None, (environment.world.base.x, environment.world.base.y))),
            ("traffic", replay is not None and not spec.traffic.allows(replay.source())),
            (
                "parking",
                not environment.parking.is_as(
                    ParkingInput.of(spec.settings, spec.parking_seed, spec.parking_mix), environment.world
                ),
            ),
            ("area of the traffic", replay is not None and not self._holds_area_of(spec, replay)),
            ("aircraft", replay is not None and bool(replay.aircraft) != bool(spec.aircraft)),
        ):
            if differs:
                raise PaveTwinError(f"`inputs`: the {what} differs from the mission's spec.")

    def _holds_area_of(self, spec: MissionSpec, replay: Replay) -> bool:
        if replay.area is None:
            return True
        same = replay.file is not None or replay.area.distance_m == spec.settings.traffic_area_m
        return same and not replay.area.misses(map(self.environment.world.segment, spec.targets))

    def indices(self, spec: MissionSpec) -> list[int]:
        """Indices of the segments to inspect, among the world's segments.

        Raises:
            PaveTwinError: a segment does not exist.
        """
        world = self.environment.world
        known = {segment.id: index for index, segment in enumerate(world.segments)}
        return [known[world.segment(name).id] for name in spec.targets]


def load_inputs(
    spec: MissionSpec,
    *,
    world: World | None = None,
    environment: MissionEnvironment | None = None,
    on_progress: OnProgress | None = None,
) -> MissionInputs:
    """Read the inputs of a spec, and record the traffic if it is not recorded yet.

    Args:
        world: the world, in place of the folder that the spec names.
        environment: the world with its defects from `prepare`, if it exists already.

    Raises:
        PaveTwinError: an input is missing or has changed (each is named), or the traffic cannot be recorded.
    """
    report = on_progress or (lambda _share, _what: None)
    loaded = world or world_of(spec.world)
    check_unchanged(spec, loaded)
    report(0.0, "Preparing the flight domain")
    base = None if spec.base is None else Point(spec.base)
    ready = environment or prepare(
        loaded,
        spec.settings,
        defects_of(loaded, spec.defects, spec.targets),
        base=base,
        parking_seed=spec.parking_seed,
        parking_mix=spec.parking_mix,
    )
    if spec.defects.content_hash not in ("", ready.defects_hash):
        raise PaveTwinError(
            f"The mission's inputs have changed: seed {spec.defects.seed} places other defects than before."
        )
    search = f"Finding the demand of {spec.traffic.density}, kept for the next time"
    traffic = traffic_of(
        loaded,
        spec.traffic,
        lambda share: report(share, RECORDING),
        lambda share: report(share, search),
        area=spec.area(loaded),
        first_s=min(FIRST_DURATION_S, FIRST_PER_TARGET_S * len(spec.targets)),
    )
    traffic.aircraft = aircraft_of(spec)
    return MissionInputs(ready, traffic)


def world_of(source: WorldInput) -> World:
    """The world of a spec.

    Raises:
        PaveTwinError: its folder is missing, or it was passed as a value.
    """
    if source.path == HANDED_IN:
        raise PaveTwinError(
            f"The world '{source.name}' was never saved, so its mission cannot be flown from its description alone; "
            "give the world as well."
        )
    if not Path(source.path).is_dir():
        raise PaveTwinError(f"The world '{source.name}' is no longer at '{source.path}'; give its folder.")
    return load_world(Path(source.path))


def check_unchanged(spec: MissionSpec, world: World) -> None:
    """Check the inputs against the hashes of a spec.

    Raises:
        PaveTwinError: some have changed; the message names each.
    """
    changed = []
    if world.content_hash != spec.world.content_hash:
        changed.append(
            f"the world '{spec.world.name}' ({spec.world.content_hash[:12]}) is now '{world.name}' "
            f"({world.content_hash[:12]})"
        )
    elif spec.defects.seed is None and world.defects_hash != spec.defects.content_hash:
        changed.append(f"the world '{world.name}' has other defects")
    changed += [difference for file in spec.files() if (difference := file.difference())]
    if changed:
        raise PaveTwinError(f"The mission's inputs have changed: {'; '.join(changed)}.")


def defects_of(world: World, source: DefectInput, targets: Sequence[str] = ()) -> tuple[Defect, ...]:
    """The defects that a mission looks for, numbered from 0."""
    if source.seed is None:
        return world.defects
    chosen = set(targets)
    segments = [segment for segment in world.segments if source.on == "world" or segment.id in chosen]
    return placed_on(world, segments, source.seed, source.options)


def aircraft_of(spec: MissionSpec) -> tuple[Aircraft, ...]:
    """Tracks of other aircraft.

    Raises:
        PaveTwinError: their file is not a table of tracks.
    """
    if isinstance(spec.aircraft, FileInput):
        return load_airspace(Path(spec.aircraft.path))
    return tuple(track.value() for track in spec.aircraft or ())


def traffic_of(
    world: World,
    source: TrafficInput,
    on_progress: Callable[[float], None] | None = None,
    on_search: Callable[[float], None] | None = None,
    *,
    area: TrafficArea | None = None,
    first_s: float = FIRST_DURATION_S,
) -> Replay:
    """The recorded traffic of a mission, recorded now if it was not before.

    Args:
        area: the streets with traffic; None for the whole town.
        first_s: time recorded from take-off on; a longer mission extends it.

    Raises:
        PaveTwinError: it cannot be recorded, or the recording is of another world.
    """
    if source.density == HANDED_IN:
        raise PaveTwinError(
            "The mission's traffic was handed in as a value, so it cannot be flown from its description alone; give it "
            "by `inputs`."
        )
    routes = [file.path for file in source.routes]
    if source.recording is not None:
        recording = load_recording(source.recording.path, world)
        replay = Replay(world, recording, routes, file=Path(source.recording.path))
    else:
        asked, instead_of = source.asked(), source.instead_of
        reach = partial(within_reach, world, on_search=on_search, of_area=area is not None)
        if source.or_nearest and asked is not None and asked != (nearest := reach(asked)):
            asked, instead_of = nearest, asked.name
        replay = replay_of(
            world,
            asked,
            source.seed,
            routes=routes,
            take_off_s=source.take_off_s,
            area=area,
            first_s=first_s,
            on_progress=on_progress,
            on_search=on_search,
        )
        replay.instead_of = instead_of
    return replay.taking_off_at(source.take_off_s)
