"""The plan of a study as values: its cells, the units that are flown one by one, their seeds and settings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from hashlib import sha256
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from pavetwin.config import MissionSettings, load_settings
from pavetwin.config.mission import PolicySettings
from pavetwin.config.options import OptionValue, options_of_one
from pavetwin.config.settings import ALIASES
from pavetwin.errors import PaveTwinError, naming
from pavetwin.experiments.design import ALL, Design, Value, WorldEntry
from pavetwin.files import file_sha256
from pavetwin.mission.replay import Replay
from pavetwin.plugins import load_plugins
from pavetwin.policies import policy_class, policy_names
from pavetwin.reports.words import listed
from pavetwin.seeds import Stream, child
from pavetwin.sensing import ImageSource, sensor_class
from pavetwin.traffic.demand import own_demand
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.recording_file import load_recording
from pavetwin.world.model import World
from pavetwin.world.store import load_world

Owners = Mapping[str, Sequence[str]]
"""Swept setting, as the design names it → the policies or sensors that have it, as the design names them. A setting
that all of them have, or that belongs to no policy and no sensor, is not named."""

EVERYONE: Final[Owners] = MappingProxyType({})


def owners_of(design: Design) -> dict[str, list[str]]:
    """The owners of a design's swept settings; its plugins are loaded.

    Raises:
        PaveTwinError: a policy or sensor is not known, or no policy of the design reads a setting of policies.
    """
    found = {}
    for key in design.sweep:
        section, _, setting = ALIASES.get(key, key).partition(".")
        option = setting.removeprefix("options.") if setting.startswith("options.") else None
        if option is not None and section in ("policy", "sensing"):
            names = design.policies if section == "policy" else design.sensors
            has = [name for name in names if option in _options(section, name)]
        elif section == "policy" and setting in PolicySettings.model_fields:
            names = design.policies
            has = [name for name in names if setting in policy_class(name).reads]
            if not has:
                those = [name for name in policy_names() if setting in policy_class(name).reads]
                raise PaveTwinError(
                    f"the design: sweep: no policy of the design reads {key}; of all, {listed(those)} "
                    f"{'does' if len(those) == 1 else 'do'}."
                )
        else:
            continue
        if 0 < len(has) < len(names):  # an option that none has is refused where settings are made
            found[key] = has
    return found


def has_setting(owners: Owners, key: str, policy: str, sensor: str) -> bool:
    """True if missions of a policy with a sensor have a swept setting."""
    if key not in owners:
        return True
    return (policy if _is_of_policies(key) else sensor) in owners[key]


def ownership_notes(design: Design, owners: Owners, names: Mapping[str, str]) -> list[str]:
    """`Only hover has wait_s: baseline and skip are flown once for all its values.`

    Args:
        names: of the policies of the design.
    """
    notes = []
    for key, having in owners.items():
        every = design.policies if _is_of_policies(key) else design.sensors
        lacking = [names.get(name, name) for name in every if name not in having]
        verb = "is" if len(lacking) == 1 else "are"
        only = listed([names.get(name, name) for name in having])
        notes.append(
            f"Only {only} {'has' if len(having) == 1 else 'have'} {key}: {listed(lacking)} {verb} flown once for all "
            "its values."
        )
    return notes


def _is_of_policies(key: str) -> bool:
    return ALIASES.get(key, key).startswith("policy.")


def _options(section: str, name: str) -> Mapping[str, OptionValue]:
    return (policy_class(name) if section == "policy" else sensor_class(name)).default_options


IN_DESIGN_FILE: Final = {
    **{"`plugins`": "plugins", "`policy`": "policies", "`density`": "densities", "`preset`": "presets"},
    **{"`routes`": "routes", "`recording`": "recordings"},
    **{"sensing.sensor": "sensors", "sensing.options": "sensing.options", "policy.options": "policy.options"},
}
"""Parameter, as messages name it → the key of a design that gives it."""

ImageSourceFactory = Callable[[World, Replay, int, ParkedVehicles], ImageSource]
"""Makes what takes the images of missions: over a world with the defects that they look for, in a replayed traffic,
with their sensors' seed and the vehicles that are parked. It is pickled: a function or class at the top of a module."""

