"""Specification of a mission as a value: everything that decides how it is flown, and nothing else.

`fly(spec)` repeats a mission from its `MissionSpec` and the files that it names. `mission.yaml` holds the spec. Every
file is named with its SHA-256, so that a changed input is noticed.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt

from pavetwin.config import MissionSettings
from pavetwin.config.options import option_files
from pavetwin.config.settings import Settings
from pavetwin.defects import DefectOptions
from pavetwin.files import FORMAT, file_sha256
from pavetwin.mission.airspace import Aircraft
from pavetwin.mission.versions import packages_in_use, software_versions
from pavetwin.plugins import files_of, plugin_hashes
from pavetwin.policies import policy_class
from pavetwin.sensing.sensor import with_models
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand import DEFAULT_MIX, USER, Density
from pavetwin.uav.aircraft import camera_name
from pavetwin.uav.entries import own_file
from pavetwin.world.model import World

HANDED_IN: Final = "handed in"
"""The path of an input that a Python caller gave as a value, which the spec alone cannot reproduce."""


class FileInput(Settings):
    """A file that a mission depends on."""

    path: str
    """Absolute."""
    sha256: str

    @classmethod
    def of(cls, path: Path | str) -> Self:
        """Raises:
        PaveTwinError: the file cannot be read.
        """
        place = Path(path).absolute()
        return cls(path=str(place), sha256=file_sha256(place))

    def difference(self) -> str | None:
        """The change of the file in words; None if it is the same."""
        place = Path(self.path)
        if not place.is_file():
            return f"'{place}' is gone"
        return None if file_sha256(place) == self.sha256 else f"'{place}' has changed"


class WorldInput(Settings):
    """The world, and the hash of its static content except its defects."""

    name: str
    path: str
    """Folder of the world, absolute."""
    content_hash: str

    @classmethod
    def of(cls, world: World) -> Self:
        path = HANDED_IN if world.folder is None else str(world.folder.resolve())
        return cls(name=world.name, path=path, content_hash=world.content_hash)


class DefectInput(Settings):
    """The defects to look for: the world's own, or placed under a seed."""

    seed: NonNegativeInt | None = None
    """None for the world's own."""
    options: DefectOptions | None = Field(
        default_factory=lambda given: None if given.get("seed") is None else DefectOptions()
    )
    """Options of their placement under the seed."""
    on: Literal["world", "targets"] = "world"
    """Segments with defects: all, or, in studies, only the inspected ones, in the world's order."""
    content_hash: str = ""
    """Hash of the defects themselves."""


class TrafficInput(Settings):
    """The recorded traffic that a mission is flown against."""

    density: str | None = None
    """Name of the density, level of service or hour, with its mix of vehicles; None for routes of the user's own."""
    vehicles_per_lane_km: float | None = None
    """None for a level of service or an hour, where a search finds it."""
    pedestrians_per_sidewalk_km: float | None = None
    routes: tuple[FileInput, ...] = ()
    """SUMO demand of the user's own."""
    recording: FileInput | None = None
    """File of the recording, if given in place of a density or routes."""
    seed: NonNegativeInt = 0
    take_off_s: NonNegativeFloat = 0.0
    """Time of take-off in the recording."""
    or_nearest: bool = False
    """Fly the nearest level of service if the world cannot reach this one, which is a default."""
    instead_of: str | None = None
    """The traffic that this one replaces, since the world cannot reach it."""

    @classmethod
    def of(
        cls,
        density: Density | None,
        seed: int,
        *,
        routes: Sequence[Path | str] = (),
        recording: Path | None = None,
        take_off_s: float = 0.0,
        or_nearest: bool = False,
        instead_of: str | None = None,
    ) -> Self:
        """Raises:
        PaveTwinError: a file cannot be read.
        """
        return cls(
            density=density.name if density else None,
            vehicles_per_lane_km=None if density is None or density.is_found else density.vehicles_per_lane_km,
            pedestrians_per_sidewalk_km=density.pedestrians_per_sidewalk_km if density else None,
            routes=tuple(FileInput.of(route) for route in routes),
            recording=FileInput.of(recording) if recording else None,
            seed=seed,
            take_off_s=take_off_s,
            or_nearest=or_nearest,
            instead_of=instead_of,
        )

    def allows(self, flown: Self) -> bool:
        """True if recorded traffic fits: it is this one, or the nearest to it if `or_nearest`."""
        if not self.or_nearest:
            return flown == self
        named = self.model_copy(update={"or_nearest": False})
        nearest = {"density": flown.density, "instead_of": self.density}
        return flown in (named, named.model_copy(update=nearest))

    @property
    def name(self) -> str:
        """Name of the recording, such as `high-1`."""
        return f"{self.density or USER}-{self.seed}"

    @property
    def mix(self) -> str:
        """Name of the mix of vehicles; the default mix for routes of the user's own."""
        asked = self.asked()
        return asked.mix if asked else DEFAULT_MIX

    def asked(self) -> Density | None:
        """The density that SUMO holds; None for routes."""
        if self.density is None or self.pedestrians_per_sidewalk_km is None:
            return None
        return Density(self.density, self.vehicles_per_lane_km, self.pedestrians_per_sidewalk_km)


