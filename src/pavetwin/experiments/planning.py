"""The plan of a study: a design checked against its worlds, with levels of service that these can reach."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from pavetwin.config import MissionSettings
from pavetwin.config.options import OptionValue
from pavetwin.defects import DefectOptions
from pavetwin.defects.population import population_names, population_sha256
from pavetwin.defects.registry import DEFECT_CLASSES, kinds
from pavetwin.errors import PaveTwinError, naming, nearest_name
from pavetwin.experiments.design import ALL, Design
from pavetwin.experiments.metrics import EVERY_PAIR, REFERENCE
from pavetwin.experiments.units import (
    IN_DESIGN_FILE,
    Cell,
    Plan,
    cells_of,
    content_of,
    owners_of,
    take_offs,
    traffic_area_m,
)
from pavetwin.files import file_sha256
from pavetwin.mission.environment import Surroundings
from pavetwin.mission.inputs import OnProgress
from pavetwin.mission.planning import check_distinct, check_names, short_tour
from pavetwin.mission.spec import PolicyInput, files_of_settings
from pavetwin.mission.versions import packages_in_use
from pavetwin.plugins import load_plugins, registered_in
from pavetwin.reports.words import listed
from pavetwin.sensing.sensor import unnamed_models
from pavetwin.traffic.demand import density_named, own_demand
from pavetwin.traffic.demand_search import within_reach
from pavetwin.traffic.recording_file import load_recording
from pavetwin.world.model import World
from pavetwin.world.solids import solids
from pavetwin.world.store import load_record, load_world


def plan(design: Design, worlds: Sequence[World], tell: Callable[[str], None] = lambda _: None) -> Plan:
    """Check a design against its worlds, and see which segments can be reached.

    Args:
        tell: called with the name of each long step.

    Raises:
        PaveTwinError: a factor's level does not exist, or the worlds leave nothing to inspect.
    """
    with naming(IN_DESIGN_FILE, "the design"):
        load_plugins(design.plugins)
        owners = owners_of(design)
        cells = cells_of(design, owners)
        policies = _check_levels(design, cells)
    if design.compare not in (known := [EVERY_PAIR, REFERENCE, *policies.values()]):
        near = nearest_name(design.compare, known)
        raise PaveTwinError(
            f"the design: compare: no policy '{design.compare}'{near}; give {EVERY_PAIR} or one of "
            f"{', '.join(policies.values())}."
        )
    recordings = _check_recordings(design, worlds)
    names = tuple(world.name for world in worlds)
    if twice := next((name for at, name in enumerate(names) if name in names[:at]), None):
        raise PaveTwinError(
            f"the design: two of its worlds are called '{twice}', and the table could not distinguish them; rename the "
            "folder of one."
        )
    targets = tuple(
        _targets(design, world, named, _surroundings(design, world, cells, tell))
        for world, named in zip(worlds, _named(design, worlds), strict=True)
    )
    named = _populations(design, worlds)
    own = {name: file_sha256(Path(name)) for name in named if name not in population_names()}
    used = {cell: {**_files_of(cell, design), **own} for cell in cells}
    routes = {route: file_sha256(Path(route)) for entry in design.worlds for route in entry.routes}
    return Plan(
        design,
        tuple(content_of(world, with_defects=design.defects == "world") for world in worlds),
        names,
        targets,
        policies,
        owners=owners,
        files={path: content for files in used.values() for path, content in files.items()} | routes | recordings,
        used={cell: tuple(files) for cell, files in used.items()},
        packages=_packages(design, worlds, cells),
        populations={name: population_sha256(name) for name in named if name not in own},
        models=_models(design, cells),
        traffic_area_m=traffic_area_m(design, cells),
    )


def load_worlds(design: Design) -> list[World]:
    """Raises:
    PaveTwinError: one of them does not exist or is damaged.
    """
    return [load_world(Path(entry.path)) for entry in design.worlds]


def _check_levels(design: Design, cells: Sequence[Cell]) -> dict[str, str]:
    """Policy → its name."""
    for name in design.densities:
        density_named(name)
    for world in design.worlds:
        for route in world.routes:
            if not Path(route).is_file():
                raise PaveTwinError(f"the design: there is no routes file '{route}'.")
            own_demand([route])
    names: dict[str, str] = {}
    for cell in cells:
        names |= check_names(cell.settings(design), [cell.policy], design.seed)
    check_distinct(names)
    return names


def _check_recordings(design: Design, worlds: Sequence[World]) -> dict[str, str]:
    """Hash of the inputs of each recording."""
    hashes = {}
    for entry, world in zip(design.worlds, worlds, strict=True):
        for file in entry.recordings:
            recording, latest_s = load_recording(file, world), take_offs(entry, Path(file).stem)[1]
            if recording.duration_s <= latest_s:
                raise PaveTwinError(
                    f"the design: the recording '{file}' ends after {recording.duration_s:g} s, before the latest "
                    f"take-off of take_off_s, {latest_s:g} s."
                )
            hashes[file] = recording.origin.inputs
    return hashes


def _files_of(cell: Cell, design: Design) -> dict[str, str]:
    """SHA-256 by path of the user's own files that a cell depends on; all have been loaded.

    A plugin file that registers policies and sensors alone concerns the cells with one of them.
    """

    def concerns(plugin: str) -> bool:
        registered = registered_in(plugin)
        kinds, names = {kind for kind, _ in registered}, {name for _, name in registered}
        return not registered or not kinds <= {"policy", "sensor"} or not names.isdisjoint((cell.policy, cell.sensor))

    settings = cell.settings(design)
    own = settings.model_copy(update={"plugins": tuple(filter(concerns, settings.plugins))})
    return {file.path: file.sha256 for file in (*PolicyInput.of(cell.policy).files, *files_of_settings(own))}


def _populations(design: Design, worlds: Sequence[World]) -> list[str]:
    """The damage populations that defects are placed by: names, and paths of the user's own."""
    if design.defects == "world":
        return []
    if isinstance(design.defects, DefectOptions):
        return [design.defects.population]
    folders = [world.folder for world in worlds if world.folder is not None]
    return sorted({DefectOptions.of_record(load_record(folder)).population for folder in folders})