SHOWN: Final = 12
"""Characters of a hash in `design.yaml` and in the table."""

_LARGEST_SEED: Final = 2**31
_SEEDS, _SEGMENTS = 0, 1  # Keys of the stream EXPERIMENT, before the replicate


@dataclass(frozen=True)
class Cell:
    """One combination of everything but world and traffic."""

    altitude_m: float
    policy: str
    """Name in the design."""
    sensor: str
    preset: str
    swept: tuple[Value | None, ...]
    """Values of the sweep, in its order; None if the policy or sensor does not have the setting."""

    def settings(self, design: Design) -> MissionSettings:
        """Settings of its missions.

        Raises:
            PaveTwinError: a setting is not known, or a value does not fit.
        """
        swept = zip(design.sweep, self.swept, strict=True)
        values = {**design.set, **{key: value for key, value in swept if value is not None}}
        nested: dict[str, Any] = {
            "altitude_m": self.altitude_m,
            "sensing": {"sensor": self.sensor},
            "plugins": design.plugins,
        }
        for key, value in values.items():
            *sections, leaf = ALIASES.get(key, key).split(".")
            layer = nested
            for section in sections:
                layer = layer.setdefault(section, {})
                if not isinstance(layer, dict):
                    raise PaveTwinError(f"the design: '{key}' is not a setting.")
            layer[leaf] = value
        _keep_own_options(nested, "sensing", self.sensor, design.sensors, owners="sensor of the design")
        _keep_own_options(nested, "policy", self.policy, design.policies, owners="policy of the design")
        return load_settings(self.preset, **nested)


@dataclass(frozen=True)
class ReplicateSeeds:
    """The seeds of one replicate, shared by all its missions."""

    traffic: int
    defects: int
    sensing: int
    moment: float
    """0 … 1: when within the take-off times of a world with its own routes."""


@dataclass(frozen=True)
class Unit:
    """Missions that are flown together and written as one part of the table."""

    world: int
    """Its place in the design."""
    replicate: int
    traffic: str
    cells: tuple[int, ...] | None = None
    """Places in the plan of the cells to fly, where the others have been flown; None for all."""

    @property
    def name(self) -> str:
        return f"w{self.world}-r{self.replicate:05d}-{self.traffic}"


