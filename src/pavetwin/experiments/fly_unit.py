"""Flying one unit: a replicate over one world in one traffic, a mission for each cell."""

import io
import json
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, get_args, get_type_hints

import polars as pl
import pyarrow.parquet
from shapely.errors import ShapelyError

from pavetwin.arrays import Float64Array
from pavetwin.config import MissionSettings, load_settings
from pavetwin.config.mission import UavSettings
from pavetwin.defects import DefectOptions, placed_on, sample_points
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import OWN_ROUTES, Design, WorldEntry
from pavetwin.experiments.metrics import (
    COVERAGE_DRAWS,
    DETECTED,
    FACTORS,
    FAILED,
    FILES,
    FLOWN,
    REASON,
    RENDERER,
    REPLICATE,
    STATUS,
)
from pavetwin.experiments.tours import MISSION_COLUMNS
from pavetwin.experiments.units import (
    Cell,
    ImageSourceFactory,
    Plan,
    Unit,
    are_texts,
    check_files,
    recording_of,
    world_of_study,
)
from pavetwin.mission.environment import MissionEnvironment, ParkingInput, Surroundings, prepare
from pavetwin.mission.fly import fly
from pavetwin.mission.inputs import MissionInputs
from pavetwin.mission.metrics import SegmentMetrics, totals
from pavetwin.mission.replay import Replay
from pavetwin.mission.result import MissionResult
from pavetwin.mission.spec import DefectInput, MissionSpec, PolicyInput, WorldInput
from pavetwin.mission.versions import renderer_of
from pavetwin.sensing import ImageSource, Sensor, load_sensor, reused_sensor, sensor_class
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder
from pavetwin.world.model import Defect, World
from pavetwin.world.solids import Solids, solids
from pavetwin.world.store import load_record

RECORDED_S: Final = 100.0
"""Recorded before the first mission of one segment: half of the units in light traffic need no more. Longer missions
extend it."""

QUIET_S: Final = 300.0
"""A user's demand without any agent for so long after the take-off has ended."""

_LEFT_OUT: Final = ("start_s", "end_s")  # Columns of a segment's row that only state the mission's clock

_TYPES: Final = {int: pl.Int64, float: pl.Float64, str: pl.String, bool: pl.Boolean}

Row = dict[str, Any]


def fly_unit(plan: Plan, unit: Unit, on_recorded: Callable[[], None] = lambda: None) -> bytes:
    """Fly a unit's missions, and give its part of the table as a Parquet file.

    The same plan and unit give the same bytes in every process. Failures are not raised: the missions that
    failed are rows with their reason.

    Args:
        on_recorded: called once the traffic is recorded, before the first mission.
    """
    try:
        check_files(plan)
        ground = _Ground.of(plan, unit)
        on_recorded()
        with ground.replay:
            rows = [row for cell in plan.cells_of(unit) for row in _flown(plan, unit, cell, ground)]
    except Exception as error:
        return failed_unit(plan, unit, _words(error))
    return part_of(pl.DataFrame(rows, schema=schema(plan)))


def failed_unit(plan: Plan, unit: Unit, reason: str) -> bytes:
    """The part of a unit of which no mission could be flown."""
    rows = [row for cell in plan.cells_of(unit) for row in _failed(plan, unit, cell, reason)]
    return part_of(pl.DataFrame(rows, schema=schema(plan)))


def schema(plan: Plan) -> dict[str, Any]:
    design = plan.design
    swept = {
        column: _type_of(values) for column, values in zip(design.sweep_columns, design.sweep.values(), strict=True)
    }
    measured = {
        name: next(_TYPES[kind] for kind in (hint, *get_args(hint)) if kind in _TYPES)
        for name, hint in get_type_hints(SegmentMetrics).items()
        if name not in _LEFT_OUT
    }
    has_fitted = any(sensor_class(name).is_fitted for name in design.sensors)
    return {
        **{factor: pl.Float64 if factor == "altitude_m" else pl.String for factor in FACTORS},
        **swept,
        **dict.fromkeys((REPLICATE, "seed", "traffic_seed", "parking_seed", "defect_seed", "sensing_seed"), pl.Int64),
        "take_off_s": pl.Float64,
        **({FILES: pl.String} if plan.files else {}),
        **dict.fromkeys(("version", RENDERER, STATUS, REASON), pl.String),
        **measured,
        **(dict.fromkeys(COVERAGE_DRAWS, pl.Float64) if has_fitted else {}),
        **(dict.fromkeys(DETECTED, pl.Float64) if measures_sizes(design) else {}),
        **(MISSION_COLUMNS if design.tours else {}),
    }