def _models(design: Design, cells: Sequence[Cell]) -> dict[str, dict[str, OptionValue]]:
    """Models that the design leaves to each sensor."""
    found = ((cell.sensor, unnamed_models(cell.settings(design).sensing)) for cell in cells)
    return {sensor: models for sensor, models in found if models}


def _packages(design: Design, worlds: Sequence[World], cells: Sequence[Cell]) -> dict[str, str]:
    """Versions by name of the installed packages that give what a design's missions name or look for."""
    if isinstance(design.defects, str):
        classes = {defect.kind for world in worlds for defect in world.defects}
    else:
        classes = {kind.name for kind, _ in design.defects.effective().shares()}
    if not classes <= {kind.name for kind in kinds()}:
        DEFECT_CLASSES.names()  # finds those of installed packages
    used = [packages_in_use(cell.settings(design), cell.policy, classes) for cell in cells]
    return {name: version for packages in used for name, version in packages.items()}


def _named(design: Design, worlds: Sequence[World]) -> list[dict[str, list[int]]]:
    """For each world, the places of the segments with each name of the design's streets.

    Raises:
        PaveTwinError: no world has a street or segment of one of the names.
    """
    found: list[dict[str, list[int]]] = [{} for _ in worlds]
    for name in design.streets:
        misses: list[PaveTwinError] = []
        for world, named in zip(worlds, found, strict=True):
            try:
                ids = {segment.id for segment in world.segments_named(name)}
            except PaveTwinError as error:
                misses.append(error)
            else:
                named[name] = [at for at, segment in enumerate(world.segments) if segment.id in ids]
        if len(misses) == len(worlds):
            raise PaveTwinError(f"the design: streets: {misses[0]}")
    return found