@dataclass(frozen=True)
class Plan:
    """A design that has been checked against its worlds: everything that a worker process needs."""

    design: Design
    hashes: tuple[str, ...]
    """Hashes of the worlds' content, see `content_of`."""
    names: tuple[str, ...]
    """Distinct names of the worlds."""
    targets: tuple[tuple[int, ...], ...]
    """For each world the segments, by their place in it, that are reachable in every cell; where the order of the
    design is `near`, along a short tour from the base."""
    policies: Mapping[str, str]
    """The name of each policy of the design."""
    owners: Owners = field(default_factory=dict)
    """Owners of the swept settings that not all policies or sensors have."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Hashes of the user's own files and of what they depend on, by path: of the content, or of what a recording was
    made from, since it is extended in place."""
    used: Mapping[Cell, tuple[str, ...]] = field(default_factory=dict)
    """Files that each cell depends on, except traffic."""
    packages: Mapping[str, str] = field(default_factory=dict)
    """Versions by name of the installed packages that give a policy, a sensor or the like."""
    populations: Mapping[str, str] = field(default_factory=dict)
    """Hashes by name of the damage populations of the package that defects are placed by."""
    models: Mapping[str, Mapping[str, OptionValue]] = field(default_factory=dict)
    """Current models that the design leaves to each sensor, keyed by sensor and option."""
    traffic_area_m: float | None = None
    """Traffic is recorded within this distance of a unit's segments; None: in the whole town."""
    image_source_factory: ImageSourceFactory | None = None
    """Source of images for sensors that analyse them; called in the worker processes."""

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        return cells_of(self.design, self.owners)

    @cached_property
    def units(self) -> tuple[Unit, ...]:
        return units_of(self.design)

    @property
    def missions(self) -> int:
        return len(self.units) * len(self.cells)

    def cells_of(self, unit: Unit) -> tuple[Cell, ...]:
        """The cells of a unit that are flown."""
        return self.cells if unit.cells is None else tuple(self.cells[at] for at in unit.cells)

    def levels(self, unit: Unit, cell: Cell) -> dict[str, Any]:
        """Factors and swept settings of a mission as in the table; None for those that it does not have."""
        swept = zip(self.design.sweep_columns, self.design.sweep.values(), cell.swept, strict=True)
        return {
            "world": self.names[unit.world],
            "traffic": unit.traffic,
            "altitude_m": cell.altitude_m,
            "policy": self.policies[cell.policy],
            "sensor": cell.sensor,
            "preset": cell.preset,
            **{
                column: str(value) if value is not None and are_texts(values) else value
                for column, values, value in swept
            },
        }

    def files_hash(self, unit: Unit, cell: Cell) -> str | None:
        """Hash of the user's own files that a mission depends on; None if there are none."""
        paths = {*self.used.get(cell, ()), *self.design.worlds[unit.world].files(unit.traffic)}
        hashes = "".join(sorted(self.files[path] for path in paths))
        return sha256(hashes.encode()).hexdigest()[:SHOWN] if hashes else None

    def seeds(self, replicate: int) -> ReplicateSeeds:
        rng = child(self.design.seed, Stream.EXPERIMENT, _SEEDS, replicate)
        traffic, defects, sensing = rng.integers(_LARGEST_SEED, size=3).tolist()
        return ReplicateSeeds(traffic, defects, sensing, moment=float(rng.random()))

    def take_off_s(self, unit: Unit) -> float:
        """When in its recording a unit's missions begin, on a whole step."""
        earliest, latest = take_offs(self.design.worlds[unit.world], unit.traffic)
        return float(round(earliest + self.seeds(unit.replicate).moment * (latest - earliest)))

    def segments(self, unit: Unit) -> list[int]:
        """Segments of the missions of a unit, in order: drawn in each replicate, or along the short tour."""
        rng = child(self.design.seed, Stream.EXPERIMENT, _SEGMENTS, unit.replicate)
        reachable = self.targets[unit.world]
        count = len(reachable) if self.design.segments == ALL else self.design.segments
        drawn = rng.permutation(len(reachable))[:count].tolist()
        return [reachable[index] for index in (sorted(drawn) if self.design.order == "near" else drawn)]

    @property
    def segment_missions(self) -> int:
        """Rows of the table once everything is flown."""
        return sum(len(self.segments(unit)) for unit in self.units) * len(self.cells)


def take_offs(entry: WorldEntry, traffic: str) -> tuple[float, float]:
    """The earliest and the latest take-off over one level of traffic."""
    if entry.take_off_s is not None:
        return entry.take_off_s
    file = entry.recording(traffic)
    warm_up_s = own_demand(entry.routes).warm_up_s if file is None else _warm_up_s(file)
    return warm_up_s, warm_up_s


@cache
def _warm_up_s(recording: Path) -> float:
    return load_recording(recording).warm_up_s


def units_of(design: Design) -> tuple[Unit, ...]:
    """All units in the order of the design, those of a replicate together."""
    return tuple(
        Unit(world, replicate, traffic)
        for world in range(len(design.worlds))
        for replicate in range(design.replicates)
        for traffic in design.traffics(world)
    )