class AircraftTrack(Settings):
    """The track of another aircraft that a Python caller gave as a value."""

    name: str
    altitude_m: float
    t_s: tuple[float, ...]
    xy_m: tuple[tuple[float, float], ...]
    """World frame."""

    @classmethod
    def of(cls, aircraft: Aircraft) -> Self:
        return cls(
            name=aircraft.name, altitude_m=aircraft.altitude_m, t_s=aircraft.t_s.tolist(), xy_m=aircraft.xy_m.tolist()
        )

    def value(self) -> Aircraft:
        return Aircraft(self.name, np.array(self.t_s), np.array(self.xy_m).reshape(-1, 2), self.altitude_m)


class PolicyInput(Settings):
    """The recovery policy: a registered name, or a class in a file."""

    name: str
    """A name for `load_policy`: `hover`, or `path/to/file.py:ClassName`."""
    files: tuple[FileInput, ...] = ()
    """The policy's file, the modules next to it that it imports, and the data files that these declare."""

    @classmethod
    def of(cls, name: str) -> Self:
        """A registered policy, or one from a file that has been loaded already.

        Raises:
            PaveTwinError: its file cannot be read.
        """
        path, colon, class_name = name.rpartition(":")
        if not (colon and path.endswith(".py")):
            return cls(name=name)
        files = tuple(FileInput.of(file) for file in files_of(path))
        return cls(name=f"{files[0].path}:{class_name}", files=files)


def files_of_settings(settings: MissionSettings) -> tuple[FileInput, ...]:
    """The user's files that settings name (plugins, sensor, aircraft, camera, options), and their dependencies.

    Raises:
        PaveTwinError: a file cannot be read.
    """
    plugins = plugin_hashes(settings.plugins)
    files = {path: FileInput(path=path, sha256=content) for path, content in plugins.items()}
    sensor, colon, _ = settings.sensing.sensor.rpartition(":")
    if colon and sensor.endswith(".py"):
        files |= {str(file): FileInput.of(file) for file in files_of(sensor)}
    for name in (settings.aircraft, camera_name(settings)):
        own = None if name is None else own_file(name)
        if own is not None:
            files[own] = FileInput.of(own)
    for options in (settings.sensing.options, settings.policy.options):
        files |= {str(path): FileInput.of(path) for path in option_files(options).values()}
    return tuple(files.values())


class MissionSpec(Settings):
    """Everything a mission depends on."""

    format: Literal[1] = FORMAT
    versions: Mapping[str, str] = Field(default_factory=software_versions)
    """Versions of the software that decides the numbers, including installed packages that give a named policy, sensor
    or the like; `fly` sets the present ones."""
    world: WorldInput
    defects: DefectInput = DefectInput()
    traffic: TrafficInput
    aircraft: FileInput | tuple[AircraftTrack, ...] | None = None
    """Tracks of other aircraft: their file, or the tracks themselves if they were given as values."""
    base: tuple[float, float] | None = None
    """Place of take-off, in metres of the world's frame; by default according to `settings.uav.base`."""
    targets: Annotated[tuple[str, ...], Field(min_length=1)]
    """Ids of the segments to inspect, in this order."""
    policy: PolicyInput
    seed: NonNegativeInt = 0
    """Seed of the sensor's random numbers."""
    parking_seed: NonNegativeInt = 0
    """Seed of the parked vehicles, which the settings describe."""
    parking_mix: str = DEFAULT_MIX
    """Name of the mix of vehicles that are parked."""
    settings: MissionSettings
    plugins: tuple[FileInput, ...] = ()
    """Files from `files_of_settings`."""

    def with_policy(self, name: str, settings: MissionSettings | None = None) -> Self:
        """The same mission under another policy, as `load_policy` takes it.

        Args:
            settings: with the options of that policy; by default the options of `settings` that the policy has.
        """
        if name == self.policy.name:
            return self
        own = settings or self.settings
        if settings is None and own.policy.options:
            has = policy_class(name).default_options
            options = {option: value for option, value in own.policy.options.items() if option in has}
            own = own.model_copy(update={"policy": own.policy.model_copy(update={"options": options})})
        versions = software_versions(packages=packages_in_use(own, name))
        return self.model_copy(update={"policy": PolicyInput.of(name), "settings": own, "versions": versions})

    @classmethod
    def of(cls, settings: MissionSettings, policy: PolicyInput, **given: Any) -> Self:
        """A spec with the hashes of the files that the settings name, the sensor's models, and the present versions.

        Raises:
            PaveTwinError: a file cannot be read, or there is no such sensor.
        """
        named = settings.model_copy(update={"sensing": with_models(settings.sensing)})
        return cls(
            versions=software_versions(packages=packages_in_use(named, policy.name)),
            policy=policy,
            settings=named,
            plugins=files_of_settings(settings),
            **given,
        )

    def as_values(self) -> dict[str, Any]:
        """Plain values, as in `mission.yaml`."""
        return self.model_dump(mode="json")

    def area(self, world: World) -> TrafficArea | None:
        """The streets on which its traffic is recorded; None for the whole town.

        Raises:
            PaveTwinError: a target does not exist.
        """
        distance_m = self.settings.traffic_area_m
        if distance_m is None or self.traffic.recording is not None or self.traffic.routes:
            return None
        return TrafficArea.around(world, self.targets, distance_m)

    def files(self) -> tuple[FileInput, ...]:
        """All named files, except the world's."""
        recording = (self.traffic.recording,) if self.traffic.recording else ()
        aircraft = (self.aircraft,) if isinstance(self.aircraft, FileInput) else ()
        return (*self.traffic.routes, *recording, *aircraft, *self.policy.files, *self.plugins)