def _targets(
    design: Design,
    world: World,
    named: Mapping[str, Sequence[int]],
    surroundings: Sequence[Surroundings],
) -> tuple[int, ...]:
    """The segments that missions may inspect: those that can be reached in every cell, of those with a name of the
    design's streets.

    Raises:
        PaveTwinError: none of a name can be reached, or they are fewer than a mission inspects.
    """
    reachable = [at for at in range(len(world.segments)) if all(each.segments_in_reach[at] for each in surroundings)]
    for name, places in named.items():
        if not set(places) & set(reachable):
            raise PaveTwinError(f"the design: streets: no way leads to {name} in '{world.name}' at all altitudes.")
    asked = {at for places in named.values() for at in places} if design.streets else set(range(len(world.segments)))
    found = tuple(at for at in reachable if at in asked)
    least = 1 if design.segments == ALL else design.segments
    if len(found) < least:
        which = f" of {listed(design.streets)}" if design.streets else ""
        there_are = (
            f"'{world.name}' has only {len(found)}{which}"
            if len(found) == len(asked)
            else f"only {len(found)} of the {len(asked)} segments{which} in '{world.name}' can be reached at all "
            "altitudes"
        )
        raise PaveTwinError(f"the design: segments: the design requests {design.segments}, but {there_are}.")
    flown = replace(world, base=surroundings[0].base)
    return tuple(short_tour(flown, found)) if design.order == "near" else found


def _surroundings(
    design: Design, world: World, cells: Sequence[Cell], tell: Callable[[str], None]
) -> list[Surroundings]:
    """Surroundings of the missions of all cells. Bakes and caches the NavMeshes."""
    ways: Mapping[tuple[float, float, str], MissionSettings] = {
        (settings.altitude_m, settings.uav.radius_m, settings.uav.base): settings
        for settings in (cell.settings(design) for cell in cells)
    }
    around, standing = [], solids(world)
    for settings in ways.values():
        tell(f"Planning: where to fly over {world.name} at {settings.altitude_m:g} m")
        around.append(Surroundings.of(world, settings.altitude_m, settings.uav, standing=standing))
    return around


def with_levels_in_reach(
    design: Design, worlds: Sequence[World], tell: OnProgress, on_notice: Callable[[str], None]
) -> Design:
    """The design with the nearest levels for what its worlds cannot reach, where its `or_nearest` allows it.

    Args:
        on_notice: called with the replaced levels of each world.
    """
    if not design.or_nearest:
        return design
    of_area = area_if_known(design) is not None
    entries = []
    for entry, world in zip(design.worlds, worlds, strict=True):
        nearest = {} if entry.traffics else _nearest(design.densities, world, tell, of_area=of_area)
        if nearest:
            on_notice(replaced_sentence(world.name, nearest))
        entries.append(entry.model_copy(update={"nearest": nearest}))
    return design.model_copy(update={"worlds": tuple(entries)})


def replaced_sentence(world: str, nearest: Mapping[str, str]) -> str:
    """A sentence on the replaced levels of a world."""
    levels = [(density_named(name).level, density_named(other).level) for name, other in nearest.items()]
    what, are = ("Level", "is") if len(levels) == 1 else ("Levels", "are")
    missed = listed([f"{level}" for level, _ in levels])
    flown = listed([f"{other} for {level}" for level, other in levels])
    return f"{what} of service {missed} {are} out of reach in '{world}'; the nearest {are} flown: {flown}."


def area_if_known(design: Design) -> float | None:
    """Distance around the inspected segments within which traffic is recorded; None for whole towns, and for a design
    that does not fit."""
    with suppress(PaveTwinError):
        load_plugins(design.plugins)
        return traffic_area_m(design, cells_of(design))
    return None


def _nearest(densities: Sequence[str], world: World, tell: OnProgress, *, of_area: bool) -> dict[str, str]:
    """Levels that the world cannot reach → the nearest that it can. What fails otherwise fails in its missions."""
    found = {}

    def search(name: str, _share: float) -> None:
        tell(0.0, f"Finding the demand of {name} in {world.name}")

    for name in densities:
        with suppress(PaveTwinError):
            asked = density_named(name)
            other = within_reach(world, asked, partial(search, name), of_area=of_area)
            if other != asked:
                found[name] = other.name
    return found