def cells_of(design: Design, owners: Owners = EVERYONE) -> tuple[Cell, ...]:
    """Every combination of a design's factors except world and traffic, the policies of an altitude together.

    Combinations that differ only in a setting that their policy or sensor does not have are one.
    """

    def swept(values: tuple[Value, ...], policy: str, sensor: str) -> tuple[Value | None, ...]:
        keyed = zip(design.sweep, values, strict=True)
        return tuple(value if has_setting(owners, key, policy, sensor) else None for key, value in keyed)

    combinations = product(
        design.presets, product(*design.sweep.values()), design.sensors, design.altitudes_m, design.policies
    )
    cells = (
        Cell(altitude_m, policy, sensor, preset, swept(values, policy, sensor))
        for preset, values, sensor, altitude_m, policy in combinations
    )
    return tuple(dict.fromkeys(cells))


def traffic_area_m(design: Design, cells: Sequence[Cell]) -> float | None:
    """The widest traffic area of a unit's cells, since they share a recording; None for whole towns.

    Raises:
        PaveTwinError: as `Cell.settings`.
    """
    asked = [cell.settings(design).traffic_area_m for cell in cells]
    known = [distance_m for distance_m in asked if distance_m is not None]
    return max(known) if len(known) == len(asked) else None


def _keep_own_options(values: dict[str, Any], section: str, name: str, names: Sequence[str], *, owners: str) -> None:
    """Leave of a section's options those that one of several policies or sensors has."""
    inner = values.get(section)
    if len(names) > 1 and isinstance(inner, dict) and isinstance(options := inner.get("options"), Mapping):
        has = {each: _options(section, each) for each in names}
        inner["options"] = options_of_one(name, has, options, key=f"{section}.options", owners=owners)


def check_files(plan: Plan) -> None:
    """Load the plugins of a study in this process, and see whether all files of the user's own are as they were.

    Raises:
        PaveTwinError: one is missing, fails, or differs from the start of the study.
    """
    recordings = {file for entry in plan.design.worlds for file in entry.recordings}  # checked where they are read
    for path, content in plan.files.items():
        if path not in recordings and file_sha256(Path(path)) != content:
            raise PaveTwinError(f"the design: '{path}' is not what the study began with.")
    with naming(IN_DESIGN_FILE, "the design"):
        load_plugins(plan.design.plugins)


def recording_of(plan: Plan, world: World, file: Path) -> Recording:
    """A recording that the design names.

    Raises:
        PaveTwinError: it is missing, damaged, or differs from the start of the study.
    """
    recording = load_recording(file, world)
    if recording.origin.inputs != plan.files[str(file)]:
        raise PaveTwinError(f"the design: '{file}' is not what the study began with.")
    return recording


def are_texts(values: Sequence[Value]) -> bool:
    """True if the values of a swept setting are a column of texts."""
    kinds = {type(value) for value in values}
    return kinds != {bool} and not kinds <= {int, float}


def check_worlds(plan: Plan) -> None:
    """Check that the worlds are those that the study began with.

    Raises:
        PaveTwinError: one is missing, damaged or different.
    """
    for entry, content in zip(plan.design.worlds, plan.hashes, strict=True):
        world_of_study(entry.path, content)


def content_of(world: World, *, with_defects: bool) -> str:
    """Identity of a world in a study: its content hash, with that of its defects if the study uses them."""
    return (
        sha256(f"{world.content_hash}{world.defects_hash}".encode()).hexdigest() if with_defects else world.content_hash
    )


@cache
def world_of_study(path: str, content_hash: str) -> World:
    """A world, read once a process.

    Raises:
        PaveTwinError: it is missing, damaged, or differs from the start of the study.
    """
    world = load_world(Path(path))
    if content_hash not in (content_of(world, with_defects=False), content_of(world, with_defects=True)):
        raise PaveTwinError(f"The world '{path}' is not the one that the study began with.")
    return world