def measures_sizes(design: Design) -> bool:
    """True if a study has a sensor that measures sizes."""
    return any(sensor_class(name).measures_sizes for name in design.sensors)


def _type_of(values: Sequence[Any]) -> Any:
    if are_texts(values):
        return pl.String
    return pl.Boolean if isinstance(values[0], bool) else pl.Float64


def part_of(table: pl.DataFrame) -> bytes:
    """Rows as a part of the study's table: a Parquet file."""
    if RENDERER in table.columns and table[RENDERER].null_count() == table.height:
        table = table.drop(RENDERER)
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(table.to_arrow(), buffer, compression="zstd")
    return buffer.getvalue()


def _flown(plan: Plan, unit: Unit, cell: Cell, ground: "_Ground") -> list[Row]:
    """The rows of one mission; it may fail."""
    try:
        settings = cell.settings(plan.design)
        environment = ground.environment(settings)
        spec = _spec(plan, unit, cell, settings, environment, ground.replay)
        eyes = ground.sensor(settings, environment)
        inputs = MissionInputs(environment, ground.replay)
        result = fly(spec, inputs=inputs, sensor=eyes, image_source=ground.image_source(environment))
        detected, reason = _detected(result) if eyes.measures_sizes else ({}, None)
    except Exception as error:
        return _failed(plan, unit, cell, _words(error))
    common: Row = {RENDERER: renderer_of(result.spec.versions), STATUS: FLOWN, REASON: reason}
    if plan.design.tours:
        common |= dict(zip(MISSION_COLUMNS, _whole(result), strict=True))
    return [
        _factors(plan, unit, cell) | common | _measured(row) | _drawn(row, result, eyes) | detected.get(row.segment, {})
        for row in result.rows
    ]


def _detected(result: MissionResult) -> tuple[Mapping[str, Row], str | None]:
    """By segment, the columns `DETECTED`; of none where the sensor measured nothing of what it reported, or where no
    inventory can be made of it, with the reason. The mission was flown all the same."""
    from pavetwin.inventory.condition import detected_of_segments

    true = {row.segment: row.pci for row in result.rows}
    try:
        indices = detected_of_segments(result)
    except (PaveTwinError, ShapelyError) as error:
        return {}, f"no condition index by what was detected: {_words(error)}"
    errors = {segment: (pci, pci - true[segment]) for segment, pci in indices.items()}
    columns = {
        segment: dict(zip(DETECTED, (pci, error, abs(error)), strict=True)) for segment, (pci, error) in errors.items()
    }
    return columns, None


def _drawn(row: SegmentMetrics, result: MissionResult, eyes: Sensor) -> Row:
    """The columns `COVERAGE_DRAWS`; none of a sensor that was not fitted, or without defects."""
    defects = result.environment.defects_by_segment.get(row.segment, ())
    chances = eyes.found_by_draws(defects) if defects else None
    return {} if chances is None else dict(zip(COVERAGE_DRAWS, chances.mean(axis=1).tolist(), strict=True))


def _whole(result: MissionResult) -> tuple[float, float, float, int]:
    """The values of `MISSION_COLUMNS`."""
    sums = totals(result)
    return sums.time_s, sums.energy, sums.distance_m, sums.batteries


def _spec(
    plan: Plan, unit: Unit, cell: Cell, settings: MissionSettings, environment: MissionEnvironment, replay: Replay
) -> MissionSpec:
    """The mission of a cell, from which `fly` repeats it alone."""
    design, seeds, world = plan.design, plan.seeds(unit.replicate), environment.world
    own = design.defects == "world"
    return MissionSpec.of(
        world=WorldInput.of(world),
        defects=DefectInput(
            seed=None if own else seeds.defects,
            options=None if own else _defect_options(design.worlds[unit.world].path, _defects_text(design)),
            on="world" if own else "targets",
            content_hash=environment.defects_hash,
        ),
        traffic=replay.source(),
        base=(world.base.x, world.base.y),
        targets=tuple(world.segments[index].id for index in plan.segments(unit)),
        policy=_policy_input(cell.policy),
        seed=seeds.sensing,
        parking_seed=seeds.traffic,
        parking_mix=replay.recording.origin.mix,
        settings=settings,
    )


