"""One mission as a value: everything that decides how it is flown, and nothing else.

Whoever has a `MissionSpec` and the files it names can fly the same mission again: `fly(spec)`. It is what a mission's
`mission.yaml` holds. Every file is named with its SHA-256, so that an input which is not what it was is noticed.
"""

import hashlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt

from pavetwin.config import MissionSettings
from pavetwin.config.base import Settings
from pavetwin.defects import DefectOptions
from pavetwin.errors import PaveTwinError
from pavetwin.plugins import helpers_of, plugin_hashes
from pavetwin.traffic.demand import USER, Density
from pavetwin.world.model import World

FORMAT: Final = 3
"""Of `mission.yaml`; raised when one written before cannot be read any more."""

HANDED_IN: Final = "handed in"
"""The path of an input that a Python caller gave as a value: it cannot be found again from the spec alone."""


def software_versions() -> dict[str, str]:
    """Versions of what decides a mission's numbers, by distribution."""
    found = {}
    for name in ("pavetwin", "libsumo"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's content; read again only when its size or time has changed.

    Raises:
        PaveTwinError: it cannot be read.
    """
    try:
        stat = path.stat()
        return _digest(str(path), stat.st_size, stat.st_mtime_ns)
    except OSError as error:
        raise PaveTwinError(f"Cannot read '{path}': {error.strerror or error}.") from error


@lru_cache(maxsize=64)
def _digest(path: str, size: int, changed_ns: int) -> str:  # noqa: ARG001 - they are the cache's key
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
        """What is not as it was, in words; None where the file is the same."""
        place = Path(self.path)
        if not place.is_file():
            return f"'{place}' is gone"
        return None if file_sha256(place) == self.sha256 else f"'{place}' has changed"


class WorldInput(Settings):
    """The world, and the hash of all in it that stands still but its defects."""

    name: str
    path: str
    """Folder of the world, absolute."""
    content_hash: str

    @classmethod
    def of(cls, world: World) -> Self:
        path = HANDED_IN if world.folder is None else str(world.folder.absolute())
        return cls(name=world.name, path=path, content_hash=world.content_hash)


class DefectInput(Settings):
    """The defects that are looked for: the world's own, or placed under a seed."""

    seed: NonNegativeInt | None = None
    """None for the world's own."""
    options: DefectOptions | None = None
    """How many of which classes are placed under the seed; the defaults when not given."""
    on: Literal["world", "targets"] = "world"
    """Where they are placed: studies place them on the inspected segments only, in the world's order."""
    content_hash: str = ""
    """Of the defects themselves."""


class TrafficInput(Settings):
    """The recorded traffic that a mission is flown against."""

    density: str | None = None
    """Name of the density; None for routes of the user's own."""
    vehicles_per_lane_km: float | None = None
    pedestrians_per_sidewalk_km: float | None = None
    routes: tuple[FileInput, ...] = ()
    """SUMO demand of the user's own."""
    recording: FileInput | None = None
    """The recording itself, where a file of it was given instead of a density or routes."""
    seed: NonNegativeInt = 0
    take_off_s: NonNegativeFloat = 0.0
    """When in the recording the mission begins."""

    @classmethod
    def of(
        cls,
        density: Density | None,
        seed: int,
        *,
        routes: Sequence[Path | str] = (),
        recording: Path | None = None,
        take_off_s: float = 0.0,
    ) -> Self:
        """Raises:
        PaveTwinError: a file cannot be read.
        """
        return cls(
            density=density.name if density else None,
            vehicles_per_lane_km=density.vehicles_per_lane_km if density else None,
            pedestrians_per_sidewalk_km=density.pedestrians_per_sidewalk_km if density else None,
            routes=tuple(FileInput.of(route) for route in routes),
            recording=FileInput.of(recording) if recording else None,
            seed=seed,
            take_off_s=take_off_s,
        )

    @property
    def name(self) -> str:
        """Of the recording, such as `high-1`."""
        return f"{self.density or USER}-{self.seed}"

    def asked(self) -> Density | None:
        """The density that SUMO is to hold; None for routes."""
        if self.density is None or self.vehicles_per_lane_km is None or self.pedestrians_per_sidewalk_km is None:
            return None
        return Density(self.density, self.vehicles_per_lane_km, self.pedestrians_per_sidewalk_km)


class PolicyInput(Settings):
    """The recovery policy: a registered name, or a class in a file."""

    name: str
    """As `load_policy` takes it: `hover`, or `path/to/file.py:ClassName`."""
    files: tuple[FileInput, ...] = ()
    """The policy's file and what it imports from beside it."""

    @classmethod
    def of(cls, name: str) -> Self:
        """A registered policy, or one from a file that has been loaded already.

        Raises:
            PaveTwinError: its file cannot be read.
        """
        path, colon, class_name = name.rpartition(":")
        if not (colon and path.endswith(".py")):
            return cls(name=name)
        place = Path(path).absolute()
        files = dict.fromkeys([place, *helpers_of(place)])
        return cls(name=f"{place}:{class_name}", files=tuple(FileInput.of(file) for file in files))


class MissionSpec(Settings):
    """Everything a mission depends on."""

    format: Literal[3] = FORMAT
    versions: Mapping[str, str] = Field(default_factory=software_versions)
    """Of what computes: pavetwin and SUMO."""
    world: WorldInput
    defects: DefectInput = DefectInput()
    traffic: TrafficInput
    aircraft: FileInput | None = None
    """Tracks of other aircraft."""
    targets: Annotated[tuple[str, ...], Field(min_length=1)]
    """Ids of the segments to inspect, in this order."""
    policy: PolicyInput
    seed: NonNegativeInt = 0
    """Of the sensor's random numbers."""
    settings: MissionSettings
    plugins: tuple[FileInput, ...] = ()
    """The user's files that the settings name (plugins, sensor, camera), and what they import from beside them."""

    def with_policy(self, name: str) -> Self:
        """The same mission under another policy, as `load_policy` takes it."""
        if name == self.policy.name:
            return self
        return self.model_copy(update={"policy": PolicyInput.of(name)})

    @classmethod
    def of(cls, settings: MissionSettings, **given: Any) -> Self:
        """A spec with the hashes of the files that the settings name.

        Raises:
            PaveTwinError: a file cannot be read.
        """
        plugins = plugin_hashes(settings.plugins)
        files = {path: FileInput(path=path, sha256=content) for path, content in plugins.items()}
        sensor, colon, _ = settings.sensing.sensor.rpartition(":")
        if colon and sensor.endswith(".py"):
            files |= {str(file): FileInput.of(file) for file in (Path(sensor), *helpers_of(Path(sensor)))}
        camera = settings.camera.model.partition(":")[0]
        if camera.endswith((".yaml", ".yml")):
            files[camera] = FileInput.of(camera)
        return cls(settings=settings, plugins=tuple(files.values()), **given)

    def as_values(self) -> dict[str, Any]:
        """In plain values, as `mission.yaml` holds them."""
        return self.model_dump(mode="json")

    def files(self) -> tuple[FileInput, ...]:
        """All files it names, the world's aside."""
        recording = (self.traffic.recording,) if self.traffic.recording else ()
        aircraft = (self.aircraft,) if self.aircraft else ()
        return (*self.traffic.routes, *recording, *aircraft, *self.policy.files, *self.plugins)