def _failed(plan: Plan, unit: Unit, cell: Cell, reason: str) -> list[Row]:
    count = len(plan.segments(unit))
    return [_factors(plan, unit, cell) | {STATUS: FAILED, REASON: reason, "order": order} for order in range(count)]


def _factors(plan: Plan, unit: Unit, cell: Cell) -> Row:
    design, seeds = plan.design, plan.seeds(unit.replicate)
    return {
        **plan.levels(unit, cell),
        REPLICATE: unit.replicate,
        "seed": design.seed,
        "traffic_seed": None if design.worlds[unit.world].recordings else seeds.traffic,
        "parking_seed": seeds.traffic,
        "defect_seed": seeds.defects,
        "sensing_seed": seeds.sensing,
        "take_off_s": plan.take_off_s(unit),
        **({FILES: plan.files_hash(unit, cell)} if plan.files else {}),
        "version": _own_version(),
    }


@cache
def _own_version() -> str:
    return version("pavetwin")


def _measured(row: SegmentMetrics) -> Row:
    return {name: value for name, value in asdict(row).items() if name not in _LEFT_OUT}


_PRINTED: Final[set[tuple[str, str, int | None]]] = set()
"""Faults whose traceback this process has printed: type, file and line."""


def _words(error: Exception) -> str:
    """A failure in one line. One that no user can fix is named by its type, and its traceback is printed: once for each
    place, since a fault is often that of all missions."""
    text = " ".join(str(error).split())
    if isinstance(error, PaveTwinError):
        return text
    frame = traceback.extract_tb(error.__traceback__)[-1]
    if (place := (type(error).__name__, frame.filename, frame.lineno)) not in _PRINTED:
        _PRINTED.add(place)
        traceback.print_exception(error)
    return f"{type(error).__name__}: {text}"


@dataclass(frozen=True)
class _Ground:
    """World, traffic and sensors that the missions of a unit share."""

    place: "_Place"
    replay: Replay
    parking_seed: int
    sensing_seed: int
    images_of: ImageSourceFactory | None
    _image_sources: dict[ParkingInput, ImageSource] = field(default_factory=dict)
    _sensors: dict[tuple[str, ParkingInput], Sensor] = field(default_factory=dict)
    """Sensors that serve several missions, see `Sensor.is_reused`, keyed by their settings."""

    @classmethod
    def of(cls, plan: Plan, unit: Unit) -> "_Ground":
        design, seeds = plan.design, plan.seeds(unit.replicate)
        entry = design.worlds[unit.world]
        targets = tuple(sorted(plan.segments(unit)))
        place = _Place(entry.path, plan.hashes[unit.world], targets, seeds.defects, _defects_text(design))
        replay = _replay(plan, unit, place.world, entry)
        return cls(place, replay, seeds.traffic, seeds.sensing, plan.image_source_factory)

    def sensor(self, settings: MissionSettings, environment: MissionEnvironment) -> Sensor:
        key = settings.sensing.model_dump_json(), environment.parking
        if key not in self._sensors:
            reused = reused_sensor(settings.sensing, self.sensing_seed)
            if reused is None:
                return load_sensor(settings.sensing, self.sensing_seed)
            self._sensors[key] = reused
        return self._sensors[key]

    def image_source(self, environment: MissionEnvironment) -> ImageSource | None:
        if self.images_of is None:
            return None
        key = environment.parking
        if key not in self._image_sources:
            made = self.images_of(_inspected(self.place), self.replay, self.sensing_seed, environment.parked)
            self._image_sources[key] = made
        return self._image_sources[key]

    def environment(self, settings: MissionSettings) -> MissionEnvironment:
        uav = UavSettings(radius_m=settings.uav.radius_m, base=settings.uav.base)
        parking = ParkingInput.of(settings, self.parking_seed, self.replay.recording.origin.mix)
        return _environment(self.place, settings.altitude_m, uav, settings.visibility.cell_m, parking)


@dataclass(frozen=True)
class _Place:
    """Inputs of a unit's ground, equal in all traffic of a replicate."""

    path: str
    content_hash: str
    targets: tuple[int, ...]
    seed: int
    defects: str
    """Placement in the design: placed, world, or options as JSON."""

    @property
    def world(self) -> World:
        return world_of_study(self.path, self.content_hash)


@lru_cache(maxsize=2)
def _defects(place: _Place) -> tuple[Defect, ...]:
    """The defects of the segments that are inspected; others are not flown over by any pass."""
    world = place.world
    if place.defects == "world":
        return world.defects
    options = _defect_options(place.path, place.defects)
    return placed_on(world, [world.segments[target] for target in place.targets], place.seed, options, threads=1)


@lru_cache(maxsize=2)
def _sampled(place: _Place) -> Callable[[int], Float64Array]:
    """The sample points of a defect by its number: the same at all altitudes."""
    defects = _defects(place)
    return cache(lambda number: sample_points(defects[number]))


@lru_cache(maxsize=2)
def _inspected(place: _Place) -> World:
    """The world with these defects alone."""
    return replace(place.world, defects=_defects(place))


def _defects_text(design: Design) -> str:
    """Placement of defects in a design: placed, world, or options as JSON."""
    return design.defects if isinstance(design.defects, str) else design.defects.model_dump_json()


@cache
def _policy_input(name: str) -> PolicyInput:
    return PolicyInput.of(name)


@lru_cache(maxsize=16)
def _defect_options(path: str, defects: str) -> DefectOptions:
    """Options of placement over the world at `path`."""
    if defects == "placed":
        return DefectOptions.of_record(load_record(Path(path)))
    return DefectOptions.parse(json.loads(defects), where="the design: defects")


@lru_cache(maxsize=16)
def _environment(
    place: _Place, altitude_m: float, uav: UavSettings, cell_m: float, parking: ParkingInput
) -> MissionEnvironment:
    settings = load_settings(
        altitude_m=altitude_m,
        uav=uav.model_dump(),
        visibility={"cell_m": cell_m},
        parking=parking.settings.model_dump(),
        conditions={"date": parking.date, "time": parking.time},
    )
    around = _surroundings(place.path, place.content_hash, altitude_m, uav)
    return prepare(
        place.world,
        settings,
        _defects(place),
        around,
        points_of=_sampled(place),
        parking_seed=parking.seed,
        parking_mix=parking.mix,
    )


@lru_cache(maxsize=16)
def _surroundings(path: str, content_hash: str, altitude_m: float, uav: UavSettings) -> Surroundings:
    """Cached, since all replicates share it."""
    world = world_of_study(path, content_hash)
    return Surroundings.of(world, altitude_m, uav, standing=_solids(path, content_hash))


@lru_cache(maxsize=2)
def _solids(path: str, content_hash: str) -> Solids:
    """Solids of a world, equal at all altitudes."""
    return solids(world_of_study(path, content_hash))


def _replay(plan: Plan, unit: Unit, world: World, entry: WorldEntry) -> Replay:
    take_off_s = plan.take_off_s(unit)
    if file := entry.recording(unit.traffic):
        return Replay(world, recording_of(plan, world, file), file=file, start_s=take_off_s)
    routes = [Path(route) for route in entry.routes]
    density = None if unit.traffic == OWN_ROUTES else unit.traffic
    seed = plan.seeds(unit.replicate).traffic
    targets = [world.segments[index].id for index in plan.segments(unit)]
    area = None if plan.traffic_area_m is None else TrafficArea.around(world, targets, plan.traffic_area_m)
    recorder = Recorder(Inputs.of(world, density, seed, routes, area))
    recording = recorder.until(take_off_s + (QUIET_S if routes else RECORDED_S) * len(plan.segments(unit)))
    if routes and recording.after(take_off_s).is_empty:
        raise PaveTwinError(
            f"Nothing moves {take_off_s:.0f} s after the first departure: its demand has ended; change take_off_s."
        )
    return Replay(world, recording, routes, start_s=take_off_s, recorder=recorder)
